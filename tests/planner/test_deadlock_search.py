"""The compiled search for ways home, against looking at every state there is."""

import math
from itertools import permutations
from typing import Any

import numpy as np
from hypothesis import example, given, settings
from hypothesis import strategies as st

from planner.traffic.deadlock_avoidance import DeadlockAvoidance
from planner.traffic.deadlock_search import can_finish_by_turns, can_finish_one_by_one, round_to_tenths
from tests.examples import count_examples
from tests.planner.grid import Cells, all_hold_points, plan_on, traffic
from vehicle.missions.plan import LegGate

State = tuple[int, ...]


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

    def in_turn(self, state: State) -> bool:
        """Whether each goes home in one go in some order, by trying all orders."""
        return any(self._works(state, order) for order in permutations(range(len(state))))

    def _works(self, state: State, order: tuple[int, ...]) -> bool:
        for one in order:
            while state[one] < self.final_holds[one]:
                if not self.can_move(state, one):
                    return False
                state = self.after(state, one)
        return True

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
def gated(draw: Any) -> tuple[Cells, dict[tuple[int, int], list[LegGate]], State]:
    """Traffic with some gates, and a state: cells in which no two stand."""
    drawn = draw(traffic())
    gates: dict[tuple[int, int], list[LegGate]] = {}
    for _ in range(draw(st.integers(0, 3))):
        one, other = draw(st.permutations(range(len(drawn.cells))))[:2]
        number, leg = (draw(st.integers(0, len(drawn.holds[who]) - 2)) for who in (one, other))
        gates.setdefault((one, number), []).append(LegGate(other, leg, 1.0))
    state = tuple(draw(st.integers(0, len(holds) - 1)) for holds in drawn.holds)
    stood = [own[holds[number]] for own, holds, number in zip(drawn.cells, drawn.holds, state, strict=True)]
    return drawn, gates, state if len(set(stood)) == len(stood) else (0,) * len(state)


@settings(max_examples=count_examples(150))
@given(gated())
def test_one_after_another_is_found_exactly_where_there_is_an_order_and_no_way_home_is_made_up(
    asked: tuple[Cells, dict[tuple[int, int], list[LegGate]], State],
) -> None:
    drawn, gates, state = asked
    trajectories, plain = drawn.trajectories(), Plain(drawn, gates)
    net = DeadlockAvoidance(plan_on(trajectories, gates), all_hold_points(trajectories)).net
    at = np.array(state, dtype=np.int64)
    assert can_finish_one_by_one(net, at) == plain.in_turn(state)
    paths = plain.gets_home(state)
    for deep in (False, True):
        reached = np.empty(len(state), dtype=np.int64)
        if can_finish_by_turns(net, at, deep, reached):
            assert paths and tuple(reached.tolist()) == plain.final_holds


@settings(max_examples=count_examples(60))
@given(gated())
def test_a_deep_look_finds_every_way_home_that_a_first_look_finds(
    asked: tuple[Cells, dict[tuple[int, int], list[LegGate]], State],
) -> None:
    drawn, gates, state = asked
    trajectories = drawn.trajectories()
    net = DeadlockAvoidance(plan_on(trajectories, gates), all_hold_points(trajectories)).net
    at, reached = np.array(state, dtype=np.int64), np.empty(len(state), dtype=np.int64)
    if can_finish_by_turns(net, at, False, reached):
        assert can_finish_by_turns(net, at, True, reached)


@given(st.floats(-1e6, 1e6))
@example(12.35)
@example(0.25)
@example(-0.05)
@example(math.nextafter(0.45, 1.0))
def test_tenths_are_those_of_round(x: float) -> None:
    assert round_to_tenths(x) == round(10 * round(x, 1))
