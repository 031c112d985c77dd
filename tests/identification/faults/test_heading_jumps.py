"""Headings that jump once and stay off are told and turned back; what turns, drifts or scatters is no jump."""

import numpy as np
import pandas as pd
import pytest

from tests.identification.fault_logs import START_S, clean_frames, clean_logs
from vehicle.identification.diagnosis.log_notes import list_onset_faults
from vehicle.identification.faults.level_steps import HEADING_JUMP, correct_heading_jumps
from vehicle.identification.logs.reader import build_log


def turn(frame: pd.DataFrame, by_deg: np.ndarray) -> pd.DataFrame:
    """The frame with turned headings."""
    frame = frame.copy()
    frame["heading_deg"] = (frame.heading_deg + by_deg) % 360.0
    return frame


@pytest.mark.parametrize("size_deg", [-25.0, 8.0, 20.0])
@pytest.mark.parametrize("name", ["there", "steps"])
@pytest.mark.parametrize("is_right_after", [False, True])
def test_a_jump_is_told_and_turned_back(size_deg: float, name: str, is_right_after: bool) -> None:
    frame = clean_frames()[name]
    late = (frame.time_s - START_S).to_numpy() >= 22.0
    log = build_log(turn(frame, np.where(late != is_right_after, size_deg, 0.0)), name)
    (corrected,) = correct_heading_jumps([log])
    (fault,) = corrected.faults
    assert (fault.id, fault.run, fault.to_s) == (HEADING_JUMP, name, None)
    assert fault.from_s - START_S == pytest.approx(22.0, abs=0.2)
    said = list_onset_faults([corrected])[0].words
    assert float(said.split(" deg ")[0].split()[-1]) == pytest.approx(abs(size_deg), abs=1.0)
    assert ("right" if (size_deg > 0.0) != is_right_after else "left") in said
    used = corrected.used
    clean = build_log(frame, name).heading_deg
    assert corrected.heading_deg is not None and clean is not None
    assert float(np.max(np.abs((corrected.heading_deg[used] - clean[used] + 180.0) % 360.0 - 180.0))) < 1.0
    assert log.rows_used - corrected.rows_used < 12 and corrected.segment_count == log.segment_count + 1


@pytest.mark.parametrize("kind", ["drift", "bias", "moment", "often", "small"])
@pytest.mark.parametrize("name", ["there", "steps"])
def test_what_does_not_jump_once_is_left_as_it_is(kind: str, name: str) -> None:
    frame = clean_frames()[name]
    seconds = (frame.time_s - START_S).to_numpy()
    by_deg = {
        "drift": 20.0 * seconds / seconds[-1],
        "bias": np.full(len(seconds), 15.0),
        "moment": np.where((seconds >= 22.0) & (seconds < 24.0), 20.0, 0.0),
        "often": np.where(seconds % 8.0 < 4.0, 20.0, 0.0),
        "small": np.where(seconds >= 22.0, 3.0, 0.0),
    }[kind]
    log = build_log(turn(frame, by_deg), name, check=False)
    assert correct_heading_jumps([log]) == [log]


def test_clean_runs_have_none_and_need_no_heading() -> None:
    logs = list(clean_logs().values())
    without = [build_log(frame.drop(columns="heading_deg"), name) for name, frame in clean_frames().items()]
    assert correct_heading_jumps(logs) == logs and correct_heading_jumps(without) == without
