"""Moves in closed form, compiled: the quickest from pose to pose, and of these those on which the body has room.

A closed form is straight on (or back), a primitive of Dubins or Reeds and Shepp, and straight on into the next line (or
back and forth into it); or straight, one arc and straight. It is a table of ROWS segments (length m, curvature 1/m,
gear) with zero lengths where it has fewer.
"""

from __future__ import annotations

import math

import numpy as np

from fields.arrays import Floats
from strategies.path_planning.paths import PATH_KINDS, DrivePath, Pose, build_path_from_rows, place_in_frame
from strategies.path_planning.primitives import (
    MAX_PIECES,
    MAX_PRIMITIVES,
    ROUTE,
    SWITCH_BACK,
    U,
    add_forward_primitives,
    add_reverse_arc_primitives,
    add_reverse_straight_primitives,
    compute_drive_time_s,
    wrap_angle,
)
from strategies.site.ground import measure_length_inside, measure_path_room
from vehicle.copying import copy_table
from vehicle.jit import compile_for_views, compile_function

ROWS = MAX_PIECES + 2
LEADS_OUT_M = np.array([0.0, 2.0, 5.0, 10.0, -3.0, -7.0])  # straight on before the first arc, or back
LEADS_IN_M = np.array([2.5, 0.0, 5.0, 10.0, -4.0, -8.0])  # straight before the next line, or back into it
SAME_S = 0.02  # candidates that take as long as this are one path, built twice
FARTHEST_M = 60.0  # straights of a plain corner are no longer
CURVED_REVERSE_S = 20.0  # in reverse the rear axle leads, so that an arc falls short: charged so much
LEAST_TURN = 0.1  # sine of the angle between two lines that one arc joins
FEW_FORMS = 12  # tried where many pairs of poses are asked for


@compile_for_views
def _write_row(rows, number, length, curvature, gear) -> None:  # type: ignore[no-untyped-def]
    rows[number, 0], rows[number, 1], rows[number, 2] = length, curvature, gear


@compile_for_views
def _clear_rows(rows) -> None:  # type: ignore[no-untyped-def]
    for number in range(len(rows)):
        _write_row(rows, number, 0.0, 0.0, 1.0)


@compile_for_views
def _add_plain_corners(b, radius, forms, kinds, count) -> int:  # type: ignore[no-untyped-def]
    """Add straight, arc, straight from the origin to pose b, forwards and with the arc in reverse; the new count."""
    turn, sine = wrap_angle(b[2]), math.sin(b[2])
    if abs(sine) <= LEAST_TURN:
        return count  # type: ignore[no-any-return]
    before, after = b[0] - b[1] * math.cos(b[2]) / sine, b[1] / sine  # to where the two lines meet
    hand, tangent = (1.0 if turn > 0.0 else -1.0), radius * math.tan(0.5 * abs(turn))
    for gear in (1.0, -1.0):
        first, last = before - gear * tangent, after - gear * tangent
        if abs(first) < FARTHEST_M and abs(last) < FARTHEST_M:
            _clear_rows(forms[count])
            _write_row(forms[count], 0, abs(first), 0.0, 1.0 if first >= 0.0 else -1.0)
            _write_row(forms[count], 1, radius * abs(turn), gear * hand / radius, gear)
            _write_row(forms[count], ROWS - 1, abs(last), 0.0, 1.0 if last >= 0.0 else -1.0)
            is_forward = first >= 0.0 and last >= 0.0 and gear > 0.0
            kinds[count] = (U if abs(turn) >= 0.5 * math.pi else ROUTE) if is_forward else SWITCH_BACK
            count += 1
    return count  # type: ignore[no-any-return]


@compile_function
def _add_primitives(b, lead_out, lead_in, radius, forms, kinds, count) -> int:  # type: ignore[no-untyped-def]
    """Add lead out, a primitive and lead in from the origin to pose b, forwards and in reverse; the new count."""
    primitives, primitive_kinds = np.zeros((MAX_PRIMITIVES, MAX_PIECES, 3)), np.zeros(MAX_PRIMITIVES, np.int64)
    start, goal = np.zeros(3), np.empty(3)
    start[0] = lead_out
    goal[0], goal[1], goal[2] = b[0] - lead_in * math.cos(b[2]), b[1] - lead_in * math.sin(b[2]), b[2]
    for gear in (1.0, -1.0):
        if gear < 0.0:
            if lead_out < 0.0 or lead_in < 0.0:
                break
            start[2], goal[2] = math.pi, b[2] + math.pi
        found = add_forward_primitives(start, goal, radius, primitives, primitive_kinds, 0)
        if gear > 0.0 and lead_out >= 0.0 and lead_in >= 0.0:
            found = add_reverse_arc_primitives(start, goal, radius, primitives, primitive_kinds, found)
            found = add_reverse_straight_primitives(start, goal, radius, primitives, primitive_kinds, found)
        for k in range(found):
            _clear_rows(forms[count])
            _write_row(forms[count], 0, abs(lead_out), 0.0, 1.0 if lead_out >= 0.0 else -1.0)
            for piece in range(MAX_PIECES):
                bend, way = gear * primitives[k, piece, 1], gear * primitives[k, piece, 2]
                _write_row(forms[count], 1 + piece, primitives[k, piece, 0], bend, way)
            _write_row(forms[count], ROWS - 1, abs(lead_in), 0.0, 1.0 if lead_in >= 0.0 else -1.0)
            is_forward = gear > 0.0 and lead_out >= 0.0 and lead_in >= 0.0
            kinds[count] = primitive_kinds[k] if is_forward else SWITCH_BACK
            count += 1
    return count  # type: ignore[no-any-return]


@compile_for_views
def compute_awkward_s(rows) -> float:  # type: ignore[no-untyped-def]
    """Charge (s) of rows (n, 3) for reversing on an arc."""
    for k in range(len(rows)):
        if rows[k, 2] < 0.0 and rows[k, 0] > 0.0 and rows[k, 1] != 0.0:
            return CURVED_REVERSE_S
    return 0.0


@compile_for_views
def back_up(backed, length, gear) -> float:  # type: ignore[no-untyped-def]
    """How far (m) a machine has backed up after a segment: driving forwards makes up for it metre by metre."""
    return backed + length if gear < 0.0 else max(0.0, backed - length)  # type: ignore[no-any-return]


@compile_for_views
def measure_backing_up(rows, backed) -> float:  # type: ignore[no-untyped-def]
    """The farthest (m) that rows (n, 3) back up, at the begin of which a machine has backed up `backed` metres."""
    farthest = backed
    for k in range(len(rows)):
        backed = back_up(backed, rows[k, 0], rows[k, 2])
        farthest = max(farthest, backed)
    return farthest  # type: ignore[no-any-return]


@compile_for_views
def charge_backing_up_s(rows, backed, max_reverse, far) -> float:  # type: ignore[no-untyped-def]
    """Charge (s) of rows (n, 3): `far` s/m, which may be infinite, for each metre beyond `max_reverse` that they back
    up."""
    beyond = measure_backing_up(rows, backed) - max_reverse
    return far * beyond if beyond > 0.0 else 0.0


@compile_for_views
def _interpolate(place, curve) -> float:  # type: ignore[no-untyped-def]
    """The value of a curve (2, k: places, values) at a place: np.interp takes ten times as long for one."""
    places, values = curve
    for k in range(1, len(places)):
        if place < places[k]:
            slope = (values[k] - values[k - 1]) / (places[k] - places[k - 1])
            return slope * (max(place, places[k - 1]) - places[k - 1]) + values[k - 1]  # type: ignore[no-any-return]
    return values[-1]  # type: ignore[no-any-return]


@compile_for_views
def estimate_settling_s(rows, settling) -> float:  # type: ignore[no-untyped-def]
    """Charge (s) for beginning a line after rows (n, 3), by the metres driven straight since their last arc.

    `settling` (2, k): such metres, and the charge for beginning a line then.
    """
    straight, bends = 0.0, False
    for k in range(len(rows)):
        if rows[k, 0] > 0.0 and rows[k, 1] != 0.0:
            straight, bends = 0.0, True
        else:
            straight += rows[k, 0]
    return _interpolate(straight, settling) if bends else 0.0


@compile_function
def list_closed_forms(  # type: ignore[no-untyped-def]
    b, radii, costs, settling, leads_out, leads_in, allowed_kinds, backed, max_reverse, far, most
):
    """The closed forms (k <= most, ROWS, 3) from the origin to pose b (3,) with the least seconds, charges included,
    the least first, and these seconds.

    `radii` (r,) are tried in turn; `allowed_kinds` (4,) says which kinds of primitives may be driven; kinds (k,) come
    third. `settling` as of estimate_settling_s. A machine has backed up `backed` metres already at the origin; each
    metre beyond `max_reverse` is charged `far` s/m, and a form with such metres is left out where that is infinite.
    """
    size = len(radii) * (2 + 2 * MAX_PRIMITIVES * len(leads_out) * len(leads_in))
    forms, kinds, seconds = np.empty((size, ROWS, 3)), np.zeros(size, np.int64), np.empty(size)
    count = 0
    for r in range(len(radii)):
        count = _add_plain_corners(b, radii[r], forms, kinds, count)
        for i in range(len(leads_out)):
            for j in range(len(leads_in)):
                count = _add_primitives(b, leads_out[i], leads_in[j], radii[r], forms, kinds, count)
    for k in range(count):
        seconds[k] = np.inf
        if allowed_kinds[kinds[k]]:
            seconds[k] = compute_drive_time_s(forms[k], costs) + compute_awkward_s(forms[k])
            seconds[k] += estimate_settling_s(forms[k], settling)
            seconds[k] += charge_backing_up_s(forms[k], backed, max_reverse, far)
    order = np.argsort(seconds[:count])
    kept, kept_s, kept_kinds = np.empty((most, ROWS, 3)), np.empty(most), np.empty(most, np.int64)
    found, last = 0, -1.0
    for k in order:
        if found == most or seconds[k] == np.inf:
            break
        if seconds[k] - last < SAME_S:
            continue
        copy_table(forms[k], kept[found])
        kept_s[found] = last = seconds[k]
        kept_kinds[found] = kinds[k]
        found += 1
    return kept[:found].copy(), kept_s[:found].copy(), kept_kinds[:found].copy()


@compile_for_views
def _find_first_row(rows) -> int:  # type: ignore[no-untyped-def]
    """The number of the first of rows (n, 3) that is driven."""
    for k in range(len(rows)):
        if rows[k, 0] > 0.0:
            return k
    return 0


@compile_for_views
def _is_blocked(row, blocked) -> bool:  # type: ignore[no-untyped-def]
    """Whether a row (3,) leads as far as one of the blocked ones (n, 3) with its curvature and gear."""
    for k in range(len(blocked)):
        if row[1] == blocked[k, 1] and row[2] == blocked[k, 2] and row[0] >= blocked[k, 0]:
            return True
    return False


@compile_function
def pick_with_room(a, forms, most, guide, points, reach, grid, frame, margin):  # type: ignore[no-untyped-def]
    """Numbers of the first `most` of the forms (k, ROWS, 3) from pose a (3,) on which the body keeps `margin`.

    Many begin alike: where one has no room on its first row, none has that leads as far on such a row.
    """
    numbers, found = np.empty(most, np.int64), 0
    blocked, known = np.empty((len(forms), 3)), 0
    for k in range(len(forms)):
        first = forms[k, _find_first_row(forms[k])]
        if _is_blocked(first, blocked[:known]):
            continue
        room, driven = measure_path_room(a, forms[k], guide, points, reach, grid, frame, margin)
        if room >= margin:
            numbers[found] = k
            found += 1
            if found == most:
                break
        elif driven <= first[0]:
            blocked[known, 0], blocked[known, 1], blocked[known, 2] = driven, first[1], first[2]
            known += 1
    return numbers[:found]


def find_forward_path(a: Pose, b: Pose, radius_m: float, speeds: Floats) -> DrivePath:
    """The quickest path from a to b on open ground, driven forwards."""
    forward, none = np.array([kind != PATH_KINDS[SWITCH_BACK] for kind in PATH_KINDS]), np.zeros(1)
    goal, settled, radii = np.array(place_in_frame(a, b)), np.zeros((2, 1)), np.array([radius_m])
    forms, _, kinds = list_closed_forms(goal, radii, speeds, settled, none, none, forward, 0.0, 0.0, np.inf, 1)
    return build_path_from_rows(a, forms[0], PATH_KINDS[kinds[0]])


@compile_function
def weigh_forms(a, forms, numbers, costs, settling, kept):  # type: ignore[no-untyped-def]
    """Seconds (k, 3) of some of the forms (n, m, 3) from pose a (3,): as driven, charged, and for settling after.

    `kept` is what Site.get_kept gives.
    """
    grid, frame, depth, wheels_s_per_m = kept
    weights = np.empty((len(numbers), 3))
    for place, k in enumerate(numbers):
        wheels = measure_length_inside(a, forms[k], grid, frame, depth)
        weights[place, 0] = compute_drive_time_s(forms[k], costs)
        weights[place, 1] = compute_awkward_s(forms[k]) + wheels_s_per_m * wheels
        weights[place, 2] = estimate_settling_s(forms[k], settling)
    return weights
