"""Read a field from a sample or from a file of a form in fields.formats."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from fields.document import Document, RawPolygon
from fields.errors import FieldError, named
from fields.fences import NEAR_M, read_fences
from fields.field import Field, GroundZone
from fields.frame import Frame, frame_of
from fields.guidance import guidance_lines
from fields.headlands import headland_edges
from fields.obstacles import Obstacle
from fields.obstacles_read import on_field, polygons_inside, read_obstacle
from fields.outline import check_area, polygon, position, rings
from fields.samples_index import sample_names
from fields.source import field_file, source_of
from fields.telling import told
from fields.write import write_field

__all__ = ["Listed", "field_file", "list_fields", "read_field", "sample_names", "write_field"]

LISTED = 12


def read_field(
    where: str | Path, *, local: bool = False, name: str | None = None, crs: str | None = None, swap: bool = False
) -> Field:
    """Read one field.

    Args:
        where: name of a sample field, or a file or folder of a form in fields.formats. ``file#KEY`` chooses one of
            several polygons by feature id, properties id, name, or 0-based position among the polygons, in this order.
        local: the coordinates are local metres; otherwise they are longitude and latitude unless the file
            itself names another system.
        name: name for the field; otherwise taken from the file.
        crs: coordinate system of a file that does not name its own, such as "EPSG:25832".
        swap: the file has latitude or northing first where longitude or easting should be.

    A Point whose properties have ``role: entrance`` is the entrance, one with ``role: refill`` the place where tanks
    are filled or emptied; polygons whose properties have a ``ground`` are ground zones. Features with ``role:
    obstacle`` are obstacles: a Point with its ``radius_m``, a LineString with its ``width_m``, a Polygon; a ``kind``
    such as ``pole`` or ``ditch`` may stand for the size. A line or Polygon
    with ``role: headland`` has the inner edge of a headland. The boundary may have ``edge: fence`` all round; a
    LineString along it with ``edge: fence`` or ``edge: open`` tells of one side, and one with ``role: guidance``, or
    with a name alone, is a line that tracks can be laid along. Heights are dropped and open rings closed.

    Raises:
        FieldError: the file cannot be read or does not describe one usable field.
    """
    source = source_of(str(where))
    label = f"'{source.name}'"
    document = told(source.document(), local, crs, swap, label)
    chosen = _choose(document, source.key, local, label)
    shape, frame = _outline(document, chosen, local, label)
    check_area(shape, label)
    several = len(document.polygons) > 1
    inside = polygons_inside(document, chosen, frame, shape) if several else []
    fences, odd = read_fences(chosen, document.edges, frame, shape, several, label)
    obstacles, away = _obstacles(document, frame, shape, several, label)
    grounds, elsewhere = _grounds(document, frame, shape, several, label)
    return Field(
        name=name or _name(chosen, source.name),
        boundary=shape,
        crs=frame.crs,
        origin_m=frame.origin_m,
        entrance=_one_place(document.entrances, "entrance", frame, shape, several, label),
        refill=_one_place(document.refills, "refill", frame, shape, several, label),
        grounds=grounds,
        default_ground=str(chosen.properties.get("default_ground") or "soil"),
        source=str(chosen.properties.get("source") or document.source),
        remarks=(*_remarks(document), *_inside_remark(len(inside)), *odd, *away, *elsewhere),
        obstacles=(*obstacles, *inside),
        fences=fences,
        lines=guidance_lines(document, frame, shape, several),
        headlands=headland_edges(document, frame, shape),
    )


def _remarks(document: Document) -> tuple[str, ...]:
    """What the reader of the form says, and a sentence on what the file holds and no plan uses."""
    if not document.unused:
        return document.notes
    counted = ", ".join(f"{count} {what}" for what, count in document.unused)
    return (
        *document.notes,
        f"Not used of the field file: {counted}; an obstacle has the role 'obstacle' or is a hole of the boundary, an "
        "entrance is a Point with role 'entrance' (a place to refill: 'refill'), a ground zone a Polygon with a "
        "'ground', a fence a LineString along the boundary with edge 'fence'.",
    )


def _inside_remark(polygons: int) -> tuple[str, ...]:
    """A sentence on polygons that are taken for obstacles though no role says so."""
    if not polygons:
        return ()
    inside = "A polygon" if polygons == 1 else f"{polygons} polygons"
    return (f"{inside} of the field file inside the field {'is' if polygons == 1 else 'are'} taken for obstacles.",)


@dataclass(frozen=True)
class Listed:
    """One of the fields of a file: how to choose it (`file#key`, or `file#position`), and how large it is.

    `area_ha` is without its `holes`; both are None where `fault` says in a sentence why the field cannot be used.
    """

    position: int
    key: str
    area_ha: float | None = None
    holes: int | None = None
    fault: str = ""


def list_fields(
    where: str | Path, *, local: bool = False, crs: str | None = None, swap: bool = False
) -> tuple[Listed, ...]:
    """Every field of a file or sample, in the order of the file; arguments as of `read_field`.

    Raises:
        FieldError: the file cannot be read or holds no field.
    """
    return survey(where, local=local, crs=crs, swap=swap)[0]


def survey(
    where: str | Path, *, local: bool = False, crs: str | None = None, swap: bool = False
) -> tuple[tuple[Listed, ...], tuple[str, ...]]:
    """The fields of a file as `list_fields` tells them, and what its reader left out or mended, in sentences."""
    source = source_of(str(where))
    document = told(source.document(), local, crs, swap, f"'{source.name}'")
    return tuple(_listed(document, position, local) for position in range(len(document.polygons))), document.notes


def _listed(document: Document, position: int, local: bool) -> Listed:
    raw = document.polygons[position]
    key = _printable(raw.keys[0]) if raw.keys else str(position)
    try:
        shape = _outline(document, raw, local, key)[0]
    except FieldError as fault:
        return Listed(position, key, fault=str(fault))
    return Listed(position, key, float(shape.area) / 1e4, len(shape.interiors))


def _choose(document: Document, key: str | None, local: bool, label: str) -> RawPolygon:
    """The polygon that is meant."""
    found = document.polygons
    if key is None:
        around = found[0] if len(found) == 1 else _around_all(document, local)
        if around is not None:
            return around
        raise FieldError(f"{label} holds {len(found)} fields; {_how_to_choose(document, local)}.", parameter="field")
    matches = [i for i, raw in enumerate(found) if key in raw.keys]
    if len(matches) > 1:
        places = ", ".join(f"#{i}" for i in matches)
        raise FieldError(f"'{key}' names {len(matches)} polygons of {label}; choose by position: {places}.")
    if matches:
        return found[matches[0]]
    if key.isdecimal() and len(key) < 10 and int(key) < len(found):
        return found[int(key)]
    raise FieldError(f"{label} has no field '{key}'; {_how_to_choose(document, local)}.", parameter="field")


def _around_all(document: Document, local: bool) -> RawPolygon | None:
    """The polygon that all others lie inside, if there is one."""
    for raw in document.polygons if len(document.polygons) <= LISTED else ():
        try:
            shape, frame = _outline(document, raw, local, "")
        except FieldError:
            continue
        if len(polygons_inside(document, raw, frame, shape)) == len(document.polygons) - 1:
            return raw
    return None


def _how_to_choose(document: Document, local: bool) -> str:
    """Names and areas of the fields in a file, and how to pick one."""
    most = range(min(len(document.polygons), LISTED))
    rows = []
    for one in (_listed(document, number, local) for number in most):
        rows.append(f"{one.key} ({'not usable' if one.area_ha is None else f'{one.area_ha:.2f} ha'})")
    rest = len(document.polygons) - len(rows)
    more = f" and {rest} more ({named('list_fields')} lists all)" if rest else ""
    return f"choose one by adding #ID or #position (from 0) to the file name: {', '.join(rows)}{more}"


def _outline(document: Document, raw: RawPolygon, local: bool, label: str) -> tuple[shapely.Polygon, Frame]:
    """Checked boundary in local metres, and the frame that led there."""
    parts = rings(raw.coordinates, label)
    frame = frame_of(document, parts, local, label)
    parts = [frame.unwrapped(part) for part in parts]
    polygon(parts, label)
    return polygon([frame.local(part) for part in parts], label), frame


def _grounds(
    document: Document, frame: Frame, shape: shapely.Polygon, several: bool, label: str
) -> tuple[tuple[GroundZone, ...], tuple[str, ...]]:
    """Ground zones in local metres, in the order of the file, and remarks on those far from the field."""
    zones, remarks = [], []
    for raw in document.zones:
        ground = str(raw.properties["ground"]).strip()
        parts = rings(raw.coordinates, f"ground zone '{ground}' of {label}")
        area = polygon([frame.local(part) for part in parts], f"ground zone '{ground}' of {label}")
        away_m = float(area.distance(shape))
        if not several or away_m <= NEAR_M:
            zones.append(GroundZone(ground, area))
        if not several and away_m > NEAR_M:
            remarks.append(f"Ground zone '{ground}' lies {away_m:.0f} m outside the field.")
    return tuple(zones), tuple(remarks)


def _obstacles(
    document: Document, frame: Frame, shape: shapely.Polygon, several: bool, label: str
) -> tuple[tuple[Obstacle, ...], tuple[str, ...]]:
    """Obstacles in local metres, in the order of the file, and remarks on those off the field."""
    read = [read_obstacle(raw, frame, label) for raw in document.obstacles]
    return on_field(read, shape, several, label)


def _one_place(
    places: tuple[Any, ...], role: str, frame: Frame, shape: shapely.Polygon, several: bool, label: str
) -> tuple[float, float] | None:
    """The one entrance of the field, or place to refill, in local metres, or None."""
    found = []
    for raw in places:
        what = f"{'an' if role == 'entrance' else 'a'} {role} of {label}"
        x, y = frame.local(np.array([position(raw, what)]))[0].tolist()
        if not several or shape.distance(shapely.Point(x, y)) <= NEAR_M:
            found.append((x, y))
    if len(found) > 1:
        raise FieldError(f"{label} has {len(found)} {role}s; keep one Point with role '{role}'.")
    return found[0] if found else None


def _name(raw: RawPolygon, stem: str) -> str:
    """Name for the field: its own, else its id, else that of the file."""
    properties: dict[str, Any] = raw.properties
    for key in ("name", "Name"):
        if isinstance(properties.get(key), str) and properties[key].strip():
            return _printable(properties[key].strip())
    return _printable(raw.keys[0] if raw.keys else stem)


def _printable(name: str) -> str:
    """A name out of a file for a terminal: what a terminal would obey is shown as a question mark."""
    return "".join(one if one.isprintable() else "?" for one in name)
