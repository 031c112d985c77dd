"""Layouts worth comparing inside the same headland passes: several bearings, and cells with bearings of their own."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely

from fields.arrays import Floats
from fields.errors import FieldError, mark_parameter
from fields.geometry.arithmetic import multiply
from fields.geometry.field import Field
from fields.layout.bearings import list_candidate_bearings, list_trial_bearings
from fields.layout.cells import PLAIN_RATES, Cell, EffortRates, RegionPart, divide_region, estimate_costs_m
from fields.layout.parallel_lines import PatternRules, compute_axes, fill_region
from fields.layout.swaths import (
    Layout,
    Swath,
    build_swaths,
    lay_swaths,
    normalise_bearing,
    number_from_longer_side,
    orient_bearing_by_outline,
    reverse_line_numbers,
)
from fields.text_files import count_noun

MIN_DIFFERENCE_RAD = math.radians(5.0)  # closer bearings give much the same swaths
CLOSE_RAD = math.radians(1.0)  # closer ones are the same
MAX_COST_RATIO = 1.1  # to the cheapest bearing by estimate: others are not laid
MAX_LAID_BEARINGS, MAX_LAID_SWATHS = 16, 160  # laid to choose among: few swaths allow many bearings
MIN_LAID_BEARINGS = 3


def estimate_layout_cost_m(layout: Layout, rates: EffortRates = PLAIN_RATES) -> float:
    """Estimated cost of swaths as a driving length (m): their length, a turn for each, the way to every cell.

    Half a turn belongs to every end, the cheapest that leads to an end on the same side of its cell.
    """
    turns_m = [
        _estimate_cell_turns_m([swath for swath in layout.swaths if swath.cell_number == cell.number], cell, rates)
        for cell in layout.cells
    ]
    return layout.total_length_m + math.fsum(turns_m) + rates.cell_m * (len(layout.cells) - 1)


def _estimate_cell_turns_m(swaths: Sequence[Swath], cell: Cell, rates: EffortRates) -> float:
    """Metres that could be worked during the turns of one cell."""
    if len(swaths) < 2:
        return rates.turn_m * len(swaths)
    along = compute_axes(cell.bearing_rad)[0]
    lines = np.array([swath.line for swath in swaths])
    apart = np.abs(lines[:, None] - lines[None, :])
    turns_m = np.array((np.inf, *rates.turns_m, np.inf))[np.minimum(apart, len(rates.turns_m) + 1)]
    total_m = 0.0
    for ends in ([swath.start_m for swath in swaths], [swath.end_m for swath in swaths]):
        station = multiply(ends, along)
        costs = turns_m + rates.offset * np.abs(station[:, None] - station[None, :])
        cheapest = costs.min(axis=1)
        total_m += 0.5 * float(np.where(np.isfinite(cheapest), cheapest, rates.turn_m).sum())
    return total_m


def find_cheapest_bearing_deg(field: Field, region: shapely.Geometry, width_m: float, rates: EffortRates) -> float:
    """The bearing (degrees clockwise from north) that seems cheapest for swaths over a region of a field."""
    angles = np.array(list_trial_bearings(field.boundary))
    return 90.0 - math.degrees(angles[np.round(estimate_costs_m(region, angles, width_m, rates), 3).argmin()])


def list_layout_alternatives(base_layout: Layout, rates: EffortRates = PLAIN_RATES) -> list[Layout]:
    """A layout by `lay_swaths` with headland passes and its alternatives, the cheapest by estimate first.

    The alternatives have other bearings, and cells if these seem cheaper than any single bearing. Bearings are first
    compared by the edges of the ground alone, and only promising ones are laid.
    """
    field, width_m, region = base_layout.field, base_layout.width_m, base_layout.inner_region
    angles = np.array([normalise_bearing(angle) for angle in list_trial_bearings(field.boundary)])
    cost = np.round(estimate_costs_m(region, angles, width_m, rates), 3)
    options = [base_layout]
    laid_swaths = len(base_layout.swaths)
    for angle in _list_promising_bearings(base_layout.bearing_rad, angles, cost):
        is_enough = laid_swaths >= MAX_LAID_SWATHS and len(options) >= MIN_LAID_BEARINGS
        if is_enough or len(options) >= MAX_LAID_BEARINGS:
            break
        cells = _cover_cells(base_layout, [(region, angle)])
        if cells:
            options.append(_assemble_layout(base_layout, cells))
            laid_swaths += len(options[-1].swaths)
    parts = divide_region(region, angles[: len(list_candidate_bearings(field.boundary))], width_m, rates)
    if len({part.bearing_rad for part in parts}) > 1:
        options.append(lay_cell_swaths(base_layout, parts))
    return sorted(options, key=lambda option: round(estimate_layout_cost_m(option, rates), 3))


def _list_promising_bearings(first: float, angles: Floats, cost: Floats) -> list[float]:
    """Bearings (radians) other than the first, by cost: first those that differ from all before, then close ones."""
    ranked = [
        float(angles[k]) for k in np.argsort(cost, kind="stable").tolist() if cost[k] <= MAX_COST_RATIO * cost.min()
    ]
    chosen = [first]
    for gap_rad in (MIN_DIFFERENCE_RAD, CLOSE_RAD):
        for angle in ranked:
            if min(abs(math.remainder(angle - other, math.pi)) for other in chosen) > gap_rad:
                chosen.append(angle)
    return chosen[1:]


@dataclass(frozen=True, eq=False)
class _CellSwaths:
    """A region, the direction of its swaths (radians), and its swaths, lines counted from 0."""

    region: shapely.Geometry
    bearing_rad: float
    swaths: tuple[Swath, ...]


def lay_cell_swaths(base_layout: Layout, parts: Sequence[RegionPart]) -> Layout:
    """The layout with every part of its inner region as a cell that its own swaths cover completely.

    Cells and their lines are numbered so that each is near the one before.
    """
    return _assemble_layout(
        base_layout, _order_cells(_cover_cells(base_layout, [(part.region, part.bearing_rad) for part in parts]))
    )


def _cover_cells(base_layout: Layout, cells: Iterable[tuple[shapely.Geometry, float]]) -> list[_CellSwaths]:
    """Swaths over regions in their directions; regions not worth a swath are dropped."""
    rules = PatternRules.inside_headland(base_layout.inner_region, base_layout.width_m, base_layout.min_spacing_m)
    entrance = base_layout.field.entrance
    return [
        _CellSwaths(region, bearing, number_from_longer_side(build_swaths(pattern, compute_axes(bearing)), entrance))
        for region, bearing in (
            (region, orient_bearing_by_outline(base_layout.field, bearing)) for region, bearing in cells
        )
        if (pattern := fill_region(region, bearing, rules)) is not None
    ]


def _assemble_layout(base_layout: Layout, ordered_cells: Sequence[_CellSwaths]) -> Layout:
    """The layout with these cells, in this order."""
    cells: list[Cell] = []
    swaths: list[Swath] = []
    for number, cell_swaths in enumerate(ordered_cells, start=1):
        cells.append(Cell(number, cell_swaths.bearing_rad, cell_swaths.region))
        first = swaths[-1].line + 1 if swaths else 0
        swaths += [replace(swath, line=first + swath.line, cell_number=number) for swath in cell_swaths.swaths]
    largest = max(cells, key=lambda cell: round(cell.area_m2, 3))
    return replace(base_layout, bearing_rad=largest.bearing_rad, swaths=tuple(swaths), cells=tuple(cells))


def replace_bearings(layout: Layout, bearings_deg: Mapping[int, float]) -> Layout:
    """The layout with other bearings, degrees clockwise from north, by numbers of cells; raises FieldError."""
    count = max(1, len(layout.cells))  # other bearings may leave room for tracks where there are none
    for number in sorted(bearings_deg):
        if not 1 <= number <= count:
            raise FieldError(
                f"Cell {number} ({mark_parameter('cell_bearings')}) does not exist: field '{layout.field.name}' has "
                f"{count_noun(count, 'cell')}; use {'1' if count == 1 else f'1 to {count}'}.",
                parameter="cell_bearings",
            )
    if count == 1:
        return lay_swaths(
            layout.field,
            layout.width_m,
            layout.headland_m,
            bearings_deg[1],
            headland_passes=layout.headland_passes,
            min_spacing_m=layout.min_spacing_m,
        )
    turned = (
        normalise_bearing(math.radians(90.0 - bearings_deg[cell.number]) % math.pi)
        if cell.number in bearings_deg
        else cell.bearing_rad
        for cell in layout.cells
    )
    pairs = zip(layout.cells, turned, strict=True)
    return _assemble_layout(layout, _cover_cells(layout, [(cell.region, bearing) for cell, bearing in pairs]))


def _order_cells(cells: list[_CellSwaths]) -> list[_CellSwaths]:
    """Cells in an order of short ways, an outer one first; lines of each begin where the cell before ends."""
    distance = np.array([[shapely.distance(a.region, b.region) for b in cells] for a in cells])
    centroids = [cell.region.centroid for cell in cells]
    remoteness = distance.sum(axis=1) + shapely.distance(centroids, shapely.MultiPoint(centroids).centroid)
    place = int(np.round(remoteness, 3).argmax())
    row, remaining = [], list(range(len(cells)))
    end: shapely.Point | None = None
    while remaining:
        remaining.remove(place)
        cell = cells[place]
        next_place = min(remaining, key=lambda other: (round(distance[place, other], 3), other), default=-1)
        if end is not None:
            cell = _orient_lines_toward(cell, end)
        elif next_place >= 0:
            cell = _reverse_lines(_orient_lines_toward(cell, cells[next_place].region.centroid))
        row.append(cell)
        end = _build_line(cell.swaths[-1]).centroid
        place = next_place
    return row


def _build_line(swath: Swath) -> shapely.LineString:
    return shapely.LineString([swath.start_m, swath.end_m])


def _orient_lines_toward(cell: _CellSwaths, target: shapely.Geometry) -> _CellSwaths:
    """The cell with its lines counted from the side nearer to the target."""
    first, last = (shapely.distance(_build_line(swath), target) for swath in (cell.swaths[0], cell.swaths[-1]))
    return _reverse_lines(cell) if last < first - 1e-6 else cell


def _reverse_lines(cell: _CellSwaths) -> _CellSwaths:
    """The cell with its lines counted from the other side."""
    return replace(cell, swaths=reverse_line_numbers(cell.swaths))
