"""The confined process that estimates plans, with the grounds that it keeps from one answer to the next.

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
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from planner.errors import HeadlandError
from planner.risk.costs import choose_terms
from planner.service.sandbox.confined_reading import encode_answer, write_all
from planner.service.sandbox.confinement import confine_process, list_library_folders, lower_priority
from planner.service.sandbox.readings import build_work_order
from planner.sweeps.estimates import Points
from planner.sweeps.kept_grounds import BEARING_DECIMALS, KeptGrounds, OrderEstimate
from reports.common.rendering import pick_values
from reports.common.wording import round_up_to_minute
from reports.plan.shortfall_wording import describe_lacks, question_pull

WARM_UP = {"field": "iwamizawa", "width": 3.0, "tractors": "1-2"}
READY = b"{}\n"
PLAN_KEYS = ("tractors", "feasible", "reason", "time_s", "finished_s", "done_s", "cost", "worked_pct")


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
