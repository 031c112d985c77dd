"""Work lines of a field that is worked in part: what is done leaves, and what is half done is cut where work ended.

Lines keep their places, so that what follows joins what was done before.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from operator import itemgetter

import numpy as np
import shapely

from fields.arrays import Floats, cut_line, find_true_spans, locate_at, measure_along
from fields.layout.headland_passes import MIN_OPEN_AREA
from strategies.lines.lay_lines import MIN_OWN_SHARE, MIN_PIECE_M, Span, keep_uncovered, measure_bar_shares
from strategies.lines.work_line import (
    MOST_OFF_SHARE,
    SHARPEST_RAD,
    STRAIGHT_RAD,
    WorkLine,
    extend_line,
)
from strategies.path_planning.paths import Pose
from strategies.rules.legs import PATH_STEP_M
from strategies.site.site import Site
from vehicle.missions.plan import ENTER, MAX_JOINT_GAP_M, Leg, LegTask

START_OVERLAP_M = 1.0  # of work that a start joins: an implement takes about a metre to work as deep as it should
BAR_POINTS = 17  # places on the bar where it is asked what is done: one is less of it than a line is worth driving for
LOOSE_BEND = 2.0  # turning radii: what bends less sharply is a bent line and no corner
PLACE_M = 0.02  # length of the line that stands for a place


def leave_done_lines(site: Site, lines: Sequence[WorkLine], error_m: float) -> list[WorkLine]:
    """The lines, or their parts, that are not done, each with the ground that it alone covers of what is due.

    Where work was done is known to `error_m`: ground that near to it is no reason to drive, and is worked again where a
    line joins it. Nor is a part that is no more than a corner which those before went round. The first part of a line
    that is left has its name.
    """
    done = site.layout.field.done
    if done is None:
        return list(lines)
    known = done.buffer(error_m)
    shapely.prepare(known)
    parts, is_whole, origins = list[WorkLine](), dict[LegTask, bool](), dict[LegTask, LegTask]()
    counts = Counter(line.task.whole for line in lines)
    for line in lines:
        task = line.task
        for part in _cut_done_line(site, line, known, START_OVERLAP_M + error_m):
            parts.append(replace(part, task=task))
            is_whole[task], origins[task] = part is line, line.task
            task = replace(task, piece=counts[task.whole])
            counts[task.whole] += 1
    least_m2 = MIN_OPEN_AREA * site.width_m**2
    kept = [part for part in keep_uncovered(site, parts) if is_whole[part.task] or part.own_m2 >= least_m2]
    names = {task: origin for origin, task in {origins[part.task]: part.task for part in reversed(kept)}.items()}
    left = Counter(part.task.whole for part in kept)
    tasks = [names.get(part.task, part.task) for part in kept]
    return [
        replace(part, task=replace(task, is_piece=task.is_piece or left[task.whole] > 1))
        for part, task in zip(kept, tasks, strict=True)
    ]


def _cut_done_line(site: Site, line: WorkLine, done: shapely.Geometry, join_m: float) -> Iterator[WorkLine]:
    """The parts of a line that are not done, longer by `join_m` where they join what is."""
    length_m = line.measure_path_m(0)
    spans = _find_due_spans(site, line, done, join_m)
    if spans == [(0.0, length_m)]:
        yield line
        return
    bars = [shapely.LineString(extend_line(path, line.tool_m, 0.0)) for path in line.paths]
    for first_m, last_m in spans:
        ahead = cut_line(line.paths[0], first_m, last_m)
        if not line.both_ways:
            yield replace(line, paths=(ahead, ahead))
            continue
        ends = [shapely.line_interpolate_point(bars[0], distance_m) for distance_m in (last_m, first_m)]
        begin_m, end_m = (float(shapely.line_locate_point(bars[1], end)) for end in ends)
        end_m = min(end_m, line.measure_path_m(1))
        if end_m - begin_m >= MIN_PIECE_M:
            yield replace(line, paths=(ahead, cut_line(line.paths[1], begin_m, end_m)))
        else:
            yield replace(line, paths=(ahead, ahead), both_ways=False)


def _find_due_spans(site: Site, line: WorkLine, done: shapely.Geometry, join_m: float) -> list[Span]:
    """From where to where along the first path of a line (m) enough of the bar is over ground that is not done."""
    length_m = line.measure_path_m(0)
    bar = extend_line(line.paths[0], line.tool_m, 0.0)
    stations = np.linspace(0.0, length_m, max(2, math.ceil(length_m / PATH_STEP_M) + 1))
    is_due = _measure_due_shares(bar, stations, site.width_m, done) >= MIN_OWN_SHARE
    merged = list[Span]()
    for first, end in find_true_spans(is_due):
        first_m, last_m = max(0.0, stations[first] - join_m), min(length_m, stations[end - 1] + join_m)
        if last_m - first_m < MIN_PIECE_M:
            first_m = max(0.0, min(0.5 * (first_m + last_m - MIN_PIECE_M), length_m - MIN_PIECE_M))
            last_m = min(length_m, first_m + MIN_PIECE_M)
        if merged and first_m <= merged[-1][1]:
            merged[-1] = (merged[-1][0], max(merged[-1][1], float(last_m)))
        else:
            merged.append((float(first_m), float(last_m)))
    return merged


def _measure_due_shares(bar: Floats, stations: Floats, width_m: float, done: shapely.Geometry) -> Floats:
    """The share (n,) of the bar at stations along its path that is over ground not done."""
    along = measure_along(bar)
    middle = locate_at(bar, along, stations)
    ahead = locate_at(bar, along, np.minimum(stations + PATH_STEP_M, along[-1])) - locate_at(
        bar, along, np.maximum(stations - PATH_STEP_M, 0.0)
    )
    return 1.0 - measure_bar_shares(middle, ahead / np.hypot(*ahead.T)[:, None], width_m, done, BAR_POINTS)


def build_round_corners(legs: Iterable[Leg], radius_m: float, width_m: float) -> list[shapely.Geometry]:
    """The corners that legs go round with the implement down, whole: what a plan left there is not gone back for."""
    corners = list[shapely.Geometry]()
    for points in (leg.points for leg in legs if leg.implement):
        steps = np.diff(points, axis=0)
        first, last = steps[0] / np.hypot(*steps[0]), steps[-1] / np.hypot(*steps[-1])
        sine, cosine = float(first[0] * last[1] - first[1] * last[0]), float(first[0] * last[0] + first[1] * last[1])
        turn = abs(math.atan2(sine, cosine))
        if STRAIGHT_RAD < turn < SHARPEST_RAD and measure_along(points)[-1] <= LOOSE_BEND * radius_m * turn:
            gap = points[-1] - points[0]
            tip = points[0] + (gap[0] * last[1] - gap[1] * last[0]) / sine * first
            line = shapely.LineString([points[0], tip, points[-1]])
            corners.append(line.buffer(0.5 * width_m, cap_style="flat", join_style="mitre"))
    return corners


def begin_where_tractors_stand(
    site: Site, lines: Sequence[WorkLine], stands: Sequence[tuple[Pose, bool]], error_m: float
) -> tuple[list[WorkLine], tuple[int, ...]]:
    """The lines with those that tractors begin with, which stand at poses of the guided point, folded or not, and the
    nodes of these.

    A tractor that stands on a line where it joins what is done goes on along the nearest; any other begins at its
    place, as one does that is folded.
    """
    lines, starts = list(lines), list[int]()
    for pose, is_folded in stands:
        rests = [] if is_folded else list(_iter_rests(site, lines, pose, START_OVERLAP_M + error_m, starts))
        if rests:
            _, number, rest = min(rests, key=itemgetter(0))
            lines[number] = rest
        else:
            number = len(lines)
            lines.append(_stand_at(pose, site.rules.tool_m))
        starts.append(2 * number)
    return lines, tuple(starts)


def list_places_ahead(legs: Iterable[Leg]) -> tuple[Pose, ...]:
    """Poses in the middle of the legs that work lines, in order."""
    places = list[Pose]()
    for leg in legs:
        if leg.implement and leg.task.is_work:
            along = measure_along(leg.points)
            (x, y), (x1, y1) = locate_at(leg.points, along, 0.5 * along[-1] + np.array([0.0, PLACE_M])).tolist()
            places.append((x, y, math.atan2(y1 - y, x1 - x)))
    return tuple(places)


def find_orders(
    site: Site, lines: Sequence[WorkLine], starts: Sequence[int], places: Sequence[Sequence[Pose]]
) -> tuple[tuple[int, ...], ...]:
    """For every tractor that stands on the field its start and the nodes at places ahead of it; each line once."""
    taken, orders = {start // 2 for start in starts}, list[tuple[int, ...]]()
    curves = [[shapely.LineString(path) for path in line.paths] for line in lines]
    for start, ahead in zip(starts, places, strict=True):
        order = [start]
        for pose in ahead:
            for number, line in enumerate(lines):
                for way in () if number in taken else (0, 1) if line.both_ways else (0,):
                    if _is_on_line(site, line, curves[number][way], way, pose):
                        order.append(2 * number + way)
                        taken.add(number)
        orders.append(tuple(order))
    return tuple(orders)


def _is_on_line(site: Site, line: WorkLine, curve: shapely.LineString, way: int, pose: Pose) -> bool:
    place = shapely.Point(pose[:2])
    turn = math.remainder(line.get_pose(way, float(curve.project(place)))[2] - pose[2], 2.0 * math.pi)
    return float(curve.distance(place)) <= MOST_OFF_SHARE * site.width_m and abs(turn) <= STRAIGHT_RAD


def _iter_rests(
    site: Site, lines: Sequence[WorkLine], pose: Pose, join_m: float, taken: Sequence[int]
) -> Iterator[tuple[float, int, WorkLine]]:
    """What remains, from a pose on, of lines that a tractor standing there may work: how far it stands beside (m), its
    number, and the rest of it, which begins where the tractor stands."""
    place = shapely.Point(pose[:2])
    for number, line in enumerate(lines):
        for way in (0, 1) if line.both_ways else (0,):
            path, whole_m = line.paths[way], line.measure_path_m(way)
            curve = shapely.LineString(path)
            begun_m, beside_m = float(curve.project(place)), float(curve.distance(place))
            x, y, heading = line.get_pose(way, begun_m)
            ahead_m = (x - pose[0]) * math.cos(heading) + (y - pose[1]) * math.sin(heading)
            is_on_line = _is_on_line(site, line, curve, way, pose)
            is_joined = ahead_m <= join_m and begun_m <= 2.0 * join_m
            joins_m = begun_m if beside_m <= MAX_JOINT_GAP_M else begun_m + beside_m / STRAIGHT_RAD
            if 2 * number in taken or not (is_on_line and is_joined) or whole_m - joins_m < MIN_PIECE_M:
                continue
            rest = cut_line(path, joins_m, whole_m)
            rest = rest if joins_m == begun_m else np.vstack([pose[:2], rest])
            yield beside_m, number, replace(line, paths=(rest, rest), both_ways=False)


def _stand_at(pose: Pose, tool_m: float) -> WorkLine:
    """A line that is no work, from which a tractor standing at a pose sets out."""
    x, y, heading = pose
    back = PLACE_M * np.array([math.cos(heading), math.sin(heading)])
    path = np.array([(x, y) - back, (x, y)])
    return WorkLine(LegTask(ENTER), (ENTER, 0), (path, path), tool_m, both_ways=False)
