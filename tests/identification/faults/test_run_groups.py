"""Two groups of runs are told with what differs and since when; runs alike, one odd run and a drift are no groups."""

from dataclasses import replace

import numpy as np
import pytest

from tests.identification.fault_logs import clean_frames
from tests.truth.cases import TruthCase
from tests.truth.drives import three_speeds_programme
from tests.truth.second import Second
from tests.truth.third import Third, make_third_logs
from tests.truth.third_drives import PROGRAMMES
from vehicle.identification.faults.run_groups import OwnValues, find_split, rank_runs
from vehicle.identification.faults.unlike_runs import RunDifference, describe_groups, find_unlike_runs
from vehicle.identification.logs.reader import build_log
from vehicle.identification.logs.schema import Log
from vehicle.model.tractor import load_tractor

EG105 = load_tractor("eg105")
LEAST = 0.07
CHOSEN = (("closed", "steering_offset"), ("mixed", "wheel_slip"))
"""Programmes and effects whose mixed logs are told apart in every run of CI."""


def own_values(values: np.ndarray) -> OwnValues:
    return OwnValues(tuple(range(len(values))), values, np.diag(np.full(len(values), 1e-6)))


def mix(case: TruthCase, runs: tuple[int, ...], **hidden: dict[str, float]) -> list[Log]:
    """Logs of a case in which some runs are those of another tractor."""
    frames, other = make_third_logs(case), Third(replace(case, effects=hidden))
    for run in runs:
        frames[run] = other.log(PROGRAMMES[case.programme]()[run], run)
    return [build_log(frame, frame.attrs["name"]) for frame in frames]


def tell_group(logs: list[Log]) -> tuple[set[int], list[RunDifference]]:
    differences = find_unlike_runs(logs, EG105, "soil")
    return {run for each in differences for run in each.group}, differences


def test_runs_of_one_distribution_are_hardly_ever_two_groups() -> None:
    rng = np.random.default_rng(4)
    told = [
        find_split(own_values(spread * rng.standard_normal(8)), LEAST) is not None
        for spread in (0.02, 0.05, 0.2)
        for _ in range(300)
    ]
    assert np.mean(told) < 0.01


def test_a_value_that_moves_steadily_is_no_pair_of_groups() -> None:
    for count in (6, 8, 16):
        assert find_split(own_values(np.linspace(0.0, 0.5, count)), LEAST) is None
        assert find_split(own_values(0.15 * np.sin(np.linspace(0.0, 6.0, count))), LEAST) is None


def test_two_tight_clusters_are_told_unless_a_condition_explains_them() -> None:
    values = np.array([0.01, 0.2, -0.01, 0.0, 0.19, 0.21, 0.2, 0.02])
    split = find_split(own_values(values), LEAST)
    assert split is not None and split.second == (1, 4, 5, 6) and split.amount == pytest.approx(0.195, abs=0.01)
    side = (values > 0.1).astype(float)
    doubtful = OwnValues(tuple(range(8)), values, 1e-6 * np.eye(8) + 0.1**2 * np.outer(side, side))
    assert find_split(doubtful, LEAST) is None
    # The same doubt about a condition that differs inside the groups explains nothing.
    other = np.tile([0.0, 1.0], 4)
    assert find_split(replace(doubtful, covariance=1e-6 * np.eye(8) + 0.1**2 * np.outer(other, other)), LEAST)


def test_a_tractor_that_was_changed_between_two_runs_is_told_with_the_run() -> None:
    drives = three_speeds_programme()
    frames = list(clean_frames().values())
    for run in (5, 6, 7):
        frames[run] = Second({"wheel_slip": {"ratio": 0.1}}, 61).log(drives[run], run)
    logs = [build_log(frame, frame.attrs["name"]) for frame in frames]
    group, differences = tell_group(logs)
    assert group == {5, 6, 7} and "10 % slower" in differences[0].words
    (sentence,) = describe_groups(differences, logs)
    assert "All runs from waves on" in sentence and "Diagnose the two groups apart" in sentence
    assert describe_groups([replace(differences[0], group=())], logs) == ()


def test_logs_whose_clocks_start_anew_count_in_their_order() -> None:
    logs = [build_log(frame, frame.attrs["name"]) for frame in list(clean_frames().values())[:3]]
    assert rank_runs(logs) == [0, 1, 2]
    in_time = [replace(log, time_s=log.time_s + shift) for log, shift in zip(logs, (900.0, 0.0, 450.0), strict=True)]
    assert rank_runs(in_time) == [2, 0, 1]


@pytest.mark.matrix
@pytest.mark.parametrize(("programme", "name", "value", "quantity"), [
    pytest.param(programme, *hidden, marks=() if (programme, hidden[0]) in CHOSEN else pytest.mark.matrix)
    for programme in ("three_speeds", "mixed", "closed")
    for hidden in (("steering_offset", {"angle_deg": 1.7}, "offset"), ("wheel_slip", {"ratio": 0.11}, "pace"))
])  # fmt: skip
def test_two_tractors_are_told_apart(programme: str, name: str, value: dict[str, float], quantity: str) -> None:
    for seed, runs, rate_hz in ((31, (4, 5, 6, 7), 10.0), (32, (0, 2, 3, 7), 5.0)):
        logs = mix(TruthCase("clean", seed, programme=programme, rate_hz=rate_hz), runs, **{name: value})
        group, differences = tell_group(logs)
        assert group and (group <= set(runs) or group <= set(range(8)) - set(runs))
        assert differences[0].quantity == quantity
