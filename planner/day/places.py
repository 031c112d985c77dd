"""Where the fields and the yard are, and how far it is from one to another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from fields.field import Field
from fields.projection import project
from planner.day.file import YARD, DayField, DayFile, Road
from planner.errors import ScenarioError, nearest
from planner.farm.file import FarmFile
from planner.transport import FARTHEST_KM, end_of_road

M_PER_KM = 1000.0
Array = npt.NDArray[np.float64]
Degrees = tuple[float, float]


@dataclass(frozen=True)
class Spot:
    """A place with its name; `at` are its longitude and latitude in degrees, None where nobody said."""

    name: str
    at: Degrees | None


def spots(day: DayFile, fields: Sequence[Field]) -> tuple[Spot, ...]:
    """The fields in their order; the yard as the last where anybody said where it is or how far.

    Raises ScenarioError for two fields of one name.
    """
    found = [Spot(one.name, _position(said, one)) for said, one in zip(day.fields, fields, strict=True)]
    names = [spot.name for spot in found]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise ScenarioError(f"Two fields of the day are called {twice!r}; give each a name of its own.")
    return tuple(found)


def yard_of(day: DayFile, farm: FarmFile) -> Spot | None:
    """The yard; None where neither file places it and no road leads to it."""
    yard = day.yard or farm.yard
    if yard.lon is not None and yard.lat is not None:
        return Spot(YARD, (yard.lon, yard.lat))
    return Spot(YARD, None) if any(YARD in road.between for road in day.roads) else None


def road_km(day: DayFile, places: Sequence[Spot], road_factor: float) -> Array:
    """Kilometres of road between all places, (n, n): as given, else straight lines times a factor.

    Raises ScenarioError for a road to nowhere, two lengths of one road, a pair with neither road nor places, and a
    yard farther from a field than anybody would drive.
    """
    given = _given(day.roads, [place.name for place in places])
    km = np.zeros((len(places), len(places)))
    for a, one in enumerate(places):
        for b, other in enumerate(places[:a]):
            length = given.get(frozenset((one.name, other.name)))
            km[a, b] = km[b, a] = _straight_km(one, other) * road_factor if length is None else length
    return km


def on_map(places: Sequence[Spot]) -> list[tuple[float, float] | None]:
    """Metres east and north of the middle of all places; None for a place that nobody said."""
    known = [place.at for place in places if place.at is not None]
    if not known:
        return [None] * len(places)
    lon, lat = np.asarray(known).mean(axis=0).tolist()
    metres = iter(project(np.asarray(known), "EPSG:4326", f"+proj=aeqd +lat_0={lat!r} +lon_0={lon!r}").tolist())
    return [None if place.at is None else (lambda xy: (xy[0], xy[1]))(next(metres)) for place in places]


def _position(said: DayField, field: Field) -> Degrees | None:
    if said.lon is not None and said.lat is not None:
        return said.lon, said.lat
    if field.crs is None:
        return None
    lon, lat = field.to_wgs84([end_of_road(field)])[0].tolist()
    return lon, lat


def _given(roads: Sequence[Road], names: Sequence[str]) -> dict[frozenset[str], float]:
    lengths: dict[frozenset[str], float] = {}
    for road in roads:
        for name in road.between:
            if name not in names:
                known = [*names, YARD] if YARD not in names else names
                raise ScenarioError(
                    f"A road of the day leads to {name!r}, which is no field of it{nearest(name, known)}; use one of: "
                    f"{', '.join(known)}."
                )
        pair = frozenset(road.between)
        one, other = road.between
        if one == other:
            raise ScenarioError(f"A road of the day leads from {one!r} to {one!r}; name two places.")
        if lengths.setdefault(pair, road.km) != road.km:
            raise ScenarioError(
                f"The road between {one!r} and {other!r} is {lengths[pair]:g} km and {road.km:g} km; keep one of them."
            )
    return lengths


def _straight_km(one: Spot, other: Spot) -> float:
    from pyproj import Geod

    for place in (one, other):
        if place.at is None:
            where = "lon and lat of the yard" if place.name == YARD else f"lon and lat of {place.name!r}"
            raise ScenarioError(
                f"The road between {other.name!r} and {one.name!r} is missing; give it under [[roads]], or {where}."
            )
    (lon, lat), (to_lon, to_lat) = one.at or (0.0, 0.0), other.at or (0.0, 0.0)
    km = float(Geod(ellps="WGS84").inv(lon, lat, to_lon, to_lat)[2]) / M_PER_KM
    if km > FARTHEST_KM and YARD in (one.name, other.name):
        field = other.name if one.name == YARD else one.name
        raise ScenarioError(
            f"The yard of the day is {km:.0f} km from field {field!r} by the straight line; use {FARTHEST_KM:g} km or "
            "less, or give the road between them under [[roads]]."
        )
    return km
