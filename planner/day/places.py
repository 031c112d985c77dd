"""Places of a day: fields and yard, the roads between them, and sunrise and sunset."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date

import numpy as np

from fields.arrays import Floats
from fields.geometry.field import Field
from fields.geometry.geodesy import DEGREES_CRS, measure_distance_m, project
from fields.units import DAY_S, KILO, MINUTE_S
from planner.day.input_file import DayFile, DayRoad
from planner.errors import RequestError, suggest_name
from planner.farm.inventory import FarmFile
from planner.farm.workday import MAX_ROAD_KM, locate_road_end
from reports.day.results import MapPlace

YARD = "yard"
ZENITH_DEG = 90.833  # of the sun's centre at rise and set: half its width and refraction
LonLat = tuple[float, float]


def compute_sun_hours(day: date, lon: float, lat: float, utc_offset_h: float) -> tuple[int, int] | None:
    """Sunrise and sunset as seconds of the day in local time, to the minute; None if the sun does not set.

    They are those of the upper edge with refraction, good to a minute or two between latitudes of 65 degrees.
    Declination and equation of time are by the Fourier series of Spencer (1971). If the sun does not rise, both are at
    noon.
    """
    year_angle = 2.0 * math.pi * (day.timetuple().tm_yday - 1 + 0.5) / 365.0
    angle, double_angle, triple_angle = (number * year_angle for number in (1, 2, 3))
    declination = (
        0.006918 - 0.399912 * math.cos(angle) + 0.070257 * math.sin(angle) - 0.006758 * math.cos(double_angle)
        + 0.000907 * math.sin(double_angle) - 0.002697 * math.cos(triple_angle) + 0.00148 * math.sin(triple_angle)
    )  # fmt: skip
    equation_min = 229.18 * (
        0.000075 + 0.001868 * math.cos(angle) - 0.032077 * math.sin(angle) - 0.014615 * math.cos(double_angle)
        - 0.040849 * math.sin(double_angle)
    )  # fmt: skip
    latitude = math.radians(lat)
    height = math.cos(math.radians(ZENITH_DEG)) - math.sin(latitude) * math.sin(declination)
    reach = height / max(math.cos(latitude) * math.cos(declination), 1e-9)
    if reach <= -1.0:
        return None
    half_min = 4.0 * math.degrees(math.acos(min(reach, 1.0)))
    noon_min = 0.5 * DAY_S / MINUTE_S - 4.0 * lon - equation_min + MINUTE_S * utc_offset_h
    rise_s, set_s = (60 * round(noon_min + sign * half_min) % DAY_S for sign in (-1.0, 1.0))
    return rise_s, set_s


@dataclass(frozen=True)
class DayPlace:
    """A place with its name and its longitude and latitude in degrees, None if unknown."""

    name: str
    lon_lat: LonLat | None


def locate_fields(day: DayFile, fields: Sequence[Field]) -> tuple[DayPlace, ...]:
    """The places of the fields, in order; raises RequestError for two fields of one name, and for that of the yard."""
    places = []
    for day_field, field in zip(day.fields, fields, strict=True):
        lon_lat = None
        if day_field.lon is not None and day_field.lat is not None:
            lon_lat = day_field.lon, day_field.lat
        elif field.crs is not None:
            lon, lat = field.to_wgs84([locate_road_end(field)])[0].tolist()
            lon_lat = lon, lat
        places.append(DayPlace(field.name, lon_lat))
    names = [place.name for place in places]
    if YARD in names:
        raise RequestError(
            f"A field of the day is called {YARD!r}, which is the name of the yard; give it another with name = '...'."
        )
    duplicate = next((name for name in names if names.count(name) > 1), None)
    if duplicate is not None:
        raise RequestError(f"Two fields of the day are called {duplicate!r}; give each a unique name.")
    return tuple(places)


def locate_yard(day: DayFile, farm: FarmFile) -> DayPlace | None:
    """The yard; None if neither file gives its place and no road leads to it."""
    yard = day.yard or farm.yard
    if yard.lon is not None and yard.lat is not None:
        return DayPlace(YARD, (yard.lon, yard.lat))
    return DayPlace(YARD, None) if any(YARD in road.between for road in day.roads) else None


def compute_road_km(day: DayFile, places: Sequence[DayPlace], road_factor: float) -> Floats:
    """Kilometres of road between all places, (n, n): as given, else straight lines times a factor.

    Raises RequestError for a road to an unknown place, two lengths of one road, a pair with neither road nor places,
    and a yard farther than MAX_ROAD_KM from a field.
    """
    lengths_km = _collect_road_lengths(day.roads, [place.name for place in places])
    km = np.zeros((len(places), len(places)))
    for a, start in enumerate(places):
        for b, end in enumerate(places[:a]):
            length_km = lengths_km.get(frozenset((start.name, end.name)))
            km[a, b] = km[b, a] = _measure_straight_km(start, end) * road_factor if length_km is None else length_km
    return km


def project_places(places: Sequence[DayPlace]) -> list[tuple[float, float] | None]:
    """Metres east and north of the middle of all places; None for an unknown place."""
    known_lon_lat = [place.lon_lat for place in places if place.lon_lat is not None]
    if not known_lon_lat:
        return [None] * len(places)
    lon, lat = np.asarray(known_lon_lat).mean(axis=0).tolist()
    metres = iter(project(np.asarray(known_lon_lat), DEGREES_CRS, f"+proj=aeqd +lat_0={lat!r} +lon_0={lon!r}").tolist())
    return [None if place.lon_lat is None else (lambda xy: (xy[0], xy[1]))(next(metres)) for place in places]


def build_map_places(places: Sequence[DayPlace], fields: Sequence[Field]) -> tuple[MapPlace, ...]:
    """Places with known coordinates, fields with their outline."""
    map_places = []
    for number, (place, position_m) in enumerate(zip(places, project_places(places), strict=True)):
        if position_m is None:
            continue
        outline = None
        if place.name != YARD:
            ground = fields[number].boundary
            middle = np.asarray(locate_road_end(fields[number]))
            outline = np.asarray(ground.exterior.coords)[:, :2] - middle + np.asarray(position_m)
        map_places.append(MapPlace(place.name, position_m[0], position_m[1], outline))
    return tuple(map_places)


def _collect_road_lengths(roads: Sequence[DayRoad], names: Sequence[str]) -> dict[frozenset[str], float]:
    lengths: dict[frozenset[str], float] = {}
    for road in roads:
        for name in road.between:
            if name not in names:
                known_names = [*names, YARD] if YARD not in names else names
                raise RequestError(
                    f"A road of the day leads to {name!r}, which is not one of its fields"
                    f"{suggest_name(name, known_names)}; use one of: {', '.join(known_names)}."
                )
        pair = frozenset(road.between)
        start, end = road.between
        if start == end:
            raise RequestError(f"A road of the day leads from {start!r} to {start!r}; name two places.")
        if lengths.setdefault(pair, road.km) != road.km:
            raise RequestError(
                f"The road between {start!r} and {end!r} is given twice, as {lengths[pair]:g} km and {road.km:g} km; "
                "keep one of them."
            )
    return lengths


def _measure_straight_km(start: DayPlace, end: DayPlace) -> float:
    for place in (start, end):
        if place.lon_lat is None:
            wanted = "lon and lat of the yard" if place.name == YARD else f"lon and lat of {place.name!r}"
            raise RequestError(
                f"The road between {end.name!r} and {start.name!r} is missing; give it under [[roads]], or {wanted}."
            )
    km = measure_distance_m(start.lon_lat or (0.0, 0.0), end.lon_lat or (0.0, 0.0)) / KILO
    if km > MAX_ROAD_KM and YARD in (start.name, end.name):
        field = end.name if start.name == YARD else start.name
        raise RequestError(
            f"The yard of the day is {km:.0f} km from field {field!r} in a straight line; at most {MAX_ROAD_KM:g} km "
            "are allowed, so correct its place, or give the road under [[roads]]."
        )
    return km
