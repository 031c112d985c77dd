"""The sets of a seed are what they are said to be, and a run goes on where it stopped."""

from collections import Counter
from fractions import Fraction
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from tests.diagnosis import log_sets
from tests.diagnosis.drawn_sets import BLOCKS, EITHER_WAY, make_drawn_case
from tests.diagnosis.log_sets import REFERENCES, LogSet, list_sets, load_set_tractor, make_frames, make_unseen_frames
from tests.diagnosis.rerecording import VARIATIONS, Record, list_flips, list_losses, vary_logs
from tests.diagnosis.test_tally import EFFECT, RIGHT, WRONG, build, say
from tests.truth.cases import TruthCase
from tests.truth.effects import CLEAR_SIZES, NEUTRAL, PLACES


@pytest.mark.parametrize("reference", REFERENCES)
def test_sets_have_keys_of_their_own_and_are_drawn_by_the_seed(reference: str) -> None:
    sets = list_sets(reference, 5)
    assert sets == list_sets(reference, 5) and len({one.key for one in sets}) == len(sets)
    assert {one.column for one in sets} == {reference}
    assert reference == "real" or not {one.key for one in sets} & {one.key for one in list_sets(reference, 6)}


@pytest.mark.parametrize("seed", [4, 5])
def test_a_seed_has_every_effect_every_two_blocks_and_every_three(seed: int) -> None:
    sets = list_sets("second", seed)
    assert len(sets) == 3 * len(CLEAR_SIZES) + 10 + 4 + 3
    assert {name for block in BLOCKS.values() for name in block} == set(CLEAR_SIZES)
    of = {name: block for block, names in BLOCKS.items() for name in names}
    blocks = {tuple(sorted(of[name] for name in one.case.effects)) for one in sets}
    assert Counter(map(len, blocks)) == {0: 1, 1: 4, 2: 10, 3: 4}
    # What one seed shows on one tractor, the next shows on the other.
    mine, others = ([one.tractor for one in list_sets("second", number)] for number in (seed, seed + 1))
    assert all(one != other for one, other in zip(mine, others, strict=True))


def test_sizes_and_signs_are_drawn_about_the_clear_size() -> None:
    for name, clear in CLEAR_SIZES.items():
        key, signs = next(key for key in clear if key not in PLACES), set()
        for seed in range(40):
            value = make_drawn_case(((name,), "half"), seed, "half").effects[name][key]
            share = (value - NEUTRAL[name][key]) / (clear[key] - NEUTRAL[name][key])
            share = clear[key] / value if name == "side_slip" else share
            assert 0.5 - 1e-9 <= abs(share) <= 0.5 * 1.25 + 1e-9
            signs.add(share > 0.0)
        assert signs == ({True, False} if name in EITHER_WAY else {True})


@pytest.mark.parametrize("first", [200, 203])
def test_a_share_meets_every_kind_of_set_equally_often_and_on_both_tractors(first: int) -> None:
    met = Counter[tuple[str, str]]()
    for seed in range(first, first + 10):
        mine = list_sets("second", seed, Fraction(2, 5))
        assert len(mine) == 32
        met.update(
            (one.label + "+".join(one.case.effects if len(one.case.effects) == 1 else ()), one.tractor) for one in mine
        )
    assert len(met) == 80 * 2 and set(met.values()) == {2}


def test_a_folder_without_logs_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=f"There is no log in {tmp_path}"):
        make_frames(LogSet("real", TruthCase("mixed", 0), str(tmp_path)))


def test_a_lawn_tractor_has_a_file_of_its_own() -> None:
    lawn = next(one for seed in range(9) for one in list_sets("fourth", seed) if one.case.programme == "lawn")
    assert load_set_tractor(lawn).wheelbase_m == pytest.approx(1.2)
    assert load_set_tractor(list_sets("first", 1)[0]).wheelbase_m == pytest.approx(2.4)


@pytest.mark.slow
@pytest.mark.parametrize("reference", ["first", "demo", "real"])
def test_unseen_runs_are_other_runs_of_the_same_truth(reference: str) -> None:
    one = list_sets(reference, 71)[0]
    for frame, other in zip(make_frames(one), make_unseen_frames(one), strict=False):
        assert frame.attrs["name"] == other.attrs["name"] and frame.easting_m[0] != other.easting_m[0]


def vary(*said: Record) -> tuple[list[str], list[str]]:
    """Flips and losses against an offset that was named."""
    base = build(EFFECT, RIGHT)
    varied = {"named": [one["id"] for one in said if one["status"] == "named"], "said": list(said)}
    return list_flips(base, varied), list_losses(base, varied)


def test_names_that_flip() -> None:
    assert vary(say("steering_offset", "named", 1.0, 1.2)) == ([], [])  # each value is near enough by one interval
    assert vary(say("steering_offset", "likely")) == ([], ["steering_offset likely"])
    assert vary() == ([], ["steering_offset not said"])
    moved = ["steering_offset 1 [0.9, 1.1] -> 1.18 [1.05, 1.3]"]
    assert vary(say("steering_offset", "named", 1.05, 1.3)) == (moved, [])
    assert vary(WRONG)[0] == ["wheel_slip 1 [0.9, 1.1] was not said"]
    assert vary(say("steering_offset", "refuted")) == (["steering_offset refuted"], [])
    broken = {"error": "LogError: no rows", "named": [], "said": []}
    assert list_flips(build(EFFECT, RIGHT), broken) == ["LogError: no rows"]


def make_frame(rows: int = 101) -> pd.DataFrame:
    time_s = 50.0 + 0.1 * np.arange(rows)
    frame = pd.DataFrame({"time_s": time_s, "steering_deg": np.sin(time_s), "speed_mps": np.cos(time_s)})
    frame.attrs["name"] = "run"
    return frame


@pytest.mark.parametrize("how", VARIATIONS)
def test_a_varied_log_is_the_same_drive(how: str) -> None:
    (out,) = vary_logs([make_frame()], how)
    steps = np.diff(out["time_s"])
    assert out.attrs["name"] == "run" and (steps > 0.0).all()
    if how.endswith("Hz"):
        assert np.median(steps) == pytest.approx(1.0 / float(how.split()[0]))
        assert np.allclose(out["steering_deg"], np.sin(out["time_s"]))
    elif how == "jitter":
        assert 0.02 < np.std(steps - 0.1) < 0.08
        assert np.array_equal(out["steering_deg"], make_frame()["steering_deg"])
    else:
        assert np.array_equal(out["speed_mps"], make_frame()["speed_mps"])
        same = np.mean(np.diff(out["steering_deg"]) == 0.0)
        assert 0.9 < same < 0.96 if how == "held" else same < 0.05
        if how == "held":
            refreshed = np.flatnonzero(np.diff(out["steering_deg"]) != 0.0) + 1
            assert np.diff(out["time_s"].to_numpy()[refreshed]).min() > 0.99 and 5 <= len(refreshed) <= 9
            assert np.array_equal(out["steering_deg"][refreshed], make_frame()["steering_deg"][refreshed])
        assert np.abs(out["steering_deg"] - np.sin(out["time_s"])).max() < (2.0 if how == "held" else 0.5)


def test_what_is_unknown_is_refused() -> None:
    with pytest.raises(ValueError, match="use one of: 10 Hz"):
        vary_logs([make_frame()], "3 Hz")
    with pytest.raises(ValueError, match="use one of: first"):
        log_sets.list_sets("seventh", 1)
