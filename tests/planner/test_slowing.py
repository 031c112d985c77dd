"""Turns tried alone before they are driven more slowly."""

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from planner.candidates import evaluate, slowing, turn_alone
from planner.candidates.steady import Slip, turn_start
from planner.site import Site
from strategies.registry import STRATEGIES
from vehicle.missions import Follow, Gate, Leg, Mission, Plan
from vehicle.run import DONE, Run


def test_a_turn_is_tried_once_whichever_plans_have_it(small_site: Site, monkeypatch: pytest.MonkeyPatch) -> None:
    site, tried = replace(small_site), []
    simulate = turn_alone.simulate

    def counted(*arguments: Any, **options: Any) -> Any:
        tried.append(arguments[0])
        return simulate(*arguments, **options)

    monkeypatch.setattr(turn_alone, "simulate", counted)
    plan = STRATEGIES["split-field"].build(site.job(1))
    legs = plan.missions[0].legs
    tracks = [n for n in range(1, len(legs)) if legs[n].implement and not legs[n - 1].implement]
    bad = [Slip(0, leg, 0.5) for leg in tracks[1:3]]
    first = slowing.cures(plan, bad, site)
    once = len(tried)
    assert once >= len(bad) * (1 + len(slowing.SLOWER))
    assert [cure.metres for cure in slowing.cures(plan, bad, site)] == [cure.metres for cure in first]
    assert len(tried) == once
    again = slowing.cures(plan, bad, replace(site))
    assert [cure.metres for cure in again] == [cure.metres for cure in first] and len(tried) == 2 * once


def test_turns_that_differ_are_told_apart(small_site: Site) -> None:
    legs = list(STRATEGIES["split-field"].build(small_site.job(1)).missions[0].legs[:4])
    slower = [replace(legs[0], speed_mps=0.9 * legs[0].speed_mps), *legs[1:]]
    backwards = [replace(legs[0], points=legs[0].points[::-1]), *legs[1:]]
    assert len({turn_alone.turn_key(tuple(some)) for some in (legs, slower, backwards, legs[:3])}) == 4
    assert turn_alone.turn_key(
        tuple(replace(leg, may_wait=not leg.may_wait) for leg in legs)
    ) == turn_alone.turn_key(tuple(legs))


def test_the_worst_counts_of_where_a_turn_may_begin(small_site: Site, monkeypatch: pytest.MonkeyPatch) -> None:
    """Over a third of the distance between two looks at the path it comes too near, elsewhere it does not."""
    legs = STRATEGIES["split-field"].build(small_site.job(1)).missions[0].legs
    first = next(n for n in range(1, len(legs)) if legs[n].implement and not legs[n - 1].implement)
    slip = Slip(0, next(n for n in range(first + 1, len(legs)) if legs[n].implement and not legs[n - 1].implement), 0.5)
    begun: list[float] = []

    def driven(turn: turn_alone.TurnAlone, tried: tuple[Leg, ...]) -> float:
        begun.append(sum(leg.length_m for leg in turn.before) - sum(leg.length_m for leg in tried[: len(turn.before)]))
        return 0.7 if begun[-1] > 0.06 else 0.1

    monkeypatch.setattr(turn_alone.TurnAlone, "_driven_off_m", driven)
    turn = turn_alone.turn_of(Plan((Mission(legs),)), slip, replace(small_site))
    assert turn.off_m(turn.legs) == 0.7
    look_m = turn.before[0].speed_mps / small_site.tractor.guidance.rate_hz
    assert begun == pytest.approx([0.0, 0.25 * look_m, 0.5 * look_m, 0.75 * look_m], abs=1e-9)
    assert 39.0 < sum(leg.length_m for leg in turn.before) <= 40.0 + 1e-9 and len(turn.before) > 1


@pytest.mark.parametrize("rest_m", [1e-3, 0.4, 0.999])
def test_a_lead_that_is_all_but_whole_takes_no_more(small_site: Site, rest_m: float) -> None:
    """Of legs of a track that are together that much short of 40 m no piece is cut that has no length."""
    legs = STRATEGIES["split-field"].build(small_site.job(1)).missions[0].legs
    starts = [n for n in range(1, len(legs)) if legs[n].implement and not legs[n - 1].implement]
    track = legs[starts[0]]
    ends = [np.array([x, 0.0]) for x in (0.0, 50.0, 80.0, 90.0 - rest_m)]
    pieces = tuple(replace(track, points=np.array(pair)) for pair in pairwise(ends))
    lead = turn_alone._lead((*pieces, legs[starts[1] - 1]), 3)
    assert lead == pieces[1:]
    assert sum(leg.length_m for leg in turn_alone._lead((pieces[0], *pieces[2:]), 2)) == pytest.approx(40.0)


def test_what_mends_a_turn_in_one_plan_is_taken_over_to_others(small_site: Site) -> None:
    """With the gates of the other plan; a turn in which a tractor follows another is left alone."""
    plan = STRATEGIES["split-field"].build(small_site.job(2))
    legs = plan.missions[1].legs
    goals = [n for n in range(1, len(legs)) if legs[n].implement and not legs[n - 1].implement][1:3]
    starts = [turn_start(plan.missions[1], goal) for goal in goals]
    slow = [tuple(replace(leg, speed_mps=0.5) for leg in legs[a:b]) for a, b in zip(starts, goals, strict=True)]
    cured = [slowing.Cure(Slip(1, goal, 0.5), way, 0.1) for goal, way in zip(goals, slow, strict=True)]
    known = slowing.cured_turns(plan, cured, small_site)
    gated = plan.with_gate(1, starts[0], Gate(0, 2, 5.0))
    again = slowing.with_cured(gated, known, small_site)
    assert [leg.speed_mps for leg in again.missions[1].legs] == [
        leg.speed_mps for leg in slowing.mended(gated, cured).missions[1].legs
    ]
    assert [leg.gates for leg in again.missions[1].legs] == [leg.gates for leg in gated.missions[1].legs]
    assert again.missions[0] == gated.missions[0]
    assert slowing.with_cured(plan, {}, small_site) is plan
    follows = replace(legs[starts[0]], follow=Follow(0, 1))
    led = Plan((plan.missions[0], Mission((*legs[: starts[0]], follows, *legs[starts[0] + 1 :]))))
    kept = slowing.with_cured(led, known, small_site).missions[1].legs
    assert [kept[start].speed_mps for start in starts] == [legs[starts[0]].speed_mps, 0.5]


@pytest.mark.parametrize("outside", [True, False])
def test_a_turn_that_leaves_the_field_is_mended_in_a_plan_with_other_gates(
    small_site: Site, monkeypatch: pytest.MonkeyPatch, outside: bool
) -> None:
    """Tractors meet with the gates of the run that the turn was found in; without these they would not."""
    plan = STRATEGIES["interleaved"].build(small_site.job(2))
    gated = plan.with_gate(1, 0, Gate(0, 2, 5.0))
    first, last = (Run(each, DONE, *[np.zeros(1)] * 3, (), 1.0) for each in (gated, plan))
    bad = Slip(0, 4, 0.9, outside)
    cure = slowing.Cure(bad, plan.missions[0].legs[3:4], 0.1)
    asked: list[Plan] = []

    def driven(tried: Plan, *_: Any) -> tuple[Run, str | None]:
        asked.append(tried)
        return (last, None) if tried is plan else (first, "they meet")

    monkeypatch.setattr(evaluate, "slips", lambda run, _: [bad] if run is first else [replace(bad, metres=0.1)])
    monkeypatch.setattr(evaluate, "cures", lambda *_: [cure])
    monkeypatch.setattr(evaluate, "mended", lambda tried, _: tried)
    monkeypatch.setattr(evaluate, "without_conflicts", driven)
    run, worst = evaluate._steadied(small_site, plan, first, lambda _: first, 5, lambda *_: None)
    assert asked == ([gated, plan] if outside else [gated])
    assert worst is not None and (run, worst.metres) == ((last, 0.1) if outside else (first, 0.9))
