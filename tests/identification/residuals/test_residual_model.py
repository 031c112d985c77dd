"""Benches: the vector of residuals, its places, its weights, and the floor of noise."""

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.identification.analytic_drives import QUIET, circle, course, course_of, measured, rig
from vehicle.identification.replay.drive_segments import WINDOW_S
from vehicle.identification.replay.rig import replay_segment
from vehicle.identification.replay.state_cache import STEERING_COLUMN, ReplayCache
from vehicle.identification.residuals.innovations import NoiseLevels
from vehicle.identification.residuals.noise_floor import compute_noise_floor
from vehicle.identification.residuals.noise_weights import (
    OUTLIER_SIGMAS,
    ResidualChannel,
    apply_huber,
    build_channels,
    build_filters,
    convert_noise_to_array,
)
from vehicle.identification.residuals.residual_model import RESIDUAL_BLOCK_S, ResidualModel, build_residual_model
from vehicle.model.effects import PATH, POSITION, SPEED, STEERING

NOISE = NoiseLevels(0.01, 0.0, 0.002, 0.0, 0.0015, 0.01)
PIECES = ((10.0, 8.0, 1.0, 0.0), (10.0, -8.0, 1.0, 1.0), (15.0, 0.0, 1.0, 0.0))
OFFSET, SLIP = {"steering_offset": {"angle_deg": 1.0}}, {"wheel_slip": {"ratio": 0.1}}
LATE = {"steering_dead_time": {"time_s": 0.3}}


@pytest.fixture(scope="module")
def residual_model() -> ResidualModel:
    runs = course_of(*(measured(PIECES, NOISE, seed=run, run=run) for run in range(2)))
    return build_residual_model(runs, rig(), {})


def test_small_values_are_kept_and_large_ones_count_by_their_size() -> None:
    """Squares are Huber's loss: 2 k |x| - k^2 beyond k = 4; at 6 that is 32."""
    assert OUTLIER_SIGMAS == 4.0
    assert apply_huber(np.array([-3.0, 0.5, 4.0])) == pytest.approx([-3.0, 0.5, 4.0])
    assert apply_huber(np.array([6.0, -6.0])) == pytest.approx([math.sqrt(32.0), -math.sqrt(32.0)])


def test_the_vector_is_path_wheel_and_speed(residual_model: ResidualModel) -> None:
    rows, whole = residual_model.dataset.rows, residual_model.compute_residuals({})
    assert len(whole) == 5 * rows
    assert np.array_equal(
        whole[: 3 * rows], residual_model.compute_path_residuals(residual_model.simulate_increments({}), {})
    )
    chain = residual_model.compute_wheel_and_speed_residuals({})
    assert np.array_equal(whole[3 * rows : 4 * rows], chain["wheel"])
    assert np.array_equal(whole[4 * rows :], chain["speed"])
    # The filter takes the first position as it is.
    first = residual_model.dataset.segments[0].rows
    assert (whole[[0, 1, 2, 3 * first, 3 * first + 1, 3 * first + 2]] == 0.0).all()


def test_every_entry_knows_its_run_and_its_block(residual_model: ResidualModel) -> None:
    one, two = (segment.rows for segment in residual_model.dataset.segments)
    assert residual_model.residual_runs.tolist() == [0] * 3 * one + [1] * 3 * two + 2 * ([0] * one + [1] * two)
    # 34.9 s are three blocks of ten; what is left over is under half a block and joins the last.
    assert (
        RESIDUAL_BLOCK_S == 10.0
        and residual_model.residual_blocks.max() == 5
        and residual_model.block_runs.tolist() == [0, 0, 0, 1, 1, 1]
    )
    assert np.bincount(residual_model.residual_blocks[-(one + two) :]).tolist() == [100, 100, 150, 100, 100, 150]
    assert WINDOW_S == 20.0 and residual_model.block_halves.tolist() == [0, 0, 1, 0, 0, 1]
    assert residual_model.row_interval_s == pytest.approx(0.1) and residual_model.has_measured_wheel_angle


def test_slow_commands_leave_the_times_of_the_steering_open(residual_model: ResidualModel) -> None:
    """Commands read every 2 s, of which those that stand still tell nothing of how often they were read."""
    assert residual_model.get_interval_s("steering_lag") == residual_model.row_interval_s
    segments = []
    for segment in residual_model.dataset.segments:
        readings = np.arange(segment.rows) % 20 == 0
        readings[200:] = np.arange(segment.rows - 200) == segment.rows - 201
        command = np.interp(segment.time, [0.0, 20.0], [0.0, 0.2])
        segments.append(replace(segment, command=command, measured_rows={"command": readings}))
    dataset = replace(residual_model.dataset, segments=tuple(segments))
    slow = replace(residual_model, dataset=dataset)
    assert slow.get_interval_s("steering_dead_time") == pytest.approx(2.0)
    assert slow.get_interval_s("speed_lag") == slow.get_interval_s("gnss_latency") == pytest.approx(0.1)


def test_slow_wheel_angles_leave_the_time_of_the_receiver_open(residual_model: ResidualModel) -> None:
    segments = [
        replace(
            segment,
            wheel=np.interp(segment.time, [0.0, 20.0], [0.0, 0.2]),
            measured_rows={"angle": np.arange(segment.rows) % 10 == 0},
        )
        for segment in residual_model.dataset.segments
    ]
    slow = replace(residual_model, dataset=replace(residual_model.dataset, segments=tuple(segments)))
    assert slow.get_interval_s("gnss_latency") == pytest.approx(1.0)
    assert slow.get_interval_s("position_delay") == slow.get_interval_s("steering_lag") == pytest.approx(0.1)


def test_only_channels_that_an_effect_reaches_are_made_anew(residual_model: ResidualModel) -> None:
    rows, base = residual_model.dataset.rows, np.full(5 * residual_model.dataset.rows, 7.0)
    path = residual_model.compute_change(OFFSET, base, frozenset({PATH}))
    assert (path[3 * rows :] == 7.0).all() and np.array_equal(
        path[: 3 * rows], residual_model.compute_residuals(OFFSET)[: 3 * rows]
    )
    wheel, whole = (
        residual_model.compute_change(LATE, base, frozenset({STEERING})),
        residual_model.compute_residuals(LATE),
    )
    assert np.array_equal(wheel[3 * rows : 4 * rows], whole[3 * rows : 4 * rows]) and whole[3 * rows : 4 * rows].any()
    assert (wheel[: 3 * rows] == 7.0).all() and (wheel[4 * rows :] == 7.0).all()
    speed = residual_model.compute_change(SLIP, base, frozenset({SPEED}))
    assert (speed[: 4 * rows] == 7.0).all() and np.array_equal(
        speed[4 * rows :], residual_model.compute_residuals(SLIP)[4 * rows :]
    )


def test_many_settings_side_by_side_change_what_each_alone_changes(
    residual_model: ResidualModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Bit for bit, in their order, with none of it kept, however many are driven at a time."""
    base = np.full(5 * residual_model.dataset.rows, 7.0)
    asked = [
        (OFFSET, frozenset({PATH})), (LATE, frozenset({STEERING})), (SLIP, frozenset({PATH, SPEED})), ({}, frozenset()),
        ({"gnss_latency": {"time_s": 0.2}}, frozenset({POSITION})), (OFFSET, frozenset({PATH})),
        ({**OFFSET, **SLIP}, frozenset({PATH})),
    ]  # fmt: skip
    alone = [fresh(residual_model).compute_change(settings, base, blocks) for settings, blocks in asked]
    for most in (1, 10_000, 500_000):
        monkeypatch.setattr("vehicle.identification.residuals.residual_model.MOST_STEPS_AT_ONCE", most)
        for one, other in zip(fresh(residual_model).compute_changes(asked, base), alone, strict=True):
            assert np.array_equal(one, other)
    assert not np.array_equal(alone[0], alone[4])


def fresh(residual_model: ResidualModel) -> ResidualModel:
    """The residual_model with nothing replayed."""
    return replace(residual_model, rig=replace(residual_model.rig, cache=ReplayCache()))


def test_effects_can_be_fixed_under_those_that_are_asked_for(residual_model: ResidualModel) -> None:
    fixed, both = residual_model.copy_with_fixed_effects(SLIP), {**SLIP, **OFFSET}
    assert np.array_equal(fixed.compute_residuals(OFFSET), residual_model.compute_residuals(both))
    base, blocks = residual_model.compute_residuals({}), frozenset({PATH})
    assert np.array_equal(fixed.compute_change(OFFSET, base, blocks), residual_model.compute_change(both, base, blocks))
    assert (
        np.array_equal(
            fixed.copy_with_fixed_effects(OFFSET).compute_residuals({}), residual_model.compute_residuals(both)
        )
        and residual_model.fixed == {}
    )


def test_what_a_log_lacks_leaves_its_channel_out() -> None:
    residual_model = build_residual_model(course(circle(0.05, 30.0)), rig(), {})
    assert residual_model.wheel == (None,) and residual_model.speed == (None,), "neither command was logged"
    assert (residual_model.compute_residuals({})[3 * residual_model.dataset.rows :] == 0.0).all()
    assert convert_noise_to_array(NOISE, True).tolist() == [0.01, 0.0, 0.002, 0.0, 0.0015, 0.01]
    assert convert_noise_to_array(NOISE, False)[2] > 100.0, "a heading that was not measured says nothing"


def test_a_channel_is_as_wide_as_its_noise() -> None:
    """White noise of half a degree on the wheel: its weight while nothing changes is half a degree, without memory."""
    rng = np.random.default_rng(8)
    one = measured(((120.0, 4.0, 1.0, 0.0),))
    assert one.wheel is not None
    one = replace(one, wheel=one.wheel + math.radians(0.5) * rng.standard_normal(one.rows))
    ((wheel,), (speed,)) = build_channels(course_of(one), rig(), {})
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
    quiet = ResidualModel(runs, rig(), noise, build_filters(runs, rig(), NOISE, {}), (None,) * 4, (None,) * 4)
    floor = np.sum([one[5.0] for one in compute_noise_floor(quiet, {run: {} for run in range(4)})], axis=0)
    rows = 50
    assert (floor[0] + floor[1]) / floor[3] == pytest.approx(0.01**2 * (2 * rows - 3) / rows, rel=0.07)


def test_without_noise_the_floor_is_nothing() -> None:
    runs = course_of(measured(PIECES))
    still = ResidualChannel(np.ones(runs.rows), 0.5, np.zeros(runs.rows))
    quiet = ResidualModel(runs, rig(), QUIET, build_filters(runs, rig(), NOISE, {}), (still,), (still,))
    for horizon in (1.0, 5.0):  # what is left comes of wheel angles read at ten rows a second
        sums = compute_noise_floor(quiet, {0: {}})[0][horizon]
        assert np.sqrt(sums[:3] / sums[3]).max() < 1e-3


def test_residuals_of_a_true_model_are_of_size_one_and_a_wrong_one_adds_to_them(residual_model: ResidualModel) -> None:
    rows = 3 * residual_model.dataset.rows
    true, wrong = (residual_model.compute_residuals(settings)[:rows] for settings in ({}, OFFSET))
    assert true.std() == pytest.approx(1.0, abs=0.15)
    assert float(wrong @ wrong) > float(true @ true) + 100.0


def test_a_slow_command_may_have_changed_at_any_time_between_its_readings(residual_model: ResidualModel) -> None:
    """Wheel angles count less as far from a change as it may have come, not only in the half second beside it."""
    times = []
    for every in (1, 20):
        segments = []
        for segment in residual_model.dataset.segments:
            readings = np.arange(segment.rows) % every == 0
            command = np.interp(segment.time, segment.time[readings], (segment.time[readings] > 12.0) * 0.2)
            grid = np.interp(segment.steps_s, segment.time, command)
            rows = {"command": readings} if every > 1 else {}
            driven = replace(segment, command=command, grids=segment.grids | {"command": grid}, measured_rows=rows)
            states = replay_segment(residual_model.rig, driven, {}, from_sensor=False, from_speed=False)
            wheel = np.interp(segment.time, segment.steps_s, states[:, STEERING_COLUMN])
            segments.append(replace(driven, wheel=wheel))
        dataset = replace(residual_model.dataset, segments=tuple(segments))
        channel = build_channels(dataset, residual_model.rig, {})[0][0]
        assert channel is not None
        time = residual_model.dataset.segments[0].time
        times.append(time[(channel.sigma > 2.0 * channel.sigma.min()) & (time > 5.0)])
    (fast, slow) = times
    assert fast.min() > 11.0 and fast.max() < 14.0 and slow.min() < 10.5 and slow.max() > fast.max() + 1.0
