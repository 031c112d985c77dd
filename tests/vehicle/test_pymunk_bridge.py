"""The compiled loop against plain pymunk, and pymunk with another batch layout."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pymunk
import pymunk.batch
import pytest

import vehicle.sim.pymunk_bridge
from tests.vehicle.bits import assert_same_bits
from vehicle.missions.plan import FollowOrder, LegGate, Plan
from vehicle.missions.run import SimulationRun
from vehicle.model.tractor import Implement, Tractor
from vehicle.sim.pymunk_bridge import READ_WIDTH, WRITE_WIDTH, EngineUnavailableError, PymunkEngine, create_body, lib
from vehicle.sim.world import World, simulate

FIELDS = pymunk.batch.BodyFields


def gated(build: Any) -> Plan:
    """Three tractors side by side, each held behind its neighbour by a gate at every leg."""
    missions = [build.two_passes(3.0 * i) for i in range(3)]
    plan = build.plan(*missions)
    for tractor in (1, 2):
        plan = plan.copy_with_gate(tractor, 0, LegGate(tractor - 1, 0, 12.0))
        plan = plan.copy_with_gate(tractor, 1, LegGate(tractor - 1, 1, 8.0))
        plan = plan.copy_with_gate(tractor, 2, LegGate(tractor - 1, 2, 9.5))
    return plan


def formation(build: Any) -> Plan:
    """A slower leader and two followers that start too close."""
    lead = [build.leg((0, 0), (0, 90), speed_mps=0.9, kind="track", implement=True)]
    second = [build.leg((3, -7), (3, 80), follow=FollowOrder(0, 0), kind="track", implement=True)]
    third = [build.leg((-3, -9), (-3, 80), follow=FollowOrder(0, 0, 12.0), kind="track", implement=True)]
    return build.plan(lead, second, third)


def reversing(build: Any) -> Plan:
    return build.plan(build.switch_back())


def head_on(build: Any) -> Plan:
    return build.plan([build.leg((0, 0), (0, 40))], [build.leg((0.4, 30), (0.4, 0))], [build.leg((9, 0), (9, 20))])


PLANS = (gated, formation, reversing, head_on)


def assert_same(fast: SimulationRun, slow: SimulationRun) -> None:
    assert fast.outcome == slow.outcome
    assert fast.record.shape == slow.record.shape
    assert np.abs(fast.record - slow.record).max() < 1e-9
    assert np.array_equal(fast.finish_s, slow.finish_s, equal_nan=True)
    assert fast.contacts == slow.contacts
    assert fast.min_clearance_m == pytest.approx(slow.min_clearance_m, abs=1e-9)
    assert fast.conflict == slow.conflict
    assert (fast.stall is None) == (slow.stall is None)
    margins = [[(one.margin_rad, one.x_m, one.y_m, one.leg) for one in run.roll_over] for run in (fast, slow)]
    assert np.allclose(*margins, rtol=0.0, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("make", PLANS)
def test_the_compiled_loop_drives_as_plain_pymunk_does(
    build: Any, eg105: Tractor, implement: Implement, make: Any
) -> None:
    plan = make(build)
    options = {"max_time_s": 90.0, "stop_clearance_m": -1.0}
    assert_same(simulate(plan, eg105, implement, **options), simulate(plan, eg105, implement, slow=True, **options))


def test_both_loops_stop_at_the_same_conflict(build: Any, eg105: Tractor, implement: Implement) -> None:
    plan = head_on(build)
    fast = simulate(plan, eg105, implement, stop_clearance_m=1.0)
    assert fast.outcome == "conflict"
    assert_same(fast, simulate(plan, eg105, implement, stop_clearance_m=1.0, slow=True))


def test_the_same_run_twice_is_the_same_bit_for_bit(build: Any, eg105: Tractor, implement: Implement) -> None:
    for make in (gated, head_on):
        first, again = (simulate(make(build), eg105, implement, max_time_s=90.0) for _ in range(2))
        assert_same_bits(first, again)


def test_a_tractor_drives_alone_as_it_does_among_others(build: Any, eg105: Tractor, implement: Implement) -> None:
    alone = simulate(build.plan(build.two_passes()), eg105, implement)
    both = simulate(build.plan(build.two_passes(), build.two_passes(50.0)), eg105, implement)
    rows = len(alone.record)
    assert (alone.record[:, 0] == both.record[:rows, 0]).all()


@pytest.fixture
def bodies(eg105: Tractor, implement: Implement) -> tuple[pymunk.Space, list[pymunk.Body]]:
    """Three bodies in motion, all numbers different."""
    space = pymunk.Space()
    made = [create_body(space, eg105, (20.0 * i, 1.5 - i, 0.3 * i + 0.1)) for i in range(3)]
    for i, body in enumerate(made):
        body.velocity = (0.5 + i, -0.25 * (i + 1))
        body.angular_velocity = 0.01 * (i + 1)
    return space, made


def test_the_engine_reads_and_writes_what_the_ordinary_interface_does(
    bodies: tuple[pymunk.Space, list[pymunk.Body]],
) -> None:
    space, made = bodies
    engine = PymunkEngine(space, made)
    engine.bridge.read[:] = engine.bridge.read_count[0] = 0
    getter = vehicle.sim.pymunk_bridge.ffi.addressof(lib, "pmSpaceBodyGetIteratorFuncBatched")
    lib.cpSpaceEachBody(space._space, getter, engine._data[0])
    rows = engine.bridge.read[: READ_WIDTH * len(made)].reshape(-1, READ_WIDTH)
    for row, body in zip(rows, made, strict=True):
        assert tuple(row) == (*body.position, body.angle, *body.velocity, body.angular_velocity)
        assert tuple(body.force) == (0.0, 0.0) and body.torque == 0.0
    engine.bridge.write[: WRITE_WIDTH * len(made)] = np.arange(9.0) + 1.0
    engine.bridge.write_count[0] = 0
    setter = vehicle.sim.pymunk_bridge.ffi.addressof(lib, "pmSpaceBodySetIteratorFuncBatched")
    lib.cpSpaceEachBody(space._space, setter, engine._data[1])
    assert [tuple(body.force) for body in made] == [(1.0, 2.0), (4.0, 5.0), (7.0, 8.0)]
    assert [body.torque for body in made] == [3.0, 6.0, 9.0]


@pytest.mark.parametrize(("name", "flags", "fault"), [
    ("READ", FIELDS.POSITION | FIELDS.ANGLE | FIELDS.VELOCITY, "batch read has another width"),
    ("READ", FIELDS.POSITION | FIELDS.FORCE | FIELDS.VELOCITY, "batch read has another order"),
    ("READ", FIELDS.POSITION | FIELDS.ANGLE | FIELDS.FORCE | FIELDS.TORQUE, "batch read has another order"),
    ("WRITE", FIELDS.TORQUE | FIELDS.VELOCITY, "batch write has another order"),
])  # fmt: skip
def test_another_layout_is_refused(
    bodies: tuple[pymunk.Space, list[pymunk.Body]], monkeypatch: pytest.MonkeyPatch, name: str, flags: Any, fault: str
) -> None:
    monkeypatch.setattr(vehicle.sim.pymunk_bridge, name, flags)
    with pytest.raises(EngineUnavailableError, match=f"{fault}; the fast path needs 7.3"):
        PymunkEngine(*bodies)


def test_a_layout_that_shows_only_in_motion_is_refused_at_rest_too(
    eg105: Tractor, implement: Implement, monkeypatch: pytest.MonkeyPatch
) -> None:
    space = pymunk.Space()
    body = create_body(space, eg105, (1.0, 2.0, 0.0))
    monkeypatch.setattr(
        vehicle.sim.pymunk_bridge, "READ", FIELDS.POSITION | FIELDS.ANGLE | FIELDS.FORCE | FIELDS.TORQUE
    )
    with pytest.raises(EngineUnavailableError, match="batch read has another order"):
        PymunkEngine(space, [body])
    assert tuple(body.velocity) == (0.0, 0.0) and body.angular_velocity == 0.0


def test_a_missing_function_is_refused(
    bodies: tuple[pymunk.Space, list[pymunk.Body]], monkeypatch: pytest.MonkeyPatch
) -> None:
    bridge = vehicle.sim.pymunk_bridge

    def find_address(library: Any, name: str) -> Any:
        return bridge.lib is library and getattr(library, name)

    ffi = SimpleNamespace(addressof=find_address, new=bridge.ffi.new, buffer=bridge.ffi.buffer)
    monkeypatch.setattr(bridge, "lib", SimpleNamespace(cpSpaceStep=lib.cpSpaceStep))
    monkeypatch.setattr(bridge, "ffi", ffi)
    with pytest.raises(EngineUnavailableError, match="lacks a function of the fast path"):
        PymunkEngine(*bodies)


def test_without_the_engine_the_world_warns_and_uses_the_slow_loop(
    build: Any, eg105: Tractor, implement: Implement, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = build.plan([build.leg((0, 0), (0, 6))])
    expected = simulate(plan, eg105, implement)
    monkeypatch.setattr(vehicle.sim.pymunk_bridge, "READ", FIELDS.POSITION)
    with pytest.warns(UserWarning, match="another width.*plain Python"):
        found = World(plan, eg105, implement).run()
    assert found.outcome == "done"
    assert_same(found, expected)


def test_progress_rises_to_one(build: Any, eg105: Tractor, implement: Implement) -> None:
    seen: list[float] = []
    run = simulate(build.plan([build.leg((0, 0), (0, 900))]), eg105, implement, progress=seen.append)
    assert run.duration_s > 600.0
    assert len(seen) == 2 and 0.9 < seen[0] < seen[1] <= 1.0
    assert seen[0] == pytest.approx(600.0 * 5 / 3.6 / 900.0, rel=0.01)
    assert seen[1] == pytest.approx(1.0, abs=0.1 / 900 + 1e-3)
    assert run.time_s[-1] == pytest.approx(run.duration_s)


def test_decaying_speeds_become_zero_before_they_are_denormal(build: Any, eg105: Any, implement: Any) -> None:
    """On a straight line spin and sideways speed halve at every step: after 1.5 minutes they were denormal numbers."""
    world = World(build.plan([build.leg((0, 0), (0, 300))]), eg105, implement)
    world.run(max_time_s=120.0)
    (body,) = world.bodies
    speeds = np.abs([*body.velocity, body.angular_velocity])
    assert speeds.max() > 1.0 and ((speeds == 0.0) | (speeds > np.finfo(float).tiny)).all()
