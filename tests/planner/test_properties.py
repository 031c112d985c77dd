"""What holds for every plan on every field: random convex fields, all strategies, small fleets."""

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from fields import Field, FieldError
from planner.evaluation.candidates.evaluate import Candidate, run_candidate, simulate_candidate
from planner.evaluation.context import PlanningContext
from planner.evaluation.preparation import prepare_context
from planner.evaluation.work_order import WorkOrder
from planner.pipeline.executors import SerialExecutor
from planner.pipeline.planning import plan_order
from planner.request.plan_request import PlanRequest
from strategies.programmes.move_estimates import CUTS_M
from strategies.registry import STRATEGIES
from tests.planner.excursions import measure_excursion_m
from vehicle.missions.plan import MAX_JOINT_GAP_M, check_plan
from vehicle.missions.plan_file import format_plan, parse_plan
from vehicle.missions.run import DONE, SimulationRun

FEW = settings(max_examples=5)


@st.composite
def sites(draw: Any) -> PlanningContext:
    """A convex field of 0.3 to 1.5 ha, somewhere, turned somehow."""
    count = draw(st.integers(3, 7))
    angles = sorted(draw(st.lists(st.floats(0, 2 * math.pi), min_size=count, max_size=count)))
    across, along = draw(st.floats(20, 50)), draw(st.floats(50, 90))
    corners = [(across * math.cos(a), along * math.sin(a)) for a in angles]
    hull = shapely.convex_hull(shapely.MultiPoint(corners))
    assume(hull.geom_type == "Polygon" and hull.area > 3000)
    turned = shapely.affinity.rotate(hull, draw(st.floats(0, 360)), origin=(0, 0))
    try:
        return prepare_context(WorkOrder(PlanRequest(field="random", no_headland=True), Field("random", turned)))
    except FieldError:
        assume(False)
        raise


def worked_lengths(site: PlanningContext, run: SimulationRun) -> dict[int, float]:
    """Metres of working legs per line, wherever the plan has them."""
    layout, lengths = site.layout, dict.fromkeys((track.line for track in site.layout.swaths), 0.0)
    aside = np.array([-math.sin(layout.bearing_rad), math.cos(layout.bearing_rad)])
    offsets = {track.line: float(np.dot(track.start_m, aside)) for track in layout.swaths}
    for mission in run.plan.missions:
        for leg in mission.legs:
            if leg.implement:
                place = float(leg.points.mean(axis=0) @ aside)
                line = min(offsets, key=lambda k: abs(offsets[k] - place))
                assert abs(offsets[line] - place) < 1e-6
                lengths[line] += leg.length_m
    return lengths


@pytest.mark.slow
@FEW
@given(site=sites(), name=st.sampled_from(sorted(STRATEGIES)), tractors=st.integers(1, 4))
def test_every_plan_is_sound_or_refused_with_a_reason(site: PlanningContext, name: str, tractors: int) -> None:
    evaluation = simulate_candidate(site, Candidate(name, tractors))
    result, run = evaluation.result, evaluation.run
    if run is None:
        assert not result.feasible and result.time_s is None
        assert result.reason.endswith(".") and "\n" not in result.reason
        return
    check_plan(run.plan)
    for mission in run.plan.missions:
        assert all(math.dist(a.points[-1], b.points[0]) <= MAX_JOINT_GAP_M for a, b in pairwise(mission.legs))
    lengths = dict.fromkeys((track.line for track in site.layout.swaths), 0.0)
    for track in site.layout.swaths:
        lengths[track.line] += track.length_m
    cut_m = 2.0 * max(cut for cuts in CUTS_M for cut in cuts)
    for line, worked_m in worked_lengths(site, run).items():
        assert worked_m < lengths[line] + 1e-6, "ends are cut off where no move leads from and to the whole line"
        assert worked_m > lengths[line] - cut_m - 1e-6 or any("left (" in remark for remark in result.remarks)
    again = parse_plan(format_plan(run.plan))
    assert format_plan(again) == format_plan(run.plan)
    assert set(result.turn.split("+")) <= {"u", "omega", "switch-back", "route", "none"}
    if not result.feasible:
        assert result.reason
        return
    assert result.reason is None and run.outcome == DONE
    assert run.contacts == () and result.collisions == 0
    assert measure_excursion_m(run, site) < 0.5
    assert (result.min_clearance_m is None) == (tractors == 1)
    assert result.min_clearance_m is None or result.min_clearance_m > 0
    longest = max(sum(leg.length_m / leg.speed_mps for leg in m.legs) for m in run.plan.missions)
    # Guidance cuts corners by a little, so the path may be a trace shorter than planned.
    assert run.duration_s >= 0.98 * longest
    assert 0 < result.time_s <= result.tractor_time_s + 1e-9 <= result.tractors * result.time_s + 1e-6
    assert result.cost == pytest.approx(result.tractors * result.time_s / 3600 * 40)
    assert 0 < result.worked_pct <= 100 and 0 <= result.overlap_pct < 60
    swaths = [shapely.LineString([t.start_m, t.end_m]).buffer(1.5, cap_style="flat") for t in site.layout.swaths]
    planned = 100 * shapely.union_all(swaths, grid_size=1e-6).intersection(site.layout.field.boundary).area
    assert result.worked_pct == pytest.approx(planned / site.layout.field.area_m2, abs=3.0)
    assert result.turning_s + result.waiting_s < result.tractor_time_s + 1.0


def test_more_tractors_than_tracks_are_refused_with_a_reason(small_site: PlanningContext) -> None:
    for name in STRATEGIES:
        result = simulate_candidate(small_site, Candidate(name, 30)).result
        assert not result.feasible and result.time_s is None and result.rank is None
        assert "30 tractors" in (result.reason or "") and "12" in (result.reason or "")


@pytest.mark.slow
def test_sides_of_the_headland_are_work_for_tractors_without_a_track() -> None:
    """One track and the sides of two passes round it."""
    names = ("split-field", "row-by-row")
    request = PlanRequest(width_m=6.0, headland_passes=2, tractors=(1, 2), strategies=names, bearing_deg=90.0)
    strip = Field("strip", shapely.box(0.0, 0.0, 120.0, 30.0))
    ranking = plan_order(WorkOrder(request, field=strip, simulates_all=True), executor=SerialExecutor()).ranking
    one, two = (ranking.by_count[count] for count in (1, 2))
    assert (two.time_s or 0.0) < 0.7 * (one.time_s or 0.0) and (two.worked_pct or 0.0) > (one.worked_pct or 0.0) - 1.0
    assert {"2 tractors in formation need 2 tracks, and there is work on 1; use split-field or interleaved."} == {
        plan.reason for plan in ranking.plans if not plan.feasible and "formation" in (plan.reason or "")
    }


def test_worked_share_is_that_of_the_tracks(small_site: PlanningContext, evaluate_once: Any) -> None:
    # 12 tracks of 3 m cover the whole width of 36 m; both headlands are left.
    expected = 100 * (80 - 2 * small_site.layout.headland_m) / 80
    for name in ("split-field", "interleaved"):
        result = evaluate_once(small_site, name, 2)
        assert result.worked_pct == pytest.approx(expected, abs=1.0)


def test_a_plan_read_back_drives_the_same(small_site: PlanningContext) -> None:
    from vehicle.sim.world import simulate

    run = run_candidate(small_site, Candidate("interleaved", 2)).run
    again = simulate(parse_plan(format_plan(run.plan)), small_site.tractor, small_site.implement)
    assert again.duration_s == run.duration_s
    assert np.array_equal(again.record, run.record)


@pytest.mark.parametrize("turn", ["omega", "switch-back", "u"])
def test_a_forced_turn_is_the_one_driven(place: Any, turn: str) -> None:
    site = place(shapely.box(0, 0, 45, 90), turn=turn)
    result = simulate_candidate(
        site, Candidate("interleaved", 3) if turn == "u" else Candidate("split-field", 1)
    ).result
    assert result.feasible, result.reason
    assert turn != "u" or result.turn == "u"
    assert set(result.turn.split("+")) <= {"u", turn}


def test_a_forced_headland_and_bearing_are_used(place: Any) -> None:
    site = place(shapely.box(0, 0, 60, 90), headland_m=12.0, bearing_deg=90.0)
    assert site.layout.headland_m == 12.0
    assert site.layout.bearing_deg == pytest.approx(90.0)
    assert max(swath.length_m for swath in site.layout.swaths) == pytest.approx(60 - 24, abs=1e-3)
