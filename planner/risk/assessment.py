"""How sure a simulated plan is and what it costs, which plan is advised, and a check of samples in full physics."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fields.arrays import Floats
from planner.farm.random_inputs import UncertaintySettings
from planner.farm.workday import Workday
from planner.request.plan_request import CHEAPEST, FASTEST, LEAST_FUEL, PlanRequest
from planner.risk.costs import CostTerms, choose_terms, describe_prices, list_cost_figures
from planner.risk.leg_graph import WORK_PASS, LegGraph, build_leg_graph, measure_leg_consumption
from planner.risk.monte_carlo import (
    DEFAULT_SAMPLES,
    apply_factors,
    compute_variance_shares,
    compute_wilson_interval,
    sample_outcomes,
)
from planner.risk.planned_order import enforce_planned_order
from planner.risk.rain import RainForecast, parse_rain
from reports.common.language import mark_text
from reports.common.plan_records import Shortfall
from reports.common.plan_results import MODEL_ERROR_SHARE, PlanRanking, PlanResult, build_quality_key
from reports.common.wording import format_duration, format_percent, format_price
from reports.plan.plan_wording import has_late_ground_loss
from vehicle.missions.plan import Leg, Mission, Plan
from vehicle.missions.run import DONE, SimulationRun
from vehicle.model.terrain import Terrain
from vehicle.model.tractor import Implement, Tractor
from vehicle.model.work_load import WorkLoad
from vehicle.sim.world import World

MAX_SPEED_FACTOR = 3.0  # times the planned speed: no leg is simulated faster
TIMEOUT_FACTOR = 3.0  # times as long as expected: slower drives are not finished at all
MIN_LEG_S = 0.1
STANDARD_ERROR_FACTOR = 2.0  # two plans must differ by this many standard errors
MIN_FINISH_PROBABILITY = 0.005  # a lower probability means that no plan meets the limit


@dataclass(frozen=True, eq=False)
class PhysicsCheck:
    """Finish (s) of the last tractor, (drives,) each: simulated in physics (nan: no comparison) and by the graph.

    `contact_count` drives had tractors touching (in the field one would stop), `unfinished_count` did not finish;
    neither can be compared with the graph.
    """

    simulated_s: Floats
    graph_s: Floats
    contact_count: int
    unfinished_count: int

    @property
    def mean_relative_error(self) -> float:
        """Mean absolute relative error of the graph; nan if no drive can be compared."""
        error = np.abs(self.graph_s / self.simulated_s - 1.0)
        return float(np.nanmean(error)) if np.isfinite(error).any() else float("nan")


def check_graph_in_physics(
    run: SimulationRun,
    uncertainty: UncertaintySettings,
    tractor: Tractor,
    implement: Implement,
    *,
    terrain: Terrain | None = None,
    load: WorkLoad | None = None,
    drive_count: int = 4,
    seed: int = 1,
) -> PhysicsCheck:
    """Simulate a run again with sampled speed factors on its legs, without stops, breakdowns and late starts.

    Legs are driven at the speeds at which they take their sampled times; what does not depend on speed (changing gear,
    moving the wheels) takes as long as before. Turns sampled quicker than possible are driven as quickly as possible,
    and the graph is evaluated with those times. `terrain` and `load` are as for World.
    """
    leg_uncertainty = uncertainty.disable_input("stops").disable_input("breakdowns").disable_input("late start")
    graph = build_leg_graph(run)
    outcomes = sample_outcomes(graph, leg_uncertainty, samples=drive_count, seed=seed, keep_factors=True)
    assert outcomes.leg_factors is not None
    simulated_s, factor = np.full(drive_count, np.nan), outcomes.leg_factors.copy()
    contact_count = unfinished_count = 0
    for number in range(drive_count):
        plan = scale_speeds(run.plan, graph, factor[:, number], tractor.speed.max_acceleration_mps2)
        repeat = World(plan, tractor, implement, terrain=terrain, load=load).run(
            max_time_s=600.0 + TIMEOUT_FACTOR * float(outcomes.finish_s[number])
        )
        contact_count += bool(repeat.contacts)
        unfinished_count += repeat.outcome != DONE
        if repeat.outcome == DONE and not repeat.contacts:
            simulated_s[number] = repeat.duration_s
            # Gears and wheels limit turns: quick ones take their simulated factors.
            driven_factor = build_leg_graph(repeat).driven_s / np.maximum(graph.driven_s, MIN_LEG_S)
            is_quick_turn = (graph.kind != WORK_PASS) & (factor[:, number] < 1.0) & (graph.driven_s > MIN_LEG_S)
            factor[:, number] = np.where(is_quick_turn, driven_factor, factor[:, number])
    return PhysicsCheck(simulated_s, apply_factors(graph, factor).finish_s, contact_count, unfinished_count)


def scale_speeds(plan: Plan, graph: LegGraph, factor: Floats, acceleration_mps2: float = 0.7) -> Plan:
    """The plan with every leg at the speed at which it takes `factor` (legs,) times its driven time."""
    missions = []
    for tractor, mission in enumerate(plan.missions):
        nodes = graph.get_nodes(tractor)
        gears = [0, *(leg.gear for leg in mission.legs), 0]
        leg_rows = zip(mission.legs, graph.driven_s[nodes].tolist(), factor[nodes].tolist(), strict=True)
        legs = []
        for index, (leg, driven_s, share) in enumerate(leg_rows):
            halts = index + 1 < len(mission.legs) and mission.legs[index + 1].standing_s > 0.0
            standing = (gears[index] != leg.gear or leg.standing_s > 0.0) + (gears[index + 2] != leg.gear or halts)
            lag = 0.5 * standing / acceleration_mps2
            legs.append(replace(leg, speed_mps=_solve_speed(leg, driven_s, share, lag)))
        missions.append(Mission(tuple(legs)))
    return replace(plan, missions=tuple(missions))


def _solve_speed(leg: Leg, driven_s: float, factor: float, lag: float) -> float:
    """The speed v at which length / v + lag v + a fixed time gives the sampled time.

    `lag` v is the time lost by starting and stopping where a leg begins or ends at a standstill.
    """
    length, speed = leg.length_m, leg.speed_mps
    fixed = max(driven_s - length / speed - lag * speed, 0.0)
    scale = driven_s / (length / speed + lag * speed + fixed)
    moving_s = factor * (driven_s / scale) - fixed if scale > 0.0 else 0.0
    root = moving_s * moving_s - 4.0 * lag * length
    if moving_s <= 0.0 or root < 0.0:
        return MAX_SPEED_FACTOR * speed
    return min(2.0 * length / (moving_s + math.sqrt(root)), MAX_SPEED_FACTOR * speed)


@dataclass(frozen=True)
class DecisionCriteria:
    """What plans are judged by beyond their time: samples and their laws, limits, cost, objective and budget.

    Work must be done before the `rain` and the deadline of the `request`; with a farm's `workday` not all time until
    then is for field work. They choose the best plan only if one of these or an objective or a budget is asked for.
    """

    request: PlanRequest
    uncertainty: UncertaintySettings
    cost_terms: CostTerms
    workday: Workday | None = None
    rain: RainForecast | None = None

    @property
    def samples(self) -> int:
        """How many samples are drawn: as asked for, else as many as usual."""
        return DEFAULT_SAMPLES if self.request.samples is None else self.request.samples

    @property
    def objective(self) -> str:
        """What the best plan is."""
        return self.request.objective or CHEAPEST

    @property
    def has_limit(self) -> bool:
        """Whether there is rain or a deadline."""
        return self.rain is not None or self.request.deadline_s is not None

    @property
    def decides_best(self) -> bool:
        """Whether the criteria choose the best plan: with a limit, an objective or a budget."""
        return self.has_limit or self.request.objective is not None or self.request.budget is not None

    @property
    def counts_use(self) -> bool:
        """Whether of as many tractors a slower plan may be the best: where machines are not paid from start to end."""
        return self.decides_best and self.cost_terms.prices.per_hour is None

    @property
    def limit_text(self) -> str:
        """When work must be done, such as "before 17:00"; "" without a limit."""
        request, rain = self.request, self.rain
        limits = [] if request.deadline_s is None else [f"before {request.format_clock_after(request.time_limit_s)}"]
        if rain is not None and request.start_s is not None and rain.certain_onset_s is not None:
            limits.append(f"before {request.format_clock_after(rain.certain_onset_s)}")
        elif rain is not None:
            limits.append("before the rain")
        return " and ".join(dict.fromkeys(limits))

    def sample_field_limit_s(self) -> Floats:
        """Seconds of field work that fit before the deadline or the rain, (samples,); infinite without either."""
        samples, deadline_s = self.samples, self.request.time_limit_s
        rain = np.full(samples, math.inf) if self.rain is None else self.rain.draw_onsets(samples, self.request.seed)
        limit_s = rain if deadline_s is None else np.minimum(rain, deadline_s)
        return limit_s if self.workday is None else self.workday.compute_work_s(limit_s) - self.workday.before_field_s

    def compute_field_clock_s(self, field_s: float) -> float:
        """Seconds after the start by the clock when so many seconds of field work are done."""
        return field_s if self.workday is None else self.workday.compute_clock_s(self.workday.before_field_s + field_s)


def build_decision_criteria(
    request: PlanRequest,
    uncertainty: UncertaintySettings | None = None,
    cost_terms: CostTerms | None = None,
    workday: Workday | None = None,
) -> DecisionCriteria | None:
    """The criteria of a request; None without samples, limit, objective and budget.

    Without `cost_terms` tractors are hired at the prices of the request. Raises RequestError for unreadable rain.
    """
    deciding = (request.deadline_s, request.rain, request.objective, request.budget)
    if request.samples == 0 or (request.samples is None and all(each is None for each in deciding)):
        return None
    return DecisionCriteria(
        request,
        uncertainty or UncertaintySettings(),
        choose_terms(request, cost_terms),
        workday,
        None if request.rain is None else parse_rain(request.rain, request.start_s),
    )


def add_risk_estimate(
    result: PlanResult,
    run: SimulationRun,
    tractor: Tractor,
    implement: Implement,
    area_ha: float,
    criteria: DecisionCriteria | None,
    *,
    terrain: Terrain | None = None,
    fuel_load: WorkLoad | None = None,
) -> PlanResult:
    """The result of a feasible plan with the figures of its samples.

    `fuel_load` is the load by which it uses fuel; None for flat shares of the engine's power.
    """
    if criteria is None or not result.feasible:
        return result
    ordered_run = enforce_planned_order(run, tractor, implement)
    graph = build_leg_graph(ordered_run, measure_leg_consumption(ordered_run, tractor, fuel_load, terrain))
    return replace(result, **list_sampled_figures(graph, criteria, area_ha))


def list_sampled_figures(graph: LegGraph, criteria: DecisionCriteria, area_ha: float) -> dict[str, Any]:
    """Probability, quantiles of the time and costs from samples of a plan, by their names in PlanResult.

    Probability and interval are None without a limit. A plan meets the deadline if it does so in half of the samples,
    as the median is the end that is stated.
    """
    limit_s, samples = criteria.sample_field_limit_s(), criteria.samples
    outcomes = sample_outcomes(
        graph, criteria.uncertainty, samples=samples, seed=criteria.request.seed, limit_s=limit_s
    )
    in_time = int((outcomes.work_finish_s <= limit_s).sum())
    p50_s, p80_s, p95_s = np.quantile(outcomes.finish_s, (0.50, 0.80, 0.95)).tolist()
    p50_work_s, p95_work_s = np.quantile(outcomes.work_finish_s, (0.50, 0.95)).tolist()
    p50_done_s, deadline_s = criteria.compute_field_clock_s(p50_work_s), criteria.request.time_limit_s
    return {
        "meets_deadline": None if deadline_s is None else p50_done_s <= deadline_s,
        "finish_probability": in_time / samples if criteria.has_limit else None,
        "finish_probability_interval": compute_wilson_interval(in_time, samples) if criteria.has_limit else None,
        "p50_s": p50_s,
        "p80_s": p80_s,
        "p95_s": p95_s,
        "p50_done_s": p50_done_s,
        "p95_done_s": criteria.compute_field_clock_s(p95_work_s),
        **list_cost_figures(outcomes, criteria.cost_terms, area_ha),
    }


def mark_chosen_plan(ranking: PlanRanking, criteria: DecisionCriteria | None) -> PlanRanking:
    """The ranking with the plan to take and what its costs cover.

    Plans that miss the deadline as simulated are excluded if others meet it; if none does, the closest remains. The
    same holds for the share that is worked, for rain and budget; the ranking says which of the latter no plan meets.
    """
    if criteria is None:
        return ranking
    plans = [plan for plan in ranking.plans if plan.expected_cost is not None]
    in_time = [plan for plan in plans if plan.meets_deadline is not False]
    if any(plan.works_enough for plan in plans):
        in_time = [plan for plan in in_time if plan.works_enough]
    chosen_key = shortfall = None
    objective = FASTEST  # if nothing else decides, or no plan is in time
    if in_time and criteria.decides_best:
        eligible, shortfall, objective = _select_eligible(in_time, plans, criteria)
        best_plan = choose_best(eligible, objective, criteria.samples)
        chosen_key = best_plan.strategy, best_plan.tractors
    terms, prices = criteria.cost_terms, criteria.cost_terms.prices
    shortfalls = () if shortfall is None else (shortfall,)
    updated = replace(
        ranking,
        currency=prices.currency,
        samples=criteria.samples,
        chosen=chosen_key,
        shortfalls=shortfalls,
        late_ground_per_ha=prices.late_ground_per_ha,
    )
    samples, per_ha = f"{criteria.samples:,}", format_price(prices.late_ground_per_ha)
    covered = mark_text(f"Cost in {prices.currency}, mean of {samples} samples: {describe_prices(terms)}.")
    late = mark_text(f"The cost includes {per_ha} for each hectare that is not done {criteria.limit_text}.")
    return replace(updated, money_sentences=(covered, late) if has_late_ground_loss(updated) else (covered,))


def _select_eligible(
    plans: list[PlanResult], all_plans: list[PlanResult], criteria: DecisionCriteria
) -> tuple[list[PlanResult], Shortfall | None, str]:
    """The eligible plans, what no plan meets (or None), and the objective to choose by."""
    before_rain, note = _select_before_rain(plans, criteria.rain)
    if note is not None:
        return plans, Shortfall("rain", note), FASTEST
    budget = criteria.request.budget
    affordable, all_affordable = (
        [plan for plan in candidates if budget is None or (plan.paid_cost or 0.0) <= budget]
        for candidates in (before_rain, all_plans)
    )
    if affordable or budget is None:
        return affordable, None, criteria.objective
    least_paid, unit = min(plan.paid_cost or 0.0 for plan in before_rain), criteria.cost_terms.prices.currency
    cheapest = [plan for plan in before_rain if plan.paid_cost == least_paid]
    subject = "No plan that finishes in time" if all_affordable else "No plan"
    cheaper_is_late = not all_affordable and min(plan.paid_cost or 0.0 for plan in all_plans) < least_paid
    closest = "the cheapest that finishes in time" if cheaper_is_late else "the cheapest"
    note = f"{subject} is within the budget of {budget:.2f} {unit}; {closest} costs {least_paid:.2f} {unit}."
    return cheapest, Shortfall("budget", note), CHEAPEST


def _select_before_rain(plans: list[PlanResult], rain: RainForecast | None) -> tuple[list[PlanResult], str | None]:
    """The plans that may finish before the rain; if none may, also a sentence that says so."""
    if rain is None:
        return plans, None
    onset_s = rain.certain_onset_s
    if onset_s is not None:
        before_rain = [plan for plan in plans if plan.stated_end_s <= onset_s]
        if before_rain:
            return before_rain, None
        late_s = min(plan.stated_end_s for plan in plans) - onset_s
        return [], f"No plan finishes before the rain; the closest is {format_duration(late_s)} late."
    surest = max(plan.finish_probability or 0.0 for plan in plans)
    if surest >= MIN_FINISH_PROBABILITY:
        return plans, None
    return [], f"No plan finishes before the rain: the surest does in {format_percent(surest)} % of the samples."


def check_best_plan(
    run: SimulationRun,
    tractor: Tractor,
    implement: Implement,
    criteria: DecisionCriteria,
    *,
    terrain: Terrain | None = None,
    load: WorkLoad | None = None,
) -> tuple[PhysicsCheck, dict[str, float]]:
    """Samples of a plan simulated in full physics, and what causes the spread of its time."""
    ordered_run = enforce_planned_order(run, tractor, implement)
    uncertainty, seed = criteria.uncertainty, criteria.request.seed
    check_result = check_graph_in_physics(
        ordered_run, uncertainty, tractor, implement, terrain=terrain, load=load, seed=seed
    )
    graph = build_leg_graph(ordered_run)
    return check_result, compute_variance_shares(graph, uncertainty, samples=criteria.samples, seed=seed)


def describe_check(check_result: PhysicsCheck, variance_shares: dict[str, float]) -> tuple[str, ...]:
    """A sentence on the check in full physics, and one on the main causes of the spread."""
    drive_count = len(check_result.simulated_s)
    touching, unfinished = check_result.contact_count, check_result.unfinished_count
    compared_count = drive_count - touching - unfinished
    off_pct = f"{100.0 * check_result.mean_relative_error:.1f}"
    problems = f"; in {touching} tractors touch" if touching else ""
    problems += f"; in {unfinished} a tractor does not finish" if unfinished else ""
    sentence = (
        f"{compared_count} of {drive_count} samples simulated in full physics could be compared{problems}."
        if math.isnan(check_result.mean_relative_error)
        else f"{compared_count} of {drive_count} samples simulated in full physics finish {off_pct} % off their "
        f"sampled times on average{problems}."
    )
    main_shares = [f"{name} ({100.0 * share:.0f} %)" for name, share in variance_shares.items() if share >= 0.01][:3]
    causes = f"Main causes of uncertain time, by share of its variance: {', '.join(main_shares)}."
    return sentence, *([causes] if main_shares else [])


def choose_best(plans: Sequence[PlanResult], objective: str = CHEAPEST, samples: int = 1) -> PlanResult:
    """The plan to take: of the plans equal to the best one, the one with the fewest tractors.

    All are feasible, and their probabilities are from so many `samples`. Cheapest means the lowest expected cost; of
    plans equal in cost, those clearly less sure than another are excluded. Surest means the highest probability, or
    without a limit the earliest 95th percentile. The objective fuel means the least energy as simulated; plans whose
    energy is not known are left out if that of others is. Of equal plans with as many tractors that take as long the
    one of better quality is taken.
    """
    if objective == CHEAPEST:
        equal = select_surest(
            _select_equally_good_plans(
                plans, lambda plan: plan.ranked_cost, lambda plan: plan.expected_cost_error or 0.0
            ),
            samples,
        )
    elif objective == FASTEST:
        equal = _select_equally_good_plans(plans, lambda plan: plan.ranked_s)
    elif objective == LEAST_FUEL:
        metered = [plan for plan in plans if _compute_finished_energy(plan) is not None] or plans
        equal = _select_equally_good_plans(metered, lambda plan: _compute_finished_energy(plan) or 0.0)
    elif any(plan.finish_probability is None for plan in plans):
        equal = _select_equally_good_plans(plans, _compute_ranked_late_s)
    else:
        equal = select_surest(plans, samples)
    preferred = min(equal, key=_build_preference_key)

    def takes_as_long(plan: PlanResult) -> bool:
        """Whether a plan takes as long as the preferred one within the error of the model."""
        shorter_s = min(plan.ranked_s, preferred.ranked_s)
        return abs(plan.ranked_s - preferred.ranked_s) <= MODEL_ERROR_SHARE * abs(shorter_s)

    as_long = [plan for plan in equal if plan.tractors == preferred.tractors and takes_as_long(plan)]
    return min(as_long, key=lambda plan: (build_quality_key(plan), _build_preference_key(plan)))


def _compute_finished_energy(plan: PlanResult) -> float | None:
    """Litres or kilowatt-hours with the unworked ground finished at the plan's own rate; None where not known."""
    energy = plan.fuel_l if plan.energy_kwh is None else plan.energy_kwh
    return energy if energy is None or not plan.time_s else energy * (1.0 + plan.finishing_s / plan.time_s)


def _compute_ranked_late_s(plan: PlanResult) -> float:
    """The 95th percentile of the time, with the unworked ground finished."""
    return (plan.p95_s or 0.0) + plan.finishing_s


def select_surest(plans: Sequence[PlanResult], samples: int) -> list[PlanResult]:
    """Plans less sure than the surest by no more than the errors of samples and model; all plans without a limit."""
    if any(plan.finish_probability is None for plan in plans):
        return list(plans)
    top = max(plans, key=lambda plan: (plan.finish_probability or 0.0, _compute_sampling_error(plan, samples)))
    top_error = _compute_sampling_error(top, samples)

    def is_clearly_less_sure(plan: PlanResult) -> bool:
        tolerance = STANDARD_ERROR_FACTOR * math.hypot(_compute_sampling_error(plan, samples), top_error)
        return (top.finish_probability or 0.0) - (plan.finish_probability or 0.0) > tolerance + MODEL_ERROR_SHARE

    return [plan for plan in plans if not is_clearly_less_sure(plan)]


def _compute_sampling_error(plan: PlanResult, samples: int) -> float:
    """The standard error of the probability of a plan."""
    share = plan.finish_probability or 0.0
    return math.sqrt(share * (1.0 - share) / samples)


def _select_equally_good_plans(
    plans: Sequence[PlanResult],
    get_value: Callable[[PlanResult], float],
    get_error: Callable[[PlanResult], float] = lambda _: 0.0,
) -> list[PlanResult]:
    """Plans whose value exceeds the lowest by no more than the errors of samples and model."""
    best_plan = min(plans, key=lambda plan: (get_value(plan), -get_error(plan)))
    least, least_error = get_value(best_plan), get_error(best_plan)

    def compute_tolerance(plan: PlanResult) -> float:
        return STANDARD_ERROR_FACTOR * math.hypot(get_error(plan), least_error) + MODEL_ERROR_SHARE * abs(least)

    return [plan for plan in plans if get_value(plan) - least <= compute_tolerance(plan)]


def _build_preference_key(plan: PlanResult) -> tuple[int, float, float, float, float, float, str]:
    """Fewer tractors, then lower cost, earlier finish, higher probability; the rest breaks ties."""
    return (
        plan.tractors,
        round(plan.ranked_cost, 2),
        round(plan.ranked_s, 1),
        -round(plan.finish_probability or 0.0, 6),
        round(_compute_ranked_late_s(plan), 1),
        round(plan.paid_cost or 0.0, 2),
        plan.strategy,
    )
