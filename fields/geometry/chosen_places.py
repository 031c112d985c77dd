"""What the user says of places in a field: obstacles to add or to leave out, and the entrance, which is checked against
outline and obstacles and moved to the outline."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import shapely

from fields.errors import MAX_LISTED, FieldError, join_first, mark_parameter, shorten_value, suggest_name
from fields.geometry.arithmetic import NEAR_FIELD_M
from fields.geometry.assumed_obstacles import DEFAULT_SIZE_M, MAX_ENTRANCE_INSIDE_M, describe_assumed_obstacles
from fields.geometry.field import Field
from fields.geometry.obstacles import MAX_OBSTACLE_M, Obstacle


def parse_obstacle_place(text: str) -> tuple[float, float, float]:
    """ "9.53,56.21" or "9.53,56.21,2.5" as x, y and radius in metres; raises FieldError that names `obstacles`."""
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in (2, 3) or not all(map(math.isfinite, numbers)):
        raise FieldError(
            f"{mark_parameter('obstacles')} {shorten_value(text)} is not a place; write longitude,latitude or "
            "longitude,latitude,radius in metres, for instance 9.53,56.21,2."
        )
    radius_m = numbers[2] if len(numbers) == 3 else DEFAULT_SIZE_M
    if not 0.0 < radius_m <= MAX_OBSTACLE_M:
        raise FieldError(
            f"{mark_parameter('obstacles')} {shorten_value(text)} has a radius of {radius_m:g} m; use more than 0 and "
            f"at most {MAX_OBSTACLE_M:g} m."
        )
    return numbers[0], numbers[1], radius_m


def add_obstacles(field: Field, texts: Sequence[str]) -> Field:
    """The field with round obstacles at these places: longitude, latitude and perhaps radius (x, y in local metres).

    Raises FieldError where a text is not a place, or the place is outside the field.
    """
    added = []
    for text in texts:
        x, y, radius_m = parse_obstacle_place(text)
        located = field.locate_place((x, y))
        if located is None:
            raise FieldError(
                f"{mark_parameter('obstacles')} {shorten_value(text)} is not on the earth; give degrees of longitude, "
                "then of latitude."
            )
        place = shapely.Point(located)
        away_m = float(shapely.Polygon(field.boundary.exterior).distance(place))
        if away_m > radius_m:
            order = "" if field.crs is None else " (longitude first)"
            raise FieldError(
                f"The obstacle {text.strip()} ({mark_parameter('obstacles')}) lies {away_m:.0f} m outside field "
                f"'{field.name}'; give a place in the field{order}."
            )
        added.append(Obstacle("point", place, radius_m, f"at {text.strip()}"))
    return replace(field, obstacles=(*field.obstacles, *added)) if added else field


def leave_out_obstacles(field: Field, names: Sequence[str]) -> Field:
    """The field without the obstacles of these names, or of these numbers counted from 1 in their order.

    Raises FieldError where no obstacle has the name or number.
    """
    left_out = {number for text in names for number in _find_obstacle_numbers(field, text)}
    if not left_out:
        return field
    kept = tuple(one for number, one in enumerate(field.obstacles) if number not in left_out)
    gone = [str(field.obstacles[number]) for number in sorted(left_out)]
    remark = f"Left out as asked, so machines drive there: {', '.join(gone)}."
    assumed = describe_assumed_obstacles(field.obstacles)
    others = [one for one in field.remarks if one not in assumed]
    return replace(field, obstacles=kept, remarks=(*describe_assumed_obstacles(kept), remark, *others))


def _find_obstacle_numbers(field: Field, text: str) -> list[int]:
    """Places of the obstacles that a text names: all of that name in any case, else the one of that number."""
    wanted = text.strip().casefold()
    names = [place for place, one in enumerate(field.obstacles) if wanted and one.name.casefold() == wanted]
    numbers = [place for place, one in enumerate(field.obstacles) if wanted == str(one.number or place + 1)]
    if names or numbers:
        return names or numbers
    subject = f"{mark_parameter('ignored')} {shorten_value(text.strip())} names no obstacle of field '{field.name}'"
    if not field.obstacles:
        raise FieldError(f"{subject}, which has none; leave it out.")
    close = suggest_name(text.strip(), [one.name for one in field.obstacles if one.name])
    shown = [f"{one.number or place} {one.name or one.kind}" for place, one in enumerate(field.obstacles, 1)]
    raise FieldError(f"{subject}{close}; give a name or number out of: {join_first(shown, MAX_LISTED)}.")


def set_entrance(field: Field, place: tuple[float, float]) -> Field:
    """The field with its entrance at (longitude, latitude), or at (x, y) for a field in local metres.

    Raises FieldError where the place is not a valid longitude and latitude.
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

    Raises FieldError where the entrance is far outside, in an obstacle, or farther inside than the headland.
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
    if is_inside and distance_m > max(headland_m, MAX_ENTRANCE_INSIDE_M):
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
