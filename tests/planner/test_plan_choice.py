"""The choice from tables written by hand."""

from collections.abc import MutableSequence, Sequence
from dataclasses import replace
from random import Random
from typing import Any

from hypothesis import example, given, settings
from hypothesis import strategies as st

from planner.request.plan_request import CHEAPEST, FASTEST, OBJECTIVES, SUREST
from planner.risk.assessment import choose_best
from reports.common.plan_results import PlanResult
from tests.examples import count_examples

SAMPLES = 10_000


def plan(tractors: int, paid: float, probability: float | None, late: float = 0.0, hours: float = 3.0) -> PlanResult:
    """A plan of so many tractors: what is paid, P, late ground on top, median hours."""
    return PlanResult(
        "interleaved", tractors, "u", True, paid_cost=paid, expected_cost=paid + late,
        p50_s=3600.0 * hours, p95_s=3600.0 * (hours + 0.5), finish_probability=probability,
    )  # fmt: skip


def choose(plans: Sequence[PlanResult], objective: str = CHEAPEST) -> PlanResult:
    return choose_best(plans, objective, SAMPLES)


def add_cost(each: PlanResult, more: float) -> PlanResult:
    return replace(each, paid_cost=(each.paid_cost or 0.0) + more, expected_cost=(each.expected_cost or 0.0) + more)


TABLE = [
    plan(1, 96.40, 0.61, late=31.0, hours=3.9), plan(2, 120.10, 0.97, late=8.8, hours=2.1), plan(3, 138.30, 0.99),
]  # fmt: skip


class Reversing(Random):
    """Luck that reverses what it shuffles."""

    def shuffle(self, x: MutableSequence[Any]) -> None:
        x.reverse()


class TestChoice:
    def test_late_ground_counts(self) -> None:
        assert choose(TABLE).tractors == 2
        free = [replace(each, expected_cost=each.paid_cost) for each in TABLE]
        assert choose(free).tractors == 1

    def test_equal_money_goes_to_fewer_tractors_when_they_are_as_sure(self) -> None:
        near = [plan(1, 100.9, 0.97), plan(2, 100.0, 0.975)]
        assert choose(near).tractors == 1
        assert choose([plan(1, 103.0, 0.97), plan(2, 100.0, 0.975)]).tractors == 2

    def test_equal_money_does_not_go_to_a_plan_that_is_clearly_less_sure(self) -> None:
        assert choose([plan(1, 127.40, 0.61), plan(2, 128.90, 0.97)]).tractors == 2

    def test_few_draws_tell_less_apart(self) -> None:
        plans = [plan(1, 108.0, 0.9), plan(2, 100.0, 0.9)]
        assert choose(plans).tractors == 2
        assert choose([replace(each, expected_cost_error=4.0) for each in plans]).tractors == 1

    def test_preferences(self) -> None:
        plans = [plan(1, 50.0, 0.5, hours=6.0), plan(3, 80.0, 0.9, hours=3.0), plan(6, 200.0, 0.99, hours=2.0)]
        assert [choose(plans, prefer).tractors for prefer in (CHEAPEST, FASTEST, SUREST)] == [1, 6, 6]
        assert choose([*plans, plan(4, 300.0, 0.985, hours=2.5)], SUREST).tractors == 4
        unlimited = [replace(each, finish_probability=None) for each in plans]
        assert choose(unlimited, SUREST).tractors == 6

    def test_a_unit_of_money_per_tractor_does_not_flip_it(self) -> None:
        for fee in (0.0, 0.5, 1.0):
            extra = {each.tractors: fee * each.tractors for each in TABLE}
            dearer = [add_cost(each, extra[each.tractors]) for each in TABLE]
            assert choose(dearer).tractors == 2

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
        plans = [replace(plan(*row), strategy=f"strategy-{number}") for number, row in enumerate(rows)]
        mixed = list(plans)
        luck.shuffle(mixed)
        assert choose(plans, prefer) == choose(mixed, prefer)
