"""Live fleets near each other: distances, right of way and stops are kept between them too.

Two fleets are neighbours if their grounds come within NEAR_M, which is checked when a fleet is added. Each fleet
manager then watches the other's tractors like its own, by the same rules and by their last reports, however old: others
keep clear of the last place of a silent tractor, and one that waits at its entrance or has left through it counts as
present. Each fleet manager holds only its own tractors. Of tractors of two fleets that stand because they are near each
other, those of the fleet added first resume first; the others wait. Stop-all stops the neighbours of a fleet, but not
their neighbours.

Plans without a coordinate system share one system of local metres. Their distance from plans with a coordinate system
is unknown: they do not move beside these until an operator has answered for the distance. Beside plans with a
coordinate system that cannot be converted, neither fleet moves.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from functools import partial

import numpy as np
import shapely

from fields.arrays import Floats, Integers
from fields.errors import FieldError
from fields.geometry.geodesy import project
from planner.fleet.manager.fleet_manager import FleetManager
from planner.fleet.model.fleet_plan import FleetPlan, build_field_outline
from planner.fleet.model.tractor_state import BY_HAND, Hold
from planner.fleet.safety.motion_prediction import (
    NeighbourFleets,
    NeighbourTractor,
    PossibleArea,
    compute_centre_poses,
    compute_stopping_time_s,
)
from vehicle.missions.plan_file import SavedPlan

WGS84 = "EPSG:4326"
FIT_SAMPLES = 5  # sample places along each side of a ground
NEAR_M = 50.0
LOOKOUT_M = 5.0  # beyond what two could close in the predicted time


class IncomparablePlacesError(ValueError):
    """The places of two plans cannot be compared."""


def build_plan_extent(plan: FleetPlan) -> shapely.Geometry:
    """The field of a plan, if known, and the lines that its tractors drive; metres of the plan."""
    lines = shapely.MultiLineString([line for mission in plan.timed_missions for line in mission.lines])
    field = [] if plan.field is None else [build_field_outline(plan.field, plan.saved)]
    return shapely.GeometryCollection([*field, lines])


class GroundConversion:
    """Converts places from metres of one plan to metres of another.

    Between two coordinate systems it uses a polynomial of the second degree fitted to `ground`, as pyproj is too slow
    for every tick; over some kilometres it is accurate to a millimetre. Raises IncomparablePlacesError.
    """

    def __init__(self, source: SavedPlan, target: SavedPlan, ground: shapely.Geometry) -> None:
        self.turn_rad = 0.0
        self._terms: Floats | None = None
        self._shift = np.asarray(source.origin_m) - np.asarray(target.origin_m)
        if source.crs != target.crs:
            west, south, east, north = shapely.bounds(ground)
            self._middle = np.array([0.5 * (west + east), 0.5 * (south + north)])
            self._size = max(east - west, north - south, 1.0)
            x, y = np.meshgrid(*(middle + np.linspace(-0.5, 0.5, FIT_SAMPLES) * self._size for middle in self._middle))
            # a square: one line would not determine the other direction
            places = np.column_stack([x.ravel(), y.ravel()])
            converted = _convert_places(source, target, places)
            fitted = np.linalg.lstsq(self._compute_powers(places), converted, rcond=None)[0]
            self._terms = np.asarray(fitted, np.float64)
            ahead = self.convert_places(self._middle + np.array([[0.0, 0.0], [1.0, 0.0]]))
            self.turn_rad = float(np.arctan2(*(ahead[1] - ahead[0])[::-1]))

    def _compute_powers(self, places: Floats) -> Floats:
        x, y = ((places - self._middle) / self._size).T
        return np.column_stack([np.ones(len(x)), x, y, x * x, x * y, y * y])

    def convert_places(self, places: Floats) -> Floats:
        """Convert places (n, 2)."""
        return places + self._shift if self._terms is None else self._compute_powers(places) @ self._terms

    def convert_poses(self, poses: Floats) -> Floats:
        """Convert poses (..., 3) of x, y (m) and mathematical heading (rad)."""
        flat = poses.reshape(-1, 3)
        moved = np.column_stack([self.convert_places(flat[:, :2]), flat[:, 2] + self.turn_rad])
        return moved.reshape(poses.shape)


def _convert_places(source: SavedPlan, target: SavedPlan, places: Floats) -> Floats:
    """Places (n, 2) in metres of one plan as those of another, through longitude and latitude if they differ."""
    source_origin, target_origin = np.asarray(source.origin_m), np.asarray(target.origin_m)
    if source.crs == target.crs:
        shifted: Floats = places + (source_origin - target_origin)
        return shifted
    if source.crs is None or target.crs is None:
        raise IncomparablePlacesError("One of two plans has local metres and the other a coordinate system.")
    try:
        degrees = project(places + source_origin, source.crs, WGS84)
        converted: Floats = project(degrees, WGS84, target.crs) - target_origin
        return converted
    except FieldError as fault:
        raise IncomparablePlacesError(f"The places of two plans cannot be compared: {fault}") from None


def are_grounds_near(source: FleetPlan, target: FleetPlan) -> bool:
    """Whether the grounds of two plans come within NEAR_M. Raises IncomparablePlacesError."""
    moved = shapely.transform(build_plan_extent(source), partial(_convert_places, source.saved, target.saved))
    return bool(shapely.dwithin(moved, build_plan_extent(target), NEAR_M))


class NeighbourhoodMember(NeighbourFleets):
    """A live fleet, and the fleets near it.

    `send` flushes its orders and events, `rank` counts fleets in the order they were added.
    By id, `neighbours` are the fleets near it, with the conversion of their places to its metres, and `unknown` those
    at an unknown distance.
    """

    def __init__(self, id: str, name: str, manager: FleetManager, send: Callable[[], None], rank: int) -> None:
        self.id, self.name, self.manager, self.send, self.rank = id, name, manager, send, rank
        self.neighbours: dict[str, tuple[NeighbourhoodMember, GroundConversion]] = {}
        self.unknown: dict[str, NeighbourhoodMember] = {}

    @property
    def fastest_mps(self) -> float:
        """The highest speed of its tractors."""
        reports = [state.report for state in self.manager.states if state.report is not None]
        legs = max(state.mission.fastest_mps for state in self.manager.states)
        return max([legs, self.manager.rules.remote_mps, *(report.speed_mps for report in reports)])

    def list_neighbours(self) -> list[NeighbourhoodMember]:
        """The fleets near it, in the order they were added."""
        return sorted((neighbour for neighbour, _ in self.neighbours.values()), key=lambda each: each.rank)

    def update_neighbour_names(self, now: float) -> None:
        """Tell its fleet manager who is near, and who is at an unknown distance."""
        unknown = [self.unknown[id] for id in sorted(self.unknown)]
        # where both have coordinate systems, neither can be placed
        has_own_metres = self.manager.plan.saved.crs is None
        unplaced_beside = [one.name for one in unknown if has_own_metres or one.manager.plan.saved.crs is not None]
        near_names, unknown_names = [one.name for one in self.list_neighbours()], [fleet.name for fleet in unknown]
        self.manager.dangers.set_neighbours(near_names, unknown_names, unplaced_beside, now)

    def find_nearby_tractors(self) -> list[NeighbourTractor]:
        """Tractors of neighbours that could come near its own within the predicted time."""
        own_positions = _list_positions(self)
        if not len(own_positions):
            return []
        return [one for fleet in self.list_neighbours() for one in self._find_tractors_near(fleet, own_positions)]

    def _find_tractors_near(self, neighbour: NeighbourhoodMember, own_positions: Floats) -> list[NeighbourTractor]:
        """Tractors of one neighbour that could come near `own_positions` (n, 2)."""
        manager, (_, conversion) = neighbour.manager, self.neighbours[neighbour.id]
        pace = manager.rules.times / self.manager.rules.times
        reported_numbers = np.array(
            [n for n, state in enumerate(manager.states) if state.report is not None], dtype=np.int64
        )
        if not len(reported_numbers):
            return []
        places = conversion.convert_places(_list_positions(neighbour, reported_numbers))
        closing_m = self.manager.rules.ahead_s * (self.fastest_mps + pace * neighbour.fastest_mps)
        reach_m = closing_m + LOOKOUT_M + 2.0 * (self.manager.guard.reach_m + manager.guard.reach_m)
        is_near = (np.hypot(*(places[:, None] - own_positions[None]).transpose(2, 0, 1)) <= reach_m).any(axis=1)
        is_near |= [manager.states[number].doubt is not None for number in reported_numbers]  # it may be elsewhere
        numbers = reported_numbers[is_near].tolist()
        if not numbers:
            return []
        paths = manager.guard.predict_paths(manager.states, numbers, pace)
        poses = conversion.convert_poses(compute_centre_poses(paths, manager.guard.tractor))
        return [self._build_neighbour(neighbour, number, poses[k], pace) for k, number in enumerate(numbers)]

    def _build_neighbour(
        self, neighbour: NeighbourhoodMember, number: int, path: Floats, pace: float
    ) -> NeighbourTractor:
        """A tractor of a neighbour with its path in metres of this fleet, and where it may be if it is in doubt."""
        manager, (_, conversion), guard = neighbour.manager, self.neighbours[neighbour.id], self.manager.guard
        state, key = manager.states[number], (neighbour.id, number)
        assert state.report is not None
        speed_mps, area = abs(state.report.speed_mps), manager.guard.build_area(number, state, pace)
        if area is not None:
            centre = conversion.convert_places(area.centre[None])[0]
            clearance_m, release_m = guard.neighbour_clearances_m[0], guard.neighbour_release_m[0]
            area = PossibleArea(key, centre, area.radii_m, clearance_m, release_m)
        return NeighbourTractor(
            key=key,
            name=f"tractor {number + 1} of fleet {neighbour.name!r}",
            fleet=neighbour.name,
            path=path,
            model=manager.guard.model[0],
            speed_mps=speed_mps,
            braking_s=compute_stopping_time_s(speed_mps, manager.rules) / pace,
            is_waiting=Hold.TOO_NEAR in state.holds and state.mode not in BY_HAND,
            is_free=manager.dangers.separation.is_free(number),
            has_priority=neighbour.rank < self.rank,
            is_linked=manager.is_report_current(number),
            is_queueing=manager.guard.is_queueing(state),
            area=area,
        )

    def stop_neighbour_fleets(self, who: str, now: float) -> list[str]:
        """Stop all neighbours at once; returns their names."""
        for neighbour in self.list_neighbours():
            neighbour.manager.operators.stop_with_neighbour(who, self.name, now)
            neighbour.send()
        return [neighbour.name for neighbour in self.list_neighbours()]

    def restart_waiting_times(self) -> None:
        """A tractor resumes: standing ones of the neighbours start their waiting time again."""
        for neighbour in self.list_neighbours():
            neighbour.manager.dangers.separation.restart_waiting_times()


class Neighbourhood:
    """All live fleets, and which are neighbours."""

    def __init__(self) -> None:
        self._members: dict[str, NeighbourhoodMember] = {}
        self._ranks = itertools.count()

    def add(self, id: str, name: str, manager: FleetManager, send: Callable[[], None], now: float) -> None:
        """Add a fleet, and make it and those near it neighbours."""
        self.remove(id, now)
        member = NeighbourhoodMember(id, name, manager, send, next(self._ranks))
        for neighbour in self._members.values():
            first, second = member.manager.plan, neighbour.manager.plan
            try:
                if are_grounds_near(first, second):
                    inward = GroundConversion(second.saved, first.saved, build_plan_extent(second))
                    outward = GroundConversion(first.saved, second.saved, build_plan_extent(first))
                    member.neighbours[neighbour.id] = neighbour, inward  # both of them or none
                    neighbour.neighbours[member.id] = member, outward
            except IncomparablePlacesError:
                member.unknown[neighbour.id], neighbour.unknown[member.id] = neighbour, member
        self._members[id] = manager.neighbours = member
        for affected in (member, *member.list_neighbours(), *member.unknown.values()):
            affected.update_neighbour_names(now)

    def remove(self, id: str, now: float) -> None:
        """Remove a fleet."""
        member = self._members.pop(id, None)
        if member is None:
            return
        others = [*member.list_neighbours(), *member.unknown.values()]
        member.neighbours, member.unknown = {}, {}
        for other in others:
            other.neighbours.pop(id, None)
            other.unknown.pop(id, None)
            other.update_neighbour_names(now)

    def list_neighbours(self, id: str) -> list[NeighbourhoodMember]:
        """The neighbours of a fleet, in the order they were added."""
        return self._members[id].list_neighbours() if id in self._members else []


def _list_positions(member: NeighbourhoodMember, numbers: Integers | None = None) -> Floats:
    """Last places (n, 2) of all tractors that have reported, or of those with these numbers."""
    states = member.manager.states if numbers is None else [member.manager.states[number] for number in numbers]
    reports = [state.report for state in states if state.report is not None]
    return np.array([[report.x_m, report.y_m] for report in reports]).reshape(-1, 2)
