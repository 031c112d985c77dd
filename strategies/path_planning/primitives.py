"""Primitives, the closed-form paths between two poses, compiled: which there are, and their cost.

A primitive is a row of MAX_PIECES segments (length m, curvature 1/m, gear), with zero lengths where it has fewer.
Primitives come in families: Dubins' six (with both places of the middle circle of the three-arc ones), Reeds and
Shepp's C|C|C, and arc, straight in reverse, arc. Their kinds: three forward arcs are OMEGA; arc, straight, arc is OMEGA
if more than a quarter turn is turned in vain, U if the heading changes by a quarter turn or more, otherwise ROUTE.

Sources: L. E. Dubins, "On curves of minimal length with a constraint on average curvature", American Journal of
Mathematics 79 (1957); J. A. Reeds and L. A. Shepp, "Optimal paths for a car that goes both forwards and backwards",
Pacific Journal of Mathematics 145 (1990). The primitives are built from tangent circles, not from the papers' tables,
so that each has its exact mirror image.
"""

from __future__ import annotations

import math

import numpy as np

from vehicle.control.speed_profile import STEERING_DISTANCE_FACTOR, compute_straight_time_s
from vehicle.jit import compile_for_views

ROUTE, U, OMEGA, SWITCH_BACK = range(4)
MAX_PRIMITIVES, MAX_PIECES = 16, 5
TAU = 2.0 * math.pi
SNAP = 1e-12  # arcs (rad) and straights (m) shorter than this are rounding, not driving
FULL_TURN_RAD = TAU + 1e-9
# Places in the costs of a search: forward and reverse speed (m/s), seconds per direction change, seconds per 1/m of
# curvature by which the wheels turn over in it, and the values of vehicle.control.speed_profile.DrivingLimits.
(
    COST_FORWARD, COST_REVERSE, COST_CUSP, COST_SWING,
    COST_LATERAL, COST_STEERING, COST_WINDOW, COST_LENGTH, COST_ACCELERATION,
) = range(9)  # fmt: skip
SLOW_WINDOWS = 3.0  # steering distances driven slowly where two curvatures meet


@compile_for_views
def wrap_angle(angle: float) -> float:
    """The angle in [-pi, pi]; halves go to the even multiple, as in math.remainder."""
    return angle - TAU * np.round(angle / TAU)  # type: ignore[no-any-return]


@compile_for_views
def compute_turned_angle(hand: float, start: float, end: float) -> float:
    """Angle in [0, 2 pi) turned to the given hand (1 left, -1 right) from one heading to another."""
    angle = (hand * (end - start)) % TAU
    return 0.0 if angle > TAU - SNAP else angle


@compile_for_views
def advance_pose(x, y, heading, length, curvature, gear):  # type: ignore[no-untyped-def]
    """Pose after a segment."""
    run = gear * length
    half = 0.5 * curvature * run
    chord = run * (math.sin(half) / half if half != 0.0 else 1.0)
    angle = heading + half
    return x + chord * math.cos(angle), y + chord * math.sin(angle), wrap_angle(heading + 2.0 * half)


@compile_for_views
def _write_primitive(out, count, p0, k0, g0, p1, k1, g1, p2, k2, g2) -> None:  # type: ignore[no-untyped-def]
    out[count] = 0.0
    out[count, 0, 0], out[count, 0, 1], out[count, 0, 2] = p0, k0, g0
    out[count, 1, 0], out[count, 1, 1], out[count, 1, 2] = p1, k1, g1
    out[count, 2, 0], out[count, 2, 1], out[count, 2, 2] = p2, k2, g2
    out[count, 3, 2] = out[count, 4, 2] = 1.0


@compile_for_views
def _add_arc_straight_arc(ax, ay, ah, bx, by, bh, radius, first_hand, second_hand, gear, out, count, kinds):  # type: ignore[no-untyped-def]
    """Add the primitive with these hands and the straight in the given gear; returns the number of primitives then."""
    cx, cy = ax - first_hand * radius * math.sin(ah), ay + first_hand * radius * math.cos(ah)
    dx = gear * (bx - second_hand * radius * math.sin(bh) - cx)
    dy = gear * (by + second_hand * radius * math.cos(bh) - cy)
    run = math.hypot(dx, dy)
    heading = math.atan2(dy, dx) if run > SNAP else ah
    if first_hand != second_hand:
        square = run * run - 4.0 * radius * radius
        if square < -SNAP * radius * radius:
            return count
        run = math.sqrt(max(square, 0.0))
        heading += math.atan2(2.0 * gear * first_hand * radius, run)
    first, second = compute_turned_angle(first_hand, ah, heading), compute_turned_angle(second_hand, heading, bh)
    if gear < 0.0 and first + second > FULL_TURN_RAD:
        return count
    _write_primitive(
        out, count, first * radius, first_hand / radius, 1.0, run, 0.0, gear, second * radius, second_hand / radius, 1.0
    )
    change = abs(wrap_angle(bh - ah))
    if gear < 0.0:
        kinds[count] = SWITCH_BACK
    elif first + second - change > 0.5 * math.pi + 1e-9:
        kinds[count] = OMEGA
    else:
        kinds[count] = U if change >= 0.5 * math.pi - 1e-9 else ROUTE
    return count + 1


@compile_for_views
def _add_three_arcs(ax, ay, ah, bx, by, bh, radius, hand, gear, out, count, kinds):  # type: ignore[no-untyped-def]
    """Add both primitives arc, opposite arc in the given gear, arc; returns the number of primitives then."""
    cx, cy = ax - hand * radius * math.sin(ah), ay + hand * radius * math.cos(ah)
    ex, ey = bx - hand * radius * math.sin(bh), by + hand * radius * math.cos(bh)
    dx, dy = ex - cx, ey - cy
    apart = math.hypot(dx, dy)
    square = 4.0 * radius * radius - 0.25 * apart * apart
    if square < -SNAP * radius * radius:
        return count
    rise = math.sqrt(max(square, 0.0))
    ux, uy = (dx / apart, dy / apart) if apart > SNAP else (math.cos(ah), math.sin(ah))
    for side in (hand, -hand):
        mx, my = 0.5 * (cx + ex) - side * rise * uy, 0.5 * (cy + ey) + side * rise * ux
        near = math.atan2(-hand * (cx - mx), hand * (cy - my))
        far = math.atan2(-hand * (ex - mx), hand * (ey - my))
        middle_rad = compute_turned_angle(-hand, near, far)
        first_rad, last_rad = compute_turned_angle(hand, ah, near), compute_turned_angle(hand, far, bh)
        if gear < 0.0:
            # In reverse the middle arc bends the same way while the heading keeps turning.
            middle_rad = compute_turned_angle(hand, near, far)
            if first_rad + middle_rad + last_rad > FULL_TURN_RAD:
                continue
        _write_primitive(
            out,
            count,
            first_rad * radius,
            hand / radius,
            1.0,
            middle_rad * radius,
            -hand / radius,
            gear,
            last_rad * radius,
            hand / radius,
            1.0,
        )
        kinds[count] = OMEGA if gear > 0.0 else SWITCH_BACK
        count += 1
    return count


@compile_for_views
def add_forward_primitives(a, b, radius, out, kinds, count) -> int:  # type: ignore[no-untyped-def]
    """Add Dubins' primitives from pose a to pose b behind the first `count`; returns the new count."""
    for first_hand, second_hand in ((1.0, 1.0), (-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0)):
        count = _add_arc_straight_arc(
            a[0], a[1], a[2], b[0], b[1], b[2], radius, first_hand, second_hand, 1.0, out, count, kinds
        )
    for hand in (1.0, -1.0):
        count = _add_three_arcs(a[0], a[1], a[2], b[0], b[1], b[2], radius, hand, 1.0, out, count, kinds)
    return count  # type: ignore[no-any-return]


@compile_for_views
def add_reverse_arc_primitives(a, b, radius, out, kinds, count) -> int:  # type: ignore[no-untyped-def]
    """As `add_forward_primitives`: three arcs, the middle one in reverse."""
    for hand in (1.0, -1.0):
        count = _add_three_arcs(a[0], a[1], a[2], b[0], b[1], b[2], radius, hand, -1.0, out, count, kinds)
    return count  # type: ignore[no-any-return]


@compile_for_views
def add_reverse_straight_primitives(a, b, radius, out, kinds, count) -> int:  # type: ignore[no-untyped-def]
    """As `add_forward_primitives`: two arcs and between them a straight in reverse."""
    for first_hand, second_hand in ((1.0, 1.0), (-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0)):
        count = _add_arc_straight_arc(
            a[0], a[1], a[2], b[0], b[1], b[2], radius, first_hand, second_hand, -1.0, out, count, kinds
        )
    return count  # type: ignore[no-any-return]


@compile_for_views
def _compute_reached_curvature(primitive, piece, costs) -> float:  # type: ignore[no-untyped-def]
    """The curvature a tractor reaches on a segment: less than planned on one shorter than the steering distance."""
    length, window = primitive[piece, 0], costs[COST_WINDOW]
    return primitive[piece, 1] if length >= window else primitive[piece, 1] * length / window  # type: ignore[no-any-return]


@compile_for_views
def _compute_piece_speed(bend, wheel, gear, costs) -> float:  # type: ignore[no-untyped-def]
    """Largest speed at a curvature, with the wheels at an angle, in a gear."""
    speed = costs[COST_REVERSE] if gear < 0.0 else costs[COST_FORWARD]
    if bend == 0.0:
        return speed  # type: ignore[no-any-return]
    returning = costs[COST_STEERING] / (STEERING_DISTANCE_FACTOR * abs(wheel))
    return min(speed, math.sqrt(costs[COST_LATERAL] / abs(bend)), returning)  # type: ignore[no-any-return]


@compile_for_views
def _compute_steering_loss_s(change, base, costs) -> float:  # type: ignore[no-untyped-def]
    """Seconds lost where the wheels turn by `change` (rad), with `base` the lower of the speeds beside it."""
    if change * base <= costs[COST_STEERING]:
        return 0.0
    slow = costs[COST_STEERING] / change
    braking_s = (base - slow) ** 2 / (base * costs[COST_ACCELERATION])
    return SLOW_WINDOWS * costs[COST_WINDOW] * (1.0 / slow - 1.0 / base) + braking_s  # type: ignore[no-any-return]


@compile_for_views
def compute_drive_time_s(primitive, costs) -> float:  # type: ignore[no-untyped-def]
    """Seconds to drive a primitive (n, 3) or a path of any number of segments between two straight swaths.

    `costs` (9,) are described above. Direction changes at the ends count, and so does slowing down before the
    first bend and speeding up after the last.
    """
    forward, acceleration = costs[COST_FORWARD], costs[COST_ACCELERATION]
    seconds, gear, curvature, wheel, speed = 0.0, 1.0, 0.0, 0.0, forward
    straight_m, straight_start = 0.0, forward  # of the straight that is being driven
    for piece in range(len(primitive)):
        if primitive[piece, 0] <= SNAP:
            continue
        bend, direction = _compute_reached_curvature(primitive, piece, costs), primitive[piece, 2]
        turned = math.atan(costs[COST_LENGTH] * bend) if bend != 0.0 else 0.0
        own = _compute_piece_speed(bend, turned, direction, costs)
        if direction != gear:
            seconds += costs[COST_CUSP] + costs[COST_SWING] * abs(bend - curvature)
        else:
            seconds += _compute_steering_loss_s(abs(turned - wheel), min(speed, own), costs)
        if curvature == 0.0:
            end = speed if direction != gear else min(own, speed)
            seconds += compute_straight_time_s(straight_m, speed, straight_start, end, acceleration)
        if bend == 0.0:
            straight_m, straight_start = primitive[piece, 0], own if direction != gear else min(speed, own)
        else:
            seconds += primitive[piece, 0] / own
        gear, curvature, wheel, speed = direction, bend, turned, own
    if gear < 0.0:
        seconds += costs[COST_CUSP] + costs[COST_SWING] * abs(curvature)
    if curvature == 0.0:
        seconds += compute_straight_time_s(straight_m, speed, straight_start, speed, acceleration)
    else:
        seconds += _compute_steering_loss_s(abs(wheel), speed, costs)
        seconds += compute_straight_time_s(0.0, forward, min(speed, forward), forward, acceleration)
    return seconds
