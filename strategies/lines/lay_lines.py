"""The work lines of a site: swaths and headland sides, cut to where the body has room, without those that others cover.

A line is pulled back from an edge or an obstacle as far as the body needs, first by stations on its path, then by a
drive where a tractor may not keep to it: no move can repair a line that leaves the ground itself.
"""

from __future__ import annotations

import itertools
import math
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely

from fields.arrays import Flags, Floats, compute_angles, cut_line, find_true_spans, locate_at, measure_along
from fields.geometry.arithmetic import CURVE_M, SLIVER_M2
from fields.geometry.overlays import Areas, clip_all_areas, intersect, subtract_area, unite_areas
from fields.layout.headland_passes import MIN_OPEN_AREA, HeadlandPass, HeadlandPassSide
from strategies.lines.work_line import HOLE_PASS, WorkLine, extend_line
from strategies.rules.legs import PATH_STEP_M
from strategies.site.ground import CELL_M, measure_rooms
from strategies.site.site import MISSED_FACTOR, STRAIGHT_M, Site
from vehicle.missions.plan import HEADLAND_PASS, SWATH, Leg, LegTask, Mission, Plan
from vehicle.missions.run import DONE

LINE_MARGIN_M = 0.12  # room kept on lines: a little more than on moves, which begin and end on them
SCARCE_M = 0.6  # a line with less room is driven on its own, unless tractors keep to such lines
PROOF_ROOM_M = 0.02
PULL_BACK_M = 0.3  # beyond the place where a drive touches
MIN_PIECE_M = 3.0
MOST_MITRE = 1.5  # half widths by which a side is drawn out into a corner
BAR_POINTS = 9  # places on the bar where it is asked what is covered
MOST_EXTENSION_WIDTHS = 6.0  # beyond the end of a swath
WORTH_SHARE = 0.3  # of the bar over uncovered ground: there a swath goes on
RING = "ring"  # group of lines round obstacles
LEFTOVER = "left"  # group of lines on ground that sides and swaths leave
MIN_LEFT_HALF_M = 0.5  # half of the least width of such ground
LAST_WIDTH_SHARE = 0.25  # a piece this much wider than its lines gets no further one
MIN_OWN_SHARE = 1.0 / MISSED_FACTOR  # of its strip: driving a line that alone covers less costs more than it is worth
Span = tuple[float, float]


@dataclass(frozen=True, eq=False)
class LineDraft:
    """A line before the body is asked: where the implement's middle is to go (n, 2), and what it belongs to."""

    kind: str
    number: int
    group: tuple[str, int]
    points: Floats


def lay_headland_lines(site: Site) -> list[WorkLine]:
    """The lines of the headland sides: the same for all layouts inside the same headland passes."""
    return _settle_all(site, _list_headland_sides(site))


def lay_lines(site: Site, headland_lines: Sequence[WorkLine] | None = None) -> list[WorkLine]:
    """The lines worth driving, each with the ground that it alone covers.

    Headland sides come first, as they were laid if they are given; swaths go on beyond their ends as long as they cover
    what neither sides nor other swaths do, obstacles that they are driven round have a ring, and lines of their own
    follow the ground that is still left. A headland that is only room for turning counts as covered.
    """
    lines = lay_headland_lines(site) if headland_lines is None else list(headland_lines)
    due = site.work_ground if site.headland_passes else shapely.Polygon()
    swaths = _settle_all(site, _list_swaths(site, subtract_area(due, unite_strips(site, lines))))
    lines += swaths
    left = subtract_area(due, unite_strips(site, lines))
    rings = _settle_all(site, _list_obstacle_rings(site, left))
    strips = clip_all_areas(_build_strips(site, rings), left)
    rings = [replace(ring, own_m2=float(strip.area)) for ring, strip in zip(rings, strips, strict=True)]
    lines += _settle_all(site, _list_leftover(site, subtract_area(left, unite_areas(strips)), lines))
    return _number_pieces(keep_uncovered(site, lines) + rings)


def _number_pieces(lines: Sequence[WorkLine]) -> list[WorkLine]:
    """The lines with the pieces of each swath, and the sides of each headland pass, numbered from 0."""
    counts = Counter(line.task.whole for line in lines)
    numbers = defaultdict[LegTask, Iterator[int]](itertools.count)
    return [
        replace(
            line, task=replace(line.task, piece=next(numbers[line.task.whole]), is_piece=counts[line.task.whole] > 1)
        )
        for line in lines
    ]


def _settle_all(site: Site, drafts: Iterable[LineDraft]) -> list[WorkLine]:
    """The pieces of lines on which the body has room, settled by a drive where a tractor may not keep to them."""
    keeps_to_lines = _keeps_to_lines(site)
    settled = (_settle(site, piece, keeps_to_lines) for draft in drafts for piece in _cut_to_room(site, draft))
    return [line for line in settled if line is not None]


def unite_strips(site: Site, lines: Sequence[WorkLine]) -> shapely.Geometry:
    """The ground that the implement passes over on lines."""
    return unite_areas(_build_strips(site, lines))


def _build_strips(site: Site, lines: Sequence[WorkLine]) -> Areas:
    return np.array([line.build_strip(site.width_m) for line in lines], dtype=np.object_)


def _list_headland_sides(site: Site) -> Iterator[LineDraft]:
    for ring, headland_pass in enumerate(site.headland_passes):
        group = (HOLE_PASS if headland_pass.is_round_hole else HEADLAND_PASS, ring)
        for side in headland_pass.sides:
            yield LineDraft(HEADLAND_PASS, headland_pass.number, group, _draw_into_corners(site, headland_pass, side))


def _list_swaths(site: Site, uncovered: shapely.Geometry) -> Iterator[LineDraft]:
    """The swaths, drawn out beyond their ends as long as they cover ground that no headland side or swath does."""
    swaths = [shapely.LineString(swath.points_m) for swath in site.layout.swaths]
    strips = shapely.buffer(swaths, 0.5 * site.width_m, cap_style="flat", join_style="mitre")
    uncovered = subtract_area(uncovered, unite_areas(strips))
    shapely.prepare(uncovered)
    for swath in site.layout.swaths:
        points = swath.points_m
        more = [_measure_extension_m(site, points[::-1], uncovered), _measure_extension_m(site, points, uncovered)]
        yield LineDraft(SWATH, swath.line, (SWATH, swath.line), extend_line(points, *more))


def _list_obstacle_rings(site: Site, left: shapely.Geometry) -> Iterator[LineDraft]:
    """A ring, as round as tractors turn, round every obstacle that swaths are driven round where enough of the ground
    that these leave is its own; it is a piece of the nearest swath."""
    swaths = site.layout.swaths
    lines = [shapely.LineString(swath.points_m) for swath in swaths]
    away_m = max(0.5 * site.width_m + PULL_BACK_M, site.rules.radius_m)
    for count, obstacle in enumerate(site.layout.field.small_obstacles if swaths else ()):
        ring = obstacle.convex_hull.buffer(away_m).exterior.simplify(CURVE_M)
        strip = ring.buffer(0.5 * site.width_m)
        if intersect(strip, left).area > MIN_OWN_SHARE * strip.area:
            left = subtract_area(left, strip)
            number = swaths[int(np.argmin(shapely.distance(lines, obstacle.centroid)))].line
            yield LineDraft(SWATH, number, (RING, count), np.asarray(ring.coords)[:, :2])


def _measure_extension_m(site: Site, points: Floats, uncovered: shapely.Geometry) -> float:
    """How far a line is drawn out beyond its last point: to the last place where it covers enough that is uncovered."""
    ahead = (points[-1] - points[-2]) / math.dist(points[-1], points[-2])
    steps_m = np.arange(0.5 * CELL_M, MOST_EXTENSION_WIDTHS * site.width_m, CELL_M)
    shares = measure_bar_shares(points[-1] + steps_m[:, None] * ahead, ahead[None], site.width_m, uncovered, BAR_POINTS)
    worth = np.flatnonzero(shares >= WORTH_SHARE)
    ends = worth[(np.cumsum(shares)[worth] / (worth + 1.0)) >= WORTH_SHARE]
    return float(CELL_M * (ends[-1] + 1)) if len(ends) else 0.0


def measure_bar_shares(middles: Floats, ahead: Floats, width_m: float, ground: shapely.Geometry, points: int) -> Floats:
    """The share (n,) of an implement's bar over a ground, by so many points of the bar.

    `middles` are those of the bar (n, 2), `ahead` unit vectors (n, 2) or (1, 2) along its path.
    """
    aside = np.column_stack([-ahead[:, 1], ahead[:, 0]])
    across_m = width_m * ((np.arange(points) + 0.5) / points - 0.5)
    places = (middles[:, None, :] + across_m[None, :, None] * aside[:, None, :]).reshape(-1, 2)
    shares: Floats = shapely.contains_xy(ground, places).reshape(len(middles), points).mean(axis=1)
    return shares


def _list_leftover(site: Site, left: shapely.Geometry, lines: Sequence[WorkLine]) -> Iterator[LineDraft]:
    """A line along the middle of every piece of ground that no line covers and that is worth one: one more round."""
    opened = left.buffer(-MIN_LEFT_HALF_M).buffer(MIN_LEFT_HALF_M)
    number = 1 + max((line.task.number or 0 for line in lines if line.task.kind == HEADLAND_PASS), default=0)
    count = 0
    for piece in shapely.get_parts(opened).tolist():
        if piece.geom_type == "Polygon" and piece.area >= MIN_OPEN_AREA * site.width_m**2:
            for line in _draw_middles(site, piece):
                yield LineDraft(HEADLAND_PASS, number, (LEFTOVER, count), line)
                count += 1


def _draw_middles(site: Site, piece: shapely.Polygon) -> Iterator[Floats]:
    """Parallel lines a width apart along the longer side of the smallest rectangle round a piece."""
    corners = np.asarray(shapely.minimum_rotated_rectangle(piece).exterior.coords)[:4]
    if math.dist(corners[0], corners[1]) < math.dist(corners[1], corners[2]):
        corners = np.roll(corners, -1, axis=0)
    across = corners[3] - corners[0]
    count = max(1, math.ceil(float(np.hypot(*across)) / site.width_m - LAST_WIDTH_SHARE))
    for number in range(count):
        middle = across * (number + 0.5) / count
        if math.dist(corners[0], corners[1]) > MIN_PIECE_M:
            yield np.array([corners[0] + middle, corners[1] + middle])


def _draw_into_corners(site: Site, headland_pass: HeadlandPass, side: HeadlandPassSide) -> Floats:
    """A side drawn out so that its strip and that of the next cover their corner; an open one up to the edge."""
    half_m = 0.5 * site.width_m
    turns = (side.start_turn_rad, side.end_turn_rad)
    if not headland_pass.is_closed:
        return extend_line(side.points, half_m, half_m)
    return extend_line(side.points, *(half_m * min(MOST_MITRE, math.tan(0.5 * abs(t))) for t in turns))


def _cut_to_room(site: Site, draft: LineDraft) -> Iterator[WorkLine]:
    """The pieces of a line on which the body has room, in either direction."""
    tool_m = site.rules.tool_m
    length_m = float(measure_along(draft.points)[-1])
    drawn = [extend_line(points, 0.0, tool_m + 1.0) for points in (draft.points, draft.points[::-1])]
    spans = [_find_spans(site, path, length_m) for path in drawn]
    pieces: list[tuple[Span | None, Span | None]]
    pieces = [(ahead, _pick_opposite(ahead, spans[1], length_m)) for ahead in spans[0]]
    taken = {back for _, back in pieces if back is not None}
    pieces += [(None, back) for back in spans[1] if back not in taken]
    for ahead, back in pieces:
        paths = [
            None if span is None else cut_line(path, span[0] + tool_m, span[1] + tool_m)
            for path, span in zip(drawn, (ahead, back), strict=True)
        ]
        known = [path for path in paths if path is not None]
        yield WorkLine(
            LegTask(draft.kind, draft.number),
            draft.group,
            (known[0], known[-1]),
            tool_m,
            both_ways=len(known) == 2,
        )


def _find_spans(site: Site, path: Floats, length_m: float) -> list[Span]:
    """From where to where on a path of the bar the body has room (m), in its direction."""
    along = measure_along(path)
    stations = np.linspace(0.0, length_m, max(2, math.ceil(length_m / PATH_STEP_M) + 1))
    places = (locate_at(path, along, stations), locate_at(path, along, stations + site.rules.tool_m))
    rooms = _measure_rooms_at(site, *places)
    roomy = find_true_spans(rooms >= LINE_MARGIN_M)
    spans = [(float(stations[first]), float(stations[end - 1])) for first, end in roomy]
    return [span for span in spans if span[1] - span[0] >= MIN_PIECE_M]


def _measure_rooms_at(site: Site, bars: Floats, guided: Floats) -> Floats:
    """Room (n,) where the implement and the guided point are at places (n, 2), exact below SCARCE_M (m)."""
    body, ground, ahead = site.body, site.ground, guided - bars
    poses = np.column_stack([guided, compute_angles(ahead)])
    return measure_rooms(poses, body.guide_m, body.points, body.reach_m, ground.grid, ground.frame, SCARCE_M)  # type: ignore[no-any-return]


def _pick_opposite(span: Span, others: Sequence[Span], length_m: float) -> Span | None:
    """The span of the opposite direction that shares most ground with one; None if they share too little."""

    def measure_shared_m(other: Span) -> float:
        return min(span[1], length_m - other[0]) - max(span[0], length_m - other[1])

    best = max(others, key=measure_shared_m, default=None)
    return best if best is not None and measure_shared_m(best) >= MIN_PIECE_M else None


def _settle(site: Site, line: WorkLine, keeps_to_lines: bool) -> WorkLine | None:
    """The line pulled back from where a drive of it alone leaves the ground; None if little is left."""
    for direction in (0, 1) if line.both_ways else (0,):
        path = line.paths[direction]
        if len(path) == 2 and (keeps_to_lines or _has_ample_room(site, path)):
            continue
        kept = _find_driven_span(site, path, line.task)
        if kept is None:
            return None
        path = cut_line(path, *kept)
        other = line.paths[1 - direction] if line.both_ways else path
        line = replace(line, paths=(other, path) if direction else (path, other))
    return line


def _has_ample_room(site: Site, path: Floats) -> bool:
    along = measure_along(path)
    stations = np.arange(0.0, along[-1], 4.0 * PATH_STEP_M)
    ahead = locate_at(path, along, np.minimum(stations + 0.5, along[-1]))
    behind = locate_at(path, along, np.maximum(np.minimum(stations, along[-1] - 0.5), 0.0))
    return bool((_measure_rooms_at(site, behind, ahead) >= SCARCE_M).all())


def _keeps_to_lines(site: Site) -> bool:
    """Whether a tractor keeps to straight lines and stops at their ends so well that those which have room at their
    stations need no drive."""
    if not site.is_alike:
        return False
    run = site.straight_run
    east_m, north_m, heading = run.get_poses(0).T
    off_m, beyond_m = np.abs(north_m) + site.body.reach_m * np.abs(heading), np.ptp(east_m) - STRAIGHT_M
    return run.outcome == DONE and bool(max(off_m.max(), beyond_m) < LINE_MARGIN_M - PROOF_ROOM_M)


def _find_driven_span(site: Site, path: Floats, task: LegTask) -> Span | None:
    """The longest stretch of a path on which a drive of it alone has room."""
    leg = Leg(path, site.rules.work_speed_mps, 1, True, task=task)
    poses = site.drive(Plan((Mission((leg,)),))).get_poses(0)
    rooms = measure_proof_rooms(site, poses)
    driven = measure_along(poses[:, :2])
    length_m = float(measure_along(path)[-1])
    touches = np.minimum(driven[rooms < PROOF_ROOM_M], length_m)
    borders = np.concatenate([[-PULL_BACK_M], touches, [length_m + PULL_BACK_M]])
    longest = int(np.argmax(np.diff(borders)))
    first, last = borders[longest] + PULL_BACK_M, borders[longest + 1] - PULL_BACK_M
    return (float(first), float(last)) if last - first >= MIN_PIECE_M else None


def measure_proof_rooms(site: Site, poses: Floats, is_folded: Flags | None = None) -> Floats:
    """Room (t,) of the body on the proof ground at poses (t, 3) of the centre of mass (m), folded where `is_folded`."""
    ground, places, rooms = site.proof_ground, np.ascontiguousarray(poses), np.empty(len(poses))
    for folded, rows in ((False, slice(None)), (True, is_folded)):
        if rows is not None:
            body = site.get_body(folded)
            rooms[rows] = measure_rooms(
                places[rows], site.axle_m, body.points, body.reach_m, ground.grid, ground.frame, SCARCE_M
            )
    return rooms


def keep_uncovered(site: Site, lines: Sequence[WorkLine]) -> list[WorkLine]:
    """The lines without those whose strip others cover nearly all of; the least needed goes first."""
    if not lines:
        return []
    strips = clip_all_areas(_build_strips(site, lines), site.work_ground)
    areas_m2, overlaps, is_kept = shapely.area(strips), _list_overlaps(strips), np.ones(len(lines), bool)
    full_m2 = np.array([site.width_m * line.length_m for line in lines])

    def measure_own_m2(number: int) -> float:
        shared = [overlap for k, overlap in overlaps[number].items() if is_kept[k]]
        return float(areas_m2[number] - unite_areas(np.array(shared, dtype=np.object_)).area)

    own_m2 = np.array([measure_own_m2(number) for number in range(len(lines))])
    while True:
        shares = np.where(is_kept, own_m2 / full_m2, np.inf)
        least = int(np.argmin(np.round(shares, 9)))
        if shares[least] > MIN_OWN_SHARE:
            break
        is_kept[least] = False
        for k in overlaps[least]:
            own_m2[k] = measure_own_m2(k)
    return [replace(line, own_m2=float(own_m2[k])) for k, line in enumerate(lines) if is_kept[k]]


def _list_overlaps(strips: Areas) -> list[dict[int, shapely.Geometry]]:
    """For every strip the ground that it shares with each of the others, where that is more than a sliver."""
    first, second = shapely.STRtree(strips).query(strips, predicate="intersects")
    first, second = first[first < second], second[first < second]
    shared = clip_all_areas(strips[first], strips[second])
    overlaps: list[dict[int, shapely.Geometry]] = [{} for _ in strips]
    for a, b, ground in zip(first.tolist(), second.tolist(), shared.tolist(), strict=True):
        if ground.area > SLIVER_M2:
            overlaps[a][b] = overlaps[b][a] = ground
    return overlaps
