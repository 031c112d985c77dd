"""What differs from tractor to tractor is free in every fit, as far as tractors differ in it."""

import numpy as np
import pytest

from tests.measured.benches import bench_of, knobs
from vehicle.measured.causes.refit import restarted
from vehicle.measured.causes.unknowns import unknowns
from vehicle.measured.fit.fitting import empty_fit
from vehicle.measured.surprise.bench import Bench


@pytest.fixture(scope="module")
def bench() -> Bench:
    return bench_of("circles", {})


def test_an_amount_of_one_surprises_the_first_rows_by_one(bench: Bench) -> None:
    columns = unknowns(bench, empty_fit(bench))
    ends = np.cumsum([3 * one.rows for one in bench.course.stretches])
    starts = [int(end) - 3 * one.rows for end, one in zip(ends, bench.course.stretches, strict=True)]
    firsts = np.concatenate([np.arange(start, start + 3) for start in starts])
    assert (columns[firsts] ** 2).sum(axis=0) == pytest.approx([1.0, 1.0, 1.0])
    assert bench.surprise({})[firsts] == pytest.approx(np.zeros(len(firsts)))
    assert not columns[3 * bench.course.rows :].any()  # wheel angle and speed are no part of it


def test_a_turn_that_comes_earlier_is_a_wheel_angle_ahead_of_its_time(bench: Bench) -> None:
    """The second column is the derivative of the turn: nothing while the tractor circles evenly."""
    column = unknowns(bench, empty_fit(bench))[: 3 * bench.course.rows, 1].copy()
    column[:3] = 0.0
    first = bench.course.stretches[0]
    size = np.abs(column[: 3 * first.rows]).reshape(-1, 3).sum(axis=1)
    steady = np.abs(np.gradient(np.gradient(first.heading, first.time), first.time)) < 1e-3
    assert size[~steady].max() > 5.0 * np.median(size[steady])


def test_a_fit_without_effects_has_them_and_an_effect_is_told_beside_them() -> None:
    hidden = bench_of("circles", {"steering_offset": {"angle_deg": 1.0}})
    plain = restarted(hidden, (), None)
    assert plain.extra is not None and plain.extra.unknowns == plain.extra.columns.shape[1] == 3
    assert np.all(np.abs(plain.extra.amounts) < 3.0)
    fit = restarted(hidden, ((knobs("steering_offset"), np.zeros(1)),), None)
    assert fit.settings["steering_offset"]["angle_deg"] == pytest.approx(1.0, abs=0.02)
    assert fit.extra is not None and np.all(np.abs(fit.extra.amounts) < 0.2)
