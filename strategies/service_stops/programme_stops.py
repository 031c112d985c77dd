"""Programmes with service stops: every tractor is served before its load is used up, where that costs least time.

At its place it stands along the nearest edge, either way, with room straight before and behind.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely

from fields.arrays import Floats
from strategies.moves.drives import build_path_legs
from strategies.moves.move import Move
from strategies.moves.move_finder import MOVE_MARGIN_M
from strategies.path_planning.errors import StrategyError
from strategies.path_planning.paths import Pose, shift_pose_ahead
from strategies.programmes.move_table import MoveTable
from strategies.programmes.programme import Programme
from strategies.programmes.tour_legs import (
    build_move,
    build_stand,
    build_way_in,
    build_way_out,
    split_work_leg,
    stand_to_unfold,
)
from strategies.rules.legs import add_wait_points, make_mission
from strategies.rules.supply import PLACE, Point, Supply
from strategies.service_stops.load_tours import order_for_loads
from strategies.service_stops.service_gates import (
    WAIT_POINT_STEP_M,
    ServiceStop,
    add_service_gates,
    find_waiting_leg,
    note_stops,
)
from strategies.service_stops.stop_moves import StopMoves
from strategies.service_stops.tour_parts import TourPart, measure_line_need
from strategies.service_stops.tour_stops import Span, TourGaps, TourStop
from strategies.site.ground import CELL_M, measure_rooms
from strategies.site.site import Site
from vehicle.missions.plan import REFILL, ROUTE, TURN, Leg, LegTask, Mission, Plan

STEP_COUNT, STEP_RADII = 8, 0.5  # places tried on either side, and radii between them
INSET_COUNT, INSET_HALVES = 3, 0.5  # rows tried, the first as near to the edge as the body may be; half widths between


@dataclass(frozen=True, eq=False)
class StoppedProgramme:
    """A programme whose tractors are served in time.

    Attributes:
        gaps: (per tractor) the gaps of its tour, where stops may be made.
        stops: (per tractor) the stops that are made, in order.
    """

    programme: Programme
    supply: Supply
    gaps: tuple[TourGaps, ...]
    stops: tuple[tuple[TourStop, ...], ...]

    def compute_tractor_s(self) -> list[float]:
        """Seconds that every tractor drives and stands, without waiting for others."""
        return [
            gaps.driven_s + sum(stop.detour.extra_s + stop.stand_s for stop in stops)
            for gaps, stops in zip(self.gaps, self.stops, strict=True)
        ]

    def list_nodes(self) -> list[list[int]]:
        """The nodes of every tractor in the order in which they are worked, each once."""
        return [list(dict.fromkeys(part.node for part in gaps.tour)) for gaps in self.gaps]

    def build_plan(self) -> Plan:
        """Its plan, with all stops in the notes, one mission per tractor that has lines or stands on the field."""
        table = self.programme.table
        pairs = [
            _build_stopped_mission(self.gaps[number], self.stops[number], is_alone=len(self.stops) == 1)
            if self.gaps[number].tour
            else (build_stand(table, table.starts[number]), ())
            for number in self.programme.list_present()
        ]
        plan, stops = Plan(tuple(mission for mission, _ in pairs)), [own for _, own in pairs]
        return add_service_gates(note_stops(plan, stops, self.supply), stops, self.supply)


def build_stop_moves(table: MoveTable, supply: Supply) -> StopMoves | None:
    """The moves to the place of a supply, to be found when needed, for all programmes of a table; None without a place.

    Raises StrategyError where a place has no room beside it.
    """
    if supply.served_at != PLACE or supply.place is None:
        return None
    places: tuple[Pose, ...] = find_stop_poses(table.site, supply.place)
    if not places:
        x, y = supply.place
        raise StrategyError(
            f"The place to refill at ({x:.0f}, {y:.0f} m) has no room beside it for a tractor to stand; use another."
        )
    return StopMoves(table, places)


def add_stops(
    programme: Programme, supply: Supply, moves: StopMoves | None, tours: Sequence[tuple[TourPart, ...]]
) -> StoppedProgramme:
    """The programme with the stops that cost least time on its tours, whose parts are given.

    Where one tractor is served at a time, each takes into account when those before it are. Raises StrategyError where
    no stops are enough.
    """
    all_gaps, all_stops, busy_spans = list[TourGaps](), list[tuple[TourStop, ...]](), list[Span]()
    for tour in tours:
        gaps = TourGaps(programme.table, supply, tour, moves, tuple(busy_spans) if supply.one_at_a_time else ())
        stops = gaps.list_stops() if tour else ()
        all_gaps.append(gaps)
        all_stops.append(stops)
        busy_spans += gaps.list_service_spans(stops)
    return StoppedProgramme(programme, supply, tuple(all_gaps), tuple(all_stops))


def _build_stopped_mission(
    gaps: TourGaps, stops: Sequence[TourStop], *, is_alone: bool
) -> tuple[Mission, tuple[ServiceStop, ...]]:
    """The mission of a tractor with its stops; alone on the field it needs no places to wait on the way to them."""
    table, parts = gaps.table, gaps.parts
    stop_by_gap = {stop.gap: stop for stop in stops}
    legs, placed = build_way_in(table, parts[0].node), list[ServiceStop]()
    begun_m = 0.0
    for gap, part in enumerate(parts, start=1):
        stop, direct = stop_by_gap.get(gap), gaps.direct_moves[gap]
        if stop is None and gaps.is_inside_line(gap):
            continue
        arrive, depart = (None, None) if stop is None else (stop.detour.arrive, stop.detour.depart)
        leaving, entering = (direct, direct) if arrive is None or depart is None else (arrive, depart)
        rest_m = table.lines[part.node // 2].measure_path_m(part.node % 2) - part.last_m
        if not part.is_stand:
            legs += split_work_leg(table, part.node, rest_m + (0.0 if leaving is None else leaving.leave_m), begun_m)
        if gap == len(parts):
            break
        if stop is not None:
            hold_leg = find_waiting_leg(legs, placed[-1].leg + 1 if placed else 0)
            legs += _build_way(table, arrive, LegTask(REFILL), is_alone=is_alone)
            placed.append(ServiceStop(len(legs), hold_leg, stop.amount))
        goal, begun_m = parts[gap], parts[gap].first_m + (0.0 if entering is None else entering.join_m)
        if depart is not None:
            task = replace(table.lines[goal.node // 2].task, kind=ROUTE if depart.kind == "route" else TURN)
            legs += _build_way(table, depart, task, is_alone=is_alone)
        elif direct is not None:
            legs += build_move(table, goal.node, direct)
    legs += build_way_out(table, parts[-1].node)
    for at, served in zip(placed, stops, strict=True):
        legs[at.leg] = legs[at.leg].copy_with(stand_s=served.stand_s)
    return make_mission(stand_to_unfold(table.site, legs)), tuple(placed)


def _build_way(table: MoveTable, move: Move | None, task: LegTask, *, is_alone: bool) -> list[Leg]:
    """The legs of a move to a place or on from there; none where there is no place."""
    legs = [] if move is None else build_path_legs(table.site, move.path, task)
    return legs if is_alone else add_wait_points(legs, WAIT_POINT_STEP_M)


def estimate_served_s(table: MoveTable, supply: Supply, moves: StopMoves | None) -> Floats:
    """How long a tractor takes to be served for each line (n,): its part of a load by what a load takes in the mean."""
    trips_s = np.zeros(2)
    if moves is not None:
        ends = [(node, table.lines[node // 2].measure_path_m(node % 2), 0.0) for node in range(table.gate)]
        trips_s = np.median(moves.estimate_trips_s(ends), axis=0).min(axis=0)
    needs = np.array([measure_line_need(table, supply, 2 * number) for number in range(len(table.lines))])
    stops = max(float(needs.sum()) / supply.capacity - 1.0, 0.0)
    served_s = stops * (supply.estimate_stop_s(float(needs.sum())) + float(trips_s.sum()))
    shares: Floats = needs / needs.sum()
    return served_s * shares


def stop_programme(
    programme: Programme, supply: Supply, moves: StopMoves | None, stages: Sequence[int] | None = None
) -> StoppedProgramme:
    """The programme with its lines in an order found with their loads, and with the stops that cost least time.

    `moves` lead to the place of the supply; `stages` (n,) say which lines come first, all at any time by default.
    Raises StrategyError where no stops are enough.
    """
    tours = [order_for_loads(programme.table, supply, moves, stages, tour) if tour else () for tour in programme.tours]
    return add_stops(programme, supply, moves, tours)


def find_stop_poses(site: Site, place: Point) -> tuple[Pose, ...]:
    """The poses of the guided point to stand in, one for each direction along the edge; none where there is no room."""
    candidates = list(_list_candidates(site, place))
    poses = (
        next((pose for pose in candidates[hand] if _has_room(site, pose)), None) for hand in range(len(candidates))
    )
    return tuple(pose for pose in poses if pose is not None)


def _list_candidates(site: Site, place: Point) -> Iterator[list[Pose]]:
    """For either direction along the edge the poses near a place, the nearest first."""
    half_m = max(half for _, _, half in site.rules.boxes)
    rings = [
        ring
        for number in range(INSET_COUNT)
        if (ring := _find_nearest_ring(site, place, (1.0 + INSET_HALVES * number) * half_m + MOVE_MARGIN_M)) is not None
    ]
    for hand in (1, -1):
        poses = [pose for ring in rings for pose in _list_poses(site, ring, place, hand)]
        yield sorted(poses, key=lambda pose: round(math.dist(pose[:2], place), 3))


def _find_nearest_ring(site: Site, place: Point, inset_m: float) -> shapely.LinearRing | None:
    """The ring nearest to a place, so far inside the edges and obstacles."""
    parts = shapely.get_parts(site.layout.field.region_without_obstacles.buffer(-inset_m)).tolist()
    rings = [ring for part in parts if not part.is_empty for ring in (part.exterior, *part.interiors)]
    return min(rings, key=lambda ring: round(float(ring.distance(shapely.Point(place))), 3), default=None)


def _list_poses(site: Site, ring: shapely.LinearRing, place: Point, hand: int) -> Iterator[Pose]:
    place_m, step_m = float(ring.project(shapely.Point(place))), STEP_RADII * site.rules.radius_m
    for number in range(-STEP_COUNT, STEP_COUNT + 1):
        distance_m = (place_m + number * step_m) % ring.length
        point = ring.interpolate(distance_m)
        a, b = (ring.interpolate((distance_m + off_m) % ring.length) for off_m in (-CELL_M, CELL_M))
        yield point.x, point.y, math.atan2(hand * (b.y - a.y), hand * (b.x - a.x))


def _has_room(site: Site, pose: Pose) -> bool:
    """Whether the body has room on the straight line through a pose, so far that a move may begin and end there."""
    room_m = site.rules.radius_m  # straight before and behind
    along_m = np.linspace(-room_m, room_m, max(2, math.ceil(2.0 * room_m / CELL_M) + 1)).tolist()
    poses = np.array([shift_pose_ahead(pose, distance_m) for distance_m in along_m])
    body, ground = site.body, site.ground
    rooms = measure_rooms(
        poses, body.guide_m, body.points, body.reach_m, ground.grid, ground.frame, 2.0 * MOVE_MARGIN_M
    )
    return float(rooms.min()) >= MOVE_MARGIN_M
