"""Charts of a page over the number of tractors, as numbers for its template: time, probability and expected cost."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

from reports.common.palette import TRACTOR_COLOURS
from reports.common.plan_results import PlanRanking, PlanResult, get_ranked_s, get_stated_s
from reports.common.wording import format_deadline, format_duration, format_percent, format_price
from reports.plan.drive_geometry import MapExtent
from reports.plan.plan_wording import (
    format_in_time_probability,
    format_unworked,
    list_feasible,
)

_TIME_STEPS_S = (1, 2, 5, 10, 20, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 14400, 21600, 43200, 86400)
_VALUE_STEPS = (0.1, 0.2, 0.5, 1, 2, 5)
_POINT_DISTANCE = 10.0  # between two points, in units of the picture
_RISK_WIDTH, _RISK_HEIGHT, _RISK_BETWEEN = 720.0, 420.0, 30.0  # of two curves, and between them
_RISK_LEFT, _RISK_RIGHT, _RISK_ABOVE, _RISK_BELOW = 86.0, 16.0, 18.0, 56.0  # room around them
_FRONT_BOX = (720.0, 340.0, 86.0, 16.0, 18.0, 56.0)  # width, height, then room left, right, above and below


def build_time_chart(ranking: PlanRanking) -> dict[str, Any] | None:
    """Points, Pareto line, deadline and ticks of time to finish by number of tractors; None without a feasible plan."""
    plans = [plan for plan in list_feasible(ranking) if plan.time_s is not None]
    if not plans:
        return None
    width, height, room_left, room_right, above, below = _FRONT_BOX
    limit = ranking.allowed_s if ranking.field_allowed_s is None else ranking.field_allowed_s
    top = max([get_ranked_s(plan) for plan in plans] + ([limit] if limit is not None else [])) * 1.06 or 1.0
    counts = sorted({plan.tractors for plan in plans})
    span = counts[-1] - counts[0]

    def scale_x(count: int) -> float:
        inner = width - room_left - room_right - 40
        return round(room_left + 20 + (inner * (count - counts[0]) / span if span else inner / 2), 1)

    def scale_y(time_s: float) -> float:
        return round(height - below - (height - above - below) * time_s / top, 1)

    names = list(dict.fromkeys(plan.strategy for plan in plans))
    front = sorted((plan.tractors, get_ranked_s(plan)) for plan in plans if plan.on_pareto_front)
    return {
        "box": MapExtent(room_left, above, width - room_right, height - below),
        "width": width,
        "height": height,
        "points": _place_points(
            plans, names, [(scale_x(plan.tractors), scale_y(get_ranked_s(plan))) for plan in plans]
        ),
        "line": " ".join(f"{scale_x(count)},{scale_y(time)}" for count, time in front),
        "deadline": None if limit is None else {"y": scale_y(limit), "text": f"deadline {format_deadline(ranking)}"},
        "counts": [{"x": scale_x(count), "text": str(count)} for count in counts],
        "times": [{"y": scale_y(time), "text": _format_tick_time(time)} for time in _choose_time_ticks(top)],
        "names": [{"text": name, "colour": index % len(TRACTOR_COLOURS)} for index, name in enumerate(names)],
    }


def _place_points(plans: list[PlanResult], names: list[str], places: list[tuple[float, float]]) -> list[dict[str, Any]]:
    """Points to draw, the best last; a point that would hide another is moved right, not as far as the next count."""
    columns = sorted({x for x, _ in places})
    room = min((right - left for left, right in pairwise(columns)), default=_FRONT_BOX[0] / 4)
    step = min(_POINT_DISTANCE, 0.6 * room / max(sum(x == column for x, _ in places) for column in columns))
    points: list[dict[str, Any]] = []
    for plan, (x, y) in zip(plans, places, strict=True):
        while any(abs(other["x"] - x) < 0.99 * step and abs(other["y"] - y) < _POINT_DISTANCE for other in points):
            x = round(x + step, 3)
        points.append(
            {
                "x": x,
                "y": y,
                "colour": names.index(plan.strategy) % len(TRACTOR_COLOURS),
                "front": plan.on_pareto_front,
                "text": f"{plan.tractors} x {plan.strategy}, {plan.turn}: {_describe_plan_times(plan)}",
            }
        )
    return points[::-1]


def _describe_plan_times(plan: PlanResult) -> str:
    """The time of a plan, and that to finish the field where it leaves ground."""
    finish = "" if format_unworked(plan) is None else f", to finish {format_duration(get_ranked_s(plan))}"
    return f"{format_duration(get_stated_s(plan))}{finish}"


def _choose_time_ticks(top_s: float) -> list[int]:
    """Times from 0 to `top_s` at the smallest round step that gives six or fewer."""
    step = next((step for step in _TIME_STEPS_S if top_s / step <= 6), 86400 * math.ceil(top_s / 86400 / 6))
    return list(range(0, math.floor(top_s) + 1, step))


def _format_tick_time(seconds: int) -> str:
    hours, rest = divmod(seconds, 3600)
    return f"{hours}:{rest // 60:02d}" + (f":{rest % 60:02d}" if rest % 60 else "")


def build_risk_chart(ranking: PlanRanking) -> dict[str, Any] | None:
    """Two curves over the number of tractors: probability above, where there is one, and expected cost below.

    Every count has its plan of lowest expected cost, that of the best plan has the best plan. None without samples.
    """
    plans = choose_plan_per_count(ranking)
    if not plans:
        return None
    judged = [plan for plan in plans if plan.finish_probability is not None]
    height = (
        0.5 * (_RISK_HEIGHT - _RISK_ABOVE - _RISK_BELOW - _RISK_BETWEEN)
        if judged
        else _RISK_HEIGHT - _RISK_ABOVE - _RISK_BELOW
    )
    counts = [plan.tractors for plan in plans]
    span = counts[-1] - counts[0]
    inner = _RISK_WIDTH - _RISK_LEFT - _RISK_RIGHT - 40.0

    def scale_x(plan: PlanResult) -> float:
        return round(_RISK_LEFT + 20.0 + (inner * (plan.tractors - counts[0]) / span if span else inner / 2), 1)

    north = _RISK_HEIGHT - _RISK_BELOW
    top = max(plan.expected_cost or 0.0 for plan in plans) * 1.06 or 1.0
    costs = _ChartBand(north - height, north, top)
    probabilities = _ChartBand(_RISK_ABOVE, _RISK_ABOVE + height, 1.0)
    bands = [
        {
            "name": f"Cost, {ranking.currency}",
            "ticks": [
                {"y": costs.scale_y(value), "text": _format_axis_value(value)} for value in _choose_value_ticks(top)
            ],
            "points": [
                _build_risk_point(ranking, plan, scale_x(plan), costs.scale_y(plan.expected_cost or 0.0))
                for plan in plans
            ],
            "box": MapExtent(_RISK_LEFT, costs.south, _RISK_WIDTH - _RISK_RIGHT, costs.north),
        }
    ]
    if judged:
        bands.insert(
            0,
            {
                "name": "In time, %",
                "ticks": [
                    {"y": probabilities.scale_y(share), "text": format_percent(share)}
                    for share in (0.0, 0.25, 0.5, 0.75, 1.0)
                ],
                "points": [
                    _build_risk_point(
                        ranking, plan, scale_x(plan), probabilities.scale_y(plan.finish_probability or 0.0)
                    )
                    for plan in judged
                ],
                "box": MapExtent(_RISK_LEFT, probabilities.south, _RISK_WIDTH - _RISK_RIGHT, probabilities.north),
            },
        )
    return {
        "width": _RISK_WIDTH,
        "height": _RISK_HEIGHT,
        "bands": bands,
        "counts": [{"x": scale_x(plan), "text": str(plan.tractors)} for plan in plans],
    }


class _ChartBand:
    """A band of the picture from y `south` (its upper edge, as y is down) to `north`, for values from 0 to `top`."""

    def __init__(self, south: float, north: float, top: float) -> None:
        self.south, self.north, self.top = south, north, top

    def scale_y(self, value: float) -> float:
        """The y of a value."""
        return round(self.north - (self.north - self.south) * value / self.top, 1)


def choose_plan_per_count(ranking: PlanRanking) -> list[PlanResult]:
    """One plan for every number of tractors, fewest first."""
    best, plan_by_count = ranking.best, dict[int, PlanResult]()
    plans = [plan for plan in list_feasible(ranking) if plan.expected_cost is not None]
    for plan in sorted(plans, key=lambda plan: (plan.tractors, plan is not best, plan.expected_cost)):
        plan_by_count.setdefault(plan.tractors, plan)
    return list(plan_by_count.values())


def _build_risk_point(ranking: PlanRanking, plan: PlanResult, x: float, y: float) -> dict[str, Any]:
    in_time_text = "" if plan.finish_probability is None else f"{format_in_time_probability(plan)} % in time, "
    text = f"{plan.tractors} x {plan.strategy}: {in_time_text}cost {format_price(plan.expected_cost)}"
    return {"x": x, "y": y, "best": plan is ranking.best, "text": text}


def _choose_value_ticks(top: float) -> list[float]:
    """Values from 0 to `top` at the smallest round step that gives five or fewer."""
    power = 10.0 ** math.floor(math.log10(top))
    step = next(step * power for step in _VALUE_STEPS if top / (step * power) <= 5.0)
    return [number * step for number in range(math.floor(top / step + 1e-9) + 1)]


def _format_axis_value(value: float) -> str:
    return f"{value:g}" if value < 1e6 else f"{value:.3g}"
