"""The order in which one tractor works its swaths.

Swaths are grouped into cells, runs of neighbouring lines with one piece each, so that a hole or a notch is worked round
instead of crossed line by line; a cell never spans two cells of the layout, which have bearings of their own. In a cell
the swaths are worked one after another, or in a pattern that skips lines and comes back so that turns are wide.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise, product

import shapely

from fields.layout.swaths import Layout, Swath
from strategies.program.field_job import FieldJob, SwathPass
from strategies.sequencing.order_proof import PROOF_EFFORT
from strategies.sequencing.tour_search import BOUND_TOLERANCE, Tour, sharpen_bound
from strategies.sequencing.turn_table import TurnTable

START_CORNERS = [(last, way) for last in (False, True) for way in (1, -1)]
CLOSE_RATIO = 1.03  # orders whose estimates are this close are compared by the paths driven
MIN_OVERLAP_M = 1e-6  # of curved swaths
SwathCell = list[Swath]
PassOrder = list[SwathPass]


def group_swaths_into_cells(layout: Layout, swaths: list[Swath]) -> list[SwathCell]:
    """Group swaths of a layout into cells, each within one cell of the layout, in the order of their first swaths."""
    return [
        cell
        for layout_cell in layout.cells
        for cell in group_same_bearing_cells(
            [swath for swath in swaths if swath.cell_number == layout_cell.number], layout_cell.bearing_rad
        )
    ]


def group_same_bearing_cells(swaths: list[Swath], bearing_rad: float) -> list[SwathCell]:
    """Group swaths of one bearing: a piece joins the cell of the one before if each overlaps only the other."""
    by_line: dict[int, list[Swath]] = {}
    for swath in swaths:
        by_line.setdefault(swath.line, []).append(swath)
    lines = sorted(by_line)
    cells: list[SwathCell] = []
    last_cell: dict[Swath, SwathCell] = {}
    for number, line in enumerate(lines):
        before = by_line[lines[number - 1]] if number else []
        for swath in by_line[line]:
            touching = [t for t in before if _is_overlapping(t, swath, bearing_rad)]
            is_alone = (
                len(touching) == 1 and sum(_is_overlapping(touching[0], t, bearing_rad) for t in by_line[line]) == 1
            )
            cell = last_cell[touching[0]] if is_alone else []
            if not is_alone:
                cells.append(cell)
            cell.append(swath)
            last_cell[swath] = cell
    return cells


def _is_overlapping(a: Swath, b: Swath, bearing_rad: float) -> bool:
    """Whether two swaths lie beside each other: straight ones by their bearing, curved ones by the other's line."""
    if a.via_m or b.via_m:
        line = shapely.LineString(b.points_m)
        first, last = shapely.line_locate_point(line, shapely.points([a.start_m, a.end_m])).tolist()
        return bool(abs(last - first) > MIN_OVERLAP_M)
    cosine, sine = math.cos(bearing_rad), math.sin(bearing_rad)

    def project_m(point: tuple[float, float]) -> float:
        return point[0] * cosine + point[1] * sine

    return project_m(a.start_m) < project_m(b.end_m) and project_m(b.start_m) < project_m(a.end_m)


def build_skip_pattern(count: int, jump: int) -> list[int]:
    """Indices 0..count-1 in an order that jumps `jump` ahead and `jump` - 1 back, block by block of 2 `jump`."""
    order: list[int] = []
    first = 0
    while first < count:
        size = min(2 * jump, count - first)
        half = (size + 1) // 2
        for index in range(half):
            order.append(first + index)
            if index + half < size:
                order.append(first + index + half)
        first += size
    return order


def list_jumps(job: FieldJob) -> list[int]:
    """Patterns worth trying: one after another, and the two smallest jumps with room for a U-turn."""
    min_u_turn_jump = math.ceil(2.0 * job.driving_rules.radius_m / job.layout.width_m)
    return [1] if min_u_turn_jump <= 1 else [1, min_u_turn_jump, min_u_turn_jump + 1]


def order_swaths(
    swaths: list[Swath],
    job: FieldJob,
    jump: int,
    corner: tuple[bool, int],
    last_piece: bool = False,
    cells: Sequence[SwathCell] | None = None,
) -> PassOrder:
    """One order through all swaths, starting at a corner (from the last line?, first direction).

    If the line of that corner is interrupted, it starts with its first piece or its last. `cells` are those of the
    swaths if already known.
    """
    cells = list(group_swaths_into_cells(job.layout, swaths) if cells is None else cells)
    start = _find_start_cell(cells, job.layout, corner, last_piece)
    cells.remove(start)
    order = _order_cell(start, jump, *corner)
    while cells:
        cell, option = _find_nearest_cell(order[-1], cells, job)
        cells.remove(cell)
        order += _order_cell(cell, jump, *option)
    return order


def _find_start_cell(
    cells: Sequence[SwathCell], layout: Layout, corner: tuple[bool, int], last_piece: bool
) -> SwathCell:
    """The cell that an order begins with."""
    from_last, _ = corner
    outer = -1 if from_last else 0
    first_cells = _find_first_cells(list(cells), layout)
    edge_line = (max if from_last else min)(cell[outer].line for cell in first_cells)
    pieces = (cell for cell in first_cells if cell[outer].line == edge_line)
    return (max if last_piece else min)(pieces, key=lambda cell: cell[outer].piece)


def _find_first_cells(cells: list[SwathCell], layout: Layout) -> list[SwathCell]:
    """The cells an order may begin with: all, or with an entrance those in the layout's cell nearest to it."""
    entrance = layout.field.entrance
    if entrance is None or len(layout.cells) == 1:
        return cells
    ends = (
        (round(math.dist(entrance, end), 6), swath.cell_number)
        for cell in cells
        for swath in cell
        for end in (swath.start_m, swath.end_m)
    )
    nearest_cell = min(ends)[1]
    return [cell for cell in cells if cell[0].cell_number == nearest_cell]


def _order_cell(cell: SwathCell, jump: int, from_last: bool, direction: int) -> PassOrder:
    swaths = cell[::-1] if from_last else cell
    return [
        SwathPass(swaths[index], direction if turn % 2 == 0 else -direction)
        for turn, index in enumerate(build_skip_pattern(len(swaths), jump) if jump > 1 else range(len(swaths)))
    ]


def _find_nearest_cell(
    current_pass: SwathPass, cells: list[SwathCell], job: FieldJob
) -> tuple[SwathCell, tuple[bool, int]]:
    """The cell, and the corner of it, that is reached soonest from the end of a pass."""
    seconds = job.build_turn_estimator(current_pass)
    options = [
        (seconds(SwathPass(cell[-1] if from_last else cell[0], direction)), index, from_last, direction)
        for index, cell in enumerate(cells)
        for from_last in (False, True)
        for direction in (-current_pass.direction, current_pass.direction)
    ]
    _, index, from_last, direction = min(options, key=lambda option: (round(option[0], 6), *option[1:]))
    return cells[index], (from_last, direction)


def _is_interrupted(cells: Sequence[SwathCell], layout: Layout, corner: tuple[bool, int]) -> bool:
    """Whether the line of a corner has different first and last pieces."""
    return _find_start_cell(cells, layout, corner, True) is not _find_start_cell(cells, layout, corner, False)


def estimate_order_time_s(order: PassOrder, job: FieldJob) -> float:
    """Estimated seconds for an order, turns and work."""
    work_s = sum(swath_pass.swath.length_m for swath_pass in order) / job.driving_rules.work_speed_mps
    return work_s + sum(job.estimate_turn_time_s(a, b) for a, b in pairwise(order))


def order_shares_in_pattern(shares: list[list[Swath]], job: FieldJob, jump: int) -> list[PassOrder]:
    """Orders in one pattern for several tractors at once, from the corner that makes the slowest quickest.

    Estimates decide; close ones are compared by the paths really driven, so that the choice depends on the shape of the
    field and not on its orientation.
    """
    corners = [job.corner] if job.corner else START_CORNERS
    share_cell_lists = [group_swaths_into_cells(job.layout, share) for share in shares]
    options = [
        [
            order_swaths(share, job, jump, corner, last_piece, share_cells)
            for share, share_cells in zip(shares, share_cell_lists, strict=True)
        ]
        for corner, last_piece in product(corners, (False, True))
        if not last_piece or any(_is_interrupted(share_cells, job.layout, corner) for share_cells in share_cell_lists)
    ]
    option_entrance_times_s = [
        [job.estimate_entrance_time_s(order[0], order[-1]) for order in orders] for orders in options
    ]
    option_times_s = [
        max(
            estimate_order_time_s(order, job) + entrance_s
            for order, entrance_s in zip(orders, entrance_times_s, strict=True)
        )
        for orders, entrance_times_s in zip(options, option_entrance_times_s, strict=True)
    ]
    close_options = [
        orders
        for orders, time in zip(options, option_times_s, strict=True)
        if time <= CLOSE_RATIO * min(option_times_s)
    ]
    distinct = [orders for index, orders in enumerate(close_options) if orders not in close_options[:index]]
    if len(distinct) == 1:
        return distinct[0]

    def measure_slowest_s(orders: list[PassOrder]) -> float:
        return round(
            max(
                compute_driven_time_s(order, job) + job.estimate_entrance_time_s(order[0], order[-1])
                for order in orders
            ),
            2,
        )

    return min(distinct, key=measure_slowest_s)


@dataclass(frozen=True, eq=False)
class SearchedOrder:
    """An order of passes, its seconds including work, and the tour found by the search."""

    order: PassOrder
    seconds: float
    tour: Tour

    @cached_property
    def gap_pct(self) -> float:
        """By how much the paths of another order could be quicker at most (percent); computed on first use."""
        return sharpen_bound(self.tour).gap_pct


def search_order(
    share: list[Swath], job: FieldJob, table: TurnTable, *, roughly: bool = False, proven: bool = True
) -> SearchedOrder:
    """The quickest order through some swaths by the paths that would be driven.

    `table` is that of all swaths of the layout. The search begins with the usual patterns and improves them
    (tour_search). `roughly` is for comparing layouts: long paths are estimated, and the search ends early. Without
    `proven` the best order of few swaths is not computed.
    """
    place = {swath: index for index, swath in enumerate(job.layout.swaths)}
    cells = group_swaths_into_cells(job.layout, share)
    starts = [
        [place[swath_pass.swath] for swath_pass in order_swaths(share, job, jump, corner, cells=cells)]
        for jump, corner in product(list_jumps(job), START_CORNERS)
    ]
    distinct = [start for index, start in enumerate(starts) if start not in starts[:index]]
    best = table.find_best_pass_order([place[swath] for swath in share], distinct, roughly=roughly, proven=proven)
    work_s = sum(swath.length_m for swath in share) / job.driving_rules.work_speed_mps
    return SearchedOrder([table.passes[p] for p in best.passes.tolist()], work_s + best.seconds, best)


def prove_order(searched: SearchedOrder, table: TurnTable, effort: float = PROOF_EFFORT) -> SearchedOrder:
    """A searched order improved and proven to a percent as far as `effort` goes: for orders that are kept.

    `table` is that of the search. Takes up to some seconds where the search leaves more open.
    """
    tour = searched.tour
    if tour.times is None or tour.gap_pct <= 100.0 * BOUND_TOLERANCE:
        return searched
    proven = table.prove_pass_order(tour, effort)
    order = [table.passes[p] for p in proven.passes.tolist()]
    return SearchedOrder(order, searched.seconds - tour.seconds + proven.seconds, proven)


def compute_driven_time_s(order: PassOrder, job: FieldJob) -> float:
    """Seconds for an order with the paths that would really be driven; infinite if one is missing."""
    paths = [job.find_path(job.get_exit_pose(a), job.get_entry_pose(b)) for a, b in pairwise(order)]
    turns = (math.inf if path is None else job.connector.compute_cost_s(path) for path in paths)
    return sum(swath_pass.swath.length_m for swath_pass in order) / job.driving_rules.work_speed_mps + sum(turns)
