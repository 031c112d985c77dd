"""Plans estimated: tours found and driven once for the ground and a number of tractors, their times by speed.

The drive is at one speed of the sweep. By how much it takes longer than its tours alone, as tractors wait for each
other and moves are refused, is taken for all speeds: as long as all move likewise, who meets whom does not change.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from typing import TypeVar

import numpy as np
import shapely

from fields.units import MPS_PER_KMH
from planner.errors import HeadlandError
from planner.evaluation.candidates.energy_figures import list_energy_figures
from planner.evaluation.candidates.evaluate import Candidate, run_candidate
from planner.evaluation.candidates.figures import add_clock_times, compute_cost
from planner.evaluation.candidates.line_programme import SketchedPlan, sketch_plans, weigh_order_s
from planner.evaluation.context import PlanningContext
from planner.evaluation.ground.left_out import measure_left_out_m2
from planner.evaluation.layout_choice import compute_covered_share
from planner.evaluation.preparation import change_terms, prepare_context
from planner.evaluation.site import build_site, get_site_moves
from planner.evaluation.work_order import WorkOrder
from planner.pipeline.ranking import mark_worked_shares
from planner.request.parameter_names import UNLAID, WISHES
from planner.request.plan_request import STRAIGHT, PlanRequest
from planner.risk.costs import DrivenTimes
from reports.common.plan_results import PlanResult, choose_plan
from strategies.lines.line_wishes import LineWishes, name_lines
from strategies.lines.work_line import WorkLine
from strategies.path_planning.errors import StrategyError
from strategies.programmes.programme import list_pairs
from strategies.programmes.site_moves import SiteMoves
from strategies.registry import get_strategy
from vehicle.energy.run_energy import choose_rolling_share, estimate_consumption

STRATEGY = get_strategy("split-field")
K = TypeVar("K")
T = TypeVar("T")
MOST_GROUNDS = 6
MOST_SKETCHES, MOST_SPEEDS = 150, 40  # of a ground: 50 numbers of tractors with the headland first and last, and more
DRAWN_M = 0.2  # points of lines that matter less are left out of drawings
Points = tuple[tuple[float, ...], ...]
MOST_PREPARED = 8  # tractors
PREPARED_MPS = tuple(kmh * MPS_PER_KMH for kmh in (2.5, 10.0, 20.0))  # and the usual speed
MOST_LAYOUTS = 50  # of which only bearing and headland passes are kept
SUMMED = UNLAID | {"speed_mps", "turn_speed_mps", "headland_order"}
"""Parameters whose plans may share a ground, its lines and the moves between them, for estimates of many."""


@dataclass(frozen=True)
class EstimatedLine:
    """A work line of an estimated plan.

    Attributes:
        name: as maps and requests name it.
        tractor: the one that works it, counted from 1; None where it is left.
        place: its place in the tour of that tractor, from 1.
        points: its path as driven, metres.
    """

    name: str
    tractor: int | None
    place: int | None
    points: Points


def _describe_line(name: str, line: WorkLine, tractor: int | None, place: int | None, way: int) -> EstimatedLine:
    path = shapely.LineString(line.paths[way]).simplify(DRAWN_M)
    return EstimatedLine(name, tractor, place, tuple(path.coords))


@dataclass(frozen=True, eq=False)
class _TimedTours:
    """Tours at a speed: seconds of every tractor, of all at work, and metres of their moves."""

    times: DrivenTimes
    order: str
    worked_share: float


class GroundEstimates:
    """The plans of one layout: tours are found once for a number of tractors and an order of the headland."""

    def __init__(self, context: PlanningContext, drives: bool = True) -> None:
        """For the ground of a context, whose speed is that at which tours are found; with `drives` they are driven."""
        self._context, self._drives = context, drives
        self._covered_share = compute_covered_share(get_site_moves(context))
        self._sketches = OrderedDict[tuple[int, str, LineWishes], SketchedPlan | StrategyError]()
        self._drive_factors = dict[int, float]()
        self._moves = OrderedDict({_list_speeds(context.request): get_site_moves(context)})
        self._timed = OrderedDict[tuple[SketchedPlan, tuple[float, float]], _TimedTours]()

    @property
    def layout(self) -> tuple[float, int]:
        """Bearing of the tracks of the largest cell, degrees clockwise from north, and headland passes."""
        return self._context.layout.bearing_deg, self._context.layout.headland_passes

    def compare(self, request: PlanRequest) -> tuple[float, float]:
        """How far the width of a request, then its speed, are from those of this ground; 0 for the same."""
        own = self._context.request
        return abs(math.log(own.width_m / request.width_m)), abs(math.log(own.speed_mps / request.speed_mps))

    def estimate(self, order: WorkOrder) -> PlanResult:
        """The plan of an order for one number of tractors on this ground, the better of its orders of the headland."""
        context, count = change_terms(self._context, order), order.request.tractors[0]
        timed = list[_TimedTours]()
        refusal: StrategyError | None = None
        for headland in order.request.headland_orders or ("",):
            sketch = self._sketch(count, headland, order.request)
            if isinstance(sketch, StrategyError):
                refusal = sketch
            else:
                timed.append(self._time_driven(context, sketch))
        if not timed:
            return PlanResult(STRATEGY.name, count, order.request.turn, False, str(refusal), is_simulated=False)
        return _build_result(context, min(timed, key=_weigh_s))

    def knows(self, order: WorkOrder) -> bool:
        """Whether tours, and moves at its speeds, are there for all that an order asks for."""
        request = order.request
        orders, wishes = request.headland_orders or ("",), request.line_wishes
        wanted = ((count, headland, wishes) for count in request.tractors for headland in orders)
        return _list_speeds(request) in self._moves and all(each in self._sketches for each in wanted)

    def scale(self, order: WorkOrder) -> PlanResult:
        """The plan of an order for one number of tractors, of another width, number or speed: nothing is sought.

        Work and moves go by the number of lines, so with one over the width. They are dealt out as the tours of the
        nearest number of tractors are, whose last one ends by as much later than all on average. New wishes for single
        lines are left aside.
        """
        context, request = change_terms(self._context, order), order.request
        count, orders = request.tractors[0], request.headland_orders or ("",)
        found = [
            ((wishes != request.line_wishes, abs(known - count)), sketch)
            for (known, headland, wishes), sketch in self._sketches.items()
            if headland in orders and not isinstance(sketch, StrategyError)
        ]
        if not found:
            return self.estimate(order)
        least, ratio = min(distance for distance, _ in found), self._context.request.width_m / request.width_m
        near = [
            _scale_tours(self._time_between(context, sketch), count, ratio)
            for distance, sketch in found
            if distance == least
        ]
        return _build_result(context, min(near, key=_weigh_s))

    def _time_between(self, context: PlanningContext, sketch: SketchedPlan) -> _TimedTours:
        """The tours of a sketch, their moves between those of the two nearest speeds by one over the speed."""
        speed_mps, turn_mps = own = _list_speeds(context.request)
        known = [key for key in self._moves if key[1] == (key[0] if turn_mps == speed_mps else turn_mps)]
        if own in self._moves or len(known) < 2:
            return _time_tours(context, sketch, self._get_moves(context), self._covered_share)
        near = sorted(known, key=lambda key: abs(math.log(key[0] / speed_mps)))[:2]
        share = (1.0 / speed_mps - 1.0 / near[0][0]) / (1.0 / near[1][0] - 1.0 / near[0][0])
        one, other = (_time_tours(context, sketch, self._moves[key], self._covered_share) for key in near)
        tractor_s = (1.0 - share) * one.times.tractor_s + share * other.times.tractor_s
        turn_s = (1.0 - share) * one.times.turn_s + share * other.times.turn_s
        return replace(one, times=DrivenTimes(tractor_s, one.times.work_s, turn_s))

    def list_lines(self, order: WorkOrder, plan: PlanResult) -> tuple[EstimatedLine, ...]:
        """All work lines, as an estimated plan of an order works them."""
        sketch = self._sketch(plan.tractors, plan.headland_order or "", order.request)
        tours = [] if isinstance(sketch, StrategyError) else sketch.tours
        places = {
            node // 2: (tractor, place, node % 2)
            for tractor, tour in enumerate(tours, start=1)
            for place, node in enumerate(tour, start=1)
        }
        lines = [(number, line) for number, line in enumerate(get_site_moves(self._context).lines) if line.task.is_work]
        names = name_lines([line.task for _, line in lines])
        return tuple(
            _describe_line(name, line, *places.get(number, (None, None, 0)))
            for name, (number, line) in zip(names, lines, strict=True)
        )

    def list_outlines(self) -> tuple[Points, ...]:
        """The outline of the field and its holes, metres."""
        boundary = self._context.layout.field.boundary
        return tuple(tuple(ring.coords) for ring in (boundary.exterior, *boundary.interiors))

    def _sketch(self, tractors: int, headland: str, requested: PlanRequest) -> SketchedPlan | StrategyError:
        """The plan of a number of tractors with the headland in an order and lines as asked, or why there is none."""
        key = tractors, headland, requested.line_wishes
        found = self._sketches.get(key)
        if found is None:
            wishes = {name: getattr(requested, name) for name in WISHES}
            request = replace(self._context.request, tractors=(tractors,), headland_order=headland or None, **wishes)
            context = replace(self._context, request=request)
            context.site_cache.update(self._context.site_cache)
            try:
                sketch = sketch_plans(context, STRATEGY, tractors)[0]
                idle = next((number for number, tour in enumerate(sketch.tours) if not tour), None)
                found = sketch if idle is None else _refuse_idle(tractors)
            except StrategyError as refusal:
                found = refusal
        _keep(self._sketches, key, found, MOST_SKETCHES)
        return found

    def _time_driven(self, context: PlanningContext, sketch: SketchedPlan) -> _TimedTours:
        """The tours of a sketch at the speeds of a context, by drives; prices and clock times change nothing in it."""
        key = sketch, _list_speeds(context.request)
        timed = self._timed.get(key)
        if timed is None:
            factor = self._get_drive_factor(len(sketch.tours))
            alone = _time_tours(context, sketch, self._get_moves(context), self._covered_share)
            timed = replace(alone, times=replace(alone.times, tractor_s=factor * alone.times.tractor_s))
        _keep(self._timed, key, timed, MOST_SKETCHES * MOST_SPEEDS)
        return timed

    def _get_drive_factor(self, tractors: int) -> float:
        """By how much a drive takes longer than tours by themselves, with the headland as the context has it."""
        if tractors not in self._drive_factors:
            self._drive_factors[tractors] = self._measure_drive_factor(tractors) if self._drives else 1.0
        return self._drive_factors[tractors]

    def _measure_drive_factor(self, tractors: int) -> float:
        """The plan of split-field as driven, else that of the quickest strategy, over the tours of split-field alone.

        1 where none can be driven.
        """
        requested = self._context.request
        sketches = [self._sketch(tractors, headland, requested) for headland in requested.headland_orders or ("",)]
        sketched = [sketch for sketch in sketches if not isinstance(sketch, StrategyError)]
        if not sketched:
            return 1.0
        alone_s = min(float((np.array(one.tractor_s) + np.array(one.served_s)).max()) for one in sketched)
        best_s = self._drive(STRATEGY.name, tractors, sketched)
        if not math.isfinite(best_s):
            others = [name for name in self._context.request.strategies if name != STRATEGY.name]
            best_s = min((self._drive(name, tractors) for name in others), default=math.inf)
        return best_s / alone_s if math.isfinite(best_s) else 1.0

    def _drive(self, strategy: str, tractors: int, sketches: list[SketchedPlan] | None = None) -> float:
        """Seconds of the plan of a strategy as driven; infinite where it cannot be driven."""
        with suppress(StrategyError):
            driven = run_candidate(self._context, Candidate(strategy, tractors), sketches)
            return math.inf if driven.reason else driven.run.duration_s
        return math.inf

    def _get_moves(self, context: PlanningContext) -> SiteMoves:
        """The moves at the speeds of a context, between the same lines."""
        key = _list_speeds(context.request)
        moves = self._moves.get(key) or SiteMoves(build_site(context), get_site_moves(self._context).lines)
        _keep(self._moves, key, moves, MOST_SPEEDS)
        return moves


def _weigh_s(one: _TimedTours) -> float:
    """Seconds to finish the field, as orders of the headland are compared by."""
    return weigh_order_s(one.order, float(one.times.tractor_s.max()) / one.worked_share)


def _time_tours(context: PlanningContext, sketch: SketchedPlan, moves: SiteMoves, covered_share: float) -> _TimedTours:
    """The tours of a sketch at the working speed of a context, with these moves."""
    rules, tours = context.driving_rules, sketch.tours
    work_m = [math.fsum(moves.lines[node // 2].measure_path_m(node % 2) for node in tour) for tour in tours]
    pairs = [list_pairs(moves, [tour]) for tour in tours]
    moves_s = [float(moves.estimates.estimate_s(one, is_charged=False).sum()) for one in pairs]
    work_s = np.array(work_m) / rules.work_speed_mps
    tractor_s = work_s + np.array(moves_s) + moves.drives.rest_s + np.array(sketch.served_s)
    worked = {node // 2 for tour in tours for node in tour}
    all_m2 = math.fsum(line.own_m2 for line in moves.lines)
    worked_m2 = math.fsum(moves.lines[number].own_m2 for number in sorted(worked))
    share = covered_share * worked_m2 / all_m2
    return _TimedTours(DrivenTimes(tractor_s, float(work_s.sum()), math.fsum(moves_s)), sketch.order, share)


def _list_speeds(request: PlanRequest) -> tuple[float, float]:
    """Speeds at work and in turns, m/s."""
    return request.speed_mps, request.effective_turn_speed_mps


def _scale_tours(timed: _TimedTours, tractors: int, ratio: float) -> _TimedTours:
    """Tours with all seconds times a ratio, shared by another number of tractors."""
    times = timed.times
    tractor_s = ratio * times.tractor_s
    if len(tractor_s) != tractors:
        mean_s = float(tractor_s.sum()) / tractors
        last_s = mean_s if tractors == 1 else mean_s * float(tractor_s.max() / tractor_s.mean())
        others_s = (tractors * mean_s - last_s) / max(1, tractors - 1)
        tractor_s = np.array([last_s] + [others_s] * (tractors - 1))
    return replace(timed, times=DrivenTimes(tractor_s, ratio * times.work_s, ratio * times.turn_s))


def _refuse_idle(tractors: int) -> StrategyError:
    return StrategyError(f"There is no work for tractor {tractors} that is worth the drive.")


def _build_result(context: PlanningContext, timed: _TimedTours) -> PlanResult:
    """The figures of a plan as a drive would have them, as far as they are estimated."""
    times, share, due_m2 = timed.times, timed.worked_share, context.layout.field.due_region.area
    missed_m2 = (1.0 - share) * due_m2
    whole = 1.0 + (missed_m2 - measure_left_out_m2(context)) / (share * due_m2)
    finish_s = float(times.tractor_s.max())
    energy = _estimate_energy(context, times)
    hourly, hiring = compute_cost(context, times, energy)
    figures = PlanResult(
        strategy=STRATEGY.name,
        tractors=len(times.tractor_s),
        turn=context.request.turn,
        feasible=True,
        time_s=finish_s,
        tractor_time_s=float(times.tractor_s.sum()),
        cost=hourly + hiring,
        worked_pct=100.0 * share,
        missed_m2=missed_m2,
        finished_s=finish_s * whole,
        finished_cost=hourly * whole + hiring,
        turning_s=times.turn_s,
        headland_passes=context.layout.headland_passes,
        headland_order=timed.order or None,
        is_simulated=False,
        **list_energy_figures(context, times, energy),
    )
    return add_clock_times(mark_worked_shares([figures], context)[0], context, finish_s, finish_s * whole)


def _estimate_energy(context: PlanningContext, times: DrivenTimes) -> tuple[float, ...] | None:
    """Litres or kilowatt-hours of every tractor at steady speeds on level ground; None where the load is not known."""
    load, rules = context.physics.fuel_load, context.driving_rules
    if load is None:
        return None
    rolling_share = choose_rolling_share(load, context.layout.field.default_ground)
    total = 0.0
    for seconds, speed_mps, is_working in (
        (times.work_s, rules.work_speed_mps, True),
        (times.turn_s, rules.turn_speed_mps, False),
    ):
        speeds = np.array([speed_mps])
        total += estimate_consumption(
            context.tractor, load, rolling_share, seconds * speeds, np.zeros(1), speeds, is_working
        )
    return tuple((total * times.tractor_s / times.tractor_s.sum()).tolist())


@dataclass(frozen=True)
class OrderEstimate:
    """The plan of each number of tractors that was asked for, the one to take, and the layout that they have.

    Attributes:
        order: what was estimated.
        plans: one for each number of tractors, fewest first; what is not possible says why.
        best: by the rule of `headland plan`; None where nothing is possible.
        bearing_deg: of the tracks of the largest cell, clockwise from north.
        headland_passes: around the field.
        is_layout_borrowed: whether these are those of another width or speed; a plan would choose anew.
        lines: the work lines as the best plan works them; empty without one.
        outlines: of the field and its holes, metres; empty without lines.
        is_scaled: whether tours are those of another width or number of tractors.
    """

    order: WorkOrder
    plans: tuple[PlanResult, ...]
    best: PlanResult | None
    bearing_deg: float
    headland_passes: int
    is_layout_borrowed: bool
    lines: tuple[EstimatedLine, ...]
    outlines: tuple[Points, ...]
    is_scaled: bool


@dataclass(frozen=True, eq=False)
class _KeptGround:
    estimates: GroundEstimates
    is_borrowed: bool
    field_key: str


class KeptGrounds:
    """The grounds used last. What is found depends on the order and, for a borrowed layout, on the one before."""

    def __init__(self) -> None:
        self._grounds = OrderedDict[str, _KeptGround]()
        self._layouts = OrderedDict[str, tuple[float, int]]()
        self._unprepared = list[tuple[GroundEstimates, WorkOrder]]()

    def prepare(self) -> bool:
        """Find tours or moves of one more number of tractors and speed on the ground laid out last; False without any.

        Answers at once are scaled from them.
        """
        if not self._unprepared:
            return False
        estimates, order = self._unprepared.pop()
        with suppress(HeadlandError):
            estimates.estimate(order)
        return True

    def estimate(self, order: WorkOrder, files: str = "", *, at_once: bool = False) -> OrderEstimate:
        """The plans of an order; `files` names the content of what it reads. Raises HeadlandError.

        A width or speed that is new takes bearing and headland passes of the last answer for the same field, where it
        may. With `at_once` nothing is laid out or sought but what no ground of the field is near to.
        """
        ground = self._find_near_ground(order, files) if at_once else None
        is_scaled = ground is not None
        ground = ground or self._find_ground(order, files)
        estimate = ground.estimates.scale if is_scaled else ground.estimates.estimate
        request = order.request
        plans = tuple(estimate(_set_tractors(order, count)) for count in sorted(request.tractors))
        feasible = [plan for plan in plans if plan.feasible]
        is_priced = order.cost_terms is not None or request.price_per_hour is not None
        best = choose_plan(feasible, request.time_limit_s, is_priced) if feasible else None
        lines = () if best is None or is_scaled else ground.estimates.list_lines(order, best)
        outlines = ground.estimates.list_outlines() if lines else ()
        is_borrowed = ground.is_borrowed or is_scaled
        return OrderEstimate(order, plans, best, *ground.estimates.layout, is_borrowed, lines, outlines, is_scaled)

    def _find_near_ground(self, order: WorkOrder, files: str) -> _KeptGround | None:
        """The ground of the nearest width and speed; None where the order's own has all tours, or the field none."""
        own = self._grounds.get(_build_key(order, files, UNLAID))
        if own is not None and own.estimates.knows(order):
            return None
        field_key = _build_key(order, files, SUMMED | {"width_m"})
        near = (ground for ground in self._grounds.values() if ground.field_key == field_key)
        return min(near, key=lambda ground: ground.estimates.compare(order.request), default=None)

    def _find_ground(self, order: WorkOrder, files: str) -> _KeptGround:
        key = _build_key(order, files, UNLAID)
        field_key = _build_key(order, files, SUMMED | {"width_m"})
        ground = self._grounds.pop(key, None)
        if ground is None:
            ground = self._lay_out(_forget_wishes(order), field_key)
            self._unprepared = [(ground.estimates, each) for each in _list_prepared(order)]
        _keep(self._grounds, key, ground, MOST_GROUNDS)
        _keep(self._layouts, field_key, ground.estimates.layout, MOST_LAYOUTS)
        return ground

    def _lay_out(self, reference: WorkOrder, field_key: str) -> _KeptGround:
        borrowed = _borrow_layout(reference.request, self._layouts.get(field_key))
        if borrowed is not None:
            with suppress(HeadlandError):  # what fits one width may not fit another
                return _KeptGround(_lay_out_undriven(replace(reference, request=borrowed)), True, field_key)
        return _KeptGround(_lay_out_undriven(reference), False, field_key)


def _list_prepared(order: WorkOrder) -> list[WorkOrder]:
    """The orders from which others are scaled, the last one first: all numbers as asked, then at other speeds."""
    faster = [replace(order, request=replace(order.request, speed_mps=each)) for each in PREPARED_MPS]
    return [_set_tractors(one, count + 1) for one in (*faster, order) for count in reversed(range(MOST_PREPARED))]


def _set_tractors(order: WorkOrder, count: int) -> WorkOrder:
    return replace(order, request=replace(order.request, tractors=(count,)))


def _lay_out_undriven(order: WorkOrder) -> GroundEstimates:
    """A ground on which nothing is driven: an answer at once matters more than how tractors wait for each other."""
    return GroundEstimates(prepare_context(order), drives=False)


def _keep(kept: OrderedDict[K, T], key: K, value: T, most: int) -> None:
    """Keep a value as the one used last."""
    kept[key] = value
    kept.move_to_end(key)
    while len(kept) > most:
        kept.popitem(last=False)


def _build_key(order: WorkOrder, files: str, without: Iterable[str]) -> str:
    """What a layout depends on: the request, the content of its files, and the machines that are chosen from them."""
    left_out = set(without)
    values = [(one.name, getattr(order.request, one.name)) for one in fields(PlanRequest) if one.name not in left_out]
    return repr((files, values, order.field, order.tractor, order.implement, order.supply))


def _forget_wishes(order: WorkOrder) -> WorkOrder:
    """The order without what is wanted of single lines, which changes no layout."""
    return replace(order, request=replace(order.request, leave_out=None, work_first=None, give=()))


def _borrow_layout(request: PlanRequest, layout: tuple[float, int] | None) -> PlanRequest | None:
    """The request with bearing and headland passes of a layout; None without one, and where it asks for its own."""
    own = request.bearing_deg, request.guidance_line, request.headland_m, request.headland_passes
    if layout is None or own != (None,) * 4 or request.cell_bearings or request.swaths != STRAIGHT:
        return None
    bearing_deg, passes = layout
    return replace(request, bearing_deg=bearing_deg, headland_passes=None if request.no_headland else passes)
