"""Ground swept by the implements of a run, as polygons with the rows of the record in which they were swept.

A bar sweeps whole, or by sections that switch themselves off over worked ground and outside the field.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import groupby, pairwise
from operator import itemgetter

import numpy as np
import numpy.typing as npt
import shapely

from fields.arrays import Flags, Floats, Integers, build_directions
from fields.geometry.overlays import (
    ROUNDING_SHARE,
    Areas,
    clip_all_areas,
    clip_area,
    drop_slivers,
    extract_polygons,
    measure_widths_m,
    subtract_area,
    unite_areas,
)
from planner.evaluation.context import PlanningContext
from vehicle.missions.plan import HEADLAND_PASS
from vehicle.missions.run import SimulationRun

SIMPLIFY_M = 0.003  # tolerance of the sides: a bend loses two thirds of it at its outer end
STILL_M = 1e-9
# Narrower unworked ground switches no section on: no track is followed more closely, so there is some along every one.
MIN_UNWORKED_M = 0.05
LEAST_SHARE = 0.1  # of a section: nor does less of it than this
PLACE_DECIMALS = 6  # of a row: fewer than a millimetre, so that neighbours that switch together are seen to
Spans = tuple[tuple[float, float], ...]
SWATH_ROW_STEP = 3  # rows of the 10 Hz record between corners of a polygon: under half a metre of driving
BEND_RAD = math.radians(20.0)  # a polygon ends where the bar has turned this far, so that neither side crosses itself
MIN_SWEPT_M = 0.1


@dataclass(frozen=True, eq=False)
class SweptPart:
    """What neighbouring sections sweep without a break.

    It belongs to the piece of that number, begins and ends at these places of its rows (0 the first, fractions are
    between rows), and is swept by the share of the bar between two places, 0 at its left end and 1 at its right one.
    """

    piece: int
    begin: float
    end: float
    share: tuple[float, float]
    ground: shapely.Geometry


def switch_sections(ends: list[Floats], ground: Areas, region: shapely.Geometry, sections: int) -> Iterator[SweptPart]:
    """What sections of equal width sweep where each works as long as it has unworked ground of the region under it.

    `ends` are of pieces (2, t, 2) in the order in which they are swept, and `ground` is what the whole bar sweeps.
    """
    earlier: list[list[int]] = [[] for _ in ends]
    for piece, other in sorted(shapely.STRtree(ground).query(ground, predicate="intersects").T.tolist()):
        if other < piece:
            earlier[piece].append(other)
    worked: list[list[shapely.Geometry]] = []
    for piece, bar in enumerate(ends):
        near = [one for other in earlier[piece] for one in worked[other]]
        unworked = clip_area(ground[piece], region)
        unworked = subtract_area(unworked, unite_areas(np.array(near, dtype=np.object_))) if near else unworked
        parts = list(_switch_on_piece(piece, bar, ground[piece], unworked, sections))
        worked.append([part.ground for part in parts])
        yield from parts


def _switch_on_piece(
    piece: int, bar: Floats, ground: shapely.Geometry, unworked: shapely.Geometry, sections: int
) -> Iterator[SweptPart]:
    """What sections sweep of a piece, of which some ground is unworked; neighbours that switch alike are one part."""
    whole = float(bar.shape[1] - 1)
    parts = drop_slivers(shapely.get_parts(unworked), MIN_UNWORKED_M)
    if not len(parts):
        return
    if shapely.area(parts).sum() >= (1.0 - ROUNDING_SHARE) * ground.area:
        yield SweptPart(piece, 0.0, whole, (0.0, 1.0), ground)
        return
    shares = list(pairwise((np.arange(sections + 1) / sections).tolist()))
    strips = build_swept_polygons([take_share(bar, *share) for share in shares])
    section_m = float(np.hypot(*(bar[0, 0] - bar[1, 0]))) / sections
    unworked_strips = clip_all_areas(strips, shapely.multipolygons(parts))
    times = _find_times_on(bar, unworked_strips, min(MIN_UNWORKED_M, LEAST_SHARE * section_m))
    for spans, group in groupby(zip(times, shares, strict=True), key=itemgetter(0)):
        alike = [share for _, share in group]
        share = alike[0][0], alike[-1][1]
        swept = build_swept_polygons([take_share(_cut_bar(bar, *span), *share) for span in spans])
        for (begin, end), area in zip(spans, swept, strict=True):
            yield SweptPart(piece, begin, end, share, area)


def _find_times_on(bar: Floats, unworked: Areas, least_m: float) -> list[Spans]:
    """For every section when its unworked ground, where that is so wide, is under the bar (2, t, 2).

    Spans are by places of the rows of the bar.
    """
    parts, section = shapely.get_parts(unworked, return_index=True)
    section, parts = section[shapely.area(parts) > 0.0], parts[shapely.area(parts) > 0.0]
    is_wide = measure_widths_m(parts) >= least_m
    section, parts = section[is_wide], parts[is_wide]
    corners, owner = shapely.get_coordinates(shapely.get_exterior_ring(parts), return_index=True)
    first = np.searchsorted(owner, np.arange(len(parts)))
    ahead, pivots = _find_course(bar)
    places = _find_places(bar, ahead, corners)
    begins, ends = (one.reduceat(places, first).round(PLACE_DECIMALS) for one in (np.minimum, np.maximum))
    if pivots:
        begins, ends = np.zeros(len(parts)), np.full(len(parts), float(bar.shape[1] - 1))
    times: list[list[tuple[float, float]]] = [[] for _ in unworked]
    order = np.lexsort((ends, begins))
    for number, begin, end in zip(section[order].tolist(), begins[order].tolist(), ends[order].tolist(), strict=True):
        spans = times[number]
        if spans and begin <= spans[-1][1]:
            spans[-1] = spans[-1][0], max(end, spans[-1][1])
        elif begin < end:
            spans.append((begin, end))
    return [tuple(spans) for spans in times]


def _find_course(bar: Floats) -> tuple[Floats, bool]:
    """Where to (t, 2) a bar (2, t, 2) goes, as long as it is wide, and whether its ends go opposite ways."""
    across = bar[0] - bar[1]
    ahead = np.column_stack([across[:, 1], -across[:, 0]])
    gone = np.einsum("etk,tk->e", np.diff(bar, axis=1), ahead[:-1])
    return ahead if gone.sum() >= 0.0 else -ahead, bool(gone.min() < 0.0 < gone.max())


def _find_places(bar: Floats, ahead: Floats, points: Floats) -> Floats:
    """Where (n,) in its rows a bar (2, t, 2) that goes ahead (t, 2) passes points (n, 2)."""

    def measure_ahead(rows: Integers) -> Floats:
        return np.asarray(np.einsum("nk,nk->n", points - bar[0, rows], ahead[rows]))

    before, after = np.zeros(len(points), dtype=np.int64), np.full(len(points), bar.shape[1] - 1)
    for _ in range((bar.shape[1] - 1).bit_length()):
        middle = (before + after) // 2
        is_passed = measure_ahead(middle) <= 0.0
        before, after = np.where(is_passed, before, middle), np.where(is_passed, middle, after)
    left, beyond = measure_ahead(before), measure_ahead(after)
    share = left / np.where(left > beyond, left - beyond, np.inf)
    return np.asarray(before + np.clip(share, 0.0, 1.0) * (after - before), dtype=np.float64)


def _cut_bar(bar: Floats, begin: float, end: float) -> Floats:
    """The ends of a bar (2, t, 2) between two places of its rows."""
    rows = np.arange(bar.shape[1])
    places = np.concatenate([[begin], rows[(rows > begin) & (rows < end)], [end]])
    return np.stack([np.column_stack([np.interp(places, rows, axis) for axis in one.T]) for one in bar])


def take_share(bar: Floats, begin: float, end: float) -> Floats:
    """The ends (2, t, 2) of the part of a bar between two shares of its width, 0 at its left end."""
    return np.stack([(1.0 - share) * bar[0] + share * bar[1] for share in (begin, end)])


def build_swept_polygons(ends: list[Floats]) -> Areas:
    """The area between the paths of the left and right end of a bar, one polygon per pair (2, t, 2)."""
    if not ends:
        return np.empty(0, dtype=np.object_)
    sides = [_simplify_lines([pair[side] for pair in ends]) for side in (0, 1)]
    places, owners = zip(*sides, strict=True)
    owner = np.concatenate([owners[0], owners[1][::-1]])
    order = np.argsort(owner, kind="stable")
    rings = shapely.linearrings(np.concatenate([places[0], places[1][::-1]])[order], indices=owner[order])
    areas = shapely.polygons(rings)
    crossed = ~shapely.is_valid(areas)
    areas[crossed] = [extract_polygons(area) for area in shapely.make_valid(areas[crossed])]
    return np.asarray(areas, dtype=np.object_)


def _simplify_lines(lines: list[Floats]) -> tuple[Floats, Integers]:
    """Points of polylines simplified to SIMPLIFY_M, and the line number of each."""
    owner = np.repeat(np.arange(len(lines)), [len(line) for line in lines])
    lines_m = shapely.linestrings(np.concatenate(lines), indices=owner)
    plain = shapely.simplify(lines_m, SIMPLIFY_M, preserve_topology=False)
    return shapely.get_coordinates(plain, return_index=True)  # type: ignore[no-any-return]


@dataclass(frozen=True, eq=False)
class SweptArea:
    """What the lowered implements passed over.

    `ground` (n,) polygons; for each the `tractor`, the rows `first` and `last` of the record between which it was
    swept, whether that was on a headland pass, and the `share` (n, 2) of the bar that swept it, from 0 at its left end
    to 1 at its right one.
    """

    ground: Areas
    tractor: Integers
    first: Integers
    last: Integers
    on_headland_pass: Flags
    share: Floats


def compute_swept_area(run: SimulationRun, context: PlanningContext) -> SweptArea:
    """Every polygon that an implement swept; a segment of work that bends is split, edge to edge.

    An implement with sections sweeps only what these leave on (`switch_sections`).
    """
    pieces = [piece for tractor in range(run.plan.tractors) for piece in _find_swept_pieces(run, context, tractor)]
    ends = [one for _, one in pieces]
    marks = np.array([mark for mark, _ in pieces], dtype=np.int64).reshape(-1, 4)
    share = np.tile([0.0, 1.0], (len(pieces), 1))
    ground = build_swept_polygons(ends)
    if context.request.sections > 1:
        order = np.lexsort((marks[:, 0], marks[:, 1])).tolist()
        region = context.layout.field.due_region
        parts = list(switch_sections([ends[one] for one in order], ground[order], region, context.request.sections))
        marks = np.array([_cut_mark(marks[order[part.piece]], part) for part in parts], dtype=np.int64).reshape(-1, 4)
        share = np.array([part.share for part in parts]).reshape(-1, 2)
        ground = np.array([part.ground for part in parts], dtype=np.object_)
    tractor, first, last, on_pass = marks.T
    return SweptArea(ground, tractor, first, last, on_pass.astype(bool), share)


def _cut_mark(mark: Integers, part: SweptPart) -> tuple[int, int, int, int]:
    """The mark (tractor, first and last row, on a headland pass) of a part of a piece."""
    tractor, first, last, on_pass = mark.tolist()
    begin, end = (first + SWATH_ROW_STEP * place for place in (math.floor(part.begin), math.ceil(part.end)))
    return tractor, begin, min(end, last), on_pass


def compute_swept_between_rows(
    run: SimulationRun, context: PlanningContext, pieces: list[tuple[int, int, int]], share: Floats
) -> Areas:
    """What shares (n, 2) of the bar swept between two rows: pieces are (tractor, first row, last row)."""
    ends = [
        locate_implement_ends(run.get_poses(tractor)[_list_rows(first, row)], context) for tractor, first, row in pieces
    ]
    return build_swept_polygons([take_share(one, *part) for one, part in zip(ends, share.tolist(), strict=True)])


def locate_implement_ends(poses: Floats, context: PlanningContext) -> Floats:
    """Left and right end of the implement, (2, t, 2), at poses (t, 3) of the centre of mass."""
    cosine, sine = build_directions(poses[:, 2]).T
    reach = context.tractor.rear_axle_m + context.implement.hitch_m
    middle = poses[:, :2] - reach * np.column_stack([cosine, sine])
    aside = 0.5 * context.implement.width_m * np.column_stack([-sine, cosine])
    return np.stack([middle + aside, middle - aside])


def _list_rows(first: int, last: int) -> Integers:
    return np.append(np.arange(first, last, SWATH_ROW_STEP), last)


def _find_swept_pieces(
    run: SimulationRun, context: PlanningContext, tractor: int
) -> Iterator[tuple[tuple[int, int, int, int], Floats]]:
    """Segments of work, split where they bend or change direction.

    Yields (tractor, first row, last row, on a headland pass) and the ends of the bar (2, t, 2) of
    `locate_implement_ends`.
    """
    legs = run.plan.missions[tractor].legs
    kinds = np.array(
        [(2 if leg.task.kind == HEADLAND_PASS else 1) if leg.implement else 0 for leg in legs], dtype=np.int8
    )
    kind = kinds[run.get_leg_numbers(tractor)]
    cuts = np.flatnonzero(np.diff(np.concatenate(([0], kind, [0]))))
    edges = [(first, end) for first, end in pairwise(cuts.tolist()) if kind[first]]
    if not edges:
        return
    # All segments at once: there are hundreds, and the overhead of each exceeds that of its rows.
    row_lists = [_list_rows(first, min(end, len(kind) - 1)) for first, end in edges]
    rows, borders = np.concatenate(row_lists), np.cumsum([0, *map(len, row_lists)]).tolist()
    poses = run.get_poses(tractor)[rows]
    ends, angle = locate_implement_ends(poses, context), poses[:, 2]
    direction, steps = _classify_bar_motion(angle, ends), np.hypot(*np.diff(ends, axis=1).T)
    jumps = np.abs(np.diff(angle)) >= math.pi
    for begin, after in pairwise(borders):
        inner = slice(begin, after - 1)
        if after - begin < 2 or float(steps[inner].sum()) < 2.0 * MIN_SWEPT_M:
            continue
        turned = angle[begin:after]
        on_headland_pass = int(kind[rows[begin]] == 2)
        for a, b in _split_by_bend(np.unwrap(turned) if jumps[inner].any() else turned, direction[inner]):
            first, last = begin + a, begin + b
            yield (tractor, int(rows[first]), int(rows[last]), on_headland_pass), ends[:, first : last + 1]


def _classify_bar_motion(angle: Floats, ends: Floats) -> npt.NDArray[np.int8]:
    """Per step of the bar: 1 if both ends move forward, -1 if both move back, 0 if it turns on the spot."""
    ahead = build_directions(angle[:-1])
    gone = np.einsum("etk,tk->et", np.diff(ends, axis=1), ahead)
    direction = np.where((gone >= -STILL_M).all(axis=0), 1, np.where((gone <= STILL_M).all(axis=0), -1, 0))
    return direction.astype(np.int8)


def _split_by_bend(angle: Floats, direction: npt.NDArray[np.int8]) -> Iterator[tuple[int, int]]:
    """First and last pose of pieces in one direction that turn by less than BEND_RAD; single steps on the spot."""
    first = 0
    while first < len(direction):
        ends = (np.abs(angle[first + 1 :] - angle[first]) > BEND_RAD) | (direction[first:] != direction[first])
        steps = int(np.argmax(ends)) if ends.any() else len(ends)
        last = first + max(1, steps if direction[first] else 1)
        yield first, last
        first = last
