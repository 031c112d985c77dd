"""The quickest drivable way between two poses that stays inside the field.

Three searches, each only when the one before found nothing good: the words of `strategies.ways.paths` between the two
poses themselves, the same words after driving straight on for a little, and a route. A route follows the shortest
way round the corners of the free region (a visibility graph), passing each corner in a pose from which the next
is joined by a Dubins word; where that does not fit, it follows rings laid inside the region at drivable curvature.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import cast

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from strategies.ways.chains import UNKNOWN, Floats, Ints, all_close_by, layered, quickest_chain, round_rings
from strategies.ways.paths import (
    Path,
    Pose,
    Segment,
    TurnError,
    join,
    make_path,
    path_of,
    require_radius,
    straight,
)
from strategies.ways.reach import Layers, Moves, Spots, rings_lead
from strategies.ways.routes import Corners, corner_poses, ring_poses
from strategies.ways.search import RULES, best_costs, best_word, cost_s, shortest_forward, shortest_m
from strategies.ways.turns import TURN_KINDS
from strategies.ways.words import MOST_PIECES, driven_s, stays_inside

_TOLERANCE_M = 0.010  # how far a path may leave the free region
_SAGITTA_M = 0.003  # of that, what the polyline checked may differ from the arc
_STRAIGHT_ON_M = (0.0, 1.5, 3.0)
_NEAR = 12.0  # radii; farther apart, straights at the ends are left to the route
_ROUTE_AHEAD = (0.0, 0.25, 0.5, 1.0, 1.5)  # radii straight on at the ends of a route
_ROUTE_BACK = (0.5, 1.0, 2.0, 3.0, 5.0, 8.0)  # radii straight back
_ROUNDS = tuple((arcs, hand) for arcs in (3, 5, 9) for hand in (1, -1))  # ways to turn round on the spot
_RING_REACH = 6.0  # radii to the ring poses joined to a pose
_MOST_REMEMBERED, _MOST_MOVES = 20000, 2000
_FULL_ARC = 1.1  # radii of arc that a tractor needs to be where planned at the end of it
_SHORT_ARC_S = 30.0  # what a shorter arc is charged for the swath begun out of place
_CURVED_REVERSE_S = 20.0  # and an arc driven in reverse: the rear axle leads there, and the heading comes out short


@dataclass(frozen=True)
class TurnCosts:
    """What a turn costs in time: two speeds (m/s) and the seconds lost per direction change.

    A way with any reversing in it is driven at `reverse_speed_mps` all along.

    A direction change costs `cusp_s` for the stop and the shift, and `swing_sm` seconds per 1/m of curvature by
    which the wheels must be turned over meanwhile. Raises TurnError for speeds that are not positive or a
    negative loss.
    """

    speed_mps: float
    reverse_speed_mps: float
    cusp_s: float
    swing_sm: float = 0.0

    def __post_init__(self) -> None:
        for name in ("speed_mps", "reverse_speed_mps"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise TurnError(f"{name} {value} must be above zero and finite; give a driving speed in m/s.")
        for name in ("cusp_s", "swing_sm"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise TurnError(f"{name} {value} must be zero or more and finite; give the loss per direction change.")

    def time_s(self, path: Path) -> float:
        """Seconds to drive the path; a path that begins or ends in reverse is charged the change there too."""
        return float(driven_s(path.rows(), self.speeds))

    @property
    def speeds(self) -> NDArray[np.float64]:
        """As the compiled search takes them (strategies.ways.words.driven_s)."""
        return np.array([self.speed_mps, self.reverse_speed_mps, self.cusp_s, self.swing_sm])


class Connector:
    """Finds the quickest path between two poses that stays inside the field.

    `free` is where the path point may be (Polygon or MultiPolygon, metres, holes are obstacles). `kinds` are the
    turns allowed; without "switch-back" nothing is ever driven in reverse. Routes are always allowed. Raises TurnError
    for an empty region, a radius that is not positive or an unknown kind.
    """

    def __init__(
        self,
        free: BaseGeometry,
        radius_m: float,
        costs: TurnCosts,
        kinds: tuple[str, ...] = TURN_KINDS,
    ) -> None:
        require_radius(radius_m)
        if free.is_empty or free.area == 0.0:
            raise TurnError("The region a path may use is empty; the field must be wider than the implement.")
        for kind in kinds:
            if kind not in TURN_KINDS:
                raise TurnError(f'Turn kind "{kind}" is not known; use {", ".join(TURN_KINDS)}.')
        self.free = free
        self.radius_m = radius_m
        self.costs = costs
        self.kinds = tuple(kinds)
        self._guard = free.buffer(_TOLERANCE_M - _SAGITTA_M)
        shapely.prepare(self._guard)
        self._parts = shapely.get_parts(self._guard)
        shapely.prepare(self._parts)
        self._ways: dict[tuple[Pose, Pose], Path | None] = {}
        self._links: dict[tuple[Pose, Pose], Path | None] = {}
        self._moves: dict[tuple[Pose, int, bool], Moves] = {}
        self._edges = _boundary(self._guard)
        self._rules = self._make_rules()
        self._row = np.zeros((MOST_PIECES, 3))

    def connect(self, a: Pose, b: Pose) -> Path | None:
        """The quickest path found from a to b inside the region, or None when nothing fits.

        Equal times (to the microsecond) go to the word that comes first in a fixed order. What was found is remembered,
        and so is that nothing was.
        """
        if (a, b) not in self._ways:
            if len(self._ways) >= _MOST_REMEMBERED:
                self._ways.clear()
            self._ways[a, b] = self._searched(a, b) if self._joined(a, b) else None
        return self._ways[a, b]

    def _searched(self, a: Pose, b: Pose) -> Path | None:
        """As `connect`, for ends in one piece of the region."""
        best = self._best_word(a, b)
        if best is None or self._roundabout(best, a, b):
            best = self._quicker(best, self._route(a, b))
        return best

    def direct(self, a: Pose, b: Pose) -> Path | None:
        """As `connect`, without the search for routes: None where only a route would do."""
        best = self._best_word(a, b)
        return None if best is None or self._roundabout(best, a, b) else best

    def direct_costs(self, starts: Floats, ends: Floats, pairs: Ints) -> Floats:
        """`cost` and metres (k, 2) of what `direct` finds for many pairs; infinite where it finds nothing.

        `pairs` (k, 2) are numbers of `starts` (n, 3) and `ends` (m, 3); those with one start follow one another.
        """
        costs: Floats = best_costs(starts, ends, pairs, self._rules, self._edges)
        return costs

    def _joined(self, a: Pose, b: Pose) -> bool:
        """Whether both ends lie in one piece of the region."""
        ends = shapely.multipoints([a[:2], b[:2]])
        return bool(shapely.covers(self._parts, ends).any())

    def _make_rules(self) -> np.record:
        """What the compiled search is told."""
        rules = np.zeros((), dtype=RULES)
        rules["radius"], rules["speeds"] = self.radius_m, self.costs.speeds
        rules["kinds"] = 1.0, *(kind in self.kinds for kind in TURN_KINDS)
        rules["full_arc"], rules["short_s"], rules["curved_s"] = _FULL_ARC, _SHORT_ARC_S, _CURVED_REVERSE_S
        rules["near"], rules["steps"] = _NEAR, _STRAIGHT_ON_M
        return cast(np.record, rules.view(np.recarray)[()])

    def _best_word(self, a: Pose, b: Pose) -> Path | None:
        """The best word that fits, with straights at its ends where that helps."""
        kind = best_word(np.array(a), np.array(b), self._rules, self._edges, self._row)
        return None if kind < 0 else path_of(a, self._row, kind)

    def fits(self, path: Path) -> bool:
        """Whether the whole path stays inside the region (tolerance 1 cm)."""
        return bool(stays_inside(np.array(path.start), path.rows(), self._edges))

    @property
    def reversing(self) -> bool:
        """Whether anything may be driven in reverse."""
        return "switch-back" in self.kinds

    def cost(self, path: Path) -> float:
        """Seconds to drive the path, and a charge where a tractor cannot be expected to follow it closely."""
        return float(cost_s(path.rows(), self._rules))

    def _quicker(self, p: Path | None, q: Path | None) -> Path | None:
        if p is None or q is None:
            return p or q
        return q if round(self.cost(q), 6) < round(self.cost(p), 6) else p

    def _roundabout(self, path: Path, a: Pose, b: Pose) -> bool:
        """Whether a direct path is so much longer than the free-space shortest that a route may beat it."""
        spare = 4.0 * math.pi * self.radius_m
        return path.length_m > shortest_m(np.array(a), np.array(b), self.radius_m) + spare or path.reverse_m > spare

    def _route(self, a: Pose, b: Pose) -> Path | None:
        """A route by corners, else by rings; first without reversing, then with ever more of it at the ends."""
        bends = [Layers.of(layers) for layers in self._bends(a, b)]
        ends = [self._ends(a, b, effort) for effort in ((0, 1) if self.reversing else (0,))]
        for starts, goals in ends:
            way = self._by_corners(bends, starts, goals)
            if way is not None:
                return way
        if self.reversing:
            ends.append(self._ends(a, b, 2))
            way = self._by_corners(bends, *ends[-1])
        return way or self._beside_corners(ends, sight=any(not layers.sizes for layers in bends))

    def _beside_corners(self, ends: list[tuple[Moves, Moves]], sight: bool) -> Path | None:
        """The first route by rings for ends of ever more effort, the last of which hold all that those before hold.

        Where rings lead nowhere only a word from end to end is left, and that was tried where one end sees the other.
        """
        if self._rings_lead(*ends[-1]):
            return next((path for pair in ends if (path := self._by_rings(*pair))), None)
        if sight or self._by_layers(*ends[-1], Layers.of([]), math.inf) is None:
            return None
        return next((way for pair in ends if (way := self._by_layers(*pair, Layers.of([]), math.inf))), None)

    def _ends(self, a: Pose, b: Pose, effort: int) -> tuple[Moves, Moves]:
        """What may be driven before the first word of a route and after its last, remembered for the next route."""
        found = []
        for pose, moves, before in ((a, self._starts, True), (b, self._goals, False)):
            key = pose, effort, before
            if key not in self._moves:
                if len(self._moves) >= _MOST_MOVES:
                    self._moves.clear()
                self._moves[key] = self._moves_of(moves(pose, effort), before)
            found.append(self._moves[key])
        return found[0], found[1]

    def _moves_of(self, ways: list[Path], before: bool) -> Moves:
        spots = Spots.at([way.end if before else way.start for way in ways])
        return Moves(ways, spots, np.array([self.costs.time_s(way) for way in ways]))

    def _starts(self, a: Pose, effort: int) -> list[Path]:
        """What may be driven before the first word of a route.

        Effort 0 is straights ahead; 1 adds backing up and turning round in three arcs; 2 adds turning round in
        more, shorter arcs, also after backing up or going ahead.
        """
        r = self.radius_m
        moves = [straight(a, f * r) for f in _ROUTE_AHEAD]
        if effort >= 1:
            moves += [straight(a, -f * r) for f in _ROUTE_BACK]
        if effort >= 2:
            bases = [move for move in moves if self.fits(move)]
            moves += [join((m, _turn_round(m.end, h, n, r)), "route") for m in bases for n, h in _ROUNDS]
        elif effort == 1:
            moves += [_turn_round(a, hand, 3, r) for hand in (1, -1)]
        return [move for move in moves if self.fits(move)]

    def _goals(self, b: Pose, effort: int) -> list[Path]:
        """What may be driven after the last word of a route: `_starts` driven from its end."""
        x, y, heading = b
        return [_driven_back(move) for move in self._starts((x, y, heading + math.pi), effort)]

    def _bends(self, a: Pose, b: Pose) -> Iterator[list[list[Pose]]]:
        """For each of the few shortest ways through the visibility graph the poses in which its corners are passed."""
        for way in self._corners.ways(a, b):
            bends = zip(way, way[1:], way[2:], strict=False)
            yield [self._inside(corner_poses(p, q, r, self.radius_m)) for p, q, r in bends]

    def _by_corners(self, bends: list[Layers], starts: Moves, goals: Moves) -> Path | None:
        """The quickest route along the few shortest ways through the visibility graph."""
        best: Path | None = None
        for layers in bends:
            limit = self.costs.time_s(best) if best else math.inf
            best = self._by_layers(starts, goals, layers, limit) or best
        return best

    def _by_layers(self, starts: Moves, goals: Moves, layers: Layers, limit_s: float) -> Path | None:
        """Quickest chain from a start through one pose of each layer to a goal, if quicker than limit_s."""
        if not starts.ways or not goals.ways:
            return None
        sizes = np.array([len(starts.ways), *layers.sizes, len(goals.ways)])
        none = np.zeros(sizes.sum() + 1, np.int64), np.empty(0, np.int64), np.empty(0)
        return self._chain(starts, layers.spots, goals, layered(sizes), none, limit_s)

    def _by_rings(self, begin: Moves, end: Moves) -> Path | None:
        """Quickest chain from a start along ring poses to a goal, then made shorter where links can be left out."""
        if not begin.ways or not end.ways:
            return None
        ring, kept = self._ring
        first, first_goal = len(begin.ways), len(begin.ways) + len(ring.poses)
        poses = Spots.of([begin.spots, ring, end.spots]).poses
        graph = round_rings(poses, first, first_goal, _RING_REACH * self.radius_m, self.radius_m)
        return self._chain(begin, ring, end, graph, kept)

    def _rings_lead(self, begin: Moves, end: Moves) -> bool:
        """Whether there is any chain along ring poses."""
        ring, kept = self._ring
        count = len(ring.poses)
        if not begin.ways or not end.ways or not count:
            return False
        parts = begin.spots, ring, end.spots
        spots = Spots.of(parts)
        led = rings_lead(
            spots.poses, spots.rooms, len(begin.ways), len(begin.ways) + count, kept, begin.asked(count),
            end.asked(count), _RING_REACH * self.radius_m, self.radius_m, self.radius_m, self.costs.speeds, self._edges,
        )  # fmt: skip
        spots.learn(parts)
        return bool(led)

    def _chain(
        self,
        starts: Moves,
        between: Spots,
        goals: Moves,
        graph: tuple[Ints, Ints],
        kept: tuple[Ints, Ints, Floats],
        limit_s: float = math.inf,
    ) -> Path | None:
        """The route along the quickest chain of poses from a start to a goal, in a graph of all of them."""
        parts = starts.spots, between, goals.spots
        spots, links = Spots.of(parts), np.full(len(graph[1]), UNKNOWN)
        chain = quickest_chain(
            spots.poses, spots.rooms, starts.seconds, goals.seconds, (*graph, links), kept, self.radius_m,
            self.costs.speeds, self._edges, limit_s,
        ).tolist()  # fmt: skip
        spots.learn(parts)
        if not chain:
            return None
        way = self._shortcut([_pose(spots.poses[i]) for i in chain])
        first, last = starts.ways[chain[0]], goals.ways[chain[-1] - len(spots.poses) + len(goals.ways)]
        return join((first, *way, last), "route")

    def _shortcut(self, poses: list[Pose]) -> list[Path]:
        """Links along the poses, leaving out those that a direct word passes by on a shorter way."""
        links: list[Path] = []
        i = 0
        while i < len(poses) - 1:
            far, best = i + 1, self._link(poses[i], poses[i + 1])
            length = best.length_m if best else 0.0
            for j in range(i + 2, len(poses)):
                step = self._link(poses[j - 1], poses[j])
                length += step.length_m if step else 0.0
                direct = self._link(poses[i], poses[j])
                if direct is not None and direct.length_m <= length + 1e-9:
                    far, best = j, direct
            if best is not None:
                links.append(best)
            i = far
        return links

    def _link(self, p: Pose, q: Pose) -> Path | None:
        """The shortest fitting Dubins word of the three shortest, remembered for the next route."""
        key = (p, q)
        if key not in self._links:
            if len(self._links) >= _MOST_REMEMBERED:
                self._links.clear()
            kind = shortest_forward(np.array(p), np.array(q), self.radius_m, self._edges, 3, self._row)
            self._links[key] = None if kind < 0 else path_of(p, self._row, kind)
        return self._links[key]

    def _inside(self, poses: list[Pose]) -> list[Pose]:
        held = shapely.covers(self._guard, shapely.points([pose[:2] for pose in poses]))
        return [pose for pose, ok in zip(poses, held, strict=True) if ok]

    @cached_property
    def _corners(self) -> Corners:
        return Corners(self.free, self._guard)

    @cached_property
    def _ring(self) -> tuple[Spots, tuple[Ints, Ints, Floats]]:
        """Ring poses, and which may follow which, with what is known of their links."""
        spots = Spots.at(ring_poses(self.free, self.radius_m))
        near = all_close_by(spots.poses, _RING_REACH * self.radius_m, self.radius_m)
        return spots, (*near, np.full(len(near[1]), UNKNOWN))


def _pose(row: Floats) -> Pose:
    x, y, heading = row.tolist()
    return x, y, heading


def _boundary(region: BaseGeometry) -> NDArray[np.float64]:
    """Edges (n, 4) of the rings of a Polygon or MultiPolygon: x, y of both ends."""
    rings = [
        np.asarray(ring.coords)[:, :2]
        for part in shapely.get_parts(region)
        if isinstance(part, shapely.Polygon)
        for ring in (part.exterior, *part.interiors)
    ]
    return np.concatenate([np.hstack([ring[:-1], ring[1:]]) for ring in rings])


def _turn_round(a: Pose, hand: int, arcs: int, radius_m: float) -> Path:
    """An odd number of equal arcs, forward and reverse by turns, that face the other way nearly on the spot."""
    length = math.pi / arcs * radius_m
    steps = [(1, hand), (-1, -hand)] * (arcs // 2) + [(1, hand)]
    return make_path(a, [Segment(length, side / radius_m, gear) for gear, side in steps], "switch-back")


def _driven_back(path: Path) -> Path:
    """The same way driven from its end to its start by a vehicle that faces the other way round."""
    x, y, heading = path.end
    segments = [Segment(s.length_m, -s.curvature, s.gear) for s in reversed(path.segments)]
    return make_path((x, y, math.remainder(heading + math.pi, 2.0 * math.pi)), segments, path.kind)
