"""Ground swept by the implements of a run, as polygons with the rows of the record in which they were swept."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from fields.geometry.overlays import Areas
from planner.evaluation.context import PlanningContext
from planner.evaluation.ground.sections import STILL_M, SweptPart, build_swept_polygons, switch_sections, take_share
from vehicle.missions.plan import HEADLAND_PASS
from vehicle.missions.run import SimulationRun

SWATH_ROW_STEP = 3  # rows of the 10 Hz record between corners of a polygon: under half a metre of driving
BEND_RAD = math.radians(20.0)  # a polygon ends where the bar has turned this far, so that neither side crosses itself
MIN_SWEPT_M = 0.1
Points = npt.NDArray[np.float64]
Rows = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class SweptArea:
    """What the lowered implements passed over.

    `ground` (n,) polygons; for each the `tractor`, the rows `first` and `last` of the record between which it was
    swept, whether that was on a headland pass, and the `share` (n, 2) of the bar that swept it, from 0 at its left end
    to 1 at its right one.
    """

    ground: Areas
    tractor: Rows
    first: Rows
    last: Rows
    on_headland_pass: npt.NDArray[np.bool_]
    share: Points


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
        region = context.layout.field.region_without_obstacles
        parts = list(switch_sections([ends[one] for one in order], ground[order], region, context.request.sections))
        marks = np.array([_cut_mark(marks[order[part.piece]], part) for part in parts], dtype=np.int64).reshape(-1, 4)
        share = np.array([part.share for part in parts]).reshape(-1, 2)
        ground = np.array([part.ground for part in parts], dtype=np.object_)
    tractor, first, last, on_pass = marks.T
    return SweptArea(ground, tractor, first, last, on_pass.astype(bool), share)


def _cut_mark(mark: Rows, part: SweptPart) -> tuple[int, int, int, int]:
    """The mark (tractor, first and last row, on a headland pass) of a part of a piece."""
    tractor, first, last, on_pass = mark.tolist()
    begin, end = (first + SWATH_ROW_STEP * place for place in (math.floor(part.begin), math.ceil(part.end)))
    return tractor, begin, min(end, last), on_pass


def compute_swept_between_rows(
    run: SimulationRun, context: PlanningContext, pieces: list[tuple[int, int, int]], share: Points
) -> Areas:
    """What shares (n, 2) of the bar swept between two rows: pieces are (tractor, first row, last row)."""
    ends = [
        locate_implement_ends(run.get_poses(tractor)[_list_rows(first, row)], context) for tractor, first, row in pieces
    ]
    return build_swept_polygons([take_share(one, *part) for one, part in zip(ends, share.tolist(), strict=True)])


def locate_implement_ends(poses: Points, context: PlanningContext) -> Points:
    """Left and right end of the implement, (2, t, 2), at poses (t, 3) of the centre of mass."""
    x, y, angle = poses.T
    reach = -(context.tractor.rear_axle_m + context.implement.hitch_m)
    middle = np.column_stack([x + reach * np.cos(angle), y + reach * np.sin(angle)])
    aside = 0.5 * context.implement.width_m * np.column_stack([-np.sin(angle), np.cos(angle)])
    return np.stack([middle + aside, middle - aside])


def _list_rows(first: int, last: int) -> Rows:
    return np.append(np.arange(first, last, SWATH_ROW_STEP), last)


def _find_swept_pieces(
    run: SimulationRun, context: PlanningContext, tractor: int
) -> Iterator[tuple[tuple[int, int, int, int], Points]]:
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


def _classify_bar_motion(angle: Points, ends: Points) -> npt.NDArray[np.int8]:
    """Per step of the bar: 1 if both ends move forward, -1 if both move back, 0 if it turns on the spot."""
    ahead = np.column_stack([np.cos(angle[:-1]), np.sin(angle[:-1])])
    gone = np.einsum("etk,tk->et", np.diff(ends, axis=1), ahead)
    direction = np.where((gone >= -STILL_M).all(axis=0), 1, np.where((gone <= STILL_M).all(axis=0), -1, 0))
    return direction.astype(np.int8)


def _split_by_bend(angle: Points, direction: npt.NDArray[np.int8]) -> Iterator[tuple[int, int]]:
    """First and last pose of pieces in one direction that turn by less than BEND_RAD; single steps on the spot."""
    first = 0
    while first < len(direction):
        ends = (np.abs(angle[first + 1 :] - angle[first]) > BEND_RAD) | (direction[first:] != direction[first])
        steps = int(np.argmax(ends)) if ends.any() else len(ends)
        last = first + max(1, steps if direction[first] else 1)
        yield first, last
        first = last
