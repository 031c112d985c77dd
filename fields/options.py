"""Layouts worth comparing inside the same rounds of a headland: several bearings, and cells with their own."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import shapely

from fields.bearings import candidate_bearings
from fields.cells import Cell
from fields.cutting import CELL_M, Part, costs_m, divided
from fields.filling import filled
from fields.layout import Layout, Track, counted_back, from_longer_side, half_turn, lay_tracks, tracks_of
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
    others = [lay_tracks(field, width_m, 0.0, _compass(angle), rounds=rounds) for angle in chosen[1:]]
    options = [plain, *others]
    parts = divided(plain.inner, angles, width_m)
    if len({part.bearing_rad for part in parts}) > 1:
        options.append(lay_cells(plain, parts))
    return sorted(options, key=lambda option: round(effort_m(option), 3))


def _compass(bearing_rad: float) -> float:
    return 90.0 - math.degrees(bearing_rad)


@dataclass(frozen=True, eq=False)
class _Laid:
    """A part with its tracks, lines counted from 0."""

    part: Part
    tracks: tuple[Track, ...]


def lay_cells(plain: Layout, parts: Sequence[Part]) -> Layout:
    """A layout in which every part of the inner region of another is a cell, tracks of which cover it whole.

    Cells are numbered so that each is near the one before, and so are its lines.
    """
    rules = CombRules(plain.width_m, 0.0, SHORTEST_M, 0.5 * plain.width_m, plain.inner.area)
    laid = [
        _Laid(part, from_longer_side(tracks_of(teeth, axes(part.bearing_rad))))
        for part in parts
        if (teeth := filled(part.region, part.bearing_rad, rules)) is not None
    ]
    cells: list[Cell] = []
    tracks: list[Track] = []
    for number, one in enumerate(_in_a_row(laid), start=1):
        cells.append(Cell(number, one.part.bearing_rad, one.part.region))
        first = tracks[-1].line + 1 if tracks else 0
        tracks += [replace(track, line=first + track.line, cell=number) for track in one.tracks]
    largest = max(cells, key=lambda cell: round(cell.area_m2, 3))
    return replace(plain, bearing_rad=largest.bearing_rad, tracks=tuple(tracks), cells=tuple(cells))


def _in_a_row(laid: list[_Laid]) -> list[_Laid]:
    """Cells one near the other, an outer one first, the lines of each from where the one before ends."""
    distance = np.array([[shapely.distance(a.part.region, b.part.region) for b in laid] for a in laid])
    beyond = distance.sum(axis=1) + np.array([shapely.distance(a.part.region.centroid, _middle(laid)) for a in laid])
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
            one = _turned(_from(one, laid[ahead].part.region.centroid))
        row.append(one)
        end = _line(one.tracks[-1]).centroid
        place = ahead
    return row


def _middle(laid: list[_Laid]) -> shapely.Point:
    return shapely.union_all([one.part.region.centroid for one in laid]).centroid


def _line(track: Track) -> shapely.LineString:
    return shapely.LineString([track.start, track.end])


def _from(one: _Laid, near: shapely.Geometry) -> _Laid:
    """The cell with its lines counted from the side that is nearer to something."""
    first, last = (shapely.distance(_line(track), near) for track in (one.tracks[0], one.tracks[-1]))
    return _turned(one) if last < first - 1e-6 else one


def _turned(one: _Laid) -> _Laid:
    """The cell with its lines counted from the other side."""
    return replace(one, tracks=counted_back(one.tracks))
