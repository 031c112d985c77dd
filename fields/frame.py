"""From the numbers of a file to local metres: which system they are in, and where the origin goes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import shapely

from fields.document import LOCAL, WGS84, Document
from fields.errors import FieldError, named
from fields.projection import is_longitude_latitude, project, utm_crs

FloatArray = npt.NDArray[np.float64]

WIDEST_DEG = 1.0
FAR_M = 100_000.0
"""Local metres beyond this are moved to an origin of their own, to keep digits for the simulation."""


@dataclass(frozen=True)
class Frame:
    """How the numbers of one file become local metres.

    Attributes:
        given: system of the numbers; None for local metres.
        crs: UTM system of the field; None for local metres.
        origin_m: easting and northing subtracted afterwards.
        crosses_180: longitudes below zero are counted on from 180 degrees.
    """

    given: str | None
    crs: str | None
    origin_m: tuple[float, float]
    crosses_180: bool = False

    def local(self, points: FloatArray) -> FloatArray:
        """Points of shape (n, 2) of the file in local metres."""
        if self.given is not None and self.crs is not None:
            points = project(self.unwrapped(points), self.given, self.crs)
        return np.asarray(points - np.asarray(self.origin_m))

    def unwrapped(self, points: FloatArray) -> FloatArray:
        """Longitudes without a jump at 180 degrees."""
        if not self.crosses_180:
            return points
        x, y = points.T
        return np.column_stack([np.where(x < 0.0, x + 360.0, x), y])


def frame_of(document: Document, rings: list[FloatArray], local: bool, label: str) -> Frame:
    """The frame for a field with these rings (file coordinates, outer ring first).

    Raises:
        FieldError: degrees were announced as metres or the other way round, the announced and the named
            system contradict each other, or the header is damaged.
    """
    if local and document.crs is not None:
        raise FieldError(f"{label} is in the system {document.crs}, not in local metres; leave out {named('local')}.")
    if local and document.frame == WGS84:
        raise FieldError(f"{label} says that it is in longitude and latitude; leave out {named('local')}.")
    if document.crs is None and (local or document.frame == LOCAL):
        return _local_frame(document, rings[0], label)
    given = document.crs or "EPSG:4326"
    if document.crs is not None and not is_longitude_latitude(given):
        degrees = [project(ring, given, "EPSG:4326") for ring in rings]
        return _earth_frame(document, given, rings, degrees, label)
    _check_degrees(rings[0], label)
    return _earth_frame(document, "EPSG:4326", rings, rings, label)


def _local_frame(document: Document, outer: FloatArray, label: str) -> Frame:
    small = np.ptp(outer, axis=0).max() < WIDEST_DEG
    if small and (np.abs(outer) <= (180.0, 90.0)).all():
        x, y = outer[0]
        raise FieldError(
            f"Coordinates of {label} such as ({x:g}, {y:g}) look like degrees; leave out {named('local')}."
        )
    origin = _stored_origin(document, label)
    if origin is None:
        far = np.abs(outer).max() > FAR_M
        origin = _whole_metres(outer) if far else (0.0, 0.0)
    return Frame(None, None, origin)


def _earth_frame(
    document: Document, given: str, rings: list[FloatArray], degrees: list[FloatArray], label: str
) -> Frame:
    """Frame of a field with a place on the earth: UTM zone and origin from its centroid."""
    crosses = bool(np.ptp(degrees[0][:, 0]) > 180.0)
    wrap = Frame(None, None, (0.0, 0.0), crosses)
    centre = shapely.Polygon(wrap.unwrapped(degrees[0])).centroid
    stored = document.header.get("crs")
    crs = _stored_crs(stored, label) if stored is not None else utm_crs(centre.x, centre.y)
    plain = Frame(given, crs, (0.0, 0.0), crosses and degrees is rings)
    origin = _stored_origin(document, label) or _whole_metres(plain.local(rings[0]))
    return Frame(given, crs, origin, plain.crosses_180)


def _check_degrees(outer: FloatArray, label: str) -> None:
    """Refuse metres, and latitude before longitude, in a file that should hold degrees."""
    x, y = outer[np.argmax(np.abs(outer).max(axis=1))]
    span = np.ptp(outer, axis=0)
    if np.abs(outer[:, 0]).max() > 180.0 or np.abs(outer[:, 1]).max() > 90.0:
        swapped = (np.abs(outer) <= (90.0, 180.0)).all() and span.max() < WIDEST_DEG
        turned = f"look like latitude before longitude; exchange them with {named('swap')}"
        fix = turned if swapped else f"look like metres; add {named('local')}"
        raise FieldError(f"Coordinates of {label} such as ({x:g}, {y:g}) {fix}.")
    wide = min(span[0], 360.0 - span[0]) if span[0] > 180.0 else span[0]
    if max(wide, span[1]) > WIDEST_DEG:
        raise FieldError(
            f"The boundary of {label} spans {wide:g} by {span[1]:g} degrees, too much for a field; "
            f"if these are metres add {named('local')}."
        )


def _stored_crs(stored: Any, label: str) -> str:
    """The UTM code that a written file carries, so that reading it again gives the same metres."""
    code = stored.removeprefix("EPSG:") if isinstance(stored, str) else ""
    if not (code.isdecimal() and (32601 <= int(code) <= 32660 or 32701 <= int(code) <= 32760)):
        raise FieldError(f"The system {stored!r} stored in {label} is not UTM; use one such as 'EPSG:32654'.")
    return f"EPSG:{code}"


def _stored_origin(document: Document, label: str) -> tuple[float, float] | None:
    stored = document.header.get("origin_m")
    if stored is None:
        return None
    numbers = stored if isinstance(stored, list) else []
    good = all(isinstance(n, int | float) and not isinstance(n, bool) and abs(n) < 1e8 for n in numbers)
    if len(numbers) != 2 or not good:
        raise FieldError(f"The origin_m {stored!r} stored in {label} is not usable; write [easting, northing].")
    return float(numbers[0]), float(numbers[1])


def _whole_metres(outer: FloatArray) -> tuple[float, float]:
    """The centroid of a ring in whole metres."""
    centre = shapely.Polygon(outer).centroid
    return float(round(centre.x)), float(round(centre.y))
