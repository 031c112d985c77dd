"""Wheels that from a moment on stand elsewhere than their sensor says are found; what else bends paths is no step."""

import numpy as np
import pandas as pd
import pytest

from tests.identification.fault_logs import RUNS, START_S, clean_frames, clean_logs
from vehicle.identification.diagnosis.log_notes import list_onset_faults
from vehicle.identification.faults.level_steps import (
    HEADING_JUMP,
    STEERING_JUMP,
    correct_heading_jumps,
    mark_level_step,
)
from vehicle.identification.logs.reader import build_log
from vehicle.identification.logs.schema import Log, LogFault

SLIP, BENT, OPEN = ("steering_deg",), ("steering_deg", "steering_command_deg"), ("steering_command_deg",)


def shift(frame: pd.DataFrame, columns: tuple[str, ...], offset_deg: np.ndarray | float) -> pd.DataFrame:
    """The frame with columns of the steering so much further to the right."""
    frame = frame.copy()
    for name in columns:
        frame[name] += offset_deg
    return frame


def step(frame: pd.DataFrame, at_s: float, size_deg: float) -> np.ndarray:
    """A step of the level at seconds after the start."""
    return np.where(frame.time_s - START_S >= at_s, size_deg, 0.0)


def mark(changed: dict[str, pd.DataFrame], dropped: tuple[str, ...] = ()) -> tuple[list[Log], list[LogFault]]:
    """Logs that were searched for a step, with faults."""
    frames = clean_frames() | changed if dropped else changed
    built = {name: build_log(frame.drop(columns=list(dropped)), name) for name, frame in frames.items()}
    logs = mark_level_step(list((clean_logs() | built).values()))
    return logs, [fault for log in logs for fault in log.faults]


@pytest.mark.parametrize(
    ("columns", "size_deg", "dropped", "words"),
    [
        (SLIP, 2.5, (), "the wheel sensor slipped"),
        (BENT, -3.0, (), "stood 3.0 deg further to the right than steering_deg says"),
        (OPEN, 4.0, ("steering_deg",), "than steering_command_deg says"),
    ],
)
def test_a_step_is_found_with_its_time_and_size(
    columns: tuple[str, ...], size_deg: float, dropped: tuple[str, ...], words: str
) -> None:
    frame = clean_frames()["lines"]
    logs, faults = mark({"lines": shift(frame, columns, step(frame, 26.0, size_deg))}, dropped)
    (fault,) = faults
    assert (fault.id, fault.run, fault.to_s) == (STEERING_JUMP, "lines", None)
    assert fault.from_s - START_S == pytest.approx(26.0, abs=2.0)
    said = list_onset_faults(logs)[0].words
    size = float(said.split(" deg further")[0].split()[-1])
    assert size == pytest.approx(abs(size_deg), abs=0.5)
    assert words.split(" deg ")[-1] in said and said.endswith("these rows are left out")
    marked = next(log for log in logs if log.name == "lines")
    assert float(marked.time_s[marked.used].max()) - START_S < 28.0
    assert [log.rows_used for log in logs if log.name != "lines"] == [
        log.rows_used for name, log in clean_logs().items() if name != "lines"
    ]


def test_what_is_unlike_the_other_runs_is_left_out() -> None:
    frame = clean_frames()["lines"]
    logs, faults = mark({"lines": shift(frame, SLIP, 3.0 - step(frame, 26.0, 3.0))})
    marked = next(log for log in logs if log.name == "lines")
    assert [fault.id for fault in faults] == [STEERING_JUMP] and "the rows before are left out" in faults[0].words
    assert float(marked.time_s[marked.used].min()) - START_S > 24.0


def change(kind: str, frame: pd.DataFrame) -> np.ndarray:
    """What a sensor reads too much where no step is."""
    seconds, wheel = (frame.time_s - START_S).to_numpy(), frame.steering_deg.to_numpy()
    late = seconds >= 26.0
    offsets = {
        "drift": 4.0 * seconds / seconds[-1],
        "gain": np.where(late, 0.3 * wheel, 0.0),
        "side": 2.0 * np.sign(wheel),
        "whole run": np.full(len(seconds), 3.0),
        "wave": 3.0 * np.sin(2.0 * np.pi * seconds / 20.0),
        "a moment": np.where(late & (seconds < 34.0), 3.0, 0.0),
        "small": np.where(late, 0.5, 0.0),
    }
    return offsets[kind]


@pytest.mark.parametrize("kind", ["drift", "gain", "side", "whole run", "wave", "a moment", "small"])
@pytest.mark.parametrize("name", ["lines", "steps"])
def test_what_does_not_step_is_no_step(kind: str, name: str) -> None:
    frame = clean_frames()[name]
    assert mark({name: shift(frame, SLIP, change(kind, frame))})[1] == []


def test_steps_of_several_runs_have_a_cause_of_their_own() -> None:
    frames = {name: shift(frame, SLIP, step(frame, 28.0, 3.0)) for name, frame in clean_frames().items()}
    assert mark({name: frames[name] for name in RUNS[:2] + RUNS[-1:]})[1] == [] == mark(frames)[1]


@pytest.mark.parametrize("dropped", [(), ("steering_deg",), ("heading_deg",)])
def test_clean_runs_have_none(dropped: tuple[str, ...]) -> None:
    assert mark({}, dropped)[1] == []


def test_a_step_in_a_gap_began_at_any_time_in_it() -> None:
    frame = clean_frames()["lines"]
    hidden = ((frame.time_s - START_S >= 24.0) & (frame.time_s - START_S < 30.0)).to_numpy()
    shifted = shift(frame, SLIP, step(frame, 26.0, 3.0))[~hidden].reset_index(drop=True)
    (fault,) = mark({"lines": shifted})[1]
    assert fault.between_s is not None
    earliest_s, shown_s = fault.between_s
    assert earliest_s - START_S == pytest.approx(24.0, abs=2.0) and shown_s - START_S == pytest.approx(30.0, abs=2.0)
    assert fault.from_s == pytest.approx(0.5 * (earliest_s + shown_s))


# --- Headings that jump once and stay off are told and turned back; what turns, drifts or scatters is no jump ---


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
