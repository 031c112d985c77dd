"""The recommended number of tractors, and which of two plans that take as long: from tables written by hand."""

from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from reports.common.plan_results import PlanRanking, PlanResult, choose_by_count, choose_plan, is_share_different
from tests.examples import count_examples

QUICK = settings(max_examples=count_examples(60))


def build_plan(tractors: int, time_s: float, strategy: str = "split-field", **more: Any) -> PlanResult:
    """A plan that is driven in so many seconds at 40 an hour and tractor."""
    values: dict[str, Any] = {"cost": tractors * time_s / 90.0}
    return PlanResult(strategy, tractors, "u", True, time_s=time_s, **values | more)


def choose_count(times_s: dict[int, float]) -> int:
    return choose_plan([build_plan(count, time_s) for count, time_s in times_s.items()]).tractors


class TestWithoutPrices:
    @pytest.mark.parametrize(
        ("times_s", "count"),
        [
            # A fourth would save 4,000 s if it shared 16,000 s evenly; half of that is 2,000 s.
            ({1: 48000.0, 2: 24000.0, 3: 16000.0, 4: 14001.0}, 3),
            ({1: 48000.0, 2: 24000.0, 3: 16000.0, 4: 14000.0}, 4),
            # Of 7,200 s a second saves 3,600 s at best: 1,800 s are half, 1,799 s are less.
            ({1: 7200.0, 2: 5401.0}, 1),
            ({1: 7200.0, 2: 5400.0}, 2),
            # From two to five tractors an even split saves 3/5 of 20,000 s; half of that is 6,000 s.
            ({2: 20000.0, 5: 14001.0}, 2),
            ({2: 20000.0, 5: 14000.0}, 5),
            # A third is no help, whatever a fourth does; and one that is slower is none.
            ({2: 6000.0, 3: 5900.0, 4: 3000.0}, 2),
            ({1: 3600.0, 2: 3700.0}, 1),
            ({6: 1000.0}, 6),
            # On a small field a fourth saves less than the quarter of an hour that it takes to bring it.
            ({1: 6200.0, 2: 3150.0, 3: 2200.0, 4: 1750.0, 5: 1500.0, 6: 1478.0}, 3),
            ({1: 1800.0, 2: 901.0}, 1),
            ({1: 1800.0, 2: 900.0}, 2),
            # Two more together have to save twice as much.
            ({1: 3600.0, 3: 1801.0}, 1),
            ({1: 3600.0, 3: 1800.0}, 3),
        ],
    )
    def test_the_next_tractor_saves_half_of_an_even_split_and_the_time_to_bring_it(
        self, times_s: dict[int, float], count: int
    ) -> None:
        assert choose_count(times_s) == count

    @QUICK
    @given(st.integers(1, 12), st.floats(119_000.0, 1e6))
    def test_an_even_split_of_long_work_takes_all_tractors_and_no_help_one(self, most: int, time_s: float) -> None:
        """Of 33 hours the twelfth saves 15 minutes."""
        assert choose_count({count: time_s / count for count in range(1, most + 1)}) == most
        assert choose_count(dict.fromkeys(range(1, most + 1), time_s)) == 1


class TestWithPrices:
    def choose(self, costs: dict[int, float], **more: Any) -> int:
        plans = tuple(build_plan(count, 6000.0 / count, cost=cost) for count, cost in costs.items())
        best = PlanRanking("f", 1.0, 1, plans, **more).best
        return best.tractors

    def test_the_cheapest_number_and_fewer_where_the_cost_is_the_same(self) -> None:
        """2 % of 90 is 1.8: 91.8 is the same cost, 91.9 is not."""
        assert self.choose({1: 100.0, 2: 95.0, 3: 90.0, 4: 92.0}) == 3
        assert self.choose({1: 100.0, 2: 91.8, 3: 90.0, 4: 92.0}) == 2
        assert self.choose({1: 100.0, 2: 91.9, 3: 90.0, 4: 92.0}) == 3

    def test_assumed_prices_are_none(self) -> None:
        assert self.choose({1: 100.0, 2: 110.0, 3: 120.0}) == 1
        assert self.choose({1: 100.0, 2: 110.0, 3: 120.0}, prices_assumed=True) == 3
        assert self.choose({1: 0.0, 2: 0.0, 3: 0.0}) == 3

    def test_a_chosen_plan_and_a_deadline_go_before_the_knee(self) -> None:
        plans = tuple(build_plan(count, 6000.0 / count) for count in (1, 2))
        ranking = PlanRanking("f", 1.0, 1, plans, chosen=("split-field", 1), prices_assumed=True)
        assert ranking.best is plans[0] and not ranking.has_knee
        free = replace(ranking, chosen=None)
        assert free.best is plans[1] and free.has_knee
        judged = tuple(replace(plan, meets_deadline=plan.tractors == 1) for plan in plans)
        bound = replace(free, plans=judged, allowed_s=9000.0)
        assert bound.best is judged[0] and not bound.has_knee


class TestEqualTimes:
    """Within 2 % of 1,000 s: works more, then keeps more distance, then reverses less, then waits less."""

    BEST = build_plan(
        2, 1020.0, "z", worked_pct=99.0, min_clearance_m=2.0, reversals=4, waiting_s=60.0, finished_s=1020.0
    )

    @pytest.mark.parametrize(
        "worse",
        [
            {"worked_pct": 98.9, "min_clearance_m": 9.0, "reversals": 0, "waiting_s": 0.0},
            {"min_clearance_m": 1.9, "reversals": 0, "waiting_s": 0.0},
            {"reversals": 5, "waiting_s": 0.0},
            {"waiting_s": 61.0},
            {"worked_pct": 99.04, "min_clearance_m": 2.04, "waiting_s": 61.0},  # printed alike
        ],
    )
    def test_the_better_plan_wins_by_the_first_that_differs(self, worse: dict[str, Any]) -> None:
        other = replace(self.BEST, strategy="a", time_s=1000.0, finished_s=1000.0, **worse)
        assert choose_by_count([other, self.BEST]) == choose_by_count([self.BEST, other]) == {2: self.BEST}

    def test_beyond_two_percent_the_quicker_wins(self) -> None:
        slower = replace(self.BEST, finished_s=1020.1)
        quick = replace(self.BEST, strategy="a", finished_s=1000.0, worked_pct=95.0)
        assert choose_by_count([slower, quick]) == {2: quick}

    def test_time_is_that_of_the_finished_field(self) -> None:
        """Driven 30 % quicker, but as long with its rest: a crescent that is left is worth nothing."""
        leaving = build_plan(2, 700.0, "a", worked_pct=95.1, finished_s=1010.0)
        assert choose_by_count([leaving, self.BEST]) == {2: self.BEST}

    def test_every_number_of_tractors_has_its_own(self) -> None:
        third = build_plan(3, 700.0)
        assert list(choose_by_count([third, self.BEST])) == [2, 3]

    @QUICK
    @given(
        st.lists(
            st.tuples(st.integers(1, 3), st.floats(900.0, 1100.0), st.floats(90.0, 100.0), st.integers(0, 3)),
            min_size=1, max_size=10,
        ),
        st.randoms(use_true_random=False),
    )  # fmt: skip
    def test_order_does_not_matter_and_none_is_much_quicker(self, rows: list[tuple[Any, ...]], luck: Any) -> None:
        plans = [
            build_plan(count, time_s, str(number), worked_pct=share, reversals=reversals, finished_s=time_s)
            for number, (count, time_s, share, reversals) in enumerate(rows)
        ]
        chosen = choose_by_count(plans)
        luck.shuffle(plans)
        assert choose_by_count(plans) == chosen
        for plan in plans:
            assert chosen[plan.tractors].ranked_s <= 1.02 * plan.ranked_s + 1e-9


def test_cost_is_that_of_the_finished_field_with_late_ground() -> None:
    plain = build_plan(1, 900.0, cost=10.0, finished_cost=12.0)
    assert plain.ranked_cost == 12.0
    assert replace(plain, expected_cost=15.0).ranked_cost == 17.0


@pytest.mark.parametrize(
    ("worked_pct", "reference_pct", "told"),
    [(99.8, 95.1, True), (98.4, 98.1, True), (98.1, 98.4, True), (98.4, 98.2, False), (None, 98.0, False)],
)
def test_shares_are_told_from_three_tenths_of_a_point(
    worked_pct: float | None, reference_pct: float, told: bool
) -> None:
    assert is_share_different(worked_pct, reference_pct) is told
