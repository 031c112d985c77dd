"""Jumps of the fix: they are reported and are no evidence against the tractor's file, whose errors are still found."""

import math
from collections.abc import Mapping

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.examples import seldom
from tests.twin.conftest import fix_of, lay_rows
from vehicle.model.tractor import Implement, load_tractor
from vehicle.twin.kalman_filter import (
    BIAS,
    FORWARD,
    LATE,
    MEASUREMENT_SIZE,
    RIGHT,
    SHIFT_COUNT,
    STATE_SIZE,
    PoseFilter,
    build_monitor_parameters,
    update_by_fix,
)
from vehicle.twin.mismatch import (
    JUMP_PROBABILITY,
    JUMP_SPREAD_SIGMAS,
    JumpDetector,
    compute_log_density,
    compute_noise_probability,
    is_jump,
)
from vehicle.twin.robot_tractor import RobotTractor
from vehicle.twin.step_motion import TractorNoise
from vehicle.twin.twin import PoseFix, Twin

AT_S = 30.0
OUT, STAYS = 20.0, math.inf
FORWARD_MPS, SPIN = 2.0, 0.1


def driven(
    hidden: Mapping[str, float], seconds: float, rate_hz: float = 1.0, *, metres: float = 0.0, angle: float = 0.0,
    back_s: float = STAYS, seed: int = 3, right_m: float = 0.0,
) -> Twin:  # fmt: skip
    """A twin that follows rows of 80 m with ten commands a second; from AT_S on, for `back_s`, fixes are `metres` off
    in the direction `angle`, and by `right_m` to the right of the tractor."""
    mission, tractor = lay_rows(4), load_tractor("eg105")
    real = RobotTractor(mission, tractor, Implement(), hidden_effects=hidden, noise=TractorNoise(), seed=seed)
    real.base_legs = len(mission.legs)
    twin = Twin(tractor, Implement(), fix_of(real.state))
    for step in range(1, round(10.0 * seconds) + 1):
        state = real.advance(step / 10.0)
        twin.add_command(state.time_s, state.steering_command_rad, state.speed_command_mps, state.implement)
        if step % round(10.0 / rate_hz) == 0:
            off = metres if AT_S <= state.time_s < AT_S + back_s else 0.0
            right = right_m if state.time_s >= AT_S else 0.0
            x = state.x_m + off * math.cos(angle) + right * math.sin(state.heading_rad)
            y = state.y_m + off * math.sin(angle) - right * math.cos(state.heading_rad)
            twin.add_fix(PoseFix(state.time_s, x, y, state.heading_rad, state.speed_mps, state.time_s))
        twin.advance(state.time_s)
    return twin


@pytest.mark.parametrize("rate_hz", [1.0, 5.0])
@pytest.mark.parametrize("metres", [0.15, *seldom(0.3, 1.0), 5.0])
def test_a_jump_is_reported_and_causes_no_mismatch(metres: float, rate_hz: float) -> None:
    for number, back_s in enumerate((1.0 / rate_hz, OUT, STAYS)):
        twin = driven({}, 80.0, rate_hz, metres=metres, angle=2.0 * number, back_s=back_s, seed=number)
        assert twin.find_mismatch() is None
        jumps = [(jump.time_s, jump.distance_m) for jump in twin.jumps]
        times = [AT_S] if back_s != OUT else [AT_S, AT_S + OUT]
        assert [time_s for time_s, _ in jumps] == [pytest.approx(at_s, abs=0.3) for at_s in times]
        assert all(apart == pytest.approx(metres, rel=0.3, abs=0.06) for _, apart in jumps)


def test_after_a_jump_the_twin_is_at_the_fix_with_the_same_heading_and_slip() -> None:
    still, moved = driven({}, 45.0), driven({}, 45.0, metres=0.4, angle=1.0)
    assert moved.state.x_m - still.state.x_m == pytest.approx(0.4 * math.cos(1.0), abs=0.02)
    assert moved.state.y_m - still.state.y_m == pytest.approx(0.4 * math.sin(1.0), abs=0.02)
    one, other = still.state, moved.state
    assert (other.heading_rad, other.speed_mps) == pytest.approx((one.heading_rad, one.speed_mps), abs=0.003)


@pytest.mark.parametrize(
    ("hidden", "effects"),
    [({"wheel_slip": 0.08}, ("wheel_slip", "implement_slip")), ({"heading_bias": 1.5}, ("heading_bias",)),
     ({"antenna_right": 0.15}, ("antenna_right",)), ({"steering_offset": 1.0}, ("steering_offset",))],
)  # fmt: skip
def test_a_lasting_error_is_found_despite_a_jump(hidden: Mapping[str, float], effects: tuple[str, ...]) -> None:
    for metres in (0.0, 0.4):
        mismatch = driven(hidden, 90.0, metres=metres, angle=2.0).find_mismatch()
        assert mismatch is not None and mismatch.effect_id in effects and mismatch.detected_s < 80.0


@pytest.mark.parametrize("rate_hz", [1.0, 5.0])
@pytest.mark.parametrize("right_m", [0.15, 1.0])
def test_a_moved_antenna_is_a_jump_at_first_and_found_in_the_next_bend(right_m: float, rate_hz: float) -> None:
    straight, turned = (driven({}, seconds, rate_hz, right_m=right_m) for seconds in (50.0, 80.0))
    assert straight.find_mismatch() is None and straight.jumps[0].distance_m == pytest.approx(right_m, abs=0.05)
    mismatch = turned.find_mismatch()
    assert mismatch is not None and mismatch.effect_id == "antenna_right"


def test_jumps_at_every_fix_are_a_mismatch() -> None:
    """A receiver that never settles is no rare fault: the fixes exceed their given noise."""
    tractor, chance = load_tractor("eg105"), np.random.default_rng(5)
    twin = Twin(tractor, Implement(), PoseFix(0.0, 0.0, 0.0, 0.5 * math.pi, 0.0, 0.0))
    for second in range(1, 120):
        x, y = 0.06 * chance.standard_normal(2)
        twin.add_fix(PoseFix(float(second), x, y, 0.5 * math.pi, 0.0, float(second)))
        twin.add_command(float(second), 0.0, 0.0, is_exact=True)
        twin.advance(float(second))
    assert twin.find_mismatch() is not None


@given(st.floats(-300.0, 300.0), st.floats(-300.0, 300.0), st.floats(-8.0, 8.0))
def test_the_density_is_the_sum_of_noise_and_jump(east: float, north: float, turned: float) -> None:
    def normal(value: float, size: float) -> float:
        return -0.5 * (value / size) ** 2 - math.log(size)

    noise = math.log(1.0 - JUMP_PROBABILITY) + normal(east, 1.0) + normal(north, 1.0) + normal(turned, 1.0)
    jump = (
        math.log(JUMP_PROBABILITY)
        + normal(east, JUMP_SPREAD_SIGMAS)
        + normal(north, JUMP_SPREAD_SIGMAS)
        + normal(turned, 1.0)
    )
    whole = float(np.logaddexp(noise, jump))
    assert compute_log_density(east, north, turned, 1.0) == pytest.approx(whole, rel=1e-9, abs=1e-9)
    assert compute_noise_probability(east, north) == pytest.approx(math.exp(noise - whole), rel=1e-6, abs=1e-12)
    assert is_jump(np.array([east, north, turned, 0.0])) == (jump > noise) or abs(jump - noise) < 1e-9


def test_a_jump_that_goes_back_counts_and_a_lasting_offset_does_not() -> None:
    there, back, none = np.array([0.3, 0.0, 0.0]), np.array([-0.25, 0.02, 0.0]), np.zeros(3)
    for offsets, count in (((there, none), 1), ((there, back, none), 1), ((there, there, none), 0), ((none, none), 0),
                       ((there, none, back, none), 2)):  # fmt: skip
        jumps = JumpDetector()
        for second, off in enumerate(offsets):
            jumps.add_fix(float(second), off, bool(np.any(off)))
        assert len(jumps.jumps) == count


# --- The filter of the twin: it predicts how an error of an instrument shows in its innovations ---


@pytest.mark.parametrize(
    ("kind", "size", "east", "north", "turned"),
    [(BIAS, 0.02, 0.0, 0.0, 0.02), (FORWARD, 0.1, 0.08, 0.06, 0.0), (RIGHT, 0.1, 0.06, -0.08, 0.0),
     (LATE, 0.5, -0.8, -0.6, -0.05)],
)  # fmt: skip
def test_an_error_of_an_instrument_shows_as_predicted(
    kind: int, size: float, east: float, north: float, turned: float
) -> None:
    """Where a tractor heads 0.8 to the east and 0.6 to the north, by hand; then the means are the innovations, and what
    the filter is wrong by is what the fix pulled it away."""
    pose = np.array([3.0, 4.0, math.atan2(0.6, 0.8)])
    one = PoseFilter(build_monitor_parameters(TractorNoise()), pose)
    shifts, sizes = np.zeros((SHIFT_COUNT, STATE_SIZE)), np.zeros(SHIFT_COUNT)
    whitened, means = np.zeros(MEASUREMENT_SIZE), np.zeros((MEASUREMENT_SIZE, SHIFT_COUNT))
    sizes[kind] = size
    fix, before = np.array([*pose, FORWARD_MPS]), one.estimate.copy()
    fix[:3] += (east, north, turned)
    assert update_by_fix(*one.arrays, fix, 0.0, 0.0, FORWARD_MPS, SPIN, -1.0, shifts, sizes, math.inf, whitened, means)
    assert np.linalg.norm(whitened) > 0.5
    assert means[:, kind] == pytest.approx(whitened, abs=1e-9)
    assert shifts[kind] == pytest.approx(before - one.estimate, abs=1e-9)
    assert not np.delete(means, kind, axis=1).any()
