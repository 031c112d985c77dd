"""Results of plans and drives, as the planner hands them to the reports: plain frozen data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from reports.common.notebook import ShownResult
from reports.common.shortfalls import PullFigures as PullFigures
from reports.common.shortfalls import Shortfall as Shortfall

Points = npt.NDArray[np.float64]


@dataclass(frozen=True)
class UnworkedPiece:
    """A piece of unworked ground: its area, and a place in it in metres of the field and in degrees.

    `lon` and `lat` are None for a field in local metres.
    """

    m2: float
    x_m: float
    y_m: float
    lon: float | None = None
    lat: float | None = None


OBSTACLE, FENCE, OUTLINE, NO_PATH, STUCK = "obstacle", "fence", "outline", "no path", "stuck"


@dataclass(frozen=True)
class PlanFault:
    """Why and where a plan cannot be driven: a kind above, and the place in metres of the field.

    `number` is that of the obstacle (Field.solid_obstacles, then fences) that is touched.
    """

    kind: str
    number: int | None
    x_m: float
    y_m: float


@dataclass(frozen=True)
class SlopePlace:
    """A slope (percent) or a margin (degrees) at a place of a tractor, counted from 1: metres of the field and degrees.

    `lon` and `lat` are None for a field in local metres.
    """

    amount: float
    tractor: int
    x_m: float
    y_m: float
    lon: float | None = None
    lat: float | None = None


@dataclass(frozen=True, repr=False)
class PlanResult(ShownResult):
    """One plan. Values that were not simulated are None; `reason` says why, or why the plan is infeasible.

    Attributes:
        remark: what its strategy could not do, though the plan can be driven.
        rank: of feasible plans from 1, by the time to finish the field, then tractors.
        time_s, cost: of the plan as driven.
        finished_s, finished_cost: with the unworked ground (`missed_m2`, `largest_missed`) worked at the plan's rate.
        worked_pct, overlap_pct: shares of the field.
        works_enough: whether the share of the ground asked for is that of a recommendation.
        wheel_traffic_m2: finished ground off the headland that wheels went over.
        over_finished_m, over_finished_m2: metres driven with the implement up over ground worked for the last time,
            headland passes included, and the ground under wheels there. `over_finished_charged`: whether that ground
            counts as missed in `finished_s` and `finished_cost`, as it does when sowing and spraying.
        outside_m, outside_along_m: the farthest that tractor or implement, lifted or not, reach beyond the outline of
            the field outside the gate of its entrance, and the length driven with more than is allowed.
        order_gap_pct: how much less driving between tracks another order can take at most; None where the strategy
            gives the order.
        formation_pct: share of the length of all tracks that tractors drive side by side; None without a formation.
        headland_passes, headland_s: passes worked, and seconds from the first tractor on one to the last off it.
        headland_order: whether they are worked "first" or "last"; None without any.
        done_s: end of field work, seconds after the start by the clock: with the path from the entrance, without the
            path back; on a farm with breaks, road and preparation. `finished_done_s`: the same of the finished field.
        ready_s, home_s, transport_s: on a farm, when field work can begin, when all are back in the yard, and tractor
            seconds of road and handling.
        finish_probability: of being done by the deadline and before the rain, with its 95 % interval, from samples.
        p50_s, p80_s, p95_s: quantiles of the time.
        p50_done_s, p95_done_s: quantiles of the end of field work by the clock, as `done_s`.
        paid_cost, expected_cost: mean costs of the samples, the latter with losses on late ground and its standard
            error.
        refills, refilling_s: stops to fill or empty a tank, and their time; None where nothing is carried.
        faults: places where an infeasible plan touches something, leaves the field, or finds no path.
        bound_s: lower bound of the time of a plan that was not simulated because another one is quicker.
        fuel_l, fuel_l_per_ha: litres of fuel of the fleet in the field, by the load of its engines as driven, else by
            the flat shares of a farm; None where neither is known, and for electric tractors.
        energy_kwh, energy_kwh_per_ha: kilowatt-hours from the batteries of electric tractors; None for others.
        charges, charging_s: stops to charge or change batteries, and their time; None for tractors without them.
        co2_kg: of the fuel burnt, or of making the electricity; None where that is not known.
        fuel_l_by_tractor, energy_kwh_by_tractor: the same of each tractor, by its load; None where not known.
        steepest_along, steepest_across: the steepest slope (percent; positive uphill, and where the ground falls to the
            right) that a tractor drives along and across; None without heights. `rollover`: where the margin to
            rolling over (degrees) is least.
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
    largest_missed: UnworkedPiece | None = None
    finished_s: float | None = None
    finished_cost: float | None = None
    wheel_traffic_m2: float | None = None
    over_finished_m: float | None = None
    over_finished_m2: float | None = None
    over_finished_charged: bool = False
    outside_m: float | None = None
    outside_along_m: float | None = None
    turning_s: float | None = None
    waiting_s: float | None = None
    reversals: int | None = None
    min_clearance_m: float | None = None
    collisions: int | None = None
    order_gap_pct: float | None = None
    formation_pct: float | None = None
    on_pareto_front: bool = False
    remark: str | None = None
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


def get_finished_field_s(plan: PlanResult) -> float:
    """Seconds until the field is finished; as driven where the unworked ground is not known."""
    return float((plan.time_s or 0.0) if plan.finished_s is None else plan.finished_s)


def get_finished_field_cost(plan: PlanResult) -> float:
    """Cost of the finished field; as driven where the unworked ground is not known."""
    return float((plan.cost or 0.0) if plan.finished_cost is None else plan.finished_cost)


def get_field_work_end_s(plan: PlanResult) -> float:
    """When field work is done, seconds after the start by the clock."""
    return float((plan.time_s or 0.0) if plan.done_s is None else plan.done_s)


def get_finished_field_end_s(plan: PlanResult) -> float:
    """When the finished field is done, seconds after the start by the clock."""
    return get_finished_field_s(plan) if plan.finished_done_s is None else plan.finished_done_s


def get_stated_s(plan: PlanResult) -> float:
    """The time that every report states, until all tractors are done: the median of samples, else as simulated."""
    return float((plan.time_s or 0.0) if plan.p50_s is None else plan.p50_s)


def get_stated_end_s(plan: PlanResult) -> float:
    """The end of field work that every report states, seconds after the start by the clock.

    It is the median of the samples, and where there are none as simulated.
    """
    if plan.p50_done_s is not None:
        return plan.p50_done_s
    return get_field_work_end_s(plan) + get_stated_s(plan) - (plan.time_s or 0.0)


def get_stated_late_end_s(plan: PlanResult) -> float | None:
    """The end of field work by the clock in 95 % of the samples; None without samples."""
    if plan.p95_done_s is not None or plan.p95_s is None:
        return plan.p95_done_s
    return get_field_work_end_s(plan) + plan.p95_s - (plan.time_s or 0.0)


def get_stated_finished_end_s(plan: PlanResult) -> float:
    """When the finished field is done: the stated end, and the time to finish the unworked ground."""
    return get_stated_end_s(plan) + get_finished_field_end_s(plan) - get_field_work_end_s(plan)


def get_stated_cost(plan: PlanResult) -> float | None:
    """The cost that every report states: the expected one, and where there are no samples as simulated."""
    return plan.cost if plan.expected_cost is None else plan.expected_cost


def get_ranked_s(plan: PlanResult) -> float:
    """Seconds that feasible plans are ranked by: the stated time with the unworked ground finished as well."""
    delay_s = 0.0 if plan.p50_s is None else plan.p50_s - (plan.time_s or 0.0)
    return get_finished_field_s(plan) + delay_s


def build_time_sort_key(plan: PlanResult) -> tuple[float, int, str]:
    """Sort key of feasible plans: time to finish the field to the millisecond, then tractors, then name.

    Unworked ground counts with the time it would take at the plan's own rate.
    """
    return round(get_ranked_s(plan), 3), plan.tractors, plan.strategy


def build_merit_sort_key(plan: PlanResult, allowed_s: float | None = None) -> tuple[bool, int, float, float, int, str]:
    """Sort key for the best of feasible plans: those that work enough, of them those in time by cost, late by time.

    A plan that could finish the field within `allowed_s` comes before one that is in time but leaves ground.
    """
    late = 2 if not plan.meets_deadline else int(allowed_s is not None and get_stated_finished_end_s(plan) > allowed_s)
    cost = 0.0 if late == 2 else get_finished_field_cost(plan)
    return not plan.works_enough, late, cost, *build_time_sort_key(plan)


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
        advice: a sentence on the plan to take and its neighbours, from `samples`, costs in `currency`.
        chosen: that plan (strategy, tractors) where there is a deadline, rain or objective.
        check_sentences: how far the samples can be trusted.
        day_sentences: clock times of the best plan.
        shortfalls: what keeps the best plan from being a recommendation.
        cut_off_m2: ground that obstacles cut off from the field that is worked.
        field_start, field_allowed_s: on a farm, when field work can begin and how long it can last.
        money_sentences: what the costs include; `prices_assumed` whether nobody gave their prices.
        parts: further parts of a divided field, each with a plan of its own.
        changes: of a request without a plan, the smallest changes that were found to work.
        pull: whether the tractor can pull the implement; None where its power or the draft is not known.
        field_remarks: sentences on the field file, such as what of it is avoided as an obstacle.
        ground_sentences: what heights, soil and load are taken, and what the soil bears; empty without any.
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
    advice: str | None = None
    currency: str | None = None
    samples: int | None = None
    chosen: tuple[str, int] | None = None
    check_sentences: tuple[str, ...] = ()
    shortfalls: tuple[Shortfall, ...] = ()
    cut_off_m2: float = 0.0
    day_sentences: tuple[str, ...] = ()
    field_start: str | None = None
    money_sentences: tuple[str, ...] = ()
    field_allowed_s: float | None = None
    changes: tuple[str, ...] = ()
    pull: PullFigures | None = None
    field_remarks: tuple[str, ...] = ()
    parts: tuple[FieldPartPlan, ...] = ()
    ground_sentences: tuple[str, ...] = ()
    prices_assumed: bool = False

    @property
    def best(self) -> PlanResult | None:
        """The `chosen` plan, else the one that finishes first; with a deadline the cheapest in time.

        Plans that could finish the whole field by the deadline come first.
        """
        plans = [plan for plan in self.plans if plan.feasible]
        if self.chosen is not None:
            return next((plan for plan in plans if (plan.strategy, plan.tractors) == self.chosen), None)
        return min(plans, key=lambda plan: build_merit_sort_key(plan, self.allowed_s), default=None)

    @property
    def is_recommended(self) -> bool:
        """Whether there is a plan that meets all that was asked for."""
        return self.best is not None and not self.shortfalls

    @property
    def refusal(self) -> str:
        """The first reason why no plan works, and what was found to work."""
        reason = next((plan.reason for plan in self.plans if plan.reason), "no plan is feasible")
        return f"{reason.rstrip('.')}. Found to work: {' or '.join(self.changes)}" if self.changes else reason

    @property
    def missed_by_s(self) -> float | None:
        """Seconds by which the best plan misses the deadline; None when a plan meets it or none can be judged."""
        best = self.best
        if best is None or best.time_s is None or self.allowed_s is None or best.meets_deadline:
            return None
        return get_stated_end_s(best) - self.allowed_s


@dataclass(frozen=True)
class DriverLeg:
    """One leg of a tractor: a row of the list for its driver.

    Attributes:
        kind: "track", "round" (one side of a headland pass), "corner" (between two sides), "turn" or "way" (to the next
            track or pass), "enter" (from the entrance), "leave" (back to it), "wait", "drive", "refill-way" (to the
            service point), "refill" (of `amount`, below 0 where a tank is emptied), or "charge" or "change" (of a
            battery, `amount` in kWh).
        number: of the track or headland pass, from 1; turns and ways have those of their goal.
        part: piece of a track ("a", "b", ...) or side of a pass ("1", "2", ...), "" where there is only one.
        is_headland_pass: whether `number` counts headland passes.
        continues: whether it continues after a wait.
        from_s, seconds, length_m: begin, duration and length.
        bearing_deg: direction worked in, clockwise from north.
        over_swaths, shape: of a turn, how many tracks it leads over, and "u", "omega", "switch-back" or "".
        for_tractors: numbers, from 1, of the tractors that are waited for.
        reversing_m: metres of it in reverse.
        over_finished: names of the tracks, and "headland", of finished ground that it leads over; `over_finished_m`:
            metres on it.
        x_m, y_m: the place half way along it.
        fuel_l, energy_kwh: used on it; None where not known.
        slope_along_pct, slope_across_pct: the steepest on it, positive uphill and where the ground
            falls to the right; None without heights.
    """

    kind: str
    number: int | None
    part: str
    from_s: float
    seconds: float
    length_m: float
    x_m: float
    y_m: float
    is_headland_pass: bool = False
    continues: bool = False
    bearing_deg: float | None = None
    over_swaths: int | None = None
    shape: str = ""
    for_tractors: tuple[int, ...] = ()
    amount: float | None = None
    reversing_m: float = 0.0
    over_finished: tuple[str, ...] = ()
    over_finished_m: float = 0.0
    fuel_l: float | None = None
    energy_kwh: float | None = None
    slope_along_pct: float | None = None
    slope_across_pct: float | None = None


@dataclass(frozen=True, eq=False)
class HeadlandPassLine:
    """A headland pass: its number from 1 and its centre line (n, 2) in metres, closed if the first is repeated."""

    number: int
    points: Points


@dataclass(frozen=True, eq=False)
class CellOutline:
    """A cell of the field: number from 1, bearing of its tracks, rings (n, 2) and a place inside, metres."""

    number: int
    bearing_deg: float
    rings: tuple[Points, ...]
    x_m: float
    y_m: float


@dataclass(frozen=True, eq=False)
class Relief:
    """Heights of a field to draw.

    `shade` (rows from south to north, columns from west to east) is the brightness from 0 to 1 of pixels that cover
    west, south, east and north `bounds_m`; `contours` are heights and lines (n, 2) in metres, `interval_m` apart.
    """

    shade: Points
    bounds_m: tuple[float, float, float, float]
    contours: tuple[tuple[float, Points], ...]
    interval_m: float


@dataclass(frozen=True, eq=False, repr=False)
class PlanDrive(ShownResult):
    """The drive of all tractors of one plan, for pictures. Metres, rings and lines (n, 2).

    Attributes:
        boundary, holes: rings.
        swaths: centre lines (n, 2) each; `swath_names`: their names, by default their places from 1.
        xy, status: per tractor the guided point (t, 2) and its status (t,) every `step_s`: 0 finished, 1 working,
            2 turning, 3 waiting, 4 reversing, 5 refilling.
        seconds: per state (working, turning, waiting, reversing, and refilling where there is any) one value per
            tractor.
        unworked: rings around unworked ground, counter-clockwise, and clockwise around worked ground inside it.
        headland_passes: those that are worked.
        cells: of a field that has several.
        obstacles, fences: rings, and lines along the outline.
        steps: the legs of each tractor, in order.
        cut_off: pieces of ground that obstacles cut off.
        worked_pct: share of the field that is worked.
        fault_places: places (x, y) where plans cannot be driven.
        crs, origin_m: system and origin of the metres on the earth; None for local metres.
        relief: heights; None for level ground.
    """

    title: str
    boundary: Points
    holes: tuple[Points, ...]
    swaths: Sequence[Points]
    width_m: float
    step_s: float
    xy: tuple[Points, ...]
    status: tuple[npt.NDArray[np.int64], ...]
    finish_s: tuple[float, ...]
    seconds: dict[str, tuple[float, ...]]
    entrance: tuple[float, float] | None = None
    unworked: tuple[Points, ...] = ()
    largest_missed: UnworkedPiece | None = None
    swath_names: tuple[str, ...] = ()
    headland_passes: tuple[HeadlandPassLine, ...] = ()
    cells: tuple[CellOutline, ...] = ()
    obstacles: tuple[Points, ...] = ()
    fences: tuple[Points, ...] = ()
    steps: tuple[tuple[DriverLeg, ...], ...] = ()
    cut_off: tuple[UnworkedPiece, ...] = ()
    worked_pct: float | None = None
    fault_places: tuple[tuple[float, float], ...] = ()
    crs: str | None = None
    origin_m: tuple[float, float] = (0.0, 0.0)
    relief: Relief | None = None
