"""The choice from tables written by hand."""

from collections.abc import MutableSequence
from dataclasses import replace
from random import Random
from typing import Any

from hypothesis import example, given, settings
from hypothesis import strategies as st

from planner.request.plan_request import CHEAPEST, FASTEST, OBJECTIVES, SUREST
from planner.risk.plan_choice import PlanFigures, choose_best
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
