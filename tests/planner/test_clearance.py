"""Half a metre between machines with implements: measured on the record, and what it costs."""

import math
from itertools import combinations
from typing import Any

import numpy as np
import pytest
import shapely

from planner.evaluation.candidates.evaluate import Candidate, simulate_candidate
from planner.evaluation.machine_outlines import build_body
from planner.request.plan_request import PlanRequest
from tests.examples import seldom

FIELD = shapely.box(0, 0, 150, 60)


@pytest.mark.parametrize("strategy", [*seldom("row-by-row"), "col-by-col", "interleaved", "split-field"])
def test_it_is_kept_beside_each_other_as_well(strategy: str, place: Any) -> None:
    """Neighbouring tracks leave 0.3 m between machines, so nobody passes another there."""
    site = place(FIELD, (0.0, 0.0), tractors=(3,))
    run = simulate_candidate(site, Candidate(strategy, 3)).run
    assert site.request.clearance_m == 0.5 and run is not None and run.contacts == ()
    body, axle_m = build_body(site.tractor, site.implement), site.tractor.rear_axle_m
    nearest_m = math.inf
    for first, second in combinations(range(3), 2):
        poses = [run.get_poses(each)[:, :3] for each in (first, second)]
        near = np.hypot(*(poses[0] - poses[1])[:, :2].T) < 12.0
        boxes = []
        for x, y, heading in (pose[near].T for pose in poses):
            axle = np.column_stack([x - axle_m * np.cos(heading), y - axle_m * np.sin(heading), heading])
            boxes.append(shapely.multipolygons(body.place_boxes(axle).reshape(-1, 2)))
        nearest_m = min(nearest_m, *shapely.distance(*boxes), math.inf)
    assert nearest_m > 0.5 - 0.05, "looked at ten times a second"


def test_of_two_in_a_row_one_turns_a_little_ahead(place: Any) -> None:
    """The last of three, on the side that the turn leads to, goes first; the first of them 3 m of its way later."""
    site = place(FIELD, (0.0, 0.0), tractors=(3,))
    run = simulate_candidate(site, Candidate("row-by-row", 3)).run
    assert run is not None and site.driving_rules.ahead_m == 3.0
    gates = [gate for leg in run.plan.missions[0].legs for gate in leg.gates if gate.tractor == 2]
    assert any(gate.after_m == 3.0 for gate in gates)
    assert not any(gate.after_m == 3.0 for leg in run.plan.missions[2].legs for gate in leg.gates)


def test_it_costs_a_formation_little(place: Any) -> None:
    def time_s(clearance_m: float) -> float | None:
        site = place(FIELD, (0.0, 0.0), tractors=(3,), clearance_m=clearance_m)
        return simulate_candidate(site, Candidate("row-by-row", 3)).result.time_s

    assert time_s(0.5) == pytest.approx(time_s(0.05), rel=0.03)
    assert PlanRequest().clearance_m == 0.5
