"""What keeps the best plan from being a recommendation: the share of the ground asked for, and the true reason."""

from dataclasses import replace

import pytest
import shapely

from fields.geometry.field import Field
from fields.geometry.obstacles import Obstacle
from planner.evaluation.context import PlanningContext
from planner.evaluation.ground.unworked_area import KEPT_HEADLAND, find_unworked_areas, mark_worked_shares
from planner.evaluation.preparation import prepare_context
from planner.evaluation.site import get_site_moves
from planner.evaluation.work_order import WorkOrder
from planner.farm.machines import FarmImplement, FarmTractor
from planner.farm.settings import FarmPrices
from planner.pipeline.ranking import rank_plans
from planner.request.plan_request import PlanRequest
from planner.risk.costs import CostTerms, are_prices_given
from reports.common.plan_results import PlanResult

pytestmark = pytest.mark.usefixtures("first_layout")


def build_context(*, is_divided: bool = False, no_headland: bool = False, **more: object) -> PlanningContext:
    """A field of 60 x 80 m, with or without a ditch across it that leaves two parts of 2,355 and 2,325 m2."""
    ditch = Obstacle("ditch", shapely.LineString([(-5, 40.2), (65, 40.2)]), 0.75)
    field = Field("plot", shapely.box(0, 0, 60, 80), obstacles=(ditch,) if is_divided else ())
    return prepare_context(WorkOrder(PlanRequest(field="plot", no_headland=no_headland, **more), field))  # type: ignore[arg-type]


def build_result(worked_pct: float, **more: object) -> PlanResult:
    """A plan of some minutes that works so much of the field."""
    values = {"time_s": 600.0, "finished_s": 60_000.0 / worked_pct, "cost": 10.0, "worked_pct": worked_pct} | more
    return PlanResult("split-field", 1, "u", True, **values)  # type: ignore[arg-type]


def test_from_ninety_percent_on_a_plan_is_a_recommendation() -> None:
    context = build_context()
    assert rank_plans(context, [build_result(90.0)]).shortfalls == ()
    (lacking,) = rank_plans(context, [build_result(89.9)]).shortfalls
    assert lacking.kind == "worked"
    assert lacking.sentence.startswith(
        "No recommendation: only 89.9 % of the field is worked; 10 % is reached by no pass"
    )


@pytest.mark.parametrize(("start_s", "told"), [(8 * 3600, "In time with --start 07:55."), (120, "")])
def test_where_no_plan_is_in_time_the_start_that_would_be_is_told(start_s: int, told: str) -> None:
    """Ten minutes of work in five; nothing can begin before midnight."""
    context = build_context(start_s=start_s, deadline_s=start_s + 300, samples=0)
    (late,) = rank_plans(context, [build_result(97.0, meets_deadline=False)]).shortfalls
    assert (late.kind, late.sentence) == ("late", told)


@pytest.mark.parametrize(("hours", "told"), [(4.0, "In time with --start 21:00."), (24.5, "")])
def test_no_start_is_told_before_a_deadline_that_is_the_next_days(hours: float, told: str) -> None:
    context = build_context(start_s=22 * 3600, deadline_s=3600, samples=0)
    (late,) = rank_plans(context, [build_result(97.0, meets_deadline=False, time_s=3600.0 * hours)]).shortfalls
    assert late.sentence == told


def test_ground_behind_a_ditch_is_named_as_such() -> None:
    (lacking,) = rank_plans(build_context(is_divided=True), [build_result(48.0)]).shortfalls
    assert lacking.sentence == "No recommendation: only 48.0 % of the field is worked; 49 % is cut off by obstacles."


def test_a_headland_that_is_kept_free_is_not_asked_for() -> None:
    """The share is that of the ground inside it."""
    context = build_context(no_headland=True)
    kept_m2 = sum(one.area_m2 for one in find_unworked_areas(context) if one.reason == KEPT_HEADLAND)
    inside_pct = 100.0 - kept_m2 / 48.0
    assert inside_pct < 85.0
    enough, little = mark_worked_shares([build_result(0.901 * inside_pct), build_result(0.899 * inside_pct)], context)
    assert enough.works_enough and not little.works_enough
    (lacking,) = rank_plans(context, [little]).shortfalls
    assert lacking.sentence.startswith("No recommendation: only 89.9 % of the ground asked for is worked; ")


@pytest.mark.parametrize("samples", [0, 20])
def test_a_plan_that_works_enough_wins_over_a_quicker_one(samples: int) -> None:
    context = build_context(samples=samples, objective="cheapest" if samples else None)
    quick, whole = build_result(60.0), replace(build_result(97.0, cost=30.0), strategy="interleaved", time_s=2000.0)
    if samples:
        figures = {"p50_s": 700.0, "p95_s": 800.0, "expected_cost_error": 0.0}
        quick, whole = (replace(one, expected_cost=one.cost, paid_cost=one.cost, **figures) for one in (quick, whole))
    ranking = rank_plans(context, [quick, whole])
    assert ranking.best.strategy == "interleaved" and ranking.is_recommended


def test_an_implement_that_cannot_be_pulled_is_a_shortfall_and_one_that_may_be_is_a_question() -> None:
    kinds = []
    for kmh in (9.0, 12.0):
        ranking = rank_plans(build_context(width_m=6.0, speed_mps=kmh / 3.6), [build_result(97.0)])
        assert ranking.pull.is_questioned
        kinds.append([one.kind for one in ranking.shortfalls])
        assert bool(ranking.eligible) == bool(ranking.by_count) == (not ranking.pull.is_infeasible)
    assert kinds == [[], ["pull"]]


def test_prices_are_assumed_only_where_nobody_gave_them() -> None:
    assumed, given = (
        rank_plans(build_context(**more), [build_result(97.0)]) for more in ({}, {"price_per_hour": 40.0})
    )  # type: ignore[arg-type]
    assert assumed.prices_assumed and not given.prices_assumed
    assert assumed.scenario["price_per_hour"] == given.scenario["price_per_hour"] == 40.0
    priced = FarmPrices(late_per_ha=9.0), FarmTractor(name="one", price=1.0), FarmImplement(name="drill", width_m=3.0)
    plain = FarmPrices(currency="SEK"), FarmTractor(name="one"), FarmImplement(name="drill", width_m=3.0, price=2.0)
    hired = PlanRequest(price_per_tractor=60.0)
    assert are_prices_given(hired, None) and not are_prices_given(PlanRequest(), None)
    assert not are_prices_given(hired, CostTerms(plain[0], plain[1], priced[2])), "what a farm file leaves open"
    for prices, tractor, implement in ((priced[0], *plain[1:]), (plain[0], priced[1], priced[2]), plain):
        assert are_prices_given(PlanRequest(), CostTerms(prices, tractor, implement))


def test_tracks_without_room_are_no_headland_that_is_kept() -> None:
    """Between closed edges 9 m apart the outer two of 8 tracks have no room: they are due, and told as such."""
    request = PlanRequest(no_headland=True, width_m=1.2, bearing_deg=90.0, overhang_m=0.0, tractors=(1,))
    site = prepare_context(WorkOrder(request, Field("strip", shapely.box(0.0, 0.0, 100.0, 9.0))))
    why = {one.reason: one.area_m2 for one in find_unworked_areas(site)}
    missing = site.layout.track_count - len({line.task.number for line in get_site_moves(site).lines})
    assert missing > 0
    length_m = site.layout.swaths[0].length_m
    assert why["on tracks that the machine has no room to work"] == pytest.approx(missing * 1.2 * length_m, rel=0.1)
    assert why[KEPT_HEADLAND] == pytest.approx(9.0 * (100.0 - length_m), rel=0.1)
