"""Half a metre between machines with implements: measured on the record, and what it costs."""

import math
from itertools import combinations
from typing import Any

import numpy as np
import pytest
import shapely

from planner.evaluation.candidates.evaluate import Candidate, simulate_candidate
from planner.evaluation.machine_outlines import build_body

pytestmark = pytest.mark.usefixtures("first_layout")

FIELD = shapely.box(0, 0, 110, 54)
PARALLEL = math.radians(10.0)


@pytest.mark.parametrize(("strategy", "beside_m"), [
    pytest.param("row-by-row", 0.1, marks=pytest.mark.matrix), ("col-by-col", 0.1), ("interleaved", 0.1),
    ("split-field", 0.5)
])  # fmt: skip
def test_it_is_kept_and_who_works_side_by_side_may_be_nearer(strategy: str, beside_m: float, place: Any) -> None:
    """Neighbouring tracks leave 0.3 m between machines, of which a third is enough in a formation."""
    site = place(FIELD, (0.0, 0.0), tractors=(3,))
    run = simulate_candidate(site, Candidate(strategy, 3)).run
    assert site.request.clearance_m == 0.5 and run.contacts == ()
    body, axle_m = build_body(site.tractor, site.implement), site.tractor.rear_axle_m
    nearest = {True: math.inf, False: math.inf}
    for first, second in combinations(range(3), 2):
        poses = [run.get_poses(each)[:, :3] for each in (first, second)]
        near = np.hypot(*(poses[0] - poses[1])[:, :2].T) < 12.0
        angle = np.sin(poses[0][near, 2] - poses[1][near, 2])
        boxes = []
        for x, y, heading in (pose[near].T for pose in poses):
            axle = np.column_stack([x - axle_m * np.cos(heading), y - axle_m * np.sin(heading), heading])
            boxes.append(shapely.multipolygons(body.place_boxes(axle).reshape(-1, 2)))
        apart = shapely.distance(*boxes)
        for beside in (True, False):
            nearest[beside] = min(nearest[beside], *apart[(np.abs(angle) < PARALLEL) == beside], math.inf)
    assert nearest[False] > 0.5 - 0.05, "looked at ten times a second"
    assert nearest[True] > beside_m - 0.05


def test_of_two_in_a_row_one_turns_a_little_ahead_and_it_costs_a_formation_little(place: Any) -> None:
    """The last of three, on the side that the turn leads to, goes first; the first of them 3 m of its way later."""
    site, close = (place(FIELD, (0.0, 0.0), tractors=(3,), **more) for more in ({}, {"clearance_m": 0.05}))
    run, nearer = (simulate_candidate(one, Candidate("row-by-row", 3)).run for one in (site, close))
    assert site.driving_rules.ahead_m == 3.0 and site.request.clearance_m == 0.5
    gates = [gate for leg in run.plan.missions[0].legs for gate in leg.gates if gate.tractor == 2]
    assert any(gate.after_m == 3.0 for gate in gates)
    assert not any(gate.after_m == 3.0 for leg in run.plan.missions[2].legs for gate in leg.gates)
    assert run.duration_s == pytest.approx(nearer.duration_s, rel=0.03)


def test_a_clearance_that_neighbouring_tracks_do_not_leave_is_told(place: Any) -> None:
    """Wide of each other it is kept; side by side 0.3 m is all there is, and the remark says so with the figure."""
    site = place(FIELD, (0.0, 0.0), tractors=(3,), clearance_m=3.0)
    result = simulate_candidate(site, Candidate("row-by-row", 3)).result
    assert result.feasible, result.reason
    assert 0.05 < result.min_clearance_m < 0.4
    assert result.remark is not None and f"come within {result.min_clearance_m:.2f} m of each other" in result.remark
    assert "some tracks leave only 0.30 m between machines" in result.remark
    alone = simulate_candidate(
        place(FIELD, (0.0, 0.0), tractors=(1,), clearance_m=3.0, overhang_m=1.0), Candidate("split-field", 1)
    ).result
    assert alone.remark is None
