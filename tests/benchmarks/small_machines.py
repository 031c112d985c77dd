"""A mower of one metre on fields of a sixth of a hectare: python -m tests.benchmarks.small_machines

Swaths of 0.965 m, a planned radius of 1.9 m, 0.75 m/s at work and 0.5 m/s in turns: four radii are as wide as eight
swaths, and one swath after another takes half as long to turn as to work. Per field: what the planner plans, and one
swath after another with omega turns, with headland passes and without; seconds with the missed ground finished, share
worked, and by how much the order could still be quicker between swaths.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any

import shapely

from fields import Field
from planner.evaluation.candidates.evaluate import Candidate, simulate_candidate
from planner.evaluation.context import PlanningContext
from planner.evaluation.preparation import prepare_context
from planner.evaluation.work_order import WorkOrder
from planner.request.plan_request import PlanRequest
from reports.common.plan_results import PlanResult

MOWER = Path(__file__).with_name("mower.toml")
WIDTH_M, RADIUS_M, WORK_MPS, TURN_MPS = 0.965, 1.9, 0.75, 0.5
STRATEGY = "split-field"
FIELDS = {
    "rectangle": [(0, 0), (42.5, 0), (42.5, 39.5), (0, 39.5)],
    "trapezium": [(0, 0), (46, 0), (46, 32), (0, 42)],
    "quadrangle": [(0, 3), (44, -4), (52, 33), (5, 40)],
    "L": [(0, 0), (48, 0), (48, 24), (26, 24), (26, 47), (0, 47)],
    "hexagon": [(10, 0), (36, 2), (48, 21), (40, 44), (12, 46), (0, 23)],
}
"""Outlines in metres, 1,655 to 1,750 m2."""
PLANS: dict[str, dict[str, Any]] = {
    "as planned": {},
    "omega turns": {"turn": "omega"},
    "omega turns, headland left": {"turn": "omega", "no_headland": True},
}


def prepare(name: str, **options: Any) -> PlanningContext:
    """The planning context of the mower on one of the fields."""
    request = PlanRequest(
        field=name, tractor=str(MOWER), tractors=(1,), width_m=WIDTH_M, radius_m=RADIUS_M,
        speed_mps=WORK_MPS, turn_speed_mps=TURN_MPS, **options,
    )  # fmt: skip
    return prepare_context(WorkOrder(request, Field(name, shapely.Polygon(FIELDS[name]))))


def plan(context: PlanningContext) -> PlanResult:
    """The figures of one tractor."""
    return simulate_candidate(context, Candidate(STRATEGY, 1)).result


def describe(label: str, context: PlanningContext, figures: PlanResult, cpu_s: float) -> str:
    """One row of the table."""
    if not figures.feasible or figures.finished_s is None or figures.worked_pct is None:
        return f"{label:28} {figures.reason}"
    gap = "" if figures.order_gap_pct is None else f"{figures.order_gap_pct:.2f}"
    return (
        f"{label:28} {len(context.layout.swaths):6} {context.layout.headland_passes:6} {figures.finished_s:10.0f} "
        f"{figures.worked_pct:8.2f} {gap:>6} {cpu_s:6.1f}"
    )


def compare(name: str) -> None:
    """Print the rows of a field."""
    area_m2 = shapely.Polygon(FIELDS[name]).area
    print(f"\n{f'{name}, {area_m2:.0f} m2':28} swaths passes finished s worked % gap %  CPU s")
    finished_s = []
    for label, options in PLANS.items():
        begun = time.process_time()
        context = prepare(name, **options)
        figures = plan(context)
        print(describe(label, context, figures, time.process_time() - begun), flush=True)
        finished_s.append(figures.finished_s)
    planned_s, *others_s = finished_s
    shares = [f"{100.0 * (1.0 - planned_s / other_s):.1f}" for other_s in others_s if planned_s and other_s]
    print(f"{'quicker than these by %':28} {', '.join(shares)}")


if __name__ == "__main__":
    for chosen in sys.argv[1:] or FIELDS:
        compare(chosen)
