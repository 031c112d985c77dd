"""The strategies as records: what others read of them, and the table of the guide that says the same."""

import re
from pathlib import Path

import pytest

from strategies import registry
from strategies.names import FIRST_OFFERED, STRATEGY_DESCRIPTIONS, STRATEGY_NAMES, read_descriptions
from strategies.path_planning.errors import StrategyError
from strategies.registry import STRATEGIES
from strategies.split_field import deal_blocks
from strategies.strategy_record import Strategy

GUIDE = Path(__file__).parents[2] / "planner/guide/headlands.md"


def test_records_are_named_as_they_are_registered() -> None:
    assert list(STRATEGIES) == list(STRATEGY_NAMES) == [strategy.name for strategy in STRATEGIES.values()]
    assert {strategy.name: strategy.description for strategy in STRATEGIES.values()} == STRATEGY_DESCRIPTIONS
    assert STRATEGY_NAMES[: len(FIRST_OFFERED)] == FIRST_OFFERED


def test_a_module_with_a_record_is_a_strategy(tmp_path: Path) -> None:
    (tmp_path / "in_pairs.py").write_text('NAME = "in-pairs"\nSTRATEGY = Strategy(NAME, "two " "tracks each", deal)\n')
    (tmp_path / "col_by_col.py").write_text('STRATEGY = Strategy("col-by-col", "by sides", formation=None)\n')
    (tmp_path / "registry.py").write_text("STRATEGIES = {}\n")
    assert list(read_descriptions(tmp_path).items()) == [("col-by-col", "by sides"), ("in-pairs", "two tracks each")]


@pytest.mark.parametrize("source", [
    'STRATEGY: Strategy = Strategy("in-pairs", "two tracks each", deal)',
    'STRATEGY = Strategy(description="two tracks each", name="in-pairs", deal=deal)',
    'WORDS = "two tracks each"\nSTRATEGY = Strategy("in-pairs", WORDS, deal)',
])  # fmt: skip
def test_a_record_may_be_written_in_any_way(tmp_path: Path, source: str) -> None:
    (tmp_path / "in_pairs.py").write_text(source)
    assert read_descriptions(tmp_path) == {"in-pairs": "two tracks each"}


@pytest.mark.parametrize("source", [
    'STRATEGY = Strategy("pairs", "two tracks each", deal)', 'STRATEGY = Strategy("in-pairs", f"{2} each", deal)',
    'STRATEGY = Strategy("in-pairs")', "STRATEGY = make()",
])  # fmt: skip
def test_a_record_that_cannot_be_read_is_named(tmp_path: Path, source: str) -> None:
    (tmp_path / "in_pairs.py").write_text(source)
    with pytest.raises(ValueError, match=r"in_pairs\.py must set STRATEGY = Strategy\('in-pairs', "):
        read_descriptions(tmp_path)


def test_a_fault_of_a_strategy_is_why_it_has_no_plan() -> None:
    def fail(*_: object) -> None:
        raise IndexError("7")

    guarded = registry.guard_strategy(Strategy("odd", "words", fail), "Strategy 'odd'")  # type: ignore[arg-type]
    assert guarded.deal is not None
    with pytest.raises(StrategyError, match=r"Strategy 'odd' failed \(IndexError: 7\)\."):
        guarded.deal([], None, 2)  # type: ignore[arg-type]


@pytest.mark.parametrize("name", STRATEGY_NAMES)
def test_descriptions_fit_a_sentence_of_a_help_text(name: str) -> None:
    text = STRATEGIES[name].description
    assert text and not text.endswith(".") and "\n" not in text and "  " not in text


def test_the_guide_says_the_same_in_the_same_order() -> None:
    rows = re.findall(r"^\| `([a-z-]+)` \| (.*) \|$", GUIDE.read_text(encoding="utf-8"), re.MULTILINE)
    known = [(name, words.partition(": ")[0]) for name, words in rows if name in STRATEGIES]
    assert known == [(strategy.name, strategy.description) for strategy in STRATEGIES.values()]


def test_a_strategy_deals_or_forms_up() -> None:
    for made in ({}, {"deal": deal_blocks, "formation": STRATEGIES["col-by-col"].formation}):
        with pytest.raises(TypeError, match="strategy 'odd' needs either deal or formation"):
            Strategy("odd", "words", **made)
