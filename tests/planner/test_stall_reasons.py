"""Why a plan comes to nothing or takes too long, in words that can be true: one tractor waits for nobody."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from planner.evaluation.candidates.figures import CandidateRun, measure_candidate
from planner.evaluation.candidates.fleet_drive import _describe_slow_work, resolve_conflicts
from vehicle.missions.plan import Leg, LegGate, Mission, Plan
from vehicle.missions.run import DONE, STALL, SimulationRun
from vehicle.model.tractor import Implement, load_tractor
from vehicle.records import REC_SPEED, REC_STATUS, RECORD_COLUMNS, TURNING, WORKING
from vehicle.sim.world import simulate

TRACTOR = load_tractor("eg105")


def drive(plan: Plan) -> SimulationRun:
    return simulate(plan, TRACTOR, Implement(), max_time_s=900.0)


def schedule_nothing(plan: Plan) -> None:
    """Nobody gives way."""


def build_leg(start: tuple[float, float], end: tuple[float, float], *gates: LegGate) -> Leg:
    return Leg(np.array([start, end]), 1.4, gates=gates)


def test_one_tractor_that_cannot_follow_its_path_is_not_said_to_wait() -> None:
    """Its second leg is so slow that it does not get a centimetre on in two minutes."""
    slow = replace(build_leg((12.0, 0.0), (40.0, 0.0)), speed_mps=1e-5)
    plan = Plan((Mission((build_leg((0.0, 0.0), (12.0, 0.0)), slow)),))
    run, reason = resolve_conflicts(plan, drive, schedule_nothing)
    assert run.outcome == STALL
    assert (
        reason.startswith("tractor 1 stands still at (1")
        and reason.endswith("it cannot follow its path there")
        and "wait" not in reason
    )


def test_two_that_wait_for_each_other_are_said_to() -> None:
    first = Mission((build_leg((0.0, 0.0), (9.0, 0.0), LegGate(1, 0, 3.0)),))
    second = Mission((build_leg((0.0, 9.0), (9.0, 9.0), LegGate(0, 0, 3.0)),))
    assert (
        resolve_conflicts(Plan((first, second)), drive, schedule_nothing)[1]
        == "tractors wait for each other and none moves any more"
    )


def test_two_that_meet_only_once_scheduled_are_named() -> None:
    first = Mission((build_leg((0.0, 0.0), (30.0, 0.0), LegGate(1, 0, 3.0)),))
    second = Mission((build_leg((30.0, 0.0), (0.0, 0.0), LegGate(0, 0, 3.0)),))
    free = Plan(tuple(Mission((replace(mission.legs[0], gates=()),)) for mission in (first, second)))

    def drive_apart(plan: Plan) -> SimulationRun:
        return simulate(plan, TRACTOR, Implement(), max_time_s=900.0, stop_clearance_m=0.5)

    reason = resolve_conflicts(Plan((first, second)), drive_apart, lambda _: free)[1]
    assert reason.startswith("tractors 1 and 2 meet after ")


def test_a_plan_that_ends_in_a_collision_has_its_reason_and_no_times() -> None:
    """Two tractors drive towards each other on one line."""
    ways = (build_leg((0.0, 0.0), (0.0, 40.0)), build_leg((0.0, 40.0), (0.0, 0.0)))
    run = drive(Plan(tuple(Mission((way,)) for way in ways)))
    context: Any = SimpleNamespace()
    result = measure_candidate(context, "row-by-row", 2, CandidateRun(run, "tractors 1 and 2 touch", "U-turns"))
    assert run.outcome != DONE and result.collisions == len(run.contacts) == 1
    assert (result.strategy, result.tractors, result.feasible) == ("row-by-row", 2, False)
    assert result.reason == "tractors 1 and 2 touch" and result.time_s is None


@pytest.mark.parametrize(("driven_mps", "is_told"), [(0.5, True), (-0.5, True), (1.9, False)])
def test_slow_work_is_told_with_both_speeds(driven_mps: float, is_told: bool) -> None:
    record = np.zeros((50, 1, len(RECORD_COLUMNS)))
    record[:, 0, REC_SPEED], record[:, 0, REC_STATUS] = driven_mps, WORKING
    record[:10, 0, REC_SPEED], record[:10, 0, REC_STATUS] = 0.1, TURNING
    leg = SimpleNamespace(speed_mps=2.0)
    run: Any = SimpleNamespace(record=record, plan=SimpleNamespace(missions=[SimpleNamespace(legs=[leg])]))
    said = _describe_slow_work(run)
    assert ("at 1.8 km/h instead of 7.2" in said) == is_told and bool(said) == is_told
