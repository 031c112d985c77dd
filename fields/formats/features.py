"""Features in the form of GeoJSON, into which all formats are converted, sorted into the parts of a field document."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from itertools import count
from typing import Any

from fields.errors import FieldError
from fields.feature_words import LINE_KINDS, OVERHEAD_LINE, find_meaning, find_word_meaning
from fields.raw_document import FieldDocument, RawLine, RawPolygon, RawShape

Feature = dict[str, Any]
ALL_FIELDS = "*"
"""Instead of a key: every field of a file."""
BOUNDARY, GROUND_ZONE, ENTRANCE, OBSTACLE, BOUNDARY_EDGE = "boundary", "ground zone", "entrance", "obstacle", "edge"
REFILL, GUIDANCE, HEADLAND, UNASSIGNED = "refill", "guidance", "headland", "unassigned"
NON_BOUNDARY_ROLES = (OBSTACLE, ENTRANCE, REFILL, GUIDANCE)
"""Roles of polygons that are not boundaries."""
POINT_TYPES = ("Point", "MultiPoint")
LINE_TYPES = ("LineString", "MultiLineString")
POLYGON_TYPES = ("Polygon", "MultiPolygon")
MAX_KINDS_SHOWN, MAX_ROLE_CHARS = 6, 30
GEOMETRY_TYPES = (
    "Point",
    "MultiPoint",
    "LineString",
    "MultiLineString",
    "Polygon",
    "MultiPolygon",
    "GeometryCollection",
)


def build_document(
    features: list[Feature],
    label: str,
    *,
    crs: str | None = None,
    frame: str | None = None,
    header: dict[str, Any] | None = None,
    source: str = "",
    notes: tuple[str, ...] = (),
) -> FieldDocument:
    """The document of a list of features; keywords as in FieldDocument.

    Raises:
        FieldError: no feature is a boundary, or a multi-part geometry has no coordinates.
    """
    polygons, zones = _collect_polygons(features, label)
    polygons = _assign_keys(polygons)
    if not polygons:
        raise FieldError(_explain_no_boundary(features, zones, label))
    return FieldDocument(
        polygons=polygons,
        zones=zones,
        entrances=_collect_points(features, ENTRANCE),
        service_points=_collect_points(features, REFILL),
        crs=crs,
        frame=frame,
        header=header or {},
        source=source,
        unused_counts=_count_unused(features),
        obstacles=_collect_role_shapes(features, OBSTACLE, label),
        boundary_edges=_collect_role_shapes(features, BOUNDARY_EDGE, label),
        guidance_lines=tuple(
            RawLine(one.coordinates, one.keys, not convert_to_name_text(one.properties.get("role")))
            for one in _collect_role_shapes(features, GUIDANCE, label)
        ),
        headland_edges=_collect_headland_edges(features, label),
        unassigned=_collect_role_shapes(features, UNASSIGNED, label),
        notes=notes,
    )


def _collect_points(features: list[dict[str, Any]], role: str) -> tuple[Any, ...]:
    """Coordinates of the points with a role: entrances or service points."""
    return tuple(
        get_member_object(feature, "geometry").get("coordinates")
        for feature in features
        if _classify_feature(feature) == role
    )


def _collect_polygons(
    features: list[dict[str, Any]], label: str
) -> tuple[tuple[RawPolygon, ...], tuple[RawPolygon, ...]]:
    """Boundaries and ground zones; the parts of a MultiPolygon are separate."""
    polygons: list[RawPolygon] = []
    zones: list[RawPolygon] = []
    for feature in features:
        geometry, properties = get_member_object(feature, "geometry"), get_member_object(feature, "properties")
        geometry_type, coordinates = geometry.get("type"), geometry.get("coordinates")
        role = _classify_feature(feature)
        if role not in (BOUNDARY, GROUND_ZONE):
            continue
        if geometry_type == "Polygon":
            parts = [coordinates]
        elif isinstance(coordinates, list):
            parts = coordinates
        else:
            raise FieldError(f"A MultiPolygon of {label} has no coordinates; give it a list of polygons.")
        target = zones if role == GROUND_ZONE else polygons
        target.extend(RawPolygon(part, _collect_choosable_names(feature, properties), properties) for part in parts)
    return tuple(polygons), tuple(zones)


def _assign_keys(polygons: tuple[RawPolygon, ...]) -> tuple[RawPolygon, ...]:
    """The polygons with keys of their own, safe for a terminal: see `RawPolygon.key`.

    A name that several have is the key of none of them, so that it never means one by chance.
    """
    owners = Counter(name for one in polygons for name in set(map(replace_unprintable, one.keys)))
    taken = {*owners, ALL_FIELDS}
    keyed = []
    for position, one in enumerate(polygons):
        key = replace_unprintable(one.keys[0]) if one.keys else str(position)
        others = owners[key] - bool(one.keys)
        if others or key == ALL_FIELDS:
            key = next(text for text in (f"{key}-{number}" for number in count(1)) if text not in taken)
            taken.add(key)
        keyed.append(replace(one, key=key))
    return tuple(keyed)


def replace_unprintable(name: str) -> str:
    """A name from a file, safe for a terminal: unprintable characters become question marks."""
    return "".join(one if one.isprintable() else "?" for one in name)


def _collect_role_shapes(features: list[dict[str, Any]], role: str, label: str) -> tuple[RawShape, ...]:
    """Features with a role; the parts of a multi-part geometry are separate."""
    shapes: list[RawShape] = []
    for feature in features:
        if _classify_feature(feature) != role:
            continue
        geometry, properties = get_member_object(feature, "geometry"), get_member_object(feature, "properties")
        geometry_type, coordinates = str(geometry["type"]), geometry.get("coordinates")
        if not geometry_type.startswith("Multi"):
            parts = [coordinates]
        elif isinstance(coordinates, list):
            parts = coordinates
        elif role == UNASSIGNED:
            continue
        else:
            raise FieldError(
                f"A {geometry_type} with role {role} of {label} has no coordinates; give it a list of them."
            )
        keys = _collect_choosable_names(feature, properties)
        shapes += [RawShape(geometry_type.removeprefix("Multi"), part, keys, properties) for part in parts]
    return tuple(shapes)


def _collect_headland_edges(features: list[dict[str, Any]], label: str) -> tuple[RawLine, ...]:
    """Edges of headlands: lines, and all rings of polygons."""
    edges = []
    for shape in _collect_role_shapes(features, HEADLAND, label):
        rings = shape.coordinates if shape.geometry_type == "Polygon" else [shape.coordinates]
        edges += [RawLine(ring, shape.keys) for ring in (rings if isinstance(rings, list) else ())]
    return tuple(edges)


def _classify_feature(feature: dict[str, Any]) -> str:
    """The use of a feature, "" for none. A polygon with another role is not a boundary."""
    geometry_type, properties = (
        get_member_object(feature, "geometry").get("type"),
        get_member_object(feature, "properties"),
    )
    role = properties.get("role")
    if geometry_type == "Point" and role in (ENTRANCE, REFILL):
        return str(role)
    if _is_obstacle_role(role) and geometry_type in GEOMETRY_TYPES and geometry_type != "GeometryCollection":
        return OBSTACLE if role == OBSTACLE or geometry_type in POLYGON_TYPES else UNASSIGNED
    if geometry_type in LINE_TYPES and properties.get("edge") is not None:
        return BOUNDARY_EDGE
    if role == HEADLAND and geometry_type in (*LINE_TYPES, *POLYGON_TYPES):
        return HEADLAND
    if geometry_type in LINE_TYPES:
        return GUIDANCE if role == GUIDANCE else "" if role else _classify_plain_line(properties)
    if geometry_type in POINT_TYPES and not role and properties.get("edge") is None:
        return UNASSIGNED
    if geometry_type not in POLYGON_TYPES or role in NON_BOUNDARY_ROLES:
        return ""
    return GROUND_ZONE if convert_to_name_text(properties.get("ground")) else BOUNDARY


def _is_obstacle_role(role: Any) -> bool:
    """Whether a role is that of obstacles, or a word for one, such as tree."""
    return role == OBSTACLE or (isinstance(role, str) and find_word_meaning(role).use == OBSTACLE)


def _classify_plain_line(properties: dict[str, Any]) -> str:
    """The use of a line without a role: a named one is a guidance line, unless it is named like an obstacle."""
    if not convert_to_name_text(properties.get("name")):
        return UNASSIGNED
    meaning = find_meaning(properties)
    is_obstacle = meaning.use == OBSTACLE and meaning.kind in LINE_KINDS
    return UNASSIGNED if is_obstacle or meaning.use == OVERHEAD_LINE else GUIDANCE


def _count_unused(features: list[dict[str, Any]]) -> tuple[tuple[str, int], ...]:
    """Unused features, counted by geometry and role, and features whose ``edge`` has no meaning."""
    counts: Counter[str] = Counter()
    for feature in features:
        kind, properties = get_member_object(feature, "geometry").get("type"), get_member_object(feature, "properties")
        edge = convert_to_name_text(properties.get("edge"))[:MAX_ROLE_CHARS]
        shape = kind if kind in GEOMETRY_TYPES else "feature without a known geometry"
        if edge and _classify_feature(feature) not in (BOUNDARY_EDGE, BOUNDARY):
            counts[f"{shape} with edge '{edge}'"] += 1
        elif not _classify_feature(feature):
            counts[describe_unused_feature(str(shape), properties)] += 1
    return summarise_counts(counts)


def describe_unused_feature(shape: str, properties: dict[str, Any]) -> str:
    """A feature that is not used: its geometry and its role."""
    role = convert_to_name_text(properties.get("role"))[:MAX_ROLE_CHARS]
    return f"{shape} with role '{role}'" if role else shape


def summarise_counts(counts: Counter[str]) -> tuple[tuple[str, int], ...]:
    """The most frequent of what is counted, and the sum of the others."""
    most_common = counts.most_common(MAX_KINDS_SHOWN)
    remaining = counts.total() - sum(count for _, count in most_common)
    return (*most_common, *([("of other kinds", remaining)] if remaining else []))


def _explain_no_boundary(features: list[dict[str, Any]], zones: tuple[RawPolygon, ...], label: str) -> str:
    """The refusal of a file without a boundary."""
    kinds = Counter(str(get_member_object(feature, "geometry").get("type") or "no geometry") for feature in features)
    found_kinds = ", ".join(f"{count} {kind}" for kind, count in kinds.items()) or "nothing"
    if zones:
        found_kinds += ", all of its polygons ground zones"
    return f"{label} contains no field boundary (found: {found_kinds}); it needs a Polygon or MultiPolygon."


def _collect_choosable_names(feature: dict[str, Any], properties: dict[str, Any]) -> tuple[str, ...]:
    values = (feature.get("id"), properties.get("id"), properties.get("name"), properties.get("Name"))
    return tuple(dict.fromkeys(text for text in map(convert_to_name_text, values) if text))


def get_member_object(holder: dict[str, Any], key: str) -> dict[str, Any]:
    """A member that should be an object; empty for anything else."""
    value = holder.get(key)
    return value if isinstance(value, dict) else {}


def convert_to_name_text(value: Any) -> str:
    """A name from a file: text or an integer; "" for anything else."""
    if isinstance(value, bool) or not isinstance(value, str | int):
        return ""
    return str(value).strip()
