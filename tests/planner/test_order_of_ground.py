"""Fleets keep to the order of headland and tracks on each other's ground, as driven."""

import numpy as np
import pytest
import shapely

from planner.evaluation.candidates.evaluate import Candidate, run_candidate
from planner.evaluation.preparation import prepare_context
from planner.evaluation.site import get_site_moves
from planner.evaluation.work_order import WorkOrder
from planner.request.plan_request import PlanRequest
from strategies.lines.work_line import build_tool_strip
from strategies.site.site import LEFT_FACTOR
from vehicle.missions.plan import HEADLAND_PASS, SWATH
from vehicle.missions.run import SimulationRun

pytestmark = pytest.mark.usefixtures("first_layout")

WIDTH_M = 4.5
HALF_BODY_M = 0.7  # the wheels of the tractor are within it
SPARED_M2 = 1.0  # paths are drawn, not driven


def find_wrong_m2(run: SimulationRun, tool_m: float, is_kept: bool) -> float:
    """The ground that a tractor drives over on its way from track to track, of another's headland that is done (kept)
    or not (a crop that stands), at worst of one piece and one leg."""
    worst_m2 = 0.0
    plan = run.plan
    for owner, worked in enumerate(plan.missions):
        for number, leg in enumerate(worked.legs):
            if leg.task.kind != HEADLAND_PASS or not leg.implement:
                continue
            strip = build_tool_strip(leg.points, tool_m, WIDTH_M)
            begin_s, end_s = find_span_s(run, owner, number)
            for other in set(range(plan.tractors)) - {owner}:
                tracks = [n for n, one in enumerate(plan.missions[other].legs) if one.task.kind == SWATH]
                for place in range(tracks[0], tracks[-1]):
                    since_s, until_s = find_span_s(run, other, place)
                    if (since_s > end_s) if is_kept else (until_s < begin_s):
                        line = shapely.LineString(plan.missions[other].legs[place].points)
                        wheels = shapely.buffer(line, HALF_BODY_M, cap_style="flat")
                        worst_m2 = max(worst_m2, shapely.intersection(wheels, strip).area)
    return worst_m2


def find_span_s(run: SimulationRun, tractor: int, leg: int) -> tuple[float, float]:
    """When a tractor drives a leg."""
    on_it = np.flatnonzero(run.get_leg_numbers(tractor) == leg)
    return float(run.time_s[on_it[0]]), float(run.time_s[on_it[-1]])


@pytest.mark.slow
@pytest.mark.parametrize(("field", "operation", "order", "tractors"), [
    ("netherlands", "sow", "last", 5), ("iwamizawa", "harvest", "first", 4),
    pytest.param("netherlands", "harvest", "first", 4, marks=pytest.mark.matrix),
])  # fmt: skip
def test_nobody_drives_over_ground_out_of_turn(field: str, operation: str, order: str, tractors: int) -> None:
    """Without gates each of these plans does, by 12 m2 and more."""
    request = PlanRequest(field=field, width_m=WIDTH_M, tractors=(tractors,), operation=operation, headland_order=order)
    context = prepare_context(WorkOrder(request))
    driven = run_candidate(context, Candidate("split-field", tractors))
    assert driven.reason is None
    tool_m = context.driving_rules.tool_m
    assert find_wrong_m2(driven.run, tool_m, order == "last") < SPARED_M2


@pytest.mark.slow
@pytest.mark.parametrize(("strategy", "tractors"), [("split-field", 1), ("split-field", 2), ("row-by-row", 2)])
def test_a_plough_works_neighbouring_tracks_one_after_the_other(strategy: str, tractors: int) -> None:
    """Without that it leaves out tracks, as its turns are shorter then, and comes back for them."""
    context = prepare_context(WorkOrder(PlanRequest(field="netherlands", width_m=3.0, draft="plough")))
    run = run_candidate(context, Candidate(strategy, tractors)).run
    for mission in run.plan.missions:
        tracks = [leg.task.number for leg in mission.legs if leg.task.kind == SWATH and leg.implement]
        steps = np.diff([number for number in tracks if number is not None])
        assert (abs(steps) <= (1 if strategy == "split-field" else tractors)).all()


def test_what_is_crushed_on_the_way_into_a_crop_is_charged() -> None:
    """A strip as wide as the tractor for every pass that is crossed, like ground that is left; nothing on stubble."""
    request = PlanRequest(field="netherlands", width_m=6.0, operation="harvest", headland_passes=2)
    moves = get_site_moves(prepare_context(WorkOrder(request)))
    begins, ends = moves.edge_ways_s
    per_pass_s = LEFT_FACTOR * moves.site.rules.body_width_m / moves.site.rules.work_speed_mps
    numbers = np.array([line.task.number if line.is_side else 0 for line in moves.lines])
    assert begins[::2][numbers == 1] == pytest.approx(0.0)
    assert begins[::2][numbers == 2] == pytest.approx(per_pass_s)
    is_track = np.array([line.task.kind == SWATH for line in moves.lines])
    assert (begins[::2][is_track] >= 2.0 * per_pass_s).all() and (ends[::2][is_track] < per_pass_s).all()
