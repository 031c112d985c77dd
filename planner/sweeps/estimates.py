"""Plans estimated: tours found and driven once for the ground and a number of tractors, their times by speed.

The drive is at one speed of the sweep. By how much it takes longer than its tours alone and leaves more ground, as
tractors wait for each other and moves are refused, is taken for all speeds: as long as all move likewise, who meets
whom does not change.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
import shapely

from planner.evaluation.candidates.best_drive import prunes_candidates
from planner.evaluation.candidates.evaluate import Candidate, simulate_candidates
from planner.evaluation.candidates.figures import appraise_times, name_headland_order
from planner.evaluation.candidates.line_programme import SketchedPlan, sketch_plans, sort_sketches, weigh_order_s
from planner.evaluation.context import PlanningContext
from planner.evaluation.ground.coverage import measure_left_out_m2
from planner.evaluation.ground.unworked_area import mark_worked_shares
from planner.evaluation.layout_choice import compute_covered_share
from planner.evaluation.preparation import change_terms
from planner.evaluation.site import build_site, get_site_moves
from planner.evaluation.work_order import WorkOrder
from planner.request.parameter_names import UNLAID, WISHES
from planner.request.plan_request import PlanRequest
from planner.risk.costs import DrivenTimes
from reports.common.plan_results import PlanResult, choose_plan
from strategies.lines.line_wishes import LineWishes, name_line
from strategies.lines.work_line import WorkLine
from strategies.path_planning.errors import StrategyError
from strategies.programmes.programme import list_pairs
from strategies.programmes.site_moves import SiteMoves
from strategies.registry import get_strategy
from vehicle.energy.run_energy import choose_rolling_share, estimate_consumption

STRATEGY = get_strategy("split-field")
K = TypeVar("K")
T = TypeVar("T")
MOST_SKETCHES, MOST_SPEEDS = 150, 40  # of a ground: 50 numbers of tractors with the headland first and last, and more
UNCERTAINTY_PCT = (3.0, 4.0, 30.0)  # of one, two, more tractors at other speeds, from tests.benchmarks.sweeps
MOST_KNOWN = len(UNCERTAINTY_PCT)
Points = tuple[tuple[float, ...], ...]
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
        self._drive_factors = dict[tuple[int, str | None], tuple[float, float] | StrategyError]()
        self._moves = OrderedDict({_list_speeds(context.request): get_site_moves(context)})
        self._timed = OrderedDict[tuple[SketchedPlan, str | None, tuple[float, float]], _TimedTours]()

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
                continue
            try:
                timed.append(self._time_driven(context, sketch))
            except StrategyError as cannot_be_driven:
                refusal = cannot_be_driven
        if not timed:
            return PlanResult(STRATEGY.name, count, order.request.turn, False, str(refusal), is_simulated=False)
        result = _build_result(context, min(timed, key=_weigh_s))
        if not self._drives:
            return result
        is_as_driven = _list_speeds(order.request) == _list_speeds(self._context.request)
        return replace(result, uncertainty_pct=0.0 if is_as_driven else UNCERTAINTY_PCT[min(count, MOST_KNOWN) - 1])

    def knows(self, order: WorkOrder) -> bool:
        """Whether tours, and moves at its speeds, are there for all that an order asks for."""
        request = order.request
        orders, wishes = request.headland_orders or ("",), request.line_wishes
        wanted = ((count, headland, wishes) for count in request.tractors for headland in orders)
        return _list_speeds(request) in self._moves and all(each in self._sketches for each in wanted)

    def scale(self, order: WorkOrder) -> PlanResult:
        """The plan of an order for one number of tractors, of another width, number or speed: nothing is sought.

        Work and moves go by the number of lines, so with one over the width. They are dealt out as the tours of the
        nearest number of tractors are, whose last one ends by as much later than all on average. Lines that are now
        left out are taken from these tours, which leave out no others; which come first and who works them is left
        aside.
        """
        context, request = change_terms(self._context, order), order.request
        count, orders = request.tractors[0], request.headland_orders or ("",)
        lines = get_site_moves(self._context).lines
        left = set(request.line_wishes.find_left_out(lines))
        found = [
            ((wishes != request.line_wishes, abs(known - count)), sketch)
            for (known, headland, wishes), sketch in self._sketches.items()
            if headland in orders and not isinstance(sketch, StrategyError) and left >= set(wishes.find_left_out(lines))
        ]
        if not found:
            return self.estimate(order)
        least, ratio = min(distance for distance, _ in found), self._context.request.width_m / request.width_m
        near = [
            _scale_tours(self._leave_out(context, sketch, self._time_between(context, sketch)), count, ratio)
            for distance, sketch in found
            if distance == least
        ]
        best = min(near, key=_weigh_s)
        return _build_result(context, best) if best.worked_share > 0.0 else self.estimate(order)

    def _leave_out(self, context: PlanningContext, sketch: SketchedPlan, timed: _TimedTours) -> _TimedTours:
        """Timed tours of a sketch without the work on lines that a context leaves out; moves stay as they are."""
        lines = get_site_moves(self._context).lines
        left = set(context.request.line_wishes.find_left_out(lines))
        worked = [[node for node in tour if node // 2 not in left] for tour in sketch.tours]
        saved_m = [
            math.fsum(lines[node // 2].measure_path_m(node % 2) for node in tour if node // 2 in left)
            for tour in sketch.tours
        ]
        saved_s = np.array(saved_m) / context.driving_rules.work_speed_mps
        times = timed.times
        times = DrivenTimes(times.tractor_s - saved_s, times.work_s - float(saved_s.sum()), times.turn_s)
        return replace(timed, times=times, worked_share=self._covered_share * _find_worked_share(lines, worked))

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
        estimated = []
        for number, line in lines:
            tractor, place, way = places.get(number, (None, None, 0))
            path = shapely.LineString(line.paths[way]).simplify(0.2)  # a drawing needs no finer
            estimated.append(EstimatedLine(name_line(line.task), tractor, place, tuple(path.coords)))
        return tuple(estimated)

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
                found = sketch
                if idle is not None:
                    found = StrategyError(f"There is no work for tractor {tractors} that is worth the drive.")
            except StrategyError as refusal:
                found = refusal
        keep_last(self._sketches, key, found, MOST_SKETCHES)
        return found

    def _time_driven(self, context: PlanningContext, sketch: SketchedPlan) -> _TimedTours:
        """The tours of a sketch at the speeds of a context, by drives; prices and clock times change nothing in it."""
        key = sketch, context.request.headland_order, _list_speeds(context.request)
        timed = self._timed.get(key)
        if timed is None:
            driven = self._get_drive_factors(len(sketch.tours), context.request.headland_order)
            alone = _time_tours(context, sketch, self._get_moves(context), self._covered_share)
            longer, more = driven
            times = replace(alone.times, tractor_s=longer * alone.times.tractor_s)
            timed = replace(alone, times=times, worked_share=min(more * alone.worked_share, 1.0))
        keep_last(self._timed, key, timed, MOST_SKETCHES * MOST_SPEEDS)
        return timed

    def _get_drive_factors(self, tractors: int, headland: str | None) -> tuple[float, float]:
        """By how much a drive takes longer than tours by themselves, and works more ground than their lines.

        With the headland first or last, None for the better. Raises StrategyError where none can be driven.
        """
        if not self._drives:
            return 1.0, 1.0
        key = tractors, headland
        if key not in self._drive_factors:
            try:
                self._drive_factors[key] = self._measure_drive_factors(tractors, headland)
            except StrategyError as refusal:
                self._drive_factors[key] = refusal
        found = self._drive_factors[key]
        if isinstance(found, StrategyError):
            raise found
        return found

    def _measure_drive_factors(self, tractors: int, headland: str | None) -> tuple[float, float]:
        """The plan to take by the rule of `headland plan`, as driven, over the tours of split-field alone.

        Raises StrategyError where none can be driven.
        """
        request = replace(self._context.request, headland_order=headland)
        context = replace(self._context, request=request)
        context.site_cache.update(self._context.site_cache)
        found = [self._sketch(tractors, order, request) for order in request.headland_orders or ("",)]
        sketches = [sketch for sketch in found if not isinstance(sketch, StrategyError)]
        refusals = [refusal for refusal in found if isinstance(refusal, StrategyError)]
        if not sketches:
            raise refusals[0]
        driven = _drive_best(context, tractors, sort_sketches(sketches))
        assert driven.time_s is not None and driven.worked_pct is not None  # it is feasible
        moves = self._get_moves(context)
        alone = min((_time_tours(context, one, moves, self._covered_share) for one in sketches), key=_weigh_s)
        time = driven.time_s / float(alone.times.tractor_s.max())
        return time, 0.01 * driven.worked_pct / alone.worked_share

    def _get_moves(self, context: PlanningContext) -> SiteMoves:
        """The moves at the speeds of a context, between the same lines."""
        key = _list_speeds(context.request)
        moves = self._moves.get(key) or SiteMoves(build_site(context), get_site_moves(self._context).lines)
        keep_last(self._moves, key, moves, MOST_SPEEDS)
        return moves


def _drive_best(context: PlanningContext, tractors: int, sketches: list[SketchedPlan]) -> PlanResult:
    """The plan to take of a number of tractors as driven, with split-field as sketched; of one they are all alike.

    Raises StrategyError where none can be driven, for what hinders split-field if that was tried.
    """
    names = context.request.strategies if tractors > 1 else (STRATEGY.name,)
    candidates = [Candidate(name, tractors) for name in names]
    sketched = {Candidate(STRATEGY.name, tractors): sketches}
    driven = simulate_candidates(context, candidates, prunes_candidates(context), sketched, is_shown=False)
    plans = [outcome.result for _, outcome in driven]
    feasible = mark_worked_shares([plan for plan in plans if plan.feasible], context)
    if not feasible:
        own = next((plan for plan in plans if plan.strategy == STRATEGY.name), plans[0])
        raise StrategyError(own.reason or "")
    return choose_plan(feasible)


def _find_worked_share(lines: Sequence[WorkLine], tours: Sequence[Sequence[int]]) -> float:
    """The share of the ground of all lines that tours work."""
    worked = sorted({node // 2 for tour in tours for node in tour})
    return math.fsum(lines[number].own_m2 for number in worked) / math.fsum(line.own_m2 for line in lines)


def _weigh_s(one: _TimedTours) -> float:
    """Seconds to finish the field, as orders of the headland are compared by; infinite where nothing is worked."""
    whole_s = float(one.times.tractor_s.max()) / one.worked_share if one.worked_share > 0.0 else math.inf
    return weigh_order_s(one.order, whole_s)


def _time_tours(context: PlanningContext, sketch: SketchedPlan, moves: SiteMoves, covered_share: float) -> _TimedTours:
    """The tours of a sketch at the working speed of a context, with these moves."""
    rules, tours = context.driving_rules, sketch.tours
    work_m = [math.fsum(moves.lines[node // 2].measure_path_m(node % 2) for node in tour) for tour in tours]
    pairs = [list_pairs(moves, [tour]) for tour in tours]
    moves_s = [float(moves.estimates.estimate_s(one, is_charged=False).sum()) for one in pairs]
    work_s = np.array(work_m) / rules.work_speed_mps
    tractor_s = work_s + np.array(moves_s) + moves.drives.rest_s + np.array(sketch.served_s)
    share = covered_share * _find_worked_share(moves.lines, tours)
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


def _build_result(context: PlanningContext, timed: _TimedTours) -> PlanResult:
    """The figures of a plan as a drive would have them, as far as they are estimated."""
    times, share, due_m2 = timed.times, timed.worked_share, context.layout.field.due_region.area
    left_out_m2 = measure_left_out_m2(context)
    missed_m2 = max(0.0, (1.0 - share) * due_m2 - left_out_m2)
    whole = 1.0 + missed_m2 / (share * due_m2)
    finish_s = float(times.tractor_s.max())
    pull = context.pull
    figures = PlanResult(
        strategy=STRATEGY.name,
        tractors=len(times.tractor_s),
        turn=context.request.turn,
        feasible=True,
        time_s=finish_s,
        tractor_time_s=float(times.tractor_s.sum()),
        worked_pct=100.0 * share,
        missed_m2=missed_m2,
        left_out_m2=left_out_m2 or None,
        finished_s=finish_s * whole,
        turning_s=times.turn_s,
        headland_passes=context.layout.headland_passes,
        headland_order=name_headland_order(context, timed.order),
        is_simulated=False,
        pull=pull if pull is not None and pull.is_questioned else None,
    )
    marked = mark_worked_shares([figures], context)[0]
    return appraise_times(context, marked, times, _estimate_energy(context, times), finish_s)


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


def keep_last(kept: OrderedDict[K, T], key: K, value: T, most: int) -> None:
    """Keep a value as the one used last."""
    kept[key] = value
    kept.move_to_end(key)
    while len(kept) > most:
        kept.popitem(last=False)
