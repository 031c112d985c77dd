"""The gates by which tractors of a plan give way, from what each would do alone on the field."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from planner.yielding.courses import Alone, Known, courses_of
from planner.yielding.crossings import crossings_of, unhindered
from planner.yielding.right_of_way import RightOfWay
from vehicle.compile import compile_model
from vehicle.missions import Gate, Mission, Plan
from vehicle.tractor import Implement, Tractor


@dataclass(frozen=True)
class Rules:
    """What tractors must keep: the machines, how near they may come, and how one is driven `alone`.

    `known` is what has been worked out by the same rules before.
    """

    tractor: Tractor
    implement: Implement
    clearance_m: float
    beside_m: float
    alone: Alone
    known: Known = field(default_factory=Known)


@dataclass(frozen=True)
class Scheduled:
    """A plan with gates so that nobody meets another, how long it is predicted to take, and how long were all alone."""

    plan: Plan
    predicted_s: float
    alone_s: float


def giving_way(plan: Plan, rules: Rules, slack: float = 1.0) -> Scheduled | None:
    """The plan with gates so that nobody meets another; None where no order of going was found.

    `slack` times the usual time is kept between two that take the same place one after the other.
    """
    courses = courses_of(plan, rules.alone, rules.known)
    if courses is None:
        return None
    models = np.array([compile_model(rules.tractor, rules.implement)])
    gated = [{n for n, leg in enumerate(mission.legs) if leg.gates} for mission in plan.missions]
    crossings = crossings_of(courses, models, rules.clearance_m, rules.beside_m, gated, rules.known)
    rules_of_way = RightOfWay(plan, crossings, slack)
    table = rules_of_way.timetable()
    if table is None:
        return None
    alone = RightOfWay(plan, unhindered(crossings.courses)).timetable()
    alone_s = table.duration_s if alone is None else alone.duration_s
    scheduled = _with_gates(_without_gates(plan, rules_of_way.homeward.loosened), table.gates)
    return Scheduled(scheduled, table.duration_s, alone_s)


def _without_gates(plan: Plan, left_out: list[tuple[int, int, Gate]]) -> Plan:
    """The plan without gates at (tractor, leg); how often a tractor is no longer waited for is noted as `loosened`."""
    missions, places = list(plan.missions), {(gate.tractor, gate.leg) for _, _, gate in left_out}
    for tractor, leg, gate in left_out:
        legs = list(missions[tractor].legs)
        kept = tuple(each for each in legs[leg].gates if each is not gate)
        legs[leg] = replace(legs[leg], gates=kept)
        missions[tractor] = Mission(tuple(legs))
    return Plan(tuple(missions), plan.notes | {"loosened": len(places)}) if left_out else plan


def _with_gates(plan: Plan, gates: list[tuple[int, int, Gate]]) -> Plan:
    """The plan with gates at (tractor, leg); of several on one leg of the same tractor only the last opens late."""
    kept: dict[tuple[int, int, int], Gate] = {}
    for tractor, leg, gate in gates:
        key = tractor, leg, gate.tractor
        if key not in kept or (kept[key].leg, kept[key].after_m) < (gate.leg, gate.after_m):
            kept[key] = gate
    for (tractor, leg, _), gate in kept.items():
        plan = plan.with_gate(tractor, leg, gate)
    return plan
