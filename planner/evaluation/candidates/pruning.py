"""Branch and bound: which plans are simulated, and which are skipped because their lower bound loses."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Protocol, TypeVar

import numpy as np

from planner.evaluation.candidates.time_bounds import (
    CLOSE_FACTOR,
    SPEED_LIMIT_ONLY,
    SpeedLimits,
    build_speed_limits,
    compute_done_s,
    compute_earliest_finish_s,
    compute_finish_from_solo_s,
)
from planner.evaluation.context import PlanningContext
from reports.common.plan_results import PlanResult
from strategies.program.strategy_record import RefinedPlan
from vehicle.missions.plan import HEADLAND_PASS, Leg, Mission, Plan
from vehicle.missions.run import SimulationRun

SURE_FACTOR = 1.1  # times the incumbent: beyond this at one corner the other corners are not tried


@dataclass(frozen=True)
class Incumbent:
    """The quickest feasible plan with as many tractors: its strategy and seconds to finish the field.

    `tractor_s` is the sum over its tractors, each until it is done.
    """

    strategy: str
    finish_s: float
    tractor_s: float = 0.0


@dataclass(frozen=True)
class PrunedCandidate:
    """A candidate whose plans all take at least `bound_s`, longer than the incumbent.

    `was_simulated` says that quicker plans of it were simulated and were not feasible.
    """

    bound_s: float
    incumbent: Incumbent
    was_simulated: bool = False


def prune_plans(
    context: PlanningContext,
    plans: Sequence[Plan],
    incumbent: Incumbent,
    solo_runs: Callable[[Mission], SimulationRun] | None = None,
) -> PrunedCandidate | None:
    """The plans as pruned by the incumbent; None if one of them might win.

    Tractors are simulated alone (`solo_runs`) only if the bound of their pace nearly decides. If risk or cost decides,
    the sum over all tractors must be longer as well.
    """
    bound_s = math.inf
    for plan in plans:
        plan_bound_s = _find_losing_bound_s(context, plan, incumbent, solo_runs)
        if plan_bound_s is None:
            return None
        bound_s = min(bound_s, plan_bound_s)
    return PrunedCandidate(bound_s, incumbent) if plans else None


def prune_composed(
    context: PlanningContext, plans_tractor_s: Sequence[Sequence[float]], incumbent: Incumbent | None
) -> PrunedCandidate | None:
    """Plans as pruned by the incumbent, given the seconds of their tractors without waiting; None if one might win."""
    if incumbent is None or any(_may_win(context, tractor_s, incumbent) for tractor_s in plans_tractor_s):
        return None
    return PrunedCandidate(min(map(max, plans_tractor_s)), incumbent)


def _may_win(context: PlanningContext, tractor_s: Sequence[float], incumbent: Incumbent) -> bool:
    """Whether tractors that take so long may beat the incumbent."""
    return max(tractor_s) <= incumbent.finish_s or _wins_by_sum(context, tractor_s, incumbent)


def _wins_by_sum(context: PlanningContext, tractor_s: Sequence[float], incumbent: Incumbent) -> bool:
    """Whether risk or cost decides and all tractors together take less time than those of the incumbent."""
    uses_criteria = context.criteria is not None and context.criteria.decides_best
    return uses_criteria and math.fsum(tractor_s) < incumbent.tractor_s


def split_contenders(
    context: PlanningContext,
    choices: Sequence[RefinedPlan],
    incumbent: Incumbent,
    solo_runs: Callable[[Mission], SimulationRun],
) -> tuple[list[RefinedPlan], PrunedCandidate | None]:
    """The choices that might beat the incumbent, and the pruned others (None without any)."""
    bounds_s = [_find_losing_bound_s(context, choice.plan, incumbent, solo_runs) for choice in choices]
    contenders = [choice for choice, seconds in zip(choices, bounds_s, strict=True) if seconds is None]
    bound_s = min((seconds for seconds in bounds_s if seconds is not None), default=None)
    return contenders, None if bound_s is None else PrunedCandidate(bound_s, incumbent)


def choose_lower_bounded(first: PrunedCandidate | None, second: PrunedCandidate | None) -> PrunedCandidate | None:
    """The pruned candidate with the lower bound; None if both are None."""
    return min((each for each in (first, second) if each is not None), key=lambda each: each.bound_s, default=None)


def _find_losing_bound_s(
    context: PlanningContext, plan: Plan, incumbent: Incumbent, solo_runs: Callable[[Mission], SimulationRun] | None
) -> float | None:
    """Lower bound (s) of a plan that loses to the incumbent; None if it might win."""
    done_times_s = compute_done_s(
        plan, build_speed_limits(context.tractor, context.implement, context.driving_rules.radius_m)
    )
    if _wins_by_sum(context, done_times_s, incumbent):
        return None
    bound_s = max(done_times_s)
    if (
        solo_runs is not None
        and plan.tractors > 1
        and CLOSE_FACTOR * incumbent.finish_s <= bound_s <= incumbent.finish_s
    ):
        bound_s = max(bound_s, compute_finish_from_solo_s(plan, solo_runs, incumbent.finish_s))
    return None if bound_s <= incumbent.finish_s else bound_s


def is_pruned_at_all_corners(pruned: PrunedCandidate | None) -> bool:
    """Whether a formation loses by so much that no other corner can win."""
    return pruned is not None and pruned.bound_s > SURE_FACTOR * pruned.incumbent.finish_s


def relax_bound_for_corners(pruned: PrunedCandidate) -> PrunedCandidate:
    """A surely pruned formation with a bound that holds for all corners."""
    return replace(pruned, bound_s=pruned.bound_s / SURE_FACTOR)


def build_pruned_result(pruned: PrunedCandidate, context: PlanningContext, strategy: str, tractors: int) -> PlanResult:
    """The result of a candidate that is not simulated."""
    incumbent = pruned.incumbent
    reason = (
        f"skipped: even its best case ({pruned.bound_s:.0f} s) is slower than {incumbent.strategy} "
        f"({incumbent.finish_s:.0f} s)"
    )
    return PlanResult(strategy, tractors, context.request.turn, False, reason, bound_s=round(pruned.bound_s, 3))


# Errors of the difference between the lower bounds of two orders: a share of the headland time, and seconds.
UNCERTAINTY_SHARE, UNCERTAINTY_S = 0.05, 15.0


class DrivenPlan(Protocol):
    """A simulated plan: its last run, and why it is not feasible (None if it is)."""

    @property
    def run(self) -> SimulationRun: ...

    @property
    def reason(self) -> str | None: ...


T = TypeVar("T", bound=DrivenPlan)


@dataclass(frozen=True)
class PruningLimits:
    """What bounds are computed from: a tractor's pace, and its simulation alone."""

    pace: SpeedLimits = SPEED_LIMIT_ONLY
    solo_runs: Callable[[Mission], SimulationRun] | None = None

    def is_pruned(self, plan: Plan, best_s: float) -> bool:
        """Whether a plan cannot be quicker than `best_s`.

        Simulating tractors alone gives a better bound than their pace, and is done only where it may decide.
        """
        min_s = compute_earliest_finish_s(plan, self.pace)
        if min_s >= best_s or self.solo_runs is None or plan.tractors == 1 or min_s < CLOSE_FACTOR * best_s:
            return min_s >= best_s
        return compute_finish_from_solo_s(plan, self.solo_runs, best_s) >= best_s


def simulate_promising_plans(
    choices: Sequence[RefinedPlan], simulate: Callable[[RefinedPlan], T], limits: PruningLimits | None = None
) -> list[T]:
    """Simulate the choices in the order of their lower bounds, without those that an earlier one clearly beats.

    The work on swaths is the same: orders differ in the headland passes and the paths to them. Waiting that a run needs
    beyond its plan may not occur in another order, so bounds are compared with bounds, within their uncertainty. A
    choice whose bound is not below the best simulated time is skipped.
    """
    min_times_s = sorted(
        (round(compute_earliest_finish_s(choice.plan), 3), number) for number, choice in enumerate(choices)
    )
    results: list[T] = []
    min_done_s = best_s = math.inf
    for min_s, number in min_times_s:
        if min_s - UNCERTAINTY_S - UNCERTAINTY_SHARE * compute_longest_headland_s(choices[number].plan) >= min_done_s:
            continue
        if best_s < math.inf and (limits or PruningLimits()).is_pruned(choices[number].plan, best_s):
            continue
        result = simulate(choices[number])
        results.append(result)
        if result.reason is None:
            best_s = min(best_s, result.run.duration_s)
            min_done_s = min(min_done_s, max(min_s, compute_earliest_finish_s(result.run.plan)))
    return results


def simulate_promising_first(
    promising: Sequence[RefinedPlan],
    choices: Sequence[RefinedPlan],
    simulate: Callable[[RefinedPlan], T],
    limits: PruningLimits,
) -> list[T]:
    """Simulate the promising choices; the others too, but only if one of the promising ones is feasible.

    That one may turn out slower than the incumbent after all, and another choice less slow.
    """
    results: dict[int, T] = {}

    def simulate_once(choice: RefinedPlan) -> T:
        if id(choice) not in results:
            results[id(choice)] = simulate(choice)
        return results[id(choice)]

    runs = simulate_promising_plans(promising, simulate_once, limits)
    if len(promising) < len(choices) and any(each.reason is None for each in runs):
        return simulate_promising_plans(choices, simulate_once, limits)
    return runs


def compute_longest_headland_s(plan: Plan) -> float:
    """Seconds on headland passes of the tractor that works longest on them, at planned speed."""
    legs = [[leg for leg in mission.legs if leg.task.kind == HEADLAND_PASS] for mission in plan.missions]
    return max(math.fsum(leg.length_m / leg.speed_mps for leg in each) for each in legs)


def drop_simulated(choices: Sequence[RefinedPlan], simulated: Sequence[Plan]) -> list[RefinedPlan]:
    """The choices that are not the same as a simulated plan."""
    return [choice for choice in choices if not any(is_same_plan(choice.plan, plan) for plan in simulated)]


def is_same_plan(first: Plan, second: Plan) -> bool:
    """Whether two plans are the same leg by leg, apart from their notes."""
    pairs = list(zip(first.missions, second.missions, strict=False))
    if first.tractors != second.tractors or any(len(a.legs) != len(b.legs) for a, b in pairs):
        return False
    return all(
        _is_same_leg(a, b)
        for mission, counterpart in pairs
        for a, b in zip(mission.legs, counterpart.legs, strict=True)
    )


def _is_same_leg(first: Leg, second: Leg) -> bool:
    if first is second:
        return True
    field_names = (each.name for each in fields(Leg) if each.name != "points")
    return np.array_equal(first.points, second.points) and all(
        getattr(first, n) == getattr(second, n) for n in field_names
    )
