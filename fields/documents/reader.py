"""Read a field, or list the fields, of a sample or of a file in one of the formats of fields.formats."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import shapely
from shapely.geometry.polygon import orient

from fields.documents.nested_polygons import find_inside_polygons, find_parent_polygons, select_inside_obstacles
from fields.documents.sources import FieldReference, parse_field_reference
from fields.errors import (
    MAX_LISTED,
    MAX_NAMED,
    FieldError,
    join_first,
    mark_parameter,
    measure_likeness,
    shorten_value,
    suggest_name,
)
from fields.formats.features import describe_unused_feature, replace_unprintable, summarise_counts
from fields.geometry.arithmetic import NEAR_FIELD_M
from fields.geometry.assumed_obstacles import assume_roles, describe_assumed_obstacles
from fields.geometry.coordinates import (
    FieldFrame,
    apply_coordinate_options,
    build_field_frame,
    build_polygon,
    check_area,
    looks_like_degrees,
    parse_rings,
)
from fields.geometry.field import Field, GroundZone
from fields.geometry.field_lines import read_edges, read_guidance_lines, read_headland_edges
from fields.geometry.geodesy import DEGREES_CRS
from fields.geometry.obstacles import parse_obstacle, select_obstacles
from fields.geometry.outline_cleaning import clean_outline
from fields.raw_document import LOCAL_METRES, FieldDocument, GeoShape, RawShape
from fields.terrain.point_files import POINT_SUFFIXES
from fields.terrain.rasters import RASTER_SUFFIXES

FieldSource = str | Path | GeoShape
"""A field as users name it: a sample, a file, or a shape of another library."""
HEIGHT_SUFFIXES = (*RASTER_SUFFIXES, *POINT_SUFFIXES)
"""Of files with heights (fields.terrain); another `elevation` of a boundary is no name of a file."""


def read_field(
    where: FieldSource, *, local: bool = False, name: str | None = None, crs: str | None = None, swap_axes: bool = False
) -> Field:
    """Read one field.

    Args:
        where: a sample, a file or folder in one of the formats, or a shape such as a GeoDataFrame. ``file#KEY`` chooses
            one of several polygons by feature id, properties id, name, or 0-based position, in this order.
        local: the coordinates are local metres; otherwise they are longitude and latitude unless the file
            itself names another system.
        name: name for the field; otherwise taken from the file.
        crs: coordinate system of a file that does not name its own, such as "EPSG:25832".
        swap_axes: the file has latitude or northing before longitude or easting.

    A Point with ``role: entrance`` in its properties is the entrance, one with ``role: refill`` the place where tanks
    are filled or emptied; polygons with a ``ground`` are ground zones. Features with ``role: obstacle`` are obstacles:
    a Point with its ``radius_m``, a LineString with its ``width_m``, or a Polygon; a ``kind`` such as ``pole`` or
    ``ditch`` gives a default size. A line or Polygon with ``role: headland`` is the inner edge of a headland. The
    boundary may have ``edge: fence`` all round; a LineString along it with ``edge: fence`` or ``edge: open`` describes
    one side, and one with ``role: guidance``, or with only a name, is a line that swaths can be laid along. An
    ``elevation`` of the boundary names a file with heights beside the field file. Points,
    short lines and polygons within the field that have no role are obstacles, unless their words or number say
    otherwise (`fields.geometry.assumed_obstacles`); remarks name them. Heights are dropped and open rings closed.

    Raises FieldError where the file cannot be read or does not describe one usable field.
    """
    source = parse_field_reference(where)
    label = source.label
    document = apply_coordinate_options(source.read_document(), local, crs, swap_axes, label)
    polygon = _choose_polygon(document, source.key, local, label)
    shape, frame, cleaning_remarks = _read_outline(document, polygon, local, label)
    check_area(shape, label)
    multiple_fields = len(document.polygons) > 1
    inside = find_inside_polygons(document, polygon, frame, shape) if multiple_fields else []
    parsed_obstacles = [parse_obstacle(raw, frame, label) for raw in document.obstacles]
    obstacles, obstacle_remarks = select_obstacles(parsed_obstacles, shape, multiple_fields, label)
    field_names = [source.name, *(key for raw in document.polygons for key in raw.keys)]
    solid = [one.shape for one in obstacles]
    roles = assume_roles(document.unassigned, document.guidance_lines, frame, shape, field_names, solid)
    obstacles = (*obstacles, *select_inside_obstacles(inside, shape, roles.ignore), *roles.obstacles)
    obstacles = tuple(replace(one, number=number) for number, one in enumerate(obstacles, 1))
    edges = (*document.boundary_edges, *roles.fences)
    fences, overhangs, edge_remarks = read_edges(polygon, edges, frame, shape, multiple_fields, label)
    entrance = _read_single_point(document.entrances, "entrance", frame, shape, multiple_fields, label)
    service_point = _read_single_point(document.service_points, "refill", frame, shape, multiple_fields, label)
    ground_zones, zone_remarks = _read_ground_zones(document, frame, shape, multiple_fields, label)
    return Field(
        name=name or _choose_name(polygon, source.name),
        boundary=shape,
        crs=frame.crs,
        origin_m=frame.origin_m,
        entrance=roles.take_place("entrance", entrance),
        service_point=roles.take_place("refill", service_point),
        ground_zones=ground_zones,
        default_ground=str(polygon.properties.get("default_ground") or "soil"),
        source=str(polygon.properties.get("source") or document.source),
        remarks=(
            *cleaning_remarks,
            *(one.remark for one in obstacles if one.remark),
            *describe_assumed_obstacles(obstacles),
            *_list_reader_remarks(document, roles.unused),
            *roles.remarks,
            *edge_remarks,
            *obstacle_remarks,
            *zone_remarks,
        ),
        obstacles=obstacles,
        fences=fences,
        edge_overhangs=overhangs,
        guidance_lines=read_guidance_lines(roles.guidance_lines, frame, shape, multiple_fields),
        headland_edges=read_headland_edges(document.headland_edges, frame, shape),
        elevation=_find_elevation_file(polygon, source, label),
    )


def _find_elevation_file(polygon: RawShape, source: FieldReference, label: str) -> str | None:
    """The path of the file with heights that a boundary names; None for no name of a file, such as a mean height.

    It lies beside the field file, so that a field from elsewhere opens no other file. Raises FieldError.
    """
    name = polygon.properties.get("elevation")
    if not isinstance(name, str) or not name.lower().endswith(HEIGHT_SUFFIXES):
        return None
    if name != Path(name).name or "\\" in name:
        raise FieldError(
            f"{label} names the heights {shorten_value(name)}; put the file beside the field file, and give its name "
            "without folders."
        )
    return name if source.is_shape else str(Path(source.place).parent / name)


def _list_reader_remarks(document: FieldDocument, unused: Sequence[RawShape]) -> tuple[str, ...]:
    """Notes of the reader, and a sentence on features of the file that are not used."""
    counts = Counter(describe_unused_feature(one.geometry_type, one.properties) for one in unused)
    counts.update(dict(document.unused_counts))
    if not counts:
        return document.notes
    counted = ", ".join(f"{count} {what}" for what, count in summarise_counts(counts))
    return (
        *document.notes,
        f"Features of the field file that are not used: {counted}. An obstacle has the role 'obstacle' or is a hole "
        "of the boundary, an entrance is a Point with role 'entrance' (a service point: 'refill'), a ground zone a "
        "Polygon with a 'ground', a fence a LineString along the boundary with edge 'fence'.",
    )


def read_polygons(where: FieldSource, field: Field) -> list[shapely.Geometry]:
    """All polygons of a file in metres of a field, such as ground that is worked, or what its key names.

    Raises FieldError where the file cannot be read, holds no polygon, or is in local metres where the field is not.
    """
    source = parse_field_reference(where)
    document, label = source.read_document(), source.label
    raws = (*document.polygons, *document.zones, *(one for one in document.obstacles if one.geometry_type == "Polygon"))
    if source.key is not None:
        named = [raw for raw in document.polygons if source.key in raw.keys]  # the parts of one share its name
        raws = tuple(named) or (_choose_polygon(document, source.key, field.crs is None, label),)
    if not raws:
        raise FieldError(f"{label} holds no polygon; give worked ground as polygons.")
    raw_rings = [parse_rings(raw.coordinates, label) for raw in raws]
    is_local = document.frame == LOCAL_METRES
    if field.crs is None and document.crs is None and document.frame is None:  # metres where the field was read so
        is_local = not any(looks_like_degrees(outer) for outer, *_ in raw_rings)
    if is_local != (field.crs is None):
        found, needed = ("longitude and latitude", "local metres") if field.crs is None else ("local metres", "degrees")
        raise FieldError(f"{label} is in {found}, and field '{field.name}' is not; give it in {needed}.")
    frame = FieldFrame(None if is_local else document.crs or DEGREES_CRS, field.crs, field.origin_m)
    rings = [[frame.to_local(ring) for ring in part] for part in raw_rings]
    return [shapely.make_valid(shapely.Polygon(outer, holes)) for outer, *holes in rings]


@dataclass(frozen=True)
class FieldSummary:
    """One of the fields of a file: how to choose it (`file#key` or `file#position`) and its size.

    `area_ha` excludes its `holes`; both are None if the field cannot be used, for the reason in `fault`. `inside` is
    the key of the field that it lies within, of which it is an obstacle, zone or second outline; None for most.
    `shared_name` is the name of which `key` is made, where others have it too.
    """

    position: int
    key: str
    area_ha: float | None = None
    holes: int | None = None
    fault: str = ""
    inside: str | None = None
    shared_name: str | None = None


def list_fields(
    where: FieldSource, *, local: bool = False, crs: str | None = None, swap_axes: bool = False
) -> tuple[FieldSummary, ...]:
    """Every field of a file or sample, in the order of the file; arguments as in `read_field`.

    Raises FieldError where the file cannot be read or holds no field.
    """
    return list_fields_with_notes(where, local=local, crs=crs, swap_axes=swap_axes)[0]


def list_fields_with_notes(
    where: FieldSource, *, local: bool = False, crs: str | None = None, swap_axes: bool = False
) -> tuple[tuple[FieldSummary, ...], tuple[str, ...]]:
    """The fields of a file as `list_fields` gives them, and the reader's notes on what it skipped or repaired."""
    source = parse_field_reference(where)
    document = apply_coordinate_options(source.read_document(), local, crs, swap_axes, source.label)
    parents = find_parent_polygons(document.polygons)
    fields = tuple(
        _summarise_field(document, position, local, parents.get(position)) for position in range(len(document.polygons))
    )
    return fields, (*document.notes, *describe_listing(fields))


def describe_listing(fields: Sequence[FieldSummary]) -> tuple[str, ...]:
    """A sentence on fields that share names, and one on polygons that lie within one of the fields."""
    sentences = []
    numbered = [f"'{one.key}'" for one in fields if one.shared_name is not None]
    if numbered:
        listed = join_first(numbered, MAX_LISTED)
        sentences.append(f"Ids or names that another field of the file has too got a number: {listed}.")
    nested = [f"'{one.key}' (in '{one.inside}')" for one in fields if one.inside is not None]
    if nested:
        listed = join_first(nested, MAX_LISTED)
        sentences.append(
            f"No fields of their own, as they lie inside another one, such as ponds: {listed}; #* leaves them out, and "
            "#NAME picks one all the same."
        )
    return tuple(sentences)


def _summarise_field(document: FieldDocument, index: int, local: bool, parent: int | None = None) -> FieldSummary:
    raw, inside = document.polygons[index], None if parent is None else document.polygons[parent].key
    name = replace_unprintable(raw.keys[0]) if raw.keys else str(index)
    summary = FieldSummary(index, raw.key, inside=inside, shared_name=None if name == raw.key else name)
    try:
        shape = _read_outline(document, raw, local, raw.key)[0]
    except FieldError as fault:
        return replace(summary, fault=str(fault))
    return replace(summary, area_ha=float(shape.area) / 1e4, holes=len(shape.interiors))


def _choose_polygon(document: FieldDocument, key: str | None, local: bool, label: str) -> RawShape:
    """The polygon with this key; without a key the only one that does not lie within another."""
    polygons = document.polygons
    if key is None:
        offered = _list_offered_fields(document)
        if len(offered) == 1:
            return polygons[offered[0]]
        raise FieldError(
            f"{label} holds {len(offered)} fields; {_explain_polygon_choice(document, local)}.", parameter="field"
        )
    matches = [raw for raw in polygons if key == raw.key] or [raw for raw in polygons if key in raw.keys]
    if len(matches) > 1:
        keys = join_first([raw.key for raw in matches], MAX_LISTED)
        raise FieldError(
            f"{len(matches)} fields of {label} are named '{key}'; choose one of {keys}.", parameter="field"
        )
    if matches:
        return matches[0]
    if key.isdecimal() and len(key) < 10 and int(key) < len(polygons):
        return polygons[int(key)]
    close = suggest_name(key, [raw.key for raw in polygons])
    raise FieldError(
        f"{label} has no field '{key}'{close}; {_explain_polygon_choice(document, local, key)}.", parameter="field"
    )


def _list_offered_fields(document: FieldDocument) -> list[int]:
    """Positions of the polygons that do not lie within another."""
    parents = find_parent_polygons(document.polygons)
    return [position for position in range(len(document.polygons)) if position not in parents]


def _explain_polygon_choice(document: FieldDocument, local: bool, wanted: str = "") -> str:
    """Names and areas of the fields in a file, of many the first or those most like a wanted one; how to pick one."""
    offered, rows = _list_offered_fields(document), []
    shown = offered[:MAX_LISTED]
    if wanted and len(offered) > MAX_LISTED:
        likeness = {number: measure_likeness(wanted, document.polygons[number].key) for number in offered}
        shown = sorted(offered, key=lambda number: -likeness[number])[:MAX_NAMED]
    for summary in (_summarise_field(document, number, local) for number in shown):
        rows.append(f"{summary.key} ({'not usable' if summary.area_ha is None else f'{summary.area_ha:.2f} ha'})")
    remaining = len(offered) - len(rows)
    remainder = f" and {remaining} more ({mark_parameter('list_fields')} lists all)" if remaining else ""
    if document.is_shape:
        return (
            "give one alone, such as frame.explode().iloc[[0]] of a GeoDataFrame or shape.geoms[0] of shapely: "
            f"{', '.join(rows)}{remainder}"
        )
    return (
        f"choose one of its {len(offered)} by adding #ID or #position (from 0) to the file name: {', '.join(rows)}"
        f"{remainder}"
    )


def _read_outline(
    document: FieldDocument, raw: RawShape, local: bool, label: str
) -> tuple[shapely.Polygon, FieldFrame, tuple[str, ...]]:
    """The checked boundary in local metres, its frame, and a remark if it had to be cleaned."""
    parts = parse_rings(raw.coordinates, label)
    frame = build_field_frame(document, parts, local, label)
    local_parts = [frame.to_local(part) for part in parts]
    cleaned = clean_outline(local_parts, label)
    if cleaned is None:
        build_polygon([frame.unwrap_longitudes(part) for part in parts], label)  # names the place as in the file
        return build_polygon(local_parts, label), frame, ()
    return orient(cleaned[0], 1.0), frame, cleaned[1]


def _read_ground_zones(
    document: FieldDocument, frame: FieldFrame, shape: shapely.Polygon, multiple_fields: bool, label: str
) -> tuple[tuple[GroundZone, ...], tuple[str, ...]]:
    """Ground zones in local metres, in the order of the file, and remarks on those away from the field."""
    zones, remarks = [], []
    for raw in document.zones:
        ground = str(raw.properties["ground"]).strip()
        parts = parse_rings(raw.coordinates, f"ground zone '{ground}' of {label}")
        area = build_polygon([frame.to_local(part) for part in parts], f"ground zone '{ground}' of {label}")
        distance_m = float(area.distance(shape))
        if not multiple_fields or distance_m <= NEAR_FIELD_M:
            zones.append(GroundZone(ground, area))
        if not multiple_fields and distance_m > NEAR_FIELD_M:
            remarks.append(f"Ground zone '{ground}' lies {distance_m:.0f} m outside the field.")
    return tuple(zones), tuple(remarks)


def _read_single_point(
    places: Sequence[RawShape], role: str, frame: FieldFrame, shape: shapely.Polygon, multiple_fields: bool, label: str
) -> tuple[float, float] | None:
    """The only entrance or service point of the field in local metres, or None."""
    points = []
    for raw in places:
        description = f"{'an' if role == 'entrance' else 'a'} {role} of {label}"
        x, y = frame.read_points(raw, description)[0].tolist()
        if not multiple_fields or shape.distance(shapely.Point(x, y)) <= NEAR_FIELD_M:
            points.append((x, y))
    if len(points) > 1:
        raise FieldError(f"{label} has {len(points)} {role}s; keep one Point with role '{role}'.")
    return points[0] if points else None


def _choose_name(raw: RawShape, stem: str) -> str:
    """Name for the field: its own, else its id, else that of the file."""
    names = [raw.properties[key] for key in ("name", "Name") if isinstance(raw.properties.get(key), str)]
    name = next(filter(None, map(str.strip, names)), None)
    return replace_unprintable(name or (raw.keys[0] if raw.keys else stem))
