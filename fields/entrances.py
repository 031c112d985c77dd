"""Where tractors enter a field: a place given on the earth or in metres, checked against outline and obstacles."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import shapely

from fields.errors import FieldError, named
from fields.field import Field
from fields.projection import project

FARTHEST_OUTSIDE_M = 50.0  # a gate is drawn on the road beside a field, not beyond the next one
LEAST_INSIDE_M = 5.0  # drawn by hand no entrance lies on the outline


def with_entrance_at(field: Field, place: tuple[float, float]) -> Field:
    """The field with its entrance at a longitude and latitude, or at x and y of a field in local metres.

    Raises:
        FieldError: the place cannot be one of longitude and latitude.
    """
    if field.crs is None:
        return replace(field, entrance=place)
    lon, lat = place
    if not (-180.0 <= lon <= 180.0 and -90.0 <= lat <= 90.0):
        raise FieldError(
            f"The entrance ({named('entrance')}) is {lon:g},{lat:g}; give degrees of longitude, then of latitude."
        )
    x, y = (project(np.array([place]), "EPSG:4326", field.crs)[0] - np.asarray(field.origin_m)).tolist()
    return replace(field, entrance=(x, y))


def check_entrance(field: Field, headland_m: float) -> None:
    """Refuse an entrance that no tractor could use: far off, in an obstacle, or farther inside than the headland.

    Raises:
        FieldError: the entrance is one of these.
    """
    if field.entrance is None:
        return
    place, outline = shapely.Point(field.entrance), shapely.Polygon(field.boundary.exterior)
    away_m, within = float(outline.exterior.distance(place)), bool(outline.covers(place))
    where = f"The entrance ({named('entrance')}) of field '{field.name}' lies"
    if not within and away_m > FARTHEST_OUTSIDE_M:
        raise FieldError(
            f"{where} {away_m:.0f} m outside of it; it must be within {FARTHEST_OUTSIDE_M:g} m of the boundary."
        )
    holes = [(shapely.Polygon(hole), "a hole of the field") for hole in field.boundary.interiors]
    for shape, what in [*holes, *((one.shape, str(one)) for one in field.obstacles)]:
        if shape.contains(place):
            raise FieldError(f"{where} in an obstacle ({what[0].lower()}{what[1:]}); put it on the boundary.")
    if within and away_m > max(headland_m, LEAST_INSIDE_M):
        raise FieldError(
            f"{where} {away_m:.0f} m inside of it, farther than the headland is deep ({headland_m:g} m); put it on the "
            "boundary."
        )


def with_entrance_on_outline(field: Field) -> Field:
    """The field with its entrance on the outline, where it is nearest; as it is without one."""
    if field.entrance is None:
        return field
    outline = field.boundary.exterior
    edge = outline.interpolate(outline.project(shapely.Point(field.entrance)))
    return replace(field, entrance=(float(edge.x), float(edge.y)))
