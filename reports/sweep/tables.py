"""A sweep as a table: for programs all plans, for people those that nothing beats."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from reports.common.plan_results import PlanResult, get_ranked_cost, get_ranked_s
from reports.sweep.results import SweepResult, SweptPlan

if TYPE_CHECKING:
    from pandas import DataFrame

PLAN_KEYS = (
    "finished_s",
    "finished_cost",
    "worked_pct",
    "fuel_l",
    "energy_kwh",
    "meets_deadline",
    "feasible",
    "reason",
)


def list_rows(result: SweepResult) -> list[dict[str, Any]]:
    """All plans as plain values: options as written, figures, `on_front`, `is_best`; with several fields each alone."""
    keys = [option.key for option in result.options]
    on_front = {one.numbers for one in result.front}
    best = None if result.best is None else result.best.numbers

    def build_row(one: SweptPlan) -> dict[str, Any]:
        options = dict(zip(keys, result.get_values(one), strict=True))
        marks = {"on_front": one.numbers in on_front, "is_best": one.numbers == best}
        return {**options, **_list_figures(one.plan), **marks}

    if not result.by_field:
        return [build_row(one) for one in result.plans]
    return [{"field": name, **build_row(one)} for name, plans in result.by_field.items() for one in plans]


def build_sweep_frame(result: SweepResult) -> DataFrame:
    """The rows of `list_rows`."""
    import pandas as pd

    return pd.DataFrame(list_rows(result))


def _list_figures(plan: PlanResult) -> dict[str, Any]:
    figures = {key: getattr(plan, key) for key in PLAN_KEYS}
    if plan.feasible:
        figures |= {"finished_s": get_ranked_s(plan), "finished_cost": get_ranked_cost(plan)}
    return figures
