"""Whether a tractor can pull its implement: ASAE D497 by hand, and when the farmer is asked."""

from dataclasses import replace

import pytest
import shapely

from fields import Field
from planner.evaluation.preparation import prepare_context
from planner.evaluation.pull_check import compute_pull_figures, describe_pull
from planner.evaluation.work_order import WorkOrder
from planner.farm.machines import FarmTractor
from planner.pipeline.ranking import list_assumptions
from planner.request.plan_request import PlanRequest
from reports.plan.shortfall_wording import question_pull
from vehicle.datasheet.sheet import Datasheet
from vehicle.energy.draft import find_draft_rule
from vehicle.energy.load import find_drawbar_share
from vehicle.model.soil import find_soil
from vehicle.model.tractor import load_tractor

KMH = 1.0 / 3.6
EG105 = load_tractor("eg105")
SOILS = find_soil("clay"), find_soil("loam"), find_soil("sand")  # fine, medium and coarse, all firm


def test_draft_by_hand() -> None:
    """6 m at 12 km/h: 40 tines, each 0.85 x (46 + 2.8 x 12) x 10 cm; a drill of 3 m 300 N per row of 15 cm."""
    till, sow = find_draft_rule("till", 6.0), find_draft_rule("sow", 3.0)
    assert till.compute_draft_n(6.0, 12 * KMH) == pytest.approx(40 * 0.85 * 79.6 * 10)
    assert till.compute_power_kw(6.0, 12 * KMH) == pytest.approx(27.064 * 12 / 3.6)
    assert sow.compute_draft_n(3.0, 5 * KMH) == sow.compute_draft_n(3.0, 15 * KMH) == pytest.approx(20 * 300.0)
    assert all(find_draft_rule(name, 3.0) is None for name in ("spray", "harvest", "mow"))


def test_the_question_and_what_it_suggests() -> None:
    """What is suggested can be pulled, and a step more cannot."""
    pull = compute_pull_figures(PlanRequest(width_m=6.0, speed_mps=12 * KMH), EG105)
    assert pull.is_questioned and pull.available_kw == pytest.approx(find_drawbar_share(EG105) * 77)
    assert question_pull(pull) == (
        "Not feasible at this speed. The 6 m cultivator needs about 90 kW at the drawbar at 12 km/h; this tractor has "
        f"about 56 kW. Feasible: {pull.possible_speed_kmh:g} km/h (--speed-kmh {pull.possible_speed_kmh:g}) or "
        f"{pull.possible_width_m:.1f} m (--width {pull.possible_width_m:g}). A cultivator is assumed; --draft names "
        "another implement."
    )
    assert "27 kN 10 cm deep" in describe_pull(pull, find_draft_rule("till", 6.0))[0]
    assert pull.possible_width_m is not None and pull.possible_speed_kmh is not None
    for width_m, speed_kmh in ((pull.possible_width_m, 12.0), (6.0, pull.possible_speed_kmh)):
        more = (width_m + 0.5, speed_kmh) if width_m < 6 else (width_m, speed_kmh + 0.5)
        for (width, speed), expected in (((width_m, speed_kmh), False), (more, True)):
            one = compute_pull_figures(PlanRequest(width_m=width, speed_mps=speed * KMH), EG105)
            assert one.is_questioned is expected


def test_fine_soil_pulls_harder_and_the_sentence_names_it() -> None:
    """A cultivator: a factor of 1 in fine soil and of 0.65 in coarse soil, where that of medium soil is 0.85."""
    request = PlanRequest(width_m=6.0, speed_mps=12 * KMH)
    fine, medium, coarse = (compute_pull_figures(request, EG105, soil=soil) for soil in SOILS)
    assert fine.needed_kw == pytest.approx(medium.needed_kw / 0.85)
    assert coarse.draft_kn == pytest.approx(medium.draft_kn * 0.65 / 0.85)
    assert fine.possible_width_m < medium.possible_width_m
    assert fine.possible_speed_kmh < medium.possible_speed_kmh
    assert "in fine soil, is that of ASAE D497" in describe_pull(fine, find_draft_rule("till", 6.0), SOILS[0])[0]


def test_the_soil_of_a_plan_is_asked_about() -> None:
    wide = PlanRequest(field="drawn", no_headland=True, soil="clay", width_m=6.0, speed_mps=12 * KMH)
    context = prepare_context(WorkOrder(wide, Field("drawn", shapely.box(0, 0, 90, 90))))
    assert any("in fine soil, is that of ASAE D497" in sentence for sentence in list_assumptions(context))


def test_no_question_where_it_can_be_pulled_or_nothing_is_known() -> None:
    usual = compute_pull_figures(PlanRequest(), EG105)
    assert usual is not None and question_pull(usual) == "" and describe_pull(usual, find_draft_rule("till", 3.0)) == ()
    heavy = PlanRequest(width_m=6.0, speed_mps=12 * KMH)
    assert compute_pull_figures(heavy, EG105.model_copy(update={"engine": None})) is None and question_pull(None) == ""
    assert compute_pull_figures(PlanRequest(operation="mow", width_m=9.0, speed_mps=5.0), EG105) is None


def test_the_power_of_a_farm_wins() -> None:
    heavy = PlanRequest(width_m=6.0, speed_mps=12 * KMH)
    strong = compute_pull_figures(heavy, EG105, FarmTractor(name="a", power_kw=200.0))
    assert not strong.is_questioned and strong.engine_kw == 200.0
    sheet = Datasheet(wheelbase_m=2.4, width_m=2.0, turning_radius_m=5.0, power_kw=40.0)
    weak = compute_pull_figures(heavy, EG105, FarmTractor(name="b", sheet=sheet))
    assert weak.engine_kw == 40.0 and weak.is_questioned


def test_nothing_senseless_is_suggested() -> None:
    pull = compute_pull_figures(PlanRequest(width_m=40.0, speed_mps=25 * KMH), EG105)
    assert pull.possible_speed_kmh is None and pull.possible_width_m is None
    assert "Use a stronger tractor." in question_pull(pull)


def test_only_what_even_the_lightest_implement_cannot_do_is_infeasible() -> None:
    """A field cultivator pulls 30 % less or more than the mean: 56 kW are enough for 80 kW less 30 %, not for 81."""
    asked = compute_pull_figures(PlanRequest(width_m=6.0, speed_mps=12 * KMH), EG105)
    assert asked.range_pct == 30.0 and asked.is_assumed
    near, over = (replace(asked, needed_kw=asked.available_kw / share) for share in (0.701, 0.699))
    assert near.is_questioned and not near.is_infeasible and over.is_infeasible
    assert question_pull(near).endswith(f"or {asked.possible_width_m:.1f} m (--width {asked.possible_width_m:g}).")
    assert ": check it, or try " in question_pull(near)
    named = compute_pull_figures(PlanRequest(width_m=6.0, speed_mps=12 * KMH, draft="cultivator"), EG105)
    assert named.is_infeasible and "assumed" not in question_pull(named)
