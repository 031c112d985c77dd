"""The road from the yard of a farm to a field: how far it is, and how long a tractor takes for it."""

from __future__ import annotations

from dataclasses import dataclass

from fields.field import Field
from planner.errors import ScenarioError
from planner.farm.times import Times, Yard
from planner.scenario import KMH

FARTHEST_KM = 200.0  # by the straight line: a slip of the degrees is farther


@dataclass(frozen=True)
class Road:
    """One way between yard and field: metres on the road, and seconds."""

    length_m: float
    seconds: float


def road_to(field: Field, yard: Yard, times: Times) -> Road | None:
    """The road to the entrance of a field, or to its middle where it has none: a straight line times a factor.

    None where the farm has no yard, or the field no place on the earth. Raises ScenarioError for a yard farther away
    than anybody would drive.
    """
    if yard.lon is None or yard.lat is None or field.crs is None:
        return None
    from pyproj import Geod

    ((lon, lat),) = field.to_wgs84([end_of_road(field)]).tolist()
    line_m = float(Geod(ellps="WGS84").inv(yard.lon, yard.lat, lon, lat)[2])
    if line_m > 1000.0 * FARTHEST_KM:
        raise ScenarioError(
            f"The yard of the farm is {line_m / 1000.0:.0f} km from field {field.name!r} by the straight line; use "
            f"{FARTHEST_KM:g} km or less, or leave out its [yard].",
            parameter="farm",
        )
    length_m = line_m * times.road_factor
    return Road(length_m, length_m / (times.road_speed_kmh * KMH))


def end_of_road(field: Field) -> tuple[float, float]:
    """Where the road to a field ends, in its own metres: at the entrance, or in the middle where it has none."""
    middle = field.boundary.centroid
    return field.entrance or (middle.x, middle.y)
