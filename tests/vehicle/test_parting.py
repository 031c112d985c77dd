"""Tractors that begin nearer to one another than the clearance: they drive apart, and come no nearer."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicle.model.tractor import Implement, Tractor, load_tractor
from vehicle.sim.clearance import CONTACT_M, STANDING_ERROR_M, compute_start_limit
from vehicle.sim.path_conflicts import ClearanceCheck, PosePath, build_poses, compute_outline_distances
from vehicle.sim.world import simulate

CLEARANCE_M, APART_M = 0.5, 0.4
BEHIND_M = 2.42 + 3.1 + APART_M  # the nose is 2.42 m before the centre of mass, the implement ends 3.1 m behind it

CHECK = ClearanceCheck.for_machine(
    load_tractor("eg105"), Implement(width_m=3.0, hitch_m=1.5, length_m=1.0), CLEARANCE_M, CLEARANCE_M
)


@pytest.mark.parametrize(
    ("apart_m", "limit_m"),
    [
        (0.7, 0.5),  # as far as any
        (0.4, 0.4 - STANDING_ERROR_M),
        (0.0, CONTACT_M),
        (math.inf, 0.5),  # who has parted
    ],
)
def test_two_come_no_nearer_than_they_stand(apart_m: float, limit_m: float) -> None:
    assert compute_start_limit(apart_m, CLEARANCE_M) == pytest.approx(limit_m)


def drive(build: Any, tractor: Tractor, implement: Implement, front: list[Any], rear: list[Any], slow: bool) -> Any:
    plan = build.plan(front, rear)
    return simulate(plan, tractor, implement, stop_clearance_m=CLEARANCE_M, slow=slow, max_time_s=200.0)


@pytest.mark.parametrize("slow", [False, True])
def test_one_drives_away_from_another_that_stands(build: Any, eg105: Tractor, implement: Implement, slow: bool) -> None:
    front, rear = build.leg((0, BEHIND_M), (0, 30)), build.leg((0, -0.02), (0, 0))
    run = drive(build, eg105, implement, [front], [rear], slow)
    assert run.outcome == "done" and run.min_clearance_m == pytest.approx(APART_M, abs=0.03)


@pytest.mark.parametrize("slow", [False, True])
def test_nobody_comes_nearer_than_it_stands(build: Any, eg105: Tractor, implement: Implement, slow: bool) -> None:
    stands = build.leg((0, BEHIND_M), (0, BEHIND_M + 0.02))
    run = drive(build, eg105, implement, [stands], [build.leg((0, 0), (0, 10))], slow)
    assert run.outcome == "conflict" and run.conflict.time_s > 0.0
    assert APART_M - 0.1 < run.min_clearance_m < APART_M


@pytest.mark.parametrize("slow", [False, True])
def test_who_has_parted_keeps_the_clearance(build: Any, eg105: Tractor, implement: Implement, slow: bool) -> None:
    """The front one drives 5 m ahead and back to where it was."""
    ahead = build.leg((0, BEHIND_M), (0, BEHIND_M + 5.0))
    back = build.leg((0, BEHIND_M + 5.0), (0, BEHIND_M), gear=-1)
    run = drive(build, eg105, implement, [ahead, back], [build.leg((0, -0.02), (0, 0))], slow)
    assert run.outcome == "conflict" and run.conflict.first_leg + run.conflict.second_leg == 1
    last_m = abs(run.record[-1, 0, 1] - run.record[0, 0, 1])
    assert 0.0 < last_m < CLEARANCE_M - APART_M + 0.05


@pytest.mark.parametrize("slow", [False, True])
def test_two_that_touch_where_they_begin_are_stopped(
    build: Any, eg105: Tractor, implement: Implement, slow: bool
) -> None:
    front = build.leg((0, BEHIND_M - APART_M + 0.5 * CONTACT_M), (0, 30))
    run = drive(build, eg105, implement, [front], [build.leg((0, 0), (0, 0.02))], slow)
    assert run.outcome == "conflict" and run.conflict.time_s == 0.0


def path(places: Any) -> PosePath:
    return PosePath(build_poses(np.array(places, dtype=float)))


def straight(x: float, y: float, heading_deg: float, steps: int) -> PosePath:
    heading = math.radians(heading_deg)
    return path([(x + n * 0.8 * math.cos(heading), y + n * 0.8 * math.sin(heading), heading) for n in range(steps)])


def list_pairs(rows: Any) -> set[tuple[int, int]]:
    return {(i, j) for i, first, last in rows.tolist() for j in range(first, last + 1)}


class TestMeetings:
    """Rows of conflicts between paths of two that stand 0.4 m apart, one behind the other, heading east."""

    def test_the_front_one_may_leave_before_the_other_begins(self) -> None:
        front, rear = straight(BEHIND_M, 0.0, 0.0, 9), straight(0.0, 0.0, 0.0, 9)
        rows = CHECK.find_meetings(front, rear).tolist()
        assert [row for row in rows if row[0] == 0] == [[0, 1, 8]], "the rear one may not begin before"
        assert all(first > 0 for _, first, _ in rows), "nobody is in the way of the front one"
        # 0.8 m on they are 1.2 m apart, which is more than 0.5 + 0.3 m; the rear one 0.8 m on is in its way again.
        assert [row[:2] for row in rows if row[0] in (1, 2)] == [[1, 1], [2, 2]]
        assert [row[:2] for row in CHECK.find_blocked_parts(front, rear).tolist()][:2] == [[0, 0], [1, 1]]

    def test_neither_may_leave_who_faces_the_other(self) -> None:
        east, west = straight(0.0, 0.0, 0.0, 9), straight(2 * 2.42 + APART_M, 0.0, 180.0, 9)
        assert CHECK.find_meetings(east, west).tolist() == CHECK.find_blocked_parts(east, west).tolist()

    def test_each_may_leave_the_other_back_to_back(self) -> None:
        east, west = straight(0.0, 0.0, 0.0, 9), straight(-2 * 3.1 - APART_M, 0.0, 180.0, 9)
        assert len(CHECK.find_blocked_parts(east, west)) and not len(CHECK.find_meetings(east, west))

    def test_who_comes_back_meets_the_other(self) -> None:
        ahead = [(BEHIND_M + 0.8 * n, 0.0, 0.0) for n in (0, 1, 2, 1, 0)]
        rows = CHECK.find_meetings(path(ahead), path([(0.0, 0.0, 0.0)])).tolist()
        assert rows == [[4, 0, 0]]

    @given(st.floats(-8.0, 8.0), st.floats(-8.0, 8.0), st.floats(-180.0, 180.0), st.floats(-0.2, 0.2))
    def test_only_ways_apart_from_one_that_stands_are_free(
        self, x: float, y: float, heading_deg: float, bend: float
    ) -> None:
        """One drives straight on, the other on a bend from anywhere near it."""
        headings = math.radians(heading_deg) + bend * np.arange(12)
        steps = 0.8 * np.column_stack([np.cos(headings), np.sin(headings)])
        places = np.array([x, y]) + np.cumsum(steps, axis=0) - steps
        bent = np.column_stack([places, headings])
        line = np.column_stack([0.8 * np.arange(12), np.zeros(12), np.zeros(12)])
        a, b = path(line), path(bent)
        gap_m = compute_outline_distances(line[:1], bent[:1], CHECK.models)[0]
        free = list_pairs(CHECK.find_blocked_parts(a, b)) - list_pairs(CHECK.find_meetings(a, b))
        assert list_pairs(CHECK.find_meetings(a, b)) <= list_pairs(CHECK.find_blocked_parts(a, b))
        for i, j in free:
            assert min(i, j) == 0 and gap_m >= CONTACT_M
            apart_m = compute_outline_distances(line[i : i + 1], bent[j : j + 1], CHECK.models)[0]
            assert apart_m >= min(CLEARANCE_M, gap_m - STANDING_ERROR_M)

    def test_two_that_touch_do_not_part(self) -> None:
        front, rear = straight(BEHIND_M - APART_M, 0.0, 0.0, 9), path([(0.0, 0.0, 0.0)])
        assert CHECK.find_meetings(front, rear).tolist() == CHECK.find_blocked_parts(front, rear).tolist()
