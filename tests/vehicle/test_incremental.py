"""A changed plan continues from where it differs, with the same result as in a new world."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.vehicle.bits import assert_same_bits, change_leg
from vehicle.missions.plan import LegGate, Mission, Plan
from vehicle.model.gnss import load_default_error_table
from vehicle.model.tractor import Implement, Tractor
from vehicle.sim.incremental import SNAPSHOT_INTERVAL_S, IncrementalSimulator, count_same_paths, has_same_leg_references
from vehicle.sim.world import World

LONG_M = 400.0
FOREVER_S = 4000.0


def crossing(build: Any) -> Plan:
    """One tractor drives north in two legs; another crosses its path after 300 m."""
    north = [build.leg((0, 0), (0, 200)), build.leg((0, 200), (0, LONG_M))]
    east = [build.leg((-300, 300), (-100, 300)), build.leg((-100, 300), (-40, 300)), build.leg((-40, 300), (60, 300))]
    return build.plan(north, east)  # type: ignore[no-any-return]


def slower(plan: Plan, tractor: int, leg: int) -> Plan:
    return change_leg(plan, tractor, leg, speed_mps=0.6 * plan.missions[tractor].legs[leg].speed_mps)


@pytest.mark.parametrize("gnss", [False, True])
def test_every_plan_is_driven_as_in_a_new_world(build: Any, eg105: Tractor, implement: Implement, gnss: bool) -> None:
    position_errors = load_default_error_table() if gnss else None
    simulator = IncrementalSimulator(eg105, implement, stop_clearance_m=0.5, position_errors=position_errors, seed=3)
    plan = crossing(build)
    gated = plan.copy_with_gate(1, 2, LegGate(0, 1, 130.0))
    plans = [plan, gated, slower(gated, 0, 1), slower(plan, 1, 1), plan.copy_with_gate(1, 0, LegGate(0, 0, 5.0)), plan]
    began, outcomes = [], []
    for one in plans:
        run = simulator.simulate(one, FOREVER_S)
        world = World(one, eg105, implement, position_errors=position_errors, seed=3)
        alone = world.run(stop_clearance_m=0.5, max_time_s=FOREVER_S)
        assert_same_bits(run, alone)
        began.append(simulator.resumed_at_s)
        outcomes.append(run.outcome)
    assert outcomes[:2] == ["conflict", "done"]
    # 5 km/h are 83 m a minute: the hold is after 260 m, the slower legs after 200 m; then the first leg is another, and
    # the last plan has that of the last one that was done.
    assert began == [
        0.0, 3 * SNAPSHOT_INTERVAL_S, 2 * SNAPSHOT_INTERVAL_S, 2 * SNAPSHOT_INTERVAL_S, 0.0, 2 * SNAPSHOT_INTERVAL_S,
    ]  # fmt: skip


@pytest.mark.parametrize(("metres", "began_s"), [(60.0, 240.0), (72.0, 240.0), (85.0, 180.0), (140.0, 180.0)])
@pytest.mark.parametrize("taken", [False, True])
def test_gates_that_open_before_they_come_in_sight_change_nothing(
    build: Any, eg105: Tractor, implement: Implement, metres: float, began_s: float, taken: bool
) -> None:
    """At 5 km/h the leg with the gate comes in sight after some 200 s, between two snapshots."""
    beside = [build.leg((50, 0), (50, 200)), build.leg((50, 200), (50, 290)), build.leg((50, 290), (50, LONG_M))]
    plan = build.plan([build.leg((0, 0), (0, 200)), build.leg((0, 200), (0, LONG_M))], beside)
    plans = [plan, plan.copy_with_gate(1, 2, LegGate(0, 1, metres))]
    simulator = IncrementalSimulator(eg105, implement, stop_clearance_m=0.5)
    for one in plans[::-1] if taken else plans:
        run = simulator.simulate(one, FOREVER_S)
        assert run.outcome == "done"
        assert_same_bits(run, World(one, eg105, implement).run(stop_clearance_m=0.5, max_time_s=FOREVER_S))
    assert simulator.resumed_at_s == began_s


def test_snapshots_of_other_fleets_or_later_times_are_not_used(
    build: Any, eg105: Tractor, implement: Implement
) -> None:
    simulator = IncrementalSimulator(eg105, implement, stop_clearance_m=-1.0)
    plan = crossing(build)
    simulator.simulate(plan, FOREVER_S)
    short = simulator.simulate(plan, 100.0)
    assert (simulator.resumed_at_s, short.outcome) == (SNAPSHOT_INTERVAL_S, "timeout") and 99.8 < short.time_s[
        -1
    ] < 100.0
    north, beside = [build.leg((0, 1), (0, 200))], [build.leg((9, 0), (9, 200))]
    for other in (build.plan(north, beside), build.plan([plan.missions[0].legs[0]])):
        run = simulator.simulate(other, FOREVER_S)
        assert simulator.resumed_at_s == 0.0
        assert_same_bits(run, World(other, eg105, implement).run(max_time_s=FOREVER_S))


def in_parts(plan: Plan, tractor: int, leg: int) -> Plan:
    """The plan with one of its legs in two, the second of which is driven more slowly."""
    missions = list(plan.missions)
    legs = missions[tractor].legs
    whole = legs[leg]
    middle = whole.points.mean(axis=0)
    first = replace(whole, points=np.array([whole.points[0], middle]))
    second = replace(whole, points=np.array([middle, whole.points[1]]), speed_mps=0.8 * whole.speed_mps, gates=())
    missions[tractor] = Mission((*legs[:leg], first, second, *legs[leg + 1 :]))
    return Plan(tuple(missions))


@pytest.mark.parametrize(("tractor", "hold", "gate"), [(0, 2, LegGate(0, 2, 30.0)), (1, 3, LegGate(0, 1, 130.0))])
def test_the_number_of_later_legs_may_differ(
    build: Any, eg105: Tractor, implement: Implement, tractor: int, hold: int, gate: LegGate
) -> None:
    simulator = IncrementalSimulator(eg105, implement, stop_clearance_m=0.5)
    plan = crossing(build).copy_with_gate(1, 2, LegGate(0, 1, 130.0))
    for one in (plan, in_parts(crossing(build), tractor, 1).copy_with_gate(1, hold, gate), plan):
        run = simulator.simulate(one, FOREVER_S)
        assert_same_bits(run, World(one, eg105, implement).run(stop_clearance_m=0.5, max_time_s=FOREVER_S))
    assert simulator.resumed_at_s == 2 * SNAPSHOT_INTERVAL_S


def test_a_repair_continues_from_the_last_completed_run(build: Any, eg105: Tractor, implement: Implement) -> None:
    simulator = IncrementalSimulator(eg105, implement, stop_clearance_m=0.5)
    plan = crossing(build)
    done = plan.copy_with_gate(1, 2, LegGate(0, 1, 130.0))
    assert simulator.simulate(done, FOREVER_S).outcome == "done"
    simulator.simulate(plan.copy_with_gate(1, 0, LegGate(0, 0, 5.0)), FOREVER_S)
    assert simulator.resumed_at_s == 0.0
    again = slower(done, 0, 1)
    run = simulator.simulate(again, FOREVER_S)
    assert simulator.resumed_at_s == 2 * SNAPSHOT_INTERVAL_S
    assert_same_bits(run, World(again, eg105, implement).run(stop_clearance_m=0.5, max_time_s=FOREVER_S))


def count_same_legs(before: Plan, after: Plan) -> list[int]:
    """Number of legs at the start of each mission that are driven the same in both plans."""
    same, pairs = count_same_paths(before, after), zip(before.missions, after.missions, strict=True)
    return [
        next((n for n in range(count) if not has_same_leg_references(a.legs[n], b.legs[n], same)), count)
        for count, (a, b) in zip(same, pairs, strict=True)
    ]


def test_links_to_later_legs_hold_in_both_plans(build: Any) -> None:
    plan = crossing(build)
    late, later = LegGate(0, 1, 50.0), LegGate(0, 1, 60.0)
    one, other = plan.copy_with_gate(1, 1, late), plan.copy_with_gate(1, 1, later)
    assert count_same_legs(one, one) == [2, 3] and count_same_legs(one, other) == [2, 1]
    # The leg that is waited for is another: neither gate opens before it is come to.
    assert count_same_legs(one, slower(other, 0, 1)) == [1, 3]
    assert count_same_legs(plan, slower(other, 0, 1)) == [1, 1]


def test_a_world_in_contact_or_at_its_end_gives_no_snapshot(build: Any, eg105: Tractor, implement: Implement) -> None:
    head_on = build.plan([build.leg((0, 0), (0, 40))], [build.leg((0, 40), (0, 0))])
    world = World(head_on, eg105, implement)
    assert world.run(max_time_s=10.0).contacts == ()
    assert world.take_snapshot() is not None
    assert world.run(max_time_s=20.0).contacts
    assert world.take_snapshot() is None
    done = World(build.plan([build.leg((0, 0), (0, 5))]), eg105, implement)
    assert done.run().outcome == "done" and done.take_snapshot() is None


def test_a_run_in_two_parts_is_one_run(build: Any, eg105: Tractor, implement: Implement) -> None:
    plan = crossing(build)
    world = World(plan, eg105, implement)
    world.run(max_time_s=33.3)
    assert_same_bits(world.run(), World(plan, eg105, implement).run())


def test_a_world_that_goes_back_leaves_the_run_it_returned(build: Any, eg105: Tractor, implement: Implement) -> None:
    world = World(crossing(build), eg105, implement)
    world.run(max_time_s=20.0)
    back = world.take_snapshot()
    run = world.run(max_time_s=40.0)
    kept, later = run.record.copy(), world.take_snapshot()
    assert back is not None and later is not None
    world.restore(back)
    again = world.run(max_time_s=40.0)
    assert np.array_equal(again.record, kept)
    again.record[:] = -1.0
    assert np.array_equal(run.record, kept) and np.array_equal(later.list_record_parts()[0], kept)


def test_the_rows_of_a_run_are_stored_once(build: Any, eg105: Tractor, implement: Implement) -> None:
    """A run over 200 ha has some 290 MB of them."""
    simulator = IncrementalSimulator(eg105, implement, stop_clearance_m=0.5)
    run = simulator.simulate(crossing(build), FOREVER_S)
    assert simulator._last_plan is not None and simulator._last_plan.snapshots
    assert all(np.shares_memory(chunk, run.record) for one in simulator._last_plan.snapshots for chunk in one.chunks)
