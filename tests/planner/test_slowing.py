"""Turns tried alone before they are driven more slowly."""

from dataclasses import replace
from typing import Any

import pytest

from planner.candidates import slowing, turn_alone
from planner.candidates.steady import Slip
from planner.site import Site
from strategies.registry import STRATEGIES


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
