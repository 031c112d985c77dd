"""The confined process that estimates plans, with the grounds that it keeps from one answer to the next, so that a
changed number, speed or width is answered at once.

It is started without secrets, loads and warms up what estimates take, and then confines itself as readings are, to the
folder of the requests' files. A line of JSON is an order, {folder, values, files, at_once}, and a line its answer:
{value}, {refused, parameter}, {memory} or {fault}, each with `computing_s`.
"""

from __future__ import annotations

import json
import os
import select
import signal
import time
from collections import OrderedDict
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from fields.units import MPS_PER_KMH
from planner.errors import HeadlandError
from planner.evaluation.preparation import prepare_context
from planner.evaluation.work_order import WorkOrder
from planner.request.parameter_names import UNLAID
from planner.request.plan_request import STRAIGHT, PlanRequest
from planner.risk.costs import are_prices_given, choose_terms
from planner.service.sandbox.confined_reading import encode_answer, write_all
from planner.service.sandbox.confinement import confine_process, list_library_folders, lower_priority
from planner.service.sandbox.readings import build_work_order
from planner.sweeps.estimates import SUMMED, EstimatedLine, GroundEstimates, Points, keep_last
from reports.common.plan_results import PlanResult, choose_plan
from reports.common.rendering import pick_values
from reports.common.wording import round_up_to_minute
from reports.plan.shortfall_wording import describe_lacks, question_pull

WARM_UP = {"field": "iwamizawa", "width": 3.0, "tractors": "1-2"}
READY = b"{}\n"
PLAN_KEYS = ("tractors", "feasible", "reason", "time_s", "finished_s", "done_s", "cost", "worked_pct")
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


def estimate_order(grounds: KeptGrounds, order: Mapping[str, Any]) -> dict[str, Any]:
    """The estimate of an order, as the API answers it; raises HeadlandError for what cannot be planned."""
    work_order = build_work_order(order["values"])
    return describe_estimate(grounds.estimate(work_order, order["files"], at_once=order["at_once"]))


def describe_estimate(estimate: OrderEstimate) -> dict[str, Any]:
    """An estimate as plain values."""
    order, request = estimate.order, estimate.order.request
    terms = choose_terms(request, order.cost_terms)
    return {
        "recommended": None if estimate.best is None else estimate.best.tractors,
        "plans": [_describe_plan(estimate, place) for place in range(len(estimate.plans))],
        "caution": _describe_caution(estimate),
        "currency": terms.prices.currency,
        "width": request.width_m,
        "bearing": round(estimate.bearing_deg, BEARING_DECIMALS),
        "headland_passes": estimate.headland_passes,
        "is_layout_borrowed": estimate.is_layout_borrowed,
        "is_scaled": estimate.is_scaled,
        "lines": [
            {"name": one.name, "tractor": one.tractor, "place": one.place, "points": _round_points(one.points)}
            for one in estimate.lines
        ],
        "outlines": [_round_points(ring) for ring in estimate.outlines],
    }


def _describe_caution(estimate: OrderEstimate) -> str | None:
    """Why the best plan is no recommendation, else whether its tractor can pull the implement; None without a word."""
    best = estimate.best
    if best is None:
        return None
    lacks = describe_lacks(best, suggests_options=False).values()
    return " ".join(lacks) or question_pull(best.pull, suggests_options=False) or None


def _round_points(points: Points) -> list[list[float]]:
    """Places to the decimetre, without those that are then the same."""
    rounded = [[round(x_m, 1), round(y_m, 1)] for x_m, y_m in points]
    return [one for one, before in zip(rounded, [None, *rounded], strict=False) if one != before]


def _describe_plan(estimate: OrderEstimate, place: int) -> dict[str, Any]:
    request, plan = estimate.order.request, estimate.plans[place]
    has_clock = request.start_s is not None and plan.done_s is not None
    return {
        **pick_values(plan, PLAN_KEYS),
        "end": request.format_clock_after(round_up_to_minute(plan.done_s or 0.0)) if has_clock else None,
        "in_time": plan.meets_deadline,
    }


def serve(descriptor: int, folder: str, memory_bytes: int, computing_s: float) -> None:
    """Answer orders until the service is gone or `computing_s` are spent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    lower_priority()
    grounds, libraries = _warm_up(), list_library_folders()
    confine_process(Path(folder), libraries, memory_bytes, computing_s, descriptor)
    pending_orders = select.poll()  # which confinement leaves
    pending_orders.register(descriptor, select.POLLIN)
    write_all(descriptor, READY)
    with open(descriptor, "rb") as orders:  # a socket, of which confinement leaves reading and writing
        for line in orders:
            order = json.loads(line)
            write_all(descriptor, _answer_order(grounds, order) + b"\n")
            # the service waits for each answer, so that no order is in a buffer
            while order["at_once"] and not pending_orders.poll(0) and grounds.prepare():
                pass


def _warm_up() -> KeptGrounds:
    """Compile and load everything that an estimate calls, by making one."""
    from planner.pipeline.kernels import compile_kernels, list_missing_kernels

    compile_kernels(list_missing_kernels(), 1)
    grounds = KeptGrounds()
    with suppress(HeadlandError):
        for values in (WARM_UP, WARM_UP | {"speed_kmh": 7.0}):
            estimate_order(grounds, {"values": values, "files": "", "at_once": False})
    return grounds


def _answer_order(grounds: KeptGrounds, order: Mapping[str, Any]) -> bytes:
    """The answer to an order as JSON, with the seconds that it took to compute."""
    begun_s = time.process_time()

    def estimate() -> dict[str, Any]:
        os.chdir(order["folder"])
        return estimate_order(grounds, order)

    return encode_answer(estimate, lambda: {"computing_s": time.process_time() - begun_s})
