"""The second reference against closed forms, and that each effect changes what it should and nothing else."""

import math

import numpy as np
import pytest

from tests.truth import rolling
from tests.truth.drives import Drive, constant, drive, stairs, three_speeds_programme
from tests.truth.effects import CLEAR_SIZES
from tests.truth.second import EXACT, STEP_S, TRACTORS, Second
from tests.truth.signals import draw_coloured

PACE = 5.0 / 3.6


def quiet(effects: dict[str, dict[str, float]] | None = None, tractor: str = "eg105") -> Second:
    return Second(effects or {}, 0, tractor, roughness=0.0, receiver=EXACT)


def clear(name: str) -> dict[str, dict[str, float]]:
    return {name: CLEAR_SIZES[name]}


def held(angle_deg: float, speed: float = PACE, tool: float = 0.0, seconds: float = 40.0) -> Drive:
    return drive("held", seconds, constant(angle_deg), speed, tool, bearing_deg=70.0)


@pytest.mark.parametrize("tractor", TRACTORS)
def test_the_programme_reaches_a_friction_limit_of_the_clear_size_on_both_sides(tractor: str) -> None:
    for run in three_speeds_programme()[2:4]:
        rolled = quiet(tractor=tractor).roll(run)
        most = np.max(np.abs(rolled.speed_mps * rolled.column(rolling.YAW_RATE)))
        assert most > CLEAR_SIZES["side_slip"]["limit_g"] * rolling.GRAVITY


def test_the_programme_is_steady_in_the_step_of_integration() -> None:
    """A kinematic tractor must end where its heading says: the way is the integral of the speed along the heading."""
    rolled = quiet().roll(three_speeds_programme()[2])
    heading, speed = rolled.column(rolling.HEADING), rolled.speed_mps
    for axis, share in ((rolling.EAST, np.sin(heading)), (rolling.NORTH, np.cos(heading))):
        along = speed * share
        way = 0.5 * STEP_S * float(np.sum(along[1:] + along[:-1]))
        assert rolled.states[-1, axis] - rolled.states[0, axis] == pytest.approx(way, abs=1e-3)


@pytest.mark.parametrize("lag", [0.6, 1.2, 2.0])
def test_speed_lag_is_the_way_that_is_lost(lag: float) -> None:
    """Lags in a row that are T together lose T times a change of speed on the way, whatever their order."""
    run = drive("faster", 40.0, constant(0.0), stairs((20.0, 1.0), (20.0, 1.2)), bearing_deg=0.0)
    way = quiet({"speed_lag": {"time_s": lag}}).roll(run).column(rolling.WAY)
    lost = 1.2 * 20.0 - float(way[-1] - way[round(20.0 / STEP_S)])
    assert lost / 0.2 == pytest.approx(lag, abs=0.05)


def test_the_drive_line_keeps_its_limits() -> None:
    rolled = quiet().roll(drive("go", 20.0, constant(0.0), stairs((10.0, 2.2), (10.0, 0.0))))
    pull, speed = rolled.column(rolling.ACCELERATION), rolled.speed_mps
    assert np.abs(pull).max() <= 0.7 + 1e-9
    assert np.abs(np.diff(pull)).max() / STEP_S <= 2.5 + 1e-6
    assert speed.max() < 2.2 * 1.03 and abs(speed[-1]) < 5e-3


def test_instruments_and_ground_are_as_noisy_as_they_say() -> None:
    memory = draw_coloured(np.random.default_rng(1), 20000, 1.0, -1.0 / math.log(0.8))
    assert np.std(memory) == pytest.approx(1.0, abs=0.05)
    assert np.corrcoef(memory[:-1], memory[1:])[0, 1] == pytest.approx(0.8, abs=0.02)
    run = held(0.0)
    turns = [math.degrees(np.ptp(Second({}, seed, receiver=EXACT).roll(run).column(rolling.HEADING)[[0, -1]]))
             for seed in range(40)]  # fmt: skip
    # A curvature s remembered over L turns the heading by s sqrt(2 L d) on a way d.
    wanted = math.degrees(0.002 * math.sqrt(2.0 * 0.8 * 40.0 * PACE))
    assert np.sqrt(np.mean(np.square(turns))) == pytest.approx(wanted, rel=0.35)
    frame, exact = (replaced.log(run) for replaced in (Second({}, 3, roughness=0.0), quiet()))
    assert np.std(np.diff(frame.speed_mps[60:])) == pytest.approx(0.015 * math.sqrt(2.0), rel=0.15)
    assert np.abs(np.diff(frame.time_s) - 0.1).max() < 0.025 and np.allclose(np.diff(exact.time_s), 0.1)


def test_the_closed_loop_keeps_to_its_line() -> None:
    run = three_speeds_programme()[7]
    rolled = quiet().roll(run)
    aside = -(rolled.column(rolling.EAST) - rolled.column(rolling.EAST)[0])  # driving south, right is west
    for moment, offset in ((13.9, 0.6), (29.9, -0.8), (43.9, 0.7)):
        assert aside[round(moment / STEP_S)] == pytest.approx(offset, abs=0.12)
