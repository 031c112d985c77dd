"""A tractor as a file: what is read back is what was written."""

import math
import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.identification.log_tables import runs
from vehicle.identification.diagnosis.saving import compute_rise_sigmas, is_extension_helpful, measure_holdout
from vehicle.identification.logs.reader import build_log
from vehicle.identification.replay.horizon_errors import Pieces, compute_horizon_errors
from vehicle.model.tractor import DiscrepancyModel, EffectSetting, Tractor, load_tractor
from vehicle.model.tractor_writer import _format_value, format_tractor_toml

NAMES = st.text(st.characters(exclude_categories=["Cs"]), max_size=20)


@given(st.floats(-8.0, 8.0), NAMES, st.booleans(), st.floats(0.02, 1e6) | st.just(math.inf))
def test_a_tractor_with_effects_and_a_rest_survives_its_file(angle: float, log: str, named: bool, limit: float) -> None:
    effects = {
        "steering_offset": EffectSetting(
            value={"angle_deg": angle}, interval={"angle_deg": (angle - 1.0, angle + 1e-9)}, named=named,
            equivalent_to=("implement_side_draft",), ground="soil", logs=(log, "b"),
        ),
        "side_slip": EffectSetting(value={"limit_g": limit}),
    }  # fmt: skip
    rest = DiscrepancyModel(amounts={"push_to_east": 0.01}, speed_mps=(0.5, 2.0), angle_deg=(-10.0, 10.0), logs=(log,))
    before = load_tractor("eg105").model_copy(update={"effects": effects, "discrepancy_model": rest})
    assert Tractor(**tomllib.loads(format_tractor_toml(before))) == before


@pytest.mark.parametrize("name", ["eg105", "mr1000a"])
def test_every_shipped_tractor_survives_its_file(name: str, tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(format_tractor_toml(load_tractor(name)), encoding="utf-8")
    assert load_tractor(path) == load_tractor(name)


def test_values_as_toml_has_them() -> None:
    texts = {"true": True, "1.0": 1.0, "0.1": 0.1, "inf": math.inf, "-inf": -math.inf}
    assert {_format_value(one): one for one in texts.values()} == texts
    assert (
        _format_value((1.5, ("a",))) == '[1.5, ["a"]]'
        and _format_value({"a b": 1.0, "c": 2.0}) == '{"a b" = 1.0, c = 2.0}'
    )
    said = 'say "hi"\t\\'
    assert tomllib.loads(f"said = {_format_value(said)}") == {"said": said}


# --- What an extension is worth on runs held out ---


def test_the_right_extension_helps_and_a_wrong_one_does_not() -> None:
    """Bends of a tractor without faults, replayed as the file has it and with wheels that steer too much."""
    logs = [build_log(frame, name) for name, frame in runs().items() if not name.startswith("straight")][:2]
    tractor = load_tractor("eg105")
    wrong = tractor.model_copy(update={"effects": {"steering_gain": EffectSetting(value={"ratio": 1.3})}})
    harm, help_, none = (
        measure_holdout(logs, first, second, "soil")
        for first, second in ((tractor, wrong), (wrong, tractor), (tractor, tractor))
    )
    assert not harm.helps and not harm.is_unchanged and harm.after[5.0].cross_cm > harm.before[5.0].cross_cm
    assert help_.helps and help_.after == harm.before and [run.name for run in help_.by_run] == list(help_.runs)
    assert none.is_unchanged and not none.helps


def make_pieces(across_cm: list[float], along_cm: float = 1.0) -> Pieces:
    """Pieces of 10 rows of one run over 5 s, with errors of the same size over 20 s."""
    squares = [(10.0 * (0.01 * one) ** 2, 10.0 * (0.01 * along_cm) ** 2) for one in across_cm]
    rows = np.array([[0.0, 2.5, *distance, 10.0 * np.radians(1.0) ** 2, 10.0] for distance in squares])
    return {5.0: rows, 20.0: rows}


def test_an_error_has_risen_where_most_pieces_say_so() -> None:
    old, flat = make_pieces([2.0, 2.0, 2.0, 2.0], 3.0), [1.9, 2.1, 2.0, 2.0]
    assert compute_horizon_errors(old)[5.0].cross_cm == pytest.approx(2.0) and not compute_horizon_errors(old, 1)
    assert is_extension_helpful(old, make_pieces(flat, 1.0), True), "along"
    assert not is_extension_helpful(old, make_pieces(flat, 1.0), False), "along is not judged"
    one_piece, all_pieces = [1.5, 1.5, 1.5, 3.4], [2.3, 2.4, 2.3, 2.4]
    assert is_extension_helpful(old, make_pieces(one_piece, 1.0), True), "one piece of four is scatter"
    assert not is_extension_helpful(old, make_pieces(all_pieces, 1.0), False), "across rises everywhere"
    assert is_extension_helpful(old, make_pieces(all_pieces, 1.0), True), "the distance falls"
    assert not is_extension_helpful(old, make_pieces([2.0, 2.0, 2.0, 9.0], 2.5), True), "more rises than falls"
    assert not is_extension_helpful(old, old, True)


def test_the_rise_of_pieces_in_standard_errors_is_that_of_a_paired_t_test() -> None:
    from scipy import stats

    rng = np.random.default_rng(4)
    old, new = (np.column_stack([np.zeros(30), rng.chisquare(3, (30, 3)), np.full(30, 5.0)]) for _ in range(2))
    expected = stats.ttest_rel(new[:, 1:4], old[:, 1:4]).statistic
    np.testing.assert_allclose(compute_rise_sigmas(old[:, 1:4], new[:, 1:4]), expected)
    assert np.isinf(compute_rise_sigmas(old[:1, 1:4], new[:1, 1:4])).all()
