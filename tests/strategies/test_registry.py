"""The strategies as records: what others read of them, and the table of the README that says the same."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from strategies.names import NAMES
from strategies.registry import STRATEGIES
from vehicle.plan_file import plan_to_json

README = Path(__file__).parents[2] / "README.md"


def test_records_are_named_as_they_are_registered() -> None:
    assert list(STRATEGIES) == list(NAMES) == [strategy.name for strategy in STRATEGIES.values()]


@pytest.mark.parametrize("name", NAMES)
def test_words_fit_a_sentence_of_a_help_text(name: str) -> None:
    words = STRATEGIES[name].words
    assert words and not words.endswith(".") and "\n" not in words and "  " not in words


def test_the_readme_says_the_same_in_the_same_order() -> None:
    rows = re.findall(r"^\| `([a-z-]+)` \| (.*) \|$", README.read_text(encoding="utf-8"), re.MULTILINE)
    known = [(name, words) for name, words in rows if name in STRATEGIES]
    assert known == [(strategy.name, strategy.words) for strategy in STRATEGIES.values()]


@pytest.mark.parametrize("name", NAMES)
def test_every_strategy_builds_without_a_simulation(jobs: Any, name: str) -> None:
    assert STRATEGIES[name].build(jobs.rectangle(6, tractors=3)).tractors == 3


@pytest.mark.parametrize("name", NAMES)
def test_a_jump_changes_the_plan_where_it_is_taken_and_only_there(jobs: Any, name: str) -> None:
    job = jobs.rectangle(8, turn_s=(0.0, 90.0, 80.0, 10.0, 10.0))
    plans = {plan_to_json(STRATEGIES[name].build(replace(job, jump=jump, used={}))) for jump in (1, 3)}
    assert (len(plans) == 2) is STRATEGIES[name].takes_jump
