"""What an extension is worth on runs held out."""

import numpy as np
import pytest

from tests.identification.log_tables import runs
from vehicle.identification.diagnosis.saving import compute_rise_sigmas, is_extension_helpful, measure_holdout
from vehicle.identification.logs.reader import build_log
from vehicle.identification.replay.horizon_errors import Pieces, compute_horizon_errors
from vehicle.model.tractor import EffectSetting, load_tractor


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
