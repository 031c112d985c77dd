"""Charts of a page over the number of tractors, as numbers for its template: time, probability and expected cost."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

from reports.common.drawing_sizes import RISK_FRAME, TIME_FRAME, TIME_STEPS_S, ChartAxis
from reports.common.palette import TRACTOR_COLOURS
from reports.common.plan_results import PlanRanking, PlanResult
from reports.common.wording import format_deadline, format_duration, format_percent, format_price
from reports.plan.drive_geometry import MapExtent
from reports.plan.plan_wording import format_in_time_probability, format_unworked, list_feasible

_POINT_DISTANCE = 10.0  # between two points, in units of the picture
_BETWEEN, _INSET = 30.0, 20.0  # room between two curves, and at their ends


def _place_counts(plans: list[PlanResult]) -> dict[int, float]:
    """The x of every number of tractors, fewest first."""
    counts = sorted({plan.tractors for plan in plans})
    first = TIME_FRAME.left + _INSET
    span, inner = counts[-1] - counts[0], TIME_FRAME.right - _INSET - first
    return {count: round(first + (inner * (count - counts[0]) / span if span else inner / 2), 1) for count in counts}


def build_time_chart(ranking: PlanRanking) -> dict[str, Any] | None:
    """Points, Pareto line, deadline and ticks of time to finish by number of tractors; None without a feasible plan."""
    plans = [plan for plan in list_feasible(ranking) if plan.time_s is not None]
    if not plans:
        return None
    limit = ranking.allowed_s if ranking.field_allowed_s is None else ranking.field_allowed_s
    top = max([plan.ranked_s for plan in plans] + ([limit] if limit is not None else [])) * 1.06 or 1.0
    axis, places = ChartAxis(0.0, top, TIME_FRAME.bottom, TIME_FRAME.top), _place_counts(plans)
    names = list(dict.fromkeys(plan.strategy for plan in plans))
    front = sorted((plan.tractors, plan.ranked_s) for plan in plans if plan.on_pareto_front)
    deadline = None
    if limit is not None:
        deadline = {"y": axis.place(limit), "text": f"deadline {format_deadline(ranking)}"}
    return {
        "box": _build_box(axis),
        "width": TIME_FRAME.width,
        "height": TIME_FRAME.height,
        "points": _place_points(plans, names, [(places[one.tractors], axis.place(one.ranked_s)) for one in plans]),
        "line": " ".join(f"{places[count]},{axis.place(time)}" for count, time in front),
        "deadline": deadline,
        "counts": [{"x": x, "text": str(count)} for count, x in places.items()],
        "times": axis.list_ticks(TIME_STEPS_S, lambda time_s: format_duration(time_s).removesuffix(":00")),
        "names": [{"text": name, "colour": index % len(TRACTOR_COLOURS)} for index, name in enumerate(names)],
    }


def _build_box(axis: ChartAxis) -> MapExtent:
    """The band of the picture that an upward axis is of; its south is the upper edge, as y is down."""
    return MapExtent(TIME_FRAME.left, axis.last, TIME_FRAME.right, axis.first)


def _place_points(plans: list[PlanResult], names: list[str], places: list[tuple[float, float]]) -> list[dict[str, Any]]:
    """Points to draw, the best last; a point that would hide another is moved right, not as far as the next count."""
    columns = sorted({x for x, _ in places})
    room = min((right - left for left, right in pairwise(columns)), default=TIME_FRAME.width / 4)
    step = min(_POINT_DISTANCE, 0.6 * room / max(sum(x == column for x, _ in places) for column in columns))
    points: list[dict[str, Any]] = []
    for plan, (x, y) in zip(plans, places, strict=True):
        while any(abs(other["x"] - x) < 0.99 * step and abs(other["y"] - y) < _POINT_DISTANCE for other in points):
            x = round(x + step, 3)
        finish = "" if format_unworked(plan) is None else f", to finish {format_duration(plan.ranked_s)}"
        text = f"{plan.tractors} x {plan.strategy}, {plan.turn}: {format_duration(plan.stated_end_s)}{finish}"
        colour = names.index(plan.strategy) % len(TRACTOR_COLOURS)
        points.append({"x": x, "y": y, "colour": colour, "front": plan.on_pareto_front, "text": text})
    return points[::-1]


def build_risk_chart(ranking: PlanRanking) -> dict[str, Any] | None:
    """Two curves over the number of tractors: probability above, where there is one, and expected cost below.

    Every count has the plan to take. None without samples.
    """
    plans = choose_plan_per_count(ranking)
    if not plans:
        return None
    top = max(plan.expected_cost or 0.0 for plan in plans) * 1.06 or 1.0
    costs, ticks = [(plan, plan.expected_cost or 0.0) for plan in plans], dict[str, Any](most=5)
    curves = [(f"Cost, {ranking.currency}", top, ticks, costs)]
    judged = [(plan, plan.finish_probability) for plan in plans if plan.finish_probability is not None]
    if judged:
        curves.insert(0, ("In time, %", 1.0, {"steps": (0.25,), "write": format_percent}, judged))
    places, between = _place_counts(plans), _BETWEEN * (len(curves) - 1)
    height = (RISK_FRAME.bottom - RISK_FRAME.top - between) / len(curves)
    bands = []
    for number, (name, most, ticks, points) in enumerate(curves):
        upper = RISK_FRAME.top + number * (height + _BETWEEN)
        axis = ChartAxis(0.0, most, upper + height, upper)
        bands.append(
            {
                "name": name,
                "ticks": axis.list_ticks(**ticks),
                "points": [
                    {"x": places[plan.tractors], "y": axis.place(value), "best": plan is ranking.best,
                     "text": _describe_risk(plan)}
                    for plan, value in points
                ],
                "box": _build_box(axis),
            }
        )  # fmt: skip
    counts = [{"x": x, "text": str(count)} for count, x in places.items()]
    return {"width": RISK_FRAME.width, "height": RISK_FRAME.height, "bands": bands, "counts": counts}


def choose_plan_per_count(ranking: PlanRanking) -> list[PlanResult]:
    """The plan to take with every number of tractors that has a cost from samples, fewest first."""
    return [plan for plan in ranking.by_count.values() if plan.expected_cost is not None]


def _describe_risk(plan: PlanResult) -> str:
    in_time = "" if plan.finish_probability is None else f"{format_in_time_probability(plan)} % in time, "
    return f"{plan.tractors} x {plan.strategy}: {in_time}cost {format_price(plan.expected_cost)}"
