"""Thinned paths: near the path at every moment, and never more knots than asked for."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from reports.common.plan_records import PlanDrive
from reports.plan.drive_geometry import list_status_runs
from reports.plan.map_data import PATH_TOLERANCE_M, thin_paths

STEP_M = 1.4


def driven(xy: np.ndarray, status: np.ndarray) -> PlanDrive:
    none = dict.fromkeys(("working", "turning", "waiting", "reversing"), (0.0,))
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])
    return PlanDrive("a", corners, (), np.empty((0, 2, 2)), 3.0, 1.0, (xy,), (status,), (1.0,), none)


def straight(count: int) -> np.ndarray:
    return np.column_stack([STEP_M * np.arange(count), np.zeros(count)])


def test_knots_are_where_speed_or_status_changes() -> None:
    ones = np.ones(500, dtype=np.int64)
    (lane,) = thin_paths(driven(straight(500), ones), 1000)
    assert lane.samples.tolist() == [0, 499] and lane.xy[1].tolist() == [STEP_M * 499, 0.0]
    assert list_status_runs(lane.status) == [(1, 0, 1)]
    at = np.concatenate([np.arange(100) * 1.0, 99.0 + np.arange(1, 101) * 2.0])
    (lane,) = thin_paths(driven(np.column_stack([at, 0 * at]), ones[:200]), 1000)
    assert lane.samples.tolist() == [0, 99, 199]
    (lane,) = thin_paths(driven(straight(7), np.array([3, 3, 3, 1, 1, 2, 2])), 2)
    assert lane.samples.tolist() == [0, 2, 4, 6], "a change of status belongs to the step before it"
    assert list_status_runs(lane.status) == [(3, 0, 1), (1, 1, 2), (2, 2, 3)]
    (lane,) = thin_paths(driven(np.zeros((1, 2)), ones[:1]), 10)
    assert lane.samples.tolist() == [0] and list_status_runs(lane.status) == [], "one moment is one knot"


@given(st.lists(st.tuples(st.integers(-3, 3), st.integers(-3, 3), st.sampled_from((1, 2))), min_size=2, max_size=60))
def test_every_sample_is_near_its_place_on_the_thinned_path(steps: list[tuple[int, int, int]]) -> None:
    xy = np.cumsum([(0.1 * x, 0.1 * y) for x, y, _ in steps], axis=0)
    status = np.array([code for _, _, code in steps])
    (lane,) = thin_paths(driven(xy, status), 1000)
    read = np.column_stack([np.interp(np.arange(len(xy)), lane.samples, lane.xy[:, k]) for k in (0, 1)])
    assert np.hypot(*(read - xy).T).max() <= PATH_TOLERANCE_M + 1e-9
    assert np.repeat(lane.status, np.diff(lane.samples)).tolist() == status[1:].tolist()


@pytest.mark.parametrize("most", [10, 40, 400])
def test_few_knots_go_where_the_path_is_farthest_off(drive: PlanDrive, most: int) -> None:
    rng = np.random.default_rng(1)
    one = np.ones(500, dtype=np.int64)
    wild = replace(
        drive, xy=(straight(500) + rng.normal(0, 2.0, (500, 2)), straight(500) + rng.normal(0, 0.2, (500, 2))),
        status=(one, one),
    )  # fmt: skip
    rough, calm = thin_paths(wild, most)
    assert len(rough.samples) + len(calm.samples) == most
    assert len(rough.samples) > len(calm.samples)
