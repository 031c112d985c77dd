"""A move where no closed form has room: hybrid A* with the body in it, compiled.

From every pose short arcs to either side and a short straight lead on, forwards and in reverse. Poses keep their exact
place and heading; one per cell, sector of headings and gear is followed further. The way that remains is measured over
the grid of the ground, so that the search goes round obstacles at once, and with what turning into it takes, so that
it turns before it drives. A closed form that is not charged ends it as soon as one has room.

Source: D. Dolgov, S. Thrun, M. Montemerlo, J. Diebel, "Practical search techniques in path planning for autonomous
driving", STAIR workshop at AAAI (2008).
"""

from __future__ import annotations

import heapq
import math

import numpy as np

from strategies.moves.closed_forms import (
    back_up,
    charge_backing_up_s,
    list_closed_forms,
    measure_backing_up,
    pick_with_room,
)
from strategies.path_planning.primitives import TAU, advance_pose, wrap_angle
from strategies.site.ground import AMPLE_M, get_distance, has_room_on_path, measure_length_inside, measure_path_room
from vehicle.copying import copy_table
from vehicle.jit import compile_function

COARSE = 3  # cells of the ground to a cell of the way that remains
LEAST_STEP_M, STEP_RADII = 1.25, 0.28  # a step of the search, by the turning radius: large machines look as far
CELL_SHARE = 0.64  # of a step: it leads to another cell
SECTORS = 36  # of headings
GREED = 1.5  # weight of the way that remains: a path a little longer is found much sooner
MANOEUVRE_RADII = 12.0  # no search looks where the way is longer than the shortest by so many turning radii
TIGHT_FACTOR = 2.0  # a step with less than ample room takes so much longer: drives err
BEND_S = 0.6  # charge for another curvature: wheels take time to turn
SHOT_EVERY, SHOT_FORMS = 15, 30  # how often closed forms to the goal are tried, and how many of the quickest
SHOT_OUT_M, SHOT_IN_M = np.array([0.0]), np.array([2.5, 0.0, -4.0])


@compile_function
def measure_remaining_m(a, b, half, radius, speed, kept, grid, frame):  # type: ignore[no-untyped-def]
    """Metres (ny, nx) to pose b over coarse cells whose middle has at least `half` metres of room; else infinite.

    On kept ground (Site.get_kept) they are as many as are driven at `speed` in the time, with what wheels are charged.
    They are measured where a search from pose a looks: not where the way is longer than the shortest by more than
    MANOEUVRE_RADII of `radius`.
    """
    kept_grid, kept_frame, depth, wheels_s_per_m = kept
    rows, columns = grid.shape[0] // COARSE, grid.shape[1] // COARSE
    cell = COARSE * frame[2]
    remaining = np.full((rows, columns), np.inf)
    j, i = int((b[1] - frame[1]) / cell), int((b[0] - frame[0]) / cell)
    if j < 0 or i < 0 or j >= rows or i >= columns:
        return remaining
    remaining[j, i] = 0.0
    row, column, longest = (a[1] - frame[1]) / cell - 0.5, (a[0] - frame[0]) / cell - 0.5, np.inf
    heap = [(cell * math.hypot(i - column, j - row), j, i)]  # by the length of the way from a by straight lines
    while len(heap) > 0:
        length, j, i = heapq.heappop(heap)
        if length > longest:
            break
        distance, left = remaining[j, i], cell * math.hypot(i - column, j - row)
        if length > distance + left + 1e-6:
            continue
        if left < 2.0 * cell:
            longest = min(longest, distance + MANOEUVRE_RADII * radius)
        east, north = frame[0] + i * cell + COARSE // 2 * frame[2], frame[1] + j * cell + COARSE // 2 * frame[2]
        is_kept = get_distance(east, north, kept_grid, kept_frame) > depth
        factor = 1.0 + speed * wheels_s_per_m if is_kept else 1.0
        for dj in range(-1, 2):
            for di in range(-1, 2):
                q, p = j + dj, i + di
                if q < 0 or p < 0 or q >= rows or p >= columns:
                    continue
                if grid[COARSE * q + COARSE // 2, COARSE * p + COARSE // 2] < half:
                    continue
                longer = distance + factor * cell * math.sqrt(float(di * di + dj * dj))
                if longer < remaining[q, p] - 1e-9:
                    remaining[q, p] = longer
                    heapq.heappush(heap, (longer + cell * math.hypot(p - column, q - row), q, p))
    return remaining


@compile_function
def _expect_m(x, y, heading, b, radius, max_reverse, far, remaining, frame) -> float:  # type: ignore[no-untyped-def]
    """The metres that a move is expected to take from a pose to pose b, infinite where no way remains.

    Close to an edge its own cell may have no room: the least about it counts. A way farther than it may back up is
    driven forwards: turning into it by an angle t drives an arc of `radius` t and comes no more than `radius` sin t on.
    Backing up instead is as dear as `far` metres for each metre too far.
    """
    cell = COARSE * frame[2]
    j, i = int((y - frame[1]) / cell), int((x - frame[0]) / cell)
    left, row, column = np.inf, j, i
    for q in range(max(0, j - 1), min(remaining.shape[0], j + 2)):
        for p in range(max(0, i - 1), min(remaining.shape[1], i + 2)):
            if remaining[q, p] < left:
                left, row, column = remaining[q, p], q, p
    turning = 0.0
    if max_reverse < left < np.inf:
        towards = math.atan2(frame[1] + (row + 0.5) * cell - y, frame[0] + (column + 0.5) * cell - x)
        turn = abs(wrap_angle(heading - towards))
        turning = min(radius * (turn - math.sin(turn)), far * (left - max_reverse))
    off = abs(wrap_angle(heading - b[2]))
    return max(left + turning, 0.5 * (left + radius * off))  # type: ignore[no-any-return]


@compile_function
def _find_cell(x, y, heading, way, step):  # type: ignore[no-untyped-def]
    """The cell, sector of headings and gear by which poses of a search are told apart."""
    column, row = math.floor(x / (CELL_SHARE * step)), math.floor(y / (CELL_SHARE * step))
    return np.int64(column), np.int64(row), np.int64(math.floor((heading % TAU) / TAU * SECTORS)), np.int64(way)


@compile_function
def _add_step_s(spent_s, step, bend_before, gear_before, slow, costs, tightness, far) -> float:  # type: ignore[no-untyped-def]
    """Seconds spent up to the end of a step (1, 3: length, curvature, gear), arcs at the speed `slow`, with what a
    change of either costs; a step takes `tightness` times as long and is charged `far` s/m."""
    length, bend, gear = step[0, 0], step[0, 1], step[0, 2]
    step_s = length / (costs[1] if gear < 0.0 else slow if bend != 0.0 else costs[0]) * tightness + far * length
    seconds = spent_s + step_s
    if gear != gear_before:
        seconds += costs[2] + costs[3] * abs(bend - bend_before)
    elif bend != bend_before:
        seconds += BEND_S
    return seconds  # type: ignore[no-any-return]


@compile_function
def _charge_wheels(pose, rows, kept) -> float:  # type: ignore[no-untyped-def]
    """Seconds charged for wheels on kept ground along rows from a pose."""
    grid, frame, depth, wheels_s_per_m = kept
    return wheels_s_per_m * measure_length_inside(pose, rows, grid, frame, depth)  # type: ignore[no-any-return]


@compile_function
def _find_end(  # type: ignore[no-untyped-def]
    pose, b, radii, costs, settling, kinds, backed, max_reverse, far, kept, guide, points, reach, grid, frame, margin
):
    """The first closed form (ROWS, 3) with room of those that list_closed_forms has from a pose to pose b, its seconds,
    infinite for none, and what of them it is charged for backing up far and for wheels; wheels do not decide which is
    first.
    """
    dx, dy, cosine, sine = b[0] - pose[0], b[1] - pose[1], math.cos(pose[2]), math.sin(pose[2])
    goal = np.array([dx * cosine + dy * sine, dy * cosine - dx * sine, b[2] - pose[2]])
    forms, seconds, _ = list_closed_forms(
        goal, radii, costs, settling, SHOT_OUT_M, SHOT_IN_M, kinds, backed, max_reverse, far, SHOT_FORMS
    )
    numbers = pick_with_room(pose, forms, 1, guide, points, reach, grid, frame, margin)
    if len(numbers) == 0:
        return np.empty((0, 3)), np.inf, 0.0
    best, wheels_s = forms[numbers[0]], _charge_wheels(pose, forms[numbers[0]], kept)
    far_s = charge_backing_up_s(best, backed, max_reverse, far)
    return best, seconds[numbers[0]] + wheels_s, far_s + wheels_s


@compile_function
def search_move(a, b, remaining, radii, costs, settling, kinds, max_reverse, far, kept, most, body):  # type: ignore[no-untyped-def]
    """Rows (k, 3) of a path from pose a to pose b on which the body keeps `margin`; none if none is found.

    `remaining` is the way that remains (measure_remaining_m), `max_reverse` how far it may back up (m) without a charge
    of `far` s/m, `kept` the ground where wheels are charged (Site.get_kept). A path whose end is charged is kept until
    no other promises to be quicker. `most` poses may be expanded. `body` is what measure_path_room takes.
    """
    radius, gears = radii[0], 2 if kinds[3] else 1
    step_m, slow = max(LEAST_STEP_M, STEP_RADII * radius), min(costs[0], math.sqrt(costs[4] * radius))
    size, how = 6 * most + 8, (radii, costs, settling, kinds)
    frame, margin = body[4], body[5]
    poses, spent_s, came = np.empty((size, 3)), np.empty(size), np.empty(size, np.int64)
    bends, ways, backed = np.zeros(size), np.ones(size), np.zeros(size)
    poses[0, 0], poses[0, 1], poses[0, 2] = a[0], a[1], a[2]
    spent_s[0], came[0] = 0.0, -1
    count, expanded = 1, 0
    best_s = {(np.int64(0), np.int64(0), np.int64(-1), np.int64(0)): 0.0}
    heap, step = [(0.0, 0)], np.empty((1, 3))
    last_node, last_link, last_s = 0, np.empty((0, 3)), np.inf
    while len(heap) > 0 and expanded < most:
        promised_s, node = heapq.heappop(heap)
        if promised_s > last_s:
            break
        x, y, heading = poses[node]
        expanded += 1
        if expanded % SHOT_EVERY == 1:
            link, link_s, charged_s = _find_end(poses[node], b, *how, backed[node], max_reverse, far, kept, *body)
            if link_s < np.inf and charged_s == 0.0:
                return _trace_rows(node, came, bends, ways, link, step_m)
            if spent_s[node] + link_s < last_s:
                last_node, last_link, last_s = node, link, spent_s[node] + link_s
        for way in range(gears):
            gear = 1.0 if way == 0 else -1.0
            behind = back_up(backed[node], step_m, gear)
            charge = far if gear < 0.0 and behind > max_reverse else 0.0
            for side in range(-1, 2):
                bend = side / radius
                step[0, 0], step[0, 1], step[0, 2] = step_m, bend, gear
                room, _ = measure_path_room(poses[node], step, *body)
                if room < margin:
                    continue
                u, v, after = advance_pose(x, y, heading, step_m, bend, gear)
                expected_m = _expect_m(u, v, after, b, radius, max_reverse, far * costs[0], remaining, frame)
                if expected_m == np.inf:
                    continue
                tightness = TIGHT_FACTOR if room < margin + AMPLE_M else 1.0
                before_s = spent_s[node] + _charge_wheels(poses[node], step, kept)
                seconds = _add_step_s(before_s, step, bends[node], ways[node], slow, costs, tightness, charge)
                key = _find_cell(u, v, after, way, step_m)
                if key in best_s and best_s[key] <= seconds + 1e-9:
                    continue
                best_s[key] = seconds
                poses[count, 0], poses[count, 1], poses[count, 2] = u, v, after
                spent_s[count], came[count] = seconds, node
                bends[count], ways[count], backed[count] = bend, gear, behind
                heapq.heappush(heap, (seconds + GREED * expected_m / costs[0], count))
                count += 1
    return _trace_rows(last_node, came, bends, ways, last_link, step_m)


@compile_function
def has_way_on(a, gears, radius, most, guide, points, reach, grid, frame, margin):  # type: ignore[no-untyped-def]
    """Whether at least `most` places are reached from pose a by arcs and straights in the gears given."""
    size, step_m = 6 * most + 8, max(LEAST_STEP_M, STEP_RADII * radius)
    poses, seen = np.empty((size, 3)), {(np.int64(0), np.int64(0), np.int64(-1), np.int64(0))}
    poses[0, 0], poses[0, 1], poses[0, 2] = a[0], a[1], a[2]
    count, at, step = 1, 0, np.empty((1, 3))
    while at < count and count <= most:
        for gear in gears:
            for side in range(-1, 2):
                step[0, 0], step[0, 1], step[0, 2] = step_m, side / radius, gear
                if not has_room_on_path(poses[at], step, guide, points, reach, grid, frame, margin):
                    continue
                u, v, after = advance_pose(poses[at, 0], poses[at, 1], poses[at, 2], step_m, side / radius, gear)
                key = _find_cell(u, v, after, 0, step_m)
                if key not in seen:
                    seen.add(key)
                    poses[count, 0], poses[count, 1], poses[count, 2] = u, v, after
                    count += 1
        at += 1
    return count > most


@compile_function
def _trace_rows(node, came, bends, ways, link, step):  # type: ignore[no-untyped-def]
    """The steps that led to a node, and the closed form from there."""
    steps, at = 0, node
    while came[at] >= 0:
        steps += 1
        at = came[at]
    rows, at = np.empty((steps + len(link), 3)), node
    for k in range(steps - 1, -1, -1):
        rows[k, 0], rows[k, 1], rows[k, 2] = step, bends[at], ways[at]
        at = came[at]
    copy_table(link, rows[steps:])
    return rows


@compile_function
def _merge_rows(rows):  # type: ignore[no-untyped-def]
    """The rows (k, 3) of a path with those united that continue one another at one curvature in one gear."""
    merged, count = np.empty((len(rows), 3)), 0
    for k in range(len(rows)):
        if rows[k, 0] == 0.0:
            continue
        if count and merged[count - 1, 1] == rows[k, 1] and merged[count - 1, 2] == rows[k, 2]:
            merged[count - 1, 0] += rows[k, 0]
            continue
        merged[count, 0], merged[count, 1], merged[count, 2] = rows[k, 0], rows[k, 1], rows[k, 2]
        count += 1
    return merged[:count].copy()


@compile_function
def shorten_rows(a, rows, radii, costs, settling, kinds, max_reverse, kept, body):  # type: ignore[no-untyped-def]
    """The rows (k, 3) of a path from pose a with stretches replaced by closed forms that are no dearer, from the end.

    From every eighth of the path on, a closed form to its end is tried, the earliest first; what is before it is
    shortened the same way. Steps that continue one another count as one. What replaces a stretch has more room than
    the margin asks for, and with it the path backs up no farther than `max_reverse` metres, or than it did. `body` is
    as of search_move.
    """
    rows = _merge_rows(rows)
    how = radii, costs, settling, kinds
    max_reverse = max(max_reverse, measure_backing_up(rows, 0.0))
    guide, points, reach, grid, frame, margin = body
    ample = guide, points, reach, grid, frame, margin + AMPLE_M
    ends = np.empty((len(rows) + 1, 3))
    ends[0, 0], ends[0, 1], ends[0, 2] = a[0], a[1], a[2]
    for k in range(len(rows)):
        u, v, after = advance_pose(ends[k, 0], ends[k, 1], ends[k, 2], rows[k, 0], rows[k, 1], rows[k, 2])
        ends[k + 1, 0], ends[k + 1, 1], ends[k + 1, 2] = u, v, after
    out, last = np.empty((0, 3)), len(rows)
    while last > 0:
        taken = last - 1
        for eighth in range(8):
            first = eighth * last // 8
            if first >= last - 1:
                break
            link, link_s, _ = _find_end(ends[first], ends[last], *how, 0.0, max_reverse, np.inf, kept, *ample)
            replaced = rows[first:last]
            most_s = _measure_seconds(replaced, costs) + _charge_wheels(ends[first], replaced, kept)
            if link_s <= most_s:
                whole = np.concatenate((rows[:first], link, out))
                if measure_backing_up(whole, 0.0) <= max_reverse:
                    out, taken = whole[first:], first
                    break
        if taken == last - 1:
            out = np.concatenate((rows[last - 1 : last], out))
        last = taken
    return out


@compile_function
def _measure_seconds(rows, costs) -> float:  # type: ignore[no-untyped-def]
    """Seconds of steps at their speeds, with what bends and changes of direction cost in the search."""
    seconds, bend, gear = 0.0, rows[0, 1], rows[0, 2]
    for k in range(len(rows)):
        speed = costs[1] if rows[k, 2] < 0.0 else costs[0]
        seconds += rows[k, 0] / speed
        if rows[k, 2] != gear:
            seconds += costs[2]
        elif rows[k, 1] != bend:
            seconds += BEND_S
        bend, gear = rows[k, 1], rows[k, 2]
    return seconds
