"""A fleet that goes on from where it is: all work that is left planned anew for the tractors that are left.

What tractors have driven, and what is released to them, stays; from the end of that on each gets a new mission, made as
for work that began earlier (planner.pipeline.going_on). It takes a while: run it in a process of its own.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely

from fields.geometry.overlays import clip_area, extract_polygons, unite_areas
from planner.evaluation.candidates.line_programme import ComposedPlan, sketch_plans
from planner.evaluation.context import GoingOn, PlanningContext, Stand
from planner.evaluation.preparation import prepare_context
from planner.evaluation.site import build_site, build_site_moves
from planner.evaluation.work_order import WorkOrder
from planner.fleet.manager.remaining_work import RemainingWork
from planner.fleet.model.errors import FleetManagerError
from planner.fleet.replanning.gates import drop_open_gates, drop_stale_gates
from planner.fleet.replanning.reassignment import compute_leg_end_pose
from planner.fleet.replanning.replan import (
    ReplanProposal,
    build_plan_from_here,
    build_taken_area,
    build_whole_plan,
    can_help,
    infer_carried_supply,
    simulate_without_conflicts,
)
from planner.pipeline.going_on import PLAN_ERROR_M, list_driven_part, sum_used
from planner.pipeline.outputs.saved_plans import read_done_ground
from strategies.lines.done_lines import build_round_corners, list_places_ahead
from strategies.lines.work_line import build_tool_strip
from strategies.path_planning.errors import StrategyError
from strategies.programmes.site_moves import SiteMoves
from strategies.split_field import STRATEGY
from vehicle.missions.plan import ENTER, LEAVE, Leg, LegGate

PLANNING_S = 60.0  # of real time: a driving fleet has come so far when its new plan is sent


@dataclass(frozen=True, eq=False)
class _Helper:
    """A tractor that goes on: its number, how many legs it keeps, and where it stands then; None on the road."""

    number: int
    kept_legs: int
    stand: Stand | None


def continue_remaining_work(remaining: RemainingWork) -> ReplanProposal:
    """Plan all work that is left once tractors have driven what they keep anew, for the tractors that are left.

    One for whom no work is worth the drive has none. Raises FleetManagerError if no plan works.
    """
    plan = remaining.plan
    scenario = replace(plan.scenario, rain=None, samples=None, deadline_s=None, gnss=False, gnss_table=None)
    supply = infer_carried_supply(plan)
    order = WorkOrder(scenario, plan.field, plan.tractor, plan.implement, supply=supply)
    whole = prepare_context(order, physics=plan.physics)
    ends = [_count_kept_legs(remaining, number) for number in range(plan.tractor_count)]
    helpers = [_build_helper(remaining, n, ends[n], whole) for n in range(plan.tractor_count) if can_help(remaining, n)]
    helpers.sort(key=lambda helper: (helper.stand is None, helper.number))
    if not helpers:
        raise FleetManagerError("Every tractor is leaving the field already, or is left out; nobody can go on.")
    context = _leave_done_work(remaining, whole, ends, helpers)
    half_m = 0.5 * max(context.implement.contact_width_m, context.tractor.width_m)
    taken = build_taken_area(remaining, context, half_m)
    context.site_cache[SiteMoves] = moves = build_site_moves(context, build_site(context, taken))
    composed = _compose_best(context, len(helpers))
    missions = _join_missions(remaining, ends, helpers, composed)
    run = simulate_without_conflicts(remaining, context, build_plan_from_here(remaining, missions))
    new_plan = build_whole_plan(remaining, missions, run)
    numbers = [n for n in range(plan.tractor_count) if n not in remaining.excluded]
    eta_s = float(max(run.finish_s[n] for n in numbers)) / remaining.times
    left_m = math.fsum(moves.lines[number].length_m for number in composed.programme.left)
    work_m = math.fsum(line.length_m for line in moves.lines if not line.is_place)
    sentence = _describe_stands(remaining, context, whole)
    return ReplanProposal(new_plan, tuple(ends), eta_s, work_m - left_m, left_m, 0.0, sentence)


def _count_kept_legs(remaining: RemainingWork, number: int) -> int:
    """How many legs of a tractor stay: what it has driven and what is released to it, up to the end of a line or turn.

    One that drives keeps what it drives until the new plan can be sent.
    """
    state, legs = remaining.states[number], remaining.states[number].mission.legs
    if number in remaining.excluded:
        return min(state.leg + 1, len(legs))
    if not can_help(remaining, number):
        return len(legs)
    if not remaining.has_tractor_driven(number) and state.base_end == 0:
        return 0
    end = max(state.base_end, state.leg + 1)
    if not state.is_standing:
        here_s = state.mission.compute_driven_s(state.leg, state.leg_m)
        while end < len(legs) and state.mission.leg_starts_s[end] < here_s + PLANNING_S * remaining.times:
            end += 1
    is_on_way = not legs[end - 1].implement
    while is_on_way and end < len(legs) and not legs[end].implement and legs[end].task.kind != LEAVE:
        end += 1
    first_out = next((k for k, leg in enumerate(legs) if leg.task.kind == LEAVE), len(legs))
    return max(min(end, first_out), state.base_end, state.leg + 1)


def _build_helper(remaining: RemainingWork, number: int, kept_legs: int, context: PlanningContext) -> _Helper:
    legs = remaining.states[number].mission.legs[:kept_legs]
    if not legs:
        return _Helper(number, 0, None)
    used = 0.0 if context.supply is None else sum_used(legs, context.supply, context.request.width_m)
    ahead = list_places_ahead(remaining.states[number].mission.legs[kept_legs:])
    return _Helper(number, kept_legs, Stand(compute_leg_end_pose(legs[-1], -1), used, ahead))


def _leave_done_work(
    remaining: RemainingWork, context: PlanningContext, ends: Sequence[int], helpers: Sequence[_Helper]
) -> PlanningContext:
    """The context without what is worked once all have driven the legs that they keep, and with where they stand."""
    tool_m, width_m, field = context.driving_rules.tool_m, context.layout.width_m, context.layout.field
    strips = read_done_ground(remaining.plan.saved)
    for number, (state, end) in enumerate(zip(remaining.states, ends, strict=True)):
        legs = list(state.mission.legs[:end])
        if number in remaining.excluded and legs:
            legs[-1:] = list_driven_part(legs[-1], state.leg_m)
        strips += [build_tool_strip(leg.points, tool_m, width_m) for leg in legs if leg.implement]
        strips += build_round_corners(legs, context.driving_rules.radius_m, width_m)
    ground = extract_polygons(unite_areas(np.array(strips, dtype=np.object_))) if strips else shapely.Polygon()
    done = clip_area(ground, field.region_without_obstacles)
    stands = tuple(helper.stand for helper in helpers if helper.stand is not None)
    layout = replace(context.layout, field=replace(field, done=done))
    return replace(context, layout=layout, going_on=GoingOn(PLAN_ERROR_M, stands, may_rest=True))


def _compose_best(context: PlanningContext, tractors: int) -> ComposedPlan:
    """The quickest plan by its lines and moves; raises FleetManagerError where there is none."""
    try:
        *quicker, last = sketch_plans(context, STRATEGY, tractors)
        for sketch in quicker:
            with suppress(StrategyError):
                return sketch.compose()
        return last.compose()
    except StrategyError as refusal:
        raise FleetManagerError(f"The work that is left cannot be planned: {refusal}") from None


def _join_missions(
    remaining: RemainingWork, ends: Sequence[int], helpers: Sequence[_Helper], composed: ComposedPlan
) -> list[tuple[Leg, ...]]:
    """All legs of every tractor: those it keeps, and the new ones with gates by tractors and legs of the fleet."""
    kept = [
        tuple(drop_open_gates(leg, remaining) for leg in state.mission.legs[:end])
        for state, end in zip(remaining.states, ends, strict=True)
    ]
    legs = [list(each) for each in drop_stale_gates(kept, ends)]  # what comes after `ends` are other legs
    working = [helper for helper, tour in zip(helpers, composed.programme.tours, strict=True) if tour]
    for helper, mission in zip(working, composed.plan.missions, strict=True):
        legs[helper.number] += [_renumber_gates(leg, working) for leg in mission.legs]
    return [tuple(each) for each in legs]


def _renumber_gates(leg: Leg, helpers: Sequence[_Helper]) -> Leg:
    gates = (
        LegGate(helpers[gate.tractor].number, helpers[gate.tractor].kept_legs + gate.leg, gate.after_m)
        for gate in leg.gates
    )
    return replace(leg, gates=tuple(gates))


def _describe_stands(remaining: RemainingWork, context: PlanningContext, whole: PlanningContext) -> str:
    """Where the tractors are, and how much is left."""
    places = []
    for number, state in enumerate(remaining.states):
        leg = state.mission.legs[min(state.leg, len(state.mission.legs) - 1)]
        where: Any = "on the road" if remaining.is_on_road(number) else None
        if where is None:
            where = "on the way in" if leg.task.kind == ENTER else _name_line(leg)
        places.append(f"Tractor {number + 1} {'is left out' if number in remaining.excluded else f'is {where}'}.")
        if state.doubt is not None:
            places.append(f"Its place is in doubt: it may be up to {state.doubt.radius_m:.0f} m from where it was.")
    left_ha, whole_ha = context.layout.field.area_ha, whole.layout.field.area_ha
    return " ".join([*places, f"{left_ha:.2f} of {whole_ha:.2f} ha are left."])


def _name_line(leg: Leg) -> str:
    if leg.task.number is None:
        return "on its way"
    words = (
        "on track" if leg.task.is_work and leg.task.kind == "track" else "on headland pass" if leg.task.is_work else ""
    )
    return f"{words} {leg.task.number + 1}" if words else "in a turn"
