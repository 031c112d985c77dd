"""Positions on a clock of their own are found by kinematics, and no controller in the loop looks like one."""

import numpy as np
import pandas as pd
import pytest

from tests.truth.drives import drive, stairs, triangle
from tests.truth.second import Second
from vehicle.identification.logs.clocks import correct_position_clock, measure_heading_lags, measure_speed_lags
from vehicle.identification.logs.reader import build_log
from vehicle.identification.logs.schema import Log

PACES = stairs(*[(14.0, 1.2), (17.0, 1.8), (11.0, 0.9)] * 5)
WEAVE = drive("weave", 180.0, triangle(12.0, 14.0), PACES)


def shift_clock(frame: pd.DataFrame, rate: float, names: tuple[str, ...]) -> pd.DataFrame:
    """The log with some columns stamped by a clock that runs slower by `rate`."""
    time = frame.time_s.to_numpy()
    shown, late = time[0] + (time - time[0]) * (1.0 - rate), frame.copy()
    for name in names:
        values = np.unwrap(frame[name], period=360.0) if name == "heading_deg" else frame[name]
        late[name] = np.interp(shown, time, values)
    return late


def read(frame: pd.DataFrame) -> Log:
    return build_log(frame, "run")


@pytest.mark.parametrize("rate", [0.004, -0.006])
@pytest.mark.parametrize("with_heading", [True, False])
def test_clocks_that_drift_apart_are_told_and_joined(rate: float, with_heading: bool) -> None:
    frame = Second({}, 5).log(WEAVE)
    names = ("easting_m", "northing_m", *(("heading_deg",) if with_heading else ()))
    late = shift_clock(frame, rate, names)
    log = read(late)
    (told,) = [one for one in log.corrections if "clock" in one]
    what = "positions and headings get" if with_heading else "positions get"
    assert told.startswith(f"the {what} ") and f"a minute {'later' if rate > 0 else 'earlier'} against" in told
    assert float(told.split("get ")[1].split()[0]) == pytest.approx(abs(60 * rate), abs=0.03)
    inside = slice(20, -40)
    off, before = (
        np.hypot(one.easting_m - frame.easting_m, one.northing_m - frame.northing_m)[inside] for one in (log, late)
    )
    assert float(off.max()) < 0.25 * float(before.max())


def test_a_heading_alone_shows_positions_that_drift() -> None:
    frame = Second({}, 5).log(drive("weave", 180.0, triangle(12.0, 14.0), 1.6))
    late = shift_clock(frame, 0.005, ("easting_m", "northing_m"))
    assert "against the heading" in read(late).corrections[0]
    both = shift_clock(frame, 0.005, ("easting_m", "northing_m", "heading_deg"))
    assert read(both).corrections == (), "at one speed only the steering differs, and that is no evidence"


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_one_clock_stays_one_clock(seed: int) -> None:
    """Paces, loops, constant lateness, slip and soil are no drift."""
    rng = np.random.default_rng(seed)
    paces = stairs(*[(float(rng.uniform(5, 40)), float(rng.uniform(0.7, 2.2))) for _ in range(40)])
    lines = stairs(*[(float(rng.uniform(8, 40)), float(rng.uniform(-1.5, 1.5))) for _ in range(40)])
    working = stairs(*[(20.0, 0.0), (20.0, 1.0)] * 8)
    loop = drive("loop", 240.0, lines, paces, implement=working, closed_loop=True)
    effects = {"gnss_latency": {"time_s": 0.3}, "implement_slip": {"ratio": 0.12}, "speed_lag": {"time_s": 0.8}}
    for hidden in ({}, effects):
        assert read(Second(hidden, seed).log(loop)).corrections == ()


def test_short_logs_and_logs_without_a_second_instrument_show_nothing() -> None:
    frame = Second({}, 5).log(WEAVE)
    bare = read(frame.drop(columns=["speed_mps", "heading_deg"]))
    short = read(frame[:600])
    for log in (bare, short):
        assert measure_speed_lags(log) is None and measure_heading_lags(log) is None
        assert correct_position_clock(log) is log
