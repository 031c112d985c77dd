"""Layouts worth comparing inside the same rounds of a headland: several bearings, and cells with their own."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import shapely

from fields.bearings import candidate_bearings
from fields.cells import Cell
from fields.cutting import CELL_M, Part, costs_m, divided
from fields.errors import FieldError, named
from fields.filling import filled
from fields.layout import Layout, Track, counted_back, from_longer_side, half_turn, lay_tracks, pointing, tracks_of
from fields.lines import TURN_M, CombRules, axes

FloatArray = npt.NDArray[np.float64]

PROMISING = 1.02  # directions this much dearer than the cheapest may still be quicker
MOST_BEARINGS = 3
APART_RAD = math.radians(5.0)  # directions that are nearer give much the same tracks
SHORTEST_M = 5.0


def effort_m(layout: Layout) -> float:
    """What tracks cost by estimate, as a driving length (m): their own, a turn for each, the way to every cell."""
    return layout.total_m + TURN_M * len(layout.tracks) + CELL_M * (len(layout.cells) - 1)


def lay_options(plain: Layout) -> list[Layout]:
    """Layouts inside the same rounds as one that `lay_tracks` has laid there, the cheapest by estimate first.

    It is one of them. The others have other bearings that come close, and cells where these look cheaper than any one
    bearing.
    """
    field, width_m, rounds = plain.field, plain.width_m, plain.rounds
    angles = np.array([half_turn(angle) for angle in candidate_bearings(field.boundary)])
    cost = np.round(costs_m(plain.inner, angles, width_m), 3)
    chosen = [plain.bearing_rad]
    for place in np.argsort(cost, kind="stable").tolist():
        away = min(abs(math.remainder(angles[place] - other, math.pi)) for other in chosen)
        if cost[place] <= PROMISING * cost.min() and away > APART_RAD and len(chosen) < MOST_BEARINGS:
            chosen.append(float(angles[place]))
    others = [
        lay_tracks(field, width_m, 0.0, _compass(angle), rounds=rounds, apart_m=plain.apart_m) for angle in chosen[1:]
    ]
    options = [plain, *others]
    parts = divided(plain.inner, angles, width_m)
    if len({part.bearing_rad for part in parts}) > 1:
        options.append(lay_cells(plain, parts))
    return sorted(options, key=lambda option: round(effort_m(option), 3))


def _compass(bearing_rad: float) -> float:
    return 90.0 - math.degrees(bearing_rad)


@dataclass(frozen=True, eq=False)
class _Laid:
    """A region with the direction of its tracks (radians) and these, lines counted from 0."""

    region: shapely.Geometry
    bearing_rad: float
    tracks: tuple[Track, ...]


def lay_cells(plain: Layout, parts: Sequence[Part]) -> Layout:
    """A layout in which every part of the inner region of another is a cell, tracks of which cover it whole.

    Cells are numbered so that each is near the one before, and so are its lines.
    """
    return _laid_in_order(plain, _in_a_row(_covered(plain, [(part.region, part.bearing_rad) for part in parts])))


def _covered(plain: Layout, cells: Iterable[tuple[shapely.Geometry, float]]) -> list[_Laid]:
    """Tracks over regions in their directions; what is not worth a track is left out."""
    rules = CombRules(plain.width_m, 0.0, SHORTEST_M, 0.5 * plain.width_m, plain.inner.area, plain.apart_m)
    return [
        _Laid(region, bearing, from_longer_side(tracks_of(teeth, axes(bearing))))
        for region, bearing in ((region, pointing(plain.field, bearing)) for region, bearing in cells)
        if (teeth := filled(region, bearing, rules)) is not None
    ]


def _laid_in_order(plain: Layout, laid: Sequence[_Laid]) -> Layout:
    """The layout whose cells are these in their order."""
    cells: list[Cell] = []
    tracks: list[Track] = []
    for number, one in enumerate(laid, start=1):
        cells.append(Cell(number, one.bearing_rad, one.region))
        first = tracks[-1].line + 1 if tracks else 0
        tracks += [replace(track, line=first + track.line, cell=number) for track in one.tracks]
    largest = max(cells, key=lambda cell: round(cell.area_m2, 3))
    return replace(plain, bearing_rad=largest.bearing_rad, tracks=tuple(tracks), cells=tuple(cells))


def with_bearings(layout: Layout, bearings_deg: Mapping[int, float]) -> Layout:
    """The layout with other bearings, degrees clockwise from north, by numbers of cells; raises FieldError."""
    count = len(layout.cells)
    for number in sorted(bearings_deg):
        if not 1 <= number <= count:
            raise FieldError(
                f"Cell {number} ({named('cell_bearings')}) does not exist: field '{layout.field.name}' has {count} "
                f"cell{'s' if count > 1 else ''}; use {'1' if count == 1 else f'1 to {count}'}.",
                parameter="cell_bearings",
            )
    if count == 1:
        return lay_tracks(
            layout.field, layout.width_m, layout.headland_m, bearings_deg[1], rounds=layout.rounds,
            apart_m=layout.apart_m,
        )  # fmt: skip
    turned = (
        half_turn(math.radians(90.0 - bearings_deg[cell.number]) % math.pi)
        if cell.number in bearings_deg else cell.bearing_rad for cell in layout.cells
    )  # fmt: skip
    pairs = zip(layout.cells, turned, strict=True)
    return _laid_in_order(layout, _covered(layout, [(cell.region, bearing) for cell, bearing in pairs]))


def _in_a_row(laid: list[_Laid]) -> list[_Laid]:
    """Cells one near the other, an outer one first, the lines of each from where the one before ends."""
    distance = np.array([[shapely.distance(a.region, b.region) for b in laid] for a in laid])
    beyond = distance.sum(axis=1) + np.array([shapely.distance(a.region.centroid, _middle(laid)) for a in laid])
    place = int(np.round(beyond, 3).argmax())
    row, left = [], list(range(len(laid)))
    end: shapely.Point | None = None
    while left:
        left.remove(place)
        one = laid[place]
        ahead = min(left, key=lambda other: (round(distance[place, other], 3), other), default=-1)
        if end is not None:
            one = _from(one, end)
        elif ahead >= 0:
            one = _turned(_from(one, laid[ahead].region.centroid))
        row.append(one)
        end = _line(one.tracks[-1]).centroid
        place = ahead
    return row


def _middle(laid: list[_Laid]) -> shapely.Point:
    return shapely.union_all([one.region.centroid for one in laid]).centroid


def _line(track: Track) -> shapely.LineString:
    return shapely.LineString([track.start, track.end])


def _from(one: _Laid, near: shapely.Geometry) -> _Laid:
    """The cell with its lines counted from the side that is nearer to something."""
    first, last = (shapely.distance(_line(track), near) for track in (one.tracks[0], one.tracks[-1]))
    return _turned(one) if last < first - 1e-6 else one


def _turned(one: _Laid) -> _Laid:
    """The cell with its lines counted from the other side."""
    return replace(one, tracks=counted_back(one.tracks))
