"""Fixes that leap: told as that and no evidence against the tractor's file, which is doubted all the same where it is
wrong."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.benchmarks.twins import rows
from tests.twin.conftest import fix_of
from vehicle.tractor import Implement, load_tractor
from vehicle.twin.leaps import RARE, SPREAD, Leaps, leapt, log_density, noise_share
from vehicle.twin.motion import Noise
from vehicle.twin.stepper import Stepper
from vehicle.twin.twin import Fix, Twin

AT_S = 30.0
OUT, STAYS = 20.0, math.inf


def driven(
    hidden: Mapping[str, float], seconds: float, rate_hz: float = 1.0, *, metres: float = 0.0, angle: float = 0.0,
    back_s: float = STAYS, seed: int = 3, right_m: float = 0.0,
) -> Twin:  # fmt: skip
    """A twin that follows rows of 80 m, told how they are driven ten times a second; from AT_S on, for `back_s`, fixes
    are so many metres elsewhere, and so many to the right of the tractor."""
    mission, tractor = rows(4), load_tractor("eg105")
    real = Stepper(mission, tractor, Implement(), hidden=hidden, noise=Noise(), seed=seed)
    real.released = len(mission.legs)
    twin = Twin(tractor, Implement(), fix_of(real.state))
    for step in range(1, round(10.0 * seconds) + 1):
        state = real.advance(step / 10.0)
        twin.command(state.time_s, state.steering_command_rad, state.speed_command_mps, state.implement)
        if step % round(10.0 / rate_hz) == 0:
            off = metres if AT_S <= state.time_s < AT_S + back_s else 0.0
            right = right_m if state.time_s >= AT_S else 0.0
            x = state.x_m + off * math.cos(angle) + right * math.sin(state.heading_rad)
            y = state.y_m + off * math.sin(angle) - right * math.cos(state.heading_rad)
            twin.measured(Fix(state.time_s, x, y, state.heading_rad, state.speed_mps, state.time_s))
        twin.advance(state.time_s)
    return twin


@pytest.mark.parametrize("rate_hz", [1.0, 5.0])
@pytest.mark.parametrize("metres", [0.15, 0.3, 1.0, 5.0])
def test_a_leap_is_told_as_a_leap_and_makes_no_doubt(metres: float, rate_hz: float) -> None:
    for number, back_s in enumerate((1.0 / rate_hz, OUT, STAYS)):
        twin = driven({}, 80.0, rate_hz, metres=metres, angle=2.0 * number, back_s=back_s, seed=number)
        assert twin.doubt() is None
        told = [(leap.time_s, leap.metres) for leap in twin.leaps]
        times = [AT_S] if back_s != OUT else [AT_S, AT_S + OUT]
        assert [time_s for time_s, _ in told] == [pytest.approx(at_s, abs=0.3) for at_s in times]
        assert all(apart == pytest.approx(metres, rel=0.3, abs=0.06) for _, apart in told)


def test_the_twin_is_where_the_fix_is_after_it_and_its_heading_and_slip_are_not_learnt_of_it() -> None:
    still, moved = driven({}, 45.0), driven({}, 45.0, metres=0.4, angle=1.0)
    assert moved.state.x_m - still.state.x_m == pytest.approx(0.4 * math.cos(1.0), abs=0.02)
    assert moved.state.y_m - still.state.y_m == pytest.approx(0.4 * math.sin(1.0), abs=0.02)
    one, other = still.state, moved.state
    assert (other.heading_rad, other.speed_mps) == pytest.approx((one.heading_rad, one.speed_mps), abs=0.003)


@pytest.mark.parametrize(
    ("hidden", "like"),
    [({"wheel_slip": 0.08}, ("wheel_slip", "implement_slip")), ({"heading_bias": 1.5}, ("heading_bias",)),
     ({"antenna_right": 0.15}, ("antenna_right",)), ({"steering_offset": 1.0}, ("steering_offset",))],
)  # fmt: skip
def test_what_is_wrong_all_along_is_found_with_a_leap_in_between_too(
    hidden: Mapping[str, float], like: tuple[str, ...]
) -> None:
    for metres in (0.0, 0.4):
        doubt = driven(hidden, 90.0, metres=metres, angle=2.0).doubt()
        assert doubt is not None and doubt.like in like and doubt.told_s < 80.0


@pytest.mark.parametrize("rate_hz", [1.0, 5.0])
@pytest.mark.parametrize("right_m", [0.15, 1.0])
def test_an_antenna_that_is_pushed_aside_is_a_leap_at_first_and_found_in_the_next_bend(
    right_m: float, rate_hz: float
) -> None:
    straight, turned = (driven({}, seconds, rate_hz, right_m=right_m) for seconds in (50.0, 80.0))
    assert straight.doubt() is None and straight.leaps[0].metres == pytest.approx(right_m, abs=0.05)
    doubt = turned.doubt()
    assert doubt is not None and doubt.like == "antenna_right"


def test_one_leap_after_another_is_more_than_a_leap() -> None:
    """A receiver that never comes to rest is no rare fault: the fixes exceed what is said of them."""
    tractor, chance = load_tractor("eg105"), np.random.default_rng(5)
    twin = Twin(tractor, Implement(), Fix(0.0, 0.0, 0.0, 0.5 * math.pi, 0.0, 0.0))
    for second in range(1, 120):
        x, y = 0.06 * chance.standard_normal(2)
        twin.measured(Fix(float(second), x, y, 0.5 * math.pi, 0.0, float(second)))
        twin.command(float(second), 0.0, 0.0, exact=True)
        twin.advance(float(second))
    assert twin.doubt() is not None


@given(st.floats(-300.0, 300.0), st.floats(-300.0, 300.0), st.floats(-8.0, 8.0))
def test_the_density_is_that_of_noise_or_a_leap_and_their_shares_are_its_parts(
    east: float, north: float, turned: float
) -> None:
    def normal(value: float, size: float) -> float:
        return -0.5 * (value / size) ** 2 - math.log(size)

    noise = math.log(1.0 - RARE) + normal(east, 1.0) + normal(north, 1.0) + normal(turned, 1.0)
    leap = math.log(RARE) + normal(east, SPREAD) + normal(north, SPREAD) + normal(turned, 1.0)
    whole = float(np.logaddexp(noise, leap))
    assert log_density(east, north, turned, 1.0) == pytest.approx(whole, rel=1e-9, abs=1e-9)
    assert noise_share(east, north) == pytest.approx(math.exp(noise - whole), rel=1e-6, abs=1e-12)
    assert leapt(np.array([east, north, turned, 0.0])) == (leap > noise) or abs(leap - noise) < 1e-9


def test_a_leap_that_goes_back_is_one_and_what_goes_on_is_none() -> None:
    there, back, none = np.array([0.3, 0.0, 0.0]), np.array([-0.25, 0.02, 0.0]), np.zeros(3)
    for offs, told in (((there, none), 1), ((there, back, none), 1), ((there, there, none), 0), ((none, none), 0),
                       ((there, none, back, none), 2)):  # fmt: skip
        leaps = Leaps()
        for second, off in enumerate(offs):
            leaps.take(float(second), off, bool(np.any(off)))
        assert len(leaps.told) == told
