"""Benches: the vector of surprises, its places, its weights, and the floor of noise."""

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.measured.drawn import QUIET, circle, course, course_of, measured, rig
from vehicle.effects import PATH, POSITION, SPEED, STEERING
from vehicle.measured.replay.keeping import Kept
from vehicle.measured.replay.windows import WINDOW_S
from vehicle.measured.surprise.bench import BLOCK_S, Bench, prepare
from vehicle.measured.surprise.floor import floor_squares
from vehicle.measured.surprise.weights import OUTLIER, Channel, channels, filters, huber, noise_row
from vehicle.measured.surprise.whitening import Noise

NOISE = Noise(0.01, 0.0, 0.002, 0.0, 0.0015, 0.01)
PIECES = ((10.0, 8.0, 1.0, 0.0), (10.0, -8.0, 1.0, 1.0), (15.0, 0.0, 1.0, 0.0))
OFFSET, SLIP = {"steering_offset": {"angle_deg": 1.0}}, {"wheel_slip": {"ratio": 0.1}}
LATE = {"steering_dead_time": {"time_s": 0.3}}


@pytest.fixture(scope="module")
def bench() -> Bench:
    runs = course_of(*(measured(PIECES, NOISE, seed=run, run=run) for run in range(2)))
    return prepare(runs, rig(), {})


def test_small_values_are_kept_and_large_ones_count_by_their_size() -> None:
    """Squares are Huber's loss: 2 k |x| - k^2 beyond k = 4; at 6 that is 32."""
    assert OUTLIER == 4.0
    assert huber(np.array([-3.0, 0.5, 4.0])) == pytest.approx([-3.0, 0.5, 4.0])
    assert huber(np.array([6.0, -6.0])) == pytest.approx([math.sqrt(32.0), -math.sqrt(32.0)])


def test_the_vector_is_path_wheel_and_speed(bench: Bench) -> None:
    rows, whole = bench.course.rows, bench.surprise({})
    assert len(whole) == 5 * rows
    assert np.array_equal(whole[: 3 * rows], bench.path_surprise(bench.path({}), {}))
    chain = bench.chain_surprise({})
    assert np.array_equal(whole[3 * rows : 4 * rows], chain["wheel"])
    assert np.array_equal(whole[4 * rows :], chain["speed"])
    # The filter takes the first position as it is.
    first = bench.course.stretches[0].rows
    assert (whole[[0, 1, 2, 3 * first, 3 * first + 1, 3 * first + 2]] == 0.0).all()


def test_every_entry_knows_its_run_and_its_block(bench: Bench) -> None:
    one, two = (stretch.rows for stretch in bench.course.stretches)
    assert bench.runs.tolist() == [0] * 3 * one + [1] * 3 * two + 2 * ([0] * one + [1] * two)
    # 34.9 s are three blocks of ten; what is left over is under half a block and joins the last.
    assert BLOCK_S == 10.0 and bench.blocks.max() == 5 and bench.block_runs.tolist() == [0, 0, 0, 1, 1, 1]
    assert np.bincount(bench.blocks[-(one + two) :]).tolist() == [100, 100, 150, 100, 100, 150]
    assert WINDOW_S == 20.0 and bench.block_halves.tolist() == [0, 0, 1, 0, 0, 1]
    assert bench.row_s == pytest.approx(0.1) and bench.has_wheel


def test_only_channels_that_an_effect_reaches_are_made_anew(bench: Bench) -> None:
    rows, base = bench.course.rows, np.full(5 * bench.course.rows, 7.0)
    path = bench.change(OFFSET, base, frozenset({PATH}))
    assert (path[3 * rows :] == 7.0).all() and np.array_equal(path[: 3 * rows], bench.surprise(OFFSET)[: 3 * rows])
    wheel, whole = bench.change(LATE, base, frozenset({STEERING})), bench.surprise(LATE)
    assert np.array_equal(wheel[3 * rows : 4 * rows], whole[3 * rows : 4 * rows]) and whole[3 * rows : 4 * rows].any()
    assert (wheel[: 3 * rows] == 7.0).all() and (wheel[4 * rows :] == 7.0).all()
    speed = bench.change(SLIP, base, frozenset({SPEED}))
    assert (speed[: 4 * rows] == 7.0).all() and np.array_equal(speed[4 * rows :], bench.surprise(SLIP)[4 * rows :])


def test_many_settings_side_by_side_change_what_each_alone_changes(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Bit for bit, in their order, with none of it kept, however many are driven at a time."""
    base = np.full(5 * bench.course.rows, 7.0)
    asked = [
        (OFFSET, frozenset({PATH})), (LATE, frozenset({STEERING})), (SLIP, frozenset({PATH, SPEED})), ({}, frozenset()),
        ({"gnss_latency": {"time_s": 0.2}}, frozenset({POSITION})), (OFFSET, frozenset({PATH})),
        ({**OFFSET, **SLIP}, frozenset({PATH})),
    ]  # fmt: skip
    alone = [fresh(bench).change(settings, base, blocks) for settings, blocks in asked]
    for most in (1, 10_000, 500_000):
        monkeypatch.setattr("vehicle.measured.surprise.bench.MOST_STEPS", most)
        for one, other in zip(fresh(bench).changes(asked, base), alone, strict=True):
            assert np.array_equal(one, other)
    assert not np.array_equal(alone[0], alone[4])


def fresh(bench: Bench) -> Bench:
    """The bench with nothing replayed."""
    return replace(bench, rig=replace(bench.rig, kept=Kept()))


def test_effects_can_be_fixed_under_those_that_are_asked_for(bench: Bench) -> None:
    fixed, both = bench.on_top_of(SLIP), {**SLIP, **OFFSET}
    assert np.array_equal(fixed.surprise(OFFSET), bench.surprise(both))
    base, blocks = bench.surprise({}), frozenset({PATH})
    assert np.array_equal(fixed.change(OFFSET, base, blocks), bench.change(both, base, blocks))
    assert np.array_equal(fixed.on_top_of(OFFSET).surprise({}), bench.surprise(both)) and bench.fixed == {}


def test_what_a_log_lacks_leaves_its_channel_out() -> None:
    bench = prepare(course(circle(0.05, 30.0)), rig(), {})
    assert bench.wheel == (None,) and bench.speed == (None,), "neither command was logged"
    assert (bench.surprise({})[3 * bench.course.rows :] == 0.0).all()
    assert noise_row(NOISE, True).tolist() == [0.01, 0.0, 0.002, 0.0, 0.0015, 0.01]
    assert noise_row(NOISE, False)[2] > 100.0, "a heading that was not measured says nothing"


def test_a_channel_is_as_wide_as_its_noise() -> None:
    """White noise of half a degree on the wheel: its weight while nothing changes is half a degree, without memory."""
    rng = np.random.default_rng(8)
    one = measured(((120.0, 4.0, 1.0, 0.0),))
    assert one.wheel is not None
    one = replace(one, wheel=one.wheel + math.radians(0.5) * rng.standard_normal(one.rows))
    ((wheel,), (speed,)) = channels(course_of(one), rig(), {})
    assert wheel is not None and speed is not None
    late = slice(600, None)
    assert wheel.scatter[late] == pytest.approx(np.full(one.rows - 600, math.radians(0.5)), rel=0.1)
    assert wheel.sigma[late] == pytest.approx(wheel.scatter[late], rel=0.15) and wheel.memory < 0.1


def test_noise_alone_leaves_what_a_rigid_fit_cannot_take() -> None:
    """White positions of size s over n rows: (2 n - 3) s^2 of 2 n s^2 are left, the fit has taken three numbers.

    Headings weigh in by a tenth, so the turn is theirs as well.
    """
    noise = replace(QUIET, position=0.01, heading=1e-6)
    runs = course_of(*(measured(((100.0, 0.0, 1.0, 0.0),), noise, seed=run, run=run) for run in range(4)))
    quiet = Bench(runs, rig(), noise, filters(runs, rig(), NOISE, {}), (None,) * 4, (None,) * 4)
    floor = np.sum([one[5.0] for one in floor_squares(quiet, {run: {} for run in range(4)})], axis=0)
    rows = 50
    assert (floor[0] + floor[1]) / floor[3] == pytest.approx(0.01**2 * (2 * rows - 3) / rows, rel=0.07)


def test_without_noise_the_floor_is_nothing() -> None:
    runs = course_of(measured(PIECES))
    still = Channel(np.ones(runs.rows), 0.5, np.zeros(runs.rows))
    quiet = Bench(runs, rig(), QUIET, filters(runs, rig(), NOISE, {}), (still,), (still,))
    for horizon in (1.0, 5.0):  # what is left comes of wheel angles read at ten rows a second
        sums = floor_squares(quiet, {0: {}})[0][horizon]
        assert np.sqrt(sums[:3] / sums[3]).max() < 1e-3


def test_surprises_of_a_true_model_are_of_size_one_and_a_wrong_one_adds_to_them(bench: Bench) -> None:
    rows = 3 * bench.course.rows
    true, wrong = (bench.surprise(settings)[:rows] for settings in ({}, OFFSET))
    assert true.std() == pytest.approx(1.0, abs=0.15)
    assert float(wrong @ wrong) > float(true @ true) + 100.0
