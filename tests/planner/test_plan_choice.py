"""The choice and its sentence from tables written by hand."""

from collections.abc import MutableSequence
from dataclasses import replace
from random import Random
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from planner.request.plan_request import CHEAPEST, FASTEST, OBJECTIVES, SUREST
from planner.risk.plan_choice import PlanFigures, choose_best, write_advice
from tests.examples import count_examples


def plan(tractors: int, paid: float, probability: float | None, late: float = 0.0, hours: float = 3.0) -> PlanFigures:
    """A plan of so many tractors: what is paid, P, late ground on top, median hours."""
    return PlanFigures(
        "interleaved", tractors, paid, paid + late, 3600.0 * hours, 3600.0 * (hours + 0.5), probability, 10_000
    )


TABLE = [
    plan(1, 96.40, 0.61, late=31.0, hours=3.9), plan(2, 120.10, 0.97, late=8.8, hours=2.1), plan(3, 138.30, 0.99),
]  # fmt: skip


class Reversing(Random):
    """Luck that reverses what it shuffles."""

    def shuffle(self, x: MutableSequence[Any]) -> None:
        x.reverse()


class TestSentence:
    def test_of_the_issue(self) -> None:
        assert write_advice(TABLE, "before 17:00", currency="EUR") == (
            "2 tractors: 97 % before 17:00, 129 EUR expected (120 EUR paid). 1 tractor: 61 % in time, -2 EUR (about "
            "equal). 3 tractors: 99 % in time, +9 EUR."
        )

    @pytest.mark.parametrize(
        ("plans", "expected"),
        [
            ([], ""),
            ([plan(1, 50.0, 0.75)], "1 tractor: 75 % before the rain, 50."),
            (
                [plan(1, 50.0, 1.0), plan(2, 60.0, 1.0)],
                "1 tractor: 100 % before the rain, 50. 2 tractors: 100 % in time, +10.",
            ),
            (
                [plan(2, 50.0, 0.9), plan(5, 70.0, 0.95)],
                "2 tractors: 90 % before the rain, 50. 5 tractors: 95 % in time, +20.",
            ),
            (
                [plan(1, 90.0, 0.0, 50.0), plan(3, 60.0, 0.999), plan(4, 75.0, 0.9)],
                "3 tractors: over 99 % before the rain, 60. 1 tractor: too late, +80. 4 tractors: 90 % in time, +15.",
            ),
            (
                [plan(2, 40.0, 0.5, 60.0), plan(3, 60.0, 0.9)],
                "3 tractors: 90 % before the rain, 60. 2 tractors: 50 % in time, +40.",
            ),
            (
                [plan(1, 60.0, 0.8), plan(7, 61.0, 0.3), plan(8, 61.0, 0.3)],
                "1 tractor: 80 % before the rain, 60. 7 tractors: 30 % in time, +1 (about equal).",
            ),
        ],
    )
    def test_of_other_tables(self, plans: list[PlanFigures], expected: str) -> None:
        assert write_advice(plans, "before the rain") == expected

    def test_without_a_limit_it_compares_times(self) -> None:
        plans = [plan(1, 50.0, None, hours=4.0), plan(2, 56.0, None, hours=2.25)]
        assert write_advice(plans) == (
            "1 tractor: median 4 h 0 min, 95 % within 4 h 30 min, 50. 2 tractors: 1 h 45 min faster, +6."
        )
        for objective in (FASTEST, SUREST):
            assert write_advice(plans, objective=objective) == (
                "2 tractors: median 2 h 15 min, 95 % within 2 h 45 min, 56. 1 tractor: 1 h 45 min slower, -6."
            )

    def test_what_is_equal_in_the_objective_says_so(self) -> None:
        assert write_advice(TABLE, "before 17:00", SUREST) == (
            "2 tractors: 97 % before 17:00, 129 expected (120 paid). 1 tractor: 61 % in time, -2. "
            "3 tractors: 99 % in time (about equal), +9."
        )
        near = [plan(3, 138.30, 0.99, hours=2.1), plan(4, 139.0, 0.99, hours=2.08)]
        assert write_advice(near, "before 17:00", FASTEST) == (
            "3 tractors: median 2 h 6 min, 99 % before 17:00, 138. 4 tractors: 1 min faster (about equal), +1."
        )

    def test_few_samples_have_an_interval_and_show_no_small_difference(self) -> None:
        plans = [
            replace(plan(1, 60.0, 0.77), samples=100, interval=(0.678, 0.842)),
            replace(plan(2, 66.0, 0.81), samples=100, interval=(0.722, 0.875)),
        ]
        assert write_advice(plans, "before the rain") == (
            "1 tractor: 77 % (68 to 84 %) before the rain, 60. 2 tractors: 81 % (72 to 88 %) in time (no clear "
            "difference with 100 samples), +6."
        )
        clear = [plans[0], replace(plans[1], probability=0.99, interval=(0.946, 0.998))]
        assert write_advice(clear, "before the rain").endswith("2 tractors: 99 % (95 to 100 %) in time, +6.")

    def test_what_is_over_the_budget_is_said(self) -> None:
        advice = write_advice(TABLE, "before 17:00", chosen_key=("interleaved", 2), budget=125.0)
        assert advice.endswith("(about equal). 3 tractors: 99 % in time, +9, over the budget.")

    def test_differences_are_those_of_the_figures_printed(self) -> None:
        small = write_advice([plan(1, 5.004, 0.2), plan(2, 5.006, 0.9)], "before 17:00")
        assert small.endswith("1 tractor: 20 % in time, -0.01 (about equal).")
        large = write_advice([plan(1, 1400.4, 0.9), plan(2, 1500.6, 0.95)], "before 17:00")
        assert large == "1 tractor: 90 % before 17:00, 1400. 2 tractors: 95 % in time, +101."

    @given(st.floats(20, 400), st.floats(20, 400), st.floats(0, 60), st.floats(0, 60))
    def test_the_difference_is_told_in_what_it_chose_by(self, a: float, b: float, late: float, more: float) -> None:
        """The plan that is taken is never told to cost more than another by more than it calls equal."""
        plans = [plan(1, a, 0.8, late), plan(2, b, 0.8, more)]
        taken, other = sorted(plans, key=lambda each: each is not choose_best(plans))
        sentence = write_advice(plans, "before 17:00")
        assert f" {taken.expected:.0f}" in sentence
        gap = other.expected - taken.expected
        assert gap > -0.02 * other.expected - 1e-9
        printed = float(f"{other.expected:.0f}") - float(f"{taken.expected:.0f}")
        if printed:
            assert f"{printed:+.0f}" in sentence
            assert ("about equal" in sentence) == (abs(gap) <= 0.02 * min(taken.expected, other.expected))


class TestChoice:
    def test_late_ground_counts(self) -> None:
        assert choose_best(TABLE).tractors == 2
        free = [replace(each, expected=each.paid) for each in TABLE]
        assert choose_best(free).tractors == 1

    def test_equal_money_goes_to_fewer_tractors_when_they_are_as_sure(self) -> None:
        near = [plan(1, 100.9, 0.97), plan(2, 100.0, 0.975)]
        assert choose_best(near).tractors == 1
        assert choose_best([plan(1, 103.0, 0.97), plan(2, 100.0, 0.975)]).tractors == 2

    def test_equal_money_does_not_go_to_a_plan_that_is_clearly_less_sure(self) -> None:
        assert choose_best([plan(1, 127.40, 0.61), plan(2, 128.90, 0.97)]).tractors == 2

    def test_few_draws_tell_less_apart(self) -> None:
        plans = [plan(1, 108.0, 0.9), plan(2, 100.0, 0.9)]
        assert choose_best(plans).tractors == 2
        assert choose_best([replace(each, expected_error=4.0) for each in plans]).tractors == 1

    def test_preferences(self) -> None:
        plans = [plan(1, 50.0, 0.5, hours=6.0), plan(3, 80.0, 0.9, hours=3.0), plan(6, 200.0, 0.99, hours=2.0)]
        assert [choose_best(plans, prefer).tractors for prefer in (CHEAPEST, FASTEST, SUREST)] == [1, 6, 6]
        assert choose_best([*plans, plan(4, 300.0, 0.985, hours=2.5)], SUREST).tractors == 4
        unlimited = [replace(each, probability=None) for each in plans]
        assert choose_best(unlimited, SUREST).tractors == 6

    def test_a_unit_of_money_per_tractor_does_not_flip_it(self) -> None:
        for fee in (0.0, 0.5, 1.0):
            extra = {each.tractors: fee * each.tractors for each in TABLE}
            dearer = [
                replace(each, paid=each.paid + extra[each.tractors], expected=each.expected + extra[each.tractors])
                for each in TABLE
            ]
            assert choose_best(dearer).tractors == 2

    @given(
        st.lists(
            st.tuples(st.integers(1, 12), st.floats(1, 500), st.floats(0, 1), st.floats(0, 100), st.floats(0.5, 20)),
            min_size=1, max_size=12,
        ),
        st.sampled_from(OBJECTIVES), st.randoms(use_true_random=False),
    )  # fmt: skip
    @example([(1, 1.0, 0.0, 0.0, 1.0), (1, 1.0, 2.2e-308, 0.0, 1.0)], CHEAPEST, Reversing())
    @example([(1, 1.0, 0.5, 4e-3, 1.0), (1, 1.0, 0.5, 0.0, 1.0)], FASTEST, Reversing())
    @settings(max_examples=count_examples(80))
    def test_the_order_of_the_plans_does_not_matter(
        self, rows: list[tuple[int, ...]], prefer: str, luck: Random
    ) -> None:
        plans = [plan(*row) for row in rows]
        mixed = list(plans)
        luck.shuffle(mixed)
        assert choose_best(plans, prefer) == choose_best(mixed, prefer)
        sentence = write_advice(plans, "before 17:00", prefer)
        assert sentence == write_advice(mixed, "before 17:00", prefer)
        assert sentence.endswith(".") and "  " not in sentence
