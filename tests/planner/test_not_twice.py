"""Nothing is driven twice; of the plans of a candidate only those are driven that may win."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapely

from fields import Field
from planner.evaluation.candidates.evaluate import Candidate, run_candidate, simulate_candidate
from planner.evaluation.candidates.pruning import (
    Incumbent,
    PruningLimits,
    drop_simulated,
    is_same_plan,
    simulate_promising_first,
    split_contenders,
)
from planner.evaluation.candidates.solo_runs import SoloRuns
from planner.evaluation.candidates.time_bounds import (
    build_speed_limits,
    compute_earliest_finish_s,
    compute_finish_from_solo_s,
    remove_gates,
)
from planner.evaluation.context import PlanningContext, prepare_context
from planner.request.plan_request import PlanRequest
from strategies.program.strategy_record import RefinedPlan
from strategies.split_field import plan_split_field
from vehicle.missions.plan import LegGate, Mission, Plan
from vehicle.missions.run import SimulationRun
from vehicle.sim.incremental import IncrementalSimulator


@pytest.fixture(scope="module")
def round_site() -> PlanningContext:
    """60 m by 90 m with its headland worked."""
    return prepare_context(PlanRequest(), Field("drawn", shapely.box(0, 0, 60, 90)))


def two_plans(site: PlanningContext) -> tuple[Plan, Plan]:
    """Two tractors by blocks, and the same with the second one waiting for the first to be nearly done."""
    plan = plan_split_field(site.build_job(2))
    last = len(plan.missions[0].legs) - 1
    return plan, plan.copy_with_gate(1, 0, LegGate(0, last, 1.0))


def copied(plan: Plan, **changes: Any) -> Plan:
    """The plan with legs of its own, the third of the first tractor changed."""
    legs = [[replace(leg, points=leg.points.copy()) for leg in mission.legs] for mission in plan.missions]
    legs[0][2] = replace(legs[0][2], **changes)
    return Plan(tuple(Mission(tuple(each)) for each in legs))


def test_plans_are_alike_leg_for_leg(round_site: PlanningContext) -> None:
    plan, waits = two_plans(round_site)
    assert is_same_plan(plan, plan) and is_same_plan(plan, copied(plan)) and not is_same_plan(plan, waits)
    moved = plan.missions[0].legs[2].points + 1e-6
    for change in ({"points": moved}, {"speed_mps": 0.5}, {"gates": (LegGate(1, 0),)}, {"stand_s": 1.0}):
        assert not is_same_plan(plan, copied(plan, **change))
    assert not is_same_plan(plan, Plan(plan.missions[:1])) and not is_same_plan(Plan(plan.missions[:1]), plan)
    assert [one.plan for one in drop_simulated([RefinedPlan(copied(plan)), RefinedPlan(waits)], [plan])] == [waits]


def test_a_choice_that_is_beaten_leaves_the_other_to_be_driven(round_site: PlanningContext) -> None:
    plan, waits = two_plans(round_site)
    pace = build_speed_limits(round_site.tractor, round_site.implement, round_site.driving_rules.radius_m)
    quick, slow = compute_earliest_finish_s(plan, pace), compute_earliest_finish_s(waits, pace)
    assert slow > 1.2 * quick
    choices, alone = [RefinedPlan(waits), RefinedPlan(plan)], SoloRuns(round_site)
    left, beaten = split_contenders(round_site, choices, Incumbent("another", 0.9 * slow), alone)
    assert left == choices[1:] and beaten is not None and beaten.bound_s == pytest.approx(slow)
    assert split_contenders(round_site, choices, Incumbent("another", 2.0 * slow), alone) == (choices, None)
    left, beaten = split_contenders(round_site, choices, Incumbent("another", 0.5 * quick), alone)
    assert not left and beaten is not None and beaten.bound_s == pytest.approx(quick)


def test_the_same_plan_by_another_passage_is_not_driven_again(
    round_site: PlanningContext, meeting: list[Plan], monkeypatch: pytest.MonkeyPatch
) -> None:
    plan, waits = two_plans(round_site)
    again = [RefinedPlan(copied(plan))], [RefinedPlan(plan), RefinedPlan(waits)]
    monkeypatch.setattr(
        "planner.evaluation.candidates.evaluate.iter_headland_variants", lambda *_: iter(([RefinedPlan(plan)], *again))
    )
    assert run_candidate(round_site, Candidate("split-field", 2)).reason == "tractors meet"
    assert meeting == [plan, waits]


def test_what_is_left_out_as_beaten_is_told_where_the_rest_cannot_be_driven(
    round_site: PlanningContext, meeting: list[Plan], monkeypatch: pytest.MonkeyPatch
) -> None:
    plan, waits = two_plans(round_site)
    pace = build_speed_limits(round_site.tractor, round_site.implement, round_site.driving_rules.radius_m)
    slow = compute_earliest_finish_s(waits, pace)
    choices = [RefinedPlan(waits), RefinedPlan(plan)]
    monkeypatch.setattr(
        "planner.evaluation.candidates.evaluate.iter_headland_variants", lambda *_: iter((choices, choices))
    )
    told = simulate_candidate(round_site, Candidate("split-field", 2, jump=1), Incumbent("a rival", 0.9 * slow)).result
    assert meeting == [plan]  # and what beats the other is no reason to try it by another passage
    assert not told.feasible and told.bound_s == pytest.approx(slow, abs=1e-3)
    assert told.reason == (f"skipped: even its best case ({slow:.0f} s) is slower than a rival ({0.9 * slow:.0f} s)")


def test_the_slowest_alone_is_asked_first_and_may_be_enough(round_site: PlanningContext) -> None:
    plan = plan_split_field(round_site.build_job(2))
    legs = [mission.legs for mission in plan.missions]
    short = Plan((Mission(legs[0][: len(legs[0]) // 2]), plan.missions[1]))
    alone, asked = SoloRuns(round_site), []

    def drive(mission: Mission) -> SimulationRun:
        asked.append(mission)
        return alone(mission)

    whole = compute_finish_from_solo_s(short, drive)
    assert [len(each.legs) for each in asked] == [len(legs[1]), len(legs[0]) // 2]
    asked.clear()
    assert 0.5 * whole < compute_finish_from_solo_s(short, drive, 0.5 * whole) <= whole and len(asked) == 1
    asked.clear()
    assert compute_finish_from_solo_s(short, drive, whole + 1.0) == whole and len(asked) == 1, (
        "the other has less to do"
    )


def test_all_are_driven_alone_where_what_the_plan_lets_them_wait_may_decide(round_site: PlanningContext) -> None:
    _, waits = two_plans(round_site)
    alone, asked = SoloRuns(round_site), []

    def drive(mission: Mission) -> SimulationRun:
        asked.append(mission)
        return alone(mission)

    whole = compute_finish_from_solo_s(waits, drive)
    slowest = compute_finish_from_solo_s(remove_gates(waits), drive)
    assert 0.9 * slowest < compute_finish_from_solo_s(waits, drive, 0.9 * slowest) < whole
    for enough_s in (0.98 * whole, 1.1 * whole):
        asked.clear()
        assert compute_finish_from_solo_s(waits, drive, enough_s) == whole and len(asked) == 2


def test_who_is_driven_alone_is_forgotten_only_where_records_are_long(
    round_site: PlanningContext, monkeypatch: pytest.MonkeyPatch
) -> None:
    one, other = plan_split_field(round_site.build_job(2)).missions
    alone = SoloRuns(round_site)
    first = alone(one)
    alone(other)
    assert alone(one) is first
    monkeypatch.setattr("planner.evaluation.candidates.solo_runs.MAX_ROWS", 0)
    alone(plan_split_field(round_site.build_job(1)).missions[0])
    again = alone(one)
    assert again is not first and np.array_equal(again.record, first.record)


def test_of_an_expected_plan_all_others_are_driven_with_the_second_that_is_asked_for(
    round_site: PlanningContext, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = plan_split_field(round_site.build_job(4))
    free, site = remove_gates(plan).missions, round_site
    rehearsal = IncrementalSimulator(site.tractor, site.implement, stop_clearance_m=0.5, seed=site.request.seed)
    alone, plain, driven, apart = SoloRuns(site, rehearsal), SoloRuns(site), [], rehearsal.simulate_alone

    def noted(plan: Plan, numbers: list[int], most_s: list[float]) -> Any:
        driven.append(numbers)
        return apart(plan, numbers, most_s)

    monkeypatch.setattr(rehearsal, "simulate_alone", noted)
    alone.expect_plans([plan])
    alone.expect_plan(plan)
    for number in (2, 0, 1, 3):
        run, own = alone(free[number]), plain(free[number])
        assert run.record.tobytes() == own.record.tobytes() and run.outcome == own.outcome
    assert driven == [[2], [0, 1, 3]]
    alone(Mission(free[0].legs[:5]))
    assert len(driven) == 2  # that is no tractor of the plan


def test_blocks_of_a_field_are_worked_out_once_for_all_orders(monkeypatch: pytest.MonkeyPatch) -> None:
    site = prepare_context(PlanRequest(), Field("drawn", shapely.box(0, 0, 60, 90)))
    there = plan_split_field(site.build_job(2))
    monkeypatch.setattr("strategies.split_field.TurnTable", None)
    back = plan_split_field(replace(site.build_job(2), reversed_tractors=(0, 1)))
    assert "order_gap_pct" in there.notes and "order_gap_pct" not in back.notes
    for mission, turned in zip(there.missions, back.missions, strict=True):
        worked = [[leg.task for leg in each.legs if leg.implement] for each in (mission, turned)]
        assert {task.number for task in worked[0]} == {task.number for task in worked[1]}


class Driven:
    """A choice driven in so many seconds, or not at all."""

    def __init__(self, choice: RefinedPlan, seconds: float | None) -> None:
        self.reason = "tractors meet" if seconds is None else None
        self.run = type("Run", (), {"plan": choice.plan, "duration_s": seconds})()


@pytest.mark.parametrize(("first_s", "expected"), [(None, 1), (1e5, 2)])
def test_the_others_are_driven_where_one_that_might_win_turns_out_slow(
    round_site: PlanningContext, first_s: float | None, expected: int
) -> None:
    plan, _ = two_plans(round_site)
    beaten, open_ = RefinedPlan(copied(plan)), RefinedPlan(plan)
    driven: list[RefinedPlan] = []

    def drive(choice: RefinedPlan) -> Driven:
        driven.append(choice)
        return Driven(choice, first_s if choice is open_ else 2e5)

    found = simulate_promising_first([open_], [beaten, open_], drive, PruningLimits())
    assert [id(choice) for choice in driven] == [id(open_), id(beaten)][:expected]
    assert len(found) == expected
