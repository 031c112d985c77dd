"""Drivable paths made of straights and circular arcs, and the closed-form ways to join two poses with them.

A path is a start pose and a list of segments of constant curvature, driven forwards or in reverse. Everything
here is exact geometry: no sampling is involved until a caller asks for a polyline.

Sources: L. E. Dubins, "On curves of minimal length with a constraint on average curvature", American Journal of
Mathematics 79 (1957); J. A. Reeds and L. A. Shepp, "Optimal paths for a car that goes both forwards and
backwards", Pacific Journal of Mathematics 145 (1990). The words are built from tangent circles, not from the
papers' tables, so that every hand has its exact mirror image.
"""

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from strategies.errors import StrategyError
from strategies.ways.words import MOST_PIECES, MOST_WORDS, backing_words, cusped_words, forward_words

Pose = tuple[float, float, float]
"""x (m, east), y (m, north) and the heading of the vehicle as a mathematical angle (rad, ccw from x)."""

Points = NDArray[np.float64]

KINDS = ("route", "u", "omega", "switch-back")
_TAU = 2.0 * math.pi
_SNAP = 1e-12  # arcs (rad) and straights (m) shorter than this are rounding, not driving


class TurnError(StrategyError):
    """A turn or path was asked for with values that cannot describe one."""


@dataclass(frozen=True, slots=True)
class Segment:
    """One piece of constant curvature: length_m >= 0, curvature in 1/m, gear +1 forward or -1 reverse.

    Positive curvature turns left (ccw) while driving forward; driven in reverse the same curvature turns the
    heading clockwise.
    """

    length_m: float
    curvature: float
    gear: int


@dataclass(frozen=True, slots=True)
class Path:
    """A start pose followed by segments; `kind` is "u", "omega", "switch-back" or "route"."""

    start: Pose
    segments: tuple[Segment, ...]
    kind: str

    def rows(self) -> Points:
        """Its segments as rows of length, curvature and gear (n, 3), as the compiled search has them."""
        pieces = [(segment.length_m, segment.curvature, float(segment.gear)) for segment in self.segments]
        return np.array(pieces, float).reshape(-1, 3)

    @property
    def length_m(self) -> float:
        """Driven length, forward and reverse together (m)."""
        return math.fsum(s.length_m for s in self.segments)

    @property
    def reverse_m(self) -> float:
        """Length driven in reverse (m)."""
        return math.fsum(s.length_m for s in self.segments if s.gear < 0)

    @property
    def reversals(self) -> int:
        """Number of gear changes inside the path."""
        return sum(p.gear != q.gear for p, q in zip(self.segments, self.segments[1:], strict=False))

    @property
    def end(self) -> Pose:
        """Pose at the end of the last segment."""
        pose = self.start
        for segment in self.segments:
            pose = advance(pose, segment)
        return pose

    def poses(self) -> Iterator[Pose]:
        """Pose at the start of every segment."""
        pose = self.start
        for segment in self.segments:
            yield pose
            pose = advance(pose, segment)

    def sample(self, step_m: float = 0.25) -> list[tuple[int, Points]]:
        """One polyline per run of equal gear, as (gear, points of shape (n, 2)), at most step_m apart.

        Ends of segments are met exactly, and each polyline begins where the one before ended. A path without
        segments has no polylines. Raises TurnError when step_m is not positive.
        """
        if not step_m > 0.0:
            raise TurnError(f"Sampling step {step_m} m must be above zero; use for instance 0.25.")
        runs: list[tuple[int, list[Points]]] = []
        for pose, segment in zip(self.poses(), self.segments, strict=True):
            points = arc_points(pose, segment, max(1, math.ceil(segment.length_m / step_m - 1e-9)))
            if runs and runs[-1][0] == segment.gear:
                runs[-1][1].append(points[1:])
            else:
                runs.append((segment.gear, [points]))
        return [(gear, np.concatenate(pieces)) for gear, pieces in runs]

    def outline(self, sagitta_m: float = 0.003) -> Points:
        """A few points, shape (n, 2), whose polyline stays within sagitta_m of the path.

        Straights give their ends only. Made for checking many paths quickly: the points of an arc are turned
        and moved from a table kept per curvature.
        """
        pieces = [np.array([complex(*self.start[:2])])]
        pose = self.start
        for segment in self.segments:
            if segment.curvature:
                table, step = _arc_table(segment.curvature * segment.gear, sagitta_m)
                whole = math.ceil(segment.length_m / step - 1e-9)
                turn = segment.gear * complex(math.cos(pose[2]), math.sin(pose[2]))
                pieces.append(table[: max(0, whole - 1)] * turn + complex(*pose[:2]))
            pose = advance(pose, segment)
            pieces.append(np.array([complex(*pose[:2])]))
        return np.concatenate(pieces).view(np.float64).reshape(-1, 2)


@lru_cache(maxsize=64)
def _arc_table(bend: float, sagitta_m: float) -> tuple[NDArray[np.complex128], float]:
    """Points of an arc that starts along +x, as complex numbers from the first step on, and the step (m).

    `bend` is the turn of the heading per metre driven; the table covers one full turn.
    """
    step = math.sqrt(8.0 * sagitta_m / abs(bend))
    run = step * np.arange(1, math.ceil(_TAU / (abs(bend) * step)) + 1)
    half = 0.5 * bend * run
    return run * np.sinc(half / math.pi) * np.exp(1j * half), step


def advance(pose: Pose, segment: Segment) -> Pose:
    """Pose after driving the whole segment from `pose`; the heading comes back in [-pi, pi]."""
    x, y, heading = pose
    run = segment.gear * segment.length_m
    half = 0.5 * segment.curvature * run
    chord = run * (math.sin(half) / half if half else 1.0)
    angle = heading + half
    return (
        x + chord * math.cos(angle),
        y + chord * math.sin(angle),
        math.remainder(heading + 2.0 * half, _TAU),
    )


def arc_points(pose: Pose, segment: Segment, pieces: int) -> Points:
    """Points that cut the segment driven from `pose` into equal pieces, shape (pieces + 1, 2)."""
    run = np.linspace(0.0, segment.gear * segment.length_m, pieces + 1)
    half = 0.5 * segment.curvature * run
    chord = run * np.sinc(half / math.pi)
    angle = pose[2] + half
    return np.column_stack((pose[0] + chord * np.cos(angle), pose[1] + chord * np.sin(angle)))


def make_path(start: Pose, segments: Iterable[Segment], kind: str) -> Path:
    """A Path without empty segments and with neighbours of equal curvature and gear made one."""
    kept: list[Segment] = []
    for segment in segments:
        if segment.length_m <= _SNAP:
            continue
        last = kept[-1] if kept else None
        if last and last.curvature == segment.curvature and last.gear == segment.gear:
            kept[-1] = Segment(last.length_m + segment.length_m, last.curvature, last.gear)
        else:
            kept.append(segment)
    return Path(start, tuple(kept), kind)


def join(paths: Iterable[Path], kind: str) -> Path:
    """The paths one behind the other as one path of the given kind; each must begin where the last ended."""
    parts = list(paths)
    return make_path(parts[0].start, (s for part in parts for s in part.segments), kind)


def ahead(pose: Pose, distance_m: float) -> Pose:
    """The pose straight ahead of `pose` (behind it when the distance is negative)."""
    x, y, heading = pose
    return x + distance_m * math.cos(heading), y + distance_m * math.sin(heading), heading


def straight(pose: Pose, distance_m: float) -> Path:
    """Straight on from `pose`, in reverse when the distance is negative."""
    gear = 1 if distance_m >= 0.0 else -1
    return make_path(pose, [Segment(abs(distance_m), 0.0, gear)], "route")


def require_radius(radius_m: float) -> None:
    """Raise TurnError unless the radius is a positive finite number."""
    if not (math.isfinite(radius_m) and radius_m > 0.0):
        raise TurnError(f"Turning radius {radius_m} m must be above zero and finite; give the tractor's own.")


def path_of(start: Pose, rows: Points, kind: int) -> Path:
    """A word of the compiled search (n, 3) from a pose as a path; `kind` is one of strategies.ways.words."""
    segments = (Segment(length, curvature, 1 if gear > 0.0 else -1) for length, curvature, gear in rows.tolist())
    return make_path(start, segments, KINDS[kind])


def dubins_paths(a: Pose, b: Pose, radius_m: float) -> list[Path]:
    """All forward words that exist from a to b: LSL, RSR, LSR, RSL, LRL and RLR, the shortest first.

    The three-arc words come with both places of the middle circle. Kinds: three arcs are "omega"; an arc, a
    straight and an arc are "omega" when more than a quarter turn is turned in vain, "u" when the heading changes
    by a quarter turn or more, otherwise "route". Raises TurnError for a radius that is not positive.
    """
    return _words(forward_words, a, b, radius_m)


def three_arc(a: Pose, b: Pose, radius_m: float) -> list[Path]:
    """Reeds-Shepp words C|C|C, forward, reverse, forward, for either hand, the shortest first.

    Only those that turn the heading by a full turn at most are kept; there may be none. Raises
    TurnError for a radius that is not positive.
    """
    return _words(cusped_words, a, b, radius_m)


def back_straight(a: Pose, b: Pose, radius_m: float) -> list[Path]:
    """Words arc forward, straight in reverse, arc forward, for every pair of hands, the shortest first.

    The fishtail turn is the one with both arcs to the same hand. Words that turn by more than a full turn
    altogether are left out. Raises TurnError for a radius that is not positive.
    """
    return _words(backing_words, a, b, radius_m)


def _words(family: Callable[..., int], a: Pose, b: Pose, radius_m: float) -> list[Path]:
    """A family of words as paths."""
    require_radius(radius_m)
    rows, kinds = np.empty((MOST_WORDS, MOST_PIECES, 3)), np.empty(MOST_WORDS, np.int64)
    count = family(np.array(a, float), np.array(b, float), float(radius_m), rows, kinds, 0)
    return [path_of(a, rows[index], int(kinds[index])) for index in range(count)]
