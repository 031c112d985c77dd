"""AgOpenGPS: a folder of text files in metres about the StartFix of Field.txt, in a plane of the program's own.

The plane is that of `fields.plane`, not UTM. Numbers are written with a comma for a point where the computer's language
does so.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterator
from pathlib import PurePosixPath

from fields.document import Document, Format
from fields.errors import FieldError
from fields.formats.archive import Members, members_around
from fields.formats.features import Feature, document_of
from fields.formats.vector import WGS84
from fields.plane import Plane
from fields.reading import some

FIELD, BOUNDARY, HEADLAND = "field.txt", "boundary.txt", "headland.txt"
TRACKS = ("tracklines.txt", "curvelines.txt", "ablines.txt")
AB_MODE, CURVE_MODE = 2, 4
AB_LENGTH_M = 100.0
UNNAMED = ("FieldNew", "XML Derived", "KML Derived")
"""What the program writes for a name where it has none; the folder is called by it."""
Track = tuple[str, list[tuple[float, float]]]
"""Name and points in metres of a line of guidance."""
_SPACES = re.compile(r"\s+")


def _read(path: str, label: str) -> Document:
    members = members_around(path)
    notes: list[str] = []
    features: list[Feature] = []
    for name in [one for one in members if one.lower().split("/")[-1] == FIELD]:
        features += _field(members, name, label, notes)
    if not features:
        raise FieldError(f"{label} has no field with a boundary; draw one in AgOpenGPS, or name another folder.")
    return document_of(features, label, crs=WGS84, source="AgOpenGPS", notes=tuple(notes))


def _field(members: Members, main: str, label: str, notes: list[str]) -> list[Feature]:
    """Boundary and lines of the field whose Field.txt this is."""
    lines = _lines(members[main])
    plane = _plane(lines, label)
    said = next((after for line, after in itertools.pairwise(lines) if line == "$FieldDir"), "")
    folder = PurePosixPath(main).parent.name or members.path.resolve().name
    name = said if said and said not in UNNAMED else folder
    outline = members.beside(main, BOUNDARY)
    rings = [] if outline is None else _rings(_lines(outline), name, notes)
    if not rings:
        notes.append(f"'{name}' has no boundary and is left out.")
        return []
    coordinates = [[plane.degrees(*point) for point in ring] for ring in rings]
    features = [_feature("Polygon", coordinates, {"name": name, "role": "boundary"})]
    for file in TRACKS:
        content = members.beside(main, file)
        left: list[int] = []
        found = [] if content is None else list(_tracks(_lines(content), file, left))
        if left:
            notes.append(f"Left out of '{name}': {some(sum(left), 'line')} of {file} that cannot be read.")
        features += [
            _feature("LineString", [plane.degrees(*point) for point in points], {"name": title, "role": "guidance"})
            for title, points in found
        ]
    return [*features, *_headlands(members.beside(main, HEADLAND), plane)]


def _headlands(content: bytes | None, plane: Plane) -> list[Feature]:
    """Inner edges of headlands: rings as those of the boundary, of no points where a ring has none."""
    rings = [] if content is None else _rings(_lines(content), "", [])
    edges = [[plane.degrees(*point) for point in (*ring, ring[0])] for ring in rings]
    return [_feature("LineString", edge, {"role": "headland"}) for edge in edges]


def _plane(lines: list[str], label: str) -> Plane:
    """The origin that stands below StartFix, latitude first."""
    after = next((line for before, line in itertools.pairwise(lines) if before == "StartFix"), "")
    numbers = _numbers(after, 2)
    if numbers is None or abs(numbers[0]) > 90.0 or abs(numbers[1]) > 180.0:
        raise FieldError(f"Field.txt of {label} has no StartFix with latitude and longitude; save the field again.")
    return Plane(numbers[1], numbers[0])


def _rings(lines: list[str], name: str, notes: list[str]) -> list[list[tuple[float, float]]]:
    """Rings of Boundary.txt, the outer one first: lines of True or False, a count, and so many points."""
    rings, place, short = [], 0, 0
    while place < len(lines):
        count = _count(lines[place])
        if count is None:
            place += 1
            continue
        points = [_numbers(line, 2) for line in lines[place + 1 : place + 1 + count]]
        whole = [(one[0], one[1]) for one in points if one is not None]
        if len(whole) < count:
            notes.append(f"A ring of '{name}' says {count} points and has {len(whole)}; those are taken.")
        if len(set(whole)) >= 3:
            rings.append(whole)
        elif not rings and not short:
            return []  # without its outer ring a field has no boundary
        else:
            short += 1
        place += 1 + len(whole)
    if short:
        notes.append(f"Left out of '{name}': {some(short, 'ring')} with fewer than 3 points.")
    return rings


def _tracks(lines: list[str], file: str, left: list[int]) -> Iterator[Track]:
    """Names and points of the lines of a file: TrackLines.txt of today, or the two files that came before it.

    How many lines of guidance could not be read is put into `left`.
    """
    lines = lines[1:] if lines and lines[0].startswith("$") else lines
    if file == "ablines.txt":
        yield from _old_ab(lines, left)
    elif file == "curvelines.txt":
        yield from _old_curves(lines, left)
    else:
        yield from _track_lines(lines, left)


def _track_lines(lines: list[str], left: list[int]) -> Iterator[Track]:
    """Name, heading in radians, A, B, nudge, mode, visible, count and points, one after the other.

    After one that is garbled the next is looked for line by line.
    """
    place, garbled = 0, False
    while place < len(lines):
        head = lines[place : place + 8]
        ends = [_numbers(line, 2) for line in head[2:4]]
        mode, count = (_count(head[5]), _count(head[7])) if len(head) == 8 else (None, None)
        if count is None or mode is None or None in ends or head[6].lower() not in ("true", "false"):
            left += [] if garbled else [1]
            garbled, place = True, place + 1
            continue
        garbled, name = False, head[0]
        points = [_numbers(line, 2) for line in lines[place + 8 : place + 8 + count]]
        curve = [(one[0], one[1]) for one in points if one is not None]
        if mode == CURVE_MODE and len(curve) > 1:
            yield name, curve
        elif mode == AB_MODE:
            yield name, [(one[0], one[1]) for one in ends if one is not None]
        else:
            left.append(1)
        place += 8 + count


def _old_ab(lines: list[str], left: list[int]) -> Iterator[Track]:
    """ABLines.txt: name, heading in degrees, easting and northing of a point, all in one line."""
    for line in lines:
        name, _, rest = line.partition(",")
        numbers = _numbers(rest, 3)
        if numbers is not None:
            turn, east, north = math.radians(numbers[0]), numbers[1], numbers[2]
            yield name, [(east, north), (east + AB_LENGTH_M * math.sin(turn), north + AB_LENGTH_M * math.cos(turn))]
        else:
            left.append(1)


def _old_curves(lines: list[str], left: list[int]) -> Iterator[Track]:
    """CurveLines.txt: name, heading in radians, count, points; what follows a garbled one is not looked for."""
    place = 0
    while place < len(lines):
        count = _count(lines[place + 2]) if place + 2 < len(lines) else None
        if count is None:
            left.append(1)
            return
        points = [_numbers(line, 2) for line in lines[place + 3 : place + 3 + count]]
        curve = [(one[0], one[1]) for one in points if one is not None]
        if len(curve) > 1:
            yield lines[place], curve
        else:
            left.append(1)
        place += 3 + count


def _numbers(line: str, least: int) -> list[float] | None:
    """Numbers of a line between commas; where commas are also points of numbers, of pairs put together."""
    parts = [part for part in _SPACES.sub("", line).split(",") if part]
    if len(parts) >= 2 * least and all("." not in part for part in parts):
        parts = [f"{whole}.{rest}" for whole, rest in zip(parts[::2], parts[1::2], strict=False)]
    try:
        numbers = [float(part) for part in parts]
    except ValueError:
        return None
    return numbers if len(numbers) >= least and all(map(math.isfinite, numbers)) else None


def _count(line: str) -> int | None:
    """A whole number of a few digits, None for anything else."""
    return int(line) if line.isascii() and line.isdecimal() and len(line) <= 7 else None


def _lines(content: bytes) -> list[str]:
    text = content.decode("utf-8-sig", errors="replace")
    return [line.strip() for line in text.splitlines() if line.strip()]


def _feature(kind: str, coordinates: object, properties: dict[str, str]) -> Feature:
    return {"type": "Feature", "properties": properties, "geometry": {"type": kind, "coordinates": coordinates}}


def plane_of(content: bytes, label: str) -> Plane:
    """The plane that a Field.txt sets; raises FieldError."""
    return _plane(_lines(content), label)


def outline_of(members: Members, main: str, plane: Plane) -> list[list[list[float]]]:
    """Longitude and latitude of the rings of the field whose Field.txt is `main`; nothing without a boundary."""
    content = members.beside(main, BOUNDARY)
    rings = [] if content is None else _rings(_lines(content), "", [])
    return [[plane.degrees(*point) for point in ring] for ring in rings]


def lines_of(content: bytes) -> list[str]:
    """The lines of a file of the program that hold anything."""
    return _lines(content)


def numbers_of(line: str, least: int) -> list[float] | None:
    """Numbers of a line, with decimal points or commas; None for fewer than `least`."""
    return _numbers(line, least)


FORMAT = Format("AgOpenGPS", (), _read, lambda names: FIELD in names)
