"""Headland first or last: the stage of every line, and tractors that wait for one another between the two."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import shapely

from strategies.lines.work_line import HOLE_PASS, WorkLine
from strategies.path_planning.turn_kinds import HEADLAND_FIRST
from strategies.site.site import Site
from vehicle.missions.plan import HEADLAND_PASS, SWATH, Leg, LegGate, LegTask, Mission, Plan


def find_first_tasks(site: Site, lines: Sequence[WorkLine], order: str) -> frozenset[LegTask]:
    """What the lines are for that come before all others in an order: those of the headland, or the others.

    Where a machine works its way into a crop that stands, only passes round the field are its headland.
    """
    works_way_in = _works_way_in(site, order)
    headland = {
        line.task
        for line in lines
        if line.task.kind == HEADLAND_PASS and (line.group[0] == HEADLAND_PASS or not works_way_in)
    }
    return frozenset(headland if order == HEADLAND_FIRST else {line.task for line in lines} - headland)


def list_stages(site: Site, lines: Sequence[WorkLine], order: str) -> list[int]:
    """The stage of every line; with no order everything comes at any time.

    Into a crop that stands a machine works its way, headland first: passes round the field from the outside, tracks,
    passes round holes that it reaches over worked ground then, and last the pieces that begin or end there and what all
    others leave.
    """
    first = find_first_tasks(site, lines, order)
    if not _works_way_in(site, order):
        return [int(bool(order) and line.task not in first) for line in lines]
    passes = max((line.task.number or 0 for line in lines if line.task.kind == HEADLAND_PASS), default=0)
    round_holes = shapely.MultiLineString([line.paths[0] for line in lines if line.group[0] == HOLE_PASS])

    def find_stage(line: WorkLine) -> int:
        number = line.task.number or 0
        if line.task in first:
            return number - 1
        if line.group[0] == HOLE_PASS:
            return 2 * passes + 1 - number
        return passes if line.group[0] == SWATH and not ends_there(line) else 2 * passes + 1

    def ends_there(line: WorkLine) -> bool:
        ends = shapely.points(line.tool_path[[0, -1]])
        return bool((shapely.distance(ends, round_holes) < site.width_m).any())

    return [find_stage(line) for line in lines]


def _works_way_in(site: Site, order: str) -> bool:
    return site.crop_stands and order == HEADLAND_FIRST


@dataclass(frozen=True)
class _StageBorder:
    """Where a mission ends its first stage: `hold` is the leg before which it waits for others, 0 the very first.

    `is_awaited` says whether it has a first stage, so that others wait for it, `has_more` whether a second follows.
    """

    hold: int
    is_awaited: bool
    has_more: bool


def add_stage_gates(plan: Plan, first: Collection[LegTask]) -> Plan:
    """A plan in which nobody begins other work before all others are on the last part of what comes first.

    A tractor waits before that part of its own, where it may stand in any case.
    """
    borders = [_find_border(mission.legs, first) for mission in plan.missions]
    gates = [
        LegGate.place(number, border.hold - 1, mission.legs[border.hold - 1].length_m)
        for number, (mission, border) in enumerate(zip(plan.missions, borders, strict=True))
        if border.is_awaited and border.hold > 0
    ]
    for number, border in enumerate(borders):
        for gate in gates if border.has_more else ():
            if gate.tractor != number:
                plan = plan.copy_with_gate(number, border.hold, gate)
    return plan


def _find_border(legs: Sequence[Leg], first: Collection[LegTask]) -> _StageBorder:
    stages = [int(leg.task not in first) if leg.implement else -1 for leg in legs]
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
            gate = LegGate.place(number - 1, first, before.legs[first].length_m, distance_m)
            plan = plan.copy_with_gate(number, 0, gate)
    return plan
