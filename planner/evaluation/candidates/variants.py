"""Variants of a candidate's plan: headland passes before or after the swaths, other orders, service stops, and the part
of the field that can be reached.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import TypeVar

import numpy as np
import shapely

from fields.layout.headland_passes import HeadlandPass
from fields.layout.swaths import Swath
from planner.evaluation.context import PlanningContext
from planner.evaluation.layout_repairs import LayoutRepairs
from strategies.headland.entrance_legs import add_entrance
from strategies.headland.plan_passes import (
    HEADLAND_TRANSITIONS,
    HeadlandTransition,
    add_headland_passes,
)
from strategies.path_planning.errors import NoPathError, StrategyError
from strategies.path_planning.turn_kinds import HEADLAND_FIRST
from strategies.program.field_job import FieldJob
from strategies.program.strategy_record import RefinedPlan, Strategy
from strategies.service_stops.stop_plan import add_service_stops, explain_no_service
from vehicle.missions.plan import HEADLAND_PASS, Plan
from vehicle.missions.run import SimulationRun
from vehicle.records import FINISHED

LEFT_OUT_TOLERANCE_M = 20.0  # of headland passes skipped: smaller differences do not decide


def build_for_headland_orders(strategy: Strategy, job: FieldJob, orders: Sequence[str]) -> RefinedPlan:
    """The plan of a job; with an entrance also that for headland passes that come first.

    Several tractors share the headland, so their paths between it and their swaths are short anywhere: only one end of
    each order is at the entrance. One tractor ends its passes where it began them.
    """
    if job.tractors == 1 or job.entrance_lane is None or not job.headland_passes:
        return RefinedPlan(strategy.build(job))
    plans = {
        order: strategy.build(replace(job, entrance_ends=(order != HEADLAND_FIRST, order == HEADLAND_FIRST)))
        for order in orders
    }
    return RefinedPlan(plans[orders[-1]], plan_after_headland=plans.get(HEADLAND_FIRST))


def iter_headland_variants(
    context: PlanningContext, job: FieldJob, refined: RefinedPlan
) -> Iterator[list[RefinedPlan]]:
    """The plan with the headland passes in every possible order, to be compared by simulation.

    Then the same with other transitions, in case none can be driven. With an entrance the drives in and out are part of
    every plan. Raises StrategyError if no order is possible.
    """
    if not job.headland_passes:
        yield (
            [refined]
            if job.entrance_lane is None
            else [RefinedPlan(add_entrance(job, refined.plan), None, refined.remark)]
        )
        return
    for passage in HEADLAND_TRANSITIONS if job.tractors > 1 else HEADLAND_TRANSITIONS[:1]:
        orders = [
            order
            for order in context.request.headland_orders
            if not (passage.single_tractor and order == HEADLAND_FIRST)
        ]
        if orders:  # with one tractor on the headland first, the others would stand in its path
            plans = _build_ordered_plans(job, refined, passage, orders)
            yield [RefinedPlan(plan, None, _describe_left_out(refined, plan)) for plan in plans]


def _build_ordered_plans(
    job: FieldJob, refined: RefinedPlan, passage: HeadlandTransition, orders: Sequence[str]
) -> list[Plan]:
    """The plans of those orders that skip the least of the headland passes."""
    plans: list[Plan] = []
    refusal: StrategyError | None = None
    for order in orders:
        plan = refined.plan_after_headland if order == HEADLAND_FIRST else None
        try:
            plans.append(add_entrance(job, add_headland_passes(job, plan or refined.plan, order, passage)))
        except StrategyError as error:
            refusal = refusal or error
    if refusal is not None and not plans:
        raise refusal
    min_left_out_m = min((float(each.notes["unworked_m"]) for each in plans), default=0.0)
    return [each for each in plans if each.notes["unworked_m"] <= min_left_out_m + LEFT_OUT_TOLERANCE_M]


LEAST_SAID_M = 0.5  # a shorter piece would read as 0 m


def _describe_left_out(refined: RefinedPlan, plan: Plan) -> str | None:
    """The remark of a plan, with what it skips of the headland passes."""
    left_out_m = plan.notes["unworked_m"]
    remarks = [
        refined.remark,
        f"{left_out_m:.0f} m of the headland cannot be reached and are skipped" if left_out_m >= LEAST_SAID_M else None,
    ]
    return "; ".join(each for each in remarks if each) or None


def measure_headland_phase_s(run: SimulationRun) -> float | None:
    """Seconds from the first tractor's start on the headland passes to the last one's end; None without passes."""
    times = []
    for tractor, mission in enumerate(run.plan.missions):
        is_headland_leg = np.array([leg.task.kind == HEADLAND_PASS for leg in mission.legs])
        headland_rows = np.flatnonzero(
            is_headland_leg[run.get_leg_numbers(tractor)] & (run.get_statuses(tractor) != FINISHED)
        )
        times += (
            [float(run.time_s[headland_rows[0]]), float(run.time_s[headland_rows[-1]])] if len(headland_rows) else []
        )
    return max(times) - min(times) if times else None


OTHER_ORDER_REMARK = "in another order of tracks, as the first one cannot be driven"


def list_other_orders(strategy: Strategy, job: FieldJob) -> Iterator[FieldJob]:
    """The job with all tractors reversed, with every second one reversed, and with swaths one after another.

    Only simulation shows whether tractors keep clear of each other and turns stay in the field; reversed orders have
    other turns and other times.
    """
    if job.supply is None:  # loads are divided from the start of an order
        yield replace(job, reversed_tractors=tuple(range(job.tractors)), turn_counts={})
        if job.tractors > 1:
            yield replace(job, reversed_tractors=tuple(range(1, job.tractors, 2)), turn_counts={})
    if strategy.takes_jump and job.jump is None:
        yield replace(job, jump=1, turn_counts={})


def check_formation_supply(job: FieldJob, strategy: Strategy) -> None:
    """Refuse a formation that needs service stops, before it is simulated; raises StrategyError."""
    supply = job.supply
    if supply is None or not strategy.side_by_side or job.tractors == 1 or not supply.one_at_a_time:
        return
    length_m = job.layout.total_length_m + math.fsum(headland_pass.length_m for headland_pass in job.headland_passes)
    if supply.compute_need(length_m, job.layout.width_m) > job.tractors * supply.capacity:
        raise StrategyError(explain_no_service(job, supply))


def list_service_variants(job: FieldJob, strategy: Strategy, choices: Iterable[RefinedPlan]) -> list[RefinedPlan]:
    """The plans with their service stops, without plans that cannot have them; raises StrategyError if none remains.

    If only one tractor can be served at a time, each plan comes with staggered stops and without staggering.
    """
    if job.supply is None:
        return list(choices)
    plans: list[RefinedPlan] = []
    refusal: StrategyError | None = None
    stagger_options = (True, False) if job.supply.one_at_a_time and job.tractors > 1 else (True,)
    for choice, staggered in product(choices, stagger_options):
        try:
            plan = add_service_stops(job, choice.plan, side_by_side=strategy.side_by_side, staggered=staggered)
        except StrategyError as error:
            refusal = refusal or error
            continue
        if staggered or not plans or plan.notes["refills"] != plans[-1].plan.notes["refills"]:
            plans.append(replace(choice, plan=plan, run=None if plan.notes["refills"] else choice.run))
    if refusal is not None and not plans:
        raise refusal
    return plans


MAX_LEFT_OUT_SHARE = 0.1  # of the length of all swaths: if more cannot be reached, the field is refused
MAX_TRIES = 8
MAX_SKIPS = 60  # with repairs that skip whatever cannot be reached
Built = TypeVar("Built")


@dataclass(frozen=True)
class ReachableJob:
    """A job without what cannot be reached, and how much was skipped."""

    job: FieldJob
    left_out_swaths: int = 0
    left_out_swaths_m: float = 0.0
    left_out_passes_m: float = 0.0

    @property
    def remark(self) -> str | None:
        """The remark on what is skipped, None if nothing is."""
        parts = []
        if self.left_out_swaths:
            plural = "s" if self.left_out_swaths > 1 else ""
            parts.append(f"{self.left_out_swaths} piece{plural} of track ({self.left_out_swaths_m:.0f} m)")
        if self.left_out_passes_m >= LEAST_SAID_M:
            parts.append(f"{self.left_out_passes_m:.0f} m of headland")
        skipped = " and ".join(parts)
        verb = "is" if self.left_out_swaths == 1 and len(parts) == 1 else "are"
        return (
            f"{skipped} cannot be reached and {verb} skipped; a wider passage or headland may help" if parts else None
        )

    def drop_swath(self, swath: Swath) -> ReachableJob:
        """The same job without one more swath."""
        layout = self.job.layout
        swaths = tuple(each for each in layout.swaths if each is not swath)
        job = replace(self.job, layout=replace(layout, swaths=swaths), turn_counts={})
        return replace(
            self,
            job=job,
            left_out_swaths=self.left_out_swaths + 1,
            left_out_swaths_m=self.left_out_swaths_m + swath.length_m,
        )


def restrict_to_reachable(job: FieldJob) -> ReachableJob:
    """The job on the connected part of the ground that holds most of the swaths; others are planned on their own."""
    parts = [part for part in shapely.get_parts(job.connector.free).tolist() if isinstance(part, shapely.Polygon)]
    reachable = ReachableJob(job)
    if len(parts) < 2 or not job.layout.swaths:
        return reachable
    part_of_swath = [_find_nearest_part(parts, shapely.LineString(swath.points_m)) for swath in job.layout.swaths]
    length = [
        math.fsum(t.length_m for t, part in zip(job.layout.swaths, part_of_swath, strict=True) if part == n)
        for n in range(len(parts))
    ]
    main_part = max(range(len(parts)), key=lambda n: round(length[n], 3))
    for swath, part in zip(job.layout.swaths, part_of_swath, strict=True):
        reachable = reachable if part == main_part else reachable.drop_swath(swath)
    reachable_passes: list[HeadlandPass] = [
        headland_pass
        for headland_pass in job.headland_passes
        if _find_nearest_part(parts, headland_pass.line) == main_part
    ]
    left_out_m = math.fsum(headland_pass.length_m for headland_pass in job.headland_passes) - math.fsum(
        headland_pass.length_m for headland_pass in reachable_passes
    )
    return replace(
        reachable, job=replace(reachable.job, headland_passes=tuple(reachable_passes)), left_out_passes_m=left_out_m
    )


def _find_nearest_part(parts: list[shapely.Polygon], line: shapely.Geometry) -> int:
    """Index of the part of the ground that holds most of a line, or else is nearest to it."""
    return min(
        range(len(parts)),
        key=lambda n: (-round(parts[n].intersection(line).length, 3), round(parts[n].distance(line), 3)),
    )


def build_for_reachable_job(
    job: FieldJob, build: Callable[[FieldJob], Built], layout_repairs: LayoutRepairs
) -> tuple[Built, ReachableJob]:
    """The result of `build` for the job without short pieces that cannot be reached; raises StrategyError.

    With repairs that skip whatever cannot be reached, the pieces may be as long as they are.
    """
    max_share, max_tries = (1.0, MAX_SKIPS) if layout_repairs.skips_unreachable else (MAX_LEFT_OUT_SHARE, MAX_TRIES)
    reachable = restrict_to_reachable(job)
    whole_m, restricted_m = job.layout.total_length_m, reachable.left_out_swaths_m
    for _ in range(max_tries):
        try:
            return build(reachable.job), reachable
        except NoPathError as error:
            shortest = min(error.swaths, key=lambda track: (round(track.length_m, 3), track.line, track.piece))
            if reachable.left_out_swaths_m - restricted_m + shortest.length_m > max_share * whole_m:
                raise
            reachable = reachable.drop_swath(shortest)
    return build(reachable.job), reachable
