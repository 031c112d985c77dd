"""The guidance of a plan, formats of guidance files, and what their writers share: segments, names, ZIP archives."""

from __future__ import annotations

import io
import math
import re
import unicodedata
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
import shapely

from fields.arrays import Floats
from fields.geometry.arithmetic import CURVE_M
from fields.geometry.geodesy import LocalPlane
from fields.text_files import WINDOWS_DEVICE

DegreePoints = Floats
"""Longitude and latitude (WGS 84) of points, (n, 2). Rings do not repeat their first point."""
SWATH, HEADLAND_PASS = "track", "round"
DEGREE_DECIMALS = 9
"""Of written degrees: a tenth of a millimetre."""
MAX_SEGMENTS = 8
"""Curves with more segments are dropped: no driver selects that many lines on the way."""
SEGMENT_LETTERS = "abcdefgh"

FileContents = Mapping[str, bytes]
"""Contents by path inside the folder that is written, with ``/`` between folders."""

MAX_DESIGNATOR_BYTES = 32
"""The longest designator of ISO 11783-10."""
MAX_FOLDER_LETTERS = 60
_ASCII_LETTERS = str.maketrans({
    "ß": "ss", "ø": "o", "Ø": "O", "æ": "ae", "Æ": "AE", "œ": "oe", "Œ": "OE", "ł": "l", "Ł": "L", "đ": "d", "Đ": "D",
    "þ": "th", "Þ": "Th",
    "\N{LATIN SMALL LETTER DOTLESS I}": "i",
})  # fmt: skip
_FORBIDDEN_IN_FOLDERS = re.compile(r"[<>:\"/\\|?*]+")
ZIP_MEDIA_TYPE = "application/zip"


@dataclass(frozen=True, eq=False)
class GuidedLine:
    """A line that a tractor drives with its implement down, from its first point to its last.

    `order` counts the lines of a tractor in driving order from 1. `kind` is SWATH or HEADLAND_PASS, `description` says
    which one, as ``track 14a`` or ``round 2 side 3``; `name` contains all of this and is unique within a plan.
    `bearing_deg` is from the first to the last point, clockwise from true north. A straight line has two points.
    """

    name: str
    tractor: int
    order: int
    kind: str
    description: str
    points: DegreePoints
    length_m: float
    bearing_deg: float

    @property
    def driving_position(self) -> tuple[int, int]:
        """Tractor and order; the segments of a curve share theirs."""
        return self.tractor, self.order

    @property
    def is_straight(self) -> bool:
        """Whether it is a straight line from A to B."""
        return len(self.points) == 2


@dataclass(frozen=True, eq=False)
class GuidanceArea:
    """The rings of a polygon, the outer one first, and its name."""

    name: str
    rings: tuple[DegreePoints, ...]

    @property
    def closed_rings(self) -> tuple[DegreePoints, ...]:
        """Its rings, each with its first point repeated at its end."""
        return tuple(np.concatenate([ring, ring[:1]]) for ring in self.rings)


@dataclass(frozen=True, eq=False)
class TractorLines:
    """The lines of one tractor, counted from 1, in driving order, and its colour on maps as ``#rrggbb``."""

    number: int
    colour: str
    lines: tuple[GuidedLine, ...]


@dataclass(frozen=True, eq=False)
class PlanGuidance:
    """The guidance of a plan on one field.

    `boundary` is None if the plan was saved without it; `headland_interior` is the ground inside the headland passes.
    `area_m2` is the area of the boundary without its holes. `has_other_tractors` says whether the plan has more
    tractors than `tractors`, so that file names must tell them apart. `left_out` has the parts of the plan that are not
    guidance, each a description and a count.
    """

    field: str
    boundary: GuidanceArea | None
    area_m2: float
    headland_interior: tuple[GuidanceArea, ...]
    obstacles: tuple[GuidanceArea, ...]
    entrance: tuple[float, float] | None
    tractors: tuple[TractorLines, ...]
    has_other_tractors: bool
    left_out: tuple[tuple[str, int], ...] = ()

    @property
    def lines(self) -> tuple[GuidedLine, ...]:
        """All lines, by tractor and in driving order."""
        return tuple(line for each in self.tractors for line in each.lines)

    def list_tractor_guidances(self) -> tuple[PlanGuidance, ...]:
        """The guidance of every single tractor."""
        return tuple(replace(self, tractors=(each,)) for each in self.tractors)


def cut_curves_into_segments(guidance: PlanGuidance) -> PlanGuidance:
    """The guidance in straight lines, for terminals without curves: curves of few segments are cut, others dropped.

    Segments have the order of their curve, and its name with a letter after the number: ``T1 03b round 1 side 2``.
    """
    tractors = tuple(
        replace(each, lines=tuple(one for line in each.lines for one in _cut_curve_into_segments(line)))
        for each in guidance.tractors
    )
    return replace(guidance, tractors=tractors)


def _cut_curve_into_segments(line: GuidedLine) -> tuple[GuidedLine, ...]:
    """A straight line itself, the segments of a curve, or nothing for a curve with too many."""
    if line.is_straight:
        return (line,)
    plane = LocalPlane(*line.points[0].tolist())
    metres = np.array([plane.to_metres(*point) for point in line.points.tolist()])
    simplified_m = shapely.get_coordinates(shapely.linestrings(metres).simplify(CURVE_M, preserve_topology=False))
    steps = np.diff(simplified_m, axis=0)
    if not 1 <= len(steps) <= MAX_SEGMENTS:
        return ()
    corners = np.array([plane.to_degrees(*point) for point in simplified_m.tolist()])
    start = f"T{line.tractor} "
    number, _, description = line.name.removeprefix(start).partition(" ")
    return tuple(
        replace(
            line,
            name=f"{start}{number}{SEGMENT_LETTERS[place]} {description}" if len(steps) > 1 else line.name,
            points=corners[place : place + 2],
            length_m=math.hypot(east_m, north_m),
            bearing_deg=math.degrees(math.atan2(east_m, north_m)) % 360.0,
        )
        for place, (east_m, north_m) in enumerate(steps.tolist())
    )


@dataclass(frozen=True)
class GuidanceFormat:
    """A format of guidance files.

    Attributes:
        name: its name in options.
        title: its usual name.
        write: builds the files of a guidance; if `per_tractor`, of a single tractor.
        extension: of its only file, "" for a folder of several.
        media_type: of that file, or of the archive of a folder.
        per_tractor: the format has no tractors, so each gets its own files.
        names_tractors: paths of files name the tractor; otherwise each tractor has a folder T1, T2, ...
        takes_curves: terminals accept curves, so they are written by default.
        older: name of the format for older terminals, which read straight lines only; "" for none.
        unsupported_parts: parts of a guidance that it cannot store.
    """

    name: str
    title: str
    write: Callable[[PlanGuidance], FileContents]
    extension: str = ""
    media_type: str = "application/zip"
    per_tractor: bool = False
    names_tractors: bool = False
    takes_curves: bool = True
    older: str = ""
    unsupported_parts: tuple[str, ...] = ()


def simplify_to_ascii(name: str) -> str:
    """A name in printable ASCII, letters with accents simplified and other characters dropped; possibly ""."""
    letters = unicodedata.normalize("NFKD", name.translate(_ASCII_LETTERS)).encode("ascii", "ignore").decode("ascii")
    return " ".join("".join(letter if letter.isprintable() else " " for letter in letters).split())


def build_designator(name: str, fallback: str) -> str:
    """A name of at most `MAX_DESIGNATOR_BYTES` bytes, cut if necessary; the fallback if nothing is left."""
    return simplify_to_ascii(name)[:MAX_DESIGNATOR_BYTES].strip() or fallback


def build_folder_name(name: str, fallback: str) -> str:
    """A folder name for every file system; the fallback if nothing is left."""
    folder = _FORBIDDEN_IN_FOLDERS.sub(" ", simplify_to_ascii(name))
    folder = " ".join(folder.split())[:MAX_FOLDER_LETTERS].strip(" .")
    return f"{fallback} {folder}".strip() if not folder or WINDOWS_DEVICE.match(folder) else folder


def zip_files(files: FileContents, mode: int = 0o644, compression: int = zipfile.ZIP_DEFLATED) -> bytes:
    """A ZIP archive in the order of the files, unpacked with that mode; the same bytes for the same files."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, content in files.items():
            entry = zipfile.ZipInfo(name)  # of the earliest time there is, so that archives are reproducible
            entry.compress_type, entry.external_attr = compression, mode << 16
            archive.writestr(entry, content)
    return buffer.getvalue()
