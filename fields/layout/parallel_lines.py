"""Parallel lines over a region: where they run, how they are trimmed or extended to cover it, and what they cost.

Everything here is in *swath coordinates*: s along the swaths (+u), q to the left of them (+n).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely

from fields.arrays import Floats, Integers, build_directions
from fields.geometry.arithmetic import CURVE_M, GRID_M, MIN_SWATH_LENGTH_M, multiply
from fields.geometry.overlays import intersect_on_grid

TURN_COST_M = 15.0
"""Driving length charged for every piece, because each ends in a turn."""
UNCOVERED_COST_FACTOR = 2.0
"""Charge per metre of uncovered swath, which is worked with the headland and its turns."""
OUTER_LINE_SHIFTS = (1 / 16, 1 / 8, 1 / 4, 1 / 2, 3 / 4)
"""How far (in widths) an outer line may stand off a bulging or notched side."""
MIN_SWATH_AREA = 0.25  # squared widths: smaller remainders are not worth a turn
SPECK_WIDTH = 0.02  # of the width: parts of a swath with a narrower connection are separate


@dataclass(frozen=True)
class SwathPattern:
    """A set of parallel pieces in swath coordinates.

    Attributes:
        offsets_m: lateral position of each line, metres, evenly spaced.
        line_index: index into ``offsets_m`` of each piece, ascending.
        start_m, end_m: start and end of each piece, metres along +u.
        cost_m: estimated effort as a driving length, metres.
    """

    offsets_m: Floats
    line_index: Integers
    start_m: Floats
    end_m: Floats
    cost_m: float

    @property
    def used_lines(self) -> int:
        """Number of lines that carry a piece."""
        return 1 + int(np.count_nonzero(np.diff(self.line_index)))

    @property
    def total_length_m(self) -> float:
        """Sum of the lengths of all pieces, metres."""
        return float((self.end_m - self.start_m).sum())


@dataclass(frozen=True)
class PatternRules:
    """Rules for a set of parallel pieces.

    Attributes:
        width_m: working width, the largest spacing of the lines.
        trim_m: taken off both ends of every chord.
        min_length_m: shorter pieces are dropped.
        edge_offset_m: distance of the outer lines from the lateral extremes of the edges.
        field_area_m2: area of the whole field, square metres.
        min_spacing_m: smallest spacing of lines in `fill_region`, but at most the width.
    """

    width_m: float
    trim_m: float
    min_length_m: float
    edge_offset_m: float
    field_area_m2: float
    min_spacing_m: float = 0.0

    @classmethod
    def inside_headland(cls, region: shapely.Geometry, width_m: float, min_spacing_m: float) -> PatternRules:
        """Those of lines that cover a region, which worked headland passes surround, to its edges."""
        return cls(width_m, 0.0, MIN_SWATH_LENGTH_M, 0.5 * width_m, region.area, min_spacing_m)


def collect_edges(region: shapely.Geometry) -> Floats:
    """Every edge of the polygons of a region, shape (n, 2, 2): edge, end, coordinate."""
    loops = [
        np.asarray(loop.coords)[:, :2]
        for part in shapely.get_parts(region)
        if isinstance(part, shapely.Polygon)
        for loop in (part.exterior, *part.interiors)
    ]
    pieces = [np.stack([loop[:-1], loop[1:]], axis=1) for loop in loops]
    return np.concatenate(pieces) if pieces else np.empty((0, 2, 2))


def compute_axes(bearing_rad: float) -> Floats:
    """Rows: unit vector u along the tracks and n to the left of it, shape (2, 2)."""
    ((c, s),) = build_directions(np.array([bearing_rad]))
    return np.array([[c, s], [-s, c]])


def find_line_chords(edges: Floats, q: Floats) -> tuple[Integers, Floats, Floats]:
    """Chords of lines at lateral positions q (k,), ascending or descending, inside closed rings of edges (n, 2, 2).

    Each is line index, start and end along s, sorted by line and start; all in swath coordinates. The half-open
    rule (an edge owns its lower end) makes the number of crossings of each line even.
    """
    (s_a, q_a), (s_b, q_b) = edges[:, 0].T, edges[:, 1].T
    line, edge = _find_crossings(np.minimum(q_a, q_b), np.maximum(q_a, q_b), q)
    t = (q[line] - q_a[edge]) / (q_b[edge] - q_a[edge])
    s = s_a[edge] + t * (s_b[edge] - s_a[edge])
    order = np.lexsort((s, line))
    line, s = line[order], s[order]
    return line[::2], s[::2], s[1::2]


def _find_crossings(low: Floats, high: Floats, q: Floats) -> tuple[Integers, Integers]:
    """Indices of crossing lines and edges: lines at sorted q that are in [low, high) of an edge."""
    down = len(q) > 1 and q[0] > q[-1]
    ascending = q[::-1] if down else q
    first, end = np.searchsorted(ascending, low), np.searchsorted(ascending, high)
    count = end - first
    edge = np.repeat(np.arange(len(low)), count)
    line = np.arange(len(edge)) + np.repeat(first - (np.cumsum(count) - count), count)
    return (len(q) - 1 - line if down else line), edge


def space_lines(low_m: float, high_m: float, width_m: float) -> Floats:
    """Lateral positions from low to high, evenly spaced by at most one width (and the span tolerance)."""
    gaps = max(int(np.ceil((high_m - low_m - CURVE_M) / width_m)), 0)
    q: Floats = np.linspace(low_m, high_m, gaps + 1)
    return q


def find_best_pattern(edges: Floats, rules: PatternRules, shifts: tuple[float, ...] = ()) -> SwathPattern | None:
    """The cheapest pattern over a region, or None when it has no ground or every piece would be too short.

    One outer line and then the other is shifted inwards (in widths) if that is cheaper and loses no line; both orders
    are tried, so that the choice depends on the shape only, not on its position or heading.
    """
    if not len(edges):
        return None
    low, high = _find_extent(edges, rules)
    best: SwathPattern | None = None
    for side, extent in ((1.0, (low, high)), (-1.0, (-high, -low))):
        pattern = _search_shifts(edges, rules, extent, side, shifts)
        if pattern is not None and (best is None or is_better(pattern, best)):
            best = pattern
    return best


def _search_shifts(
    edges: Floats, rules: PatternRules, extent: tuple[float, float], side: float, shifts: tuple[float, ...]
) -> SwathPattern | None:
    """The cheapest pattern over the shifts of the two outer lines, the one on `side` first."""
    best, best_near_shift = _build_pattern(edges, rules, extent, side), 0.0
    min_lines = best.used_lines if best is not None else 0
    for near_shift in shifts:
        pattern = _build_pattern(edges, rules, extent, side, (near_shift, 0.0))
        if pattern is not None and pattern.used_lines >= min_lines and (best is None or is_better(pattern, best)):
            best, best_near_shift = pattern, near_shift
    for far_shift in shifts:
        pattern = _build_pattern(edges, rules, extent, side, (best_near_shift, far_shift))
        if pattern is not None and pattern.used_lines >= min_lines and (best is None or is_better(pattern, best)):
            best = pattern
    return best


def is_better(candidate: SwathPattern, incumbent: SwathPattern) -> bool:
    """Whether the candidate is cheaper than the incumbent, or costs the same and covers more."""
    slack = 1e-9 * max(incumbent.cost_m, 1.0)
    if abs(candidate.cost_m - incumbent.cost_m) > slack:
        return candidate.cost_m < incumbent.cost_m
    return candidate.total_length_m > incumbent.total_length_m * (1.0 + 1e-9)


def _find_extent(edges: Floats, rules: PatternRules) -> tuple[float, float]:
    """Lateral positions of the two outermost lines; equal if there is room for one line only."""
    q = edges[..., 1]
    low, high = float(q.min()) + rules.edge_offset_m, float(q.max()) - rules.edge_offset_m
    if high < low:
        low = high = (low + high) / 2.0
    return low, high


def _build_pattern(
    edges: Floats,
    rules: PatternRules,
    extent: tuple[float, float],
    side: float,
    shift: tuple[float, float] = (0.0, 0.0),
) -> SwathPattern | None:
    """The pattern numbered from one side, outer lines shifted inwards (in widths); None without a piece."""
    low, high = extent[0] + shift[0] * rules.width_m, extent[1] - shift[1] * rules.width_m
    if high < low and any(shift):
        return None
    q = space_lines(low, high, rules.width_m)
    line, s0, s1 = find_line_chords(edges, side * q)
    s0, s1 = s0 + rules.trim_m, s1 - rules.trim_m
    is_long_enough = s1 - s0 >= rules.min_length_m - GRID_M
    line, s0, s1 = line[is_long_enough], s0[is_long_enough], s1[is_long_enough]
    if not len(line):
        return None
    return SwathPattern(side * q, line, s0, s1, _estimate_cost_m(q, line, s1 - s0, rules))


def _estimate_cost_m(q: Floats, line: Integers, length: Floats, rules: PatternRules) -> float:
    """Driving length of the pieces, a turn for each, and the uncovered area as length at full width."""
    spacing = float(q[1] - q[0]) if len(q) > 1 else rules.width_m
    uncovered = max(rules.field_area_m2 - float(length.sum()) * spacing, 0.0)
    return float(length.sum() + TURN_COST_M * len(length) + UNCOVERED_COST_FACTOR * uncovered / rules.width_m)


def fill_region(region: shapely.Geometry, bearing_rad: float, rules: PatternRules) -> SwathPattern | None:
    """Pieces that cover a region (in metres) completely, in swath coordinates; None if it is not worth a piece.

    Every piece extends over the whole swath, also at oblique edges; one shorter than `rules.min_length_m` is extended
    at both ends. Lines keep `rules.min_spacing_m`, so that the outer swaths may reach beyond the region by less than
    half a width. `rules.trim_m` is not used. The cost is the length driven; nothing remains uncovered.
    """
    frame = compute_axes(bearing_rad)
    turned = shapely.transform(region, lambda points: multiply(points, frame.T))
    edges = collect_edges(turned)
    if not len(edges):
        return None
    half = 0.5 * rules.width_m
    low, high = float(edges[..., 1].min()) + half, float(edges[..., 1].max()) - half
    if high < low:
        low = high = 0.5 * (low + high)
    q = _spread_lines(space_lines(low, high, rules.width_m), min(rules.min_spacing_m, rules.width_m))
    west, _, east, _ = turned.bounds
    swaths = intersect_on_grid(shapely.box(west - 1.0, q - half, east + 1.0, q + half), turned)
    line: list[int] = []
    ends: list[tuple[float, float]] = []
    for number, swath in enumerate(swaths):
        for first, last in _find_swath_spans(swath, rules):
            line.append(number)
            ends.append((first, last))
    if not line:
        return None
    s = np.array(ends)
    cost = float((s[:, 1] - s[:, 0]).sum())
    return SwathPattern(q, np.array(line, dtype=np.int64), s[:, 0], s[:, 1], cost)


def _spread_lines(q: Floats, min_spacing_m: float) -> Floats:
    """Evenly spaced lines with a minimum spacing, spread from the middle, so that outer swaths may overlap the edge."""
    if len(q) < 2 or q[1] - q[0] >= min_spacing_m:
        return q
    spread: Floats = 0.5 * (q[0] + q[-1]) + min_spacing_m * (np.arange(len(q)) - 0.5 * (len(q) - 1))
    return spread


def _find_swath_spans(swath: shapely.Geometry, rules: PatternRules) -> list[tuple[float, float]]:
    """Spans along which a swath meets the region, in ascending order; touching spans are joined."""
    speck = 0.5 * SPECK_WIDTH * rules.width_m
    solid = shapely.buffer(shapely.buffer(swath, -speck, join_style="mitre"), speck, join_style="mitre")
    spans: list[tuple[float, float]] = []
    parts = [part for part in shapely.get_parts(solid) if part.area >= MIN_SWATH_AREA * rules.width_m**2]
    for first, last in sorted((part.bounds[0], part.bounds[2]) for part in parts):
        short = max(rules.min_length_m - (last - first), 0.0)
        first, last = first - 0.5 * short, last + 0.5 * short
        if spans and first <= spans[-1][1]:
            before = spans.pop()
            first, last = before[0], max(last, before[1])
        spans.append((first, last))
    return spans
