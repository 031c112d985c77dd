"""Write a field as GeoJSON."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from fields.arrays import Floats
from fields.errors import FieldError
from fields.formats.features import build_feature
from fields.formats.geojson import format_features
from fields.geometry.field import Field
from fields.geometry.field_lines import FENCE, OPEN_EDGE, OVERHANG
from fields.geometry.obstacles import AREA, LINE, POINT, Obstacle
from fields.raw_document import LOCAL_METRES, WGS84

HEIGHT_COMPANIONS = (".prj", ".tfw", ".shx", ".dbf", ".cpg")
"""Endings of files that belong to heights of the same name."""


def write_field(field: Field, path: str | Path) -> None:
    """Write a field so that ``read_field`` restores it; the file of its heights is copied beside it.

    A georeferenced field is written in longitude and latitude (RFC 7946), any other in local metres. The member
    ``headland`` stores the frame, the UTM system and the origin.

    Raises FieldError where the file cannot be written, or other heights of the same name are in its folder.
    """
    try:
        _copy_heights(field, Path(path).parent)
        Path(path).write_bytes(build_field_geojson(field))
    except OSError as error:
        raise FieldError(f"'{path}' cannot be written ({error.strerror}); choose another file.") from error


def _copy_heights(field: Field, folder: Path) -> None:
    """Copy the heights that a field names, with the files beside them that say their place, into a folder."""
    if field.elevation is None:
        return
    source = Path(field.elevation)
    companions = [source.with_suffix(suffix) for suffix in HEIGHT_COMPANIONS]
    for file in (source, *companions, source.with_name(f"{source.name}.aux.xml")):
        target = folder / file.name
        if not file.is_file() or (target.exists() and target.samefile(file)):
            continue
        if target.exists() and target.read_bytes() != file.read_bytes():
            raise FieldError(
                f"'{target}' exists and holds other heights than those of field '{field.name}'; choose another folder, "
                "or remove it."
            )
        shutil.copyfile(file, target)


def build_field_geojson(field: Field) -> bytes:
    """GeoJSON text of a field, one feature per line."""
    properties = {"name": field.name, "source": field.source, "default_ground": field.default_ground}
    properties |= {} if field.elevation is None else {"elevation": Path(field.elevation).name}
    features = [build_feature("Polygon", _build_rings(field, field.workable_region), properties)]
    for zone in field.ground_zones:
        features.append(build_feature("Polygon", _build_rings(field, zone.polygon), {"ground": zone.name}))
    for obstacle in field.obstacles:
        features.append(_build_obstacle_feature(field, obstacle))
    lines: list[tuple[shapely.Geometry, dict[str, Any]]] = []
    for one in field.edge_overhangs:  # before fences, which hold wherever both are
        merged = one.part if one.part.geom_type == "LineString" else shapely.line_merge(one.part)
        edge = {"edge": OPEN_EDGE, OVERHANG: one.overhang_m}
        lines += [(part, edge) for part in shapely.get_parts(merged)]
    lines += [(fence, {"edge": FENCE}) for fence in field.fences]
    lines += [(line.line, {"role": "guidance", "name": line.name}) for line in field.guidance_lines]
    lines += [(headland.line, {"role": "headland"}) for headland in field.headland_edges]
    for line, line_properties in lines:
        points = _convert_to_file_system(field, shapely.get_coordinates(line))
        features.append(build_feature(LINE, points, line_properties))
    for role, place in (("entrance", field.entrance), ("refill", field.service_point)):
        if place is not None:
            point = _convert_to_file_system(field, np.array([place]))[0]
            features.append(build_feature("Point", point, {"role": role}))
    header: dict[str, Any] = {"frame": LOCAL_METRES, "origin_m": list(field.origin_m)}
    if field.crs is not None:
        header |= {"frame": WGS84, "crs": field.crs}
    return format_features(features, header)


def _build_obstacle_feature(field: Field, obstacle: Obstacle) -> dict[str, Any]:
    properties: dict[str, Any] = {"role": "obstacle", "kind": obstacle.kind, "name": obstacle.name}
    geometry = obstacle.geometry
    if isinstance(geometry, shapely.Polygon):
        return build_feature(AREA, _build_rings(field, geometry), properties)
    points = _convert_to_file_system(field, shapely.get_coordinates(geometry))
    if geometry.geom_type == POINT:
        return build_feature(POINT, points[0], properties | {"radius_m": obstacle.half_width_m})
    return build_feature(LINE, points, properties | {"width_m": 2.0 * obstacle.half_width_m})


def _build_rings(field: Field, polygon: shapely.Polygon) -> list[Any]:
    return [
        _convert_to_file_system(field, np.asarray(loop.coords)[:, :2])
        for loop in (polygon.exterior, *polygon.interiors)
    ]


def _convert_to_file_system(field: Field, xy: Floats) -> list[list[float]]:
    """Local metres in the system of the file; every ring ends exactly where it starts."""
    points = xy + np.asarray(field.origin_m) if field.crs is None else field.to_wgs84(xy)
    return [[float(x), float(y)] for x, y in points]
