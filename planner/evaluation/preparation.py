"""Makes the planning context of a request: reads its field and machines, and chooses its layout."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import shapely

from fields.arrays import measure_along
from fields.geometry.arithmetic import GRID_M
from fields.geometry.chosen_places import check_entrance, move_entrance_to_outline
from fields.geometry.field import Field
from fields.geometry.field_parts import cut_field_part
from fields.layout.bearings import find_handedness
from fields.layout.headland_passes import HeadlandPass, HeadlandPassSide, lay_headland_passes
from fields.layout.options import replace_bearings
from fields.layout.swaths import Layout, check_width, compute_free_space
from fields.units import MPS_PER_KMH
from planner.errors import RequestError, attach_parameter
from planner.evaluation.context import CLEARANCE_SHARE, MoveStore, PlanningContext
from planner.evaluation.field_physics import (
    FieldPhysics,
    adapt_to_ground,
    build_field_physics,
    check_fuel_is_known,
    list_soil_rows,
)
from planner.evaluation.layout_choice import (
    Report,
    build_effort_rates,
    build_slope_weigher,
    choose_quickest_index,
    count_passes,
    lay_contours,
    list_layouts,
)
from planner.evaluation.machine_outlines import (
    build_body,
    folds_at_gate,
    measure_passage_m,
)
from planner.evaluation.time_share import NO_LIMIT, TimeShare
from planner.evaluation.work_order import (
    PlannedLayout,
    WorkOrder,
    choose_radius_m,
    complete_cost_terms,
    load_gnss_errors,
    read_requested_field,
    resolve_guidance_line,
    size_implement,
)
from planner.farm.settings import Yard
from planner.farm.workday import Workday, build_workday
from planner.request.implement_choice import check_transport_width
from planner.request.plan_request import MIN_CLEARANCE_M, STRAIGHT, PlanRequest
from planner.request.service_points import locate_service_point
from planner.risk.assessment import build_decision_criteria
from planner.risk.costs import CostTerms
from strategies.path_planning.turns import compute_headland_m, list_allowed_kinds
from strategies.rules.battery_supply import ESTIMATE_MARGIN, BatterySupply
from strategies.rules.driving_rules import DrivingRules
from strategies.rules.turn_timing import TurnTimer
from vehicle.control.speed_profile import build_driving_limits
from vehicle.energy.run_energy import build_leg_meter
from vehicle.model.tractor import Implement, Tractor
from vehicle.sim.compile import list_contact_boxes

CORNER_BEND_RAD = 0.25 * math.pi  # times the radius: an arc this long turns by 45 degrees; sharper bends are corners
BYPASSED_WIDTHS = 4.0  # working widths across: the headland is not laid round smaller obstacles
SWING_MARGIN_M = 0.1  # for machines swinging out of a bend, and for guidance
ROW_OFFSET_M = 3.0  # rows of a formation turning exactly side by side would violate a usual clearance
MAX_REVERSE_SPEED_MPS = 5.0 * MPS_PER_KMH  # also in turns with changes of direction


CreateContext = Callable[..., PlanningContext]
DETOUR_FACTOR = 1.5  # of the straight line from the farthest corner of the field to the place
AMPLE_SHARE = 0.8  # of a battery: if one is enough for all work with so much to spare, no stop is planned


def prepare_context(
    order: WorkOrder,
    *,
    report_layouts: Report | None = None,
    physics: FieldPhysics | None = None,
    time_share: TimeShare = NO_LIMIT,
    move_cache: MoveStore | None = None,
) -> PlanningContext:
    """Read the field and the tractor of an order, time the turns, size the headland, lay out the swaths.

    The request or the field names the service point of the supply. `report_layouts` is called with (layouts compared,
    all of them). `physics` replaces heights and soil of the request. Half of a `time_share` may go into comparing
    layouts; then those compared so far decide. A `move_cache` has moves of earlier runs. Raises FieldError,
    VehicleError, StrategyError or RequestError.
    """
    request = order.name_choices()
    with attach_parameter("field"):
        field = read_requested_field(request, order.field)
        request = resolve_guidance_line(request, field)
    with attach_parameter("gnss_table"):
        position_errors = load_gnss_errors(request)
    with attach_parameter("tractor"):
        bare_tractor = order.resolve_tractor()
    with attach_parameter("refill"):
        supply = locate_service_point(request, field, order.supply, is_electric=bare_tractor.battery is not None)
    implement = size_implement(order.implement, request)
    check_transport_width(request.transport_width_m, max(implement.width_m, implement.contact_width_m))
    workday, cost_terms = _settle_terms(order, request, field, bare_tractor, implement)
    with attach_parameter("rain"):
        criteria = build_decision_criteria(request, order.uncertainty, cost_terms, workday)
    farm_tractor = None if cost_terms is None else cost_terms.tractor
    physics = physics or build_field_physics(request, field, bare_tractor, farm_tractor)
    tractor = adapt_to_ground(bare_tractor, physics, field.default_ground)
    check_fuel_is_known(request, physics, cost_terms is not None)
    rules = DrivingRules(
        **_list_speeds(request),
        radius_m=choose_radius_m(request, tractor, field),
        tool_m=tractor.antenna_forward_m + implement.hitch_m,
        boxes=list_contact_boxes(tractor, implement, tractor.guide_m),
        ahead_m=ROW_OFFSET_M if request.clearance_m > MIN_CLEARANCE_M else 0.0,
        limits=build_driving_limits(tractor, field.default_ground),
    ).scale_spacing()
    field = cut_requested_part(field, request, tractor, implement)
    create = partial(
        PlanningContext,
        request=request,
        tractor=tractor,
        bare_tractor=bare_tractor,
        implement=implement,
        position_errors=position_errors,
        criteria=criteria,
        supply=supply,
        cost_terms=cost_terms,
        workday=workday,
        physics=physics,
        time_share=time_share,
        move_cache=move_cache,
    )
    context = _lay_out_field(
        create, request, field, tractor, implement, physics, rules, time_share, report_layouts, order.layout
    )
    battery = None if supply else build_battery_supply(context)
    served = supply or battery
    if served is not None and (refusal := served.explain_least_load(context.layout.width_m)):
        raise RequestError(refusal, parameter="tractor" if battery else None)
    if battery is None:
        return context
    supplied = replace(context, supply=battery)
    supplied.site_cache.update(context.site_cache)
    return supplied


def read_planned_field(order: WorkOrder) -> Field:
    """The field of an order, or the part of it that is asked for; raises HeadlandError."""
    request, field = order.request, read_requested_field(order.request, order.field)
    tractor = order.resolve_tractor()
    return cut_requested_part(field, request, tractor, size_implement(order.implement, request))


def cut_requested_part(field: Field, request: PlanRequest, tractor: Tractor, implement: Implement) -> Field:
    """The part of a field that a request asks for, as far as its machines get; the field without such a wish.

    Raises FieldError if the field has no part of this number.
    """
    if request.part is None:
        return field
    with attach_parameter("field"):
        return cut_field_part(field, request.margin_m, measure_passage_m(tractor, implement), request.part)


def check_machine_and_soil(order: WorkOrder) -> None:
    """Whether the tractor and the soil of an order are known, before any field is read; raises HeadlandError."""
    with attach_parameter("tractor"):
        order.resolve_tractor()
    if order.request.soil is not None:
        list_soil_rows(order.request.soil)


def change_terms(context: PlanningContext, order: WorkOrder) -> PlanningContext:
    """The context of an order that asks for other speeds, prices or times on the same ground, with the same machines.

    Times of turns and losses in them are not measured anew, and no batteries sized: the context is for estimates.
    """
    request, rules = order.name_choices(), context.driving_rules
    workday, cost_terms = _settle_terms(order, request, context.layout.field, context.tractor, context.implement)
    rules = replace(rules, **_list_speeds(request))
    return replace(context, request=request, driving_rules=rules, workday=workday, cost_terms=cost_terms)


def _settle_terms(
    order: WorkOrder, request: PlanRequest, field: Field, tractor: Tractor, implement: Implement
) -> tuple[Workday | None, CostTerms | None]:
    """The day and the prices of an order on its field; None for what no farm gives."""
    with attach_parameter("farm"):
        times, has_gate = order.times, field.entrance is not None and not request.no_headland
        fold_s = implement.fold_s if has_gate and folds_at_gate(tractor, implement) else 0.0
        times = None if times is None else times.drop_folding(implement.folds)
        workday = None if times is None else build_workday(field, request.start_s, times, order.yard or Yard(), fold_s)
        workday = workday.begin_on_field() if workday is not None and order.begins_on_field else workday
    return workday, complete_cost_terms(order.cost_terms, workday, tractor)


def _list_speeds(request: PlanRequest) -> dict[str, Any]:
    """The speeds of driving rules by name."""
    turn_mps = request.effective_turn_speed_mps
    return {
        "work_speed_mps": request.speed_mps,
        "turn_speed_mps": turn_mps,
        "reverse_speed_mps": min(turn_mps, MAX_REVERSE_SPEED_MPS),
    }


def _lay_out_field(
    create: CreateContext,
    request: PlanRequest,
    field: Field,
    tractor: Tractor,
    implement: Implement,
    physics: FieldPhysics,
    rules: DrivingRules,
    time_share: TimeShare,
    report_layouts: Report | None,
    planned: PlannedLayout | None,
) -> PlanningContext:
    """The context of the layout that was `planned`, or the quickest; `create` makes one of what the layout adds."""
    margin_m = 0.5 * max(implement.width_m, tractor.width_m)  # to either side of the guided point
    needed_m = compute_headland_m(request.turn, request.width_m, rules.radius_m, rules.tool_m, margin_m)
    headland_m = needed_m if request.requested_headland_m is None else request.requested_headland_m
    field = _prepare_ground(request, field, tractor, implement, rules.radius_m, margin_m, headland_m)
    check_width(field, request.width_m)
    turn_kinds = list_allowed_kinds(request.turn)
    turn_clock = TurnTimer(tractor, implement, rules, field.default_ground)
    rules = turn_clock.measure_reversal_costs()
    free_space = compute_free_space(field, margin_m)

    def measure_turns(headland_m: float) -> tuple[float | None, ...]:
        """Seconds of turns on a headland that is met squarely."""
        return turn_clock.measure_best_times(request.width_m, headland_m - rules.tool_m - margin_m, turn_kinds)

    def build_context(layout: Layout) -> PlanningContext:
        """The context of one layout: its turns timed and its headland passes laid, with remarks on it."""
        remarks = *field.remarks, *_describe_unmet_wishes(request, layout, needed_m)
        layout = replace(layout, field=replace(field, remarks=remarks))
        turn_times = measure_turns(layout.headland_m)
        turn_s = tuple(turn_clock.estimate_detour_s() if seconds is None else seconds for seconds in turn_times)
        return create(
            layout=layout,
            driving_rules=replace(rules, turn_s=turn_s),
            free_space=free_space,
            fitting_turns=tuple(seconds is not None for seconds in turn_times),
            headland_passes=lay_directed_passes(field, request.width_m, layout.headland_passes, rules.radius_m),
        )

    passing_m = max(implement.contact_width_m, tractor.width_m) + MIN_CLEARANCE_M / CLEARANCE_SHARE
    rates = build_effort_rates(rules, measure_turns(headland_m))
    contexts: list[PlanningContext] = []
    layouts = (
        list_layouts(request, field, headland_m, passing_m, rates)
        if request.swaths == STRAIGHT
        else [lay_contours(request, field, headland_m, passing_m, physics.terrain, rules.radius_m)]
    )
    layouts = next(([one] for one in layouts if planned is not None and planned.fits(one)), layouts)
    weigh = build_slope_weigher(request, physics, tractor, field.default_ground)
    with time_share.save_half() as layout_share:
        for layout in layouts:
            if contexts and layout_share.is_spent():
                break
            contexts.append(build_context(layout))
        context = contexts[choose_quickest_index(contexts, report_layouts, weigh)]
    if request.cell_bearings:
        context = build_context(replace_bearings(context.layout, dict(request.cell_bearings)))
    return context


def _prepare_ground(
    request: PlanRequest,
    field: Field,
    tractor: Tractor,
    implement: Implement,
    radius_m: float,
    margin_m: float,
    headland_m: float,
) -> Field:
    """The field reduced to the ground that may be worked, with its entrance checked."""
    with attach_parameter("entrance"):
        check_entrance(field, headland_m)
    if not request.no_headland:
        field = move_entrance_to_outline(field)
    with attach_parameter("field"):
        swing_m = build_body(tractor, implement).compute_swing_m(radius_m) + SWING_MARGIN_M - margin_m
        bypassed_m = BYPASSED_WIDTHS * request.width_m
        return field.compute_ground_with_margin(request.margin_m, bypassed_m, max(0.0, swing_m))


def _describe_unmet_wishes(request: PlanRequest, layout: Layout, needed_m: float) -> Iterator[str]:
    """Sentences on a bearing without tracks, a headland without room, and passes less deep than turns need."""
    passes = request.headland_passes
    if not layout.swaths and (request.bearing_deg is not None or request.cell_bearings):
        yield "No track fits inside the headland passes, so that the bearing asked for changes nothing."
    if not request.no_headland and layout.headland_passes < count_passes(request, request.requested_headland_m or 0.0):
        yield f"The field has no room for more headland passes than {layout.headland_passes}."
    elif layout.swaths and passes is not None and passes * request.width_m <= needed_m - GRID_M:
        subject = "One headland pass is" if passes == 1 else f"{passes} headland passes are"
        yield (
            f"{subject} {passes * request.width_m:g} m deep, and turns need {needed_m:g} m "
            f"({math.ceil(needed_m / request.width_m - GRID_M)} passes): where they do not fit, they lead over tracks."
        )


def lay_directed_passes(field: Field, width_m: float, pass_count: int, radius_m: float) -> tuple[HeadlandPass, ...]:
    """The headland passes for a turning radius; their direction is mirrored on a mirrored field."""
    headland_passes = lay_headland_passes(field, width_m, pass_count, CORNER_BEND_RAD * radius_m)
    boundary = field.boundary
    rings = [np.asarray(ring.coords)[:-1, :2] for ring in (boundary.exterior, *boundary.interiors)]
    is_left_handed = find_handedness(rings, [] if field.entrance is None else [field.entrance]) > 0
    if is_left_handed:
        return headland_passes
    sides = (
        tuple(HeadlandPassSide(s.points[::-1], -s.end_turn_rad, -s.start_turn_rad) for s in one.sides[::-1])
        for one in headland_passes
    )
    return tuple(replace(one, sides=turned) for one, turned in zip(headland_passes, sides, strict=True))


def build_battery_supply(context: PlanningContext) -> BatterySupply | None:
    """The battery of every tractor; None for diesel, where its use is not known, and where one lasts for all work.

    Raises RequestError for a place to charge at that cannot be read or is too far off.
    """
    load, layout, rules = context.physics.fuel_load, context.layout, context.driving_rules
    meter = None if load is None else build_leg_meter(context.tractor, load, context.physics.terrain)
    lines_m = [measure_along(points)[-1] for points in context.main_lines_m]
    if meter is None or not lines_m:
        return None
    drive, ground, mean_m = meter.drive, layout.field.default_ground, float(np.mean(lines_m))
    swath_kwh = meter.compute_straight_kwh(mean_m, rules.work_speed_mps, True, ground)
    turn_m = rules.turn_s[1] * rules.turn_speed_mps
    supply = BatterySupply(
        capacity=drive.usable_kwh,
        rate_per_m2=(1.0 + ESTIMATE_MARGIN) * swath_kwh / mean_m / layout.width_m,
        stop_s=drive.stop_s,
        meter=meter,
        turn_kwh=(1.0 + ESTIMATE_MARGIN) * meter.compute_straight_kwh(turn_m, rules.turn_speed_mps, False, ground),
    )
    with attach_parameter("refill"):
        located = locate_service_point(context.request, layout.field, supply)
    assert isinstance(located, BatterySupply)
    worked_m = [*(one.length_m for one in layout.swaths), sum(one.length_m for one in context.headland_passes)]
    if sum(supply.compute_need(length_m, layout.width_m) for length_m in worked_m) <= AMPLE_SHARE * drive.usable_kwh:
        return None
    if located.place is None:
        return located
    # The energy of the way to its place and back is set apart.
    place, corners = shapely.Point(located.place), shapely.points(shapely.get_coordinates(layout.field.boundary))
    trip_m = DETOUR_FACTOR * float(shapely.distance(place, corners).max())
    trip_kwh = (1.0 + ESTIMATE_MARGIN) * located.meter.compute_straight_kwh(trip_m, rules.turn_speed_mps, False, ground)
    return replace(located, trip_kwh=trip_kwh, capacity=located.usable_kwh - 2.0 * trip_kwh)
