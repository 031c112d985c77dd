"""The whitening filter against a Kalman step by hand, and against the textbook's matrices row by row."""

import math

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.identification.analytic_drives import circle, course, rig
from vehicle.identification.replay.drive_segments import compute_step_times
from vehicle.identification.residuals.innovations import (
    DRIFT_MEMORY_S,
    SOIL_MEMORY_S,
    NoiseLevels,
    compute_increments,
    compute_innovations,
    compute_kalman_gains,
    compute_noise_persistence,
    simulate_segment_increments,
)
from vehicle.identification.residuals.noise_weights import convert_noise_to_array

Array = npt.NDArray[np.float64]
NOISE = NoiseLevels(0.01, 0.02, 0.003, 0.004, 0.0025, 0.01)
LEVER = (0.7, 0.2)
AXLE_BEHIND_M = 1.1


def filtered(
    time: Array,
    seen: Array,
    move: Array,
    bias: float = 0.0,
    noise: NoiseLevels = NOISE,
    unknown: Array | None = None,
) -> tuple[Array, Array, Array]:
    """Gains, roots and whitened innovations of rows (east, north, heading) and moves (ahead, aside, turned).

    `unknown` are variances (rad2) of turns between rows.
    """
    unknown = np.zeros(len(time) - 1) if unknown is None else unknown
    rows = len(time)
    gains, roots, out = np.empty((rows, 7, 3)), np.empty((rows, 3, 3)), np.empty((rows, 3))
    east, north, heading = (np.ascontiguousarray(column) for column in seen.T)
    ahead, aside, turned = (np.ascontiguousarray(column) for column in move.T)
    levels = convert_noise_to_array(noise, True)
    compute_kalman_gains(time, heading, ahead, aside, *LEVER, levels, unknown, AXLE_BEHIND_M, gains, roots)
    compute_innovations(
        compute_noise_persistence(time), east, north, heading, ahead, aside, turned, *LEVER, bias, gains, roots, out
    )
    return gains, roots, out


@pytest.mark.slow
def test_the_first_gains_by_hand() -> None:
    """Heading east, so that east and north stay apart: variance of the state over that of the innovation."""
    gains, roots, _ = filtered(np.array([0.0]), np.zeros((1, 3)), np.zeros((0, 3)))
    place, heading = 100.0 + 0.01**2, 0.1**2
    # East sees place, drift of place, and 0.2 m per rad of heading (an antenna to the right swings ahead).
    east = place + 0.02**2 + 0.2**2 * heading + 0.01**2
    assert 1.0 / roots[0, 0, 0] ** 2 == pytest.approx(east)
    north = place + 0.02**2 + 0.7**2 * heading + 0.01**2
    turn = heading + 0.004**2 + 0.003**2
    spread = np.linalg.inv(roots[0]) @ np.linalg.inv(roots[0]).T
    assert np.diag(spread) == pytest.approx([east, north, turn])
    assert spread[0, 2] == pytest.approx(0.2 * heading) and spread[1, 2] == pytest.approx(0.7 * heading)
    crossed = np.array([[place, 0.0, 0.0], [0.2 * heading, 0.7 * heading, heading]])
    assert gains[0, [0, 2]] == pytest.approx(crossed @ np.linalg.inv(spread), rel=1e-6)


def textbook(time: Array, seen: Array, move: Array, bias: float, unknown: Array) -> Array:
    """Whitened innovations by plain matrices: x = F x + u, P = F P F' + Q, K = P H' / S.

    A tractor turns about its rear axle: an unknown turn moves the centre of mass, ahead of it, to the side.
    """
    state, spread = np.zeros(7), np.diag([100.0 + NOISE.position**2] * 2 + [0.01, *(
        one**2 for one in (NOISE.soil, NOISE.heading_drift, NOISE.position_drift, NOISE.position_drift)
    )])  # fmt: skip
    out = []
    for k, (east, north, facing) in enumerate(seen):
        turn = np.array([[math.cos(facing), math.sin(facing)], [math.sin(facing), -math.cos(facing)]])
        arm = turn @ LEVER
        if k == 0:
            state[:2] = [east - arm[0], north - arm[1]]
        see = np.zeros((3, 7))
        see[:2, :2] = see[:2, 5:] = np.eye(2)
        see[:, 2] = [-arm[1], arm[0], 1.0]
        see[2, 4] = 1.0
        expected = see @ state + [arm[0], arm[1], bias]
        off = np.array([east, north, 0.0]) - expected
        whole = see @ spread @ see.T + np.diag([NOISE.position**2, NOISE.position**2, NOISE.heading**2])
        out.append(np.linalg.solve(np.linalg.cholesky(whole), off))
        gain = spread @ see.T @ np.linalg.inv(whole)
        state, spread = state + gain @ off, (np.eye(7) - gain @ see) @ spread
        if k + 1 == len(seen):
            return np.array(out)
        dt, (ahead, aside, turned) = time[k + 1] - time[k], move[k]
        step, soil, slow = np.eye(7), math.exp(-dt / SOIL_MEMORY_S), math.exp(-dt / DRIFT_MEMORY_S)
        way = turn @ [ahead, aside]
        step[:2, 2] = [-way[1], way[0]]
        step[2, 3] = math.hypot(ahead, aside)
        step[range(3, 7), range(3, 7)] = [soil, slow, slow, slow]
        pushes = np.zeros((7, 7))
        pushes[:2, :2] = turn @ np.diag([NOISE.along**2, (0.1 * NOISE.along) ** 2]) @ turn.T * dt
        fresh = [1.0 - soil * soil] + [1.0 - slow * slow] * 3
        sizes = [NOISE.soil, NOISE.heading_drift, NOISE.position_drift, NOISE.position_drift]
        pushes[range(3, 7), range(3, 7)] = [new * size**2 for new, size in zip(fresh, sizes, strict=True)]
        about_axle = np.array([-AXLE_BEHIND_M * math.sin(facing), AXLE_BEHIND_M * math.cos(facing), 1.0, 0, 0, 0, 0])
        pushes += unknown[k] * np.outer(about_axle, about_axle)
        state, spread = step @ state, step @ spread @ step.T + pushes
        state[:2] += way
        state[2] += turned - (seen[k + 1, 2] - facing)
    raise AssertionError("no rows")


@given(st.integers(0, 10**6))
def test_every_row_is_the_textbooks(seed: int) -> None:
    rng = np.random.default_rng(seed)
    time = np.cumsum(rng.uniform(0.05, 0.4, 6))
    facing = rng.uniform(-3.0, 3.0) + rng.normal(0.0, 0.1, 6)
    seen = np.column_stack([0.5 * np.arange(6.0), rng.normal(0.0, 0.1, 6), facing])
    move = np.column_stack([rng.uniform(0.1, 0.6, 5), rng.normal(0.0, 0.02, 5), rng.normal(0.0, 0.1, 5)])
    unknown = rng.choice([0.0, 0.03**2], 5)
    expected = textbook(time, seen, move, 0.02, unknown)
    assert filtered(time, seen, move, 0.02, unknown=unknown)[2] == pytest.approx(expected, rel=1e-6, abs=1e-7)


def test_increments_are_in_the_tractors_frame() -> None:
    """From (0, 0) heading north to (1, 2): 2 m ahead and 1 m to the right; then 1 m back while facing west."""
    x, y, angle = np.array([0.0, 1.0, 2.0]), np.array([0.0, 2.0, 2.0]), np.array([0.5, 1.0, 1.25]) * math.pi
    move = compute_increments(x, y, angle)
    assert move.ahead == pytest.approx([2.0, -1.0]) and move.aside == pytest.approx([1.0, 0.0], abs=1e-12)
    assert move.turned == pytest.approx([0.5 * math.pi, 0.25 * math.pi])


def test_simulated_increments_are_those_of_the_drive() -> None:
    (one,) = course(circle(0.0, 10.0, bearing_deg=30.0)).segments
    move = simulate_segment_increments(rig(), one, {})
    assert move.ahead == pytest.approx(np.full(99, 0.15)) and move.aside == pytest.approx(np.zeros(99), abs=1e-9)
    late = simulate_segment_increments(rig(), one, {"gnss_latency": {"time_s": 0.25}})
    assert late.ahead[:3] == pytest.approx([0.0, 0.0, 0.075]) and late.ahead[3:] == pytest.approx(np.full(96, 0.15))


def test_steps_are_sixty_a_second() -> None:
    assert compute_step_times(121)[[0, 60, 120]].tolist() == [0.0, 1.0, 2.0]
