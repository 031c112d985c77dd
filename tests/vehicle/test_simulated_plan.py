"""Runs of single tractors and of their fleet give each other, bit for bit."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.vehicle.bits import assert_same_bits, change_leg
from vehicle.missions.plan import LEAVE, LegGate, LegTask, Mission, Plan
from vehicle.missions.run import TIMEOUT, SimulationRun
from vehicle.model.gnss import load_default_error_table
from vehicle.model.tractor import Implement, Tractor
from vehicle.sim.incremental import SNAPSHOT_INTERVAL_S, IncrementalSimulator
from vehicle.sim.world import World

FOREVER_S = 4000.0
CLEARANCE_M = 0.5


def abreast(build: Any, apart_m: float = 50.0, meet: bool = True) -> Plan:
    """Three tractors drive north in legs of 100 m; the second turns to the first one's way at the end."""
    missions = []
    for number in range(3):
        x, end = apart_m * number, 400 + 30 * number
        missions.append([build.leg((x, y), (x, min(y + 100, end))) for y in range(0, end, 100)])
    if meet:
        x, y = missions[1][-1].points[-1]
        missions[1].append(build.leg((x, y), (-20.0, 386.0)))
    return build.plan(*missions)  # type: ignore[no-any-return]


def in_world(plan: Plan, tractor: Tractor, implement: Implement) -> SimulationRun:
    return World(plan, tractor, implement).run(stop_clearance_m=CLEARANCE_M, max_time_s=FOREVER_S)


@pytest.fixture
def simulator(eg105: Tractor, implement: Implement) -> IncrementalSimulator:
    return IncrementalSimulator(eg105, implement, stop_clearance_m=CLEARANCE_M)


def driven_apart(simulator: IncrementalSimulator, plan: Plan, numbers: list[int]) -> list[SimulationRun]:
    return simulator.simulate_alone(plan, numbers, [FOREVER_S] * len(numbers))


@pytest.mark.parametrize("fleet_first", [False, True])
def test_each_is_driven_as_in_its_own_world(
    build: Any, simulator: IncrementalSimulator, eg105: Tractor, implement: Implement, fleet_first: bool
) -> None:
    plan = abreast(build)
    if fleet_first:
        assert simulator.simulate(plan, FOREVER_S).outcome == "conflict"
    runs = driven_apart(simulator, plan, [2]) + driven_apart(simulator, plan, [0, 1])
    for run, number in zip(runs, (2, 0, 1), strict=True):
        assert_same_bits(run, in_world(Plan((plan.missions[number],)), eg105, implement))


@pytest.mark.parametrize("gated", [False, True])
@pytest.mark.parametrize("meet", [False, True])
def test_a_fleet_continues_from_the_solo_runs_of_its_tractors(
    build: Any, simulator: IncrementalSimulator, eg105: Tractor, implement: Implement, meet: bool, gated: bool
) -> None:
    plan = abreast(build, meet=meet)
    driven_apart(simulator, plan, [1])
    driven_apart(simulator, plan, [0, 2])
    if gated:  # the gate is closed when the third comes to it
        plan = plan.copy_with_gate(2, 3, LegGate(0, 3, 30.0))
    run = simulator.simulate(plan, FOREVER_S)
    assert run.outcome == ("conflict" if meet else "done")
    # The first is done after 290 s; 5 km/h are 83 m a minute, and the next moment must be as when driven apart.
    assert simulator.resumed_at_s == (2 if gated else 3) * SNAPSHOT_INTERVAL_S
    assert_same_bits(run, in_world(plan, eg105, implement))


def test_a_single_tractor_continues_from_its_own_solo_run(
    build: Any, simulator: IncrementalSimulator, eg105: Tractor, implement: Implement
) -> None:
    plan = Plan(abreast(build, meet=False).missions[:1])
    driven_apart(simulator, plan, [0])
    run = simulator.simulate(plan, FOREVER_S)
    assert (run.outcome, simulator.resumed_at_s) == ("done", 3 * SNAPSHOT_INTERVAL_S)
    assert_same_bits(run, in_world(plan, eg105, implement))


@pytest.mark.parametrize(("apart_m", "began_s"), [(3.25, 0.0), (4.5, 3 * SNAPSHOT_INTERVAL_S)])
def test_tractors_that_may_touch_are_driven_together(
    build: Any, simulator: IncrementalSimulator, eg105: Tractor, implement: Implement, apart_m: float, began_s: float
) -> None:
    """Neighbours with a frame of 2.7 m, 0.55 and 1.8 m from each other; 0.62 m is what may be driven between looks."""
    plan = abreast(build, apart_m, meet=False)
    driven_apart(simulator, plan, [0, 1, 2])
    run = simulator.simulate(plan, FOREVER_S)
    assert simulator.resumed_at_s == began_s
    assert_same_bits(run, in_world(plan, eg105, implement))


def test_a_tractor_that_has_left_the_field_blocks_nobody(
    build: Any, simulator: IncrementalSimulator, eg105: Tractor, implement: Implement
) -> None:
    legs = list(abreast(build, meet=False).missions[0].legs)
    out = (*legs[:2], replace(legs[2], task=LegTask(LEAVE)))
    behind = tuple(build.leg((-500.0 + x, 300.0), (-400.0 + x, 300.0)) for x in range(0, 900, 100))
    plan = Plan((Mission(out), Mission(behind)))
    driven_apart(simulator, plan, [0, 1])
    run = simulator.simulate(plan, FOREVER_S)
    assert (run.outcome, simulator.resumed_at_s) == ("done", 2 * SNAPSHOT_INTERVAL_S)
    assert_same_bits(run, in_world(plan, eg105, implement))


def test_runs_that_need_their_own_world_get_it(
    build: Any, simulator: IncrementalSimulator, eg105: Tractor, implement: Implement
) -> None:
    plan = change_leg(abreast(build, meet=False), 0, 2, stand_s=300.0)
    known, late = simulator.simulate_alone(plan, [0, 1], [FOREVER_S, 200.0])
    assert_same_bits(known, in_world(Plan((plan.missions[0],)), eg105, implement))
    assert late.outcome == TIMEOUT and late.time_s[-1] == pytest.approx(200.0, abs=0.1)
    table = load_default_error_table()
    errors = IncrementalSimulator(eg105, implement, stop_clearance_m=CLEARANCE_M, position_errors=table)
    for run, mission in zip(driven_apart(errors, plan, [0, 1, 2]), plan.missions, strict=True):
        own = World(Plan((mission,)), eg105, implement, position_errors=table, seed=1)
        assert_same_bits(run, own.run(max_time_s=FOREVER_S))


def test_independent_tractors_drive_through_each_other(build: Any, eg105: Tractor, implement: Implement) -> None:
    head_on = build.plan([build.leg((0, 0), (0, 40))], [build.leg((0, 40), (0, 0))])
    for slow in (False, True):
        run = World(head_on, eg105, implement).run(independent=True, slow=slow)
        assert (run.outcome, run.contacts, run.min_clearance_m) == ("done", (), np.inf)
