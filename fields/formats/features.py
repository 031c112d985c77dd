"""Features, as GeoJSON has them and other forms are turned into, sorted by what a field reads them as."""

from __future__ import annotations

from collections import Counter
from typing import Any

from fields.document import Document, RawLine, RawObstacle, RawPolygon
from fields.errors import FieldError

Feature = dict[str, Any]
BOUNDARY, ZONE, ENTRANCE, OBSTACLE, EDGE = "boundary", "ground zone", "entrance", "obstacle", "edge"
REFILL, GUIDANCE, HEADLAND = "refill", "guidance", "headland"
NO_BOUNDARY = (OBSTACLE, ENTRANCE, REFILL, GUIDANCE)
"""Roles of polygons that are certainly no field."""
LINES = ("LineString", "MultiLineString")
KINDS_SHOWN, ROLE_SHOWN = 6, 30
GEOMETRIES = (
    "Point", "MultiPoint", "LineString", "MultiLineString", "Polygon", "MultiPolygon", "GeometryCollection",
)  # fmt: skip


def document_of(
    features: list[Feature],
    label: str,
    *,
    crs: str | None = None,
    frame: str | None = None,
    header: dict[str, Any] | None = None,
    source: str = "",
    notes: tuple[str, ...] = (),
) -> Document:
    """The document of a list of features; the keywords are those of Document.

    Raises:
        FieldError: no feature is a boundary, or a geometry in several parts has none.
    """
    polygons, zones = _polygons(features, label)
    if not polygons:
        raise FieldError(_nothing(features, zones, label))
    return Document(
        polygons=polygons,
        zones=zones,
        entrances=_points(features, ENTRANCE),
        refills=_points(features, REFILL),
        crs=crs,
        frame=frame,
        header=header or {},
        source=source,
        unused=_unused(features),
        obstacles=_parts_of(features, OBSTACLE, label),
        edges=_parts_of(features, EDGE, label),
        lines=tuple(RawLine(one.coordinates, one.keys) for one in _parts_of(features, GUIDANCE, label)),
        headlands=_edges(features, label),
        notes=notes,
    )


def _points(features: list[dict[str, Any]], use: str) -> tuple[Any, ...]:
    """Coordinates of the points that are read as entrances, or as places to refill."""
    return tuple(member(feature, "geometry").get("coordinates") for feature in features if _use(feature) == use)


def _polygons(features: list[dict[str, Any]], label: str) -> tuple[tuple[RawPolygon, ...], tuple[RawPolygon, ...]]:
    """Boundaries and ground zones; the parts of a MultiPolygon stand one by one."""
    polygons: list[RawPolygon] = []
    zones: list[RawPolygon] = []
    for feature in features:
        geometry, properties = member(feature, "geometry"), member(feature, "properties")
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
        geometry, properties = member(feature, "geometry"), member(feature, "properties")
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


def _edges(features: list[dict[str, Any]], label: str) -> tuple[RawLine, ...]:
    """Edges of headlands: lines, and all rings of polygons."""
    found = []
    for one in _parts_of(features, HEADLAND, label):
        rings = one.coordinates if one.form == "Polygon" else [one.coordinates]
        found += [RawLine(ring, one.keys) for ring in (rings if isinstance(rings, list) else ())]
    return tuple(found)


def _use(feature: dict[str, Any]) -> str:
    """What a feature is read as, "" for nothing. A polygon with a role of something else is no boundary."""
    kind, properties = member(feature, "geometry").get("type"), member(feature, "properties")
    role = properties.get("role")
    if kind == "Point" and role in (ENTRANCE, REFILL):
        return str(role)
    if role == OBSTACLE and kind in GEOMETRIES and kind != "GeometryCollection":
        return OBSTACLE
    if kind in LINES and properties.get("edge") is not None:
        return EDGE
    if role == HEADLAND and kind in (*LINES, "Polygon", "MultiPolygon"):
        return HEADLAND
    if kind in LINES and (role == GUIDANCE or (not role and text(properties.get("name")))):
        return GUIDANCE
    if kind not in ("Polygon", "MultiPolygon") or role in NO_BOUNDARY:
        return ""
    return ZONE if text(properties.get("ground")) else BOUNDARY


def _unused(features: list[dict[str, Any]]) -> tuple[tuple[str, int], ...]:
    """Features that are read as nothing, counted by geometry and role, and edges told of what has none."""
    counts: Counter[str] = Counter()
    for feature in features:
        kind = member(feature, "geometry").get("type")
        role, edge = (text(member(feature, "properties").get(key))[:ROLE_SHOWN] for key in ("role", "edge"))
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
    kinds = Counter(str(member(feature, "geometry").get("type") or "no geometry") for feature in features)
    found = ", ".join(f"{count} {kind}" for kind, count in kinds.items()) or "nothing"
    if zones:
        found += ", all of its polygons ground zones"
    return f"{label} holds no field boundary (found: {found}); it needs a Polygon or MultiPolygon."


def _keys(feature: dict[str, Any], properties: dict[str, Any]) -> tuple[str, ...]:
    values = (feature.get("id"), properties.get("id"), properties.get("name"), properties.get("Name"))
    return tuple(dict.fromkeys(text for text in map(text, values) if text))


def member(holder: dict[str, Any], key: str) -> dict[str, Any]:
    """A member that should be an object; anything else counts as empty."""
    value = holder.get(key)
    return value if isinstance(value, dict) else {}


def text(value: Any) -> str:
    """A name out of a file: text or a whole number, otherwise nothing."""
    if isinstance(value, bool) or not isinstance(value, str | int):
        return ""
    return str(value).strip()
