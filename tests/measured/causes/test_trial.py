"""One more effect on top of a fit, and how far above chance it stands."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.measured.benches import knobs, linear_bench
from vehicle.measured.causes.trial import Projector, Tried, strengths, tried
from vehicle.measured.thresholds import FAR_LESS, HOPELESS


def left_by(columns: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """What a least-squares fit leaves of a vector."""
    return vector - columns @ np.linalg.lstsq(columns, vector, rcond=None)[0]


@given(st.integers(0, 10**6))
def test_a_projector_leaves_what_least_squares_leaves(seed: int) -> None:
    rng = np.random.default_rng(seed)
    columns, vector = rng.standard_normal((20, 3)) * [1.0, 1e-3, 1e3], rng.standard_normal(20)
    project = Projector(columns)
    assert project(vector) == pytest.approx(left_by(columns, vector), abs=1e-9)
    assert project(project(vector)) == pytest.approx(project(vector), abs=1e-9)
    assert Projector(columns[:, [0, 0]])(vector) == pytest.approx(left_by(columns[:, :1], vector), abs=1e-6)
    assert Projector(np.zeros((20, 0)))(vector) is vector


@given(st.integers(0, 10**6))
def test_an_effect_takes_away_what_least_squares_takes_beyond_the_fit(seed: int) -> None:
    bench = linear_bench(seed=seed, steering_offset=1.0, heading_bias=-2.0)
    fit = bench.fit("heading_bias")
    project = Projector(fit.slope)
    one = tried(bench.changes, fit, knobs("steering_offset"), project)
    both = np.stack([bench.columns["heading_bias"], bench.columns["steering_offset"]], axis=1)
    alone, together = left_by(both[:, :1], fit.surprise), left_by(both, fit.surprise)
    assert one.gain == pytest.approx(float(alone @ alone - together @ together), rel=1e-6)
    assert one.at == pytest.approx(np.linalg.lstsq(both, -bench.base, rcond=None)[0][1:], abs=1e-4)
    assert np.abs(bench.columns["heading_bias"] @ one.columns).max() < 1e-6


def test_what_promises_nothing_is_simulated_once() -> None:
    bench = linear_bench()
    fit = bench.fit()
    bench.asked.clear()
    one = tried(bench.changes, fit, knobs("steering_offset"), Projector(fit.slope))
    assert bench.asked == [frozenset({"wheel to path"})] and one.gain == 0.0 and one.at.tolist() == [0.0]


def test_what_promises_far_less_than_others_is_only_begun() -> None:
    bench = linear_bench(steering_offset=5.0)
    fit = bench.fit()
    whole, begun, near = (
        tried(bench.changes, fit, knobs("steering_offset"), Projector(fit.slope), worth) for worth in (0.0, 1e6, 1.0)
    )
    assert whole.ended and near.ended and near.gain == whole.gain > HOPELESS
    assert not begun.ended and begun.gain == 0.0 and begun.at.tolist() == [0.0]
    less = tried(bench.changes, fit, knobs("steering_offset"), Projector(fit.slope), 0.9 * whole.gain / FAR_LESS)
    assert less.ended and less.gain == whole.gain
    nothing = linear_bench()
    hopeless = tried(nothing.changes, nothing.fit(), knobs("steering_offset"), Projector(nothing.fit().slope), 1e6)
    assert hopeless.ended, "what is hopeless by itself would come to no more"


def test_strength_is_the_gain_where_blocks_scatter_as_noise_does() -> None:
    """Every block leaves as much as noise or less: the scatter is that of the noise, and the strength the gain."""
    bench = linear_bench(steering_offset=5.0)
    column = bench.columns["steering_offset"][:, None]
    left = np.zeros(len(bench.base))
    (strength,), chance = strengths(bench, [Tried(knobs("steering_offset"), np.array([5.0]), 80.0, column)], left)
    assert strength == pytest.approx(80.0) and chance == 0.0


def test_blocks_that_disagree_take_strength_away_and_chance_is_theirs() -> None:
    """One column, one number a block: the scatter is the sum of their squares."""
    bench = linear_bench()
    column = np.ones(len(bench.base))
    sides = np.array([3.0, -3.0] * 6)
    left = sides[bench.blocks]
    one = Tried(knobs("steering_offset"), np.array([1.0]), 50.0, column[:, None])
    (strength,), chance = strengths(bench, [one], left)
    square, scatter = 120.0, float(np.sum((10.0 * sides) ** 2))
    assert strength == pytest.approx(50.0 * square / scatter)
    assert 0.0 < chance <= 12.0  # twelve blocks of the same sign are the most that signs can do
    assert strengths(bench, [Tried(one.knobs, one.at, 50.0, np.zeros((120, 1)))], left) == ([0.0], 0.0)
