"""Time stamps that jitter are evened; rows that were really taken unevenly keep theirs."""

import numpy as np
import pandas as pd
import pytest

from tests.diagnosis.mixups import shift_clock
from tests.identification.log_tables import runs
from tests.truth.drives import drive, stairs, triangle
from tests.truth.second import Second
from vehicle.identification.errors import LogError
from vehicle.identification.logs.clocks import (
    correct_position_clock,
    even_time_stamps,
    measure_followed_share,
    measure_heading_lags,
    measure_speed_lags,
)
from vehicle.identification.logs.reader import build_log
from vehicle.identification.logs.schema import Log

STEP_S, PACE_MPS = 0.1, 1.4
PACES = stairs(*[(14.0, 1.2), (17.0, 1.8), (11.0, 0.9)] * 5)
WEAVE = drive("weave", 180.0, triangle(12.0, 14.0), PACES)


def drive_straight(
    stamps_are_wrong: bool, jitter_s: float, noise_m: float = 0.01
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """True times, and columns of a straight drive with stamps about even ones, wrong or as the rows were taken."""
    rng, even = np.random.default_rng(5), STEP_S * np.arange(400)
    stamps = np.sort(even + jitter_s * rng.uniform(-1.0, 1.0, len(even)))
    taken = even if stamps_are_wrong else stamps
    east, north = PACE_MPS * taken + noise_m * rng.standard_normal((2, len(even)))
    return taken, {"time_s": stamps, "easting_m": east, "northing_m": north}


@pytest.mark.parametrize("jitter_s", [0.03, 0.05])
def test_stamps_that_jitter_are_evened(jitter_s: float) -> None:
    taken, columns = drive_straight(True, jitter_s)
    evened, (sentence,) = even_time_stamps(columns)
    before, after = (float(np.std(one["time_s"] - taken)) for one in (columns, evened))
    assert after < 0.4 * before and "rows were taken every 0.1 s" in sentence
    assert evened["easting_m"] is columns["easting_m"]


@pytest.mark.parametrize(("stamps_are_wrong", "jitter_s"), [(False, 0.03), (False, 0.05), (True, 0.002)])
def test_rows_that_were_taken_unevenly_and_small_jitter_are_left_alone(stamps_are_wrong: bool, jitter_s: float) -> None:
    _, columns = drive_straight(stamps_are_wrong, jitter_s)
    assert even_time_stamps(columns) == (columns, ())


def test_held_positions_and_standing_tractors_say_nothing() -> None:
    even, stamps = STEP_S * np.arange(300), STEP_S * np.arange(300) + 0.03 * np.sin(np.arange(300))
    held = np.where(np.arange(299) % 5 == 0, 0.7, 0.0)
    assert measure_followed_share(stamps, even, held)[1] == np.inf
    assert measure_followed_share(stamps, even, np.full(299, 0.01))[1] == np.inf


def test_rows_lost_between_are_no_jitter() -> None:
    _, columns = drive_straight(True, 0.0)
    kept = np.delete(np.arange(400), np.arange(7, 400, 29))
    thinned = {name: values[kept] for name, values in columns.items()}
    assert even_time_stamps(thinned) == (thinned, ())


def test_a_log_says_that_its_stamps_were_evened() -> None:
    frame = runs()["steps"]
    rng = np.random.default_rng(2)
    step_s = float(np.median(np.diff(frame["time_s"])))
    wrong = frame.assign(time_s=np.sort(frame["time_s"] + 0.4 * step_s * rng.uniform(-1.0, 1.0, len(frame))))
    assert any("time_s jitters by" in each for each in build_log(wrong, "steps").corrections)
    assert build_log(frame, "steps").corrections == ()


def bundle(columns: dict[str, np.ndarray], at_once_s: float = 0.002) -> dict[str, np.ndarray]:
    """The columns with rows stamped on arrival, three to seven at once."""
    time, start = columns["time_s"].copy(), 0
    for count in np.random.default_rng(3).integers(3, 8, len(time)):
        rows = np.arange(start, min(start + int(count), len(time)))
        if len(rows):
            time[rows] = time[rows[-1]] + at_once_s * np.arange(len(rows))
        start += int(count)
    return {**columns, "time_s": time}


def test_rows_that_come_in_bundles_are_spread() -> None:
    taken, columns = drive_straight(True, 0.0)
    evened, (sentence,) = even_time_stamps(bundle(columns))
    assert np.max(np.abs(evened["time_s"] - taken)) < 0.02
    assert "bundles of about 5," in sentence and "rows were taken every 0.1 s" in sentence


def test_rows_lost_between_bundles_stay_lost() -> None:
    taken, columns = drive_straight(True, 0.0)
    kept = np.delete(np.arange(400), np.arange(180, 230))
    bundled = bundle({name: values[kept] for name, values in columns.items()})
    evened, _ = even_time_stamps(bundled)
    assert np.max(np.abs(evened["time_s"] - taken[kept])) < 0.11


def test_rows_that_were_taken_in_bundles_are_refused_for_that() -> None:
    """Positions stand within a bundle and move on between two of them: each row was taken when it is stamped."""
    _, columns = drive_straight(True, 0.0)
    time = bundle(columns)["time_s"]
    frame = pd.DataFrame({
        "time_s": time, "easting_m": PACE_MPS * time, "northing_m": 0.5 * time, "steering_deg": np.sin(time),
    })  # fmt: skip
    with pytest.raises(LogError, match=r"rows come in bundles, 0.002 s apart within one and 0.099 s on average"):
        build_log(frame, "run")


def test_stamps_in_whole_seconds_are_spread_where_positions_advance_evenly() -> None:
    taken, columns = drive_straight(False, 0.0)
    log = build_log(pd.DataFrame({**columns, "time_s": taken // 1.0, "steering_deg": 0.0, "speed_mps": 2.0}), "run")
    apart = log.time_s - taken
    assert np.ptp(apart) < 0.15 and any("bundles of about 10" in each for each in log.corrections)


# --- Positions on a clock of their own are found by kinematics, and no controller in the loop looks like one ---


def read(frame: pd.DataFrame) -> Log:
    return build_log(frame, "run")


@pytest.mark.parametrize("rate", [0.004, -0.006])
@pytest.mark.parametrize("with_heading", [True, False])
def test_clocks_that_drift_apart_are_told_and_joined(rate: float, with_heading: bool) -> None:
    frame = Second({}, 5).log(WEAVE)
    names = ("easting_m", "northing_m", *(("heading_deg",) if with_heading else ()))
    late = shift_clock(names, 0.0, 60.0 * rate)(frame)
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
    late = shift_clock(("easting_m", "northing_m"), 0.0, 0.3)(frame)
    assert "against the heading" in read(late).corrections[0]
    both = shift_clock(("easting_m", "northing_m", "heading_deg"), 0.0, 0.3)(frame)
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
