"""The strategies as records: what others read of them, and the table of the guide that says the same."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from strategies.names import STRATEGY_NAMES
from strategies.registry import STRATEGIES
from vehicle.missions.plan_file import format_plan

GUIDE = Path(__file__).parents[2] / "planner/guide/headlands.md"


def test_records_are_named_as_they_are_registered() -> None:
    assert list(STRATEGIES) == list(STRATEGY_NAMES) == [strategy.name for strategy in STRATEGIES.values()]


@pytest.mark.parametrize("name", STRATEGY_NAMES)
def test_descriptions_fit_a_sentence_of_a_help_text(name: str) -> None:
    primitives = STRATEGIES[name].description
    assert primitives and not primitives.endswith(".") and "\n" not in primitives and "  " not in primitives


def test_the_guide_says_the_same_in_the_same_order() -> None:
    rows = re.findall(r"^\| `([a-z-]+)` \| (.*) \|$", GUIDE.read_text(encoding="utf-8"), re.MULTILINE)
    known = [(name, primitives) for name, primitives in rows if name in STRATEGIES]
    assert known == [(strategy.name, strategy.description) for strategy in STRATEGIES.values()]


@pytest.mark.parametrize("name", STRATEGY_NAMES)
def test_every_strategy_builds_without_a_simulation(jobs: Any, name: str) -> None:
    assert STRATEGIES[name].build(jobs.rectangle(6, tractors=3)).tractors == 3


@pytest.mark.parametrize("name", STRATEGY_NAMES)
def test_a_jump_changes_the_plan_where_it_is_taken_and_only_there(jobs: Any, name: str) -> None:
    job = jobs.rectangle(8, turn_s=(0.0, 90.0, 80.0, 10.0, 10.0))
    plans = {format_plan(STRATEGIES[name].build(replace(job, jump=jump, turn_counts={}))) for jump in (1, 3)}
    assert (len(plans) == 2) is STRATEGIES[name].takes_jump
