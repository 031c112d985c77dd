"""Sowing and spraying: ways by the headland and forwards, and what is driven over all the same is told and charged."""

from dataclasses import fields, replace
from typing import Any

import pytest
import shapely

from planner.evaluation.candidates.evaluate import Candidate, Outcome, simulate_candidate
from planner.evaluation.candidates.figures import CandidateRun, measure_candidate
from planner.evaluation.context import PlanningContext
from vehicle.missions.run import find_longest_reversing

pytestmark = pytest.mark.usefixtures("first_layout")

# An L and a field whose swaths end at 45 degrees.
ELL = shapely.Polygon([(0, 0), (220, 0), (220, 90), (90, 90), (90, 220), (0, 220)])
SLANTED = shapely.Polygon([(0, 0), (260, 0), (410, 150), (150, 150)])


@pytest.fixture(scope="module")
def sown(place: Any) -> tuple[PlanningContext, Outcome]:
    site = place(ELL, no_headland=False, operation="sow", width_m=4.0, speed_mps=3.0)
    return site, simulate_candidate(site, Candidate("interleaved", 2))


@pytest.mark.slow
def test_no_long_way_is_driven_in_reverse(sown: tuple[PlanningContext, Outcome]) -> None:
    site, found = sown
    assert found.run is not None and found.result.feasible
    longest_m, limit_m = find_longest_reversing(found.run)[0], site.driving_rules.max_reverse_m
    assert longest_m <= 1.5 * limit_m
    assert ("reverses" in (found.result.remark or "")) == (longest_m > limit_m + 0.5)


def test_what_is_driven_over_is_charged_like_missed_ground(sown: tuple[PlanningContext, Outcome]) -> None:
    _, found = sown
    plan = found.result
    assert plan.spoilt_m2 == plan.over_finished_m2
    area_m2, time_s = ELL.area, plan.time_s or 0.0
    missed_m2, spoilt_m2 = plan.missed_m2 or 0.0, plan.over_finished_m2 or 0.0
    assert spoilt_m2 > 0.0 and (plan.over_finished_m or 0.0) > 0.0
    expected_s = time_s * (1.0 + (missed_m2 + spoilt_m2) / (area_m2 - missed_m2))
    assert plan.finished_s == pytest.approx(expected_s, rel=1e-6)


def test_tillage_is_told_and_not_charged(place: Any) -> None:
    site = place(shapely.box(0, 0, 60, 120), no_headland=False, width_m=4.0)
    plan = simulate_candidate(site, Candidate("split-field", 1)).result
    assert plan.spoilt_m2 is None and plan.over_finished_m2 is not None
    missed_m2 = plan.missed_m2 or 0.0
    assert plan.finished_s == pytest.approx((plan.time_s or 0.0) * (1.0 + missed_m2 / (7200.0 - missed_m2)), rel=1e-6)


@pytest.mark.parametrize("width_m", [12.0, 24.0])
def test_slanted_ends_do_not_block_the_headland(place: Any, width_m: float) -> None:
    # One pass of headland: the corners of the swaths reach far into it, and it still leads all the way round.
    site = place(SLANTED, no_headland=False, operation="sow", width_m=width_m, headland_m=width_m, bearing_deg=90.0)
    plan = simulate_candidate(site, Candidate("split-field", 1)).result
    assert site.layout.headland_passes == 1
    assert plan.feasible, plan.reason
    assert plan.worked_pct > 90.0


@pytest.mark.slow
@pytest.mark.parametrize("operation", ["sow", "till"])
def test_a_plan_that_is_not_shown_has_the_figures_it_is_chosen_by(
    sown: tuple[PlanningContext, Outcome], operation: str
) -> None:
    """Where finished ground is charged what wheels go over decides too."""
    site, found = sown
    assert found.run is not None
    tilled, run = replace(site, request=replace(site.request, operation=operation)), CandidateRun(found.run, None, "")
    shown, hidden = (measure_candidate(tilled, "interleaved", 2, run, is_shown=each) for each in (True, False))
    others = {one.name for one in fields(shown) if getattr(shown, one.name) != getattr(hidden, one.name)}
    wheels = {"wheel_traffic_m2", "over_finished_m", "over_finished_m2"}
    assert others - {"remarks"} == {"outside_m", "outside_along_m"} | (wheels if operation == "till" else set())
    assert {getattr(hidden, name) for name in others - {"remarks"}} == {None}
