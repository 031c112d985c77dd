"""Layouts worth comparing inside the same headland passes: several bearings, and cells with bearings of their own."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import shapely

from fields.errors import FieldError, mark_parameter
from fields.layout.bearings import list_candidate_bearings
from fields.layout.cells import CELL_COST_M, Cell, RegionPart, divide_region, estimate_costs_m
from fields.layout.parallel_lines import TURN_COST_M, PatternRules, compute_axes, fill_region
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

FloatArray = npt.NDArray[np.float64]

MAX_COST_RATIO = 1.02  # to the cheapest bearing: within this, another one may still be quicker
MAX_BEARINGS = 3
MIN_DIFFERENCE_RAD = math.radians(5.0)  # closer bearings give much the same swaths
MIN_SWATH_LENGTH_M = 5.0


def estimate_layout_cost_m(layout: Layout) -> float:
    """Estimated cost of swaths as a driving length (m): their length, a turn for each, the way to every cell."""
    return layout.total_length_m + TURN_COST_M * len(layout.swaths) + CELL_COST_M * (len(layout.cells) - 1)


def list_layout_alternatives(base_layout: Layout) -> list[Layout]:
    """A layout by `lay_swaths` with headland passes and its alternatives, the cheapest by estimate first.

    The alternatives have other bearings of nearly the same cost, and cells if these seem cheaper than any single
    bearing.
    """
    field, width_m, headland_passes = base_layout.field, base_layout.width_m, base_layout.headland_passes
    angles = np.array([normalise_bearing(angle) for angle in list_candidate_bearings(field.boundary)])
    cost = np.round(estimate_costs_m(base_layout.inner_region, angles, width_m), 3)
    chosen = [base_layout.bearing_rad]
    for place in np.argsort(cost, kind="stable").tolist():
        difference_rad = min(abs(math.remainder(angles[place] - other, math.pi)) for other in chosen)
        if (
            cost[place] <= MAX_COST_RATIO * cost.min()
            and difference_rad > MIN_DIFFERENCE_RAD
            and len(chosen) < MAX_BEARINGS
        ):
            chosen.append(float(angles[place]))
    alternatives = [
        lay_swaths(
            field,
            width_m,
            0.0,
            _convert_to_bearing_deg(angle),
            headland_passes=headland_passes,
            min_spacing_m=base_layout.min_spacing_m,
        )
        for angle in chosen[1:]
    ]
    options = [base_layout, *alternatives]
    parts = divide_region(base_layout.inner_region, angles, width_m)
    if len({part.bearing_rad for part in parts}) > 1:
        options.append(lay_cell_swaths(base_layout, parts))
    return sorted(options, key=lambda option: round(estimate_layout_cost_m(option), 3))


def _convert_to_bearing_deg(bearing_rad: float) -> float:
    return 90.0 - math.degrees(bearing_rad)


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
    rules = PatternRules(
        base_layout.width_m,
        0.0,
        MIN_SWATH_LENGTH_M,
        0.5 * base_layout.width_m,
        base_layout.inner_region.area,
        base_layout.min_spacing_m,
    )
    return [
        _CellSwaths(region, bearing, number_from_longer_side(build_swaths(pattern, compute_axes(bearing))))
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
    count = len(layout.cells)
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
    remoteness = distance.sum(axis=1) + np.array(
        [shapely.distance(a.region.centroid, _find_cells_centroid(cells)) for a in cells]
    )
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


def _find_cells_centroid(cells: list[_CellSwaths]) -> shapely.Point:
    return shapely.union_all([one.region.centroid for one in cells]).centroid


def _build_line(swath: Swath) -> shapely.LineString:
    return shapely.LineString([swath.start_m, swath.end_m])


def _orient_lines_toward(cell: _CellSwaths, target: shapely.Geometry) -> _CellSwaths:
    """The cell with its lines counted from the side nearer to the target."""
    first, last = (shapely.distance(_build_line(swath), target) for swath in (cell.swaths[0], cell.swaths[-1]))
    return _reverse_lines(cell) if last < first - 1e-6 else cell


def _reverse_lines(cell: _CellSwaths) -> _CellSwaths:
    """The cell with its lines counted from the other side."""
    return replace(cell, swaths=reverse_line_numbers(cell.swaths))
