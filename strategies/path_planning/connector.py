"""The quickest drivable path between two poses that stays inside the field.

Searches, each only if the one before found nothing good: the primitives between the two poses, the same primitives
after driving straight on for a little, and a route. A route follows the shortest line round the corners of the free
region (a visibility graph), passing each corner in a pose that a Dubins path joins to the next; where that does not
fit, it follows rings laid inside the region at drivable curvature, and where no ring leads through, a lattice of short
arcs.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from itertools import product
from typing import cast

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from strategies.path_planning.lattice_search import LatticeGrid, find_lattice_route
from strategies.path_planning.paths import (
    DrivePath,
    Pose,
    TurnError,
    build_path_from_rows,
    join_paths,
    make_pose,
    require_radius,
    reverse_path,
    turn_pose_round,
)
from strategies.path_planning.primitive_search import (
    SEARCH_RULES,
    compute_primitive_cost_s,
    compute_shortest_m,
    find_best_primitive,
    find_shortest_forward,
)
from strategies.path_planning.primitives import MAX_PIECES, compute_drive_time_s, is_path_inside
from strategies.path_planning.route_ends import list_start_paths, list_straights_inside
from strategies.path_planning.route_search import (
    UNKNOWN,
    EndMoves,
    Floats,
    Ints,
    RouteLayers,
    RoutePoses,
    can_rings_connect,
    find_all_close_poses,
    find_quickest_chain,
    link_layers,
    link_rings,
)
from strategies.path_planning.turn_kinds import TURN_KINDS
from strategies.path_planning.visibility_graph import VisibilityGraph, list_corner_poses, list_ring_poses
from vehicle.control.speed_profile import UNLIMITED, DrivingLimits

_TOLERANCE_M = 0.010  # how far a path may leave the free region
_SAGITTA_M = 0.003  # part of that tolerance, by which the checked polyline may differ from the arc
_STRAIGHT_ON_M = (0.0, 1.5, 3.0)
_NEAR_RADII = 12.0  # radii; poses farther apart get straights at their ends only in a route
_RING_REACH_RADII = 6.0  # radii to the ring poses joined to a pose
_MAX_CACHED_PATHS, _MAX_CACHED_MOVES = 20000, 2000
_FULL_ARC_RADII = 1.1  # length of arc in radii after which a tractor is where planned
_SHORT_ARC_S = 30.0  # charge for a shorter arc: the swath is begun out of place
_CURVED_REVERSE_S = 20.0  # charge for an arc in reverse: the rear axle leads, and the turn falls short


@dataclass(frozen=True)
class TurnCosts:
    """What a turn costs in time: two speeds (m/s), the seconds lost per direction change, and the limits in bends.

    A direction change costs `cusp_s` for the stop and the shift, and `swing_sm` seconds per 1/m of curvature by which
    the wheels must be turned over meanwhile. Raises TurnError for speeds that are not positive or a negative loss.
    """

    speed_mps: float
    reverse_speed_mps: float
    cusp_s: float
    swing_sm: float = 0.0
    limits: DrivingLimits = UNLIMITED

    def __post_init__(self) -> None:
        for name in ("speed_mps", "reverse_speed_mps"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise TurnError(f"{name} {value} must be above zero and finite; give a driving speed in m/s.")
        for name in ("cusp_s", "swing_sm"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise TurnError(f"{name} {value} must be zero or more and finite; give the loss per direction change.")

    def compute_time_s(self, path: DrivePath) -> float:
        """Seconds to drive the path between two swaths; direction changes at its ends count too."""
        return float(compute_drive_time_s(path.to_rows(), self.speeds))

    @property
    def speeds(self) -> NDArray[np.float64]:
        """The costs as the compiled search takes them (primitives.compute_drive_time_s)."""
        own, limits = (self.speed_mps, self.reverse_speed_mps, self.cusp_s, self.swing_sm), self.limits
        bends = limits.lateral_mps2, limits.steering_mps, limits.window_m, limits.length_m, limits.deceleration_mps2
        return np.array([*own, *bends])


class Connector:
    """Finds the quickest path between two poses that stays inside the field.

    `free` is where the path point may be (Polygon or MultiPolygon, metres, holes are obstacles). `kinds` are the turns
    allowed; without "switch-back" nothing is driven in reverse. Routes are always allowed. A manoeuvre holds at most
    `max_reverse_m` in reverse, and a route one manoeuvre at either end. `before_search` is called before every search
    and may raise. Raises TurnError for an empty region, a radius that is not positive or an unknown kind.
    """

    def __init__(
        self,
        free: BaseGeometry,
        radius_m: float,
        costs: TurnCosts,
        kinds: tuple[str, ...] = TURN_KINDS,
        max_reverse_m: float = math.inf,
        before_search: Callable[[], None] | None = None,
    ) -> None:
        require_radius(radius_m)
        if free.is_empty or free.area == 0.0:
            raise TurnError("No room is left for a path; the field must be wider than the implement.")
        for kind in kinds:
            if kind not in TURN_KINDS:
                raise TurnError(f'Turn kind "{kind}" is unknown; use {", ".join(TURN_KINDS)}.')
        self.free, self.radius_m, self.costs = free, radius_m, costs
        self.kinds, self.max_reverse_m = tuple(kinds), max_reverse_m
        self._before_search = before_search
        self._guard = free.buffer(_TOLERANCE_M - _SAGITTA_M)
        shapely.prepare(self._guard)
        self._parts = shapely.get_parts(self._guard)
        shapely.prepare(self._parts)
        self._paths: dict[tuple[Pose, Pose], DrivePath | None] = {}
        self._links: dict[tuple[Pose, Pose], DrivePath | None] = {}
        self._moves: dict[tuple[Pose, int, bool], EndMoves] = {}
        self._edges = _list_boundary_edges(self._guard)
        self._rules = self._make_rules()
        self._row = np.zeros((MAX_PIECES, 3))

    def connect(self, a: Pose, b: Pose) -> DrivePath | None:
        """The quickest path found from a to b inside the region, or None if nothing fits; cached.

        Equal times (to the microsecond) go to the primitive that comes first in a fixed order.
        """
        if (a, b) not in self._paths:
            if len(self._paths) >= _MAX_CACHED_PATHS:
                self._paths.clear()
            search = self._search if self._is_same_region_part(a, b) else self._search_from_outside
            self._paths[a, b] = search(a, b)
        return self._paths[a, b]

    def _search_from_outside(self, a: Pose, b: Pose) -> DrivePath | None:
        """As `connect`, for ends of which one is a little outside the region: straight ahead or back into it first.

        The end of a swath that meets the edge at a sharp angle may lie a little outside.
        """
        reverse_m = self.max_reverse_m if self.can_reverse else 0.0
        leads, tails = (
            list_straights_inside(pose, self._guard, self.radius_m, reverse_m) for pose in (a, turn_pose_round(b))
        )
        paths = [
            join_paths((lead, path, reverse_path(tail)), "route")
            for lead, tail in product(leads, tails)
            if self._is_same_region_part(lead.end, turn_pose_round(tail.end))
            and (lead.segments or tail.segments)
            and (path := self.connect(lead.end, turn_pose_round(tail.end)))
        ]
        return min(paths, key=lambda path: round(self.compute_cost_s(path), 6), default=None)

    def connect_in_reverse(self, a: Pose, b: Pose) -> DrivePath | None:
        """As `connect`, with any length in reverse: for ends between which nothing else leads."""
        return self._unlimited.connect(a, b) if self.can_reverse else None

    @cached_property
    def _unlimited(self) -> Connector:
        """The same connector without a limit of reversing."""
        return Connector(self.free, self.radius_m, self.costs, self.kinds, before_search=self._before_search)

    def _search(self, a: Pose, b: Pose) -> DrivePath | None:
        """As `connect`, for ends in the same part of the region."""
        if self._before_search is not None:
            self._before_search()
        best = self._find_best_primitive(a, b)
        if best is None or self._is_long_detour(best, a, b):
            best = self._pick_quicker(best, self._find_route(a, b))
        return best or self._find_lattice_route(a, b)

    def _find_lattice_route(self, a: Pose, b: Pose) -> DrivePath | None:
        """A route over the lattice: first driven forwards between its ends, then with a manoeuvre on the way."""
        reverse_m = min(self.max_reverse_m, self._lattice_grid.reach_m) if self.can_reverse else 0.0
        for effort, most_reverse_m in ((1, 0.0), (2, reverse_m)) if self.can_reverse else ((0, 0.0),):
            begin, end = self._get_end_moves(a, b, effort)
            speeds, edges = self.costs.speeds, self._edges
            route = find_lattice_route(begin, end, self._lattice_grid, self.radius_m, speeds, edges, most_reverse_m)
            if route is not None:
                return route
        return None

    @cached_property
    def _lattice_grid(self) -> LatticeGrid:
        return LatticeGrid.from_region(self._guard, self.radius_m)

    def connect_directly(self, a: Pose, b: Pose) -> DrivePath | None:
        """As `connect`, without the search for routes: None where only a route would do."""
        best = self._find_best_primitive(a, b)
        return None if best is None or self._is_long_detour(best, a, b) else best

    def _is_same_region_part(self, a: Pose, b: Pose) -> bool:
        """Whether both ends lie in the same part of the region."""
        ends = shapely.multipoints([a[:2], b[:2]])
        return bool(shapely.covers(self._parts, ends).any())

    def _make_rules(self) -> np.record:
        """The rules of the compiled search, a record of SEARCH_RULES."""
        rules = np.zeros((), dtype=SEARCH_RULES)
        rules["radius"], rules["speeds"] = self.radius_m, self.costs.speeds
        rules["kinds"] = 1.0, *(kind in self.kinds for kind in TURN_KINDS)
        rules["full_arc"], rules["short_s"], rules["curved_s"] = _FULL_ARC_RADII, _SHORT_ARC_S, _CURVED_REVERSE_S
        rules["near"], rules["steps"] = _NEAR_RADII, _STRAIGHT_ON_M
        rules["most_reverse"] = self.max_reverse_m
        return cast(np.record, rules.view(np.recarray)[()])

    def _find_best_primitive(self, a: Pose, b: Pose) -> DrivePath | None:
        """The best primitive that fits, with straights at its ends if that helps."""
        kind = find_best_primitive(np.array(a), np.array(b), self._rules, self._edges, self._row)
        return None if kind < 0 else build_path_from_rows(a, self._row, kind)

    def fits(self, path: DrivePath) -> bool:
        """Whether the whole path stays inside the region (tolerance 1 cm)."""
        return bool(is_path_inside(np.array(path.start), path.to_rows(), self._edges))

    @property
    def can_reverse(self) -> bool:
        """Whether reversing is allowed."""
        return "switch-back" in self.kinds

    def compute_cost_s(self, path: DrivePath) -> float:
        """Seconds to drive the path, plus a charge if a tractor cannot be expected to follow it closely."""
        return float(compute_primitive_cost_s(path.to_rows(), self._rules))

    def _pick_quicker(self, p: DrivePath | None, q: DrivePath | None) -> DrivePath | None:
        if p is None or q is None:
            return p or q
        return q if round(self.compute_cost_s(q), 6) < round(self.compute_cost_s(p), 6) else p

    def _is_long_detour(self, path: DrivePath, a: Pose, b: Pose) -> bool:
        """Whether a direct path is so much longer than the shortest without obstacles that a route may beat it."""
        spare_m = 4.0 * math.pi * self.radius_m
        return (
            path.length_m > compute_shortest_m(np.array(a), np.array(b), self.radius_m) + spare_m
            or path.reverse_m > spare_m
        )

    def _find_route(self, a: Pose, b: Pose) -> DrivePath | None:
        """A route by corners, else by rings; first without reversing, then with ever more of it at the ends."""
        corner_layers = [RouteLayers.from_layers(layers) for layers in self._list_corner_layers(a, b)]
        end_moves = [self._get_end_moves(a, b, effort) for effort in ((0, 1) if self.can_reverse else (0,))]
        for starts, goals in end_moves:
            route = self._route_by_corners(corner_layers, starts, goals)
            if route is not None:
                return route
        if self.can_reverse:
            end_moves.append(self._get_end_moves(a, b, 2))
            route = self._route_by_corners(corner_layers, *end_moves[-1])
        return route or self._route_beside_corners(end_moves, sight=any(not layers.sizes for layers in corner_layers))

    def _route_beside_corners(self, ends: list[tuple[EndMoves, EndMoves]], sight: bool) -> DrivePath | None:
        """The first route by rings for ends of ever more effort; each pair of ends includes those before it.

        Where no rings lead through, only a primitive from end to end remains; that was tried if the ends see each
        other.
        """
        if self._can_route_by_rings(*ends[-1]):
            return next((path for move_pair in ends if (path := self._route_by_rings(*move_pair))), None)
        if sight or self._route_by_layers(*ends[-1], RouteLayers.from_layers([]), math.inf) is None:
            return None
        return next(
            (
                route
                for move_pair in ends
                if (route := self._route_by_layers(*move_pair, RouteLayers.from_layers([]), math.inf))
            ),
            None,
        )

    def _get_end_moves(self, a: Pose, b: Pose, effort: int) -> tuple[EndMoves, EndMoves]:
        """What may be driven before the first primitive of a route and after its last; cached."""
        end_moves = []
        for pose, is_start in ((a, True), (b, False)):
            key = pose, effort, is_start
            if key not in self._moves:
                if len(self._moves) >= _MAX_CACHED_MOVES:
                    self._moves.clear()
                self._moves[key] = self._build_moves(self._list_end_paths(pose, effort, is_start), is_start)
            end_moves.append(self._moves[key])
        return end_moves[0], end_moves[1]

    def _build_moves(self, paths: list[DrivePath], is_start: bool) -> EndMoves:
        spots = RoutePoses.from_poses([path.end if is_start else path.start for path in paths])
        return EndMoves(paths, spots, np.array([self.costs.compute_time_s(path) for path in paths]))

    def _list_end_paths(self, pose: Pose, effort: int, is_start: bool) -> list[DrivePath]:
        """What may be driven from a pose before the first primitive of a route, or to it after the last."""
        if is_start:
            paths = list_start_paths(pose, effort, self.radius_m, self.fits)
        else:
            paths = [
                reverse_path(path) for path in list_start_paths(turn_pose_round(pose), effort, self.radius_m, self.fits)
            ]
        return [path for path in paths if path.reverse_m <= self.max_reverse_m]

    def _list_corner_layers(self, a: Pose, b: Pose) -> Iterator[list[list[Pose]]]:
        """For each of the few shortest lines through the visibility graph, poses in which its corners are passed."""
        for points in self._visibility_graph.find_shortest_lines(a, b):
            bends = zip(points, points[1:], points[2:], strict=False)
            yield [self._keep_inside(list_corner_poses(p, q, r, self.radius_m)) for p, q, r in bends]

    def _route_by_corners(
        self, corner_layers: list[RouteLayers], starts: EndMoves, goals: EndMoves
    ) -> DrivePath | None:
        """The quickest route along the few shortest lines through the visibility graph."""
        best: DrivePath | None = None
        for layers in corner_layers:
            limit = self.costs.compute_time_s(best) if best else math.inf
            best = self._route_by_layers(starts, goals, layers, limit) or best
        return best

    def _route_by_layers(
        self, starts: EndMoves, goals: EndMoves, layers: RouteLayers, limit_s: float
    ) -> DrivePath | None:
        """Quickest chain from a start through one pose of each layer to a goal, if quicker than limit_s."""
        if not starts.paths or not goals.paths:
            return None
        sizes = np.array([len(starts.paths), *layers.sizes, len(goals.paths)])
        no_ring_graph = np.zeros(sizes.sum() + 1, np.int64), np.empty(0, np.int64), np.empty(0)
        return self._build_chain(starts, layers.spots, goals, link_layers(sizes), no_ring_graph, limit_s)

    def _route_by_rings(self, begin: EndMoves, end: EndMoves) -> DrivePath | None:
        """Quickest chain from a start along ring poses to a goal, shortened where links can be left out."""
        if not begin.paths or not end.paths:
            return None
        ring, ring_graph = self._ring_graph
        first, first_goal = len(begin.paths), len(begin.paths) + len(ring.poses)
        poses = RoutePoses.from_parts([begin.spots, ring, end.spots]).poses
        graph = link_rings(poses, first, first_goal, _RING_REACH_RADII * self.radius_m, self.radius_m)
        return self._build_chain(begin, ring, end, graph, ring_graph)

    def _can_route_by_rings(self, begin: EndMoves, end: EndMoves) -> bool:
        """Whether any chain along ring poses exists."""
        ring, ring_graph = self._ring_graph
        count = len(ring.poses)
        if not begin.paths or not end.paths or not count:
            return False
        parts = begin.spots, ring, end.spots
        spots = RoutePoses.from_parts(parts)
        is_connected = can_rings_connect(
            spots.poses,
            spots.rooms,
            len(begin.paths),
            len(begin.paths) + count,
            ring_graph,
            begin.get_ring_states(count),
            end.get_ring_states(count),
            _RING_REACH_RADII * self.radius_m,
            self.radius_m,
            self.radius_m,
            self.costs.speeds,
            self._edges,
        )
        spots.update_parts(parts)
        return bool(is_connected)

    def _build_chain(
        self,
        starts: EndMoves,
        between: RoutePoses,
        goals: EndMoves,
        graph: tuple[Ints, Ints],
        ring_graph: tuple[Ints, Ints, Floats],
        limit_s: float = math.inf,
    ) -> DrivePath | None:
        """The route along the quickest chain of poses from a start to a goal, in a graph of all of them."""
        parts = starts.spots, between, goals.spots
        spots, link_times_s = RoutePoses.from_parts(parts), np.full(len(graph[1]), UNKNOWN)
        chain = find_quickest_chain(
            spots.poses,
            spots.rooms,
            starts.seconds,
            goals.seconds,
            (*graph, link_times_s),
            ring_graph,
            self.radius_m,
            self.costs.speeds,
            self._edges,
            limit_s,
        ).tolist()
        spots.update_parts(parts)
        if not chain:
            return None
        links = self._shorten_links([make_pose(spots.poses[i]) for i in chain])
        first, last = starts.paths[chain[0]], goals.paths[chain[-1] - len(spots.poses) + len(goals.paths)]
        return join_paths((first, *links, last), "route")

    def _shorten_links(self, poses: list[Pose]) -> list[DrivePath]:
        """Links along the poses, without those that a direct primitive replaces by a shorter path."""
        links: list[DrivePath] = []
        i = 0
        while i < len(poses) - 1:
            farthest, best_link = i + 1, self._get_forward_link(poses[i], poses[i + 1])
            length_m = best_link.length_m if best_link else 0.0
            for j in range(i + 2, len(poses)):
                step = self._get_forward_link(poses[j - 1], poses[j])
                length_m += step.length_m if step else 0.0
                direct_link = self._get_forward_link(poses[i], poses[j])
                if direct_link is not None and direct_link.length_m <= length_m + 1e-9:
                    farthest, best_link = j, direct_link
            if best_link is not None:
                links.append(best_link)
            i = farthest
        return links

    def _get_forward_link(self, p: Pose, q: Pose) -> DrivePath | None:
        """The shortest fitting of the three shortest Dubins paths; cached."""
        key = (p, q)
        if key not in self._links:
            if len(self._links) >= _MAX_CACHED_PATHS:
                self._links.clear()
            kind = find_shortest_forward(np.array(p), np.array(q), self.radius_m, self._edges, 3, self._row)
            self._links[key] = None if kind < 0 else build_path_from_rows(p, self._row, kind)
        return self._links[key]

    def _keep_inside(self, poses: list[Pose]) -> list[Pose]:
        is_held = shapely.covers(self._guard, shapely.points([pose[:2] for pose in poses]))
        return [pose for pose, is_inside in zip(poses, is_held, strict=True) if is_inside]

    @cached_property
    def _visibility_graph(self) -> VisibilityGraph:
        return VisibilityGraph(self.free, self._guard)

    @cached_property
    def _ring_graph(self) -> tuple[RoutePoses, tuple[Ints, Ints, Floats]]:
        """Ring poses, which of them may follow which, and the link times known so far."""
        spots = RoutePoses.from_poses(list_ring_poses(self.free, self.radius_m))
        near = find_all_close_poses(spots.poses, _RING_REACH_RADII * self.radius_m, self.radius_m)
        return spots, (*near, np.full(len(near[1]), UNKNOWN))


def _list_boundary_edges(region: BaseGeometry) -> NDArray[np.float64]:
    """Edges (n, 4) of the rings of a Polygon or MultiPolygon: x, y of both ends."""
    rings = [
        np.asarray(ring.coords)[:, :2]
        for part in shapely.get_parts(region)
        if isinstance(part, shapely.Polygon)
        for ring in (part.exterior, *part.interiors)
    ]
    return np.concatenate([np.hstack([ring[:-1], ring[1:]]) for ring in rings])


@dataclass(eq=False)
class ConnectorCache:
    """Connectors by region and settings, made once, so that every layout that uses one shares what it has found.

    It is pickled empty.
    """

    connectors: dict[tuple[bytes, float, TurnCosts, tuple[str, ...], float], Connector] = field(default_factory=dict)
    before_search: Callable[[], None] | None = None

    def get_connector(
        self,
        region: BaseGeometry,
        radius_m: float,
        costs: TurnCosts,
        kinds: tuple[str, ...],
        max_reverse_m: float = math.inf,
    ) -> Connector:
        """The connector for these; raises TurnError as Connector does."""
        key = region.wkb, radius_m, costs, kinds, max_reverse_m
        if key not in self.connectors:
            self.connectors[key] = Connector(region, radius_m, costs, kinds, max_reverse_m, self.before_search)
        return self.connectors[key]

    def __getstate__(self) -> dict[str, object]:
        return {"connectors": {}}
