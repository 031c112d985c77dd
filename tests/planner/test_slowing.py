"""Turns tried alone before they are driven more slowly."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from planner.candidates import evaluate, slowing, turn_alone
from planner.candidates.steady import Slip
from planner.site import Site
from strategies.registry import STRATEGIES
from vehicle.missions import Gate, Plan
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
