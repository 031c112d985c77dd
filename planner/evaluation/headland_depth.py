"""How deep the headland is: as asked for in metres or passes, or as turns need; what is said where they need more."""

from __future__ import annotations

import math
from dataclasses import replace

from fields.geometry.field import Field
from planner.request.plan_request import PlanRequest
from strategies.path_planning.turns import TurnReach, compute_headland_m

ROUNDING_M = 1e-6


def choose_headland_m(request: PlanRequest, radius_m: float, reach: TurnReach, extra_passes: int) -> float:
    """Depth of the headland (m): as asked for, else what turns need and the extra passes of a repair."""
    if request.requested_headland_m is not None:
        return request.requested_headland_m
    return compute_headland_m(request.turn, request.width_m, radius_m, reach) + extra_passes * request.width_m


def add_headland_remark(field: Field, request: PlanRequest, radius_m: float, reach: TurnReach) -> Field:
    """The field with a remark where turns need more headland passes than asked for."""
    shortage = describe_shallow_headland(request, radius_m, reach)
    return field if not shortage else replace(field, remarks=(*field.remarks, shortage))


def describe_shallow_headland(request: PlanRequest, radius_m: float, reach: TurnReach) -> str:
    """A sentence that turns need more headland passes than asked for; "" where they fit or planning decides."""
    needed_m = compute_headland_m(request.turn, request.width_m, radius_m, reach)
    passes = request.headland_passes
    if passes is None or passes * request.width_m > needed_m - ROUNDING_M:
        return ""
    subject = "One headland pass is" if passes == 1 else f"{passes} headland passes are"
    return (
        f"{subject} {passes * request.width_m:g} m deep, and turns need {needed_m:g} m "
        f"({math.ceil(needed_m / request.width_m - ROUNDING_M)} passes): where they do not fit, they lead over tracks."
    )
