"""Turns tried alone before they are driven more slowly."""

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from planner.evaluation.candidates import evaluate
from planner.evaluation.context import PlanningContext
from planner.evaluation.repair import turn_repair, turn_trial
from planner.evaluation.repair.path_deviation import TurnDeviation, find_first_turn_leg
from strategies.registry import STRATEGIES
from vehicle.missions.plan import FollowOrder, Leg, LegGate, Mission, Plan
from vehicle.missions.run import DONE, SimulationRun
from vehicle.sim.world import World


def test_a_turn_is_tried_once_whichever_plans_have_it(
    small_site: PlanningContext, monkeypatch: pytest.MonkeyPatch
) -> None:
    site, tried = replace(small_site), []

    def build_counted_world(*arguments: Any, **options: Any) -> World:
        tried.append(arguments[0])
        return World(*arguments, **options)

    monkeypatch.setattr(turn_trial, "World", build_counted_world)
    plan = STRATEGIES["split-field"].build(site.build_job(1))
    legs = plan.missions[0].legs
    tracks = [n for n in range(1, len(legs)) if legs[n].implement and not legs[n - 1].implement]
    bad = [TurnDeviation(0, leg, 0.5) for leg in tracks[1:3]]
    first = turn_repair.find_repairs(plan, bad, site)
    once = len(tried)
    assert once >= len(bad) * (1 + len(turn_repair.SLOW_FACTORS))
    assert [cure.offset_m for cure in turn_repair.find_repairs(plan, bad, site)] == [cure.offset_m for cure in first]
    assert len(tried) == once
    again = turn_repair.find_repairs(plan, bad, replace(site))
    assert [cure.offset_m for cure in again] == [cure.offset_m for cure in first] and len(tried) == 2 * once


def test_turns_that_differ_are_told_apart(small_site: PlanningContext) -> None:
    legs = list(STRATEGIES["split-field"].build(small_site.build_job(1)).missions[0].legs[:4])
    slower = [replace(legs[0], speed_mps=0.9 * legs[0].speed_mps), *legs[1:]]
    backwards = [replace(legs[0], points=legs[0].points[::-1]), *legs[1:]]
    assert len({turn_trial.hash_legs(tuple(some)) for some in (legs, slower, backwards, legs[:3])}) == 4
    assert turn_trial.hash_legs(tuple(replace(leg, may_wait=not leg.may_wait) for leg in legs)) == turn_trial.hash_legs(
        tuple(legs)
    )


def test_the_worst_counts_of_where_a_turn_may_begin(
    small_site: PlanningContext, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Over a third of the distance between two looks at the path it comes too near, elsewhere it does not."""
    legs = STRATEGIES["split-field"].build(small_site.build_job(1)).missions[0].legs
    first = next(n for n in range(1, len(legs)) if legs[n].implement and not legs[n - 1].implement)
    slip = TurnDeviation(
        0, next(n for n in range(first + 1, len(legs)) if legs[n].implement and not legs[n - 1].implement), 0.5
    )
    begun: list[float] = []

    def driven(turn: turn_trial.TurnTrial, tried: tuple[Leg, ...]) -> float:
        begun.append(
            sum(leg.length_m for leg in turn.lead_legs) - sum(leg.length_m for leg in tried[: len(turn.lead_legs)])
        )
        return 0.7 if begun[-1] > 0.06 else 0.1

    monkeypatch.setattr(turn_trial.TurnTrial, "_simulate_offset_m", driven)
    turn = turn_trial.build_turn_trial(Plan((Mission(legs),)), slip, replace(small_site))
    assert turn.measure_offset_m(turn.legs) == 0.7
    look_m = turn.lead_legs[0].speed_mps / small_site.tractor.guidance.rate_hz
    assert begun == pytest.approx([0.0, 0.25 * look_m, 0.5 * look_m, 0.75 * look_m], abs=1e-9)
    assert 39.0 < sum(leg.length_m for leg in turn.lead_legs) <= 40.0 + 1e-9 and len(turn.lead_legs) > 1


@pytest.mark.parametrize("rest_m", [1e-3, 0.4, 0.999])
def test_a_lead_that_is_all_but_whole_takes_no_more(small_site: PlanningContext, rest_m: float) -> None:
    """Of legs of a track that are together that much short of 40 m no piece is cut that has no length."""
    legs = STRATEGIES["split-field"].build(small_site.build_job(1)).missions[0].legs
    starts = [n for n in range(1, len(legs)) if legs[n].implement and not legs[n - 1].implement]
    track = legs[starts[0]]
    ends = [np.array([x, 0.0]) for x in (0.0, 50.0, 80.0, 90.0 - rest_m)]
    pieces = tuple(replace(track, points=np.array(pair)) for pair in pairwise(ends))
    lead = turn_trial._cut_lead_in_legs((*pieces, legs[starts[1] - 1]), 3)
    assert lead == pieces[1:]
    assert sum(leg.length_m for leg in turn_trial._cut_lead_in_legs((pieces[0], *pieces[2:]), 2)) == pytest.approx(40.0)


def test_what_mends_a_turn_in_one_plan_is_taken_over_to_others(small_site: PlanningContext) -> None:
    """With the gates of the other plan; a turn in which a tractor follows another is left alone."""
    plan = STRATEGIES["split-field"].build(small_site.build_job(2))
    legs = plan.missions[1].legs
    goals = [n for n in range(1, len(legs)) if legs[n].implement and not legs[n - 1].implement][1:3]
    starts = [find_first_turn_leg(plan.missions[1], goal) for goal in goals]
    slow = [tuple(replace(leg, speed_mps=0.5) for leg in legs[a:b]) for a, b in zip(starts, goals, strict=True)]
    cured = [
        turn_repair.TurnRepair(TurnDeviation(1, goal, 0.5), way, 0.1) for goal, way in zip(goals, slow, strict=True)
    ]
    known = turn_repair.collect_repaired_turns(plan, cured, small_site)
    gated = plan.copy_with_gate(1, starts[0], LegGate(0, 2, 5.0))
    again = turn_repair.apply_repaired_turns(gated, known, small_site)
    assert [leg.speed_mps for leg in again.missions[1].legs] == [
        leg.speed_mps for leg in turn_repair.apply_repairs(gated, cured).missions[1].legs
    ]
    assert [leg.gates for leg in again.missions[1].legs] == [leg.gates for leg in gated.missions[1].legs]
    assert again.missions[0] == gated.missions[0]
    assert turn_repair.apply_repaired_turns(plan, {}, small_site) is plan
    follows = replace(legs[starts[0]], follow=FollowOrder(0, 1))
    led = Plan((plan.missions[0], Mission((*legs[: starts[0]], follows, *legs[starts[0] + 1 :]))))
    kept = turn_repair.apply_repaired_turns(led, known, small_site).missions[1].legs
    assert [kept[start].speed_mps for start in starts] == [legs[starts[0]].speed_mps, 0.5]


@pytest.mark.parametrize("outside", [True, False])
def test_a_turn_that_leaves_the_field_is_mended_in_a_plan_with_other_gates(
    small_site: PlanningContext, monkeypatch: pytest.MonkeyPatch, outside: bool
) -> None:
    """Tractors meet with the gates of the run that the turn was found in; without these they would not."""
    plan = STRATEGIES["interleaved"].build(small_site.build_job(2))
    gated = plan.copy_with_gate(1, 0, LegGate(0, 2, 5.0))
    first, last = (SimulationRun(each, DONE, *[np.zeros(1)] * 3, (), 1.0) for each in (gated, plan))
    bad = TurnDeviation(0, 4, 0.9, outside)
    cure = turn_repair.TurnRepair(bad, plan.missions[0].legs[3:4], 0.1)
    asked: list[Plan] = []

    def driven(tried: Plan, *_: Any) -> tuple[SimulationRun, str | None]:
        asked.append(tried)
        return (last, None) if tried is plan else (first, "they meet")

    monkeypatch.setattr(
        evaluate, "find_turn_deviations", lambda run, _: [bad] if run is first else [replace(bad, offset_m=0.1)]
    )
    monkeypatch.setattr(evaluate, "find_repairs", lambda *_: [cure])
    monkeypatch.setattr(evaluate, "apply_repairs", lambda tried, _: tried)
    monkeypatch.setattr(evaluate, "resolve_conflicts", driven)
    run, worst = evaluate._repair_turns(small_site, plan, first, lambda _: first, 5, lambda *_: None)
    assert asked == ([gated, plan] if outside else [gated])
    assert worst is not None and (run, worst.offset_m) == ((last, 0.1) if outside else (first, 0.9))
