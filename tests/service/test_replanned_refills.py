"""The tracks of one that has failed given to others whose tanks run empty."""

import json
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from planner.evaluation.candidates.energy_figures import find_service_conflict, find_service_stops
from planner.fleet.manager.fleet_manager import FleetManager
from planner.fleet.manager.remaining_work import extract_remaining_work
from planner.fleet.model.fleet_plan import FleetPlan, prepare_fleet_plan
from planner.fleet.model.rules import FleetManagerError
from planner.fleet.replanning import from_here
from planner.fleet.replanning.from_here import cut_leg
from planner.fleet.replanning.planning_anew import (
    ReplanProposal,
    _describe_unknown_load,
    continue_remaining_work,
    infer_carried_supply,
)
from planner.pipeline.outputs.saved_plans import MACHINES_KEY
from strategies.rules.supply import Supply
from tests.service.test_replanning import at, plan_field
from vehicle.errors import MissionError
from vehicle.missions.plan import REFILL, Leg, Mission
from vehicle.missions.plan_file import format_plan
from vehicle.missions.run import SimulationRun

pytestmark = pytest.mark.slow

WIDTH_M, LOAD_M2, STAND_S = 6.0, 900.0, 60.0
TANK = Supply(LOAD_M2, 1.0, STAND_S)

Made = tuple[FleetManager, ReplanProposal, SimulationRun]


@pytest.fixture(scope="module", params=["headland", pytest.param("tender", marks=pytest.mark.matrix), "0,30"])
def plan(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> FleetPlan:
    """A plan of three tractors each of which stops for a load."""
    folder: Path = tmp_path_factory.mktemp("field")
    made = plan_field(folder, "split-field", TANK, entrance=(0.0, 0.0), refill=request.param, width_m=WIDTH_M)
    assert made.plan.notes.stops
    return made


@pytest.fixture(scope="module", params=["early", pytest.param("late", marks=pytest.mark.matrix)])
def made(plan: FleetPlan, request: pytest.FixtureRequest) -> Made:
    """A fleet one of which has failed, what the others are asked to do, and the last drive of that."""
    late = 0.45 if plan.scenario.refill == "headland" else 0.55  # while there are stops to come
    manager, runs = at(plan, 0.35 if request.param == "early" else late), []
    manager.operators.mark_failed("anna", 1, 1.0)
    watched = lambda run, supply: runs.append(run) or find_service_conflict(run, supply)  # noqa: E731
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(from_here, "find_service_conflict", watched)
        return manager, continue_remaining_work(extract_remaining_work(manager, [], 100.0)), runs[-1]


@pytest.mark.matrix
def test_one_is_served_at_a_time_where_only_one_can_be(plan: FleetPlan, made: Made) -> None:
    stops = find_service_stops(made[2])
    assert len(stops) >= 2 and {round(stop.to_s - stop.from_s) for stop in stops} == {STAND_S}
    if plan.scenario.refill != "headland":
        assert all(after.from_s >= before.to_s - 1e-6 for before, after in pairwise(stops))


def loads_m2(legs: tuple[Leg, ...]) -> Iterator[float]:
    """What is worked with each load."""
    used = 0.0
    for leg in legs:
        if leg.stand_s:
            yield used
            used = 0.0
        used += leg.length_m * leg.implement * WIDTH_M
    yield used


def test_nobody_is_asked_for_more_than_a_load_and_stops_stay_where_they_are_needed(made: Made) -> None:
    manager, proposal, _ = made
    most = max(load for course in manager.plan.timed_missions for load in loads_m2(course.legs))
    assert 0.0 < most <= LOAD_M2 + 1e-6 and proposal.reassigned_m > 50.0
    for number in (0, 2):
        new, kept = proposal.plan.timed_missions[number].legs, proposal.unchanged_legs[number]
        assert max(loads_m2(new)) <= LOAD_M2 + 1e-6
        before = manager.plan.timed_missions[number].legs
        assert [leg.stand_s for leg in new[:kept]] == [leg.stand_s for leg in before[:kept]]
        assert {leg.stand_s for leg in new} <= {0.0, STAND_S}
    new, before = (
        sum(len(list(loads_m2(each.timed_missions[number].legs))) for number in (0, 2))
        for each in (proposal.plan, manager.plan)
    )
    assert new >= before


def test_a_proposal_with_refills_is_adopted_and_its_notes_are_true(made: Made) -> None:
    manager, proposal, _ = made
    legs = [mission.legs for mission in proposal.plan.plan.missions]
    for stop in proposal.plan.plan.notes.stops:
        leg = legs[stop.tractor][stop.leg]
        assert leg.stand_s == STAND_S and leg.points[0].tolist() == pytest.approx([stop.x_m, stop.y_m])
    for each in legs:  # who goes to the place stands there
        ends = [k for k, leg in enumerate(each[:-1]) if leg.task.kind == REFILL and each[k + 1].task.kind != REFILL]
        assert all(each[k + 1].stand_s == STAND_S for k in ends)
    manager.operators.adopt_plan("anna", proposal.plan, 101.0, (1,))
    manager.update_fleet(102.0)
    assert manager.version == 2


@pytest.mark.parametrize(
    ("origin_m", "error", "words"),
    [
        (None, FleetManagerError, r"Tractor 2 of the plan stops for 1e\+18 s in all; shorten that to at most 86400 s"),
        ([1e300, 0.0], MissionError, "it must be two numbers of metres"),
        ([0.0, -2e8], MissionError, "it must be two numbers of metres"),
    ],
)
def test_a_plan_that_stands_for_longer_than_a_day_or_lies_nowhere_is_refused(
    plan: FleetPlan, origin_m: list[float] | None, error: type[Exception], words: str
) -> None:
    saved = plan.saved
    told = json.loads(format_plan(saved.plan, origin_m=saved.origin_m, scenario=saved.scenario, ground=saved.ground))
    if origin_m is None:
        told["tractors"][1][3]["stand_s"] = 1e18
    else:
        told["origin_m"] = origin_m
    with pytest.raises(error, match=words):
        prepare_fleet_plan(json.dumps(told))


def test_who_stands_for_a_load_does_so_in_the_rest_though_its_place_is_not_known_to_the_centimetre() -> None:
    stands = Leg(np.array([(0.0, 0.0), (30.0, 0.0)]), 1.0, stand_s=STAND_S)
    assert cut_leg(stands, 0.3).stand_s == STAND_S and cut_leg(stands, 5.0).stand_s == 0.0


def test_tanks_of_which_the_plan_tells_nothing_are_to_be_looked_to(plan: FleetPlan) -> None:
    none = tuple(
        replace(course, mission=Mission(tuple(replace(leg, stand_s=0.0) for leg in course.legs)))
        for course in plan.timed_missions
    )
    scenario = {key: value for key, value in plan.saved.scenario.items() if key != MACHINES_KEY}
    bare = replace(plan, timed_missions=none, saved=replace(plan.saved, scenario=scenario))
    told = _describe_unknown_load(bare, infer_carried_supply(bare))
    assert len(told) == 1 and "check the tanks" in told[0]
    assert _describe_unknown_load(plan, infer_carried_supply(plan)) == []
    notes = replace(plan.plan.notes, stops=None)
    dry = replace(bare, saved=replace(bare.saved, plan=replace(bare.plan, notes=notes)))
    assert _describe_unknown_load(dry, None) == []
