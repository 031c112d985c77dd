"""A programme as a plan, and what a drive of that says of its moves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from strategies.programmes.order_tours import DETOUR_S
from strategies.programmes.programme import Programme
from strategies.programmes.tour_legs import build_mission, build_stand
from vehicle.missions.plan import Mission, Plan
from vehicle.missions.run import SimulationRun

Floats = npt.NDArray[np.float64]


def build_plan(programme: Programme, **notes: Any) -> Plan:
    """The plan of a programme, one mission per tractor that has lines or stands on the field."""
    table, tours = programme.table, programme.tours
    missions = tuple(
        build_mission(table, tours[number]) if tours[number] else build_stand(table, table.starts[number])
        for number in programme.list_present()
    )
    return Plan(missions, {"tractors": len(missions), **notes})


def charge_waiting(programme: Programme, tours: Sequence[Sequence[int]], plan: Plan, run: SimulationRun) -> Floats:
    """Seconds (n + 1, n + 1) that tractors waited at each move in a run of the plan of a programme, DETOUR_S where two
    met.

    `tours` are its nodes in the order in which they are worked. A tractor waits before the last part of a line for the
    move that follows. Gates of the plan itself do not count.
    """
    charged_s = np.zeros_like(programme.table.cost_s)
    present = [tours[number] for number in programme.list_present()]
    moves = [_list_leg_moves(programme, *each) for each in zip(plan.missions, present, strict=True)]
    for tractor, (mission, of_legs) in enumerate(zip(plan.missions, moves, strict=True)):
        waited_s = np.where([bool(leg.gates) for leg in mission.legs], 0.0, run.sum_waits_s(tractor))
        np.add.at(charged_s, tuple(of_legs.T), waited_s)
    if run.conflict is not None:
        met = run.conflict
        for tractor, leg in ((met.first, met.first_leg), (met.second, met.second_leg)):
            charged_s[tuple(moves[tractor][leg])] += DETOUR_S
    return charged_s


def _list_leg_moves(programme: Programme, mission: Mission, tour: Sequence[int]) -> npt.NDArray[np.int64]:
    """The move (legs, 2) that each leg of a tour is part of, or that follows the line it works."""
    table = programme.table
    nodes, line, worked = (
        [table.gate, *tour, table.gate],
        int(any(table.lines[u // 2].is_place for u in tour[:1])),
        None,
    )
    pairs = []
    for leg in mission.legs:
        if leg.task.is_work and leg.task != worked:
            line, worked = line + 1, leg.task
        pairs.append(nodes[min(line, len(tour)) :][:2])
    return np.array(pairs, np.int64)
