"""Write a field as GeoJSON."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import shapely

from fields.document import LOCAL, WGS84
from fields.errors import FieldError
from fields.fences import FENCE
from fields.field import Field
from fields.formats.geojson import HEADER
from fields.obstacles import AREA, LINE, POINT, Obstacle


def write_field(field: Field, path: str | Path) -> None:
    """Write a field so that ``read_field`` gives it back.

    A field with a place on the earth is written in longitude and latitude (RFC 7946), any other in local
    metres. The foreign member ``headland`` keeps the frame, the UTM system and the origin.

    Raises:
        FieldError: the file cannot be written.
    """
    try:
        Path(path).write_text(field_geojson(field), encoding="utf-8")
    except OSError as error:
        raise FieldError(f"'{path}' cannot be written ({error.strerror}); choose another place.") from error


def field_geojson(field: Field) -> str:
    """GeoJSON text of a field, one feature to a line."""
    properties = {"name": field.name, "source": field.source, "default_ground": field.default_ground}
    features = [_feature("Polygon", _rings(field, field.ground), properties)]
    for zone in field.grounds:
        features.append(_feature("Polygon", _rings(field, zone.polygon), {"ground": zone.name}))
    for obstacle in field.obstacles:
        features.append(_obstacle_feature(field, obstacle))
    for fence in field.fences:
        features.append(_feature(LINE, _given(field, shapely.get_coordinates(fence)), {"edge": FENCE}))
    for line in field.lines:
        points = _given(field, shapely.get_coordinates(line.line))
        features.append(_feature(LINE, points, {"role": "guidance", "name": line.name}))
    for edge in field.headlands:
        features.append(_feature(LINE, _given(field, shapely.get_coordinates(edge.line)), {"role": "headland"}))
    for role, place in (("entrance", field.entrance), ("refill", field.refill)):
        if place is not None:
            features.append(_feature("Point", _given(field, np.array([place]))[0], {"role": role}))
    header: dict[str, Any] = {"frame": LOCAL, "origin_m": list(field.origin_m)}
    if field.crs is not None:
        header |= {"frame": WGS84, "crs": field.crs}
    body = ",\n".join(json.dumps(feature, ensure_ascii=False, allow_nan=False) for feature in features)
    return (
        f'{{"type": "FeatureCollection", "{HEADER}": {json.dumps(header, allow_nan=False)}, "features": [\n'
        f"{body}\n]}}\n"
    )


def _obstacle_feature(field: Field, obstacle: Obstacle) -> dict[str, Any]:
    properties: dict[str, Any] = {"role": "obstacle", "kind": obstacle.kind, "name": obstacle.name}
    geometry = obstacle.geometry
    if isinstance(geometry, shapely.Polygon):
        return _feature(AREA, _rings(field, geometry), properties)
    points = _given(field, shapely.get_coordinates(geometry))
    if geometry.geom_type == POINT:
        return _feature(POINT, points[0], properties | {"radius_m": obstacle.half_m})
    return _feature(LINE, points, properties | {"width_m": 2.0 * obstacle.half_m})


def _feature(kind: str, coordinates: list[Any], properties: dict[str, Any]) -> dict[str, Any]:
    geometry = {"type": kind, "coordinates": coordinates}
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def _rings(field: Field, polygon: shapely.Polygon) -> list[Any]:
    return [_given(field, np.asarray(loop.coords)[:, :2]) for loop in (polygon.exterior, *polygon.interiors)]


def _given(field: Field, xy: npt.NDArray[np.float64]) -> list[list[float]]:
    """Local metres in the system of the file; every ring ends exactly where it starts."""
    points = xy + np.asarray(field.origin_m) if field.crs is None else field.to_wgs84(xy)
    return [[float(x), float(y)] for x, y in points]
