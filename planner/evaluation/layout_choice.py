"""The choice of the layout: several layouts are compared by the time one tractor would need."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import accumulate, pairwise

import numpy as np
import shapely

from fields.errors import FieldError
from fields.geometry.field import Field
from fields.layout.options import estimate_layout_cost_m, list_layout_alternatives
from fields.layout.swaths import Layout, lay_swaths
from planner.request.plan_request import SOW, PlanRequest
from strategies.headland.pass_legs import get_headland_legs
from strategies.headland.pass_shares import share_headland
from strategies.program.field_job import FieldJob
from strategies.sequencing.swath_order import search_order
from strategies.sequencing.turn_table import TurnTable

MAX_HEADLAND_PASSES = 50
MAX_SEARCHED_SWATHS = 125  # with more swaths the estimate decides instead of a search
MAX_COMPARED_SWATHS = 250  # in all layouts compared together: the last layouts are dropped
MAX_TIMED_LINES = 4  # turns over more lines are estimated for the comparison
MIN_GAIN = 0.01  # of the time: a smaller gain is uncertain and not worth another bearing or headland pass
EXTRA_PASS_CHARGE = 0.01  # of the time, for one more headland pass: corners take longer than the comparison knows
MAX_EFFORT_RATIO = 1.005  # layouts with a higher estimated effort, relative to the plain one, are not compared
GRID_M = 1e-6


def list_layouts(request: PlanRequest, field: Field, headland_m: float, spacing_m: float = 0.0) -> list[Layout]:
    """The layouts to compare, first the plain one: one bearing, and as many headland passes as the headland takes.

    Bearing and headland of the request, if given, hold for every layout; with both given, or without headland passes,
    there is only one. Swaths are at least `spacing_m` apart so that machines can pass each other, as far as the working
    width allows. Raises FieldError if no swath fits.
    """
    width, bearing = request.width_m, request.bearing_deg
    if request.no_headland:
        return [lay_swaths(field, width, headland_m, bearing)]
    plain_layout = _build_plain_layout(request, field, headland_m, spacing_m)
    layouts = [plain_layout]
    if bearing is None:
        options = (option for option in _list_alternative_layouts(request, plain_layout) if option is not plain_layout)
        layouts += [
            option
            for option in options
            if estimate_layout_cost_m(option) <= MAX_EFFORT_RATIO * estimate_layout_cost_m(plain_layout)
        ][:1]
    if len(plain_layout.swaths) > MAX_SEARCHED_SWATHS:
        return [layouts[_find_cheapest([estimate_layout_cost_m(layout) for layout in layouts])]]
    if request.headland_m is None and plain_layout.headland_passes < MAX_HEADLAND_PASSES:
        layouts += _build_deeper_layout(request, field, plain_layout.headland_passes + 1, spacing_m)
    cumulative_swaths = accumulate(len(layout.swaths) for layout in layouts)
    return [layout for layout, swaths in zip(layouts, cumulative_swaths, strict=True) if swaths <= MAX_COMPARED_SWATHS]


def _build_plain_layout(request: PlanRequest, field: Field, headland_m: float, spacing_m: float) -> Layout:
    """One bearing, inside as many headland passes as the headland takes and the field has room for."""
    width, bearing = request.width_m, request.bearing_deg
    max_passes = min(max(1, math.ceil(headland_m / width - 1e-6)), MAX_HEADLAND_PASSES)
    for count in range(max_passes, 1, -1):
        try:
            depth = headland_m if count == max_passes else count * width
            return lay_swaths(field, width, depth, bearing, headland_passes=count, min_spacing_m=spacing_m)
        except FieldError:
            if request.headland_m is not None:
                raise
    return lay_swaths(field, width, width, bearing, headland_passes=1, min_spacing_m=spacing_m)


def _build_deeper_layout(request: PlanRequest, field: Field, headland_passes: int, spacing_m: float) -> list[Layout]:
    """The most promising layout inside this many headland passes; none if no swath fits."""
    width = request.width_m
    try:
        plain = lay_swaths(
            field,
            width,
            headland_passes * width,
            request.bearing_deg,
            headland_passes=headland_passes,
            min_spacing_m=spacing_m,
        )
    except FieldError:
        return []
    return _list_alternative_layouts(request, plain)[:1] if request.bearing_deg is None else [plain]


def _list_alternative_layouts(request: PlanRequest, plain: Layout) -> list[Layout]:
    """The alternatives to a plain layout; no cells when sowing, as turns of one cell would cross the next."""
    return [one for one in list_layout_alternatives(plain) if request.operation != SOW or len(one.cells) == 1]


def choose_quickest_job_index(jobs: Sequence[FieldJob]) -> int:
    """Index of the job that one tractor finishes soonest; the first one if others gain little."""
    if len(jobs) == 1:
        return 0
    extra_passes = [job.layout.headland_passes > jobs[0].layout.headland_passes for job in jobs]
    return _find_cheapest(
        [
            estimate_single_tractor_s(job) * (1.0 + EXTRA_PASS_CHARGE * more)
            for job, more in zip(jobs, extra_passes, strict=True)
        ]
    )


def _find_cheapest(costs: list[float]) -> int:
    """Index of the lowest cost; 0 if it is hardly below the first."""
    best = min(range(len(costs)), key=lambda place: (round(costs[place], 1), place))
    return best if costs[best] < (1.0 - MIN_GAIN) * costs[0] else 0


def estimate_single_tractor_s(job: FieldJob) -> float:
    """Seconds one tractor needs for the field: best order, headland passes, and missed ground at the same rate."""
    swaths = list(job.layout.swaths)
    order = search_order(swaths, job, TurnTable(job, swaths, MAX_TIMED_LINES), roughly=True)
    headland_s, unreached_m = _estimate_headland_s(job)
    worked_m2 = _compute_worked_m2(job) - unreached_m * job.layout.width_m
    return (order.seconds + headland_s) * job.layout.field.area_m2 / worked_m2


def _estimate_headland_s(job: FieldJob) -> tuple[float, float]:
    """Seconds of the headland passes driven by one tractor with all corners, and the metres that cannot be reached."""
    shift = get_headland_legs(job, share_headland(job, outside_in=True, begin=job.layout.field.entrance)[0])
    if shift is None:
        return 0.0, math.fsum(headland_pass.length_m for headland_pass in job.headland_passes)
    driven_s = math.fsum(leg.length_m / leg.speed_mps for leg in shift.legs)
    gear_changes = sum(a.gear != b.gear for a, b in pairwise(shift.legs))
    return driven_s + gear_changes * job.connector.costs.cusp_s, shift.unworked_m


def _compute_worked_m2(job: FieldJob) -> float:
    """Ground (m2) that the implement works if everything is driven as planned, with square corners."""
    layout, half_width_m = job.layout, 0.5 * job.layout.width_m
    lines = [
        shapely.LinearRing(headland_pass.line) if headland_pass.is_closed else headland_pass.line
        for headland_pass in job.headland_passes
    ]
    headland_strips = shapely.buffer(lines, half_width_m, cap_style="flat", join_style="mitre")
    swath_strips = shapely.buffer(
        [shapely.LineString([t.start_m, t.end_m]) for t in layout.swaths], half_width_m, cap_style="flat"
    )
    worked = shapely.union_all(np.concatenate([headland_strips, swath_strips]), grid_size=GRID_M)
    return float(shapely.intersection(worked, layout.field.boundary, grid_size=GRID_M).area)
