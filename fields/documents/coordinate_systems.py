"""Corrections of coordinates that the user gives (system, swapped axes), and warnings where axes seem to be swapped.

A field in the sea is refused where it is read (`fields.geometry.coordinates`). Here it is compared with other features
of the same file; two countries at mirrored positions cannot be told apart.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from fields.errors import FieldError, attach_parameter, join_first, mark_parameter, shorten_middle
from fields.geometry.coordinates import parse_position
from fields.geometry.geodesy import is_wgs84_longitude_latitude
from fields.raw_document import LOCAL_METRES, UNKNOWN_CRS, WGS84, FieldDocument

MAX_NEAR_DEG, MIN_FAR_DEG = 1.0, 2.0
"""Features of one farm are at most the first apart; a misplaced one is farther than the second from all others."""
MAX_COMPARED_FIELDS = 2_000
SHAPE_MEMBERS = (
    "polygons", "zones", "obstacles", "unassigned", "boundary_edges", "guidance_lines", "headland_edges",
)  # fmt: skip


def describe_swapped_axes(document: FieldDocument, axes_swapped: bool) -> tuple[str, ...]:
    """Sentences on fields whose axes seem to be swapped; `axes_swapped` says whether the user has swapped them."""
    is_degrees = document.crs is None or document.crs == WGS84 or is_wgs84_longitude_latitude(document.crs)
    if not is_degrees or document.frame == LOCAL_METRES or len(document.polygons) > MAX_COMPARED_FIELDS:
        return ()
    drawn_lines = (*document.guidance_lines, *document.headland_edges)
    fields = np.array([_find_first_point(one.coordinates) for one in document.polygons])
    lines = np.array([_find_first_point(one.coordinates) for one in drawn_lines]).reshape(-1, 2)
    suspects = [place for place in range(len(fields)) if _is_far_from_others(place, fields, lines)]
    if not suspects:
        return ()
    x, y = fields[suspects[0]]
    named = join_first([f"'{document.polygons[place].key}'" for place in suspects])
    fix = "leave out the option swap axes" if axes_swapped else "try the option swap axes"
    return (
        f"{named}: latitude {y:.2f}, longitude {x:.2f} is far from everything else in the file; "
        f"longitude and latitude seem to be swapped, so {fix}.",
    )


def _is_far_from_others(place: int, fields: npt.NDArray[np.float64], lines: npt.NDArray[np.float64]) -> bool:
    """Whether a field is far from all others, but near some with its axes swapped; up to two fields are compared with
    the lines of the file, as of two distant fields either may be the wrong one.
    """
    others = np.delete(fields, place, axis=0) if len(fields) > 2 else lines
    others = others[np.isfinite(others).all(axis=1)]
    if not len(others) or not np.isfinite(fields[place]).all():
        return False
    distance_deg = np.abs(others - fields[place]).max(axis=1)
    swapped_distance_deg = np.abs(others - fields[place][::-1]).max(axis=1)
    return bool(distance_deg.min() > MIN_FAR_DEG and swapped_distance_deg.min() < MAX_NEAR_DEG)


def _find_first_point(raw: Any) -> tuple[float, float]:
    """The first position in nested lists of coordinates; NaN if it is not a position."""
    while isinstance(raw, list) and raw and isinstance(raw[0], list):
        raw = raw[0]
    try:
        return parse_position(raw, "")
    except FieldError:
        return math.nan, math.nan


def apply_coordinate_options(
    document: FieldDocument, local: bool, crs: str | None, swap_axes: bool, label: str
) -> FieldDocument:
    """The document with the coordinate system that the user named, and x and y swapped if requested.

    A note is added if the resulting axes still seem to be swapped. With `local` the numbers are metres, and no system
    is needed.

    Raises:
        FieldError: neither the file nor the user names a system, or the named one is unknown or contradicts the file.
    """
    if crs is not None:
        _check_crs(document, crs, label)
        document = replace(document, crs=crs)
    elif document.crs == UNKNOWN_CRS and local:
        document = replace(document, crs=None)
    elif document.crs == UNKNOWN_CRS and document.is_shape:
        raise FieldError(
            f"{label} has no coordinate system; add {mark_parameter('crs')}='EPSG:4326' if its numbers are longitude "
            f"and latitude, another code if they are of a map grid, or {mark_parameter('local')}=True if they are "
            "metres without a place on the earth.",
            parameter="crs",
        )
    elif document.crs == UNKNOWN_CRS:
        raise FieldError(
            f"{label} does not name its coordinate system (a Shapefile has it in a .prj file); add it, or name it with "
            f"{mark_parameter('crs')}, such as EPSG:25832 or EPSG:4326.",
            parameter="crs",
        )
    corrected = _swap_document_axes(document) if swap_axes else document
    return replace(corrected, notes=(*corrected.notes, *describe_swapped_axes(corrected, swap_axes)))


def _check_crs(document: FieldDocument, crs: str, label: str) -> None:
    """Refuse a system that is unknown, contradicts the file or does not fit its numbers."""
    if not crs.strip():
        raise FieldError(
            f"{mark_parameter('crs')} is empty; name a system such as EPSG:25832, or leave it out.", parameter="crs"
        )
    with attach_parameter("crs"):
        is_degrees = is_wgs84_longitude_latitude(crs)
    frame_names = {None: document.crs, LOCAL_METRES: "local metres", WGS84: "longitude and latitude"}
    stated_system = frame_names[document.frame]
    if stated_system not in (UNKNOWN_CRS, None, crs):
        shown = shorten_middle(str(stated_system), 40, 0)
        raise FieldError(
            f"{label} is in {shown} by its own header; leave out {mark_parameter('crs')} {crs}.", parameter="crs"
        )
    x, y = _find_first_point(document.polygons[0].coordinates)
    if not is_degrees and abs(x) <= 180.0 and abs(y) <= 180.0:
        raise FieldError(
            f"Coordinates of {label} such as ({x:g}, {y:g}) look like degrees; "
            f"leave out {mark_parameter('crs')} {crs}.",
            parameter="crs",
        )


def _swap_document_axes(document: FieldDocument) -> FieldDocument:
    swapped: dict[str, Any] = {
        name: tuple(replace(one, coordinates=_swap_positions(one.coordinates)) for one in getattr(document, name))
        for name in SHAPE_MEMBERS
    }
    swapped |= {name: tuple(map(_swap_positions, getattr(document, name))) for name in ("entrances", "service_points")}
    return replace(document, axes_swapped=True, **swapped)


def _swap_positions(raw: Any) -> Any:
    """Nested lists of coordinates with the first two numbers of every position swapped."""
    if not isinstance(raw, list):
        return raw
    if len(raw) >= 2 and not isinstance(raw[0], list):
        return [raw[1], raw[0], *raw[2:]]
    return [_swap_positions(each) for each in raw]
