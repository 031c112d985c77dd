"""Checks of requests before they become jobs, run in the folder with the files of the request."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from planner.errors import attach_parameter

if TYPE_CHECKING:
    from planner.evaluation.work_order import WorkOrder


def build_work_order(values: Mapping[str, Any]) -> WorkOrder:
    """What to plan, from the options of a plan request and its farm; raises HeadlandError as the command does."""
    from planner.pipeline.farm_inputs import GivenOptions

    given = GivenOptions(values, values)
    return given.build_order(given.build_request())


def check_plan_request(values: Mapping[str, Any]) -> None:
    """Raise HeadlandError for a plan request that cannot be fulfilled; all its files are read."""
    from fields.geometry.field_lines import find_line_bearing_deg
    from fields.layout.swaths import check_width
    from planner.evaluation.field_physics import find_requested_soil, read_requested_elevation
    from planner.evaluation.work_order import load_gnss_errors, read_requested_field
    from planner.request.service_points import locate_service_point
    from planner.risk.assessment import build_decision_criteria
    from vehicle.model.tractor import resolve_tractor

    order = build_work_order(values)
    request = order.request
    with attach_parameter("rain"):
        build_decision_criteria(request)
    with attach_parameter("gnss_table"):
        load_gnss_errors(request)
    with attach_parameter("field"):
        field = read_requested_field(request, None)
        check_width(field, request.width_m)
        if request.guidance_line is not None:
            find_line_bearing_deg(field.guidance_lines, request.guidance_line, f"'{field.name}'")
    read_requested_elevation(request, field)
    find_requested_soil(request)
    with attach_parameter("tractor"):
        machine = None if request.refill is None else resolve_tractor(order.tractor or request.tractor)
    with attach_parameter("refill"):
        locate_service_point(
            request, field, order.supply, is_electric=machine is not None and machine.battery is not None
        )


def check_day_request(values: Mapping[str, Any]) -> None:
    """Raise HeadlandError for a day that cannot be planned."""
    from planner.day.input_file import load_day

    with attach_parameter("day"):
        load_day(values["day"], farm=values.get("farm"), rain=values.get("rain"), certainty_pct=values.get("certainty"))


def check_diagnosis_request(values: Mapping[str, Any]) -> None:
    """Raise HeadlandError for an unknown tractor, ground, conversion or effect.

    The logs are read when the job is done.
    """
    from vehicle.identification.diagnosis.demo_logs import draw_hidden_effect
    from vehicle.identification.logs.reader import parse_conventions
    from vehicle.identification.logs.table import parse_mapping
    from vehicle.model.ground import find_ground_index
    from vehicle.model.tractor import resolve_tractor

    tractor = resolve_tractor(values["tractor"])
    with attach_parameter("ground"):
        find_ground_index(values.get("ground", "soil"))
    with attach_parameter("fixes"):
        parse_conventions(values.get("fix", ()))
    parse_mapping(values.get("mapping", ()))
    with attach_parameter("hide"):
        draw_hidden_effect(1, tractor, values.get("hide"))


REQUEST_CHECKS: dict[str, Callable[[Mapping[str, Any]], None]] = {
    "plan": check_plan_request,
    "day": check_day_request,
    "diagnosis": check_diagnosis_request,
}
"""Checks by kind of request."""
