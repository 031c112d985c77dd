"""Fits to surprises against least squares, and one against an effect that the simulator itself drove."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.measured.benches import bench_of, knobs, linear_bench
from vehicle.measured.fit.fitting import Extra, Fit, block_sums, empty_fit, flat, linear_extra, refined, slopes


@given(st.integers(0, 10**6))
@settings(max_examples=20)
def test_a_linear_bench_is_fitted_by_least_squares(seed: int) -> None:
    bench = linear_bench(seed=seed, steering_offset=1.2, heading_bias=-2.0)
    fit = refined(bench, bench.fit("steering_offset", "heading_bias"))
    columns = np.stack([bench.columns["steering_offset"], bench.columns["heading_bias"]], axis=1)
    exact, (loss,), *_ = np.linalg.lstsq(columns, -bench.base, rcond=None)
    assert flat([at for _, at in fit.parts]) == pytest.approx(exact, abs=1e-4)
    assert fit.loss == pytest.approx(loss, rel=1e-6)
    assert fit.slope == pytest.approx(columns, abs=1e-8)


def test_only_the_block_of_the_moved_effect_is_simulated_for_a_slope() -> None:
    bench = linear_bench()
    slopes(bench, bench.fit("steering_offset", "heading_bias"))
    assert bench.asked == [frozenset({"wheel to path"}), frozenset({"position to antenna"})]


def test_linear_terms_without_a_name_are_fitted_along() -> None:
    bench = linear_bench(steering_offset=1.0)
    column = np.random.default_rng(5).standard_normal(len(bench.base))
    hidden = replace(bench, base=bench.base - 0.7 * column)
    start = replace(hidden.fit("steering_offset"), extra=Extra(column[:, None], np.zeros(1)))
    fit = refined(hidden, start)
    both = np.stack([bench.columns["steering_offset"], column], axis=1)
    exact = np.linalg.lstsq(both, -hidden.base, rcond=None)[0]
    assert fit.extra is not None
    assert [float(fit.parts[0][1][0]), float(fit.extra.amounts[0])] == pytest.approx(exact, abs=1e-4)
    assert fit.slope == pytest.approx(both, abs=1e-8)
    bare = hidden.surprise(fit.settings)
    assert fit.surprise == pytest.approx(linear_extra(bare, fit.extra), abs=1e-9)
    assert linear_extra(bare, None) is bare


def test_a_fit_of_nothing_is_left_as_it_is() -> None:
    bench = linear_bench()
    fit = empty_fit(bench)
    assert refined(bench, fit) is fit and fit.slope.shape == (len(bench.base), 0)
    assert fit.loss == pytest.approx(float(np.sum(bench.base**2)))


def test_columns_belong_to_their_effects() -> None:
    parts = tuple((knobs(name), np.zeros(knobs(name).count)) for name in ("steering_offset", "cross_slope_drift"))
    fit = Fit(parts, np.zeros(3), np.zeros((3, 3)))
    assert fit.columns("steering_offset") == slice(0, 1) and fit.columns("cross_slope_drift") == slice(1, 3)
    with pytest.raises(KeyError):
        fit.columns("wheel_slip")


def test_sums_over_blocks_add_up_to_the_whole() -> None:
    bench = linear_bench()
    fit = bench.fit("steering_offset", "heading_bias")
    sums = block_sums(bench, fit.slope, fit.surprise)
    assert sums.squares.sum(axis=0) == pytest.approx(fit.slope.T @ fit.slope)
    assert sums.sides.sum(axis=0) == pytest.approx(fit.slope.T @ fit.surprise)
    assert sums.losses.sum() == pytest.approx(fit.loss)
    assert sums.losses[0] == pytest.approx(float(np.sum(bench.base[:10] ** 2)))


def test_what_the_simulator_drove_is_fitted_to_its_value() -> None:
    bench = bench_of("circles", {"steering_offset": {"angle_deg": 1.0}, "heading_bias": {"angle_deg": -1.5}})
    start = Fit(tuple((knobs(name), np.zeros(1)) for name in ("steering_offset", "heading_bias")), bench.surprise({}),
                np.zeros((5 * bench.course.rows, 0)))  # fmt: skip
    fit = refined(bench, start)
    assert flat([at for _, at in fit.parts]) == pytest.approx([1.0, -1.5], abs=0.01)
    assert fit.loss < 0.05 * start.loss


def test_vectors_one_after_another() -> None:
    assert flat([(1.0, 2.0), np.array([3.0])]).tolist() == [1.0, 2.0, 3.0] and flat([]).shape == (0,)
