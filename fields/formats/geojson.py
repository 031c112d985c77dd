"""GeoJSON (RFC 7946): fields are read, guidance is written with the roles by which Headland reads fields."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from fields.errors import FieldError, join_first, shorten_value
from fields.formats.features import (
    GEOMETRY_TYPES,
    Feature,
    build_document,
    build_feature,
    convert_to_name_text,
    get_member_object,
)
from fields.formats.guidance import (
    DEGREE_DECIMALS,
    DegreePoints,
    FileContents,
    GuidanceArea,
    GuidanceFormat,
    PlanGuidance,
)
from fields.nested_text import parse_json
from fields.raw_document import LOCAL_METRES, WGS84, FieldDocument, FieldFormat
from fields.text_files import read_text

HEADER_KEY = "headland"
"""Member (RFC 7946, section 6.1) with the frame of the file; written by ``write_field``."""


def parse_geojson(content: str, label: str) -> FieldDocument:
    """Parse a GeoJSON text, whose file is called `label` in messages.

    Raises FieldError where it is not JSON, not GeoJSON, or has no polygon.
    """
    try:
        root = parse_json(content)
    except ValueError as error:
        raise FieldError(f"{label} is not JSON ({error}); give a GeoJSON file.") from error
    if not isinstance(root, dict) or not isinstance(root.get("type"), str):
        members = join_first([shorten_value(name) for name in root]) if isinstance(root, dict) and root else "nothing"
        raise FieldError(
            f"{label} is JSON without a 'type' (it has {members}), so not GeoJSON; give a FeatureCollection or Polygon."
        )
    features = _collect_features(root, label)
    header = get_member_object(root, HEADER_KEY)
    frame = header.get("frame")
    if frame not in (None, LOCAL_METRES, WGS84):
        raise FieldError(f"The frame {frame!r} of {label} is unknown; use '{LOCAL_METRES}' or '{WGS84}'.")
    return build_document(
        features,
        label,
        crs=_parse_crs(root, label),
        frame=frame,
        header=header,
        source=convert_to_name_text(root.get("source")),
    )


def _collect_features(root: dict[str, Any], label: str) -> list[Feature]:
    """All features; a bare geometry becomes a feature."""
    root_type = root["type"]
    if root_type in GEOMETRY_TYPES:
        return [{"type": "Feature", "properties": {}, "geometry": root}]
    if root_type == "Feature":
        return [root]
    if root_type != "FeatureCollection":
        raise FieldError(f"{label} has the type '{root_type}'; give a FeatureCollection, a Feature or a Polygon.")
    features = root.get("features")
    if not isinstance(features, list) or not all(isinstance(feature, dict) for feature in features):
        raise FieldError(f"{label} has no list of features; put every feature into 'features' as an object.")
    if not features:
        raise FieldError(f"{label} is an empty collection; it needs a feature with the boundary as a Polygon.")
    return features


def _parse_crs(root: dict[str, Any], label: str) -> str | None:
    """Name in the ``crs`` member of the GeoJSON format of 2008, section 3."""
    system = root.get("crs")
    if system is None:
        return None
    name = get_member_object(system, "properties").get("name") if isinstance(system, dict) else None
    if not isinstance(name, str) or not name:
        raise FieldError(f"The 'crs' of {label} names no coordinate system; remove it or name an EPSG code.")
    return name


def _read_geojson(path: str, label: str) -> FieldDocument:
    return parse_geojson(read_text(path, "a GeoJSON file", FieldError), label)


def _parse_bytes(content: bytes, label: str) -> FieldDocument:
    try:
        return parse_geojson(content.decode("utf-8-sig"), label)
    except UnicodeDecodeError:
        raise FieldError(f"{label} is not a text file in UTF-8; give a GeoJSON file.") from None


FIELD_FORMAT = FieldFormat("GeoJSON", (".geojson", ".json"), _read_geojson, parse=_parse_bytes)


def format_features(features: Iterable[Feature], header: dict[str, Any] | None = None) -> bytes:
    """A collection of features, one per line, with a header of Headland's, if any."""
    start = '{"type": "FeatureCollection", '
    start += "" if header is None else f'"{HEADER_KEY}": {json.dumps(header, allow_nan=False)}, '
    body = ",\n".join(json.dumps(feature, ensure_ascii=False, allow_nan=False) for feature in features)
    return f'{start}"features": [\n{body}\n]}}\n'.encode("utf-8", "replace")  # names may hold half an emoji


def _write_geojson(guidance: PlanGuidance) -> FileContents:
    return {"guidance.geojson": format_features(_build_features(guidance))}


def _build_features(guidance: PlanGuidance) -> Iterator[Feature]:
    if guidance.boundary is not None:
        names = {"role": "boundary", "name": guidance.field}
        yield build_feature("Polygon", _build_rings(guidance.boundary), names)
    for area in guidance.obstacles:
        yield build_feature("Polygon", _build_rings(area), {"role": "obstacle", "name": area.name})
    if guidance.entrance is not None:
        yield build_feature("Point", _round_positions(np.array([guidance.entrance]))[0], {"role": "entrance"})
    for area in guidance.headland_interior:
        for ring in _build_rings(area):
            yield build_feature("LineString", ring, {"role": "headland"})
    for line in guidance.lines:
        properties = {
            "role": "guidance", "name": line.name, "tractor": line.tractor, "order": line.order, "kind": line.kind,
            "what": line.description, "straight": line.is_straight, "bearing_deg": round(line.bearing_deg, 6),
            "length_m": round(line.length_m, 3),
        }  # fmt: skip
        yield build_feature("LineString", _round_positions(line.points), properties)


def _build_rings(area: GuidanceArea) -> list[Any]:
    return [_round_positions(ring) for ring in area.closed_rings]


def _round_positions(points: DegreePoints) -> list[list[float]]:
    return [[round(float(x), DEGREE_DECIMALS), round(float(y), DEGREE_DECIMALS)] for x, y in points]


GUIDANCE_FORMAT = GuidanceFormat(
    "geojson", "GeoJSON", _write_geojson, extension=".geojson", media_type="application/geo+json"
)
