"""The best of several plans by what is preferred. What is too near to tell apart is equal; then fewer tractors win."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from planner.errors import ScenarioError, named, nearest
from planner.scenario import CHEAPEST, FASTEST, PREFERENCES

MODEL_SHARE = 0.02  # of money, time and probability: what simulated plans are off by however many draws there are
ERRORS = 2.0  # standard errors of the draws that two plans must differ by


@dataclass(frozen=True)
class Figures:
    """What one feasible plan is judged by: money, seconds, and the probability of being in time (None: no limit).

    `paid` is the price of the job in the mean, `expected` has the ground that is late on top; the errors are standard
    errors of both. `draws` are behind the probability, and `interval` is its 95 % interval.
    """

    strategy: str
    tractors: int
    paid: float
    expected: float
    p50_s: float
    p95_s: float
    probability: float | None = None
    draws: int = 1
    expected_error: float = 0.0
    interval: tuple[float, float] | None = None

    @property
    def _chance_error(self) -> float:
        share = self.probability or 0.0
        return math.sqrt(share * (1.0 - share) / self.draws)


def check_preference(prefer: str) -> None:
    """Refuse a preference that is not known."""
    if prefer not in PREFERENCES:
        raise ScenarioError(
            f"{named('prefer')} {prefer!r} is unknown{nearest(prefer, PREFERENCES)}; use {', '.join(PREFERENCES)}.",
            parameter="prefer",
        )


def best(plans: Sequence[Figures], prefer: str = CHEAPEST) -> Figures:
    """The plan to take: of those that are equal to the very best the one with fewest tractors.

    Cheapest is least expected cost; of plans that are equal in that, those that are clearly less sure than another of
    them are left out. Surest is the highest probability, without a limit the earliest 95th percentile.
    """
    check_preference(prefer)
    if prefer == CHEAPEST:
        equal = surest_of(_near(plans, lambda plan: plan.expected, lambda plan: plan.expected_error))
    elif prefer == FASTEST:
        equal = _near(plans, lambda plan: plan.p50_s, lambda plan: 0.0)
    elif any(plan.probability is None for plan in plans):
        equal = _near(plans, lambda plan: plan.p95_s, lambda plan: 0.0)
    else:
        equal = surest_of(plans)
    return min(equal, key=_order)


def best_by_count(plans: Sequence[Figures], prefer: str = CHEAPEST) -> dict[int, Figures]:
    """The best plan of every number of tractors, fewest first."""
    counts = sorted({plan.tractors for plan in plans})
    return {count: best([plan for plan in plans if plan.tractors == count], prefer) for count in counts}


def surest_of(plans: Sequence[Figures]) -> list[Figures]:
    """Those that are not clearly less sure than the surest; all of them where there is no limit."""
    if any(plan.probability is None for plan in plans):
        return list(plans)
    top = max(plans, key=lambda plan: round(plan.probability or 0.0, 9))
    return [plan for plan in plans if not clearly_less(plan, top)]


def clearly_less(plan: Figures, other: Figures) -> bool:
    """Whether a plan is less sure than another by more than draws and model are off by."""
    return (other.probability or 0.0) - (plan.probability or 0.0) > _apart(plan, other) + MODEL_SHARE


def same_money(plan: Figures, other: Figures) -> bool:
    """Whether the expected costs of two plans are too near to tell apart."""
    return _too_near(plan.expected, other.expected, math.hypot(plan.expected_error, other.expected_error))


def same_draws(plan: Figures, other: Figures) -> bool:
    """Whether the draws are too few to tell how sure two plans are."""
    return abs((other.probability or 0.0) - (plan.probability or 0.0)) <= _apart(plan, other)


def same_chance(plan: Figures, other: Figures) -> bool:
    """Whether two plans are as sure, as far as draws and model can tell."""
    return not clearly_less(plan, other) and not clearly_less(other, plan)


def same_time(plan_s: float, other_s: float) -> bool:
    """Whether two times are too near to tell apart."""
    return _too_near(plan_s, other_s, 0.0)


def _apart(plan: Figures, other: Figures) -> float:
    """How far two probabilities may differ by the luck of the draws."""
    return ERRORS * math.hypot(plan._chance_error, other._chance_error)


def _too_near(value: float, other: float, error: float) -> bool:
    return abs(value - other) <= ERRORS * error + MODEL_SHARE * abs(min(value, other))


def _near(
    plans: Sequence[Figures], value: Callable[[Figures], float], error: Callable[[Figures], float]
) -> list[Figures]:
    """Those whose value is not above the least by more than draws and model are off by."""
    least = min(plans, key=lambda plan: (round(value(plan), 6), -round(error(plan), 6)))

    def room(plan: Figures) -> float:
        return ERRORS * math.hypot(error(plan), error(least)) + MODEL_SHARE * abs(value(least))

    return [plan for plan in plans if value(plan) - value(least) <= room(plan)]


def _order(plan: Figures) -> tuple[int, float, float, float, float, float, str]:
    """Fewer tractors, then less money, sooner done, surer; the rest only so that no two plans are the same."""
    return (
        plan.tractors, round(plan.expected, 2), round(plan.p50_s, 1), -round(plan.probability or 0.0, 6),
        round(plan.p95_s, 1), round(plan.paid, 2), plan.strategy,
    )  # fmt: skip
