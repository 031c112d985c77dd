"""Replanning when tractors fail or obstacles appear: the remaining tracks go to the others, simulated from where all
tractors are.

It takes seconds: run `replan_remaining_work` in a process of its own.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely
import shapely.ops

from fields.errors import HeadlandError
from planner.evaluation.candidates.energy_figures import find_service_conflict
from planner.evaluation.candidates.fleet_drive import compute_parallel_clearance_m
from planner.evaluation.context import PlanningContext
from planner.evaluation.preparation import prepare_context
from planner.evaluation.site import build_site, get_site_moves
from planner.evaluation.work_order import WorkOrder
from planner.fleet.manager.remaining_work import SHORTEST_LEG_M, STAND_TOLERANCE_M, RemainingWork
from planner.fleet.model.errors import FleetManagerError
from planner.fleet.model.fleet_plan import FleetPlan, build_timed_missions
from planner.fleet.model.timed_mission import TimedMission
from planner.fleet.replanning.gates import (
    drop_open_gates,
    drop_stale_gates,
    move_gates,
    move_waiting_places,
    renumber_leg_gates,
)
from planner.fleet.replanning.reassignment import (
    HelperTractor,
    assign_pieces,
    build_exit_legs,
    compute_leg_end_pose,
    find_remaining_pieces,
)
from planner.traffic.giving_way import resolve_conflicts
from planner.traffic.precedence import TrafficRules, schedule_plan
from strategies.program.supply import HEADLAND, SERVICE_VEHICLE, Supply
from strategies.programmes.ways import Ways
from strategies.service_stops.stop_plan import (
    add_service_gates,
    add_stops_for_taken_work,
    infer_supply,
    list_service_points,
)
from vehicle.missions.plan import LEAVE, Leg, LegTask, Mission, Plan
from vehicle.missions.run import DONE, SimulationRun
from vehicle.sim.incremental import IncrementalSimulator
from vehicle.sim.world import World

STUB_LENGTH_M = 0.02  # an excluded tractor drives this far in the simulation: it stands in the way
OBSTACLE_MARGIN_M = 0.5
ROAD_M = 1e4
MOST_SINGLE_HELPERS = 5
OPEN_SHARE = 0.02  # of the work: with no more unreachable, no other attempt is made


@dataclass(frozen=True, eq=False)
class ReplanProposal:
    """A new plan: legs before `unchanged_legs` (by tractor) are as before. `eta_s` counts from the request.

    `reassigned_m` of work go to other tractors or change. `unreachable_m` that nobody can reach and `blocked_m` by
    machines or obstacles remain unworked; `sentence` says so.
    """

    plan: FleetPlan
    unchanged_legs: tuple[int, ...]
    eta_s: float
    reassigned_m: float
    unreachable_m: float
    blocked_m: float = 0.0
    sentence: str | None = None


def replan_remaining_work(remaining: RemainingWork) -> ReplanProposal:
    """Give the remaining tracks of excluded tractors to the others. Raises FleetManagerError if no plan works."""
    scenario = replace(
        remaining.plan.scenario, rain=None, samples=None, deadline_s=None, refill=None, gnss=False, gnss_table=None
    )
    order = WorkOrder(scenario, remaining.plan.field, remaining.plan.tractor, remaining.plan.implement)
    context = prepare_context(order, physics=remaining.plan.physics)
    helpers = [number for number in range(remaining.plan.tractor_count) if can_help(remaining, number)]
    if not helpers:
        raise FleetManagerError(
            "Every other tractor is already leaving the field; nobody can take over. Resume one on the field first."
        )
    half_m = 0.5 * max(context.implement.contact_width_m, context.tractor.width_m)
    taken = build_taken_area(remaining, context, half_m)
    best: ReplanProposal | None = None
    first_error: FleetManagerError | None = None
    for keep_m, helper_numbers in _list_attempts(context, helpers):
        blocked = shapely.buffer(taken, half_m + keep_m)  # where the guided point of nobody may be
        try:
            proposal = _attempt_replan(remaining, context, taken, blocked, helper_numbers)
        except HeadlandError as refusal:
            first_error = first_error or (
                refusal if isinstance(refusal, FleetManagerError) else FleetManagerError(str(refusal))
            )
            continue
        if best is None or proposal.unreachable_m < best.unreachable_m:
            best = proposal
        if best.unreachable_m <= OPEN_SHARE * (best.reassigned_m + best.unreachable_m):
            break
    if best is None:
        assert first_error is not None
        raise first_error
    return best


def _list_attempts(context: PlanningContext, helpers: list[int]) -> list[tuple[float, list[int]]]:
    """Attempts (distance to keep from obstacles, helpers): all with ample distance first, then less of either.

    The ample distance is how far a machine reaches ahead of or behind the guided point.
    """
    clear_m = max(max(abs(rear), abs(front)) for rear, front, _ in context.driving_rules.boxes)
    single = [[number] for number in helpers] if len(helpers) > 1 else []
    return [(clear_m, helpers), (0.0, helpers), *((clear_m, numbers) for numbers in single[:MOST_SINGLE_HELPERS])]


def _attempt_replan(
    remaining: RemainingWork,
    context: PlanningContext,
    taken: shapely.Geometry,
    blocked: shapely.Geometry,
    helpers: Sequence[int],
) -> ReplanProposal:
    plan, moves = remaining.plan, get_site_moves(context)
    ways = Ways(build_site(context, taken), moves.finder.settling)
    wide = shapely.buffer(blocked, 0.5)
    ends = [_count_unchanged_legs(remaining, number, wide, number in helpers) for number in range(plan.tractor_count)]
    shares = []  # what each gives away: all that remains of an excluded one, what is blocked of another
    for number, (state, end) in enumerate(zip(remaining.states, ends, strict=True)):
        first, first_m = (state.leg, state.leg_m) if number in remaining.excluded else (end, 0.0)
        shares.append(find_remaining_pieces(state.mission, first, first_m, moves, wide))
    pieces = [piece for share, _ in shares for piece in share]
    helper_tractors = [_build_helper(remaining, number, ends[number]) for number in helpers]
    unreached = assign_pieces(pieces, helper_tractors, ways)
    supply = infer_carried_supply(plan)
    missions = _build_missions(remaining, ways, helper_tractors, ends, supply)
    plan_from_here = build_plan_from_here(remaining, missions)
    run = simulate_without_conflicts(
        remaining, context, plan_from_here if supply is None else add_service_gates(plan_from_here, supply)
    )
    crowding = find_service_conflict(run, supply)
    if crowding is not None:
        raise FleetManagerError(f"The remaining work cannot be planned: {crowding}.")
    reassigned_m = sum(piece.work_m for piece in pieces) - sum(piece.work_m for piece in unreached)
    unreachable_m = sum(piece.work_m for piece in unreached)
    blocked_m = sum(metres for _, metres in shares)
    helper_numbers = [n for n in range(plan.tractor_count) if n not in remaining.excluded]
    eta_s = float(max(run.finish_s[n] for n in helper_numbers)) / remaining.times
    sentences = [*_describe_open_work(remaining, unreachable_m, blocked_m), *_describe_unknown_load(plan, supply)]
    new_plan, sentence = build_whole_plan(remaining, missions, run), " ".join(sentences) or None
    return ReplanProposal(new_plan, tuple(ends), eta_s, reassigned_m, unreachable_m, blocked_m, sentence)


def _describe_open_work(remaining: RemainingWork, unreachable_m: float, blocked_m: float) -> list[str]:
    """What remains unworked and why, in a sentence or two; none for nothing."""
    causes = [f"tractor {number + 1}" for number in remaining.excluded if not remaining.is_on_road(number)]
    causes += ["an obstacle"] if remaining.obstacles else []
    sentences = []
    if blocked_m >= 0.5:
        sentences.append(f"{blocked_m:.0f} m of track are too near {' and '.join(causes)} and remain unworked.")
    if unreachable_m >= 0.5:
        sentences.append(f"{unreachable_m:.0f} m of track cannot be reached and remain unworked.")
    return sentences


def _describe_unknown_load(plan: FleetPlan, supply: Supply | None) -> list[str]:
    """A remark if tractors carry something and the plan does not say how much; none otherwise."""
    if supply is not None or "refills" not in plan.plan.notes:
        return []
    return ["The plan has no service stops, so the size of a load is unknown: check the tanks."]


def build_taken_area(remaining: RemainingWork, context: PlanningContext, half_m: float) -> shapely.Geometry:
    """What no machine may touch: tractors left out, with the clearance round them or where they may be, and obstacles.

    `half_m` is half the width of a machine.
    """
    shapes = [shapely.buffer(shape, OBSTACLE_MARGIN_M) for shape in remaining.obstacles]
    long_m = context.tractor.length_m
    for number in remaining.excluded:
        doubt = remaining.states[number].doubt
        if doubt is not None:
            reach_m = doubt.radius_m + long_m + context.implement.hitch_m + half_m + context.request.clearance_m
            shapes.append(shapely.Point(doubt.pose[:2]).buffer(reach_m))
        elif not remaining.is_on_road(number):
            x, y, heading = remaining.get_pose(number)
            ahead, place = np.array([math.cos(heading), math.sin(heading)]), np.array([x, y])
            tail, nose = place - (long_m + context.implement.hitch_m) * ahead, place + 0.5 * long_m * ahead
            shapes.append(shapely.buffer(shapely.LineString([tail, nose]), half_m + context.request.clearance_m))
    return shapely.union_all(shapes)


def can_help(remaining: RemainingWork, number: int) -> bool:
    """Whether a tractor drives on and is not leaving the field already."""
    state, legs = remaining.states[number], remaining.plan.timed_missions[number].legs
    if number in remaining.excluded:
        return False
    return not any(leg.task.kind == LEAVE for leg in legs[: max(state.base_end, state.leg + 1)])


def _count_unchanged_legs(remaining: RemainingWork, number: int, blocked_area: shapely.Geometry, helps: bool) -> int:
    """How many legs of a tractor stay unchanged: up to its exit legs, or to the first blocked one."""
    state, legs = remaining.states[number], remaining.states[number].mission.legs
    if number in remaining.excluded:
        return min(state.leg + 1, len(legs))
    for k in range(max(state.base_end, state.leg + 1), len(legs)):
        if helps and (legs[k].task.kind == LEAVE or shapely.intersects(state.mission.lines[k], blocked_area)):
            return k
    return len(legs)


def _build_helper(remaining: RemainingWork, number: int, end: int) -> HelperTractor:
    state = remaining.states[number]
    driven_s = state.mission.compute_driven_s(state.leg, state.leg_m)
    remaining_s = 0.0 if state.done else state.mission.leg_starts_s[end] - driven_s
    return HelperTractor(number, remaining_s, compute_leg_end_pose(state.mission.legs[end - 1], -1), [])


def infer_carried_supply(plan: FleetPlan) -> Supply | None:
    """The supply that tractors of a plan carry, inferred from its stops; None without stops."""
    refill_choice = (plan.scenario.refill or "").strip().lower()
    service_place = SERVICE_VEHICLE if refill_choice == SERVICE_VEHICLE else HEADLAND
    return infer_supply(
        [timed_mission.legs for timed_mission in plan.timed_missions], plan.implement.width_m, service_place
    )


def _build_missions(
    remaining: RemainingWork,
    ways: Ways,
    helper_tractors: Sequence[HelperTractor],
    ends: Sequence[int],
    supply: Supply | None,
) -> list[tuple[Leg, ...]]:
    """All legs of every tractor, without gates on excluded ones; legs before `ends` are unchanged.

    Work that is taken over gets service stops as the remaining load of a tractor needs them.
    """
    taken_legs = {helper.number: helper.legs for helper in helper_tractors}
    service_points = list_service_points([timed_mission.legs for timed_mission in remaining.plan.timed_missions])
    missions = []
    for number, (timed_mission, end) in enumerate(zip(remaining.plan.timed_missions, ends, strict=True)):
        legs = [drop_open_gates(leg, remaining) for leg in timed_mission.legs[:end]]
        if (number not in remaining.excluded and end < len(timed_mission.legs)) or taken_legs.get(number):
            legs += taken_legs[number]
            if supply is not None:
                legs = add_stops_for_taken_work(ways, supply, legs, end, service_points)
            if timed_mission.legs[-1].task.kind == LEAVE and ways.site.lane is not None:
                legs += build_exit_legs(ways, ways.site.lane, Mission(tuple(legs)))
        missions.append(tuple(legs))
    return drop_stale_gates(missions, ends)


def build_plan_from_here(remaining: RemainingWork, missions: Sequence[tuple[Leg, ...]]) -> Plan:
    """The remaining plan from where all tractors are; leg k counts from the present leg."""
    missions_from_here = []
    for number, (legs, state) in enumerate(zip(missions, remaining.states, strict=True)):
        if remaining.stays(number, len(legs)):
            missions_from_here.append(Mission((_build_stationary_leg(remaining, number, legs),)))
            continue
        first_leg = _cut_leg(legs[state.leg], state.leg_m) if remaining.has_tractor_driven(number) else legs[0]
        rows = [first_leg, *legs[state.leg + 1 :]]
        missions_from_here.append(Mission(tuple(renumber_leg_gates(leg, remaining, -1) for leg in rows)))
    return Plan(tuple(missions_from_here), {"strategy": "rest"})


def _build_stationary_leg(remaining: RemainingWork, number: int, legs: tuple[Leg, ...]) -> Leg:
    """A stub leg for a tractor that stays where it is; one on the road is moved far away."""
    x, y, heading = remaining.get_pose(number)
    if remaining.is_on_road(number):
        x -= ROAD_M * (number + 1)
    ahead = np.array([math.cos(heading), math.sin(heading)])
    return Leg(np.array([(x, y), (x, y) + STUB_LENGTH_M * ahead]), 1.0, ground=legs[0].ground, task=LegTask())


def _cut_leg(leg: Leg, done_m: float) -> Leg:
    """The remaining part of a leg."""
    line = shapely.LineString(leg.points)
    remaining_line = shapely.ops.substring(line, min(max(done_m, 0.0), line.length - SHORTEST_LEG_M), line.length)
    stand_s = leg.stand_s if done_m <= STAND_TOLERANCE_M else 0.0  # for how long it has stood is unknown
    return replace(leg, points=np.asarray(remaining_line.coords), gates=(), stand_s=stand_s)


def simulate_without_conflicts(remaining: RemainingWork, context: PlanningContext, plan: Plan) -> SimulationRun:
    """Simulate the plan with traffic resolved; raises FleetManagerError if conflicts remain."""
    clearance_m, beside_m = context.request.clearance_m, compute_parallel_clearance_m(context, beside=True)
    machines = context.tractor, context.implement
    ground: dict[str, Any] = {"terrain": context.physics.terrain, "load": context.physics.driven_load}
    rehearsal = IncrementalSimulator(
        *machines, stop_clearance_m=clearance_m, beside_clearance_m=beside_m, seed=context.request.seed, **ground
    )

    def compute_patience_s(tried_plan: Plan) -> float:
        legs = [leg for mission in tried_plan.missions for leg in mission.legs]
        return 600.0 + sum(leg.stand_s + 2.0 * leg.length_m / leg.speed_mps for leg in legs)

    def simulate_alone(mission: Mission) -> SimulationRun:
        single = Plan((mission,))
        return World(single, *machines, **ground).run(max_time_s=compute_patience_s(single))

    def schedule_traffic(tried_plan: Plan, slack: float) -> Plan | None:
        rules = TrafficRules(*machines, clearance_m, beside_m, simulate_alone)
        scheduled_plan = schedule_plan(tried_plan, rules, slack)
        return None if scheduled_plan is None else move_gates(remaining, scheduled_plan)[0]

    def simulate(tried_plan: Plan) -> SimulationRun:
        return rehearsal.simulate(tried_plan, compute_patience_s(tried_plan))

    try:
        run, conflict = resolve_conflicts(plan, simulate, schedule_traffic)
    except HeadlandError as refusal:
        raise FleetManagerError(f"The remaining work cannot be planned: {refusal}") from None
    if conflict is not None or run.outcome != DONE:
        raise FleetManagerError(f"The remaining work cannot be planned: {conflict or run.outcome}.")
    return move_waiting_places(remaining, run, simulate)


def build_whole_plan(remaining: RemainingWork, missions: Sequence[tuple[Leg, ...]], run: SimulationRun) -> FleetPlan:
    """Join the legs driven so far and those of the run into one plan."""
    plan, timed_run, whole_missions, timed_missions = remaining.plan, build_timed_missions(run.plan, run), [], []
    for number, legs in enumerate(missions):
        present_leg, new_legs = remaining.states[number].leg, run.plan.missions[number].legs
        first_count = 1 if remaining.has_tractor_driven(number) else 0
        is_standing = remaining.stays(number, len(legs))
        past_count = len(legs) if is_standing else present_leg + first_count
        past_legs = [replace(leg, gates=(), follow=None) for leg in legs[:past_count]]
        if first_count and not is_standing:  # a standing tractor may have to wait where it is
            present_gates = renumber_leg_gates(new_legs[0], remaining, 1).gates
            past_legs[-1] = replace(past_legs[-1], gates=present_gates)
        future = slice(first_count, first_count if is_standing else None)
        whole_mission = Mission((*past_legs, *(renumber_leg_gates(leg, remaining, 1) for leg in new_legs[future])))
        whole_missions.append(whole_mission)
        past_seconds = remaining.states[number].mission.leg_seconds[: len(past_legs)]
        timed_missions.append(TimedMission(whole_mission, (*past_seconds, *timed_run[number].leg_seconds[future])))
    notes = {**plan.plan.notes, "replanned": True}
    if "refills" in notes:
        stops = notes["refills"] if isinstance(notes["refills"], list) else []
        notes["refills"] = [stop for stop in stops if _is_existing_stop(stop, whole_missions)]
    saved = replace(plan.saved, plan=Plan(tuple(whole_missions), notes))
    finish = tuple(remaining.elapsed_s + float(seconds) for seconds in run.finish_s)
    return replace(
        plan,
        saved=saved,
        timed_missions=tuple(timed_missions),
        finish_s=finish,
        min_clearance_m=min(plan.min_clearance_m, run.min_clearance_m),
    )


def _is_existing_stop(stop: Any, whole_missions: Sequence[Mission]) -> bool:
    """Whether a noted stop of a plan, which may come from outside, still exists in the new legs."""
    try:
        number, k, place = stop["tractor"] - 1, stop["leg"], (stop["x_m"], stop["y_m"])
        leg = whole_missions[number].legs[k]
        return number >= 0 and k >= 0 and leg.stand_s > 0.0 and math.dist(leg.points[0], place) < SHORTEST_LEG_M
    except (TypeError, KeyError, IndexError, OverflowError):
        return False
