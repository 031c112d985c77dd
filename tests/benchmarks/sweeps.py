"""Time sweeps, and drive some of their combinations in full to see how near the estimates are.

    python -m tests.benchmarks.sweeps [--only time,notebook,accuracy] [--points 12] [--seed 48]

`time`: wall and CPU seconds of 10,080 combinations on denmark. `notebook`: 60 of them by `headland.sweep`. `accuracy`:
combinations drawn over the four samples, each estimated in a sweep of speeds and orders of the headland, then planned
by `headland plan`: median and worst difference of time, cost and share worked, and how near 9 of 10 are.
"""

import argparse
import os
import random
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import headland
import numpy as np

from fields.units import MPS_PER_KMH
from planner.evaluation.preparation import prepare_context
from planner.evaluation.work_order import WorkOrder
from planner.pipeline.planning import plan_order
from planner.pipeline.worker_tasks import pack_context, warm_up_simulation
from planner.request.plan_request import PlanRequest
from planner.sweeps.axes import read_axes
from planner.sweeps.estimates import UNCERTAINTY_PCT
from planner.sweeps.sweep import Sweep, build_tasks, estimate_task
from reports.common.plan_results import PlanResult
from strategies.path_planning.turn_kinds import HEADLAND_ORDERS

SAMPLES = ("denmark", "iwamizawa", "netherlands", "sweden")
WIDTHS_M, SPEEDS_KMH, MOST_TRACTORS = (3.0, 4.5, 6.0), tuple(range(6, 13)), 8
TEN_THOUSAND = {
    "width": list(WIDTHS_M),
    "speed_kmh": list(SPEEDS_KMH),
    "tractors": list(range(1, MOST_TRACTORS + 1)),
    "headland_order": list(HEADLAND_ORDERS),
    "price_per_hour": [float(price) for price in range(31, 61)],
}
SIXTY: dict[str, Any] = {"width": [3.0, 6.0], "speed_kmh": [6, 8, 10, 12, 14], "tractors": "1-6"}
MIDDLE_KMH = SPEEDS_KMH[len(SPEEDS_KMH) // 2]
MEDIAN_PCT, WORST_PCT = 5.0, 15.0
"""What estimates may differ by."""


@dataclass(frozen=True)
class Difference:
    """How an estimate differs from the drive: time and cost in percent, ground worked in percent of the field."""

    name: str
    request: PlanRequest
    time_pct: float
    cost_pct: float
    worked_pct: float
    driven: PlanResult


def measure(work: Callable[[], Any]) -> tuple[Any, float, float]:
    """What work returns, and its wall and CPU seconds, those of processes that it started and ended as well."""
    wall_s, before = time.perf_counter(), os.times()
    result = work()
    after = os.times()
    cpu_s = sum(after[:4]) - sum(before[:4])
    return result, time.perf_counter() - wall_s, cpu_s


def sweep_ten_thousand() -> Sweep:
    """All combinations on one field, over all cores."""

    def build_order(name: str, parameters: Any) -> WorkOrder:
        return WorkOrder(replace(PlanRequest(name), **parameters))

    sweep = Sweep(read_axes(TEN_THOUSAND), ("denmark",), build_order)
    sweep.run()
    return sweep


def compare_with_drive(request: PlanRequest) -> Difference | None:
    """An estimate beside the plan to take when the same is driven; None where there is none of either."""
    axes = read_axes({"speed_kmh": list(SPEEDS_KMH), "headland_order": list(HEADLAND_ORDERS)})
    (task,) = build_tasks(axes, lambda parameters: WorkOrder(replace(request, **parameters)))
    plans = estimate_task(task.orders, pack_context(prepare_context(task.reference)))
    wanted = request.headland_order, round(request.speed_mps / MPS_PER_KMH, 6)
    found = [(one.request.headland_order, round(one.request.speed_mps / MPS_PER_KMH, 6)) for one in task.orders]
    estimate, driven = plans[found.index(wanted)], plan_order(WorkOrder(request)).ranking.best
    if driven is None or not estimate.feasible:
        return None
    options = f"{request.width_m:g} m, {request.speed_mps * 3.6:g} km/h, {request.tractors[0]}"
    return Difference(
        f"{request.field}, {options}, headland {request.headland_order}",
        request,
        100.0 * (estimate.ranked_s / driven.ranked_s - 1.0),
        100.0 * (estimate.ranked_cost / driven.ranked_cost - 1.0),
        (estimate.worked_pct or 0.0) - (driven.worked_pct or 0.0),
        driven,
    )


def print_accuracy(count: int, seed: int) -> None:
    """Every combination, then the median and the worst difference of each figure."""
    found = []
    draw = random.Random(seed)
    for request in [
        PlanRequest(
            SAMPLES[number % len(SAMPLES)],
            width_m=draw.choice(WIDTHS_M),
            speed_mps=draw.choice(SPEEDS_KMH) * MPS_PER_KMH,
            tractors=(draw.randint(1, MOST_TRACTORS),),
            headland_order=draw.choice(HEADLAND_ORDERS),
        )
        for number in range(count)
    ]:
        difference = compare_with_drive(request)
        if difference is None:
            print(f"  {request.field}, {request.tractors[0]} tractors: no plan", flush=True)
            continue
        found.append(difference)
        print(
            f"  {difference.name}: time {difference.time_pct:+.1f} %, cost {difference.cost_pct:+.1f} %, "
            f"worked {difference.worked_pct:+.2f}; {difference.driven.strategy}, "
            f"waiting {difference.driven.waiting_s or 0.0:.0f} s",
            flush=True,
        )
    for name in ("time_pct", "cost_pct", "worked_pct"):
        values = [abs(getattr(one, name)) for one in found]
        print(f"{name}: median {statistics.median(values):.2f}, worst {max(values):.2f}")
    print(f"allowed: {MEDIAN_PCT:g} % in the median, {WORST_PCT:g} % at worst")
    print_uncertainty([one for one in found if round(one.request.speed_mps / MPS_PER_KMH) != MIDDLE_KMH])


def print_uncertainty(found: list[Difference]) -> None:
    """How near 9 of 10 estimates of one, two and more tractors are at speeds not driven: UNCERTAINTY_PCT."""
    most = len(UNCERTAINTY_PCT)
    for number, told_pct in enumerate(UNCERTAINTY_PCT, start=1):
        values = [abs(one.time_pct) for one in found if min(one.request.tractors[0], most) == number]
        if values:
            near, label = np.percentile(values, 90.0, method="inverted_cdf"), f"{number}{'+' * (number == most)}"
            print(f"{label}: {len(values)}, 9 of 10 {near:.1f} (told {told_pct:g}), worst {max(values):.1f}")


def main() -> None:
    """Print what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="time,notebook,accuracy")
    parser.add_argument("--points", type=int, default=12)
    parser.add_argument("--seed", type=int, default=48)
    options = parser.parse_args()
    only = options.only.split(",")
    warm_up_simulation()
    if "time" in only:
        sweep, wall_s, cpu_s = measure(sweep_ten_thousand)
        print(f"{sweep.total:,} combinations on denmark: {wall_s:.1f} s wall, {cpu_s:.1f} s CPU", flush=True)
    if "notebook" in only:
        frame, wall_s, cpu_s = measure(lambda: headland.sweep(PlanRequest("denmark"), **SIXTY))
        print(f"{len(frame)} combinations in Python: {wall_s:.1f} s wall, {cpu_s:.1f} s CPU", flush=True)
    if "accuracy" in only:
        print_accuracy(options.points, options.seed)


if __name__ == "__main__":
    main()
