"""Tractors as pymunk bodies with contact boxes, and the bridge by which compiled code reaches them.

`pymunk.batch` may change in any release, so the minor version is pinned and PymunkEngine checks, before the first step,
that reading and writing bodies in batch gives the same as the ordinary API. Where the numbers of a body are found in
memory (vehicle.sim.body_memory) they are read and written there, which saves two calls for every body and step.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import pymunk
import pymunk.batch
from pymunk._chipmunk_cffi import ffi, lib

from fields.arrays import Flags, Floats, Integers
from vehicle.errors import VehicleError
from vehicle.model.tractor import Implement, Tractor
from vehicle.records import BODY_WIDTH
from vehicle.sim.body_memory import NO_OFFSETS, find_body_offsets
from vehicle.sim.compile import list_contact_boxes

MIN_SOLVER_ITERATIONS = 1  # each iteration costs time in every step, even without contacts
FRICTION = 0.5  # any value would do: plans in which tractors touch are reported as collisions
READ = (
    pymunk.batch.BodyFields.POSITION
    | pymunk.batch.BodyFields.ANGLE
    | pymunk.batch.BodyFields.VELOCITY
    | pymunk.batch.BodyFields.ANGULAR_VELOCITY
)
WRITE = pymunk.batch.BodyFields.FORCE | pymunk.batch.BodyFields.TORQUE
TOUCH = (
    pymunk.batch.ArbiterFields.BODY_A_ID
    | pymunk.batch.ArbiterFields.BODY_B_ID
    | pymunk.batch.ArbiterFields.CONTACT_COUNT
)
READ_WIDTH, WRITE_WIDTH, TOUCH_WIDTH, SLACK = BODY_WIDTH, 3, 3, 16
# Positions in the array of addresses for compiled code.
STEP, EACH_BODY, EACH_CONTACT, GET_BODY, SET_BODY, GET_CONTACT, SPACE, READ_DATA, WRITE_DATA, TOUCH_DATA = range(10)


def create_space() -> pymunk.Space:
    """A space without contact boxes, in which nothing can touch."""
    space = pymunk.Space()
    space.iterations = MIN_SOLVER_ITERATIONS
    space.on_collision(None, None, begin=drop_false_contact)
    return space


def drop_false_contact(arbiter: pymunk.Arbiter, space: pymunk.Space, data: object) -> None:
    """Let boxes pass that have a gap between them: Chipmunk takes some that lie side by side, exactly parallel, for
    touching, metres apart."""
    first, second = (_get_corners(shape) for shape in arbiter.shapes)
    sides = [np.roll(corners, -1, axis=0) - corners for corners in (first, second)]
    axes = np.concatenate(sides)[:, ::-1] * (1.0, -1.0)
    one, other = axes @ first.T, axes @ second.T
    gaps = np.maximum(other.min(axis=1) - one.max(axis=1), one.min(axis=1) - other.max(axis=1))
    arbiter.process_collision = bool((gaps <= 0.0).all())


def _get_corners(shape: pymunk.Shape) -> Floats:
    """Corners (n, 2) of a box where it is."""
    assert isinstance(shape, pymunk.Poly) and shape.body is not None
    return np.array([shape.body.local_to_world(corner) for corner in shape.get_vertices()])


def create_body(space: pymunk.Space, tractor: Tractor, pose: tuple[float, float, float]) -> pymunk.Body:
    """A tractor body at its centre of mass, without contact boxes."""
    body = pymunk.Body(tractor.mass_kg, tractor.inertia_kg_m2)
    body.position, body.angle = pose[:2], pose[2]
    space.add(body)
    return body


class ContactBoxes:
    """The boxes of tractor and implement of every body, which are in the space only while tractors are near each other.

    `present` (n,) says whose boxes are in the space, `required` (n,) whose should be; the compiled loop writes
    `required` and update_space follows it.
    """

    def __init__(self, space: pymunk.Space, bodies: list[pymunk.Body], tractor: Tractor, implement: Implement) -> None:
        boxes = list_contact_boxes(tractor, implement)
        self._space = space
        self._iterations = pymunk.Space().iterations
        self._shapes = [[_build_shape(body, *box) for box in boxes] for body in bodies]
        self.present: Flags = np.zeros(len(bodies), dtype=np.bool_)
        self.required: Flags = np.zeros(len(bodies), dtype=np.bool_)

    def update_space(self) -> None:
        """Add the required boxes to the space and remove the others."""
        for index in np.flatnonzero(self.present != self.required):
            change = self._space.add if self.required[index] else self._space.remove
            change(*self._shapes[index])
        self.present[:] = self.required
        self._space.iterations = self._iterations if self.present.any() else MIN_SOLVER_ITERATIONS


def _build_shape(body: pymunk.Body, rear: float, front: float, half: float) -> pymunk.Poly:
    shape = pymunk.Poly(body, [(rear, -half), (front, -half), (front, half), (rear, half)])
    shape.friction = FRICTION
    return shape


class EngineUnavailableError(VehicleError):
    """pymunk's batch layout is unknown to this version; the slow path still works."""


class PymunkBridge(NamedTuple):
    """What compiled code needs to reach the bodies of a space (vehicle.sim.compiled_access).

    `addresses` (10,) in the order of the constants above. If the probe of vehicle.sim.body_memory succeeded, bodies are
    read and written in memory at `offsets` (11,) from the addresses `places` (n,). Otherwise both are empty and bodies
    are handled in batch: `read` (6 n + slack,) holds x, y, angle, vx, vy, spin per body after a read, `write` (3 n +
    slack,) takes fx, fy, torque per body before a write. `touching` (TOUCH_WIDTH per pair of boxes) holds both body ids
    and how many points of contact they have. The three `*_count` are the C headers: element 0 is the number in use and
    must be set to zero before every call.
    """

    addresses: Integers
    places: Integers
    offsets: Integers
    read: Floats
    write: Floats
    touching: npt.NDArray[np.uint64]
    read_count: npt.NDArray[np.int32]
    write_count: npt.NDArray[np.int32]
    touch_count: npt.NDArray[np.int32]


class PymunkEngine:
    """Access to the bodies of one space; compiled code uses its `bridge`."""

    def __init__(self, space: pymunk.Space, bodies: list[pymunk.Body]) -> None:
        self.space, self.bodies = space, bodies
        count = len(bodies)
        read, write = np.zeros(READ_WIDTH * count + SLACK), np.zeros(WRITE_WIDTH * count + SLACK)
        touching = np.zeros(4 * TOUCH_WIDTH * count * count + 64, dtype=np.uint64)
        self._buffers = [pymunk.batch.Buffer() for _ in range(3)]
        self._buffers[0].set_float_buf(read)
        self._buffers[1].set_float_buf(write)
        self._buffers[2].set_int_buf(touching)
        headers = self._buffers[0]._float_arr, self._buffers[1]._float_arr, self._buffers[2]._int_arr
        counts = [np.frombuffer(ffi.buffer(header, 8), dtype=np.int32) for header in headers]  # C's `num` and `max`
        addresses = self._resolve_addresses()
        self.bridge = PymunkBridge(addresses, NO_OFFSETS, NO_OFFSETS, read, write, touching, *counts)
        offsets = self._check_memory_layout()
        if len(offsets):  # addresses of the bodies (n,), valid as long as the bodies live
            places = np.array([int(ffi.cast("uintptr_t", body._body)) for body in bodies], dtype=np.int64)
            self.bridge = self.bridge._replace(places=places, offsets=offsets)

    def _resolve_addresses(self) -> Integers:
        self._data = [ffi.new("pmBatchedData *") for _ in self._buffers]
        for data, buffer, fields in zip(self._data, self._buffers, (READ, WRITE, TOUCH), strict=True):
            data.fields, data.floatArray, data.intArray = fields.value, buffer._float_arr, buffer._int_arr
        functions = (
            "cpSpaceStep", "cpSpaceEachBody", "cpSpaceEachCachedArbiter", "pmSpaceBodyGetIteratorFuncBatched",
            "pmSpaceBodySetIteratorFuncBatched", "pmSpaceArbiterIteratorFuncBatched",
        )  # fmt: skip
        try:
            pointers = [ffi.addressof(lib, name) for name in functions]
        except AttributeError as error:
            message = f"pymunk {pymunk.version} lacks a function of the fast path: {error}."
            raise EngineUnavailableError(message) from None
        pointers += [self.space._space, *self._data]
        return np.array([int(ffi.cast("uintptr_t", pointer)) for pointer in pointers], dtype=np.int64)

    def _check_memory_layout(self) -> Integers:
        """Compare one batch read and one batch write with the ordinary API, and the memory of the bodies with both.

        Bodies at rest would read the same in any order, so they get distinct velocities for the test. Returns the
        offsets of the numbers in memory; none if the test fails, or if bodies may fall asleep: setting a force through
        the API wakes them, writing it to memory does not.
        """
        motion = [(body.velocity, body.angular_velocity) for body in self.bodies]
        for place, body in enumerate(self.bodies, start=1):
            body.velocity, body.angular_velocity = (place + 0.25, place + 0.5), place + 0.75
        fault = self._find_read_fault() or self._find_write_fault()
        body_layouts = [find_body_offsets(body) for body in self.bodies]
        for body, (velocity, spin) in zip(self.bodies, motion, strict=True):
            body.velocity, body.angular_velocity = velocity, spin
            body.force, body.torque = (0.0, 0.0), 0.0
        if fault:
            raise EngineUnavailableError(f"pymunk {pymunk.version}: {fault}; the fast path needs 7.3.")
        awake = self.space.sleep_time_threshold == math.inf
        return body_layouts[0] if awake and all(len(offsets) for offsets in body_layouts) else NO_OFFSETS

    def _find_read_fault(self) -> str:
        bridge, count = self.bridge, READ_WIDTH * len(self.bodies)
        bridge.read_count[0] = 0
        lib.cpSpaceEachBody(self.space._space, ffi.addressof(lib, "pmSpaceBodyGetIteratorFuncBatched"), self._data[0])
        if bridge.read_count[0] != count:
            return "the batch read has another width"
        rows = bridge.read[:count].reshape(-1, READ_WIDTH)
        for row, body in zip(rows, self.bodies, strict=True):
            expected = (*body.position, body.angle, *body.velocity, body.angular_velocity)
            if tuple(row) != expected:
                return "the batch read has another order"
        return ""

    def _find_write_fault(self) -> str:
        bridge, count = self.bridge, WRITE_WIDTH * len(self.bodies)
        bridge.write[:count] = np.arange(1, count + 1)
        bridge.write_count[0] = 0
        lib.cpSpaceEachBody(self.space._space, ffi.addressof(lib, "pmSpaceBodySetIteratorFuncBatched"), self._data[1])
        written = [value for body in self.bodies for value in (*body.force, body.torque)]
        wrong = written != bridge.write[:count].tolist()
        bridge.write[:count] = 0.0
        return "the batch write has another order" if wrong else ""
