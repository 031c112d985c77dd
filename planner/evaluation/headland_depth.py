"""The headland: how deep it is, as asked for in metres or passes or as turns need, and which way it is driven."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from fields.geometry.field import Field
from fields.layout.bearings import find_handedness
from fields.layout.headland_passes import HeadlandPass, HeadlandPassSide, lay_headland_passes
from planner.request.plan_request import PlanRequest
from strategies.path_planning.turns import TurnReach, compute_headland_m

ROUNDING_M = 1e-6


def choose_headland_m(request: PlanRequest, radius_m: float, reach: TurnReach) -> float:
    """Depth of the headland (m): as asked for, else what turns need."""
    if request.requested_headland_m is not None:
        return request.requested_headland_m
    return compute_headland_m(request.turn, request.width_m, radius_m, reach)


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


def lay_directed_passes(field: Field, width_m: float, pass_count: int, bend_m: float) -> tuple[HeadlandPass, ...]:
    """The headland passes; their direction is mirrored on a mirrored field."""
    headland_passes = lay_headland_passes(field, width_m, pass_count, bend_m)
    boundary = field.boundary
    rings = [np.asarray(ring.coords)[:-1, :2] for ring in (boundary.exterior, *boundary.interiors)]
    is_left_handed = find_handedness(rings, [] if field.entrance is None else [field.entrance]) > 0
    return (
        headland_passes if is_left_handed else tuple(reverse_pass(headland_pass) for headland_pass in headland_passes)
    )


def reverse_pass(headland_pass: HeadlandPass) -> HeadlandPass:
    """A headland pass driven the other way."""
    return replace(
        headland_pass,
        sides=tuple(
            HeadlandPassSide(s.points[::-1], -s.end_turn_rad, -s.start_turn_rad) for s in headland_pass.sides[::-1]
        ),
    )
