"""GeoJSON (RFC 7946): taken apart into a document, before any of its numbers are believed."""

from __future__ import annotations

import json
from collections import Counter
from typing import Any

from fields.document import LOCAL, WGS84, Document, Format, RawObstacle, RawPolygon
from fields.errors import FieldError
from fields.reading import parse_fault, read_text

HEADER = "headland"
"""Foreign member (RFC 7946, section 6.1) with the frame of the file; written by ``write_field``."""
BOUNDARY, ZONE, ENTRANCE, OBSTACLE, EDGE = "boundary", "ground zone", "entrance", "obstacle", "edge"
REFILL = "refill"
NO_BOUNDARY = (OBSTACLE, ENTRANCE, REFILL)
"""Roles of polygons that are certainly no field."""
LINES = ("LineString", "MultiLineString")
KINDS_SHOWN, ROLE_SHOWN = 6, 30
GEOMETRIES = (
    "Point", "MultiPoint", "LineString", "MultiLineString", "Polygon", "MultiPolygon", "GeometryCollection",
)  # fmt: skip


def parse(text: str, label: str) -> Document:
    """Take a GeoJSON text apart.

    Args:
        text: the file's contents.
        label: how messages name the file.

    Raises:
        FieldError: it is not JSON, not GeoJSON, or holds no polygon.
    """
    try:
        root = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise FieldError(f"{label} is not JSON ({parse_fault(error)}); give a GeoJSON file.") from error
    if not isinstance(root, dict) or not isinstance(root.get("type"), str):
        raise FieldError(
            f"{label} is JSON without a 'type', so not GeoJSON; give a FeatureCollection or Polygon."
        )
    features = _features(root, label)
    header = root.get(HEADER)
    header = header if isinstance(header, dict) else {}
    polygons, zones = _polygons(features, label)
    if not polygons:
        raise FieldError(_nothing(features, zones, label))
    return Document(
        polygons=polygons,
        zones=zones,
        entrances=_points(features, ENTRANCE),
        refills=_points(features, REFILL),
        crs=_crs(root, label),
        frame=_frame(header, label),
        header=header,
        source=_text(root.get("source")),
        unused=_unused(features),
        obstacles=_parts_of(features, OBSTACLE, label),
        edges=_parts_of(features, EDGE, label),
    )


def _points(features: list[dict[str, Any]], use: str) -> tuple[Any, ...]:
    """Coordinates of the points that are read as entrances, or as places to refill."""
    return tuple(_member(feature, "geometry").get("coordinates") for feature in features if _use(feature) == use)


def _features(root: dict[str, Any], label: str) -> list[dict[str, Any]]:
    """Every feature; a bare geometry becomes one."""
    kind = root["type"]
    if kind in GEOMETRIES:
        return [{"type": "Feature", "properties": {}, "geometry": root}]
    if kind == "Feature":
        return [root]
    if kind != "FeatureCollection":
        raise FieldError(f"{label} has the type '{kind}'; give a FeatureCollection, a Feature or a Polygon.")
    features = root.get("features")
    if not isinstance(features, list) or not all(isinstance(feature, dict) for feature in features):
        raise FieldError(f"{label} has no list of features; put every feature into 'features' as an object.")
    if not features:
        raise FieldError(
            f"{label} is an empty collection; it needs a feature with the boundary as a Polygon."
        )
    return features


def _polygons(
    features: list[dict[str, Any]], label: str
) -> tuple[tuple[RawPolygon, ...], tuple[RawPolygon, ...]]:
    """Boundaries and ground zones; the parts of a MultiPolygon stand one by one."""
    polygons: list[RawPolygon] = []
    zones: list[RawPolygon] = []
    for feature in features:
        geometry, properties = _member(feature, "geometry"), _member(feature, "properties")
        kind, coordinates = geometry.get("type"), geometry.get("coordinates")
        use = _use(feature)
        if use not in (BOUNDARY, ZONE):
            continue
        if kind == "Polygon":
            parts = [coordinates]
        elif isinstance(coordinates, list):
            parts = coordinates
        else:
            raise FieldError(f"A MultiPolygon of {label} has no coordinates; give it a list of polygons.")
        target = zones if use == ZONE else polygons
        target.extend(RawPolygon(part, _keys(feature, properties), properties) for part in parts)
    return tuple(polygons), tuple(zones)


def _parts_of(features: list[dict[str, Any]], wanted: str, label: str) -> tuple[RawObstacle, ...]:
    """Obstacles or edges; the parts of a geometry in several parts stand one by one."""
    obstacles: list[RawObstacle] = []
    for feature in features:
        if _use(feature) != wanted:
            continue
        geometry, properties = _member(feature, "geometry"), _member(feature, "properties")
        form, coordinates = str(geometry["type"]), geometry.get("coordinates")
        if not form.startswith("Multi"):
            parts = [coordinates]
        elif isinstance(coordinates, list):
            parts = coordinates
        else:
            raise FieldError(f"An {wanted} of {label}, a {form}, has no coordinates; give it a list of them.")
        keys = _keys(feature, properties)
        obstacles += [RawObstacle(form.removeprefix("Multi"), part, keys, properties) for part in parts]
    return tuple(obstacles)


def _use(feature: dict[str, Any]) -> str:
    """What a feature is read as, "" for nothing. A polygon with a role of something else is no boundary."""
    kind, properties = _member(feature, "geometry").get("type"), _member(feature, "properties")
    role = properties.get("role")
    if kind == "Point" and role in (ENTRANCE, REFILL):
        return str(role)
    if role == OBSTACLE and kind in GEOMETRIES and kind != "GeometryCollection":
        return OBSTACLE
    if kind in LINES and properties.get("edge") is not None:
        return EDGE
    if kind not in ("Polygon", "MultiPolygon") or role in NO_BOUNDARY:
        return ""
    return ZONE if _text(properties.get("ground")) else BOUNDARY


def _unused(features: list[dict[str, Any]]) -> tuple[tuple[str, int], ...]:
    """Features that are read as nothing, counted by geometry and role, and edges told of what has none."""
    counts: Counter[str] = Counter()
    for feature in features:
        kind = _member(feature, "geometry").get("type")
        role, edge = (_text(_member(feature, "properties").get(key))[:ROLE_SHOWN] for key in ("role", "edge"))
        shape = kind if kind in GEOMETRIES else "feature without a known geometry"
        if edge and _use(feature) not in (EDGE, BOUNDARY):
            counts[f"{shape} with edge '{edge}'"] += 1
        elif not _use(feature):
            counts[f"{shape} with role '{role}'" if role else f"{shape}"] += 1
    most = counts.most_common(KINDS_SHOWN)
    rest = counts.total() - sum(count for _, count in most)
    return (*most, *([("of other kinds", rest)] if rest else []))


def _nothing(features: list[dict[str, Any]], zones: tuple[RawPolygon, ...], label: str) -> str:
    """Why a file without a boundary was refused."""
    kinds = Counter(str(_member(feature, "geometry").get("type") or "no geometry") for feature in features)
    found = ", ".join(f"{count} {kind}" for kind, count in kinds.items())
    if zones:
        found += ", all of its polygons ground zones"
    return f"{label} holds no field boundary (found: {found}); it needs a Polygon or MultiPolygon."


def _keys(feature: dict[str, Any], properties: dict[str, Any]) -> tuple[str, ...]:
    values = (feature.get("id"), properties.get("id"), properties.get("name"), properties.get("Name"))
    return tuple(dict.fromkeys(text for text in map(_text, values) if text))


def _crs(root: dict[str, Any], label: str) -> str | None:
    """Name in the ``crs`` member of the GeoJSON format of 2008, section 3."""
    member = root.get("crs")
    if member is None:
        return None
    name = _member(member, "properties").get("name") if isinstance(member, dict) else None
    if not isinstance(name, str) or not name:
        raise FieldError(f"The 'crs' of {label} names no coordinate system; remove it or name an EPSG code.")
    return name


def _frame(header: dict[str, Any], label: str) -> str | None:
    frame = header.get("frame")
    if frame not in (None, LOCAL, WGS84):
        raise FieldError(f"The frame {frame!r} of {label} is not known; use '{LOCAL}' or '{WGS84}'.")
    return frame


def _member(holder: dict[str, Any], key: str) -> dict[str, Any]:
    """A member that should be an object; anything else counts as empty."""
    value = holder.get(key)
    return value if isinstance(value, dict) else {}


def _text(value: Any) -> str:
    """A name out of a file: text or a whole number, otherwise nothing."""
    if isinstance(value, bool) or not isinstance(value, str | int):
        return ""
    return str(value).strip()


def _read(path: str, label: str) -> Document:
    return parse(read_text(path, "a GeoJSON file", FieldError), label)


FORMAT = Format("GeoJSON", (".geojson", ".json"), _read)
