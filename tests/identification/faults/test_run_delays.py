"""A run that follows its commands later than the others is told, by its wheel angle or by its path."""

from dataclasses import replace
from functools import lru_cache

import pandas as pd
import pytest

from tests.identification.fault_logs import RUNS, clean_frames
from tests.truth.cases import TruthCase
from tests.truth.drives import three_speeds_programme
from tests.truth.second import Second
from tests.truth.third import Third, make_third_logs
from tests.truth.third_drives import PROGRAMMES
from vehicle.identification.faults.run_delays import build_delay_regression
from vehicle.identification.faults.unlike_runs import RunDifference, find_unlike_runs
from vehicle.identification.logs.reader import build_log
from vehicle.model.tractor import load_tractor

EG105 = load_tractor("eg105")


def compare(frames: list[pd.DataFrame], sensor: bool) -> list[RunDifference]:
    tables = frames if sensor else [frame.drop(columns="steering_deg") for frame in frames]
    return find_unlike_runs([build_log(frame, frame.attrs["name"]) for frame in tables], EG105, "soil")


def test_a_late_run_is_told_by_its_wheel_angle() -> None:
    late = Second({"steering_dead_time": {"time_s": 0.5}}, 61).log(three_speeds_programme()[4], 4)
    (difference,) = compare([late if name == RUNS[4] else frame for name, frame in clean_frames().items()], True)
    assert difference.run == 4 and difference.quantity == "late" and "later after a command" in difference.words
    assert 0.3 < difference.amount < 0.7


def test_runs_without_commands_or_movements_show_no_delay() -> None:
    frames = [clean_frames()[name] for name in RUNS[:2]]
    straight = [build_log(frame, frame.attrs["name"]) for frame in frames]
    assert build_delay_regression(straight, EG105, "soil") is None
    uncommanded = [build_log(frame.drop(columns="steering_command_deg"), "run") for frame in clean_frames().values()]
    assert build_delay_regression(uncommanded, EG105, "soil") is None


@lru_cache
def make_clean_logs(programme: str, rate_hz: float) -> tuple[pd.DataFrame, ...]:
    """Logs of one tractor; nobody changes them."""
    return tuple(make_third_logs(TruthCase("clean", 65, programme=programme, rate_hz=rate_hz)))


@pytest.mark.slow
@pytest.mark.parametrize(("programme", "run", "rate_hz"), [
    ("mixed", 2, 10.0), ("closed", 5, 5.0),
    *(pytest.param(*one, marks=pytest.mark.matrix)
      for one in (("mixed", 2, 5.0), ("mixed", 5, 10.0), ("mixed", 5, 5.0),
                  ("closed", 0, 10.0), ("closed", 0, 5.0), ("closed", 5, 10.0))),
])  # fmt: skip
@pytest.mark.parametrize("sensor", [True, False])
def test_a_late_run_of_any_programme_is_told(programme: str, run: int, rate_hz: float, sensor: bool) -> None:
    case = TruthCase("clean", 65, programme=programme, rate_hz=rate_hz)
    frames = list(make_clean_logs(programme, rate_hz))
    other = Third(replace(case, effects={"steering_dead_time": {"time_s": 0.5}}))
    frames[run] = other.log(PROGRAMMES[programme]()[run], run)
    (difference,) = compare(frames, sensor)
    assert difference.run == run and difference.quantity == "late" and 0.3 < difference.amount < 0.7
