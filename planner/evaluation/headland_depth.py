"""How deep the headland is: as asked for in metres or passes, or as turns need; what is said where they need more."""

from __future__ import annotations

import math
from dataclasses import replace

from fields.geometry.field import Field
from planner.errors import RequestError, mark_parameter
from planner.request.plan_request import KEPT_GROUND_OPERATIONS, STANDING_CROP_OPERATIONS, PlanRequest
from strategies.path_planning.turns import TurnReach, compute_headland_m

ROUNDING_M = 1e-6


def choose_headland_m(request: PlanRequest, radius_m: float, reach: TurnReach, extra_passes: int) -> float:
    """Depth of the headland (m): as asked for, else what turns need and the extra passes of a repair.

    Raises RequestError where turns need more passes than asked for, and the work allows none over the tracks.
    """
    needed_m = compute_headland_m(request.turn, request.width_m, radius_m, reach)
    if request.requested_headland_m is None:
        return needed_m + extra_passes * request.width_m
    shortage = describe_shallow_headland(request, radius_m, reach)
    if shortage and request.operation in (*KEPT_GROUND_OPERATIONS, *STANDING_CROP_OPERATIONS):
        raise RequestError(
            f"{shortage}, which must not lead over the tracks ({mark_parameter('operation')} {request.operation}); use "
            f"{count_needed_passes(request, needed_m)} passes ({mark_parameter('headland_passes')}).",
            parameter="headland_passes",
        )
    return request.requested_headland_m


def add_headland_remark(field: Field, request: PlanRequest, radius_m: float, reach: TurnReach) -> Field:
    """The field with a remark where turns need more passes than asked for, and so lead over the tracks."""
    shortage = describe_shallow_headland(request, radius_m, reach)
    if not shortage:
        return field
    needed = count_needed_passes(request, compute_headland_m(request.turn, request.width_m, radius_m, reach))
    remark = f"{shortage} ({needed} passes): tractors have to turn over the ends of the tracks"
    return replace(field, remarks=(*field.remarks, f"{remark}."))


def describe_shallow_headland(request: PlanRequest, radius_m: float, reach: TurnReach) -> str:
    """That turns need a deeper headland than the number of passes asked for, as half a sentence; "" where it fits."""
    needed_m = compute_headland_m(request.turn, request.width_m, radius_m, reach)
    passes = request.headland_passes
    if passes is None or passes * request.width_m > needed_m - ROUNDING_M:
        return ""
    subject = "One headland pass is" if passes == 1 else f"{passes} headland passes are"
    return f"{subject} {passes * request.width_m:g} m deep, and turns need {needed_m:g} m"


def count_needed_passes(request: PlanRequest, needed_m: float) -> int:
    """Number of headland passes that are at least so deep."""
    return max(1, math.ceil(needed_m / request.width_m - ROUNDING_M))
