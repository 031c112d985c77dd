"""Awkward fields on which fleets of every strategy must find a plan."""

from __future__ import annotations

from functools import cache

import pytest

from planner.candidates.evaluate import Candidate, evaluate
from planner.scenario import Scenario
from planner.site import Site, prepare
from strategies.registry import STRATEGIES
from tests.planner.shapes import SHAPES


@cache
def site_of(name: str) -> Site:
    return prepare(Scenario(field=name, tracks_only=False), SHAPES[name])


@pytest.mark.parametrize("strategy", sorted(STRATEGIES))
def test_a_strip_of_few_lines_is_worked_by_two(strategy: str) -> None:
    """Evenly shared out its lines would be nearer to each other than machines are wide: nobody could pass."""
    result = evaluate(site_of("thin strip"), Candidate(strategy, 2))
    assert result.feasible, result.reason
    assert result.worked_pct is not None and result.worked_pct > 99.0
