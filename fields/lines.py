"""Parallel lines over a region: where they run, how they are trimmed and what a set of them costs.

Everything here works in *track coordinates*: s along the tracks (+u), q to the left of them (+n).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

TURN_M = 15.0
"""Driving length charged for every piece, because each ends in a turn."""
SPAN_TOLERANCE_M = 0.05
"""A lateral span this much beyond a whole number of widths gains no line: less than a pass can be steered."""
LENGTH_TOLERANCE_M = 1e-6
UNCOVERED = 2.0
"""Charge for a metre of swath that no track covers: it is left to the headland, at a turn a corner."""
SHIFTS = (1 / 16, 1 / 8, 1 / 4, 1 / 2, 3 / 4)
"""How far (in widths) an outer line may stand off a bulging or notched side."""


@dataclass(frozen=True)
class Comb:
    """A set of parallel pieces in track coordinates.

    Attributes:
        q: lateral position of each line, metres, evenly spaced.
        line: index into ``q`` of each piece, ascending.
        s0, s1: where each piece starts and ends, metres along +u.
        cost_m: estimated effort as a driving length, metres.
    """

    q: FloatArray
    line: IntArray
    s0: FloatArray
    s1: FloatArray
    cost_m: float

    @property
    def used(self) -> int:
        """Number of lines that carry a piece."""
        return 1 + int(np.count_nonzero(np.diff(self.line)))

    @property
    def total_m(self) -> float:
        """Sum of the lengths of all pieces, metres."""
        return float((self.s1 - self.s0).sum())


@dataclass(frozen=True)
class CombRules:
    """What a comb has to keep to, all in metres.

    Attributes:
        width_m: working width, the largest spacing of the lines.
        trim_m: taken off both ends of every chord.
        shortest_m: pieces shorter than this are dropped.
        edge_m: distance of the outer lines from the lateral extremes of the edges handed over.
        field_area_m2: area that the whole field would offer, square metres.
        apart_m: lines over a region that is filled lie no nearer to each other than this or, where that is less, than
            the width.
    """

    width_m: float
    trim_m: float
    shortest_m: float
    edge_m: float
    field_area_m2: float
    apart_m: float = 0.0


def region_edges(region: shapely.Geometry) -> FloatArray:
    """Every edge of the polygons of a region, shape (n, 2, 2): edge, end, coordinate."""
    loops = [
        np.asarray(loop.coords)[:, :2]
        for part in shapely.get_parts(region)
        if isinstance(part, shapely.Polygon)
        for loop in (part.exterior, *part.interiors)
    ]
    pieces = [np.stack([loop[:-1], loop[1:]], axis=1) for loop in loops]
    return np.concatenate(pieces) if pieces else np.empty((0, 2, 2))


def axes(bearing_rad: float) -> FloatArray:
    """Rows: unit vector u along the tracks and n to the left of it, shape (2, 2)."""
    c, s = np.cos(bearing_rad), np.sin(bearing_rad)
    return np.array([[c, s], [-s, c]])


def chords(edges: FloatArray, q: FloatArray) -> tuple[IntArray, FloatArray, FloatArray]:
    """Where lines at lateral positions q run inside closed rings.

    The half-open rule (an edge owns its lower end) makes the number of crossings of each line even.

    Args:
        edges: shape (n, 2, 2) in track coordinates.
        q: shape (k,), ascending or descending.

    Returns:
        line index, start and end along s of each chord, sorted by line and start.
    """
    (s_a, q_a), (s_b, q_b) = edges[:, 0].T, edges[:, 1].T
    line, edge = _crossings(np.minimum(q_a, q_b), np.maximum(q_a, q_b), q)
    t = (q[line] - q_a[edge]) / (q_b[edge] - q_a[edge])
    s = s_a[edge] + t * (s_b[edge] - s_a[edge])
    order = np.lexsort((s, line))
    line, s = line[order], s[order]
    return line[::2], s[::2], s[1::2]


def _crossings(low: FloatArray, high: FloatArray, q: FloatArray) -> tuple[IntArray, IntArray]:
    """Lines and edges that meet: those of the lines at q, in order either way, that lie in [low, high) of an edge."""
    down = len(q) > 1 and q[0] > q[-1]
    ascending = q[::-1] if down else q
    first, end = np.searchsorted(ascending, low), np.searchsorted(ascending, high)
    count = end - first
    edge = np.repeat(np.arange(len(low)), count)
    line = np.arange(len(edge)) + np.repeat(first - (np.cumsum(count) - count), count)
    return (len(q) - 1 - line if down else line), edge


def positions(low: float, high: float, width: float) -> FloatArray:
    """Lateral positions from low to high, evenly spaced by at most one width (and the span tolerance)."""
    gaps = max(int(np.ceil((high - low - SPAN_TOLERANCE_M) / width)), 0)
    q: FloatArray = np.linspace(low, high, gaps + 1)
    return q


def comb(edges: FloatArray, rules: CombRules, shifts: tuple[float, ...] = ()) -> Comb | None:
    """The cheapest comb over a region, or None when every piece would be too short.

    First the one and then the other outer line is shifted (in widths) where that is cheaper and loses no
    line; both orders are tried, so that the choice depends on the shape only, not on its place or heading.
    """
    low, high = _extent(edges, rules)
    best: Comb | None = None
    for side, extent in ((1.0, (low, high)), (-1.0, (-high, -low))):
        found = _shifted(edges, rules, extent, side, shifts)
        if found is not None and (best is None or better(found, best)):
            best = found
    return best


def _shifted(
    edges: FloatArray, rules: CombRules, extent: tuple[float, float], side: float, shifts: tuple[float, ...]
) -> Comb | None:
    """The cheapest comb over the shifts of the two outer lines, the one on `side` first."""
    best, best_near = _one(edges, rules, extent, side), 0.0
    fewest = best.used if best is not None else 0
    for near in shifts:
        found = _one(edges, rules, extent, side, (near, 0.0))
        if found is not None and found.used >= fewest and (best is None or better(found, best)):
            best, best_near = found, near
    for far in shifts:
        found = _one(edges, rules, extent, side, (best_near, far))
        if found is not None and found.used >= fewest and (best is None or better(found, best)):
            best = found
    return best


def better(one: Comb, other: Comb) -> bool:
    """True when one comb is cheaper than the other, or costs the same and covers more."""
    slack = 1e-9 * max(other.cost_m, 1.0)
    if abs(one.cost_m - other.cost_m) > slack:
        return one.cost_m < other.cost_m
    return one.total_m > other.total_m * (1.0 + 1e-9)


def _extent(edges: FloatArray, rules: CombRules) -> tuple[float, float]:
    """Lateral positions of the two outermost lines; one and the same when there is room for one."""
    q = edges[..., 1]
    low, high = float(q.min()) + rules.edge_m, float(q.max()) - rules.edge_m
    if high < low:
        low = high = (low + high) / 2.0
    return low, high


def _one(
    edges: FloatArray,
    rules: CombRules,
    extent: tuple[float, float],
    side: float,
    shift: tuple[float, float] = (0.0, 0.0),
) -> Comb | None:
    """The comb numbered from one side, outer lines shifted inwards (in widths); None without a piece."""
    low, high = extent[0] + shift[0] * rules.width_m, extent[1] - shift[1] * rules.width_m
    if high < low and any(shift):
        return None
    q = positions(low, high, rules.width_m)
    line, s0, s1 = chords(edges, side * q)
    s0, s1 = s0 + rules.trim_m, s1 - rules.trim_m
    keep = s1 - s0 >= rules.shortest_m - LENGTH_TOLERANCE_M
    line, s0, s1 = line[keep], s0[keep], s1[keep]
    if not len(line):
        return None
    return Comb(side * q, line, s0, s1, _cost(q, line, s1 - s0, rules))


def _cost(q: FloatArray, line: IntArray, length: FloatArray, rules: CombRules) -> float:
    """Driving length of the pieces, a turn for each, and the uncovered area as length at full width."""
    spacing = float(q[1] - q[0]) if len(q) > 1 else rules.width_m
    uncovered = max(rules.field_area_m2 - float(length.sum()) * spacing, 0.0)
    return float(length.sum() + TURN_M * len(length) + UNCOVERED * uncovered / rules.width_m)
