"""The state of a fleet as plain values, so that it goes on after a restart of the service."""

from __future__ import annotations

from typing import Any

from planner.service.centre.centre import Centre
from planner.service.centre.core import READY
from planner.service.centre.tractors import NEAR, OBSTACLE, TractorState

LASTING = ("leg", "leg_m", "released", "update", "done", "failed", "driving_s", "driven_plan_s")
PASSING = frozenset({NEAR, OBSTACLE})
"""Holds that are found out anew."""


def progress_of(centre: Centre, now: float, clock_s: float) -> dict[str, Any]:
    """What is kept. `now` is the time of the centre and `clock_s` the same moment by a clock that outlives it."""
    started = None if centre.started_s is None else clock_s - (now - centre.started_s)
    return {
        "state": centre.state, "started_clock_s": started,
        "tractors": [
            {name: getattr(state, name) for name in LASTING} | {"holds": sorted(state.holds - PASSING)}
            for state in centre.states
        ],
        "obstacles": [
            {"name": block.name, "who": block.who, "ring": [list(point) for point in block.ring]}
            for block in centre.obstacles.items.values()
        ],
    }  # fmt: skip


def restore(centre: Centre, kept: dict[str, Any], now: float, clock_s: float) -> None:
    """Let a new centre of the same plan go on from what was kept; empty for one that never began."""
    if not kept:
        return
    centre.state = kept.get("state", READY)
    started = kept.get("started_clock_s")
    centre.started_s = None if started is None else now - (clock_s - started)
    for state, values in zip(centre.states, kept.get("tractors", ()), strict=False):
        _restore_tractor(state, values)
    for block in kept.get("obstacles", ()):
        centre.obstacle(block["who"], tuple((x, y) for x, y in block["ring"]), block["name"], now)


def _restore_tractor(state: TractorState, values: dict[str, Any]) -> None:
    for name in LASTING:
        setattr(state, name, values[name])
    state.holds = set(values["holds"])  # one that was driven by remote control stands until it is resumed
