"""Fleets that drive near each other: who knows whom, what distance they keep, who goes first, and stops for all."""

import json
import math
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from pyproj import Transformer

from planner.fleet.manager.fleet_manager import FleetManager
from planner.fleet.manager.fleet_state import RUNNING, STOPPED
from planner.fleet.manager.neighbourhood import (
    GroundConversion,
    IncomparablePlacesError,
    Neighbourhood,
    build_plan_extent,
)
from planner.fleet.model.fleet_plan import FleetPlan
from planner.fleet.model.rules import FleetManagerError, FleetRules
from planner.fleet.model.timed_mission import TimedMission
from planner.fleet.model.tractor_state import Hold, TractorReport
from planner.fleet.safety.motion_prediction import compute_centre_poses
from planner.fleet.session.clients import TRACTOR, FleetClient
from planner.fleet.session.fleet_session import FleetSession
from tests.service.fleets import SPEED, fleet_plan, restart_manager
from vehicle.missions.plan import SWATH, Leg, LegTask, Mission, Plan
from vehicle.missions.plan_file import SavedPlan
from vehicle.model.tractor import Implement, load_tractor
from vehicle.sim.path_conflicts import compute_outline_distances

RULES = FleetRules()
BRAKES_MPS2 = 0.7

Place = tuple[float, float]

NORTH, SOUTH = ((0.0, 0.0), (0.0, 60.0)), ((0.0, 60.0), (0.0, 0.0))
WEST_ZONE, EAST_ZONE = (
    Transformer.from_crs("EPSG:4326", crs, always_xy=True).transform(12.0, 55.0) for crs in ("EPSG:32632", "EPSG:32633")
)


def lane(*ends: Place, crs: str | None = None, origin: Place = (1000.0, 2000.0)) -> FleetPlan:
    """A plan of one tractor that drives from end to end, in metres of its origin."""
    legs = tuple(
        Leg(np.array(pair), SPEED, implement=True, task=LegTask(SWATH, k)) for k, pair in enumerate(pairwise(ends))
    )
    mission, model = Mission(legs), fleet_plan(1)
    course = TimedMission(mission, tuple(leg.length_m / SPEED for leg in legs))
    saved, finish_s = SavedPlan(Plan((mission,)), crs, origin, {}), (sum(course.leg_seconds),)
    ways = replace(model, saved=saved, timed_missions=(course,), finish_s=finish_s)
    return replace(ways, min_clearance_m=math.inf, ground=model.ground.buffer(500.0))


@dataclass
class Rolling:
    """A fleet of one tractor, which brakes as the rules say, and reports ten times a second."""

    name: str
    manager: FleetManager
    at_m: float = 0.0
    speed: float = 0.0
    stands: bool = True
    is_linked: bool = True
    events: list[str] = field(default_factory=list)

    @property
    def report(self) -> TractorReport:
        """What it says."""
        course = self.manager.plan.timed_missions[0]
        leg = min(int(np.searchsorted(course.leg_starts_m[1:], self.at_m, side="right")), len(course.legs) - 1)
        leg_m = self.at_m - course.leg_starts_m[leg]
        place, done = course.find_pose(leg, leg_m, len(course.legs)), self.at_m >= course.leg_starts_m[-1] - 1e-6
        command, mode = (0.0, "stopped") if self.stands else (SPEED, "automatic")
        work = {"leg": leg, "leg_m": leg_m, "implement": 1}
        return TractorReport(*place, self.speed, command, mode=mode, done=done, **work)

    def step(self, now: float) -> None:
        """A tenth of a second passes."""
        self.manager.update_fleet(now)
        orders, events = self.manager.take_outputs()
        self.events += [event.what for event in events]
        for order in orders:
            if order.kind in ("stop", "resume"):
                self.stands = order.kind == "stop"
        change = -BRAKES_MPS2 if self.stands else 1.0
        end_m = self.manager.plan.timed_missions[0].leg_starts_m[self.manager.states[0].base_end]
        self.speed = min(max(self.speed + 0.1 * change, 0.0), SPEED)
        step_m = min(0.1 * self.speed, end_m - self.at_m)
        self.speed, self.at_m = 10.0 * step_m, self.at_m + step_m
        if self.is_linked:
            self.manager.take_report(0, self.report, now)


class Ground:
    """Fleets on one ground, by a clock that the tests turn."""

    def __init__(self, *plans: FleetPlan, rules: FleetRules = RULES) -> None:
        self.now, self.hood = 0.0, Neighbourhood()
        self.fleets: list[Rolling] = []
        for number, plan in enumerate(plans):
            fleet = Rolling("abcdefgh"[number], FleetManager(plan, rules))
            fleet.manager.connect_tractor(0, 0.0)
            fleet.manager.take_report(0, fleet.report, 0.0)
            self.hood.add(fleet.name, fleet.name, fleet.manager, lambda: None, 0.0)
            self.fleets.append(fleet)

    def start(self) -> None:
        for fleet in self.fleets:
            fleet.manager.operators.start_fleet_work("anna", self.now)

    def run(self, seconds: float) -> float:
        """Time passes; how near the first two come (m)."""
        least_m = math.inf
        for _ in range(round(10 * seconds)):
            self.now += 0.1
            for fleet in self.fleets:
                fleet.step(self.now)
            least_m = min(least_m, self.apart_m())
        return least_m

    def apart_m(self) -> float:
        """Metres between the outlines of the first two, both in metres of the first one's plan."""
        one, other = (fleet.manager for fleet in self.fleets[:2])
        places = [np.array([fleet.report[:3]]) for fleet in self.fleets[:2]]
        near, far = (compute_centre_poses(p, m.plan.tractor) for p, m in zip(places, (one, other), strict=True))
        there = GroundConversion(other.plan.saved, one.plan.saved, build_plan_extent(other.plan))
        models = one.guard.model, other.guard.model
        return float(compute_outline_distances(near, there.convert_poses(far), *models)[0])


def alarms(fleet: Rolling) -> list[str]:
    return [alarm.sentence for alarm in fleet.manager.alarms.list_alarms()]


def test_two_fleets_that_are_driven_at_each_other_stop_apart_and_both_are_told() -> None:
    ground = Ground(lane(*NORTH), lane(*SOUTH))
    ground.start()
    least_m = ground.run(60)
    one, other = ground.fleets
    assert one.speed == other.speed == 0.0
    # Stopped at the latest when what is foreseen in reaction, braking and one step of 0.5 s comes within clearance.
    foreseen_s = RULES.reaction_s + SPEED / BRAKES_MPS2 + 0.5
    assert RULES.clearance_m <= least_m <= RULES.clearance_m + 2.0 * (foreseen_s + 0.2) * SPEED
    for fleet, theirs in ((one, "b"), (other, "a")):
        assert Hold.TOO_NEAR in fleet.manager.states[0].holds
        (told,) = alarms(fleet)
        assert told.startswith(f"Tractor 1 and tractor 1 of fleet {theirs!r} stand ") and "cannot resume" in told
        (frame,) = fleet.manager.alarms.describe_alarms()
        assert (frame["code"], frame["related_number"], frame["level"]) == ("near fleet", 1, "critical")


@pytest.mark.parametrize("first", [0, 1])
def test_of_two_that_cross_that_of_the_fleet_added_first_goes_first_and_the_other_after_it(first: int) -> None:
    ways = [lane((-30.0, 0.0), (40.0, 0.0)), lane((0.0, -30.0), (0.0, 40.0))]
    ground = Ground(*(ways[::-1] if first else ways))
    ground.start()
    assert ground.run(45) >= RULES.clearance_m
    assert ground.fleets[0].at_m > ground.fleets[1].at_m + 5.0
    assert ground.run(80) >= RULES.clearance_m
    assert [fleet.at_m for fleet in ground.fleets] == [pytest.approx(70.0)] * 2
    for fleet in ground.fleets:
        assert fleet.events.count(Hold.TOO_NEAR) == 1 and fleet.events.count("goes on") == 1
        assert not fleet.manager.states[0].holds and all(alarm.over for alarm in fleet.manager.alarms.list_alarms())


@pytest.mark.parametrize(("apart_m", "known"), [(40.0, True), (49.9, True), (50.1, False), (60.0, False)])
def test_fields_so_far_apart_know_each_other(apart_m: float, known: bool) -> None:
    ground = Ground(lane(*NORTH), lane((apart_m, 0.0), (apart_m, 60.0)))
    assert bool(ground.hood.list_neighbours("a")) == bool(ground.hood.list_neighbours("b")) == known
    shifted = Ground(lane(*NORTH), lane(*NORTH, origin=(1000.0 + apart_m, 2000.0)))
    assert bool(shifted.hood.list_neighbours("a")) == known


@pytest.mark.parametrize(("apart_m", "known"), [(40.0, True), (60.0, False)])
def test_plans_of_two_coordinate_systems_are_compared_by_where_they_are(apart_m: float, known: bool) -> None:
    # The zones meet at 12 degrees: the north of each is 2.46 degrees to one side of true north, its middle 3 away.
    there = lane((apart_m, 0.0), (apart_m, 60.0), crs="EPSG:32633", origin=EAST_ZONE)
    ground = Ground(lane(*NORTH, crs="EPSG:32632", origin=WEST_ZONE), there)
    turn = 2.0 * math.atan(math.tan(math.radians(3.0)) * math.sin(math.radians(55.0)))
    ends = GroundConversion(there.saved, ground.fleets[0].manager.plan.saved, build_plan_extent(there))
    assert abs(ends.turn_rad) == pytest.approx(turn, abs=1e-4)
    gap_m = apart_m if ends.turn_rad < 0.0 else apart_m * math.cos(turn) - 60.0 * math.sin(turn)
    assert bool(ground.hood.list_neighbours("a")) == known == (gap_m < 50.0)


@pytest.mark.slow
def test_two_of_different_systems_stop_apart_too_by_a_conversion_that_is_that_of_pyproj_to_a_millimetre() -> None:
    plan = lane((0.0, 60.0), (0.0, 0.0), crs="EPSG:32633", origin=EAST_ZONE)
    ground = Ground(lane(*NORTH, crs="EPSG:32632", origin=WEST_ZONE), plan)
    ground.start()
    assert RULES.clearance_m <= ground.run(60) < 6.0
    assert all(Hold.TOO_NEAR in fleet.manager.states[0].holds for fleet in ground.fleets)
    source = lane((0.0, 0.0), (3000.0, 2000.0), crs="EPSG:32632", origin=WEST_ZONE)
    places = np.random.default_rng(1).uniform((0.0, 0.0), (3000.0, 2000.0), (50, 2))
    over = Transformer.from_crs("EPSG:32632", "EPSG:32633", always_xy=True)
    exact = np.column_stack(over.transform(*(places + WEST_ZONE).T)) - EAST_ZONE
    found = GroundConversion(source.saved, plan.saved, build_plan_extent(source)).convert_places(places)
    assert np.abs(found - exact).max() < 1e-3


def test_what_cannot_be_compared_is_told_and_is_over_with_the_fleet() -> None:
    ground = Ground(lane(*NORTH), lane(*NORTH, crs="EPSG:32632"), lane(*NORTH, crs="EPSG:999999"))
    assert not ground.hood.list_neighbours("a")
    assert "fleet 'b' and fleet 'c' cannot be known" in alarms(ground.fleets[0])[0]
    ground.hood.remove("b", 1.0)
    assert "to fleet 'c' cannot" in alarms(ground.fleets[0])[0]
    ground.hood.remove("c", 1.0)
    assert ground.fleets[0].manager.alarms.list_alarms()[0].over


def test_one_whose_link_is_broken_is_kept_clear_of() -> None:
    ground = Ground(lane(*NORTH), lane((0.0, 30.0), (0.0, 90.0)))
    one, other = ground.fleets
    other.is_linked = False
    other.manager.disconnect_tractor(0, 0.0, False)
    one.manager.operators.start_fleet_work("anna", 0.0)
    assert ground.run(60) >= RULES.clearance_m
    assert one.speed == 0.0 and 15.0 < one.at_m < 30.0
    assert "or delete fleet 'b' if it is no longer there" in alarms(one)[-1]
    ground.hood.remove("b", ground.now)
    ground.run(50)
    assert one.at_m == pytest.approx(60.0) and all(alarm.over for alarm in one.manager.alarms.list_alarms())


def test_one_that_is_driven_by_remote_control_keeps_clear_of_another_fleet() -> None:
    ground = Ground(lane(*NORTH), lane((6.0, 0.0), (6.0, 60.0)))
    manager = ground.fleets[0].manager
    manager.operators.take_lease("anna", 0, False, 0.0)
    manager.take_report(0, TractorReport(0.0, 0.0, 0.0, 0.0, mode="remote"), 0.0)  # heading east, at the other one
    noses_m = RULES.clearance_m + 1.0
    manager.operators.send_command("anna", 0, 0.0, 0.5, 0.0)
    manager.take_report(0, TractorReport(6.0 - noses_m - 1.5, 0.0, 0.0, 0.0, mode="remote"), 0.1)
    with pytest.raises(FleetManagerError, match="too near tractor 1 of fleet 'b'"):
        manager.operators.send_command("anna", 0, 0.0, 1.0, 0.1)
    manager.operators.send_command("anna", 0, 0.0, -1.0, 0.1)
    ground.hood.remove("b", 0.1)
    manager.operators.send_command("anna", 0, 0.0, 1.0, 0.1)


def test_fleets_that_live_faster_are_foreseen_as_fast_as_they_live() -> None:
    """One that lives three times as fast needs a third of the time on the wall for the same way."""
    ground = Ground(lane(*NORTH), lane((0.0, 200.0), (0.0, 100.0)))
    one, other = (fleet.manager for fleet in ground.fleets)
    other.rules = other.guard.rules = FleetRules(times=3.0)
    other.guard.__init__(other.plan, other.rules)  # type: ignore[misc]
    other.operators.start_fleet_work("anna", 0.0)
    other.update_fleet(0.0)
    other.states[0].base_end = 1
    other.take_report(0, TractorReport(0.0, 100.0, -math.pi / 2, 1.0, 1.0, leg=0, leg_m=50.0), 0.1)
    one.take_report(0, TractorReport(0.0, 60.0, math.pi / 2, 0.0, 0.0, leg=0, leg_m=60.0), 0.1)
    (seen,) = one.neighbours.find_nearby_tractors()
    driven_m = np.hypot(*(seen.path[-1, :2] - seen.path[1, :2]))
    assert driven_m == pytest.approx(3.0 * (RULES.ahead_s - 0.5), abs=0.01)
    assert seen.braking_s == pytest.approx((1.0 / 0.7 + 0.5 * 3.0) / 3.0)


def test_stop_all_reaches_the_neighbours_and_each_is_let_go_on_by_its_own_operator() -> None:
    ground = Ground(lane(*NORTH), lane((40.0, 0.0), (40.0, 60.0)), lane((80.0, 0.0), (80.0, 60.0)))
    one, other, far = (fleet.manager for fleet in ground.fleets)
    ground.start()
    ground.run(5)
    one.operators.stop_all("anna", ground.now)
    assert (one.state, other.state, far.state) == (STOPPED, STOPPED, RUNNING)
    orders, events = other.take_outputs()
    assert [order.kind for order in orders] == ["stop"]
    assert ("anna", "stop_all of a neighbour", {"fleet": "a"}) in [(e.who, e.what, e.data) for e in events]
    told = [(event.what, event.data) for event in one.take_outputs()[1]]
    assert ("stop_all of neighbours", {"fleets": ["b"]}) in told
    assert [alarm.code for alarm in one.alarms.list_alarms()] == [alarm.code for alarm in other.alarms.list_alarms()]
    assert "anna stopped fleet 'a' near by" in alarms(ground.fleets[1])[0]
    with pytest.raises(FleetManagerError, match="just stopped by anna of fleet 'a'"):
        other.operators.resume_tractors("bert", None, ground.now)
    one.operators.resume_tractors("anna", None, ground.now + 2.0)
    assert [each.alarms.list_alarms()[0].over for each in (one, other)] == [True, False]
    assert Hold.HALTED in other.states[0].holds
    other.operators.resume_tractors("bert", None, ground.now + 2.0)
    assert other.state == RUNNING and other.alarms.list_alarms()[0].over


def test_a_stop_of_one_fleet_is_sent_to_the_tractors_of_the_other_at_once() -> None:
    hood, clients, fleets = Neighbourhood(), [], []
    for name in ("a", "b"):
        fleet = FleetSession(name, name, fleet_plan(), RULES, begin_s=0.0)
        clients.append(FleetClient(TRACTOR, "tractor 1", 0))
        fleet.add_client(clients[-1], 0.0)
        hood.add(name, name, fleet.manager, fleet.send_pending_outputs, 0.0)
        fleets.append(fleet)
    fleets[0].manager.operators.stop_all("anna", 1.0)
    waiting: list[Any] = [json.loads(text) for text, _ in clients[1].outbox._waiting]
    assert waiting[1]["kind"] == "stop" and waiting[1]["reason"] == Hold.HALTED  # before all but the welcome


def test_alarms_of_two_fleets_are_over_after_a_restart_once_they_are_apart() -> None:
    ground = Ground(lane(*NORTH), lane(*SOUTH))
    ground.start()
    ground.run(40)
    one = ground.fleets[0]
    again = restart_manager(one.manager, ground.now, ground.now)
    assert again.dangers.find_alarmed_pairs() == [(0, ("b", 0))]
    ground.hood.remove("b", ground.now)
    ground.hood.add("a", "a", again, lambda: None, ground.now)
    one.manager = again
    again.connect_tractor(0, ground.now)
    again.operators.start_fleet_work("anna", ground.now)
    ground.run(10)
    assert not again.dangers.find_alarmed_pairs() and one.speed > 0.5


def test_machines_of_two_fleets_have_their_own_sizes() -> None:
    wide = replace(lane((0.0, 30.0), (0.0, 90.0)), tractor=load_tractor("eg105"), implement=Implement(width_m=8.0))
    beside = [Ground(lane((4.0, 0.0), (4.0, 60.0)), plan) for plan in (lane((0.0, 30.0), (0.0, 90.0)), wide)]
    for ground in beside:
        ground.fleets[0].manager.operators.start_fleet_work("anna", 0.0)
        ground.run(65)
    assert beside[0].fleets[0].at_m == pytest.approx(60.0)
    assert beside[1].fleets[0].at_m < 30.0


@pytest.mark.parametrize("silent", [True, False])
def test_a_link_that_breaks_while_its_tractor_brakes_is_waited_for_and_told_of(silent: bool) -> None:
    ground = Ground(lane(*NORTH), lane(*SOUTH))
    ground.start()
    one, other = ground.fleets
    while not (Hold.TOO_NEAR in one.manager.states[0].holds and 0.1 < one.speed < 0.6 * SPEED):
        ground.run(0.1)
    one.is_linked = False  # it says no more, and its link is closed, or is found to be silent
    if not silent:
        one.manager.disconnect_tractor(0, ground.now, False)
    ground.run(30)
    assert one.manager.states[0].report is not None and one.manager.states[0].report.speed_mps > 0.1
    assert other.speed == 0.0 and Hold.TOO_NEAR in other.manager.states[0].holds
    (told,) = alarms(other)
    assert "cannot resume by themselves" in told and "delete fleet 'a' if it is no longer there" in told


def test_places_that_convert_one_way_only_leave_neither_fleet_half_a_neighbour(monkeypatch: pytest.MonkeyPatch) -> None:
    made = []

    def convert(*args: Any) -> GroundConversion:
        made.append(args)
        if len(made) == 2:
            raise IncomparablePlacesError("The places of one plan have none in the coordinate system of the other.")
        return GroundConversion(*args)

    monkeypatch.setattr("planner.fleet.manager.neighbourhood.GroundConversion", convert)
    ground = Ground(lane(*NORTH), lane(*SOUTH))
    assert not ground.hood.list_neighbours("a") and not ground.hood.list_neighbours("b")
    for fleet, its in zip(ground.fleets, "ba", strict=True):
        assert f"to fleet '{its}' cannot be known" in alarms(fleet)[0]
    ground.fleets[1].manager.operators.stop_all("anna", 1.0)
    assert ground.fleets[0].manager.state != STOPPED
