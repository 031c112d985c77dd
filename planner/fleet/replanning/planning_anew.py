"""A fleet plans all work that is left anew: after a failure, round an obstacle, or from where it was stopped.

What tractors have driven, and what is released to them, stays; from the end of that on each gets a new mission, made as
for work that began earlier (planner.pipeline.going_on). It takes a while: run it in a process of its own.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import shapely

from fields.geometry.overlays import clip_area, extract_polygons, intersect, unite, unite_areas
from planner.errors import HeadlandError
from planner.evaluation.candidates.best_drive import drive_best
from planner.evaluation.candidates.line_programme import ComposedPlan, sketch_plans
from planner.evaluation.context import DoneWork, PlanningContext, Stand
from planner.evaluation.preparation import prepare_context
from planner.evaluation.site import build_lane_ground, build_site, build_site_moves
from planner.evaluation.work_order import WorkOrder
from planner.fleet.manager.remaining_work import RemainingWork
from planner.fleet.model.fleet_plan import FleetPlan
from planner.fleet.model.rules import FleetManagerError, FleetRules
from planner.fleet.replanning.from_here import RestDriver, build_whole_plan, cut_leg, drop_settled_gates
from planner.fleet.safety.motion_prediction import PREDICTION_ERROR_M
from planner.pipeline.going_on import PLAN_ERROR_M, list_driven_part, sum_used
from planner.pipeline.outputs.saved_plans import read_done_ground, read_planned_layout, read_supply, read_used
from strategies.lines.done_lines import build_round_corners, list_places_ahead
from strategies.lines.line_wishes import name_line
from strategies.lines.work_line import build_tool_strip
from strategies.path_planning.errors import StrategyError
from strategies.programmes.site_moves import SiteMoves
from strategies.rules.supply import HEADLAND, SERVICE_VEHICLE, Supply
from strategies.service_stops.service_gates import infer_supply
from strategies.split_field import STRATEGY
from vehicle.missions.plan import ENTER, LEAVE, SWATH, Leg, LegGate, Mission
from vehicle.missions.run import SimulationRun

PLANNING_S = 60.0  # of real time: a driving fleet has come so far when its new plan is sent
MENTIONED_M = 0.5  # of track that stays unworked
CLOSED_TEXT = "The entrance is blocked by {causes}: tractors on the field stay there, and none can come in."

_DrivenPlan = tuple[ComposedPlan, list[tuple[Leg, ...]], SimulationRun]
"""A plan that was driven from where all tractors are, with all legs, those that are kept among them."""


@dataclass(frozen=True, eq=False)
class ReplanProposal:
    """A new plan: legs before `unchanged_legs` (by tractor) are as before. `eta_s` counts from the request.

    `reassigned_m` of work are planned anew. `unreachable_m` that are not worth a drive, or that nobody can reach, and
    `blocked_m` by machines or obstacles remain unworked; `sentence` says so, and where the tractors are.
    """

    plan: FleetPlan
    unchanged_legs: tuple[int, ...]
    eta_s: float
    reassigned_m: float
    unreachable_m: float
    blocked_m: float
    sentence: str


@dataclass(frozen=True, eq=False)
class _Helper:
    """A tractor that goes on: its number, how many legs it keeps, and where it stands then; None on the road."""

    number: int
    kept_legs: int
    stand: Stand | None


@dataclass(frozen=True, eq=False)
class _TakenGround:
    """What no machine may touch, by what is there: tractors that are left out by their names, and obstacles."""

    shapes: dict[str, shapely.Geometry]

    @cached_property
    def area(self) -> shapely.Geometry:
        """All of it."""
        return unite(list(self.shapes.values()))

    def name_causes(self, place: shapely.Geometry) -> str:
        """What is there where a place touches it: ``tractor 1 and an obstacle``; "" for a place that does not."""
        return " and ".join(cause for cause, shape in self.shapes.items() if shapely.intersects(shape, place))


def continue_remaining_work(remaining: RemainingWork) -> ReplanProposal:
    """Plan all work that is left once tractors have driven what they keep anew, for the tractors that are left.

    One for whom no work is worth the drive has none. Raises FleetManagerError if no plan works.
    """
    plan, whole = remaining.plan, _prepare_whole(remaining.plan)
    half_m = 0.5 * max(whole.implement.contact_width_m, whole.tractor.width_m)
    taken = _build_taken_ground(remaining, whole, half_m)
    reach_m = max(max(abs(rear), abs(front)) for rear, front, _ in whole.driving_rules.boxes)
    blocked = shapely.buffer(taken.area, half_m + reach_m)  # a guided point in it may have no way on
    ends = [_count_kept_legs(remaining, number, blocked) for number in range(plan.tractor_count)]
    helpers = [
        _build_helper(remaining, n, ends[n], whole) for n in range(plan.tractor_count) if _can_help(remaining, n)
    ]
    helpers.sort(key=lambda helper: (helper.stand is None, helper.number))
    if not helpers:
        raise FleetManagerError("Every tractor is leaving the field already, or is left out; nobody can go on.")
    causes = taken.name_causes(build_lane_ground(whole))
    if causes and any(helper.stand is None for helper in helpers):
        raise FleetManagerError(f"The entrance is blocked by {causes}; clear it: no tractor can get in.")
    context = _leave_done_work(remaining, whole, ends, helpers)
    if causes:
        field = replace(context.layout.field, entrance=None)
        context = replace(context, layout=replace(context.layout, field=field))
    context.site_cache[SiteMoves] = moves = build_site_moves(context, build_site(context, taken.area))
    try:
        composed, missions, run = _drive_best(remaining, context, ends, helpers)
    except FleetManagerError as refusal:
        sentence = " ".join([str(refusal), *_describe_caught(remaining, taken, half_m, reach_m)])
        raise FleetManagerError(sentence, parameter=refusal.parameter) from None
    numbers = [n for n in range(plan.tractor_count) if n not in remaining.excluded]
    left_m = math.fsum(moves.lines[number].length_m for number in composed.programme.left)
    work_m = math.fsum(line.length_m for line in moves.lines if not line.is_place)
    due = context.layout.field.due_region
    blocked_m = intersect(due, taken.area).area / context.layout.width_m
    sentences = [
        *_describe_stands(remaining, whole),
        *([CLOSED_TEXT.format(causes=causes)] if causes else []),
        *_describe_open_work(taken.name_causes(due), left_m, blocked_m),
        *_describe_unknown_load(plan, whole.supply),
    ]
    return ReplanProposal(
        build_whole_plan(remaining, context, missions, run),
        tuple(ends),
        float(max(run.finish_s[n] for n in numbers)) / remaining.times,
        work_m - left_m,
        left_m,
        blocked_m,
        " ".join(sentences),
    )


def _prepare_whole(plan: FleetPlan) -> PlanningContext:
    """The context of the plan of a fleet, with what its tractors carry."""
    scenario = replace(plan.scenario, rain=None, samples=None, deadline_s=None, gnss=False, gnss_table=None)
    supply = infer_carried_supply(plan)
    order = WorkOrder(
        scenario, plan.field, plan.tractor, plan.implement, supply=supply, layout=read_planned_layout(plan.saved)
    )
    return prepare_context(order, physics=plan.physics)


def infer_carried_supply(plan: FleetPlan) -> Supply | None:
    """What tractors of a plan carry: as it says, else as its stops tell; None without either, and with a battery."""
    if plan.tractor.battery is not None:
        return None
    refill_choice = (plan.scenario.refill or "").strip().lower()
    service_place = SERVICE_VEHICLE if refill_choice == SERVICE_VEHICLE else HEADLAND
    return read_supply(plan.saved) or infer_supply(
        [timed_mission.legs for timed_mission in plan.timed_missions], plan.implement.width_m, service_place
    )


def _build_taken_ground(remaining: RemainingWork, context: PlanningContext, half_m: float) -> _TakenGround:
    """Tractors left out, with the clearance round them or where they may be, and obstacles.

    `half_m` is half the width of a machine. Who is predicted to come nearer than the clearance is stopped, and
    predictions err: plans keep away by that much more.
    """
    found: dict[str, list[shapely.Geometry]] = {}
    long_m, away_m = context.tractor.length_m, half_m + context.request.clearance_m + PREDICTION_ERROR_M
    for number in remaining.excluded:
        doubt, shapes = remaining.states[number].doubt, found.setdefault(f"tractor {number + 1}", [])
        if doubt is not None:
            reach_m = doubt.radius_m + long_m + context.implement.hitch_m + away_m
            shapes.append(shapely.Point(doubt.pose[:2]).buffer(reach_m))
        elif not remaining.is_on_road(number):
            for x, y, heading in [remaining.get_pose(number), *remaining.paths.get(number, ())]:
                ahead, place = np.array([math.cos(heading), math.sin(heading)]), np.array([x, y])
                tail, nose = place - (long_m + context.implement.hitch_m) * ahead, place + 0.5 * long_m * ahead
                shapes.append(shapely.buffer(shapely.LineString([tail, nose]), away_m))
    found["an obstacle"] = [shapely.buffer(shape, FleetRules.obstacle_margin_m) for shape in remaining.obstacles]
    return _TakenGround({cause: unite(shapes) for cause, shapes in found.items()})


def _can_help(remaining: RemainingWork, number: int) -> bool:
    """Whether a tractor drives on and is not leaving the field already."""
    state, legs = remaining.states[number], remaining.plan.timed_missions[number].legs
    if number in remaining.excluded:
        return False
    return not any(leg.task.kind == LEAVE for leg in legs[: max(state.base_end, state.leg + 1)])


def _count_kept_legs(remaining: RemainingWork, number: int, blocked: shapely.Geometry) -> int:
    """How many legs of a tractor stay: what it has driven and what is released to it, up to the end of a line or turn.

    One that drives keeps what it drives until the new plan can be sent, but for legs on `blocked` ground.
    """
    state, legs = remaining.states[number], remaining.states[number].mission.legs
    if number in remaining.excluded:
        return min(state.leg + 1, len(legs))
    if not _can_help(remaining, number):
        return len(legs)
    if not remaining.has_tractor_driven(number) and state.base_end == 0:
        return 0
    end, is_blocked = max(state.base_end, state.leg + 1), shapely.intersects(state.mission.lines, blocked)
    if not state.is_standing:
        here_s = state.mission.compute_driven_s(state.leg, state.leg_m)
        while (
            end < len(legs)
            and not is_blocked[end]
            and state.mission.leg_starts_s[end] < here_s + PLANNING_S * remaining.times
        ):
            end += 1
    is_on_way = not legs[end - 1].implement
    while (
        is_on_way and end < len(legs) and not (legs[end].implement or is_blocked[end]) and legs[end].task.kind != LEAVE
    ):
        end += 1
    first_out = next((k for k, leg in enumerate(legs) if leg.task.kind == LEAVE), len(legs))
    return max(min(end, first_out), state.base_end, state.leg + 1)


def _build_helper(remaining: RemainingWork, number: int, kept_legs: int, context: PlanningContext) -> _Helper:
    legs = remaining.states[number].mission.legs[:kept_legs]
    if not legs:
        return _Helper(number, 0, None)
    before = read_used(remaining.plan.saved)[number]
    used = 0.0 if context.supply is None else sum_used(legs, context.supply, context.request.width_m, before)
    ahead = list_places_ahead(remaining.states[number].mission.legs[kept_legs:])
    return _Helper(number, kept_legs, Stand(Mission(tuple(legs)).end, used, ahead, is_folded=legs[-1].folded))


def _leave_done_work(
    remaining: RemainingWork, context: PlanningContext, ends: Sequence[int], helpers: Sequence[_Helper]
) -> PlanningContext:
    """The context without what is worked once all have driven the legs that they keep, and with where they stand."""
    kept = [list(state.mission.legs[:end]) for state, end in zip(remaining.states, ends, strict=True)]
    for number in remaining.excluded:
        kept[number][-1:] = [
            part for leg in kept[number][-1:] for part in list_driven_part(leg, remaining.states[number].leg_m)
        ]
    done, layout = _build_worked_ground(remaining, context, kept), context.layout
    stands = tuple(helper.stand for helper in helpers if helper.stand is not None)
    layout = replace(layout, field=replace(layout.field, done=done))
    return replace(context, layout=layout, going_on=DoneWork(done, PLAN_ERROR_M, stands, may_rest=True))


def _build_worked_ground(
    remaining: RemainingWork, context: PlanningContext, missions: Sequence[Sequence[Leg]]
) -> shapely.Geometry:
    """The ground of the field that is worked by these legs, and what was done before its plan."""
    tool_m, width_m = context.driving_rules.tool_m, context.layout.width_m
    strips = read_done_ground(remaining.plan.saved)
    for legs in missions:
        strips += [build_tool_strip(leg.points, tool_m, width_m) for leg in legs if leg.implement]
        strips += build_round_corners(legs, context.driving_rules.radius_m, width_m)
    ground = extract_polygons(unite_areas(np.array(strips, dtype=np.object_))) if strips else shapely.Polygon()
    return clip_area(ground, context.layout.field.region_without_obstacles)


def _drive_best(
    remaining: RemainingWork, context: PlanningContext, ends: Sequence[int], helpers: Sequence[_Helper]
) -> _DrivenPlan:
    """The plan that is done first; raises FleetManagerError where none can be driven."""
    driver = RestDriver(remaining, context)

    def join(composed: ComposedPlan) -> list[tuple[Leg, ...]]:
        legs = [  # what comes after `ends` are other legs
            [drop_settled_gates(leg, remaining, ends) for leg in state.mission.legs[:end]]
            for state, end in zip(remaining.states, ends, strict=True)
        ]
        programme = composed.programme
        present = [helpers[number] for number in programme.list_present()]
        for number, mission in zip(programme.list_present(), composed.plan.missions, strict=True):
            if programme.tours[number] or len(mission.legs) > 1:  # else it stands where the legs that it keeps end
                for leg in mission.legs:
                    gates = (
                        LegGate(present[gate.tractor].number, present[gate.tractor].kept_legs + gate.leg, gate.after_m)
                        for gate in leg.gates
                    )
                    legs[helpers[number].number].append(replace(leg, gates=tuple(gates)))
        return [tuple(each) for each in legs]

    def measure_alone_s(composed: ComposedPlan) -> list[float]:
        try:
            return driver.measure_alone_s(join(composed))
        except HeadlandError:  # driving it says why
            return [0.0]

    def drive(composed: ComposedPlan) -> tuple[_DrivenPlan | FleetManagerError, float]:
        try:
            missions = join(composed)
            run = driver.drive(missions)
        except FleetManagerError as refusal:
            return refusal, math.inf
        seconds = (run.finish_s[n] for n in range(len(missions)) if n not in remaining.excluded)
        return (composed, missions, run), float(max(seconds))

    try:
        sketches = sketch_plans(context, STRATEGY, len(helpers))
        best = drive_best(sketches, measure_alone_s, drive)
    except StrategyError as refusal:
        raise FleetManagerError(f"The work that is left cannot be planned: {refusal}") from None
    assert not isinstance(best, float)  # nothing is ruled out
    if isinstance(best, FleetManagerError):
        raise best
    return best


def _describe_stands(remaining: RemainingWork, whole: PlanningContext) -> list[str]:
    """Where the tractors are, and how much is left now, with what they keep."""
    places = []
    for number, state in enumerate(remaining.states):
        places.append(_describe_place(remaining, number))
        if state.doubt is not None:
            places.append(f"Its place is in doubt: it may be up to {state.doubt.radius_m:.0f} m from where it was.")
    driven = [
        [*state.mission.legs[: state.leg], *list_driven_part(state.present_leg, state.leg_m)]
        for state in remaining.states
    ]
    field, whole_ha = whole.layout.field, whole.layout.field.area_ha
    left_ha = replace(field, done=_build_worked_ground(remaining, whole, driven)).area_ha
    return [*places, f"{left_ha:.2f} of {whole_ha:.2f} ha are left to work."]


def _describe_place(remaining: RemainingWork, number: int) -> str:
    """Where a tractor is, or that it is left out."""
    task, tractor = remaining.states[number].present_leg.task, number + 1
    if number in remaining.excluded:
        return f"Tractor {tractor} is left out."
    if remaining.is_on_road(number):
        return f"Tractor {tractor} is on the road."
    if task.kind == ENTER:
        return f"Tractor {tractor} is on the way in."
    if task.number is None:
        return f"Tractor {tractor} is on its way."
    if not task.is_work:
        return f"Tractor {tractor} is in a turn."
    if task.kind == SWATH:
        return f"Tractor {tractor} is on track {name_line(task)}."
    return f"Tractor {tractor} is on headland pass {task.number}."


def _describe_caught(remaining: RemainingWork, taken: _TakenGround, half_m: float, reach_m: float) -> list[str]:
    """What helps where what is left out, or an obstacle, is in the way of what tractors keep."""
    sentences = []
    for number, state in enumerate(remaining.states):
        count = remaining.count_base_legs(number)  # it cannot be told to wait on these
        if count == 0 or remaining.stays(number, len(state.mission.legs)):
            continue
        present, *others = state.mission.legs[state.leg : state.leg + count]
        points = np.concatenate([leg.points for leg in (cut_leg(present, state.leg_m), *others)])
        onward = points[-1] - points[-2]
        end = points[-1] + reach_m * onward / np.hypot(*onward)
        cause = taken.name_causes(shapely.LineString([*points, end]).buffer(half_m))
        if cause:
            sentences.append(
                f"What tractor {number + 1} keeps leads too near {cause}: clear the way, or leave tractor {number + 1} "
                "out as well."
            )
    return sentences


def _describe_open_work(near: str, unreachable_m: float, blocked_m: float) -> list[str]:
    """What remains unworked and why, such as `near` what, in a sentence or two; none for nothing."""
    sentences = list[str]()
    if blocked_m >= MENTIONED_M:
        sentences.append(f"{blocked_m:.0f} m of track are too near {near} and remain unworked.")
    if unreachable_m >= MENTIONED_M:
        sentences.append(
            f"{unreachable_m:.0f} m of track cannot be reached, or are not worth the drive, and remain unworked."
        )
    return sentences


def _describe_unknown_load(plan: FleetPlan, supply: Supply | None) -> list[str]:
    """A remark if tractors carry something and the plan does not say how much; none otherwise."""
    if supply is not None or plan.plan.notes.stops is None:
        return []
    return ["The plan has no service stops, so the size of a load is unknown: check the tanks."]
