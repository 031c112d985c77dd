"""Results of plans and of the fleet study, as the planner hands them to the reports, and which plan to take.

Types are plain frozen data.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from operator import attrgetter
from typing import Any

from reports.common.language import mark_text
from reports.common.plan_records import PlanFault, PullFigures, Shortfall, ShortfallKind, SlopePlace, UnworkedPiece
from reports.common.rendering import ShownResult

MODEL_ERROR_SHARE = 0.02  # of cost, time and probability: the error of simulated plans, however many samples there are
LEAST_SHARE_DIFFERENCE_PCT = 0.3  # of the field: less is not told of another plan
WORTHWHILE_SHARE = 0.5  # of what an even split of the work saves: with less the next tractor mostly waits and turns
BRINGING_S = 900.0  # to bring another tractor, hitch it and set it up: nobody does that to save less
DECIDING_REASONS = (
    mark_text("as what is quicker leaves too much ground"),
    mark_text("as what is quicker comes nearer than {distance}"),
    mark_text("as ground left counts"),
    mark_text("as it is about as quick and works more"),
    mark_text("as it is about as quick and keeps more distance"),
    mark_text("as it is about as quick and reverses less"),
    mark_text("as it is about as quick and waits less"),
)
"""What decides for a plan and against a quicker one, in the order in which `choose_by_count` compares them."""


@dataclass(frozen=True, repr=False)
class PlanResult(ShownResult):
    """One plan. Values that were not simulated are None; `reason` says why, or why the plan is infeasible.

    Attributes that are keys of JSON hold what the reference of the guide says. Of the others:

    Attributes:
        resting: numbers, from 1, of tractors with nothing to do.
        remarks: what its strategy could not do, though the plan can be driven.
        works_enough: whether the share of the ground asked for is that of a recommendation.
        measured: figures that their entry in `reports.plan.figures` takes from the run, by key.
        finished_done_s: the same as `done_s` with the unworked ground worked at the plan's rate.
        expected_cost_error: standard error of the mean of the samples.
        faults: places where an infeasible plan touches something or leaves the field.
        in_formation: of a refused plan, whether its strategy is one of tractors side by side.
        uncertainty_pct: what an estimate of a sweep may differ by from its drive in time and cost, percent either way;
            0 at the speed that was driven, None for other plans.
        pull: of an estimate, where its tractor may be too weak; of plans that were driven their ranking has it.
    """

    strategy: str
    tractors: int
    turn: str
    feasible: bool
    reason: str | None = None
    rank: int | None = None
    time_s: float | None = None
    tractor_time_s: float | None = None
    cost: float | None = None
    meets_deadline: bool | None = None
    works_enough: bool = True
    worked_pct: float | None = None
    overlap_pct: float | None = None
    missed_m2: float | None = None
    spared_m2: float = 0.0
    left_out_m2: float | None = None
    largest_missed: UnworkedPiece | None = None
    finished_s: float | None = None
    finished_cost: float | None = None
    wheel_traffic_m2: float | None = None
    over_finished_m: float | None = None
    over_finished_m2: float | None = None
    spoilt_m2: float | None = None
    outside_m: float | None = None
    outside_along_m: float | None = None
    turning_s: float | None = None
    waiting_s: float | None = None
    reversals: int | None = None
    min_clearance_m: float | None = None
    keeps_clearance: bool = True
    is_simulated: bool = True
    in_formation: bool = False
    collisions: int | None = None
    measured: Mapping[str, float | None] = field(default_factory=dict)
    on_pareto_front: bool = False
    remarks: tuple[str, ...] = ()
    headland_passes: int | None = None
    headland_s: float | None = None
    transport_s: float | None = None
    ready_s: float | None = None
    done_s: float | None = None
    home_s: float | None = None
    finished_done_s: float | None = None
    finish_probability: float | None = None
    finish_probability_interval: tuple[float, float] | None = None
    p50_s: float | None = None
    p80_s: float | None = None
    p95_s: float | None = None
    expected_cost: float | None = None
    expected_cost_error: float | None = None
    paid_cost: float | None = None
    bound_s: float | None = None
    refills: int | None = None
    refilling_s: float | None = None
    faults: tuple[PlanFault, ...] = ()
    p50_done_s: float | None = None
    p95_done_s: float | None = None
    fuel_l: float | None = None
    headland_order: str | None = None
    fuel_l_per_ha: float | None = None
    energy_kwh: float | None = None
    co2_kg: float | None = None
    fuel_l_by_tractor: tuple[float, ...] | None = None
    energy_kwh_by_tractor: tuple[float, ...] | None = None
    steepest_along: SlopePlace | None = None
    steepest_across: SlopePlace | None = None
    rollover: SlopePlace | None = None
    energy_kwh_per_ha: float | None = None
    charges: int | None = None
    charging_s: float | None = None
    uncertainty_pct: float | None = None
    pull: PullFigures | None = None
    resting: tuple[int, ...] = ()

    @property
    def lacks(self) -> tuple[ShortfallKind, ...]:
        """What an estimated plan lacks of what was asked for, if it is feasible; rain and budget are not estimated."""
        kinds: dict[ShortfallKind, bool] = {
            "pull": self.pull is not None and self.pull.is_infeasible,
            "worked": not self.works_enough,
            "late": self.meets_deadline is False,
        }
        return tuple(kind for kind, is_lacking in kinds.items() if is_lacking)

    @property
    def remark(self) -> str | None:
        """All remarks in one text; None without any."""
        return "; ".join(self.remarks) or None

    @property
    def finished_field_s(self) -> float:
        """Seconds until the field is finished; as driven where the unworked ground is not known."""
        return float((self.time_s or 0.0) if self.finished_s is None else self.finished_s)

    @property
    def finished_field_cost(self) -> float:
        """Cost of the finished field; as driven where the unworked ground is not known."""
        return float((self.cost or 0.0) if self.finished_cost is None else self.finished_cost)

    @property
    def field_work_end_s(self) -> float:
        """When field work is done, seconds after the start by the clock."""
        return float((self.time_s or 0.0) if self.done_s is None else self.done_s)

    @property
    def stated_s(self) -> float:
        """The time that every report states, until all tractors are done: the median of samples, else as simulated."""
        return float((self.time_s or 0.0) if self.p50_s is None else self.p50_s)

    @property
    def stated_end_s(self) -> float:
        """The end of field work that every report states, seconds after the start by the clock.

        It is the median of the samples, and where there are none as simulated.
        """
        if self.p50_done_s is not None:
            return self.p50_done_s
        return self.field_work_end_s + self.stated_s - (self.time_s or 0.0)

    @property
    def stated_late_end_s(self) -> float | None:
        """The end of field work by the clock in 95 % of the samples; None without samples."""
        if self.p95_done_s is not None or self.p95_s is None:
            return self.p95_done_s
        return self.field_work_end_s + self.p95_s - (self.time_s or 0.0)

    @property
    def stated_finished_end_s(self) -> float:
        """When the finished field is done: the stated end, and the time to finish the unworked ground."""
        finished_s = self.finished_field_s if self.finished_done_s is None else self.finished_done_s
        return self.stated_end_s + finished_s - self.field_work_end_s

    @property
    def stated_cost(self) -> float | None:
        """The cost that every report states: the expected one, and where there are no samples as simulated."""
        return self.cost if self.expected_cost is None else self.expected_cost

    @property
    def ranked_s(self) -> float:
        """Seconds that feasible plans are ranked by: the stated time with the unworked ground finished as well."""
        delay_s = 0.0 if self.p50_s is None else self.p50_s - (self.time_s or 0.0)
        return self.finished_field_s + delay_s

    @property
    def ranked_cost(self) -> float:
        """The cost that feasible plans are compared by: the stated one with the unworked ground finished as well."""
        delay_cost = 0.0 if self.expected_cost is None else self.expected_cost - (self.cost or 0.0)
        return self.finished_field_cost + delay_cost

    @property
    def left_factor(self) -> float:
        """By how much the time to finish the field is more than the time as driven, for the ground that is left."""
        return self.finished_field_s / self.time_s if self.time_s else 1.0

    @property
    def finishing_s(self) -> float:
        """Seconds that finishing the unworked ground would take, at the plan's own rate."""
        return self.finished_field_s - (self.time_s or 0.0)

    @property
    def due_missed_m2(self) -> float:
        """The missed ground that was to be worked, which `finishing_s` is for."""
        return max((self.missed_m2 or 0.0) - self.spared_m2, 0.0)

    @property
    def finishing_cost(self) -> float:
        """What finishing the unworked ground would cost, at the plan's own rate."""
        return self.finished_field_cost - (self.cost or 0.0)


def build_time_sort_key(plan: PlanResult) -> tuple[float, int, str]:
    """Sort key of feasible plans: time to finish the field to the millisecond, then tractors, then name.

    Unworked ground counts with the time it would take at the plan's own rate.
    """
    return round(plan.ranked_s, 3), plan.tractors, plan.strategy


def build_quality_key(plan: PlanResult) -> tuple[float, float, int, float]:
    """Sort key of plans that take as long: what works more, then keeps more distance, reverses less and waits less.

    Shares and distances count as they are printed: less is no difference.
    """
    clearance_m = math.inf if plan.min_clearance_m is None else plan.min_clearance_m
    worked_pct = 100.0 if plan.worked_pct is None else plan.worked_pct
    return -round(worked_pct, 1), -round(clearance_m, 1), plan.reversals or 0, round(plan.waiting_s or 0.0)


def is_dearer(plan: PlanResult, reference: PlanResult) -> bool:
    """Whether a plan costs more than another by more than the error of the model."""
    cost = reference.ranked_cost
    return plan.ranked_cost > cost + MODEL_ERROR_SHARE * abs(cost)


def is_share_different(worked_pct: float | None, reference_pct: float | None) -> bool:
    """Whether the shares that two plans work differ by so much, as printed, that it is told."""
    if worked_pct is None or reference_pct is None:
        return False
    return round(abs(round(worked_pct, 1) - round(reference_pct, 1)), 1) >= LEAST_SHARE_DIFFERENCE_PCT


def choose_by_count(plans: Sequence[PlanResult], *, by_cost: bool = False) -> dict[int, PlanResult]:
    """The plan to take with every number of tractors, fewest first: that of the least value, which is time or cost.

    Plans that keep the clearance come first. Of those that are as good and take as long, within the error of the model,
    it is the first by `build_quality_key`.
    """
    get_ranked_s = attrgetter("ranked_s")
    get_value = attrgetter("ranked_cost") if by_cost else get_ranked_s
    chosen = {}
    for count in sorted({plan.tractors for plan in plans}):
        of_count = [plan for plan in plans if plan.tractors == count]
        alike = [plan for plan in of_count if plan.keeps_clearance] or of_count
        least = min(alike, key=lambda plan: (get_value(plan), build_time_sort_key(plan)))
        limits = [(get, get(least) + MODEL_ERROR_SHARE * abs(get(least))) for get in (get_value, get_ranked_s)]
        equal = [plan for plan in alike if plan is least or all(get(plan) <= limit for get, limit in limits)]
        chosen[count] = min(equal, key=lambda plan: (build_quality_key(plan), build_time_sort_key(plan)))
    return chosen


def find_deciding_reason(plan: PlanResult, quicker: PlanResult) -> str | None:
    """Why `choose_by_count` takes a plan before a quicker one with as many tractors, one of `DECIDING_REASONS`.

    None where it would not.
    """
    lacks = [(not one.works_enough, not one.keeps_clearance, one.ranked_s) for one in (plan, quicker)]
    qualities = [build_quality_key(one) for one in (plan, quicker)]
    reasons = zip(DECIDING_REASONS, (*zip(*lacks, strict=True), *zip(*qualities, strict=True)), strict=True)
    return next((reason for reason, (own, other) in reasons if own < other), None)


def choose_plan(plans: Sequence[PlanResult], allowed_s: float | None = None, is_priced: bool = False) -> PlanResult:
    """The plan to take of some feasible ones, at least one: of those pulled that work enough, if any are.

    With a deadline it is the cheapest in time, and the quickest if none is; plans that could finish the whole field
    within `allowed_s` come before those that are in time but leave ground. Without one it is that of the knee: with the
    number of tractors from which one more does not pay. Where prices are known that is the cheapest: time saved has no
    price of its own. Where none are, the next tractor has to save as much as `find_least_saving_s` says.
    """
    lacks = []  # less first: a strong enough tractor; enough work; being in time, or so with all ground
    for plan in plans:
        late_with_all = allowed_s is not None and plan.stated_finished_end_s > allowed_s
        lateness = 2 if plan.meets_deadline is False else int(late_with_all)
        lacks.append(("pull" in plan.lacks, "worked" in plan.lacks, lateness))
    by_count = choose_by_count([plan for plan, lack in zip(plans, lacks, strict=True) if lack == min(lacks)])
    in_time = next(iter(by_count.values())).meets_deadline
    if in_time is False:
        return min(by_count.values(), key=build_time_sort_key)
    if in_time or is_priced:  # of those that cost as much within the error of the model that with the fewest tractors
        least = min(by_count.values(), key=attrgetter("ranked_cost"))
        return next(plan for plan in by_count.values() if not is_dearer(plan, least))
    for plan, next_plan in pairwise(by_count.values()):
        if plan.ranked_s - next_plan.ranked_s < find_least_saving_s(plan, next_plan):
            return plan
    return list(by_count.values())[-1]


def find_least_saving_s(plan: PlanResult, larger: PlanResult) -> float:
    """Seconds that more tractors have to save without prices: those to bring them, or a share of an even split."""
    brought = larger.tractors - plan.tractors
    return brought * max(BRINGING_S, WORTHWHILE_SHARE * plan.ranked_s / larger.tractors)


@dataclass(frozen=True)
class FieldPartPlan:
    """A part of a field beyond what the plans of a ranking reach: its ground, how it is cut off, its own plan.

    `neck` is the narrowest place on the widest way there (its area is 0), `neck_width_m` its width; 0 where there is no
    way at all. `plan` is None where no plan works, for the `reason`.
    """

    number: int
    ground: UnworkedPiece
    neck: UnworkedPiece
    neck_width_m: float
    plan: PlanResult | None
    reason: str | None = None


@dataclass(frozen=True, repr=False)
class PlanRanking(ShownResult):
    """All plans of a request, best first, infeasible ones last.

    Attributes:
        tractor_effects: values of the effects in the tractor file by id, and under "discrepancy_model" the amounts of
            a discrepancy model that is switched on.
        scenario: the request, with the values that were planned with where it left them open: plain values with units
            in their keys, clock times as hh:mm.
        currency, samples: of costs and of figures of samples, where there are prices or samples.
        chosen: the plan to take (strategy, tractors) where there is a deadline, rain or objective.
        check_sentences: how far the samples can be trusted.
        day_sentences: clock times of the best plan.
        shortfalls: what keeps the best plan from being a recommendation.
        cut_off: all ground that obstacles cut off from the field that is worked, at the place of its largest piece.
        cross_slope_pct, erosion_share: the largest slope across the swaths, and the share of their metres near the fall
            line of steeper ground; None where no heights are known.
        field_start, field_allowed_s: on a farm, when field work can begin and how long it can last.
        money_sentences: what the costs include; `prices_assumed` if nobody gave prices, and what late ground costs.
        parts: further parts of a divided field, each with a plan of its own.
        pull: whether the tractor can pull the implement; None where its power or the draft is not known.
        field_remarks, ground_sentences: on the field file; on the heights, soil and load that are taken.
    """

    field_name: str
    area_ha: float
    seed: int
    plans: tuple[PlanResult, ...]
    start: str | None = None
    deadline: str | None = None
    allowed_s: float | None = None
    assumptions: tuple[str, ...] = ()
    tractor_effects: dict[str, dict[str, float]] = field(default_factory=dict)
    scenario: dict[str, Any] = field(default_factory=dict)
    currency: str | None = None
    samples: int | None = None
    chosen: tuple[str, int] | None = None
    check_sentences: tuple[str, ...] = ()
    shortfalls: tuple[Shortfall, ...] = ()
    cut_off: UnworkedPiece | None = None
    cross_slope_pct: float | None = None
    erosion_share: float | None = None
    day_sentences: tuple[str, ...] = ()
    field_start: str | None = None
    money_sentences: tuple[str, ...] = ()
    field_allowed_s: float | None = None
    pull: PullFigures | None = None
    field_remarks: tuple[str, ...] = ()
    parts: tuple[FieldPartPlan, ...] = ()
    ground_sentences: tuple[str, ...] = ()
    prices_assumed: bool = False
    late_ground_per_ha: float | None = None

    @property
    def best(self) -> PlanResult | None:
        """The `chosen` plan, else that of `choose_plan`; None where no plan is feasible."""
        plans = [plan for plan in self.plans if plan.feasible]
        if self.chosen is not None:
            return next((plan for plan in plans if (plan.strategy, plan.tractors) == self.chosen), None)
        return choose_plan(plans, self.allowed_s, self.is_priced) if plans else None

    @property
    def eligible(self) -> list[PlanResult]:
        """The plans to choose from, in their order: all feasible ones, or none where the tractor is too weak."""
        is_too_weak = self.pull is not None and self.pull.is_infeasible
        return [plan for plan in self.plans if plan.feasible and not is_too_weak]

    @property
    def by_count(self) -> dict[int, PlanResult]:
        """The plan to take with every number of tractors, fewest first: cheapest if samples decide, else quickest."""
        best = self.best
        if best is None or not self.eligible:
            return {}
        plans = [plan for plan in self.eligible if plan.works_enough or not best.works_enough]
        chosen = choose_by_count(plans, by_cost=best.expected_cost is not None)
        return chosen | {best.tractors: best}

    @property
    def neighbours(self) -> list[PlanResult]:
        """The plans to take with the next smaller and the next larger number of tractors than the best.

        Of larger numbers none that is slower and dearer than one of more.
        """
        best = self.best
        if best is None:
            return []
        plans = self.by_count.values()
        fewer = [plan for plan in plans if plan.tractors < best.tractors]
        more = [plan for plan in plans if plan.tractors > best.tractors]
        paying = [
            plan
            for plan in more
            if not any(one.ranked_s < plan.ranked_s and one.ranked_cost < plan.ranked_cost for one in more)
        ]
        return [*fewer[-1:], *paying[:1]]

    @property
    def is_priced(self) -> bool:
        """Whether somebody gave the prices of the costs."""
        return not self.prices_assumed and any(plan.cost for plan in self.plans)

    @property
    def cut_off_m2(self) -> float:
        """Ground that obstacles cut off."""
        return 0.0 if self.cut_off is None else self.cut_off.m2

    @property
    def unloads(self) -> bool:
        """Whether stops are to empty what was collected."""
        return bool(self.scenario.get("collects"))

    @property
    def has_knee(self) -> bool:
        """Whether the best plan has so many tractors because one more does not pay: nothing else decides."""
        best = self.best
        return self.chosen is None and best is not None and best.meets_deadline is None

    @property
    def is_recommended(self) -> bool:
        """Whether there is a plan that meets all that was asked for."""
        return self.best is not None and not self.shortfalls

    @property
    def refusal(self) -> str:
        """The first reason why no plan works."""
        return next((plan.reason for plan in self.plans if plan.reason), "no plan is feasible")

    @property
    def missed_by_s(self) -> float | None:
        """Seconds by which the best plan misses the deadline; None when a plan meets it or none can be judged."""
        best = self.best
        if best is None or best.time_s is None or self.allowed_s is None or best.meets_deadline:
            return None
        return best.stated_end_s - self.allowed_s
