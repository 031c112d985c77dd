"""AgOpenGPS: a folder of text files in metres about the StartFix of Field.txt; fields are read, guidance is written.

The plane is `fields.geometry.geodesy.LocalPlane`, not UTM. Depending on the language of the computer, numbers have
decimal commas. Written points are as close as the program's own: it looks for the nearest one and offsets each by its
heading.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterator
from pathlib import PurePosixPath

import numpy as np
import shapely

from fields.arrays import Floats
from fields.errors import FieldError
from fields.formats.archive import ArchiveMembers, open_folder_or_archive
from fields.formats.features import Feature, build_document, build_feature
from fields.formats.guidance import (
    DegreePoints,
    FileContents,
    GuidanceFormat,
    GuidedLine,
    PlanGuidance,
    build_folder_name,
    simplify_to_ascii,
)
from fields.geometry.arithmetic import ROUNDING
from fields.geometry.geodesy import DEGREES_CRS, LocalPlane
from fields.raw_document import FieldDocument, FieldFormat
from fields.text_files import count_noun

FIELD_FILE, BOUNDARY_FILE, HEADLAND_FILE = "field.txt", "boundary.txt", "headland.txt"
TRACK_FILE = "tracklines.txt"
AB_MODE, CURVE_MODE = 2, 4
AB_LINE_LENGTH_M = 100.0
PLACEHOLDER_NAMES = ("FieldNew", "XML Derived", "KML Derived")
"""Names that the program writes for unnamed fields; the folder's name is used instead."""
NamedLine = tuple[str, list[tuple[float, float]]]
"""Name and points in metres of a guidance line."""
_SPACES = re.compile(r"\s+")
RING_SPACING_M, CURVE_SPACING_M = 5.0, 2.0
START_DECIMALS = 8
FIRST_LINE = "Headland"
"""First line of Field.txt, where the program writes the time of day but reads nothing."""


def _read_fields(path: str, label: str) -> FieldDocument:
    members = open_folder_or_archive(path)
    notes: list[str] = []
    features: list[Feature] = []
    for name in [one for one in members if one.lower().split("/")[-1] == FIELD_FILE]:
        features += _read_field_features(members, name, label, notes)
    if not features:
        raise FieldError(f"{label} has no field with a boundary; draw it in AgOpenGPS, or name another folder.")
    return build_document(features, label, crs=DEGREES_CRS, source="AgOpenGPS", notes=tuple(notes))


def _read_field_features(members: ArchiveMembers, field_file: str, label: str, notes: list[str]) -> list[Feature]:
    """Boundary, guidance lines and headland edges of the field with this Field.txt."""
    lines = split_lines(members[field_file])
    plane = parse_plane(lines, label)
    stated_name = next((after for line, after in itertools.pairwise(lines) if line == "$FieldDir"), "")
    folder = PurePosixPath(field_file).parent.name or members.path.resolve().name
    name = stated_name if stated_name and stated_name not in PLACEHOLDER_NAMES else folder
    rings = read_rings(members, field_file, BOUNDARY_FILE, plane, name, notes)
    if not rings:
        notes.append(f"'{name}' has no boundary and is skipped.")
        return []
    features = [build_feature("Polygon", rings, {"name": name, "role": "boundary"})]
    for file, parse_lines in LINE_FILES.items():
        unread_counts: list[int] = []
        file_lines = split_lines(members.read_member_beside(field_file, file) or b"")
        if file_lines and file_lines[0].startswith("$"):
            file_lines = file_lines[1:]
        named_lines = list(parse_lines(file_lines, unread_counts))
        if unread_counts:
            notes.append(f"Skipped in '{name}': {count_noun(sum(unread_counts), 'unreadable line')} of {file}.")
        features += [
            build_feature(
                "LineString", [plane.to_degrees(*point) for point in points], {"name": title, "role": "guidance"}
            )
            for title, points in named_lines
        ]
        if named_lines and file == TRACK_FILE:  # the same lines stay in the files of older versions of the program
            break
    edges = read_rings(members, field_file, HEADLAND_FILE, plane)  # rings without a headland have no points
    return [*features, *(build_feature("LineString", [*edge, edge[0]], {"role": "headland"}) for edge in edges)]


def read_rings(
    members: ArchiveMembers,
    field_file: str,
    file: str,
    plane: LocalPlane,
    name: str = "",
    notes: list[str] | None = None,
) -> list[list[list[float]]]:
    """Longitude and latitude of the rings in a file beside a Field.txt, the outer one first; none without the file.

    A ring is a count below lines of True or False, and that number of points.
    """
    lines = split_lines(members.read_member_beside(field_file, file) or b"")
    rings, place, short_rings, notes = [], 0, 0, [] if notes is None else notes
    while place < len(lines):
        count = _parse_count(lines[place])
        if count is None:
            place += 1
            continue
        valid_points = _parse_points(lines[place + 1 : place + 1 + count])
        if len(valid_points) < count:
            notes.append(f"A ring of '{name}' has {len(valid_points)} points, not {count} as stated; these are used.")
        if len(set(valid_points)) >= 3:
            rings.append([plane.to_degrees(*point) for point in valid_points])
        elif not rings and not short_rings:
            return []  # without its outer ring a field has no boundary
        else:
            short_rings += 1
        place += 1 + len(valid_points)
    if short_rings:
        notes.append(f"Skipped in '{name}': {count_noun(short_rings, 'ring')} with fewer than 3 points.")
    return rings


def parse_plane(lines: list[str], label: str) -> LocalPlane:
    """The plane with the origin in the line below StartFix of a Field.txt, latitude first; raises FieldError."""
    numbers_line = next((line for before, line in itertools.pairwise(lines) if before == "StartFix"), "")
    numbers = parse_numbers(numbers_line, 2)
    if numbers is None or abs(numbers[0]) > 90.0 or abs(numbers[1]) > 180.0:
        raise FieldError(f"Field.txt of {label} has no StartFix with latitude and longitude; save the field again.")
    return LocalPlane(numbers[1], numbers[0])


def _parse_track_lines(lines: list[str], unread_counts: list[int]) -> Iterator[NamedLine]:
    """TrackLines.txt: name, heading in radians, A, B, nudge, mode, visible, count and points, for every line.

    After a garbled entry the next one is searched line by line. A number of unreadable lines is appended to
    `unread_counts`.
    """
    place, garbled = 0, False
    while place < len(lines):
        head = lines[place : place + 8]
        ends = _parse_points(head[2:4])
        mode, count = (_parse_count(head[5]), _parse_count(head[7])) if len(head) == 8 else (None, None)
        if count is None or mode is None or len(ends) < 2 or head[6].lower() not in ("true", "false"):
            unread_counts += [] if garbled else [1]
            garbled, place = True, place + 1
            continue
        garbled, name = False, head[0]
        curve = _parse_points(lines[place + 8 : place + 8 + count])
        if mode == CURVE_MODE and len(curve) > 1:
            yield name, curve
        elif mode == AB_MODE:
            yield name, ends
        else:
            unread_counts.append(1)
        place += 8 + count


def _parse_old_ab_lines(lines: list[str], unread_counts: list[int]) -> Iterator[NamedLine]:
    """ABLines.txt: name, heading in degrees, easting and northing of a point, in one line."""
    for line in lines:
        name, _, numbers_text = line.partition(",")
        numbers = parse_numbers(numbers_text, 3)
        if numbers is not None:
            heading_rad, east, north = math.radians(numbers[0]), numbers[1], numbers[2]
            end = east + AB_LINE_LENGTH_M * math.sin(heading_rad), north + AB_LINE_LENGTH_M * math.cos(heading_rad)
            yield name, [(east, north), end]
        else:
            unread_counts.append(1)


def _parse_old_curves(lines: list[str], unread_counts: list[int]) -> Iterator[NamedLine]:
    """CurveLines.txt: name, heading in radians, count and points; reading ends at a garbled entry."""
    place = 0
    while place < len(lines):
        count = _parse_count(lines[place + 2]) if place + 2 < len(lines) else None
        if count is None:
            unread_counts.append(1)
            return
        curve = _parse_points(lines[place + 3 : place + 3 + count])
        if len(curve) > 1:
            yield lines[place], curve
        else:
            unread_counts.append(1)
        place += 3 + count


def parse_numbers(line: str, min_count: int) -> list[float] | None:
    """Numbers of a line, separated by commas (decimal commas join pairs of parts); None for fewer than `min_count`."""
    parts = [part for part in _SPACES.sub("", line).split(",") if part]
    if len(parts) >= 2 * min_count and all("." not in part for part in parts):
        parts = [f"{whole}.{rest}" for whole, rest in zip(parts[::2], parts[1::2], strict=False)]
    try:
        numbers = [float(part) for part in parts]
    except ValueError:
        return None
    return numbers if len(numbers) >= min_count and all(map(math.isfinite, numbers)) else None


LINE_FILES = {
    TRACK_FILE: _parse_track_lines,
    "curvelines.txt": _parse_old_curves,
    "ablines.txt": _parse_old_ab_lines,
}
"""What parses the guidance lines of a file, and of its two predecessors, without their first line."""


def _parse_points(lines: list[str]) -> list[tuple[float, float]]:
    """Points of lines that begin with two numbers; other lines are left out."""
    return [(numbers[0], numbers[1]) for line in lines if (numbers := parse_numbers(line, 2)) is not None]


def _parse_count(line: str) -> int | None:
    """An integer of up to 7 digits, None for anything else."""
    return int(line) if line.isascii() and line.isdecimal() and len(line) <= 7 else None


def split_lines(content: bytes) -> list[str]:
    """The lines of a file that are not empty."""
    text = content.decode("utf-8-sig", errors="replace")
    return [line.strip() for line in text.splitlines() if line.strip()]


FIELD_FORMAT = FieldFormat("AgOpenGPS", (), _read_fields, lambda names: FIELD_FILE in names)


def _write_agopengps(guidance: PlanGuidance) -> FileContents:
    tractor = guidance.tractors[0]
    name = build_folder_name(guidance.field, "Field") + (f" T{tractor.number}" if guidance.has_other_tractors else "")
    plane = _build_plane(guidance)
    rings = (
        () if guidance.boundary is None else (*guidance.boundary.rings, *(one.rings[0] for one in guidance.obstacles))
    )
    start = f"{plane.latitude_deg:.{START_DECIMALS}f},{plane.longitude_deg:.{START_DECIMALS}f}"
    files = {
        "Field.txt": [FIRST_LINE, "$FieldDir", name, "$Offsets", "0,0", "Convergence", "0", "StartFix", start],
        "Boundary.txt": ["$Boundary", *(row for ring in rings for row in ("False", *_format_ring(plane, ring)))],
        "Headland.txt": ["$Headland", *_format_headland(plane, guidance)],
        "TrackLines.txt": ["$TrackLines", *(row for line in tractor.lines for row in _format_line(plane, line))],
    }
    return {f"{name}/{file}": "\r\n".join([*rows, ""]).encode("utf-8") for file, rows in files.items()}


def _build_plane(guidance: PlanGuidance) -> LocalPlane:
    """The plane about the middle of the boundary, or of the lines without a boundary."""
    points = np.concatenate(
        [guidance.boundary.rings[0]] if guidance.boundary is not None else [one.points for one in guidance.lines]
    )
    first_deg = points[0, 0]
    east_deg = (points[:, 0] - first_deg + 180.0) % 360.0 - 180.0  # the shorter way across 180 degrees
    longitude = math.remainder(first_deg + 0.5 * (east_deg.min() + east_deg.max()), 360.0)
    latitude = 0.5 * (points[:, 1].min() + points[:, 1].max())
    return LocalPlane(round(float(longitude), START_DECIMALS), round(float(latitude), START_DECIMALS))


def _format_ring(plane: LocalPlane, ring: DegreePoints) -> list[str]:
    """Count and points of a ring, each with the direction from the point before to the point after."""
    corners = _convert_to_metres(plane, ring)
    points = _insert_points(np.concatenate([corners, corners[:1]]), RING_SPACING_M)[:-1]
    return _format_rows(points, np.roll(points, -1, axis=0) - np.roll(points, 1, axis=0))


def _format_headland(plane: LocalPlane, guidance: PlanGuidance) -> list[str]:
    """The headland edge of the outer ring of the boundary and of each inner one, 0 points without.

    The program has one edge per ring; if the headland divides the field, it is that of the largest part.
    """
    if guidance.boundary is None or not guidance.headland_interior:
        return []
    edges = max(
        guidance.headland_interior, key=lambda one: shapely.Polygon(_convert_to_metres(plane, one.rings[0])).area
    ).rings
    holes = [*guidance.boundary.rings[1:], *(one.rings[0] for one in guidance.obstacles)]
    rings = [_format_ring(plane, edges[0])]
    for hole in holes:
        surrounding = next((edge for edge in edges[1:] if shapely.contains_xy(shapely.Polygon(edge), *hole[0])), None)
        rings.append(["0"] if surrounding is None else _format_ring(plane, surrounding))
    return [row for rows in rings for row in rows]


def _format_line(plane: LocalPlane, line: GuidedLine) -> list[str]:
    """Name, heading in radians, A, B, nudge, mode, visible, and the points of a curve with their headings."""
    ends = _convert_to_metres(plane, line.points)
    heading = f"{_compute_headings_rad(ends[-1:] - ends[:1])[0]:.8f}"
    head = [simplify_to_ascii(line.name), heading, _format_point(ends[0]), _format_point(ends[-1]), "0"]
    if line.is_straight:
        return [*head, str(AB_MODE), "True", "0"]
    points = _insert_points(ends, CURVE_SPACING_M)
    steps = np.diff(points, axis=0)
    return [*head, str(CURVE_MODE), "True", *_format_rows(points, np.concatenate([steps, steps[-1:]]))]


def _convert_to_metres(plane: LocalPlane, points: DegreePoints) -> Floats:
    return np.array([plane.to_metres(longitude, latitude) for longitude, latitude in points.tolist()])


def _insert_points(points: Floats, spacing_m: float) -> Floats:
    """The points (n, 2) with intermediate points inserted, at most `spacing_m` apart."""
    dense = shapely.segmentize(shapely.LineString(points), spacing_m * (1.0 + ROUNDING))
    return np.asarray(shapely.get_coordinates(dense))


def _compute_headings_rad(vectors: Floats) -> Floats:
    """Directions (n,) of vectors (n, 2) clockwise from north, radians from 0 to 2 pi."""
    return np.arctan2(vectors[:, 0], vectors[:, 1]) % (2.0 * math.pi)


def _format_rows(points: Floats, directions: Floats) -> list[str]:
    """A count, and the points (n, 2) with the headings of directions (n, 2)."""
    headings = _compute_headings_rad(directions)
    rows = [f"{_format_point(point)},{heading:.5f}" for point, heading in zip(points, headings, strict=True)]
    return [str(len(points)), *rows]


def _format_point(point: Floats) -> str:
    return f"{point[0]:.3f},{point[1]:.3f}"


GUIDANCE_FORMAT = GuidanceFormat(
    "agopengps", "AgOpenGPS", _write_agopengps, per_tractor=True, names_tractors=True, unsupported_parts=("entrance",)
)
