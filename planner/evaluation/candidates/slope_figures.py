"""Slopes that the tractors of a run drive along and across, how near they come to rolling over, where they stall."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from fields.arrays import Floats
from fields.geometry.field import Field
from fields.terrain.checks import describe_place
from fields.terrain.slopes import compute_directional_slopes
from planner.evaluation.context import PlanningContext
from reports.common.plan_records import Remark, SlopePlace, Stake
from vehicle.missions.run import RollOverMargin, SimulationRun, Stall
from vehicle.model.terrain import Terrain
from vehicle.records import FINISHED, REC_POSE, REC_SPEED

DRIVE_FORCE = "drive force"
LEVEL_PCT = 0.5  # less is no slope in a sentence
_LACKING = {
    DRIVE_FORCE: "its wheels can push with",
    "grip": "the ground lets its wheels push with",
    "power": "its engine gives",
    "brakes": "its brakes hold",
}


def compute_driven_slopes(run: SimulationRun, tractor: int, terrain: Terrain) -> tuple[Floats, Floats]:
    """Slopes (m/m, each (t,)) under a tractor: along its travel, positive uphill, and across, positive where the ground
    falls to the right of its nose; 0 after its end."""
    poses = run.get_poses(tractor)
    ahead, across = compute_directional_slopes(terrain.compute_gradients(poses[:, :2]), poses[:, 2])
    is_driving = run.get_statuses(tractor) != FINISHED
    direction = np.where(run.record[:, tractor, REC_SPEED] < 0.0, -1.0, 1.0)
    return np.where(is_driving, ahead * direction, 0.0), np.where(is_driving, across, 0.0)


def list_slope_figures(context: PlanningContext, run: SimulationRun) -> dict[str, Any]:
    """The steepest places and the least margin to rolling over by their names in PlanResult; empty on level ground."""
    terrain, field = context.physics.terrain, context.layout.field
    if terrain is None:
        return {}
    slopes = [compute_driven_slopes(run, tractor, terrain) for tractor in range(run.plan.tractors)]
    figures: dict[str, Any] = {
        name: _locate_steepest(run, [own[side] for own in slopes], field)
        for side, name in enumerate(("steepest_along", "steepest_across"))
    }
    if run.roll_over:
        number, margin = min(enumerate(run.roll_over, start=1), key=lambda pair: pair[1].margin_rad)
        figures["rollover"] = _locate(math.degrees(margin.margin_rad), number, margin.x_m, margin.y_m, field)
    return figures


def _locate_steepest(run: SimulationRun, slopes: list[Floats], field: Field) -> SlopePlace:
    tractor = max(range(len(slopes)), key=lambda number: float(np.abs(slopes[number]).max()))
    row = int(np.abs(slopes[tractor]).argmax())
    x, y = run.record[row, tractor, REC_POSE][:2].tolist()
    return _locate(100.0 * float(slopes[tractor][row]), tractor + 1, x, y, field)


def _locate(amount: float, tractor: int, x_m: float, y_m: float, field: Field) -> SlopePlace:
    lon, lat = (None, None) if field.crs is None else field.to_wgs84([(x_m, y_m)])[0].tolist()
    return SlopePlace(amount, tractor, x_m, y_m, lon, lat)


def list_slope_remarks(context: PlanningContext, run: SimulationRun) -> list[Remark]:
    """A remark where a tractor comes nearer to rolling over than its file allows; `find_overturning` refuses more."""
    stability = context.tractor.stability
    if stability is None or not run.roll_over:
        return []
    number, margin = min(enumerate(run.roll_over, start=1), key=lambda pair: pair[1].margin_rad)
    degrees = math.degrees(margin.margin_rad)
    if degrees >= stability.warn_deg:
        return []
    place = describe_place(context.layout.field, margin.x_m, margin.y_m)
    text = (
        f"tractor {number} comes within {degrees:.0f} degrees of rolling over at {place}"
        f"{_describe_cross_slope(context, margin)}; its file warns from {stability.warn_deg:g} degrees"
    )
    return [Remark(Stake.LIFE, text)]


def find_overturning(context: PlanningContext, run: SimulationRun) -> str | None:
    """Why a plan is refused because a tractor would roll over, on a swath, a headland pass or a way; None if none."""
    if context.tractor.stability is None or not run.roll_over:
        return None
    number, margin = min(enumerate(run.roll_over, start=1), key=lambda pair: pair[1].margin_rad)
    if margin.margin_rad > 0.0:
        return None
    place = describe_place(context.layout.field, margin.x_m, margin.y_m)
    return f"tractor {number} would roll over at {place}{_describe_cross_slope(context, margin)}"


def _describe_cross_slope(context: PlanningContext, margin: RollOverMargin) -> str:
    terrain = context.physics.terrain
    if terrain is None:
        return ""
    slope = float(np.hypot(*terrain.compute_gradients([(margin.x_m, margin.y_m)])[0]))
    return f", where the ground slopes by {100.0 * slope:.0f} %"


def describe_stall(stall: Stall, field: Field) -> str:
    """Why and where a tractor cannot go on, without a full stop."""
    place = describe_place(field, stall.x_m, stall.y_m)
    slope_pct = 100.0 * stall.grade
    uphill = f"{abs(slope_pct):.0f} % {'uphill' if slope_pct >= 0.0 else 'downhill'}"
    uphill = uphill if abs(slope_pct) >= LEVEL_PCT else "on level ground"
    verb = "runs away" if stall.lacking == "brakes" else "gets stuck"
    limit = _LACKING.get(stall.lacking, "there is")
    reason = (
        f"tractor {stall.tractor + 1} {verb} at {place}, {uphill}: {stall.needed_n / 1000.0:.1f} kN are needed and "
        f"{limit} {max(stall.available_n, 0.0) / 1000.0:.1f} kN"
    )
    if stall.lacking != DRIVE_FORCE:
        return reason
    # The drive force of a file stands in for the grip, which is often better than that: 0.4 of the weight by rule.
    return f"{reason} by its tractor file; name the soil (loam, firm, soft), and its grip counts instead"
