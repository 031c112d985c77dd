"""Features in the form of GeoJSON, into which all formats are converted, sorted into the parts of a field document."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import replace
from itertools import count
from typing import Any

from fields.errors import MAX_NAMED, FieldError
from fields.feature_words import (
    ENTRANCE,
    GUIDANCE,
    LINE_KINDS,
    OBSTACLE,
    OVERHEAD_LINE,
    REFILL,
    find_meaning,
    find_word_meaning,
)
from fields.raw_document import FieldDocument, RawShape

Feature = dict[str, Any]
ALL_FIELDS = "*"
"""Instead of a key: every field of a file."""
BOUNDARY, GROUND_ZONE, BOUNDARY_EDGE = "boundary", "ground zone", "edge"
HEADLAND, UNASSIGNED = "headland", "unassigned"
NON_BOUNDARY_ROLES = (ENTRANCE, REFILL, GUIDANCE)
"""Roles of polygons, besides obstacles and headlands, that are not boundaries; of any other role they are."""
POINT_TYPES = ("Point", "MultiPoint")
LINE_TYPES = ("LineString", "MultiLineString")
POLYGON_TYPES = ("Polygon", "MultiPolygon")
MAX_ROLE_CHARS = 30
COLLECTION_TYPE = "GeometryCollection"
GEOMETRY_TYPES = (*POINT_TYPES, *LINE_TYPES, *POLYGON_TYPES, COLLECTION_TYPE)


def build_feature(geometry_type: str, coordinates: object, properties: dict[str, Any]) -> Feature:
    """A feature as GeoJSON has it."""
    geometry = {"type": geometry_type, "coordinates": coordinates}
    return {"type": "Feature", "properties": properties, "geometry": geometry}


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

    Raises FieldError where no feature is a boundary, or a multi-part geometry has no coordinates.
    """
    shapes: dict[str, list[RawShape]] = defaultdict(list)
    unused: Counter[str] = Counter()
    features = [part for feature in features for part in _split_collection(feature)]
    for feature in features:
        kind, properties = get_member_object(feature, "geometry").get("type"), get_member_object(feature, "properties")
        role = _classify_feature(kind, properties)
        shapes[role] += _split_into_parts(feature, role, label) if role else []
        edge = convert_to_name_text(properties.get("edge"))[:MAX_ROLE_CHARS]
        shape = str(kind) if kind in GEOMETRY_TYPES else "feature without a known geometry"
        if edge and role not in (BOUNDARY_EDGE, BOUNDARY):
            unused[f"{shape} with edge '{edge}'"] += 1
        elif not role:
            unused[describe_unused_feature(shape, properties)] += 1
    if not shapes[BOUNDARY]:
        raise FieldError(_explain_no_boundary(features, bool(shapes[GROUND_ZONE]), label))
    return FieldDocument(
        polygons=_assign_keys(shapes[BOUNDARY]),
        zones=tuple(shapes[GROUND_ZONE]),
        entrances=tuple(shapes[ENTRANCE]),
        service_points=tuple(shapes[REFILL]),
        crs=crs,
        frame=frame,
        header=header or {},
        source=source,
        unused_counts=summarise_counts(unused),
        obstacles=tuple(shapes[OBSTACLE]),
        boundary_edges=tuple(shapes[BOUNDARY_EDGE]),
        guidance_lines=tuple(shapes[GUIDANCE]),
        headland_edges=tuple(edge for one in shapes[HEADLAND] for edge in _list_edges(one)),
        unassigned=tuple(shapes[UNASSIGNED]),
        notes=notes,
    )


def _split_collection(feature: Feature) -> list[Feature]:
    """A feature, or one for every member of its geometry collection, without the points of labels beside areas."""
    members = get_member_object(feature, "geometry").get("geometries")
    if not isinstance(members, list) or feature["geometry"].get("type") != COLLECTION_TYPE or not members:
        return [feature]
    parts = [part for member in members for part in _split_collection({**feature, "geometry": member})]
    kinds = [get_member_object(part, "geometry").get("type") for part in parts]
    has_area = any(kind in POLYGON_TYPES for kind in kinds)
    return [part for part, kind in zip(parts, kinds, strict=True) if not (has_area and kind in POINT_TYPES)]


def _split_into_parts(feature: Feature, role: str, label: str) -> list[RawShape]:
    """A feature as one shape, or the parts of a multi-part geometry as separate ones."""
    geometry, properties = get_member_object(feature, "geometry"), get_member_object(feature, "properties")
    geometry_type, coordinates = str(geometry["type"]), geometry.get("coordinates")
    is_multiple = geometry_type.startswith("Multi")
    if is_multiple and not isinstance(coordinates, list):
        if role == UNASSIGNED:
            return []
        if role in (BOUNDARY, GROUND_ZONE):
            raise FieldError(f"A MultiPolygon of {label} has no coordinates; give it a list of polygons.")
        raise FieldError(f"A {geometry_type} with role {role} of {label} has no coordinates; give it a list of them.")
    values = (feature.get("id"), properties.get("id"), properties.get("name"), properties.get("Name"))
    keys = tuple(dict.fromkeys(text for text in map(convert_to_name_text, values) if text))
    parts: Any = coordinates if is_multiple else [coordinates]
    return [RawShape(geometry_type.removeprefix("Multi"), part, keys, properties) for part in parts]


def _list_edges(shape: RawShape) -> list[RawShape]:
    """The lines of the edge of a headland: all rings of a polygon."""
    rings = shape.coordinates if shape.geometry_type == "Polygon" else [shape.coordinates]
    edges: list[Any] = rings if isinstance(rings, list) else []
    return [replace(shape, geometry_type="LineString", coordinates=ring) for ring in edges]


def _assign_keys(polygons: Sequence[RawShape]) -> tuple[RawShape, ...]:
    """The polygons with keys of their own, safe for a terminal: see `RawShape.key`.

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


def _classify_feature(geometry_type: Any, properties: dict[str, Any]) -> str:
    """The use of a feature of this geometry, "" for none."""
    role = properties.get("role")
    if geometry_type == "Point" and role in (ENTRANCE, REFILL):
        return str(role)
    means_obstacle = role == OBSTACLE or (isinstance(role, str) and find_word_meaning(role).use == OBSTACLE)
    if means_obstacle and geometry_type in GEOMETRY_TYPES and geometry_type != COLLECTION_TYPE:
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


def _classify_plain_line(properties: dict[str, Any]) -> str:
    """The use of a line without a role: a named one is a guidance line, unless it is named like an obstacle."""
    if not convert_to_name_text(properties.get("name")):
        return UNASSIGNED
    meaning = find_meaning(properties)
    is_obstacle = meaning.use == OBSTACLE and meaning.kind in LINE_KINDS
    return UNASSIGNED if is_obstacle or meaning.use == OVERHEAD_LINE else GUIDANCE


def describe_unused_feature(shape: str, properties: dict[str, Any]) -> str:
    """A feature that is not used: its geometry and its role."""
    role = convert_to_name_text(properties.get("role"))[:MAX_ROLE_CHARS]
    return f"{shape} with role '{role}'" if role else shape


def summarise_counts(counts: Counter[str]) -> tuple[tuple[str, int], ...]:
    """The most frequent of what is counted, and the sum of the others."""
    most_common = counts.most_common(MAX_NAMED)
    remaining = counts.total() - sum(count for _, count in most_common)
    return (*most_common, *([("of other kinds", remaining)] if remaining else []))


def _explain_no_boundary(features: list[Feature], has_zones: bool, label: str) -> str:
    """The refusal of a file without a boundary."""
    kinds = Counter(str(get_member_object(feature, "geometry").get("type") or "no geometry") for feature in features)
    found_kinds = ", ".join(f"{count} {kind}" for kind, count in kinds.items()) or "nothing"
    if has_zones:
        found_kinds += "; ground zones are no boundary"
    return f"{label} contains no field boundary (found: {found_kinds}); it needs a Polygon or MultiPolygon."


def get_member_object(holder: dict[str, Any], key: str) -> dict[str, Any]:
    """A member that should be an object; empty for anything else."""
    value = holder.get(key)
    return value if isinstance(value, dict) else {}


def convert_to_name_text(value: Any) -> str:
    """A name from a file: text or an integer; "" for anything else."""
    if isinstance(value, bool) or not isinstance(value, str | int):
        return ""
    return str(value).strip()
