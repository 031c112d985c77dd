"""The choice of the layout: several layouts are compared by the time one tractor would need."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import accumulate

import numpy as np

from fields.arrays import Floats
from fields.geometry.field import Field
from fields.geometry.overlays import clip_area
from fields.layout.cells import CELL_COST_M, PLAIN_RATES, EffortRates
from fields.layout.contours import lay_contour_swaths
from fields.layout.headland_passes import compute_inner_region, lay_headland_passes
from fields.layout.options import estimate_layout_cost_m, find_cheapest_bearing_deg, list_layout_alternatives
from fields.layout.parallel_lines import TURN_COST_M
from fields.layout.swaths import Layout, lay_swaths
from fields.terrain.slopes import cut_into_steps
from fields.units import KILO
from planner.errors import FieldError, RequestError, mark_parameter
from planner.evaluation.context import PlanningContext
from planner.evaluation.field_physics import FieldPhysics, build_grid
from planner.evaluation.site import get_site_moves, store_moves
from planner.evaluation.time_share import TimeSpentError
from planner.request.plan_request import CONTOUR, LEAST_FUEL, MAX_HEADLAND_PASSES, SOW, PlanRequest
from strategies.lines.work_line import WorkLine
from strategies.programmes.driven_search import TourProblem
from strategies.programmes.move_table import MoveTable
from strategies.programmes.programme import sketch_programme
from strategies.programmes.site_moves import SiteMoves
from strategies.programmes.stages import charge_furrows, list_stages
from strategies.rules.driving_rules import DrivingRules
from strategies.site.site import Site
from vehicle.energy.run_energy import STEP_M, choose_rolling_share, estimate_consumption
from vehicle.model.terrain import Terrain
from vehicle.model.tractor import Tractor
from vehicle.model.work_load import WorkLoad
from vehicle.records import GRAVITY_MPS2

MAX_SEARCHED_SWATHS = 125  # with more swaths the estimate decides instead of a search
MAX_COMPARED_SWATHS = 300  # in all layouts compared together: the last layouts are dropped
PROMISING, DEEPER = 3, 1  # layouts compared inside as many headland passes as turns need, and inside more
DEEPER_FROM_ONE_PASS = 2  # more passes tried where turns need one only, else one more
MIN_EFFORT_SHARE = 0.03
"""Layouts whose estimated effort is a share above the least are not compared; the fewer swaths, the more it errs."""
MIN_GAIN = 0.005  # of the time: a smaller gain may be one of the search, and is not worth another bearing or pass
Report = Callable[[int, int], None]
CELL_TURNS = CELL_COST_M / TURN_COST_M
LEAST_MPS, HALVINGS = 0.2, 30


def build_effort_rates(rules: DrivingRules, turn_times: Sequence[float | None]) -> EffortRates:
    """What driving off work costs, from simulated seconds over 0, 1, 2 ... lines (None where no turn fits)."""
    turns_m = tuple(math.inf if seconds is None else seconds * rules.work_speed_mps for seconds in turn_times[1:])
    if not any(map(math.isfinite, turns_m)):
        turns_m = (rules.turn_s[-1] * rules.work_speed_mps,)
    return EffortRates(turns_m, CELL_TURNS * min(turns_m), rules.work_speed_mps / rules.turn_speed_mps)


def list_layouts(
    request: PlanRequest, field: Field, headland_m: float, spacing_m: float = 0.0, rates: EffortRates = PLAIN_RATES
) -> list[Layout]:
    """The layouts to compare, most promising first: first those inside as many passes as the headland takes.

    Bearing and headland of the request, if given, hold for every layout; with both given, or without headland passes,
    there is only one. Swaths are at least `spacing_m` apart so that machines can pass each other, as far as the working
    width allows. `rates` are those of turns. Where no swath fits inside headland passes, the only layout has none;
    raises FieldError where none fits between headlands that are left.
    """
    width, bearing = request.width_m, request.bearing_deg
    if request.no_headland:
        return [lay_swaths(field, width, headland_m, bearing)]
    lay = partial(_lay_plain, request, field, spacing_m, rates)
    plain = _lay_deepest(request, field, headland_m, lay)
    if not plain.swaths:
        return [plain]
    layouts = _list_promising_layouts(request, plain, rates, PROMISING)
    if min(len(layout.swaths) for layout in layouts) > MAX_SEARCHED_SWATHS:
        return layouts[:1]
    if request.requested_headland_m is None and plain.headland_passes < MAX_HEADLAND_PASSES:
        least_m = _estimate_effort_m(layouts[0], rates)
        for more in range(1, 1 + (DEEPER_FROM_ONE_PASS if plain.headland_passes == 1 else 1)):
            inner = lay(plain.headland_passes + more)
            deeper = _list_promising_layouts(request, inner, rates, DEEPER) if inner.swaths else []
            layouts += [one for one in deeper if _estimate_effort_m(one, rates) <= _compute_limit_m(one, least_m)]
    cumulative_swaths = accumulate(len(layout.swaths) for layout in layouts)
    return [
        layout
        for place, (layout, swaths) in enumerate(zip(layouts, cumulative_swaths, strict=True))
        if not place or swaths <= MAX_COMPARED_SWATHS
    ]


def lay_contours(
    request: PlanRequest, field: Field, headland_m: float, spacing_m: float, terrain: Terrain | None, radius_m: float
) -> Layout:
    """The layout along contours, inside as many headland passes as the headland takes and the field has room for.

    Raises RequestError without heights, and FieldError where no contour leads through the field.
    """
    if terrain is None:
        raise RequestError(
            f"{mark_parameter('swaths')} {CONTOUR} follows contours, and no heights are known; give "
            f"{mark_parameter('elevation')}.",
            parameter="swaths",
        )
    grid = build_grid(terrain)
    lay = partial(lay_contour_swaths, field, grid, request.width_m, radius_m=radius_m, min_spacing_m=spacing_m)
    layout = _lay_deepest(request, field, headland_m, lay)
    if not layout.swaths:
        raise FieldError(
            f"No contour leads through field '{field.name}' inside a headland of {layout.headland_m:g} m: there is too "
            f"little ground or it is level, or contours close inside the field; leave {mark_parameter('swaths')} "
            "straight.",
            parameter="swaths",
        )
    return layout


def count_passes(request: PlanRequest, headland_m: float) -> int:
    """How many headland passes are as deep as that, or as many as there may be."""
    return min(math.ceil(headland_m / request.width_m - 1e-6), MAX_HEADLAND_PASSES)


def _lay_deepest(request: PlanRequest, field: Field, headland_m: float, lay: Callable[[int], Layout]) -> Layout:
    """The layout that `lay` makes inside as many headland passes as the headland takes and the field has room for.

    There is room for passes that can be laid; where planning decides how many, swaths have to fit inside, but for one.
    """
    max_passes = max(1, count_passes(request, headland_m))
    if request.requested_headland_m is not None:
        laid = lay_headland_passes(field, request.width_m, max_passes)
        return lay(max((one.number for one in laid), default=1))
    for count in range(max_passes, 1, -1):
        layout = lay(count)
        if layout.swaths:
            return layout
    return lay(1)


def _estimate_effort_m(layout: Layout, rates: EffortRates) -> float:
    """Estimated effort as a driving length (m), headland passes included, but not their corners."""
    ring_m = 0.5 * (layout.field.boundary.length + layout.inner_region.length)
    return float(estimate_layout_cost_m(layout, rates) + layout.headland_passes * ring_m)


def _lay_plain(request: PlanRequest, field: Field, spacing_m: float, rates: EffortRates, passes: int) -> Layout:
    """The layout with the bearing of the request, or the one that seems cheapest."""
    width, bearing = request.width_m, request.bearing_deg
    region = compute_inner_region(field, passes * width)
    lay = partial(lay_swaths, field, width, passes * width, headland_passes=passes, min_spacing_m=spacing_m)
    if bearing is None and not region.is_empty:
        cheapest = lay(bearing_deg=find_cheapest_bearing_deg(field, region, width, rates))
        if cheapest.swaths:  # a little ground may take a swath in some bearings only
            return cheapest
    return lay(bearing_deg=bearing)


def _compute_limit_m(layout: Layout, least_m: float) -> float:
    """The effort up to which a layout may still be the quickest if the least is `least_m`."""
    return (1.0 + max(MIN_EFFORT_SHARE, 1.0 / len(layout.swaths))) * least_m


def _list_promising_layouts(request: PlanRequest, plain: Layout, rates: EffortRates, count: int) -> list[Layout]:
    """A plain layout and its alternatives, the most promising first; only itself if its bearing is given.

    There are no cells when sowing, as turns of one cell would cross the next.
    """
    if request.bearing_deg is not None:
        return [plain]
    layouts = [one for one in list_layout_alternatives(plain, rates) if request.operation != SOW or len(one.cells) == 1]
    least_m = _estimate_effort_m(layouts[0], rates)
    return [one for one in layouts[:count] if _estimate_effort_m(one, rates) <= _compute_limit_m(one, least_m)]


def choose_quickest_index(
    contexts: Sequence[PlanningContext],
    report: Report | None = None,
    weigh: Callable[[Site, float], float] | None = None,
) -> int:
    """Index of the context whose field one tractor finishes soonest; the first one if others gain little.

    With `weigh` the cost of a layout is what that makes of its seconds on level ground. Where time is spent, those
    timed decide. `report` is called with (layouts timed, all of them).
    """
    if len(contexts) == 1:
        return 0
    headland_lines: dict[int, list[WorkLine]] = {}
    costs: list[float] = []
    for number, context in enumerate(contexts):
        if report:
            report(number, len(contexts))
        try:
            moves = get_site_moves(context, headland_lines)
            level_s = estimate_finish_s(context)
        except TimeSpentError:
            break
        store_moves(context)
        costs.append(level_s if weigh is None else weigh(moves.site, level_s))
    if not costs:
        return 0
    best = min(range(len(costs)), key=lambda place: (round(costs[place], 1), place))
    return best if costs[best] < (1.0 - MIN_GAIN) * costs[0] else 0


def estimate_finish_s(context: PlanningContext) -> float:
    """Seconds in which one tractor finishes the field by the programme composed for it, before anything is driven.

    With what ways to another furrow are charged. Ground that no line covers is finished at the same rate; infinite
    where there is no line.
    """
    moves = get_site_moves(context)
    if not moves.lines:
        return math.inf
    table, site, lines = MoveTable(moves), moves.site, moves.lines
    allowed = np.ones((1, len(lines)), bool)
    charged_s = charge_furrows(site, lines, allowed)
    problems = [
        TourProblem(table, allowed, list_stages(site, lines, order), charged_s)
        for order in context.request.headland_orders or ("",)
    ]
    return min(sketch_programme(problem).cost_s for problem in problems) / compute_covered_share(moves)


def compute_covered_share(moves: SiteMoves) -> float:
    """Share of the ground that the lines cover; all of it where the headland is room for turning."""
    site = moves.site
    if not site.headland_passes:
        return 1.0
    covered = clip_area(moves.covered_ground, site.work_ground)
    return float(covered.area / site.work_ground.area)


@dataclass(frozen=True, eq=False)
class SlopeCosts:
    """Costs of layouts on terrain for one tractor with a load: seconds, or millilitres with `counts_fuel`."""

    terrain: Terrain
    load: WorkLoad
    tractor: Tractor
    rolling_share: float
    counts_fuel: bool

    def weigh(self, site: Site, level_s: float) -> float:
        """The cost of a site that takes `level_s` on level ground."""
        rules = site.rules
        steps = [cut_into_steps(swath.points_m, STEP_M) for swath in site.layout.swaths]
        vectors = np.concatenate([vector for _, vector in steps])
        gradients = self.terrain.compute_gradients(np.concatenate([middle for middle, _ in steps]))
        metres = np.hypot(*vectors.T)
        slopes = (gradients * vectors).sum(axis=1) / metres
        directions = [(slopes, self.limit_speeds(slopes, rules.work_speed_mps)) for slopes in (slopes, -slopes)]
        if not self.counts_fuel:
            slowed_s = [float((metres / speeds).sum()) for _, speeds in directions]
            return level_s + 0.5 * sum(slowed_s) - float(metres.sum()) / rules.work_speed_mps
        off_work_s = max(level_s - float(metres.sum()) / rules.work_speed_mps, 0.0)
        turn = self._compute_fuel_l(
            np.array([rules.turn_speed_mps]), np.zeros(1), np.array([rules.turn_speed_mps]), False
        )
        swath_l = [self._compute_fuel_l(metres, slopes, speeds, True) for slopes, speeds in directions]
        return KILO * (0.5 * sum(swath_l) + off_work_s * turn)

    def limit_speeds(self, slopes: Floats, speed_mps: float) -> Floats:
        """Speeds (n,) up to `speed_mps` at which the power of the engine suffices on slopes (n,), positive uphill."""
        low, high = np.full(len(slopes), LEAST_MPS), np.full(len(slopes), speed_mps)
        is_enough = self._compute_power_w(slopes, high) <= self.load.axle_power_w
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            fits = self._compute_power_w(slopes, middle) <= self.load.axle_power_w
            low, high = np.where(fits, middle, low), np.where(fits, high, middle)
        return np.where(is_enough, speed_mps, low)

    def _compute_power_w(self, slopes: Floats, speeds: Floats) -> Floats:
        constant, linear, square = self.load.draft_n
        weight_n = (self.tractor.mass_kg + self.load.implement_mass_kg) * GRAVITY_MPS2
        draft_n = constant + (linear + square * speeds) * speeds
        return np.asarray((weight_n * (slopes + self.rolling_share) + draft_n) * speeds)

    def _compute_fuel_l(self, metres: Floats, slopes: Floats, speeds: Floats, is_working: bool) -> float:
        return estimate_consumption(
            self.tractor, self.load, self.rolling_share, metres, slopes * metres, speeds, is_working
        )


def build_slope_weigher(
    request: PlanRequest, physics: FieldPhysics, tractor: Tractor, ground: str
) -> Callable[[Site, float], float] | None:
    """How layouts are weighed on terrain by the objective of a request; None where slopes change nothing."""
    load = physics.driven_load
    if physics.terrain is None or load is None:
        return None
    rolling_share = choose_rolling_share(load, ground)
    counts_fuel = request.objective == LEAST_FUEL and physics.fuel_load is not None
    return SlopeCosts(physics.terrain, load, tractor, rolling_share, counts_fuel).weigh
