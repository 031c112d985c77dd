"""A run by another tractor is told with what differs; clean sets and sets with one cause have no such run."""

import numpy as np
import pytest

from tests.diagnosis.sets import drawn
from tests.examples import seldom
from tests.identification.fault_logs import RUNS, clean_frames
from tests.truth.drives import three_speeds_programme
from tests.truth.second import Second, second_logs
from vehicle.identification.diagnosis.log_notes import mark_unlike_runs
from vehicle.identification.diagnosis.results import RunCheck
from vehicle.identification.faults.unlike_runs import find_unlike_runs
from vehicle.identification.logs.reader import build_log
from vehicle.identification.replay.data_subset import leave_out_runs, select_balanced_subset
from vehicle.identification.replay.drive_segments import build_dataset
from vehicle.model.tractor import load_tractor

EG105 = load_tractor("eg105")


@pytest.mark.parametrize(
    ("run", "effects", "words"),
    [
        (2, {"steering_gain": {"ratio": 0.85}}, "% wider"),
        (3, {"steering_gain": {"ratio": 1.15}}, "% tighter"),
        (1, {"steering_offset": {"angle_deg": 1.6}}, "deg to the right"),
        (4, {"wheel_slip": {"ratio": 0.1}}, "10 % slower"),
    ],
)
def test_a_run_with_other_values_is_told(run: int, effects: dict, words: str) -> None:  # type: ignore[type-arg]
    odd = Second(effects, 61).log(three_speeds_programme()[run], run)
    frames = clean_frames() | {RUNS[run]: odd}
    (difference,) = find_unlike_runs([build_log(frame, name) for name, frame in frames.items()], EG105, "soil")
    assert difference.run == run and words in difference.words and "the 7 other runs" in difference.words
    checks = mark_unlike_runs([RunCheck(name, 1.0, 1.0) for name in RUNS], [difference])
    assert [check.name for check in checks if check.unlike] == [RUNS[run]] and words in checks[run].words


@pytest.mark.parametrize(
    "name", ["", "grip_patch", *seldom("side_slip", "cross_slope_drift", "steering_asymmetry", "implement_slip")]
)
def test_causes_that_show_in_some_runs_make_none_unlike(name: str) -> None:
    effects = {name: drawn(name, 1.2, np.random.default_rng(3))} if name else {}
    logs = [build_log(frame, frame.attrs["name"]) for frame in second_logs(effects, 63, three_speeds_programme())]
    assert find_unlike_runs(logs, EG105, "soil") == []


def test_few_runs_show_nothing() -> None:
    logs = [build_log(clean_frames()[name], name) for name in RUNS[:3]]
    assert find_unlike_runs(logs, EG105, "soil") == []


def test_runs_are_left_out_and_keep_their_numbers() -> None:
    dataset = build_dataset([build_log(clean_frames()[name], name) for name in RUNS[:3]])
    subset = select_balanced_subset(dataset, left_out=(1,))
    assert subset.runs == (0, 2) and subset.dataset.names == (RUNS[0], RUNS[2])
    assert {segment.run for segment in leave_out_runs(dataset, (1,)).segments} == {0, 2}
    assert select_balanced_subset(dataset).dataset is dataset and leave_out_runs(dataset, ()) is dataset
