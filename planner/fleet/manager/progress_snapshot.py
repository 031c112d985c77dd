"""The state of a fleet as plain values, to continue after a restart of the service."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any

from planner.fleet.manager.fleet_manager import FleetManager
from planner.fleet.manager.fleet_state import READY, RUNNING, STOPPED
from planner.fleet.model.alarms import FleetAlarm
from planner.fleet.model.tractor_state import Hold, MotionDoubt, TractorReport, TractorState

LASTING_FIELDS = {
    "leg": "leg",
    "leg_m": "leg_m",
    "released": "base_end",
    "update": "update",
    "done": "done",
    "failed": "failed",
    "driving_s": "driving_s",
    "driven_plan_s": "planned_driving_s",
}
"""Attributes of a tractor's state that a restart keeps, by their stored keys."""
TRANSIENT_HOLDS = frozenset({Hold.OBSTACLE, Hold.WAITS_FOR_PLAN})
"""Holds that are not saved because they are found again; TOO_NEAR is saved, as standing tractors raise none."""


def capture_progress(manager: FleetManager, now: float, clock_s: float) -> dict[str, Any]:
    """The state to save. `now` is the fleet manager's time, `clock_s` the same moment in seconds since 1970."""
    started_clock_s = None if manager.started_s is None else clock_s - (now - manager.started_s)
    return {
        "state": manager.state,
        "started_clock_s": started_clock_s,
        "tractors": [_capture_tractor(state, now, clock_s) for state in manager.states],
        "obstacles": [
            {"id": block.id, "name": block.name, "who": block.who, "ring": [list(point) for point in block.ring]}
            for block in manager.obstacles.items.values()
        ],
        "alarms": [
            asdict(alarm) | {"since_s": clock_s - (now - alarm.since_s)} for alarm in manager.alarms.list_alarms()
        ],
    }


def _capture_tractor(state: TractorState, now: float, clock_s: float) -> dict[str, Any]:
    """A tractor with its last report and when it came, and its doubt, if there are any."""
    values = {key: getattr(state, name) for key, name in LASTING_FIELDS.items()}
    values |= {"holds": sorted(state.holds - TRANSIENT_HOLDS), "last": None, "doubt": None}
    if state.report is not None:
        contact = {"clock_s": clock_s - (now - state.last_fix_s), "said_goodbye": state.has_disconnected}
        values["last"] = {"report": state.report._asdict()} | contact
    if state.doubt is not None:
        values["doubt"] = asdict(state.doubt) | {"since_s": clock_s - (now - state.doubt.since_s)}
    return values


def restore_progress(manager: FleetManager, saved: dict[str, Any], now: float, clock_s: float) -> None:
    """Restore a saved state (empty: none) into a new fleet manager of the same plan; all tractors are held."""
    if not saved:
        return
    manager.state = saved.get("state", READY)
    started_clock_s = saved.get("started_clock_s")
    manager.started_s = None if started_clock_s is None else now - (clock_s - started_clock_s)
    for state, values in zip(manager.states, saved.get("tractors", ()), strict=False):
        _restore_tractor(state, values, now - clock_s)
        state.unreadable_s = now if Hold.UNREADABLE in state.holds else -math.inf
    codes = {}
    for block in saved.get("obstacles", ()):
        ring = tuple((x, y) for x, y in block["ring"])
        obstacle = manager.obstacle_reports.add(block["who"], ring, block["name"], now)
        codes[f"obstacle {block.get('id')}"] = f"obstacle {obstacle.id}"
    if "alarms" in saved:
        alarms = []
        for values in saved["alarms"]:  # obstacles have new numbers, which the codes of alarms that are on have too
            code = values["code"] if values["over"] else codes.get(values["code"], values["code"])
            alarms.append(FleetAlarm(**values | {"code": code, "since_s": values["since_s"] + (now - clock_s)}))
        manager.alarms.restore(alarms)
    if manager.state in (RUNNING, STOPPED):
        manager.operators.hold_after_restart(now)


def _restore_tractor(state: TractorState, values: dict[str, Any], offset_s: float) -> None:
    for key, name in LASTING_FIELDS.items():
        setattr(state, name, values[key])
    state.holds = set(values["holds"])  # under remote control before: it stands until it is resumed
    last = values.get("last")
    if last is not None:  # others keep away from its last place until it reports again
        report = last["report"]
        state.report = TractorReport(**report | {"errors": tuple(report["errors"])})
        state.last_contact_s = state.last_fix_s = last["clock_s"] + offset_s
        state.has_disconnected = last["said_goodbye"]
    doubt = values.get("doubt")
    if doubt is not None:
        place = {"pose": tuple(doubt["pose"]), "since_s": doubt["since_s"] + offset_s}
        state.doubt = MotionDoubt(**doubt | place)
