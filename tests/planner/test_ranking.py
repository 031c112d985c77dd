"""Order, Pareto front, deadline and cost of plans, by hand."""

import math
from dataclasses import replace
from itertools import pairwise
from typing import Any

import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from fields import Field
from planner.evaluation.candidates.evaluate import Candidate
from planner.evaluation.ground.unworked_area import KEPT_HEADLAND
from planner.pipeline.executors import SerialExecutor
from planner.pipeline.planning import plan
from planner.pipeline.ranking import list_candidates, rank_plans
from planner.request.plan_request import PlanRequest
from reports.common.plan_records import UnworkedPiece
from reports.common.plan_results import PlanRanking, PlanResult
from strategies.names import FIRST_OFFERED
from tests.examples import count_examples

QUICK = settings(max_examples=count_examples(60))
Row = tuple[int, float]


def result(tractors: int, time_s: float, **more: Any) -> PlanResult:
    values: dict[str, Any] = {
        "strategy": "split-field",
        "turn": "u",
        "feasible": True,
        "cost": tractors * time_s / 90.0,
    }
    return PlanResult(tractors=tractors, time_s=time_s, **values | more)


def refused(strategy: str, tractors: int) -> PlanResult:
    return PlanResult(strategy, tractors, "auto", False, "no room")


class TestOrder:
    def test_by_time_then_count_then_name_and_infeasible_last(self, small_site: Any) -> None:
        plans = [
            result(3, 500.0, strategy="b"), refused("y", 1), result(2, 400.0), result(2, 500.0),
            result(3, 500.0, strategy="a"), refused("x", 1),
        ]  # fmt: skip
        ranked = rank_plans(small_site, plans).plans
        assert [(p.rank, p.tractors, p.strategy) for p in ranked] == [
            (1, 2, "split-field"), (2, 2, "split-field"), (3, 3, "a"), (4, 3, "b"), (None, 1, "x"), (None, 1, "y"),
        ]  # fmt: skip

    @QUICK
    @given(st.lists(st.tuples(st.integers(1, 6), st.floats(10, 1000)), min_size=1, max_size=12), st.randoms())
    def test_does_not_depend_on_the_order_of_simulation(self, small_site: Any, rows: list[Row], random: Any) -> None:
        plans = [result(count, time, strategy=f"s{number}") for number, (count, time) in enumerate(rows)]
        first = rank_plans(small_site, plans)
        random.shuffle(plans)
        assert rank_plans(small_site, plans) == first


class TestFront:
    def test_by_hand(self, small_site: Any) -> None:
        rows = [(1, 900.0), (1, 950.0), (2, 500.0), (2, 480.0), (3, 490.0), (4, 480.0), (5, 300.0), (6, 310.0)]
        ranked = rank_plans(small_site, [result(*row, strategy=str(row)) for row in rows]).plans
        front = sorted((p.tractors, p.time_s) for p in ranked if p.on_pareto_front)
        assert front == [(1, 900.0), (2, 480.0), (5, 300.0)]

    def test_infeasible_plans_are_not_on_it(self, small_site: Any) -> None:
        quick = result(1, 10.0, feasible=False, reason="touches")
        ranked = rank_plans(small_site, [quick, result(2, 400.0)])
        assert [p.on_pareto_front for p in ranked.plans] == [True, False]
        assert ranked.best.tractors == 2

    @QUICK
    @given(st.lists(st.tuples(st.integers(1, 6), st.integers(10, 99)), min_size=1, max_size=15))
    def test_nothing_beats_it_and_it_beats_or_equals_everything(self, small_site: Any, rows: list[Row]) -> None:
        plans = rank_plans(small_site, [result(n, float(t), strategy=str(i)) for i, (n, t) in enumerate(rows)]).plans
        front = [(p.tractors, p.time_s or 0.0) for p in plans if p.on_pareto_front]
        assert front
        for count, time in front:
            assert not any(n <= count and t <= time and (n, t) != (count, time) for n, t in rows)
        for count, time in rows:
            assert any(n <= count and t <= time for n, t in front)
        assert all(a[0] < b[0] and a[1] > b[1] for a, b in pairwise(sorted(front)))


class TestBest:
    PLANS = (
        result(6, 300.0, rank=1, cost=50.0, meets_deadline=True),
        result(4, 400.0, rank=2, cost=44.0, meets_deadline=True),
        result(3, 500.0, rank=3, cost=44.0, meets_deadline=True),
        result(1, 900.0, rank=4, cost=20.0, meets_deadline=False),
    )

    def ranking(self, *plans: PlanResult) -> PlanRanking:
        return PlanRanking("f", 1.0, 1, plans)

    def test_with_a_deadline_it_is_the_cheapest_that_meets_it_and_has_the_fewest_tractors(self) -> None:
        assert self.ranking(*self.PLANS).best == self.PLANS[2]
        dearer = replace(self.PLANS[2], cost=44.9)  # 2 % of 44 is 0.88
        assert self.ranking(*self.PLANS[:2], dearer).best == self.PLANS[1]

    def test_when_none_meets_it_it_is_the_quickest_and_late(self) -> None:
        late = [result(2, 500.0 + i, rank=i + 1, cost=9.0 - i, meets_deadline=False) for i in range(3)]
        ranking = replace(self.ranking(*late), allowed_s=420.0)
        assert ranking.best == late[0]
        assert ranking.missed_by_s == pytest.approx(80.0)

    def test_nothing_is_late_where_a_plan_is_in_time_or_no_deadline_is(self) -> None:
        assert replace(self.ranking(*self.PLANS), allowed_s=450.0).missed_by_s is None
        assert self.ranking(*self.PLANS[3:]).missed_by_s is None
        assert replace(self.ranking(refused("x", 1)), allowed_s=450.0).missed_by_s is None

    def test_an_infeasible_plan_is_never_best(self) -> None:
        assert self.ranking(refused("x", 1)).best is None
        touches = result(2, 1.0, feasible=False, cost=0.0, meets_deadline=True)
        assert self.ranking(self.PLANS[3], touches).best == self.PLANS[3]


class TestEqualWork:
    """Plans are ranked by what they come to when what they leave open is worked at their own rate."""

    def part(self, share: float, tractors: int, time_s: float, **more: Any) -> PlanResult:
        return result(
            tractors, time_s, worked_pct=100 * share, finished_s=time_s / share,
            finished_cost=tractors * time_s / 90.0 / share, **more,
        )  # fmt: skip

    def test_whoever_leaves_more_has_to_be_quicker_by_as_much(self, small_site: Any) -> None:
        whole, half = self.part(1.0, 2, 500.0, strategy="whole"), self.part(0.5, 2, 300.0, strategy="half")
        quick = self.part(0.5, 2, 240.0, strategy="quick")
        ranked = rank_plans(small_site, [half, whole, quick]).plans
        assert [plan.strategy for plan in ranked] == ["quick", "whole", "half"]
        assert [plan.time_s for plan in ranked] == [240.0, 500.0, 300.0], "time stays what was driven"
        assert [plan.on_pareto_front for plan in ranked] == [True, False, False]

    @QUICK
    @given(st.lists(st.tuples(st.integers(1, 6), st.integers(10, 1000)), min_size=1, max_size=12), st.floats(0.2, 1.0))
    def test_equal_shares_are_ordered_as_driven(self, small_site: Any, rows: list[Row], share: float) -> None:
        def order(plans: list[PlanResult]) -> list[tuple[str, bool]]:
            return [(plan.strategy, plan.on_pareto_front) for plan in rank_plans(small_site, plans).plans]

        driven = [result(n, float(t), strategy=str(k)) for k, (n, t) in enumerate(rows)]
        assert order([self.part(share, n, float(t), strategy=str(k)) for k, (n, t) in enumerate(rows)]) == order(driven)

    def test_in_time_counts_who_could_finish_in_time_first(self) -> None:
        little = self.part(0.5, 1, 500.0, meets_deadline=True)
        whole = self.part(1.0, 3, 550.0, meets_deadline=True)
        late = self.part(1.0, 9, 700.0, meets_deadline=False)
        ranking = PlanRanking("f", 1.0, 1, (late, little, whole), allowed_s=600.0)
        assert ranking.best == whole, "though it costs more"
        assert replace(ranking, allowed_s=1000.0).best == little
        assert replace(ranking, plans=(late, little)).best == little
        assert ranking.missed_by_s is None

    def test_the_largest_piece_has_its_place_on_the_earth(self, small_site: Any) -> None:
        field = replace(small_site.layout.field, crs="EPSG:32632", origin_m=(500_000.0, 0.0))
        site = replace(small_site, layout=replace(small_site.layout, field=field))
        left = result(1, 100.0, largest_missed=UnworkedPiece(7.0, 0.0, 30.0))
        (plan,) = rank_plans(site, [left]).plans
        assert plan.largest_missed.lon == pytest.approx(9.0, abs=1e-9)
        # At the equator the meridian of WGS84 has the radius a (1 - e2) = 6,335,439 m; the scale of UTM is 0.9996.
        assert plan.largest_missed.lat == pytest.approx(math.degrees(30.0 / 0.9996 / 6_335_439.0), rel=1e-4)
        (local,) = rank_plans(small_site, [left]).plans
        assert local.largest_missed == left.largest_missed

    def test_a_plan_of_tracks_alone_is_charged_for_its_headlands(self, small_site: Any, evaluate_once: Any) -> None:
        plan = evaluate_once(small_site, "split-field", 2)
        area = small_site.layout.field.area_m2
        assert plan.missed_m2 == pytest.approx(area * (1 - plan.worked_pct / 100), rel=1e-6)
        assert plan.finished_s == pytest.approx(plan.time_s / (plan.worked_pct / 100), rel=1e-6)
        assert plan.finished_cost == pytest.approx(plan.cost * plan.finished_s / plan.time_s, rel=1e-9)
        assert plan.largest_missed.m2 == pytest.approx(36 * small_site.layout.headland_m, rel=0.02)
        assert min(plan.largest_missed.y_m, 80 - plan.largest_missed.y_m) < small_site.layout.headland_m
        assert plan.largest_missed.reason == KEPT_HEADLAND
        assert rank_plans(small_site, [plan]).best.largest_missed.reason == KEPT_HEADLAND


def test_what_was_planned_stands_in_the_ranking(small_site: Any) -> None:
    told = rank_plans(small_site, []).scenario
    # 36 m in lines of 3 m; 8.5 m is the half metre above 1.1 + 1.2 m to the implement, the turn, and half the width.
    assert (told["field"], told["width_m"], told["swaths"], told["headland_m"]) == ("drawn", 3.0, 12, 8.5)
    assert told["bearing_deg"] == pytest.approx(0.0) and told["speed_kmh"] == pytest.approx(5.0)
    assert told["tractor"] == small_site.tractor.name and told["radius_m"] == small_site.driving_rules.radius_m
    assert told["start"] is told["deadline"] is None


class TestCandidates:
    def test_every_combination_once(self) -> None:
        scenario = PlanRequest("f", tractors=(2, 5), strategies=("row-by-row", "split-field"))
        assert list_candidates(scenario) == [
            Candidate(name, count) for count in (2, 5) for name in ("row-by-row", "split-field")
        ]

    @pytest.mark.parametrize(
        ("asked", "tried"),
        [
            (FIRST_OFFERED, "row-by-row"),
            (("interleaved", "split-field"), "split-field"),
            (("col-by-col", "row-by-row"), "row-by-row"),
            (("interleaved",), "interleaved"),
        ],
    )
    def test_one_tractor_is_tried_once(self, asked: tuple[str, ...], tried: str) -> None:
        assert list_candidates(PlanRequest("f", tractors=(1,), strategies=asked)) == [Candidate(tried, 1)]


class TestMoney:
    @pytest.fixture(scope="class")
    @staticmethod
    def ranking() -> PlanRanking:
        scenario = PlanRequest(
            tractors=(1, 2, 3), strategies=("split-field",), price_per_hour=36.0, price_per_tractor=7.0,
            start_s=36000, deadline_s=36000 + 900, no_headland=True,
        )  # fmt: skip
        field = Field("small", shapely.box(0, 0, 36, 80))
        return plan(scenario, field=field, executor=SerialExecutor()).ranking

    def test_every_tractor_is_paid_until_the_last_is_done(self, ranking: PlanRanking) -> None:
        for one in ranking.plans:
            assert one.cost == pytest.approx(one.tractors * (one.time_s * 0.01 + 7.0))

    def test_tractor_time_is_at_most_the_time_hired(self, ranking: PlanRanking) -> None:
        for one in ranking.plans:
            assert one.time_s <= one.tractor_time_s <= one.tractors * one.time_s + 1e-9

    def test_deadline_divides_the_plans_and_the_cheapest_in_time_is_best(self, ranking: PlanRanking) -> None:
        verdicts = {p.tractors: p.meets_deadline for p in ranking.plans}
        assert verdicts == {p.tractors: p.stated_end_s <= 900.0 for p in ranking.plans}
        assert set(verdicts.values()) == {True, False}
        best = ranking.best
        in_time = [p for p in ranking.plans if p.meets_deadline]
        assert best.cost == min(p.cost or 0.0 for p in in_time)

    def test_the_assumptions_name_both_prices(self, ranking: PlanRanking) -> None:
        assert any("36 per hour and 7 per tractor" in sentence for sentence in ranking.assumptions)
        assert (ranking.start, ranking.deadline) == ("10:00", "10:15")
