"""Corners by what is quicker, and how far machines reach over open edges: as planned, and as measured."""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
import shapely

from planner.evaluation.candidates.evaluate import Candidate, run_candidate, simulate_candidate
from planner.evaluation.candidates.figures import CandidateRun, measure_candidate
from planner.evaluation.context import PlanningContext
from planner.evaluation.ground.contact_places import measure_overhang
from planner.evaluation.machine_outlines import build_body
from planner.evaluation.preparation import prepare_context
from planner.evaluation.work_order import WorkOrder
from planner.request.plan_request import PlanRequest
from reports.common.plan_records import Remark, Stake
from reports.common.plan_results import PlanResult
from tests.examples import seldom
from vehicle.missions.plan import ROUTE, Leg, LegTask, Mission, Plan
from vehicle.sim.world import simulate

pytestmark = pytest.mark.usefixtures("first_layout")

RECTANGLE = shapely.box(0, 0, 110, 66)
CHOSEN = (("sweden", 6.0),)
"""Samples and widths that are compared in every run of CI, where drawn outlines are compared too."""
CHAMFERED = shapely.Polygon([(6, 0), (110, 0), (110, 66), (0, 66), (0, 6)])


def work(site: PlanningContext) -> PlanResult:
    return simulate_candidate(site, Candidate("split-field", 1)).result


def list_legs(site: PlanningContext) -> tuple[Leg, ...]:
    """The legs of one tractor."""
    return run_candidate(site, Candidate("split-field", 1)).run.plan.missions[0].legs


def sum_length_m(site: PlanningContext) -> float:
    """The way that one tractor drives."""
    return sum(leg.length_m for leg in list_legs(site))


@pytest.fixture(scope="module")
def lay(place: Callable[..., PlanningContext]) -> Callable[..., PlanningContext]:
    """A field of an outline, its headland worked."""
    return cache(lambda outline=RECTANGLE, **options: place(outline, no_headland=False, **options))


@pytest.mark.slow
@pytest.mark.parametrize(("outline", "width_m"), [
    (CHAMFERED, 3.0), (RECTANGLE, 6.0),
    *(pytest.param(*one, marks=pytest.mark.matrix) for one in ((RECTANGLE, 3.0), (CHAMFERED, 6.0))),
])  # fmt: skip
def test_auto_is_quick_and_misses_little(lay: Any, outline: shapely.Polygon, width_m: float) -> None:
    """As quick as round corners, with the missed ground finished, where these miss little; else it misses less."""
    auto, square, rounded = (work(lay(outline, width_m=width_m, corners=one)) for one in ("auto", "square", "round"))
    assert auto.feasible and square.feasible and rounded.feasible
    auto_s, square_s, rounded_s = (one.finished_s or math.inf for one in (auto, square, rounded))
    tips_pct = square.worked_pct - rounded.worked_pct
    assert auto_s <= 1.005 * square_s and auto.worked_pct >= square.worked_pct - 0.7
    assert tips_pct > 0.2 or auto_s <= 1.005 * rounded_s


@pytest.mark.slow
@pytest.mark.parametrize("corners", ["auto", *seldom("square", "round")])
def test_nothing_reaches_farther_than_asked(lay: Any, corners: str) -> None:
    """As planned and driven; the guidance errs by some centimetres."""
    loose, tight = (work(lay(corners=corners, overhang_m=metres)) for metres in (5.0, 0.5))
    assert tight.feasible and (tight.outside_m or 0.0) <= 0.7 and (tight.outside_along_m or 0.0) < 2.0
    assert (loose.outside_m or 0.0) > 1.0 and loose.outside_along_m == 0.0


@pytest.mark.slow
def test_a_wide_overhang_changes_nothing(lay: Any) -> None:
    """Where nothing reaches as far as allowed, square corners are those of any larger overhang."""
    far, farther = (list_legs(lay(corners="square", overhang_m=metres)) for metres in (8.0, 80.0))
    assert len(far) == len(farther)
    assert all(np.array_equal(a.points, b.points) for a, b in zip(far, farther, strict=True))


@pytest.mark.slow
def test_open_edges_lift_the_limit_of_planned_paths(lay: Any) -> None:
    """Paths are those of an overhang that nothing reaches; those of half a metre are others."""
    options: tuple[dict[str, Any], ...] = ({"overhang_m": 80.0}, {"open_edges": True}, {})
    wide_m, opened_m, closed_m = (sum_length_m(lay(corners="square", **one)) for one in options)
    assert opened_m == pytest.approx(wide_m, rel=0.03)  # where two tours cost the same either may be found
    assert closed_m != pytest.approx(wide_m, abs=0.01)


@pytest.mark.slow
def test_a_remark_says_what_reaches_too_far(lay: Any) -> None:
    site = lay(shapely.Polygon([(0, 0), (110, 0), (0, 44)]), corners="square", overhang_m=9.0)
    evaluation = simulate_candidate(site, Candidate("split-field", 1))
    assert "beyond the outline" not in (evaluation.result.remark or "") and evaluation.run is not None
    strict = replace(site, request=replace(site.request, overhang_m=0.2))
    others = (
        Remark(Stake.NOTHING, "in one place"),
        Remark(Stake.TIME, "reversing"),
        Remark(Stake.LIFE, "rolling over"),
    )
    result = measure_candidate(strict, "split-field", 1, CandidateRun(evaluation.run, None, "none", others))
    assert (result.outside_along_m or 0.0) > 1.0
    worst, beyond, *less = result.remarks
    assert f"reach up to {result.outside_m:.1f} m beyond the outline" in beyond
    assert worst == "rolling over" and less[-2:] == ["reversing", "in one place"]


def drive_straight(site: PlanningContext, from_x: float, to_x: float, y: float) -> Plan:
    line = np.array([(from_x, y), (to_x, y)])
    return Plan((Mission((Leg(line, 1.0, task=LegTask(ROUTE)),)),))


def test_measured_by_hand(lay: Any) -> None:
    """A tractor stops with its guided point 1 m inside the east edge: its nose is over it by what it leads, less 1."""
    site = lay(overhang_m=0.5)
    boxes = build_body(site.tractor, site.implement)
    nose_m = max(front for _, front, _ in boxes.boxes) - boxes.guide_m
    run = simulate(drive_straight(site, 60.0, 109.0, 33.0), site.tractor, site.implement)
    measured = measure_overhang(run, site)
    assert measured.farthest_m == pytest.approx(nose_m - 1.0, abs=0.15)
    assert measured.beyond_m == pytest.approx(nose_m - 1.0 - 0.5, abs=0.3)


def test_nothing_outside_is_nothing(lay: Any) -> None:
    site = lay()
    run = simulate(drive_straight(site, 30.0, 80.0, 33.0), site.tractor, site.implement)
    measured = measure_overhang(run, site)
    assert (measured.farthest_m, measured.beyond_m) == (0.0, 0.0)


@pytest.mark.slow
def test_mirrored_fields_are_driven_alike(lay: Any) -> None:
    mirrored = shapely.Polygon([(-x, y) for x, y in CHAMFERED.exterior.coords])
    here_m, there_m = (sum_length_m(lay(outline, bearing_deg=90.0)) for outline in (CHAMFERED, mirrored))
    assert here_m == pytest.approx(there_m, rel=0.01)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "width_m", "speed_kmh"), [
    pytest.param(name, *machine, marks=() if (name, machine[0]) in CHOSEN else pytest.mark.matrix)
    for name in ("denmark", "netherlands", "sweden")
    for machine in ((3.0, 15.0), (6.0, 10.0), (12.0, 12.0))
])  # fmt: skip
def test_samples_at_ordinary_speeds(name: str, width_m: float, speed_kmh: float) -> None:
    auto, square, rounded = (
        work(
            prepare_context(WorkOrder(PlanRequest(field=name, width_m=width_m, speed_mps=speed_kmh / 3.6, corners=one)))
        )
        for one in ("auto", "square", "round")
    )
    assert auto.feasible, auto.reason
    others_s = [one.finished_s for one in (square, rounded) if one.feasible and one.finished_s]
    auto_s, misses_less = auto.finished_s or math.inf, auto.worked_pct > rounded.worked_pct + 0.2
    assert auto_s <= 1.03 * (max(others_s) if misses_less else min(others_s))
    assert (auto.outside_along_m or 0.0) < 20.0
