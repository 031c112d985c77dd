"""Grounds kept between estimates, so that a changed number, speed or width is answered at once."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, fields, replace

from fields.units import MPS_PER_KMH
from planner.errors import HeadlandError
from planner.evaluation.preparation import prepare_context
from planner.evaluation.work_order import WorkOrder
from planner.request.parameter_names import UNLAID
from planner.request.plan_request import STRAIGHT, PlanRequest
from planner.risk.costs import are_prices_given
from planner.sweeps.estimates import SUMMED, EstimatedLine, GroundEstimates, Points, keep_last
from reports.common.plan_results import PlanResult, choose_plan

MOST_GROUNDS = 8
MOST_PREPARED = 8  # tractors
PREPARED_MPS = tuple(kmh * MPS_PER_KMH for kmh in (2.5, 10.0, 20.0))  # and the usual speed
BEARING_DECIMALS = 6  # of a layout as answers say it
MOST_LAYOUTS = 50  # of which only bearing and headland passes are kept


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
        may; who asks for these is then answered from the same ground. With `at_once` nothing is laid out or
        sought but what no ground of the field is near to.
        """
        ground = self._find_near_ground(order, files) if at_once else None
        is_scaled = ground is not None
        ground = ground or self._find_ground(order, files)
        estimate = ground.estimates.scale if is_scaled else ground.estimates.estimate
        request = order.request
        plans = tuple(estimate(_set_tractors(order, count)) for count in sorted(request.tractors))
        feasible = [plan for plan in plans if plan.feasible]
        is_priced = are_prices_given(request, order.cost_terms)
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
            # What is wanted of single lines changes no layout.
            laid = replace(order, request=replace(order.request, leave_out=None, work_first=None, give=()))
            ground = self._lay_out(laid, field_key)
            faster = [replace(order, request=replace(order.request, speed_mps=each)) for each in PREPARED_MPS]
            self._unprepared = [  # from these others are scaled, the last first: all numbers as asked, then faster
                (ground.estimates, _set_tractors(one, count + 1))
                for one in (*faster, order)
                for count in reversed(range(MOST_PREPARED))
            ]
        keep_last(self._grounds, key, ground, MOST_GROUNDS)
        if ground.is_borrowed:
            own = replace(order, request=_set_layout(order.request, ground.estimates.layout))
            own_ground = replace(ground, is_borrowed=False, field_key=_build_key(own, files, SUMMED | {"width_m"}))
            keep_last(self._grounds, _build_key(own, files, UNLAID), own_ground, MOST_GROUNDS)
        keep_last(self._layouts, field_key, ground.estimates.layout, MOST_LAYOUTS)
        return ground

    def _lay_out(self, reference: WorkOrder, field_key: str) -> _KeptGround:
        request, layout = reference.request, self._layouts.get(field_key)
        own = request.bearing_deg, request.guidance_line, request.headland_m, request.headland_passes
        asks_for_own = own != (None,) * 4 or request.cell_bearings or request.swaths != STRAIGHT
        if layout is not None and not asks_for_own:
            with suppress(HeadlandError):  # what fits one width may not fit another
                borrowed = replace(reference, request=_set_layout(request, layout))
                return _KeptGround(_lay_out_undriven(borrowed), True, field_key)
        return _KeptGround(_lay_out_undriven(reference), False, field_key)


def _set_tractors(order: WorkOrder, count: int) -> WorkOrder:
    return replace(order, request=replace(order.request, tractors=(count,)))


def _lay_out_undriven(order: WorkOrder) -> GroundEstimates:
    """A ground on which nothing is driven: an answer at once matters more than how tractors wait for each other."""
    return GroundEstimates(prepare_context(order), drives=False)


def _build_key(order: WorkOrder, files: str, without: Iterable[str]) -> str:
    """What a layout depends on: the request, the content of its files, and the machines that are chosen from them."""
    left_out = set(without)
    values = [(one.name, getattr(order.request, one.name)) for one in fields(PlanRequest) if one.name not in left_out]
    return repr((files, values, order.field, order.tractor, order.implement, order.supply))


def _set_layout(request: PlanRequest, layout: tuple[float, int]) -> PlanRequest:
    bearing_deg, passes = layout
    passes_or_none = None if request.no_headland else passes
    return replace(request, bearing_deg=round(bearing_deg, BEARING_DECIMALS), headland_passes=passes_or_none)
