"""A plan driven live by simulated tractors, and the tracks of one that has failed given to the others."""

import json
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
import shapely

from planner.evaluation.candidates.evaluate import Candidate, simulate_candidate
from planner.evaluation.preparation import prepare_context
from planner.evaluation.work_order import WorkOrder
from planner.fleet.manager.fleet_manager import FleetManager
from planner.fleet.manager.remaining_work import check_proposal_still_fits, extract_remaining_work
from planner.fleet.model.fleet_plan import FleetPlan, prepare_fleet_plan
from planner.fleet.model.rules import FleetManagerError, FleetRules
from planner.fleet.model.tractor_state import Hold, TractorReport
from planner.fleet.replanning.planning_anew import MENTIONED_M, ReplanProposal, continue_remaining_work
from planner.fleet.session.frame_content import build_report, describe_mission
from planner.fleet.session.inbound_frames import FRAMES_OF_ROLE
from planner.fleet.simulated_robot import RobotDriver
from planner.pipeline.outputs.saved_plans import write_saved_plan
from planner.request.plan_request import PlanRequest
from strategies.rules.supply import Supply
from tests.drawn_fields import feature, rectangle, write_features
from tests.service.fleets import restart_manager
from vehicle.missions.plan_file import format_plan, parse_plan

pytestmark = pytest.mark.slow

WIDTH_M = 3.0


@pytest.fixture(scope="module")
def plan_without_entrance(tmp_path_factory: pytest.TempPathFactory) -> FleetPlan:
    return plan_three(tmp_path_factory, None, "interleaved")


@dataclass(frozen=True)
class ForcedWait:
    """How far a plan has been driven when one tractor fails, and another must wait on its leg in the new plan."""

    share: float
    failed: int
    waiting: int


@pytest.fixture(scope="module")
def forced_wait(plan_without_entrance: FleetPlan) -> ForcedWait:
    """The first that is found from behind the middle of the plan on: where it is depends on the order of its work."""
    for percent in sorted(range(5, 95, 6), key=lambda percent: abs(percent - 56)):
        for failed in range(plan_without_entrance.tractor_count):
            manager = at(plan_without_entrance, 0.01 * percent)
            manager.operators.mark_failed("anna", failed, 1.0)
            stand(manager)
            made = continue_remaining_work(extract_remaining_work(manager, [], 100.0)).plan
            for waiting, state in enumerate(manager.states):
                if len(made.timed_missions[waiting].legs[state.leg].gates) == 1:
                    return ForcedWait(0.01 * percent, failed, waiting)
    pytest.fail("Nowhere on this plan must a tractor wait on its leg.")


def plan_three(
    tmp_path_factory: pytest.TempPathFactory, entrance: tuple[float, float] | None, strategy: str = "split-field"
) -> FleetPlan:
    return plan_field(tmp_path_factory.mktemp("field"), strategy, entrance=entrance, corners="square")


def plan_field(folder: Path, strategy: str, supply: Supply | None = None, **asked: Any) -> FleetPlan:
    """A plan of three tractors on the field of these tests, whose file is put into a folder."""
    file = write_features(folder / "field.geojson", feature(rectangle(0, 0, 70, 60)))
    always = {"field": str(file), "local": True, "width_m": WIDTH_M, "tractors": (3,), "strategies": (strategy,)}
    site = prepare_context(WorkOrder(PlanRequest(**always | asked), supply=supply))
    run = simulate_candidate(site, Candidate(strategy, 3)).run
    assert run is not None
    return prepare_fleet_plan(write_saved_plan(site, run.plan), file)


def at(plan: FleetPlan, share: float) -> FleetManager:
    """A fleet each of whose tractors has driven so much of its plan."""
    manager = FleetManager(plan, FleetRules())
    manager.operators.start_fleet_work("anna", 0.0)
    for number, course in enumerate(plan.timed_missions):
        manager.connect_tractor(number, 0.0)
        at_m = share * course.leg_starts_m[-1]
        leg = next(k for k in range(len(course.legs)) if course.leg_starts_m[k + 1] > at_m)
        x, y, heading = course.find_pose(leg, at_m - course.leg_starts_m[leg], len(course.legs))
        manager.states[number].base_end = leg + 1
        for each in range(leg + 1):
            metres = at_m - course.leg_starts_m[leg] if each == leg else course.lengths_m[each]
            manager.take_report(number, TractorReport(x, y, heading, 1.0, leg=each, leg_m=metres), 0.1)
    manager.update_fleet(0.2)
    return manager


@dataclass
class LiveFleet:
    """All but the network: steering, speed control and noise of every robot, releases and orders."""

    manager: FleetManager
    drivers: dict[int, RobotDriver]
    now: float = 0.0
    legs: dict[int, list[int]] = field(default_factory=dict)

    def drive(self, until: Callable[[], bool], longest_s: float) -> None:
        end = self.now + longest_s
        while not until() and self.now < end:
            self.now += 0.1
            plan = self.manager.plan
            orders, events = self.manager.take_outputs()
            assert not [event for event in events if event.what == "too near another"]
            for order in orders:
                frame = {"kind": order.kind, "reason": ""} | order.data
                if order.kind == "plan":
                    frame["plan"] = describe_mission(plan, order.tractor)
                if order.tractor in self.drivers:
                    self.drivers[order.tractor].handle_frame(frame, self.now)
            for number, driver in self.drivers.items():
                driver.handle_frame({"kind": "heartbeat"}, self.now)
                state = FRAMES_OF_ROLE["tractor"].validate_json(json.dumps(driver.step(self.now)))
                self.manager.take_report(number, build_report(state, plan, state.time.timestamp()), self.now)
                self.legs.setdefault(number, []).append(state.leg)
            self.manager.update_fleet(self.now)
        assert until(), self.manager.state


def start_live(plan: FleetPlan) -> LiveFleet:
    """A fleet whose robots stand at the beginning of a plan, started."""
    machine, origin_m = (plan.tractor, plan.implement), plan.saved.origin_m
    drivers = {
        number: RobotDriver(mission, *machine, origin_m, name="robot", noise_m=0.02, seed=number)
        for number, mission in enumerate(plan.plan.missions)
    }
    fleet = LiveFleet(FleetManager(plan, FleetRules()), drivers)
    for number in drivers:
        fleet.manager.connect_tractor(number, 0.0)
    fleet.manager.operators.start_fleet_work("anna", 0.0)
    return fleet


@pytest.fixture(scope="module")
def half(plan: FleetPlan) -> tuple[FleetManager, ReplanProposal]:
    manager = at(plan, 0.4)
    manager.operators.mark_failed("anna", 1, 1.0)
    return manager, continue_remaining_work(extract_remaining_work(manager, [], 100.0))


def worked(plan: FleetPlan, number: int, first: int) -> shapely.Geometry:
    legs = plan.timed_missions[number].legs[first:]
    return shapely.union_all(
        [shapely.LineString(leg.points).buffer(1.6, cap_style="flat") for leg in legs if leg.implement]
    )


def test_what_one_has_left_is_worked_by_the_others(half: tuple[FleetManager, ReplanProposal]) -> None:
    manager, proposal = half
    planned = max(course.leg_starts_s[-1] for course in manager.plan.timed_missions)
    assert 0.6 * planned < proposal.eta_s < 2.0 * planned
    assert parse_plan(format_plan(proposal.plan.plan, scenario=proposal.plan.saved.scenario)).tractors == 3
    left = worked(manager.plan, 1, manager.states[1].leg + 1)
    taken = shapely.union_all([worked(proposal.plan, number, proposal.unchanged_legs[number]) for number in (0, 2)])
    report = manager.states[1].report
    assert report is not None
    standing = shapely.Point(report.x_m, report.y_m).buffer(9.0)
    # Driven the other way, the guided point is on a track a tool's distance earlier: 2 % of what is left for each.
    assert shapely.difference(shapely.difference(left, taken), standing).area < 0.08 * left.area
    assert proposal.reassigned_m > 50.0 and proposal.unreachable_m < 0.03 * proposal.reassigned_m
    told = f"{proposal.blocked_m:.0f} m of track are too near tractor 2 and remain unworked."
    assert (told in proposal.sentence) == (proposal.blocked_m >= MENTIONED_M)


@pytest.mark.parametrize("number, share", [(0, 0.55), (1, 0.25), (2, 0.55)])
def test_hardly_anything_that_can_be_reached_stays_open(plan: FleetPlan, number: int, share: float) -> None:
    manager = at(plan, share)
    manager.operators.mark_failed("anna", number, 1.0)
    proposal = continue_remaining_work(extract_remaining_work(manager, [], 100.0))
    rests = [
        course.worked_m[-1] - course.worked_m[kept]
        for course, kept in zip(plan.timed_missions, proposal.unchanged_legs, strict=True)
    ]
    assert proposal.unreachable_m <= 0.03 * sum(rests)
    assert proposal.reassigned_m + proposal.unreachable_m + proposal.blocked_m > 0.9 * sum(rests)


@pytest.mark.parametrize("number", [0, 2])
def test_before_the_start_those_that_are_left_come_in_one_after_another(plan: FleetPlan, number: int) -> None:
    proposal = continue_remaining_work(extract_remaining_work(FleetManager(plan, FleetRules()), [number], 0.0))
    assert proposal.unreachable_m == proposal.blocked_m == 0.0 and "unworked" not in proposal.sentence
    firsts = [course.legs[0] for n, course in enumerate(proposal.plan.timed_missions) if n != number]
    assert sorted(bool(leg.gates) for leg in firsts) == [False, True]
    assert all(gate.tractor != number for leg in firsts for gate in leg.gates)


def test_an_accepted_plan_has_the_same_released_legs_and_goes_on(half: tuple[FleetManager, ReplanProposal]) -> None:
    manager, proposal = half
    before = [(state.leg, state.base_end) for state in manager.states]
    legs = [len(course.legs) for course in manager.plan.timed_missions]
    manager.obstacle_reports.acknowledge_alarm("bert", manager.alarms.list_alarms()[0].id, 100.5)
    manager.operators.adopt_plan("anna", proposal.plan, 101.0, (1,))
    assert [(state.leg, state.base_end) for state in manager.states] == before
    assert len(manager.plan.timed_missions[0].legs) > legs[0] or len(manager.plan.timed_missions[2].legs) > legs[2]
    orders, events = manager.take_outputs()
    assert {order.tractor for order in orders if order.kind == "plan"} == {0, 1, 2}
    assert "accept" in [event.what for event in events]
    (alarm,) = [each for each in manager.alarms.list_alarms() if each.code == "failed"]
    assert alarm.sentence == "Tractor 2 has failed; its tracks were given to others." and alarm.acknowledged == "bert"
    manager.update_fleet(102.0)
    assert not any(
        gate.tractor == 1 for n in (0, 2) for leg in manager.plan.timed_missions[n].legs for gate in leg.gates
    )
    again = restart_manager(manager, 102.0, 0.0)
    assert [state.leg for state in again.states] == [state.leg for state in manager.states]


def test_simulated_tractors_drive_a_plan_live_in_the_time_it_was_planned_for(plan: FleetPlan) -> None:
    fleet = start_live(plan)
    fleet.drive(lambda: fleet.manager.state == "done", 1.2 * max(plan.finish_s))
    assert fleet.now == pytest.approx(max(plan.finish_s), rel=0.03)
    assert fleet.manager.compute_total_worked_m() == pytest.approx(plan.worked_m)


def test_who_drives_is_not_told_to_wait_on_its_leg_and_who_stands_waits_there(
    plan_without_entrance: FleetPlan, forced_wait: ForcedWait
) -> None:
    failed, waiting = forced_wait.failed, forced_wait.waiting
    manager = at(plan_without_entrance, forced_wait.share)
    manager.operators.mark_failed("anna", failed, 1.0)
    driven = continue_remaining_work(extract_remaining_work(manager, [], 100.0)).plan
    for state, course in zip(manager.states, driven.timed_missions, strict=True):
        assert not course.legs[state.leg].gates
    stand(manager)
    rest = extract_remaining_work(manager, [], 100.0)
    made = continue_remaining_work(rest).plan
    state, (awaited,) = manager.states[waiting], {0, 1, 2} - {failed, waiting}
    (gate,) = made.timed_missions[waiting].legs[state.leg].gates
    assert gate.tractor == awaited and state.leg < state.base_end
    gates = [gate for course in made.timed_missions for leg in course.legs for gate in leg.gates]
    assert not any(gate.tractor == failed for gate in gates)
    check_proposal_still_fits(rest, manager, made)
    manager.operators.adopt_plan("anna", made, 101.0, rest.excluded)
    manager.operators.resume_tractors("anna", None, 103.0)
    manager.take_outputs()
    manager.update_fleet(103.2)
    assert state.holds == {Hold.WAITS_FOR_PLAN} and state.standing_ordered and not manager.states[awaited].holds
    assert manager.find_awaited_legs(waiting) == [(gate.tractor, gate.leg)]
    assert all(0.0 < manager.finish_in_s[number] < math.inf for number in (waiting, awaited))
    kept = restart_manager(manager, 103.2, 0.0)
    kept.update_fleet(0.2)
    assert kept.states[waiting].holds == {Hold.WAITS_FOR_PLAN, Hold.SERVICE_RESTARTED}
    kept.operators.resume_tractors("anna", None, 1.0)
    kept.update_fleet(1.2)
    assert kept.states[waiting].holds == {Hold.WAITS_FOR_PLAN}, "a restart does not let it go"
    manager.states[awaited].leg, manager.states[awaited].leg_m = gate.leg, gate.after_m + 0.1
    manager.update_fleet(103.4)
    assert not state.holds and not state.standing_ordered and manager.find_awaited_legs(waiting) == []


def test_a_plan_with_one_that_waits_where_it_stood_is_not_accepted_when_it_has_gone_on(
    plan_without_entrance: FleetPlan, forced_wait: ForcedWait
) -> None:
    manager, waiting = at(plan_without_entrance, forced_wait.share), forced_wait.waiting
    manager.operators.mark_failed("anna", forced_wait.failed, 1.0)
    stand(manager)
    rest = extract_remaining_work(manager, [], 100.0)
    made = continue_remaining_work(rest).plan
    moving, name = manager.states[waiting].report._replace(speed_mps=1.0), f"Tractor {waiting + 1}"
    manager.states[waiting].report = moving
    with pytest.raises(FleetManagerError, match=f"{name} already drives where the new plan makes it wait"):
        manager.operators.adopt_plan("anna", made, 101.0, rest.excluded)
    manager.states[waiting].report = moving._replace(speed_mps=0.0, x_m=moving.x_m + 3.0)
    with pytest.raises(FleetManagerError, match=rf"{name} was to wait where it stood and has moved 3\.0 m"):
        check_proposal_still_fits(rest, manager, made)


def stand(manager: FleetManager) -> None:
    """Everybody is paused, and stands."""
    manager.operators.pause_tractors("anna", None, 2.0)
    for state in manager.states:
        assert state.report is not None
        state.report = state.report._replace(speed_mps=0.0, mode="stopped")
