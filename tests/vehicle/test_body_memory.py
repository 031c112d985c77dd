"""Bodies read and written in memory: the probe, and the same drives as by batch calls, bit for bit."""

import struct
from collections.abc import Iterator
from typing import Any

import numpy as np
import pymunk
import pytest

import vehicle.sim.body_memory
import vehicle.sim.pymunk_bridge
from tests.vehicle.bits import assert_same_bits
from tests.vehicle.test_pymunk_bridge import PLANS
from vehicle.model.tractor import Implement, Tractor
from vehicle.sim.body_memory import AT_FORCE_X, AT_SINE, NO_OFFSETS, NUMBER_BYTES, ffi, find_body_offsets, find_offsets
from vehicle.sim.pymunk_bridge import MIN_SOLVER_ITERATIONS, PymunkEngine, create_body
from vehicle.sim.world import World, simulate


@pytest.fixture
def space_and_body(eg105: Tractor) -> tuple[pymunk.Space, pymunk.Body]:
    space = pymunk.Space()
    body = create_body(space, eg105, (3.5, -2.25, 0.75))
    body.velocity, body.angular_velocity, body.force, body.torque = (1.5, 2.5), 0.125, (4.0, 5.0), 6.0
    return space, body


@pytest.fixture
def fresh() -> Iterator[None]:
    """Clear the cache of offsets before and after a test."""
    find_offsets.cache_clear()
    yield
    find_offsets.cache_clear()


def test_numbers_are_found_where_the_ordinary_interface_has_them(space_and_body: Any) -> None:
    _, body = space_and_body
    offsets = find_body_offsets(body)
    assert len(offsets) == 11
    memory = ffi.buffer(ffi.cast("char *", body._body), int(offsets.max()) + NUMBER_BYTES)
    values = [struct.unpack_from("d", memory, at)[0] for at in offsets.tolist()]
    assert values == [3.5, -2.25, 0.75, 1.5, 2.5, 0.125, *body.rotation_vector, 4.0, 5.0, 6.0]
    struct.pack_into("dd", memory, int(offsets[AT_FORCE_X]), 7.5, 8.5)
    assert tuple(body.force) == (7.5, 8.5)


def test_a_number_found_twice_counts_as_not_found(fresh: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without an offset the centre of gravity is a second place with the same numbers."""
    real = vehicle.sim.body_memory.lib

    class Library:
        def __getattr__(self, name: str) -> Any:
            return getattr(real, name) if name != "cpBodySetCenterOfGravity" else lambda body, place: None

    monkeypatch.setattr(vehicle.sim.body_memory, "lib", Library())
    assert find_offsets() == ()


def test_a_library_without_the_functions_has_no_places(fresh: None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(vehicle.sim.body_memory, "lib", object())
    assert find_offsets() == ()


def test_offsets_that_are_wrong_for_a_body_are_not_used(space_and_body: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    space, body = space_and_body
    wrong = list(find_offsets())
    wrong[AT_SINE] += NUMBER_BYTES
    assert len(PymunkEngine(space, [body]).bridge.places) == 1
    monkeypatch.setattr(vehicle.sim.body_memory, "find_offsets", lambda: tuple(wrong))
    assert len(find_body_offsets(body)) == 0
    assert len(PymunkEngine(space, [body]).bridge.places) == 0


def test_bodies_that_may_fall_asleep_are_pushed_by_the_library(space_and_body: Any) -> None:
    space, body = space_and_body
    space.sleep_time_threshold = 1.0
    assert len(PymunkEngine(space, [body]).bridge.places) == 0


def test_the_probe_leaves_bodies_as_they_were(space_and_body: Any) -> None:
    space, body = space_and_body
    PymunkEngine(space, [body])
    assert (*body.position, body.angle, *body.velocity, body.angular_velocity) == (3.5, -2.25, 0.75, 1.5, 2.5, 0.125)


@pytest.mark.parametrize("make", PLANS)
def test_drives_by_memory_and_by_batch_are_the_same_bit_for_bit(
    build: Any, eg105: Tractor, implement: Implement, make: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    by_memory = simulate(make(build), eg105, implement, max_time_s=90.0)
    monkeypatch.setattr(vehicle.sim.pymunk_bridge, "find_body_offsets", lambda body: NO_OFFSETS)
    assert_same_bits(by_memory, simulate(make(build), eg105, implement, max_time_s=90.0))


def test_the_solver_has_its_usual_iterations_while_boxes_are_in_the_space(
    build: Any, eg105: Tractor, implement: Implement
) -> None:
    world = World(build.plan(build.two_passes(), build.two_passes(50.0)), eg105, implement)
    assert world.space.iterations == MIN_SOLVER_ITERATIONS
    world.boxes.required[:] = True
    world.boxes.update_space()
    assert world.space.iterations == pymunk.Space().iterations
    world.boxes.required[:] = np.array([True, False])
    world.boxes.update_space()
    assert world.space.iterations == pymunk.Space().iterations
    world.boxes.required[:] = False
    world.boxes.update_space()
    assert world.space.iterations == MIN_SOLVER_ITERATIONS


def test_the_solver_has_no_part_in_drives_without_contact(
    build: Any, eg105: Tractor, implement: Implement, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = build.plan(build.two_passes(), build.two_passes(50.0))
    few = simulate(plan, eg105, implement)
    monkeypatch.setattr("vehicle.sim.pymunk_bridge.MIN_SOLVER_ITERATIONS", 10)
    assert_same_bits(few, simulate(plan, eg105, implement))
