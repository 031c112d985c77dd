"""The order in which one tractor works its swaths.

Swaths are grouped into cells, runs of neighbouring lines with one piece each, so that a hole or a notch is worked round
instead of crossed line by line; a cell never spans two cells of the layout, which have bearings of their own. In a cell
the swaths are worked one after another, or in a pattern that skips lines and comes back so that turns are wide.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import product

import shapely

from fields.layout.swaths import Layout, Swath
from strategies.program.field_job import FieldJob, SwathPass
from strategies.sequencing.tour_search import find_best_order
from strategies.sequencing.turn_table import TurnTable

START_CORNERS = [(last, way) for last in (False, True) for way in (1, -1)]
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
    swaths: list[Swath], job: FieldJob, jump: int, corner: tuple[bool, int], cells: Sequence[SwathCell] | None = None
) -> PassOrder:
    """One order through all swaths, starting at a corner (from the last line?, first direction).

    If the line of that corner is interrupted, it starts with its first piece. `cells` are those of the swaths if
    already known.
    """
    cells = list(group_swaths_into_cells(job.layout, swaths) if cells is None else cells)
    start = _find_start_cell(cells, job.layout, corner)
    cells.remove(start)
    order = _order_cell(start, jump, *corner)
    while cells:
        cell, option = _find_nearest_cell(order[-1], cells, job)
        cells.remove(cell)
        order += _order_cell(cell, jump, *option)
    return order


def _find_start_cell(cells: Sequence[SwathCell], layout: Layout, corner: tuple[bool, int]) -> SwathCell:
    """The cell that an order begins with."""
    from_last, _ = corner
    outer = -1 if from_last else 0
    first_cells = _find_first_cells(list(cells), layout)
    edge_line = (max if from_last else min)(cell[outer].line for cell in first_cells)
    pieces = (cell for cell in first_cells if cell[outer].line == edge_line)
    return min(pieces, key=lambda cell: cell[outer].piece)


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


def estimate_layout_s(job: FieldJob, near_lines: int) -> float:
    """Seconds of the swaths of a job in a good order for one tractor, with the paths between them and the entrance.

    Turns over at most `near_lines` are those that would be driven, longer paths are estimated.
    """
    swaths = list(job.layout.swaths)
    table, place = TurnTable(job, swaths, near_lines), {swath: index for index, swath in enumerate(swaths)}
    cells = group_swaths_into_cells(job.layout, swaths)
    starts = [
        [place[swath_pass.swath] for swath_pass in order_swaths(swaths, job, jump, corner, cells)]
        for jump, corner in product(list_jumps(job), START_CORNERS)
    ]
    distinct = [start for index, start in enumerate(starts) if start not in starts[:index]]
    first_s, last_s = table.estimate_start_end_s()
    _, seconds = find_best_order(table.seconds, first_s, last_s, distinct)
    return job.layout.total_length_m / job.driving_rules.work_speed_mps + seconds
