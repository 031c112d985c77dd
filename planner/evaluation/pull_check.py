"""Whether the tractor can pull the implement at working speed."""

from __future__ import annotations

import math
from bisect import bisect_left

from fields.layout.swaths import WIDTH_STEP_M
from fields.units import KMH_PER_MPS
from planner.farm.machines import FarmTractor
from planner.request.plan_request import PlanRequest
from reports.common.plan_records import PullFigures
from vehicle.energy.draft import DraftRule
from vehicle.energy.load import find_drawbar_share, get_engine_power_kw
from vehicle.model.soil import Soil, Texture
from vehicle.model.tractor import Tractor

USUAL_TEXTURE: Texture = "medium"  # where no soil is named
SPEED_STEP_KMH = 0.5
MIN_SUGGESTED_M, MIN_SUGGESTED_KMH = 1.5, 3.0  # nothing narrower is sold, and nobody tills more slowly


def compute_pull_figures(
    request: PlanRequest,
    tractor: Tractor,
    farm_tractor: FarmTractor | None = None,
    soil: Soil | None = None,
) -> PullFigures | None:
    """Power that the implement needs in a soil and the tractor has at the drawbar; None if unknown.

    The power of the engine is that of the farm's tractor or its sheet, else that of a tractor that comes with Headland.
    """
    engine_kw = find_engine_power_kw(tractor, farm_tractor)
    rule = request.find_draft_rule()
    if engine_kw is None or rule is None:
        return None
    texture = get_texture(soil)
    available_kw = find_drawbar_share(tractor, soil) * engine_kw
    width_m, speed_mps = request.width_m, request.speed_mps
    needed_kw = rule.compute_power_kw(width_m, speed_mps, texture)
    return PullFigures(
        implement=rule.implement,
        width_m=width_m,
        speed_kmh=KMH_PER_MPS * speed_mps,
        depth_cm=rule.depth_cm if rule.follows_depth else None,
        draft_kn=rule.compute_draft_n(width_m, speed_mps, texture) / 1000.0,
        needed_kw=needed_kw,
        engine_kw=engine_kw,
        available_kw=available_kw,
        possible_width_m=_find_possible_width_m(width_m, needed_kw, available_kw),
        possible_speed_kmh=_find_possible_speed_kmh(rule, request, texture, available_kw),
        range_pct=rule.range_pct,
        is_assumed=request.draft is None,
    )


def describe_pull(pull: PullFigures | None, rule: DraftRule | None, soil: Soil | None = None) -> tuple[str, ...]:
    """How the figures of a questioned implement come about; nothing where it can be pulled."""
    if pull is None or rule is None or not pull.is_questioned:
        return ()
    depth = "" if pull.depth_cm is None else f" {pull.depth_cm:g} cm deep"
    return (
        f"The draft of the {pull.implement}, {pull.draft_kn:.0f} kN{depth} in {get_texture(soil)} soil, is that of "
        f"ASAE D497, give or take {rule.range_pct:.0f} %; at the drawbar the tractor is taken to have "
        f"{100.0 * pull.available_kw / pull.engine_kw:.0f} % of its {pull.engine_kw:g} kW.",
    )


def get_texture(soil: Soil | None) -> Texture:
    """Texture for the draft: medium where no soil is named."""
    return USUAL_TEXTURE if soil is None else soil.draft


def find_engine_power_kw(tractor: Tractor, farm_tractor: FarmTractor | None) -> float | None:
    """Power of the engine: that of the tractor in the farm or its sheet, else of the tractor itself."""
    if farm_tractor is not None and farm_tractor.power_kw is not None:
        return farm_tractor.power_kw
    if farm_tractor is not None and farm_tractor.sheet is not None:
        return farm_tractor.sheet.power_kw
    return get_engine_power_kw(tractor)


def _find_possible_width_m(width_m: float, needed_kw: float, available_kw: float) -> float | None:
    """The greatest width that can be pulled at this speed, in half metres; None if no implement is so narrow."""
    possible_m = min(width_m, width_m * available_kw / needed_kw)
    if possible_m != width_m:
        possible_m = math.floor(possible_m / WIDTH_STEP_M + 1e-9) * WIDTH_STEP_M
    return possible_m if possible_m >= MIN_SUGGESTED_M else None


def _find_possible_speed_kmh(
    rule: DraftRule, request: PlanRequest, texture: Texture, available_kw: float
) -> float | None:
    """The greatest speed, up to that asked for, at which this width can be pulled, in half km/h; None if too slow."""

    def needs_less(speed_kmh: float) -> bool:
        return rule.compute_power_kw(request.width_m, speed_kmh / KMH_PER_MPS, texture) <= available_kw

    requested_kmh = KMH_PER_MPS * request.speed_mps
    if needs_less(requested_kmh):
        return requested_kmh if requested_kmh >= MIN_SUGGESTED_KMH else None
    first, last = round(MIN_SUGGESTED_KMH / SPEED_STEP_KMH), math.ceil(requested_kmh / SPEED_STEP_KMH)
    steps = range(first, last)
    possible = bisect_left(steps, True, key=lambda step: not needs_less(step * SPEED_STEP_KMH))
    return steps[possible - 1] * SPEED_STEP_KMH if possible else None
