"""Logs in bursts whose steering columns change every ten seconds: a stuck wheel is told, and nothing is refused."""

import numpy as np
import pandas as pd
import pytest

from planner import diagnose
from tests.examples import seldom
from vehicle.identification.errors import LogError
from vehicle.identification.logs.reader import build_log
from vehicle.identification.logs.standing_columns import STEERING_LOOSE, STEERING_STUCK

EVERY_S, BURST_S, STEP_S, LAST_S, WHEELBASE_M = 10.0, 2.0, 0.1, 900.0, 2.14


def drive_in_bursts(stuck_from_s: float, stuck_deg: float, seed: int = 1) -> pd.DataFrame:
    """Return a log of a single-track vehicle that follows random commands until its wheels stay where they are."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, LAST_S, STEP_S)
    command = np.repeat(rng.uniform(-25.0, 25.0, int(LAST_S / EVERY_S)), round(EVERY_S / STEP_S))[: len(time)]
    wheel = np.where(time < stuck_from_s, command, stuck_deg)
    heading = np.cumsum(np.tan(np.radians(wheel)) / WHEELBASE_M * STEP_S)
    frame = pd.DataFrame(
        {
            "time_s": time, "easting_m": np.cumsum(np.sin(heading)) * STEP_S,
            "northing_m": np.cumsum(np.cos(heading)) * STEP_S, "heading_deg": np.degrees(heading) % 360.0,
            "speed_mps": 1.0, "steering_command_deg": command,
            "steering_deg": np.repeat(wheel[:: round(EVERY_S / STEP_S)] + rng.normal(0.0, 0.1, int(LAST_S / EVERY_S)),
                                      round(EVERY_S / STEP_S)),
        }
    )  # fmt: skip
    return frame[time % EVERY_S < BURST_S].reset_index(drop=True)


@pytest.mark.parametrize(("stuck_deg", "fault_id"), [(-28.0, STEERING_STUCK), (3.0, STEERING_LOOSE)])
@pytest.mark.parametrize("stuck_from_s", [305.0, 611.0])
def test_steering_that_stops_following_is_found_between_two_readings(
    stuck_from_s: float, stuck_deg: float, fault_id: str
) -> None:
    log = build_log(drive_in_bursts(stuck_from_s, stuck_deg), "bursts")
    assert [fault.id for fault in log.faults] == [fault_id]
    (fault,) = log.faults
    assert fault.between_s is not None
    assert fault.between_s[0] - EVERY_S <= stuck_from_s <= fault.between_s[1] + EVERY_S
    assert abs(fault.from_s - stuck_from_s) <= EVERY_S
    assert fault.to_s is None


@pytest.mark.parametrize("seed", [0, 1, *seldom(2, 3, 4)])
def test_wheels_that_follow_have_no_fault(seed: int) -> None:
    assert build_log(drive_in_bursts(np.inf, 0.0, seed), "bursts").faults == ()


def test_a_log_with_faults_and_nothing_to_replay_is_not_refused() -> None:
    diagnosis = diagnose([build_log(drive_in_bursts(305.0, -28.0), "bursts")])
    assert [fault.id for fault in diagnosis.faults] == [STEERING_STUCK]
    assert "between 300 s after the start and 310 s after the start" in diagnosis.faults[0].words
    assert diagnosis.causes_sentence.startswith("Nothing else can be diagnosed: ")
    assert not diagnosis.is_savable
    with pytest.raises(LogError):
        diagnose([build_log(drive_in_bursts(np.inf, 0.0), "bursts")])


def test_a_commanded_speed_that_is_often_empty_costs_no_rows() -> None:
    frame = drive_in_bursts(np.inf, 0.0)
    command = pd.Series(1.0 + 0.1 * np.sin(frame["time_s"]))
    frame["speed_command_mps"] = command.where(frame["time_s"] > 300.0)
    log = build_log(frame, "paused")
    assert log.rows_used == len(frame)
    assert log.speed_command_mps is None
    assert any("speed_command_mps is empty in" in message for message in log.corrections)
