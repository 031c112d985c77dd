"""Geometry of a drive for pictures: its extent, paths cut by status and simplified, stops, swaths, hatching."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely

from fields.arrays import Floats, Integers
from reports.common.plan_records import PlanDrive

FINISHED, WORKING, TURNING, WAITING, REVERSING = range(5)
STATUS_BY_STATE = {"working": WORKING, "turning": TURNING, "waiting": WAITING, "reversing": REVERSING}
SERVICE_STATE, SERVICE_STATUS = "refilling", 5
FOLDING_STATE, FOLDING_STATUS = "folding", 6
RARE_STATES = (SERVICE_STATE, FOLDING_STATE)
"""Of drives in which a tank is filled or emptied, or an implement folded, besides `STATUS_BY_STATE`."""
SIMPLIFY_TOLERANCE_M = 0.05


@dataclass(frozen=True)
class MapExtent:
    """Bounding box in metres."""

    west: float
    south: float
    east: float
    north: float

    @property
    def width(self) -> float:
        """Metres from west to east."""
        return self.east - self.west

    @property
    def height(self) -> float:
        """Metres from south to north."""
        return self.north - self.south

    @property
    def size(self) -> float:
        """The larger of the two, metres."""
        return max(self.width, self.height)

    @property
    def corners(self) -> Floats:
        """The lower left and the upper right corner (2, 2), metres."""
        return np.array([(self.west, self.south), (self.east, self.north)])


@dataclass(frozen=True)
class Viewport:
    """Converts metres, y north, to whole units of a picture, y down: `scale` to a metre, `margin` at its edges."""

    west: float
    north: float
    scale: float = 100.0
    margin: float = 0.0

    def convert_points(self, points: Floats) -> list[tuple[int, int]]:
        """Points (n, 2) on the picture."""
        flat = (points - (self.west, self.north)) * (self.scale, -self.scale) + self.margin
        return [(int(x), int(y)) for x, y in np.rint(flat)]

    def format_path(self, points: Floats, is_closed: bool = False) -> str:
        """SVG path data of a polyline (n, 2); moves after the first are relative, which halves the text."""
        flat = self.convert_points(points)
        steps = [f"{x - x0} {y - y0}" for (x0, y0), (x, y) in pairwise(flat) if (x, y) != (x0, y0)]
        return f"M{flat[0][0]} {flat[0][1]}" + (f"l{' '.join(steps)}" if steps else "") + ("z" if is_closed else "")

    def format_rings(self, rings: Iterable[Floats]) -> str:
        """SVG path data of closed rings (n, 2)."""
        return "".join(self.format_path(ring, is_closed=True) for ring in rings)


def list_states(drives: Iterable[PlanDrive]) -> list[str]:
    """The states of drives; refilling and folding only if one of them has it."""
    had = {state for drive in drives for state, seconds in drive.seconds.items() if any(seconds)}
    return [*STATUS_BY_STATE, *(state for state in RARE_STATES if state in had)]


def compute_extent(drive: PlanDrive) -> MapExtent:
    """The box around the field, the entrance and every path."""
    return bound_points([drive.boundary, *drive.xy, *([] if drive.entrance is None else [np.array([drive.entrance])])])


def bound_points(clouds: Sequence[Floats]) -> MapExtent:
    """The box around some points (n, 2) each; one of no size at the origin where there are none."""
    points = np.concatenate(clouds) if clouds else np.zeros((1, 2))
    return MapExtent(*map(float, (*points.min(axis=0), *points.max(axis=0))))


def split_by_status(
    xy: Floats, status: Integers, tolerance_m: float = SIMPLIFY_TOLERANCE_M
) -> list[tuple[int, Floats]]:
    """Status and polyline (n, 2) of the pieces of a path (t, 2) cut where the status (t,) changes, in order of time.

    The step between two samples has the status of the later one. Time standing still leaves no piece. Every
    piece stays within `tolerance_m` of the path (Douglas and Peucker, 1973) and begins where the last ended.
    """
    if len(xy) < 2:
        return []
    path_pieces = list[tuple[int, Floats]]()
    for step_status, start, end in list_status_runs(status[1:]):
        line = shapely.LineString(xy[start : end + 1])
        if line.length > 0:
            points = np.asarray(line.simplify(tolerance_m, preserve_topology=False).coords, dtype=np.float64)
            path_pieces.append((step_status, points))
    return path_pieces


def list_status_runs(status: Integers) -> list[tuple[int, int, int]]:
    """Runs of one status of steps (k,): status, first sample, last sample."""
    cuts = [0, *(np.flatnonzero(np.diff(status)) + 1).tolist(), len(status)]
    return [(int(status[start]), start, end) for start, end in pairwise(cuts) if end > start]


def find_stops(
    xy: Floats, status: Integers, step_s: float, stop_status: int = WAITING
) -> list[tuple[float, float, float]]:
    """Stops of a tractor with a status, waiting by default: x, y in metres and seconds of each."""
    return [
        (float(xy[start, 0]), float(xy[start, 1]), float(end - start) * step_s)
        for run_status, start, end in list_status_runs(status)
        if run_status == stop_status
    ]


def build_swath_outline(centre_line: Floats, width_m: float) -> Floats:
    """Outline (m, 2) of the strip of `width_m` around a centre line (n, 2), metres; of a straight one, its corners."""
    if len(centre_line) > 2:
        strip = shapely.LineString(centre_line).buffer(0.5 * width_m, cap_style="flat", join_style="mitre")
        return np.asarray(strip.exterior.coords)[:-1]
    along = centre_line[1] - centre_line[0]
    length = float(np.hypot(along[0], along[1]))
    side = np.array([-along[1], along[0]]) / length * width_m / 2 if length else np.zeros(2)
    return np.array([centre_line[0] + side, centre_line[1] + side, centre_line[1] - side, centre_line[0] - side])


def build_hatching(rings: Sequence[Floats], apart_m: float) -> Floats:
    """Lines (n, 2, 2) at 45 degrees across the area within closed rings (m, 2), holes left out.

    Lines are `apart_m` apart, in one pattern for all rings. A place inside an even number of rings is outside the area.
    """

    def turn(places: Sequence[Floats]) -> Floats:
        """Places (m, 2) in metres along and across the lines."""
        x, y = np.concatenate([np.empty((0, 2)), *places]).T
        return np.column_stack([x + y, y - x]) / math.sqrt(2.0)

    starts, ends = turn(rings), turn([np.roll(ring, -1, axis=0) for ring in rings])
    # A line crosses an edge that begins below it and ends on or above it: corners on a line count once.
    low = np.ceil(np.minimum(starts[:, 1], ends[:, 1]) / apart_m).astype(np.int64)
    count = np.ceil(np.maximum(starts[:, 1], ends[:, 1]) / apart_m).astype(np.int64) - low
    edge = np.repeat(np.arange(len(starts)), count)
    line = low[edge] + np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count)
    along = ends[edge] - starts[edge]
    places = starts[edge, 0] + along[:, 0] * (line * apart_m - starts[edge, 1]) / along[:, 1]
    order = np.lexsort((places, line))
    a, b = np.column_stack([places, line * apart_m])[order].T / math.sqrt(2.0)
    return np.column_stack([a - b, a + b]).reshape(-1, 2, 2)


def choose_round_length_m(length_m: float) -> float:
    """The largest of 1, 2, 5, 10, 20, 50, ... metres (or 0.1, 0.2, ...) not above a length above 0."""
    power = 10.0 ** math.floor(math.log10(length_m))
    return max(factor * power for factor in (1.0, 2.0, 5.0) if factor * power <= length_m * (1 + 1e-12))


def place_swath_numbers(swaths: Sequence[Floats], beyond_m: float, apart_m: float) -> list[tuple[int, Floats]]:
    """Places for numbers of tracks (n, 2) each: index and place (2,), `beyond_m` outside both ends.

    At each end no two are nearer than `apart_m`.
    """
    numbers = []
    for last, before in ((0, 1), (-1, -2)):
        if len(swaths):
            ends = np.array([track[last] for track in swaths])
            along = ends - np.array([track[before] for track in swaths])
            length = np.maximum(np.hypot(along[:, 0], along[:, 1]), 1e-9)
            places = ends + along / length[:, None] * beyond_m
            chosen = list[int]()
            for index, place in enumerate(places):
                near = places[chosen] - place
                if not chosen or float((near[:, 0] ** 2 + near[:, 1] ** 2).min()) >= apart_m**2:
                    chosen.append(index)
            numbers += [(index, places[index]) for index in chosen]
    return numbers


def build_arrow_head(line: Floats, length_m: float) -> Floats | None:
    """The head (3, 2) of an arrow, tip first, half way along a polyline; None if that has no length."""
    steps = np.diff(line, axis=0)
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    total = float(lengths.sum())
    if total <= 0.0:
        return None
    segment = int(np.searchsorted(np.cumsum(lengths), total / 2))
    ahead = steps[segment] / lengths[segment]
    middle = line[segment] + ahead * (total / 2 - float(lengths[:segment].sum()))
    side = np.array([-ahead[1], ahead[0]]) * 0.45 * length_m
    back = middle - ahead * length_m / 2
    return np.array([middle + ahead * length_m / 2, back + side, back - side])
