"""Probability and cost against count: drawn to scale, one point for every count, nothing without samples."""

from dataclasses import replace

import pytest

from reports.common.plan_results import PlanRanking, PlanResult
from reports.plan.ranking_page import build_risk_chart, render_plan_page


def plan(tractors: int, strategy: str, probability: float | None, cost: float) -> PlanResult:
    return PlanResult(
        strategy, tractors, "u", True, time_s=3600.0, cost=cost, finish_probability=probability, p50_s=3700.0,
        p95_s=4000.0, expected_cost=cost,
    )  # fmt: skip


PLANS = plan(2, "a", 0.97, 130.0), plan(1, "a", 0.61, 160.0), plan(2, "b", 0.99, 120.0), plan(4, "a", 0.995, 140.0)
RANKING = PlanRanking(
    "drawn", 1.0, 1, PLANS, currency="EUR", samples=1000, chosen=("a", 2), check_sentences=("Checked.",)
)


def test_points_are_to_scale_and_one_for_every_count() -> None:
    picture = build_risk_chart(RANKING)
    sure, money = picture["bands"]
    axis = sure["axis"]
    assert [(axis.first - point["y"]) / (axis.first - axis.last) for point in sure["points"]] == pytest.approx(
        [0.61, 0.97, 0.995], abs=1e-3
    )
    axis, top = money["axis"], 1.06 * 160.0
    assert [(axis.first - point["y"]) / (axis.first - axis.last) * top for point in money["points"]] == pytest.approx(
        [160.0, 130.0, 140.0], abs=0.1
    )
    assert [point["best"] for point in money["points"]] == [False, True, False]  # though another of two costs less
    one, two, four = picture["counts"].values()
    assert four - two == pytest.approx(2 * (two - one), abs=0.2)
    assert sure["axis"].first < money["axis"].last


def test_without_a_limit_there_is_cost_alone_and_without_draws_nothing() -> None:
    free = replace(RANKING, plans=tuple(replace(each, finish_probability=None) for each in RANKING.plans))
    picture = build_risk_chart(free)
    assert [band["name"] for band in picture["bands"]] == ["Cost, EUR"]
    undrawn = replace(free, plans=tuple(replace(each, expected_cost=None) for each in free.plans))
    assert build_risk_chart(undrawn) is None


@pytest.mark.parametrize("cost", [0.004, 0.7, 99.0, 101.0, 5_000.0, 3e7])
def test_ticks_are_few_and_inside(cost: float) -> None:
    picture = build_risk_chart(replace(RANKING, plans=(plan(1, "a", None, cost),), chosen=None))
    (band,) = picture["bands"]
    heights = [y for y, _ in band["ticks"]]
    assert 2 <= len(heights) <= 6 and min(heights) >= band["axis"].last and heights[0] == band["axis"].first


def test_the_page_shows_answer_curve_and_columns() -> None:
    page = render_plan_page(RANKING, None)
    assert "2 tractors, a: done in\N{NO-BREAK SPACE}" in page and "97\N{NO-BREAK SPACE}% sure" in page
    for words in ("Probability and cost", "In time, %", "Cost", "95 %", "Checked."):
        assert words in page
    plain = replace(RANKING, plans=(PlanResult("a", 1, "u", True, time_s=1.0),), chosen=None, check_sentences=())
    assert "Probability and cost" not in render_plan_page(plain, None)
