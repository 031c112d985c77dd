"""The entrance of a field: set in degrees or metres, checked against outline and obstacles, moved to the outline."""

from __future__ import annotations

from dataclasses import replace

import shapely

from fields.errors import FieldError, mark_parameter
from fields.geometry.field import Field
from fields.geometry.tolerances import NEAR_FIELD_M

MIN_INSIDE_LIMIT_M = 5.0  # tolerance for entrances drawn by hand


def set_entrance(field: Field, place: tuple[float, float]) -> Field:
    """The field with its entrance at (longitude, latitude), or at (x, y) for a field in local metres.

    Raises:
        FieldError: the place is not a valid longitude and latitude.
    """
    entrance = field.locate_place(place)
    if entrance is None:
        lon, lat = place
        raise FieldError(
            f"The entrance ({mark_parameter('entrance')}) is {lon:g},{lat:g}; give degrees of longitude, then of "
            "latitude."
        )
    return replace(field, entrance=entrance)


def check_entrance(field: Field, headland_m: float) -> None:
    """Refuse an entrance that no tractor could use.

    Raises:
        FieldError: the entrance is far outside, in an obstacle, or farther inside than the headland.
    """
    if field.entrance is None:
        return
    place, outline = shapely.Point(field.entrance), shapely.Polygon(field.boundary.exterior)
    distance_m, is_inside = float(outline.exterior.distance(place)), bool(outline.covers(place))
    subject = f"The entrance ({mark_parameter('entrance')}) of field '{field.name}' lies"
    if not is_inside and distance_m > NEAR_FIELD_M:
        raise FieldError(f"{subject} {distance_m:.0f} m outside; it must be within {NEAR_FIELD_M:g} m of the boundary.")
    holes = [(shapely.Polygon(hole), "a hole of the field") for hole in field.boundary.interiors]
    for shape, description in [*holes, *((one.shape, str(one)) for one in field.obstacles)]:
        if shape.contains(place):
            raise FieldError(
                f"{subject} in an obstacle ({description[0].lower()}{description[1:]}); put it on the boundary."
            )
    if is_inside and distance_m > max(headland_m, MIN_INSIDE_LIMIT_M):
        raise FieldError(
            f"{subject} {distance_m:.0f} m inside, beyond the headland of {headland_m:g} m; put it on the boundary."
        )


def move_entrance_to_outline(field: Field) -> Field:
    """The field with its entrance moved to the nearest point of the outline; unchanged without an entrance."""
    if field.entrance is None:
        return field
    outline = field.boundary.exterior
    edge = outline.interpolate(outline.project(shapely.Point(field.entrance)))
    return replace(field, entrance=(float(edge.x), float(edge.y)))
