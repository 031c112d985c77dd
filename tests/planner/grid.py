"""Courses drawn by hand, and traffic on a grid of cells in which only one tractor may be."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from hypothesis import strategies as st

from planner.traffic.conflict_zones import ConflictZones, find_conflict_zones
from planner.traffic.precedence import Timetable
from planner.traffic.trajectories import SoloTrajectory
from vehicle.missions.plan import Leg, LegGate, Mission, Plan
from vehicle.model.tractor import Implement, load_tractor
from vehicle.sim.path_conflicts import ClearanceCheck, build_poses

TRACTOR, IMPLEMENT = load_tractor("eg105"), Implement()
APART_M = 0.05
CHECK = ClearanceCheck.for_machine(TRACTOR, IMPLEMENT, APART_M, APART_M)

State = tuple[int, ...]


def trajectory(places: Sequence[tuple[float, float, float]], holds: Sequence[int], every_s: float) -> SoloTrajectory:
    """A trajectory over poses (x, y, angle), `every_s` seconds and metres apart, with hold points at some."""
    numbers = np.arange(len(places))
    seconds = np.array([every_s * number for number in range(len(places))])
    leg = np.clip(np.searchsorted(holds, numbers, "right") - 1, 0, len(holds) - 2)
    begins = np.asarray(holds)[leg]
    return SoloTrajectory(
        build_poses(np.array(places, dtype=float)),
        seconds,
        leg,
        seconds - seconds[begins],
        tuple(holds),
        tuple(range(len(holds))),
    )


def plan_on(trajectories: Sequence[SoloTrajectory], gates: dict[tuple[int, int], list[LegGate]] | None = None) -> Plan:
    """A plan with one leg per segment of every trajectory, each as long as it lasts, and these gates."""
    missions = []
    for one, each in enumerate(trajectories):
        legs = [
            Leg(
                np.array([[0.0, 0.0], [each.get_duration_s(number), 0.0]]),
                1.0,
                may_wait=True,
                gates=tuple((gates or {}).get((one, number), ())),
            )
            for number in range(each.segment_count)
        ]
        missions.append(Mission(tuple(legs)))
    return Plan(tuple(missions))


def straight(x: float, y: float, angle: float, metres: int, holds: Sequence[int]) -> SoloTrajectory:
    ahead = math.cos(angle), math.sin(angle)
    return trajectory([(x + n * ahead[0], y + n * ahead[1], angle) for n in range(metres + 1)], holds, 1.0)


def crossings(trajectories: Sequence[SoloTrajectory], gated: dict[int, set[int]] | None = None) -> ConflictZones:
    return find_conflict_zones(trajectories, CHECK, [(gated or {}).get(n, set()) for n in range(len(trajectories))])


@dataclass
class Cells:
    """Tractors that drive from cell to cell of a grid of 30 m, 10 s each; only one may be in a cell."""

    cells: list[list[int]]
    holds: list[list[int]]

    def trajectories(self) -> list[SoloTrajectory]:
        return [
            trajectory([(30.0 * (cell % 4), 30.0 * (cell // 4), 0.0) for cell in own], holds, 10.0)
            for own, holds in zip(self.cells, self.holds, strict=True)
        ]

    def taken(self, one: int, table: Timetable) -> list[tuple[float, float, int]]:
        """From when to when a tractor is in which cell by a timetable."""
        spans, own, holds = [], self.cells[one], self.holds[one]
        at_s, arrived = 0.0, 0.0
        for place, cell in enumerate(own):
            if place in holds[:-1]:
                begin = table.begins_s[one][holds.index(place)]
                at_s = max(at_s, begin)
            until = at_s + 10.0 if place < len(own) - 1 else math.inf
            spans.append((arrived, until, cell))
            at_s = arrived = until
        return spans


class Plain:
    """What may be done on a grid, told from cells and gates alone: a tractor moves while all others stand."""

    def __init__(self, drawn: Cells, gates: dict[tuple[int, int], list[LegGate]]) -> None:
        self.cells, self.holds, self.gates = drawn.cells, drawn.holds, gates
        self.final_holds = tuple(len(holds) - 1 for holds in drawn.holds)

    def stands(self, one: int, number: int) -> int:
        return self.cells[one][self.holds[one][number]]

    def can_move(self, state: State, one: int) -> bool:
        at = state[one]
        path = set(self.cells[one][self.holds[one][at] : self.holds[one][at + 1] + 1])
        stood = {self.stands(other, number) for other, number in enumerate(state) if other != one}
        waits = all(state[gate.tractor] > gate.leg for gate in self.gates.get((one, at), ()))
        return waits and not path & stood

    def after(self, state: State, one: int) -> State:
        return (*state[:one], state[one] + 1, *state[one + 1 :])

    def leads_home(self, state: State, way: list[int]) -> bool:
        """Whether all are home after these tractors have moved, one segment each, and each could."""
        for one in way:
            if not self.can_move(state, one):
                return False
            state = self.after(state, one)
        return state == self.final_holds

    def gets_home(self, state: State) -> bool:
        """Whether all get home in any way, by looking at all states."""
        seen, stack = {state}, [state]
        while stack:
            at = stack.pop()
            if at == self.final_holds:
                return True
            for one, home in enumerate(self.final_holds):
                if at[one] < home and self.can_move(at, one) and (then := self.after(at, one)) not in seen:
                    seen.add(then)
                    stack.append(then)
        return False


@st.composite
def traffic(draw: Any) -> Cells:
    """Two to four tractors on a grid of four by four, each with some hold points on its way."""
    cells, holds = [], []
    starts = draw(st.permutations(range(16)))
    for one in range(draw(st.integers(2, 4))):
        path = [starts[one]]
        for _ in range(draw(st.integers(2, 6))):
            path.append(draw(st.sampled_from([cell for cell in range(16) if cell != path[-1]])))
        inner = draw(st.sets(st.integers(1, len(path) - 2))) if len(path) > 2 else set()
        cells.append(path)
        holds.append([0, *sorted(inner), len(path) - 1])
    return Cells(cells, holds)


def all_hold_points(trajectories: list[SoloTrajectory]) -> ConflictZones:
    return crossings(trajectories, {n: set(range(each.segment_count)) for n, each in enumerate(trajectories)})
