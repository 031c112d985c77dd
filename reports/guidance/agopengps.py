"""AgOpenGPS: a folder for every tractor, in metres about the StartFix of its Field.txt (see `fields.plane`).

Points are put so close as the program's own are: it looks for the nearest one and offsets each by its heading.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import shapely

from fields.plane import Plane
from reports.guidance.form import Files, Form
from reports.guidance.lines import Degrees, Guidance, Line
from reports.guidance.names import folder_name, plain

AB_MODE, CURVE_MODE = 2, 4
RING_APART_M, CURVE_APART_M = 5.0, 2.0
START_DECIMALS = 8
HEAD = "Headland"
"""Stands in the first line of Field.txt, where the program writes the time of day and reads nothing."""

Metres = list[tuple[float, float]]


def _write(guidance: Guidance) -> Files:
    only = guidance.tractors[0]
    name = folder_name(guidance.field, "Field") + (f" T{only.number}" if guidance.several else "")
    plane = _plane(guidance)
    rings = (
        () if guidance.boundary is None else (*guidance.boundary.rings, *(one.rings[0] for one in guidance.obstacles))
    )
    files = {
        "Field.txt": [
            HEAD, "$FieldDir", name, "$Offsets", "0,0", "Convergence", "0", "StartFix",
            f"{plane.latitude_deg:.{START_DECIMALS}f},{plane.longitude_deg:.{START_DECIMALS}f}",
        ],
        "Boundary.txt": ["$Boundary", *(row for ring in rings for row in ("False", *_ring(plane, ring)))],
        "Headland.txt": ["$Headland", *_headland(plane, guidance)],
        "TrackLines.txt": ["$TrackLines", *(row for line in only.lines for row in _track(plane, line))],
    }  # fmt: skip
    return {f"{name}/{file}": "\r\n".join([*rows, ""]).encode("utf-8") for file, rows in files.items()}


def _plane(guidance: Guidance) -> Plane:
    """The plane about the middle of the boundary, or of the lines where there is none."""
    points = np.concatenate(
        [guidance.boundary.rings[0]] if guidance.boundary is not None else [one.points for one in guidance.lines]
    )
    first = points[0, 0]
    east_deg = (points[:, 0] - first + 180.0) % 360.0 - 180.0  # the short way, across 180 degrees as well
    longitude = math.remainder(first + 0.5 * (east_deg.min() + east_deg.max()), 360.0)
    latitude = 0.5 * (points[:, 1].min() + points[:, 1].max())
    return Plane(round(float(longitude), START_DECIMALS), round(float(latitude), START_DECIMALS))


def _ring(plane: Plane, ring: Degrees) -> list[str]:
    """How many points and the points of a ring, each with the direction from the one before to the one after."""
    corners = _metres(plane, ring)
    points = _close([*corners, corners[0]], RING_APART_M)[:-1]
    headings = [_heading(points[place - 1], points[(place + 1) % len(points)]) for place in range(len(points))]
    return _rows(points, headings)


def _headland(plane: Plane, guidance: Guidance) -> list[str]:
    """For the outer ring of the boundary and each inner one the inner edge of its headland, 0 points for none.

    The program knows one edge a ring: of a headland that parts a field, that of the largest part.
    """
    if guidance.boundary is None or not guidance.inside_headland:
        return []
    edges = max(guidance.inside_headland, key=lambda one: _area(plane, one.rings[0])).rings
    holes = [*guidance.boundary.rings[1:], *(one.rings[0] for one in guidance.obstacles)]
    found = [_ring(plane, edges[0])]
    for hole in holes:
        round_it = next((edge for edge in edges[1:] if _within(hole[0], edge)), None)
        found.append(["0"] if round_it is None else _ring(plane, round_it))
    return [row for rows in found for row in rows]


def _area(plane: Plane, ring: Degrees) -> float:
    """Square metres within a ring."""
    return float(shapely.Polygon(_metres(plane, ring)).area)


def _within(point: Degrees, ring: Degrees) -> bool:
    """Whether a point lies within a ring (crossings of a ray)."""
    (x, y), ends = point, np.roll(ring, -1, axis=0)
    spans = (ring[:, 1] > y) != (ends[:, 1] > y)
    starts, ends = ring[spans], ends[spans]
    cuts = starts[:, 0] + (y - starts[:, 1]) / (ends[:, 1] - starts[:, 1]) * (ends[:, 0] - starts[:, 0])
    return int((cuts > x).sum()) % 2 == 1


def _track(plane: Plane, line: Line) -> list[str]:
    """Name, heading in radians, A, B, nudge, mode, visible, and the points of a curve with their headings."""
    ends = _metres(plane, line.points)
    name = plain(line.name)
    head = [name, f"{_heading(ends[0], ends[-1]):.8f}", _pair(ends[0]), _pair(ends[-1]), "0"]
    if line.straight:
        return [*head, str(AB_MODE), "True", "0"]
    points = _close(ends, CURVE_APART_M)
    ahead = [_heading(one, other) for one, other in pairwise(points)]
    return [*head, str(CURVE_MODE), "True", *_rows(points, [*ahead, ahead[-1]])]


def _metres(plane: Plane, points: Degrees) -> Metres:
    return [plane.metres(longitude, latitude) for longitude, latitude in points.tolist()]


def _close(points: Metres, apart_m: float) -> Metres:
    """The points with more of them on the lines between, none farther from the next than that."""
    found = [points[0]]
    for (x, y), (to_x, to_y) in pairwise(points):
        parts = max(1, math.ceil(math.hypot(to_x - x, to_y - y) / apart_m - 1e-9))
        found += [(x + k / parts * (to_x - x), y + k / parts * (to_y - y)) for k in range(1, parts + 1)]
    return found


def _heading(start: tuple[float, float], end: tuple[float, float]) -> float:
    """Direction clockwise from north, radians from 0 to 2 pi."""
    return math.atan2(end[0] - start[0], end[1] - start[1]) % (2.0 * math.pi)


def _rows(points: Metres, headings: Sequence[float]) -> list[str]:
    rows = [f"{_pair(point)},{heading:.5f}" for point, heading in zip(points, headings, strict=True)]
    return [str(len(points)), *rows]


def _pair(point: tuple[float, float]) -> str:
    return f"{point[0]:.3f},{point[1]:.3f}"


FORM = Form("agopengps", "AgOpenGPS", _write, apart=True, named=True, lacks=("entrance",))
