"""What runs that had no part say, and how sure coordinates are."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.measured.benches import eg105, linear_bench
from vehicle.measured.causes.evidence import (
    _reached,
    held_out_losses,
    helps,
    nameable_parts,
    of_few,
    robust_covariance,
)
from vehicle.measured.fit.fitting import Fit, refined


@given(st.integers(0, 10**6))
@settings(max_examples=20)
def test_held_out_losses_are_those_of_fits_without_the_run(seed: int) -> None:
    bench = linear_bench(seed=seed, steering_offset=1.0)
    fit = refined(bench, bench.fit("steering_offset"))
    column = bench.columns["steering_offset"]
    for run, loss in enumerate(held_out_losses(bench, fit)):
        others, mine = bench.runs != run, bench.runs == run
        best = np.linalg.lstsq(column[others, None], -bench.base[others], rcond=None)[0]
        left = bench.base[mine] + column[mine] * best
        assert loss == pytest.approx(float(left @ left), rel=1e-4)


def test_without_coordinates_the_held_out_loss_is_the_loss() -> None:
    bench = linear_bench()
    losses = held_out_losses(bench, bench.fit())
    assert losses == pytest.approx([float(np.sum(bench.base[bench.runs == run] ** 2)) for run in range(4)])


def test_an_effect_of_all_runs_helps_and_none_does_not() -> None:
    bench = linear_bench(steering_offset=1.0)
    assert helps(bench, bench.fit(), refined(bench, bench.fit("steering_offset")), 12.0)
    clean = linear_bench()
    assert not helps(clean, clean.fit(), refined(clean, clean.fit("steering_offset")), 12.0)


def test_an_effect_of_one_run_helps_where_its_blocks_agree() -> None:
    bench = linear_bench()
    alone = np.where(bench.runs == 2, bench.columns["steering_offset"], 0.0)
    shown = replace(bench, base=bench.base - alone, columns=bench.columns | {"steering_offset": alone})
    assert helps(shown, shown.fit(), refined(shown, shown.fit("steering_offset")), 12.0)


def test_the_covariance_is_that_of_least_squares_and_wider_where_blocks_scatter() -> None:
    """With one coordinate: sum of squared block sides over the square of the sum of squares, or its inverse."""
    bench = linear_bench()
    column = np.ones(len(bench.base))
    sides = np.array([3.0, -3.0] * 6)[bench.blocks]
    fit = Fit(bench.fit("steering_offset").parts, sides, column[:, None])
    assert robust_covariance(bench, fit) == pytest.approx(12 * 30.0**2 / 120.0**2)
    calm = replace(fit, surprise=np.zeros(len(column)) + 1e-9)
    assert robust_covariance(bench, calm) == pytest.approx(1.0 / 120.0)


def test_a_scatter_of_few_pieces_is_students() -> None:
    """Quantiles of Student's distribution for 95 % of two and of eleven freedoms: 4.303 and 2.201."""
    for pieces, quantile in ((3, 4.303), (12, 2.201)):
        same = np.ones((pieces, 1, 1))
        wider = of_few(same, np.array([[1.0 / pieces]]))
        assert wider == pytest.approx([quantile / 1.96 * (pieces / (pieces - 1)) ** 0.5], rel=1e-3)
    # A piece that tells next to nothing is no piece.
    unlike = of_few(np.array([1.0, 1.0, 1.0, 1e-6]).reshape(4, 1, 1), np.array([[1.0 / 3.0]]))
    assert unlike == pytest.approx(of_few(np.ones((3, 1, 1)), np.array([[1.0 / 3.0]])), rel=1e-4)


def test_bent_slopes_of_others_do_not_decide_where_an_effect_does_not_reach() -> None:
    """Columns of an effect in one channel: what another coordinate does in the others is no harm of it."""
    bench = linear_bench(steering_offset=1.0)
    channel = np.arange(len(bench.base)) >= 4 * bench.course.rows
    mine = np.where(channel, bench.columns["steering_offset"], 0.0)
    shown = replace(bench, columns=bench.columns | {"steering_offset": mine})
    smaller = shown.fit("heading_bias", at=0.0)
    larger = refined(shown, shown.fit("heading_bias", "steering_offset"))
    bent = replace(larger, slope=larger.slope * np.where(channel[:, None], 1.0, [[0.0, 1.0]]))
    spoilt = replace(bent, surprise=np.where(channel, bent.surprise, 3.0 * bent.surprise))
    assert helps(shown, smaller, spoilt, 12.0)


def test_what_is_empty_where_an_effect_does_not_reach_is_not_copied() -> None:
    bench = linear_bench(steering_offset=1.0)
    channel = np.arange(len(bench.base)) >= 4 * bench.course.rows
    mine = np.where(channel, bench.columns["steering_offset"], 0.0)
    shown = replace(bench, columns=bench.columns | {"steering_offset": mine})
    smaller, larger = shown.fit(), shown.fit("steering_offset", at=0.5)
    for one in _reached(shown, smaller, larger):
        assert np.array_equal(one.surprise, np.where(channel, shown.base if one.parts == () else larger.surprise, 0.0))
    empty = replace(larger, surprise=np.where(channel, larger.surprise, 0.0))
    assert _reached(shown, smaller, empty)[1] is empty


def test_a_name_takes_more_than_the_tolerance_and_clearly_more_than_nothing() -> None:
    """The tolerance of the offset is 0.12 degrees; the coordinate is sure to about 0.03 of them."""
    for value, nameable in ((1.0, True), (0.11, False), (0.2, True)):
        bench = linear_bench(seed=3, steering_offset=value)
        named = nameable_parts(bench, bench.fit("steering_offset", at=value), eg105())
        assert named == (["steering_offset"] if nameable else [])
    bench = linear_bench(seed=3)
    vague = {name: 0.05 * column for name, column in bench.columns.items()}
    blurred = replace(bench, columns=vague)
    assert not nameable_parts(blurred, blurred.fit("steering_offset", at=0.2), eg105())
