"""The lever arm, late positions and a biased heading, each against its definition."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicle.model.instruments import apply_lever_arm, compute_guidance_pose, interpolate_at_time, interpolate_past_pose
from vehicle.records import HISTORY_STEPS, STATE
from vehicle.sim.compile import MODEL
from vehicle.sim.effect_terms import read_delayed


def test_a_lever_by_hand() -> None:
    """Heading north: ahead is north, to the right is east."""
    assert apply_lever_arm(10.0, 20.0, 0.0, 1.0, 2.0, 0.5) == (10.5, 22.0)
    assert apply_lever_arm(10.0, 20.0, 1.0, 0.0, 2.0, 0.5) == (12.0, 19.5)


@given(st.floats(-1.0, 4.0))
def test_between_two_samples_is_the_line_and_beyond_them_their_ends(at: float) -> None:
    assert interpolate_at_time(5.0, 9.0, 1.0, 3.0, at) == pytest.approx(np.interp(at, [1.0, 3.0], [5.0, 9.0]))


@given(st.floats(0.0, 30.0), st.integers(8, 40))
def test_delay_is_interpolation_over_the_steps_gone_by(late: float, now: int) -> None:
    size = 8
    values, ring = np.sin(np.arange(now + 1)), np.zeros(size)
    for step, value in enumerate(values):
        ring[step % size] = value
    reached = min(late, size - 2.0)
    assert read_delayed(ring, now, late) == pytest.approx(
        np.interp(now - reached, np.arange(now + 1), values), abs=1e-12
    )


def test_a_late_pose_comes_from_a_ring() -> None:
    ring = np.array([8.0, 9.0, 6.0, 7.0])  # entries 8, 9, 6, 7 of a history that goes on
    x, y, angle = interpolate_past_pose(ring, 10.0 * ring, -ring, 7, 7.0, 8.0, 7.25)
    assert (x, y, angle) == (7.25, 72.5, -7.25)


def test_guidance_believes_what_is_shown_less_the_lever_of_the_file() -> None:
    """At 1 m per step to the east and 2.5 steps late, 0.4 m shifted ahead, 0.1 m aside, heading 90 degrees wrong."""
    state, model = np.zeros(1, dtype=STATE), np.zeros(1, dtype=MODEL)
    model["guide"], model["shift_forward"], model["shift_right"] = 1.1, 0.4, 0.1
    model["latency"], model["heading_bias"] = 2.5, 0.5 * math.pi
    for step in range(HISTORY_STEPS + 10):
        state["clock"], state["x"] = step, float(step)
        x, y, heading = compute_guidance_pose(state[0], model[0])
    assert heading == pytest.approx(0.5 * math.pi)
    # The antenna is seen at (last - 2.5 + 1.5, -0.1); the file's lever is taken off along the biased heading, north.
    assert (x, y) == pytest.approx((HISTORY_STEPS + 9 - 1.0, -0.1 - 1.1))


def test_before_the_start_the_first_pose_is_seen() -> None:
    state, model = np.zeros(1, dtype=STATE), np.zeros(1, dtype=MODEL)
    model["latency"], state["x"], state["y"], state["angle"] = 30.0, 3.0, 4.0, 0.5
    assert compute_guidance_pose(state[0], model[0]) == (3.0, 4.0, 0.5)
