"""Grounds kept from one estimate to the next, so that what changes no layout is answered at once."""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from typing import TypeVar

from planner.errors import HeadlandError
from planner.evaluation.work_order import WorkOrder
from planner.request.plan_request import STRAIGHT, PlanRequest
from planner.sweep.estimates import SUMMED, GroundEstimates, prepare_ground
from reports.common.plan_results import PlanResult, choose_plan

T = TypeVar("T")
MOST_GROUNDS = 6
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
        is_layout_borrowed: whether these are those of another width; a plan would choose anew.
    """

    order: WorkOrder
    plans: tuple[PlanResult, ...]
    best: PlanResult | None
    bearing_deg: float
    headland_passes: int
    is_layout_borrowed: bool


@dataclass(frozen=True, eq=False)
class _KeptGround:
    estimates: GroundEstimates
    is_borrowed: bool


class KeptGrounds:
    """The grounds used last. What is found depends on the order and, for a borrowed layout, on the one before."""

    def __init__(self) -> None:
        self._grounds = OrderedDict[str, _KeptGround]()
        self._layouts = OrderedDict[str, tuple[float, int]]()

    def estimate(self, order: WorkOrder, files: str = "") -> OrderEstimate:
        """The plans of an order; `files` names the content of what it reads. Raises HeadlandError.

        A width that is new takes bearing and headland passes of the last answer for the same field, where it may.
        """
        ground = self._find_ground(order, files)
        request = order.request
        plans = tuple(
            ground.estimates.estimate(replace(order, request=replace(request, tractors=(count,))))
            for count in sorted(request.tractors)
        )
        feasible = [plan for plan in plans if plan.feasible]
        is_priced = order.cost_terms is not None or request.price_per_hour is not None
        best = choose_plan(feasible, request.time_limit_s, is_priced) if feasible else None
        return OrderEstimate(order, plans, best, *ground.estimates.layout, ground.is_borrowed)

    def _find_ground(self, order: WorkOrder, files: str) -> _KeptGround:
        key = _build_key(order, files, SUMMED)
        field_key = _build_key(order, files, SUMMED | {"width_m"})
        ground = self._grounds.pop(key, None) or self._lay_out(_choose_reference(order), field_key)
        _keep(self._grounds, key, ground, MOST_GROUNDS)
        _keep(self._layouts, field_key, ground.estimates.layout, MOST_LAYOUTS)
        return ground

    def _lay_out(self, reference: WorkOrder, field_key: str) -> _KeptGround:
        borrowed = _borrow_layout(reference.request, self._layouts.get(field_key))
        if borrowed is not None:
            with suppress(HeadlandError):  # what fits one width may not fit another
                return _KeptGround(prepare_ground(replace(reference, request=borrowed)), True)
        return _KeptGround(prepare_ground(reference), False)


def _keep(kept: OrderedDict[str, T], key: str, value: T, most: int) -> None:
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


def _choose_reference(order: WorkOrder) -> WorkOrder:
    """The order at which tours are found, whatever speed is asked for first, so that answers do not depend on that."""
    request = order.request
    least_mps, greatest_mps = request.min_speed_mps or 0.0, request.max_speed_mps or math.inf
    speed_mps = min(max(PlanRequest.speed_mps, least_mps), greatest_mps)
    return replace(order, request=replace(request, speed_mps=speed_mps, turn_speed_mps=None))


def _borrow_layout(request: PlanRequest, layout: tuple[float, int] | None) -> PlanRequest | None:
    """The request with bearing and headland passes of a layout; None without one, and where it asks for its own."""
    own = request.bearing_deg, request.guidance_line, request.headland_m, request.headland_passes
    if layout is None or own != (None,) * 4 or request.cell_bearings or request.swaths != STRAIGHT:
        return None
    bearing_deg, passes = layout
    return replace(request, bearing_deg=bearing_deg, headland_passes=None if request.no_headland else passes)
