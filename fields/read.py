"""Read a field from a sample or from a GeoJSON file (RFC 7946)."""

from __future__ import annotations

import difflib
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from fields.document import Document, RawPolygon, parse
from fields.errors import FieldError
from fields.field import Field, GroundZone
from fields.frame import Frame, frame_of
from fields.outline import check_area, polygon, position, rings
from fields.samples_index import sample_names, sample_text
from fields.write import write_field

__all__ = ["read_field", "sample_names", "write_field"]

NEAR_M = 50.0
"""In a file of several fields, ground zones and entrances this near belong to the chosen one."""
LISTED = 12


def read_field(where: str | Path, *, local: bool = False, name: str | None = None) -> Field:
    """Read one field.

    Args:
        where: name of a sample field, or a GeoJSON file with a Polygon, MultiPolygon, Feature or
            FeatureCollection. ``file.geojson#KEY`` chooses one of several polygons by feature id,
            properties id, name, or 0-based position among the polygons, in this order.
        local: the coordinates are local metres; otherwise they are longitude and latitude unless the file
            itself names another system.
        name: name for the field; otherwise taken from the file.

    A Point whose properties have ``role: entrance`` is the entrance; polygons whose properties have a
    ``ground`` are ground zones. Heights are dropped and open rings closed.

    Raises:
        FieldError: the file cannot be read or does not describe one usable field.
    """
    text, stem, key = _open(str(where))
    label = f"'{stem}'"
    document = parse(text, label)
    chosen = _choose(document, key, local, label)
    shape, frame = _outline(document, chosen, local, label)
    check_area(shape, label)
    several = len(document.polygons) > 1
    return Field(
        name=name or _name(chosen, stem),
        boundary=shape,
        crs=frame.crs,
        origin_m=frame.origin_m,
        entrance=_entrance(document, frame, shape, several, label),
        grounds=_grounds(document, frame, shape, several, label),
        default_ground=str(chosen.properties.get("default_ground") or "soil"),
        source=str(chosen.properties.get("source") or document.source),
    )


def _open(where: str) -> tuple[str, str, str | None]:
    """Text, short name and chosen key of what the caller names."""
    place, mark, key = where.rpartition("#") if "#" in where and not Path(where).exists() else (where, "", "")
    if place in sample_names():
        return sample_text(place), place, key if mark else None
    path = Path(place)
    if not path.is_file():
        raise FieldError(_missing(place))
    try:
        return path.read_bytes().decode("utf-8-sig"), path.stem, key if mark else None
    except UnicodeDecodeError as error:
        raise FieldError(f"'{place}' is not text in UTF-8; give a GeoJSON file.") from error
    except OSError as error:
        raise FieldError(f"'{place}' cannot be read ({error.strerror}); check its permissions.") from error


def _missing(place: str) -> str:
    """What to say about a name that is neither a sample nor a file."""
    if Path(place).is_dir():
        return f"'{place}' is a folder; name one GeoJSON file in it."
    names = sample_names()
    near = difflib.get_close_matches(Path(place).stem.lower(), names, n=1, cutoff=0.0)[0]
    return f"There is no field file '{place}'; the nearest of the samples {', '.join(names)} is '{near}'."


def _choose(document: Document, key: str | None, local: bool, label: str) -> RawPolygon:
    """The polygon that is meant."""
    found = document.polygons
    if key is None:
        if len(found) == 1:
            return found[0]
        raise FieldError(f"{label} holds {len(found)} fields; {_how_to_choose(document, local)}.")
    matches = [i for i, raw in enumerate(found) if key in raw.keys]
    if len(matches) > 1:
        places = ", ".join(f"#{i}" for i in matches)
        raise FieldError(f"'{key}' names {len(matches)} polygons of {label}; choose by position: {places}.")
    if matches:
        return found[matches[0]]
    if key.isdecimal() and int(key) < len(found):
        return found[int(key)]
    raise FieldError(f"{label} has no field '{key}'; {_how_to_choose(document, local)}.")


def _how_to_choose(document: Document, local: bool) -> str:
    """Names and areas of the fields in a file, and how to pick one."""
    rows = []
    for i, raw in enumerate(document.polygons[:LISTED]):
        title = raw.keys[0] if raw.keys else str(i)
        try:
            area = f"{_outline(document, raw, local, title)[0].area / 1e4:.2f} ha"
        except FieldError:
            area = "not usable"
        rows.append(f"{title} ({area})")
    rest = len(document.polygons) - len(rows)
    more = f" and {rest} more" if rest else ""
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
) -> tuple[GroundZone, ...]:
    """Ground zones in local metres, in the order of the file."""
    zones = []
    for raw in document.zones:
        ground = str(raw.properties["ground"]).strip()
        parts = rings(raw.coordinates, f"ground zone '{ground}' of {label}")
        area = polygon([frame.local(part) for part in parts], f"ground zone '{ground}' of {label}")
        if not several or area.distance(shape) <= NEAR_M:
            zones.append(GroundZone(ground, area))
    return tuple(zones)


def _entrance(
    document: Document, frame: Frame, shape: shapely.Polygon, several: bool, label: str
) -> tuple[float, float] | None:
    """The one entrance of the field in local metres, or None."""
    found = []
    for raw in document.entrances:
        x, y = frame.local(np.array([position(raw, f"an entrance of {label}")]))[0].tolist()
        if not several or shape.distance(shapely.Point(x, y)) <= NEAR_M:
            found.append((x, y))
    if len(found) > 1:
        raise FieldError(f"{label} has {len(found)} entrances; keep one Point with role 'entrance'.")
    return found[0] if found else None


def _name(raw: RawPolygon, stem: str) -> str:
    """Name for the field: its own, else its id, else that of the file."""
    properties: dict[str, Any] = raw.properties
    for key in ("name", "Name"):
        if isinstance(properties.get(key), str) and properties[key].strip():
            return str(properties[key]).strip()
    return raw.keys[0] if raw.keys else stem
