"""Time stamps that jitter are evened; rows that were really taken unevenly keep theirs."""

import numpy as np
import pandas as pd
import pytest

from tests.identification.log_tables import runs
from vehicle.identification.errors import LogError
from vehicle.identification.logs.clocks import even_time_stamps, measure_followed_share
from vehicle.identification.logs.reader import build_log

STEP_S, PACE_MPS = 0.1, 1.4


def drive(stamps_are_wrong: bool, jitter_s: float, noise_m: float = 0.01) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """True times, and columns of a straight drive with stamps about even ones, wrong or as the rows were taken."""
    rng, even = np.random.default_rng(5), STEP_S * np.arange(400)
    stamps = np.sort(even + jitter_s * rng.uniform(-1.0, 1.0, len(even)))
    taken = even if stamps_are_wrong else stamps
    east, north = PACE_MPS * taken + noise_m * rng.standard_normal((2, len(even)))
    return taken, {"time_s": stamps, "easting_m": east, "northing_m": north}


@pytest.mark.parametrize("jitter_s", [0.03, 0.05])
def test_stamps_that_jitter_are_evened(jitter_s: float) -> None:
    taken, columns = drive(True, jitter_s)
    evened, (sentence,) = even_time_stamps(columns)
    before, after = (float(np.std(one["time_s"] - taken)) for one in (columns, evened))
    assert after < 0.4 * before and "rows were taken every 0.1 s" in sentence
    assert evened["easting_m"] is columns["easting_m"]


@pytest.mark.parametrize(("stamps_are_wrong", "jitter_s"), [(False, 0.03), (False, 0.05), (True, 0.002)])
def test_rows_that_were_taken_unevenly_and_small_jitter_are_left_alone(stamps_are_wrong: bool, jitter_s: float) -> None:
    _, columns = drive(stamps_are_wrong, jitter_s)
    assert even_time_stamps(columns) == (columns, ())


def test_held_positions_and_standing_tractors_say_nothing() -> None:
    even, stamps = STEP_S * np.arange(300), STEP_S * np.arange(300) + 0.03 * np.sin(np.arange(300))
    held = np.where(np.arange(299) % 5 == 0, 0.7, 0.0)
    assert measure_followed_share(stamps, even, held)[1] == np.inf
    assert measure_followed_share(stamps, even, np.full(299, 0.01))[1] == np.inf


def test_rows_lost_between_are_no_jitter() -> None:
    _, columns = drive(True, 0.0)
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
    taken, columns = drive(True, 0.0)
    evened, (sentence,) = even_time_stamps(bundle(columns))
    assert np.max(np.abs(evened["time_s"] - taken)) < 0.02
    assert "bundles of about 5," in sentence and "rows were taken every 0.1 s" in sentence


def test_rows_lost_between_bundles_stay_lost() -> None:
    taken, columns = drive(True, 0.0)
    kept = np.delete(np.arange(400), np.arange(180, 230))
    bundled = bundle({name: values[kept] for name, values in columns.items()})
    evened, _ = even_time_stamps(bundled)
    assert np.max(np.abs(evened["time_s"] - taken[kept])) < 0.11


def test_rows_that_were_taken_in_bundles_are_refused_for_that() -> None:
    """Positions stand within a bundle and move on between two of them: each row was taken when it is stamped."""
    _, columns = drive(True, 0.0)
    time = bundle(columns)["time_s"]
    frame = pd.DataFrame({
        "time_s": time, "easting_m": PACE_MPS * time, "northing_m": 0.5 * time, "steering_deg": np.sin(time),
    })  # fmt: skip
    with pytest.raises(LogError, match=r"rows come in bundles, 0.002 s apart within one and 0.099 s on average"):
        build_log(frame, "run")


def test_stamps_in_whole_seconds_are_spread_where_positions_advance_evenly() -> None:
    taken, columns = drive(False, 0.0)
    log = build_log(pd.DataFrame({**columns, "time_s": taken // 1.0, "steering_deg": 0.0, "speed_mps": 2.0}), "run")
    apart = log.time_s - taken
    assert np.ptp(apart) < 0.15 and any("bundles of about 10" in each for each in log.corrections)
