"""Time against number of tractors as numbers for the template of a page: that until the field is finished."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

from reports.palette import TRACTORS
from reports.paths import Extent
from reports.results import PlanResult, Ranking, finish_s
from reports.wording import clock, duration, feasible, left

_TICKS_S = (1, 2, 5, 10, 20, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 14400, 21600, 43200, 86400)
_APART = 10.0  # between two points, in units of the picture
_FRONT = (720.0, 340.0, 86.0, 16.0, 18.0, 56.0)  # width, height, then room left, right, above and below


def front_picture(ranking: Ranking) -> dict[str, Any] | None:
    """Points, Pareto line, deadline and ticks of time against number of tractors; None without a feasible plan."""
    plans = [plan for plan in feasible(ranking) if plan.time_s is not None]
    if not plans:
        return None
    width, height, left, right, above, below = _FRONT
    limit = ranking.allowed_s if ranking.field_allowed_s is None else ranking.field_allowed_s
    top = max([finish_s(plan) for plan in plans] + ([limit] if limit is not None else [])) * 1.06 or 1.0
    counts = sorted({plan.tractors for plan in plans})
    span = counts[-1] - counts[0]

    def x(count: int) -> float:
        inner = width - left - right - 40
        return round(left + 20 + (inner * (count - counts[0]) / span if span else inner / 2), 1)

    def y(time_s: float) -> float:
        return round(height - below - (height - above - below) * time_s / top, 1)

    names = list(dict.fromkeys(plan.strategy for plan in plans))
    return {
        "box": Extent(left, above, width - right, height - below),
        "width": width,
        "height": height,
        "points": _front_points(plans, names, [(x(plan.tractors), y(finish_s(plan))) for plan in plans]),
        "line": " ".join(f"{x(count)},{y(time)}" for count, time in _front_line(plans)),
        "deadline": None if limit is None else {"y": y(limit), "text": _deadline(ranking)},
        "counts": [{"x": x(count), "text": str(count)} for count in counts],
        "times": [{"y": y(time), "text": _hours(time)} for time in _ticks(top)],
        "names": [{"text": name, "colour": index % len(TRACTORS)} for index, name in enumerate(names)],
    }


def _front_line(plans: list[PlanResult]) -> list[tuple[int, float]]:
    return sorted((plan.tractors, finish_s(plan)) for plan in plans if plan.on_pareto_front)


def _front_points(plans: list[PlanResult], names: list[str], places: list[tuple[float, float]]) -> list[dict[str, Any]]:
    """Points to draw, the best last; one that would hide another is moved right, but not as far as the next count."""
    columns = sorted({x for x, _ in places})
    room = min((right - left for left, right in pairwise(columns)), default=_FRONT[0] / 4)
    step = min(_APART, 0.6 * room / max(sum(x == column for x, _ in places) for column in columns))
    points: list[dict[str, Any]] = []
    for plan, (x, y) in zip(plans, places, strict=True):
        while any(abs(other["x"] - x) < 0.99 * step and abs(other["y"] - y) < _APART for other in points):
            x = round(x + step, 3)
        points.append(
            {
                "x": x,
                "y": y,
                "colour": names.index(plan.strategy) % len(TRACTORS),
                "front": plan.on_pareto_front,
                "text": f"{plan.tractors} x {plan.strategy}, {plan.turn}: {duration(plan.time_s)}{_to_finish(plan)}",
            }
        )
    return points[::-1]


def _to_finish(plan: PlanResult) -> str:
    return "" if left(plan) is None else f", to finish {duration(finish_s(plan))}"


def _ticks(top_s: float) -> list[int]:
    """Times from 0 to `top_s` at the smallest handy step that gives six or fewer."""
    step = next((step for step in _TICKS_S if top_s / step <= 6), 86400 * math.ceil(top_s / 86400 / 6))
    return list(range(0, math.floor(top_s) + 1, step))


def _hours(seconds: int) -> str:
    hours, rest = divmod(seconds, 3600)
    return f"{hours}:{rest // 60:02d}" + (f":{rest % 60:02d}" if rest % 60 else "")


def _deadline(ranking: Ranking) -> str:
    """The deadline as a clock time where there is a start to count from."""
    return f"deadline {clock(ranking, ranking.allowed_s) or duration(ranking.allowed_s)}"
