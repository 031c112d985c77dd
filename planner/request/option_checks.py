"""Checks of single parameters of a request: fleet, strategies and places."""

from __future__ import annotations

import math
from collections.abc import Iterable

from fields.text_files import shorten_value
from planner.errors import RequestError, mark_parameter, suggest_name
from planner.request.option_texts import MAX_TRACTORS


def check_fleet(tractors: tuple[int, ...], strategies: tuple[str, ...]) -> None:
    """Raise RequestError for no or too many tractors, and for no or unknown strategies."""
    from strategies.registry import STRATEGIES

    if not tractors:
        raise RequestError(f"No tractor count is given in {mark_parameter('tractors')}; use for instance 1 to 6.")
    for count in tractors:
        if not 1 <= count <= MAX_TRACTORS:
            raise RequestError(f"{count} tractors cannot be planned; use 1 to {MAX_TRACTORS}.", parameter="tractors")
    strategy_list = ", ".join(STRATEGIES)
    if not strategies:
        raise RequestError(f"No strategy is given; use one or more of: {strategy_list}.", parameter="strategies")
    for name in strategies:
        if name not in STRATEGIES:
            raise RequestError(
                f"Strategy {name!r} is unknown{suggest_name(name, STRATEGIES)}; use one of: {strategy_list}.",
                parameter="strategies",
            )


def check_places(entrance: tuple[float, float] | None, obstacles: Iterable[str], ignored: Iterable[str]) -> None:
    """Raise HeadlandError for an entrance or obstacle that is not a place, and for an empty name to ignore."""
    if entrance is not None and not all(map(math.isfinite, entrance)):
        raise RequestError(
            f"{mark_parameter('entrance')} is {shorten_value(entrance)}; give two numbers, longitude and latitude."
        )
    if obstacles:
        from fields.geometry.chosen_obstacles import parse_obstacle_place

        for text in obstacles:
            parse_obstacle_place(text)
    if any(not name.strip() for name in ignored):
        raise RequestError(f"{mark_parameter('ignored')} is empty; give the name or number of an obstacle.")
