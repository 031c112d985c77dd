"""Drawn sets of one tractor: nothing is said that is not so. Logs take longer to make than to judge, so all judge the
same ones."""

from __future__ import annotations

from itertools import compress

import pandas as pd
import pytest

from tests.truth.cases import TruthCase
from tests.truth.third import make_third_logs
from tests.truth.third_draw import draw_third_cases
from vehicle.identification.faults.unlike_runs import RunDifference, find_unlike_runs
from vehicle.identification.logs.reader import build_log
from vehicle.identification.logs.swapped_steering import find_swapped_steering
from vehicle.model.tractor import load_tractor

pytestmark = pytest.mark.matrix

EG105 = load_tractor("eg105")
SEED = 61
ALIKE = ("clean", "effect", "closed_loop", "column", "law", "outside", "one_speed")
"""Kinds of cases in which no run differs from the others."""
DrawnSet = tuple[TruthCase, list[pd.DataFrame]]


@pytest.fixture(scope="module", params=["one of each kind", pytest.param("the others", marks=pytest.mark.matrix)])
def drawn_sets(request: pytest.FixtureRequest) -> list[DrawnSet]:
    """Cases with their logs: the first of each kind, or all others."""
    cases = draw_third_cases(SEED)
    kinds = [case.kind for case in cases]
    first = [kinds.index(kind) == place for place, kind in enumerate(kinds)]
    chosen = first if request.param == "one of each kind" else [not each for each in first]
    return [(case, make_third_logs(case)) for case in compress(cases, chosen)]


def compare(frames: list[pd.DataFrame]) -> list[RunDifference]:
    return find_unlike_runs([build_log(frame, frame.attrs["name"]) for frame in frames], EG105, "soil")


def test_causes_and_faults_are_no_swap(drawn_sets: list[DrawnSet]) -> None:
    for case, frames in drawn_sets:
        logs = [build_log(frame, frame.attrs["name"], check=False) for frame in frames]
        assert not any(find_swapped_steering(log) for log in logs), case


def test_sets_of_one_tractor_are_one_group_and_no_run_is_late(drawn_sets: list[DrawnSet]) -> None:
    alike = [(case, frames) for case, frames in drawn_sets if case.kind in ALIKE]
    assert {case.kind for case, _ in alike} == set(ALIKE)
    for case, frames in alike:
        differences = compare(frames)
        assert not [run for each in differences for run in each.group], case
        if case.kind != "one_speed":
            assert not [each for each in differences if each.quantity == "late"], case


def test_no_run_of_one_tractor_is_late_by_its_path(drawn_sets: list[DrawnSet]) -> None:
    for case, frames in drawn_sets:
        if case.kind in ALIKE and case.kind != "one_speed":
            differences = compare([frame.drop(columns="steering_deg") for frame in frames])
            assert not [each for each in differences if each.quantity == "late"], case
