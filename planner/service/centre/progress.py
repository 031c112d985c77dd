"""The state of a fleet as plain values, so that it goes on after a restart of the service."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any

from planner.service.centre.alarms import Alarm
from planner.service.centre.centre import Centre
from planner.service.centre.core import READY
from planner.service.centre.tractors import AUTOMATIC, OBSTACLE, UNREAD, WAITS, Report, TractorState

LASTING = ("leg", "leg_m", "released", "update", "done", "failed", "driving_s", "driven_plan_s")
PASSING = frozenset({OBSTACLE, WAITS})
"""Holds that are found out anew; not that of two too near, as nothing is foreseen of those that stand."""


def progress_of(centre: Centre, now: float, clock_s: float) -> dict[str, Any]:
    """What is kept. `now` is the time of the centre and `clock_s` the same moment by a clock that outlives it."""
    started = None if centre.started_s is None else clock_s - (now - centre.started_s)
    return {
        "state": centre.state, "started_clock_s": started,
        "tractors": [
            {name: getattr(state, name) for name in LASTING}
            | {"holds": sorted(state.holds - PASSING), "last": _last(state, now, clock_s)}
            for state in centre.states
        ],
        "obstacles": [
            {"id": block.id, "name": block.name, "who": block.who, "ring": [list(point) for point in block.ring]}
            for block in centre.obstacles.items.values()
        ],
        "alarms": [
            asdict(alarm) | {"since_s": clock_s - (now - alarm.since_s)} for alarm in centre.alarms.items()
        ],
    }  # fmt: skip


def _last(state: TractorState, now: float, clock_s: float) -> dict[str, Any] | None:
    """The last report of a tractor and when it came; None without one."""
    if state.report is None:
        return None
    heard = {"clock_s": clock_s - (now - state.seen_s), "said_goodbye": state.said_goodbye}
    return {"report": asdict(state.report)} | heard


def restore(centre: Centre, kept: dict[str, Any], now: float, clock_s: float) -> None:
    """Let a new centre of the same plan go on from what was kept; empty for one that never began."""
    if not kept:
        return
    centre.state = kept.get("state", READY)
    started = kept.get("started_clock_s")
    centre.started_s = None if started is None else now - (clock_s - started)
    for state, values in zip(centre.states, kept.get("tractors", ()), strict=False):
        _restore_tractor(state, values, now - clock_s)
        state.unread_s = now if UNREAD in state.holds else -math.inf
    codes = {}
    for block in kept.get("obstacles", ()):
        again = centre.obstacle(block["who"], tuple((x, y) for x, y in block["ring"]), block["name"], now)
        codes[f"obstacle {block.get('id')}"] = f"obstacle {again.id}"
    if "alarms" in kept:
        centre.alarms.put_back(_alarm(values, codes, now - clock_s) for values in kept["alarms"])


def _alarm(values: dict[str, Any], codes: dict[str, str], offset_s: float) -> Alarm:
    """An alarm that was kept; obstacles are numbered anew, and those that are on by `codes`."""
    code = values["code"] if values["over"] else codes.get(values["code"], values["code"])
    return Alarm(**values | {"code": code, "since_s": values["since_s"] + offset_s})


def _restore_tractor(state: TractorState, values: dict[str, Any], offset_s: float) -> None:
    for name in LASTING:
        setattr(state, name, values[name])
    state.holds = set(values["holds"])  # one that was driven by remote control stands until it is resumed
    last = values.get("last")
    if last is not None:  # by it the others keep away from where it was, until it is heard of again
        report = last["report"]
        state.report = Report(**report | {"errors": tuple(report["errors"])})
        state.heard_s = state.seen_s = last["clock_s"] + offset_s
        state.said_goodbye = last["said_goodbye"]
        state.doubtful = state.report.mode == AUTOMATIC and not state.holds
