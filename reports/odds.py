"""Probability and expected cost against number of tractors, as numbers for the template of a page."""

from __future__ import annotations

import math
from typing import Any

from reports.paths import Extent
from reports.results import PlanResult, Ranking
from reports.wording import feasible, in_time, percent, price

_WIDTH, _HEIGHT, _LEFT, _RIGHT, _ABOVE, _BELOW, _BETWEEN = 720.0, 420.0, 86.0, 16.0, 18.0, 56.0, 30.0
_STEPS = (0.1, 0.2, 0.5, 1, 2, 5)


def odds_picture(ranking: Ranking) -> dict[str, Any] | None:
    """Two curves over one axis of counts: probability above where there is one, expected cost below.

    Of every count the plan of least expected cost is drawn, but the best plan for its own. None without draws.
    """
    plans = of_counts(ranking)
    if not plans:
        return None
    sure = [plan for plan in plans if plan.finish_probability is not None]
    height = 0.5 * (_HEIGHT - _ABOVE - _BELOW - _BETWEEN) if sure else _HEIGHT - _ABOVE - _BELOW
    counts = [plan.tractors for plan in plans]
    span = counts[-1] - counts[0]
    inner = _WIDTH - _LEFT - _RIGHT - 40.0

    def x(plan: PlanResult) -> float:
        return round(_LEFT + 20.0 + (inner * (plan.tractors - counts[0]) / span if span else inner / 2), 1)

    north = _HEIGHT - _BELOW
    top = max(plan.expected_cost or 0.0 for plan in plans) * 1.06 or 1.0
    costs = _Band(north - height, north, top)
    chances = _Band(_ABOVE, _ABOVE + height, 1.0)
    bands = [
        {
            "name": f"Expected cost, {ranking.currency}",
            "ticks": [{"y": costs.y(value), "text": _plain(value)} for value in _ticks(top)],
            "points": [_point(ranking, plan, x(plan), costs.y(plan.expected_cost or 0.0)) for plan in plans],
            "box": Extent(_LEFT, costs.south, _WIDTH - _RIGHT, costs.north),
        }
    ]
    if sure:
        bands.insert(0, {
            "name": "In time, %",
            "ticks": [{"y": chances.y(share), "text": percent(share)} for share in (0.0, 0.25, 0.5, 0.75, 1.0)],
            "points": [_point(ranking, plan, x(plan), chances.y(plan.finish_probability or 0.0)) for plan in sure],
            "box": Extent(_LEFT, chances.south, _WIDTH - _RIGHT, chances.north),
        })  # fmt: skip
    return {
        "width": _WIDTH,
        "height": _HEIGHT,
        "bands": bands,
        "counts": [{"x": x(plan), "text": str(plan.tractors)} for plan in plans],
    }


class _Band:
    """A band of the picture from `south` (its top, in units downwards) to `north`, for values from 0 to `top`."""

    def __init__(self, south: float, north: float, top: float) -> None:
        self.south, self.north, self.top = south, north, top

    def y(self, value: float) -> float:
        return round(self.north - (self.north - self.south) * value / self.top, 1)


def of_counts(ranking: Ranking) -> list[PlanResult]:
    """One plan for every number of tractors, fewest first."""
    best, found = ranking.best, dict[int, PlanResult]()
    plans = [plan for plan in feasible(ranking) if plan.expected_cost is not None]
    for plan in sorted(plans, key=lambda plan: (plan.tractors, plan is not best, plan.expected_cost)):
        found.setdefault(plan.tractors, plan)
    return list(found.values())


def _point(ranking: Ranking, plan: PlanResult, x: float, y: float) -> dict[str, Any]:
    sure = "" if plan.finish_probability is None else f"{in_time(plan)} % in time, "
    text = f"{plan.tractors} x {plan.strategy}: {sure}expected cost {price(plan.expected_cost)}"
    return {"x": x, "y": y, "best": plan is ranking.best, "text": text}


def _ticks(top: float) -> list[float]:
    """Values from 0 to `top` at the smallest handy step that gives five or fewer."""
    power = 10.0 ** math.floor(math.log10(top))
    step = next(step * power for step in _STEPS if top / (step * power) <= 5.0)
    return [number * step for number in range(math.floor(top / step + 1e-9) + 1)]


def _plain(value: float) -> str:
    return f"{value:g}" if value < 1e6 else f"{value:.3g}"
