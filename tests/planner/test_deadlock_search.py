"""The compiled search for ways home, against looking at every state there is."""

import math
from itertools import combinations, product
from typing import Any

import numpy as np
from hypothesis import example, given, settings
from hypothesis import strategies as st

from fields.arrays import Integers
from planner.traffic.deadlock_search import (
    drop_moves,
    find_way_home,
    is_on_way_home,
    is_pair_safe,
    round_to_tenths,
)
from planner.traffic.precedence import DeadlockAvoidance
from tests.examples import count_examples
from tests.planner.grid import Cells, Plain, State, all_hold_points, plan_on, straight, traffic, trajectory
from vehicle.missions.plan import LegGate


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
def test_ways_home_are_found_exactly_where_there_are_any(
    asked: tuple[Cells, dict[tuple[int, int], list[LegGate]], State],
) -> None:
    drawn, gates, state = asked
    trajectories, plain = drawn.trajectories(), Plain(drawn, gates)
    net = DeadlockAvoidance(plan_on(trajectories, gates), all_hold_points(trajectories)).net
    at, reached, way = np.array(state), np.empty(len(state), dtype=np.int64), allocate_way(plain, state)
    paths = plain.gets_home(state)
    assert find_way_home(net, at, reached, way) == paths
    assert not paths or tuple(reached.tolist()) == plain.final_holds
    assert not paths or plain.leads_home(state, way.tolist())


@settings(max_examples=count_examples(150))
@given(gated(), st.lists(st.tuples(st.integers(0, 3), st.integers(1, 3)), max_size=6))
def test_a_way_home_stays_one_for_those_who_go_on_before_their_turn(
    asked: tuple[Cells, dict[tuple[int, int], list[LegGate]], State], drives: list[tuple[int, int]]
) -> None:
    drawn, gates, state = asked
    trajectories, plain = drawn.trajectories(), Plain(drawn, gates)
    net = DeadlockAvoidance(plan_on(trajectories, gates), all_hold_points(trajectories)).net
    walked, way = np.empty(len(state), dtype=np.int64), allocate_way(plain, state)
    if not find_way_home(net, np.array(state), walked, way):
        return
    for tractor, length in drives:
        one = tractor % len(state)
        after = (*state[:one], state[one] + length, *state[one + 1 :])
        if after[one] <= plain.final_holds[one] and is_on_way_home(net, np.array(after), one, length, way, walked):
            drop_moves(way, one, length)
            state, way = after, way[length:]
            assert plain.leads_home(state, way.tolist())


def test_who_goes_on_before_its_turn_must_leave_room_for_those_before() -> None:
    """The second may go to the far end of the corridor once the first is out, not before."""
    cells = [[0, 1, 2, 3], [4, 2, 5]]
    drawn = Cells(cells, [[0, 3], [0, 1, 2]])
    trajectories = drawn.trajectories()
    net = DeadlockAvoidance(plan_on(trajectories), all_hold_points(trajectories)).net
    walked = np.empty(2, dtype=np.int64)
    for way, stays in ([0, 1, 1], False), ([1, 1, 0], True):
        assert is_on_way_home(net, np.array([0, 1]), 1, 1, np.array(way), walked) is stays
        assert is_on_way_home(net, np.array([0, 2]), 1, 2, np.array(way), walked)


def allocate_way(plain: Plain, state: State) -> Integers:
    """Room for the moves of all from a state to their ends."""
    return np.empty(sum(plain.final_holds) - sum(state), dtype=np.int64)


@settings(max_examples=count_examples(150))
@given(gated())
def test_two_alone_get_home_exactly_where_looking_at_every_state_says_so(
    asked: tuple[Cells, dict[tuple[int, int], list[LegGate]], State],
) -> None:
    drawn, gates, _ = asked
    trajectories = drawn.trajectories()
    net = DeadlockAvoidance(plan_on(trajectories, gates), all_hold_points(trajectories)).net
    for one, other in combinations(range(len(trajectories)), 2):
        own = {
            key: [
                LegGate([one, other].index(gate.tractor), gate.leg, 1.0)
                for gate in some
                if gate.tractor in (one, other)
            ]
            for key, some in gates.items()
            if key[0] in (one, other)
        }
        both = Cells([drawn.cells[n] for n in (one, other)], [drawn.holds[n] for n in (one, other)])
        plain = Plain(both, {([one, other].index(who), number): some for (who, number), some in own.items()})
        for state in product(*(range(len(holds)) for holds in both.holds)):
            assert is_pair_safe(net, one, state[0], other, state[1]) == plain.gets_home(state)


def test_a_large_fleet_that_goes_round_in_a_ring_gets_home() -> None:
    """None gets home before all have gone on in turns, for as many rounds as there are segments."""
    tractors, gap = 24, 2
    ring = tractors * gap
    cells = [[(gap * one + step) % ring for step in range(ring + 1)] + [ring + one] for one in range(tractors)]
    courses = [[(30.0 * cell, 0.0, 0.0) for cell in own] for own in cells]
    trajectories = [trajectory(course, range(len(course)), 10.0) for course in courses]
    net = DeadlockAvoidance(plan_on(trajectories), all_hold_points(trajectories)).net
    start, way = np.zeros(tractors, dtype=np.int64), np.empty(tractors * (ring + 1), dtype=np.int64)
    assert find_way_home(net, start, np.empty_like(start), way)
    assert (np.bincount(way) == ring + 1).all()


def test_who_passes_where_all_others_will_stand_goes_first_however_long_that_takes() -> None:
    """Three go one after another through a cell and on over cells of their own; the fourth crosses all of these."""
    count, segments = 3, 250
    own = [[1000 * one + step for step in range(segments)] for one in range(count)]
    cells = [[-1 - one, -10, *path] for one, path in enumerate(own)]
    crosses = [-20, *(cell for step in range(segments) for cell in (*(path[step] for path in own), -100 - step))]
    holds = [[0, *range(2, segments + 2)]] * count + [list(range(0, len(crosses), count + 1))]
    trajectories = Cells([*cells, crosses], holds).trajectories()
    home = DeadlockAvoidance(plan_on(trajectories), all_hold_points(trajectories))
    assert home.drop_deadlocked_gates()
    assert home.way.tolist().index(0) >= segments


def test_of_two_in_two_deadlocks_only_the_gates_in_them_are_dropped() -> None:
    """They drive apart; the first gate of all holds nobody up."""
    trajectories = [straight(0, 40.0 * one, 0.0, 60, range(0, 61, 10)) for one in range(2)]
    gates = {
        (0, 1): [LegGate(1, 0, 5.0)],
        (0, 2): [LegGate(1, 2, 5.0)], (1, 2): [LegGate(0, 2, 5.0)],
        (0, 4): [LegGate(1, 4, 5.0)], (1, 4): [LegGate(0, 4, 5.0)],
    }  # fmt: skip
    home = DeadlockAvoidance(plan_on(trajectories, gates), all_hold_points(trajectories))
    assert home.drop_deadlocked_gates()
    assert sorted(leg for _, leg, _ in home.dropped_gates) == [2, 4]


@given(st.floats(-1e6, 1e6))
@example(12.35)
@example(0.25)
@example(-0.05)
@example(math.nextafter(0.45, 1.0))
def test_tenths_are_those_of_round(x: float) -> None:
    assert round_to_tenths(x) == round(10 * round(x, 1))
