"""How answers are counted, by hand; and that the sets of a seed are what they are said to be."""

import argparse
import json
from collections import Counter
from fractions import Fraction
from pathlib import Path

import pytest

from tests.benchmarks import diagnosis
from tests.diagnosis.sets import BLOCKS, EITHER_WAY, LogSet, inside, sets_of, size_of
from tests.diagnosis.tally import Record, coverage_by_parameter, faults, tallied, verdicts
from tests.truth.effects import CLEAR_SIZES, NEUTRAL

NAMES = ("steering_offset", "wheel_slip")


def record(size: str, hidden: dict[str, dict[str, float]], **said: tuple[str, float, float, float]) -> Record:
    """An answer: per effect its status, value and interval."""
    findings = [
        {"id": name, "status": status, "value": {size_of(CLEAR_SIZES[name]): value},
         "interval": {size_of(CLEAR_SIZES[name]): [low, high]}, "visible": 0.1}
        for name, (status, value, low, high) in said.items()
    ]  # fmt: skip
    named = [name for name, one in said.items() if one[0] == "named"]
    return {"key": f"{size} {'+'.join(hidden)}", "seed": 1, "size": size, "hidden": hidden, "named": named,
            "said": findings, "unexplained": 0.0}  # fmt: skip


OFFSET, SLIP = {"angle_deg": 1.0}, {"ratio": 0.08}
RECORDS = [
    record("clear", {"steering_offset": OFFSET}, steering_offset=("named", 1.1, 0.9, 1.3)),
    record("clear", {"steering_offset": OFFSET}, steering_offset=("likely", 0.7, 0.5, 0.9)),
    record("clear", {}, wheel_slip=("named", 0.02, 0.01, 0.03)),
    record("third", {"wheel_slip": SLIP}, wheel_slip=("named", 0.07, 0.06, 0.09), steering_offset=("likely", 1, 0, 2)),
    record("clear", {"wheel_slip": SLIP, "steering_offset": OFFSET}, wheel_slip=("equivalent", 0.08, 0.0, 0.1)),
    {"key": "broken", "seed": 1, "size": "clear", "hidden": {"wheel_slip": SLIP}, "error": "LogError: no rows"},
]


def test_counts_by_hand() -> None:
    offset, slip = tallied(RECORDS, NAMES).values()
    assert str(offset.alone["clear"]) == "1/2" and str(offset.told["clear"]) == "2/2"
    assert str(offset.together) == "0/1" and str(offset.covered) == "1/2" and str(offset.likely) == "1/2"
    assert str(slip.alone["third"]) == "1/1" and str(slip.alone["clear"]) == "0/1"
    assert (slip.wrong, offset.wrong, str(slip.covered)) == (1, 0, "1/1")


def test_verdicts_by_hand() -> None:
    told = verdicts(RECORDS, tallied(RECORDS, NAMES))
    assert [figure for _, figure, _ in told] == ["1/5 = 20.0%", "1/6 = 16.7%", "2/3 = 66.7%", "1/2 = 50.0%"]
    assert not any(holds for *_, holds in told)
    good = RECORDS[:1] * 20
    *reached, likely = verdicts(good, tallied(good, NAMES))
    assert [holds for *_, holds in reached] == [True, True, False]  # all in their intervals: these are too wide
    assert likely[2] is None


def test_coverage_is_told_by_parameter() -> None:
    words = coverage_by_parameter(tallied(RECORDS, NAMES))
    assert "at least 90%: 1 of 2" in words and words.endswith("not steering_offset 1/2")
    assert coverage_by_parameter(tallied(RECORDS[:1], NAMES)).endswith("1 of 1")


def test_faults_name_the_set_and_what_was_said() -> None:
    lines = faults(RECORDS)
    assert not any(line.startswith("clear steering_offset: steering_offset 1 named") for line in lines)
    assert "clear steering_offset: steering_offset 1 likely steering_offset = 0.7 (0.5 to 0.9)" in lines
    assert "clear : wrong name wheel_slip = 0.02 (0.01 to 0.03)" in lines
    assert "broken: ended in LogError: no rows" in lines


def test_a_limit_that_is_never_reached_is_in_no_interval() -> None:
    assert inside({"limit_g": [0.05, 0.09]}, {"limit_g": 0.08}) is True
    assert inside({"limit_g": [0.05, 0.09]}, {"limit_g": 0.16}) is False
    assert inside(None, {"limit_g": 0.08}) is None


@pytest.mark.parametrize("seed", [4, 5])
def test_a_seed_has_every_effect_every_two_blocks_and_every_three(seed: int) -> None:
    sets = sets_of(seed)
    assert len(sets) == len({one.key for one in sets}) == 3 * len(CLEAR_SIZES) + 10 + 4 + 3
    assert {name for block in BLOCKS.values() for name in block} == set(CLEAR_SIZES)
    of = {name: block for block, names in BLOCKS.items() for name in names}
    pairs = {tuple(sorted(of[name] for name in one.names)) for one in sets if len(one.names) == 2}
    triples = {tuple(sorted(of[name] for name in one.names)) for one in sets if len(one.names) == 3}
    assert len(pairs) == 10 and len(triples) == 4
    assert sets == sets_of(seed)
    # What one seed shows on one tractor, the next shows on the other.
    mine, next_one = ({(one.names, one.size): one.tractor for one in sets_of(number)} for number in (seed, seed + 1))
    assert all(next_one[what] != tractor for what, tractor in mine.items() if len(what[0]) == 1)


def test_sizes_and_signs_are_drawn_about_the_clear_size() -> None:
    for name in CLEAR_SIZES:
        key, signs = size_of(CLEAR_SIZES[name]), set()
        for seed in range(12):
            values = LogSet(seed, (name,), "half", "eg105").effects()[name]
            share = (values[key] - NEUTRAL[name][key]) / (CLEAR_SIZES[name][key] - NEUTRAL[name][key])
            if name == "side_slip":
                share = CLEAR_SIZES[name][key] / values[key]
            assert 0.5 - 1e-9 <= abs(share) <= 0.5 * 1.25 + 1e-9
            signs.add(share > 0.0)
        assert signs == ({True, False} if name in EITHER_WAY else {True})


@pytest.mark.parametrize("first", [200, 203])
def test_a_share_meets_every_kind_of_set_equally_often_and_on_both_tractors(first: int) -> None:
    share, met = Fraction(2, 5), Counter[tuple[int, str]]()
    for seed in range(first, first + 10):
        mine = diagnosis.chosen(seed, share, "")
        assert len(mine) == 32
        met.update((one.number, one.tractor) for one in mine)
        clear = {one.names[0] for one in mine if len(one.names) == 1 and one.size == "clear"}
        assert 7 <= len(clear) <= 9  # of 21 effects
    assert len(met) == 80 * 2 and set(met.values()) == {2}


@pytest.mark.parametrize("text", ["0", "1/2", "6/5", "-1/3", "1/0", "much"])
def test_a_share_that_is_none_is_refused_in_words(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match="give a part of the sets above 0 and up to 1"):
        diagnosis.share_of(text)


def test_a_run_goes_on_where_it_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out, asked = tmp_path / "answers.jsonl", []

    def answer(one: LogSet) -> Record:
        asked.append(one.key)
        return {"key": one.key, "seed": one.seed}

    monkeypatch.setattr(diagnosis, "record_of", answer)
    sets = sets_of(3)[:4]
    diagnosis.run(sets[:2], 1, out, "one")
    out.write_text(out.read_text(encoding="utf-8") + '{"key": "cut o', encoding="utf-8")
    diagnosis.run(sets, 1, out, "one")
    assert asked == [one.key for one in sets]
    assert len(diagnosis.done_in(out, "one")) == 4 and not diagnosis.done_in(out, "two")
    assert all(json.loads(line)["state"] == "one" for line in out.read_text(encoding="utf-8").splitlines()[:2])
