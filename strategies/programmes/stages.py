"""Headland first or last: the stage of every line, and tractors that wait for one another between the two stages."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from strategies.lines.work_line import WorkLine
from strategies.path_planning.turn_kinds import HEADLAND_FIRST
from vehicle.missions.plan import GATE_MARGIN_M, HEADLAND_PASS, Leg, LegGate, LegTask, Mission, Plan


def get_stage(task: LegTask, order: str) -> int:
    """0 for work that comes first in an order, 1 for what follows; with no order everything comes at any time."""
    return int((task.kind == HEADLAND_PASS) != (order == HEADLAND_FIRST)) if order else 0


def list_stages(lines: Sequence[WorkLine], order: str) -> list[int]:
    """The stage of every line."""
    return [get_stage(line.task, order) for line in lines]


@dataclass(frozen=True)
class _StageBorder:
    """Where a mission ends its first stage: `hold` is the leg before which it waits for others, 0 the very first.

    `is_awaited` says whether it has a first stage, so that others wait for it, `has_more` whether a second follows.
    """

    hold: int
    is_awaited: bool
    has_more: bool


def add_stage_gates(plan: Plan, order: str) -> Plan:
    """A plan in which nobody begins the second stage before all others are on the last part of their first.

    A tractor waits before that part of its own, where it may stand in any case.
    """
    borders = [_find_border(mission.legs, order) for mission in plan.missions]
    gates = [
        LegGate(number, border.hold - 1, max(0.0, mission.legs[border.hold - 1].length_m - GATE_MARGIN_M))
        for number, (mission, border) in enumerate(zip(plan.missions, borders, strict=True))
        if border.is_awaited and border.hold > 0
    ]
    for number, border in enumerate(borders):
        for gate in gates if border.has_more else ():
            if gate.tractor != number:
                plan = plan.copy_with_gate(number, border.hold, gate)
    return plan


def _find_border(legs: Sequence[Leg], order: str) -> _StageBorder:
    stages = [get_stage(leg.task, order) if leg.implement else -1 for leg in legs]
    last = max((number for number, stage in enumerate(stages) if stage == 0), default=0)
    hold = next((number for number in range(last, 0, -1) if legs[number].may_wait), 0)
    return _StageBorder(hold, 0 in stages, 1 in stages)


def stagger_starts(plan: Plan, distance_m: float) -> Plan:
    """A plan in which each tractor begins when the one before has driven a distance of its first working leg.

    Nobody waits for a tractor that waits itself before it begins.
    """
    for number in range(1, plan.tractors):
        before: Mission = plan.missions[number - 1]
        first = next(place for place, leg in enumerate(before.legs) if leg.implement)
        waits = any(gate.tractor >= number for gate in before.legs[0].gates)
        if not waits:
            after_m = max(0.0, min(distance_m, before.legs[first].length_m - GATE_MARGIN_M))
            plan = plan.copy_with_gate(number, 0, LegGate(number - 1, first, after_m))
    return plan
