"""The door between compiled code and pymunk: C addresses, batch buffers, and a probe that they mean what we think.

`pymunk.batch` may change in any release, so the minor version is pinned and `Engine` checks, before the first
step, that reading and writing bodies in batch gives what the ordinary API gives. Where the numbers of a body are
found in memory (vehicle.memory) they are read and written there, which spares two calls for every body and step.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pymunk
import pymunk.batch
from pymunk._chipmunk_cffi import ffi, lib

from vehicle.errors import VehicleError
from vehicle.layout import BODY_WIDTH
from vehicle.memory import NOWHERE, body_offsets

READ = (
    pymunk.batch.BodyFields.POSITION
    | pymunk.batch.BodyFields.ANGLE
    | pymunk.batch.BodyFields.VELOCITY
    | pymunk.batch.BodyFields.ANGULAR_VELOCITY
)
WRITE = pymunk.batch.BodyFields.FORCE | pymunk.batch.BodyFields.TORQUE
TOUCH = pymunk.batch.ArbiterFields.BODY_A_ID | pymunk.batch.ArbiterFields.BODY_B_ID
READ_WIDTH, WRITE_WIDTH, SLACK = BODY_WIDTH, 3, 16

# Places in the array of addresses handed to compiled code.
STEP, EACH_BODY, EACH_CONTACT, GET_BODY, SET_BODY, GET_CONTACT, SPACE, READ_DATA, WRITE_DATA, TOUCH_DATA = range(10)


class EngineUnavailable(VehicleError):  # noqa: N818 - a state, raised and mended
    """pymunk's batch layout is not the one this version knows; the slow path still works."""


class Door(NamedTuple):
    """What compiled code needs to reach the bodies of a space (vehicle.door).

    `addresses` (10,) in the order of the constants above. Bodies whose numbers lie at `offsets` (11,) of vehicle.memory
    from `places` (n,) are read and written there; without places in batch: `read` (6 n + slack,) holds x, y, angle, vx,
    vy, spin per body after a read, `write` (3 n + slack,) takes fx, fy, torque per body before a write. `touching`
    holds pairs of body ids. The three `*_count` are the C headers: element 0 is the number in use and must be set to
    zero before every call.
    """

    addresses: npt.NDArray[np.int64]
    places: npt.NDArray[np.int64]
    offsets: npt.NDArray[np.int64]
    read: npt.NDArray[np.float64]
    write: npt.NDArray[np.float64]
    touching: npt.NDArray[np.uint64]
    read_count: npt.NDArray[np.int32]
    write_count: npt.NDArray[np.int32]
    touch_count: npt.NDArray[np.int32]


class Engine:
    """Access to the bodies of one space, for compiled code by its `door`."""

    def __init__(self, space: pymunk.Space, bodies: list[pymunk.Body]) -> None:
        self.space, self.bodies = space, bodies
        count = len(bodies)
        self.read = np.zeros(READ_WIDTH * count + SLACK)
        self.write = np.zeros(WRITE_WIDTH * count + SLACK)
        self.touching = np.zeros(8 * count * count + 64, dtype=np.uint64)
        self._buffers = [pymunk.batch.Buffer() for _ in range(3)]
        self._buffers[0].set_float_buf(self.read)
        self._buffers[1].set_float_buf(self.write)
        self._buffers[2].set_int_buf(self.touching)
        self.read_count = _header(self._buffers[0]._float_arr)
        self.write_count = _header(self._buffers[1]._float_arr)
        self.touch_count = _header(self._buffers[2]._int_arr)
        self.addresses = self._addresses()
        self.ids = np.array([body.id for body in bodies], dtype=np.uint64)
        offsets = self._probe()
        self.door = Door(
            self.addresses, self._places() if len(offsets) else NOWHERE, offsets, self.read, self.write,
            self.touching, self.read_count, self.write_count, self.touch_count,
        )  # fmt: skip

    def _places(self) -> npt.NDArray[np.int64]:
        """Addresses of the bodies (n,), which hold as long as the bodies live."""
        return np.array([int(ffi.cast("uintptr_t", body._body)) for body in self.bodies], dtype=np.int64)

    def _addresses(self) -> npt.NDArray[np.int64]:
        self._data = [
            _batch(buffer, fields.value)
            for buffer, fields in zip(self._buffers, (READ, WRITE, TOUCH), strict=True)
        ]
        functions = (
            "cpSpaceStep",
            "cpSpaceEachBody",
            "cpSpaceEachCachedArbiter",
            "pmSpaceBodyGetIteratorFuncBatched",
            "pmSpaceBodySetIteratorFuncBatched",
            "pmSpaceArbiterIteratorFuncBatched",
        )
        try:
            pointers = [ffi.addressof(lib, name) for name in functions]
        except AttributeError as error:
            raise EngineUnavailable(f"pymunk {pymunk.version} lacks a function of the fast path: {error}.") from None
        pointers += [self.space._space, *self._data]
        return np.array([int(ffi.cast("uintptr_t", pointer)) for pointer in pointers], dtype=np.int64)

    def _probe(self) -> npt.NDArray[np.int64]:
        """Compare one batch read and one batch write with the ordinary API, and the memory of the bodies with both.

        Bodies at rest would read alike in any order, so they get telling velocities for the moment. Returns the offsets
        of the numbers in memory; none where they are not where they should be, or where bodies may fall asleep: setting
        a force wakes them, writing it does not.
        """
        motion = [(body.velocity, body.angular_velocity) for body in self.bodies]
        for place, body in enumerate(self.bodies, start=1):
            body.velocity, body.angular_velocity = (place + 0.25, place + 0.5), place + 0.75
        fault = self._read_fault() or self._write_fault()
        found = [body_offsets(body) for body in self.bodies]
        for body, (velocity, spin) in zip(self.bodies, motion, strict=True):
            body.velocity, body.angular_velocity = velocity, spin
            body.force, body.torque = (0.0, 0.0), 0.0
        if fault:
            raise EngineUnavailable(f"pymunk {pymunk.version}: {fault}; the fast path needs 7.3.")
        awake = self.space.sleep_time_threshold == math.inf
        return found[0] if awake and all(len(offsets) for offsets in found) else NOWHERE

    def _read_fault(self) -> str:
        self.read_count[0] = 0
        lib.cpSpaceEachBody(
            self.space._space, ffi.addressof(lib, "pmSpaceBodyGetIteratorFuncBatched"), self._data[0]
        )
        if self.read_count[0] != READ_WIDTH * len(self.bodies):
            return "the batch read has another width"
        rows = self.read[: READ_WIDTH * len(self.bodies)].reshape(-1, READ_WIDTH)
        for row, body in zip(rows, self.bodies, strict=True):
            expected = (*body.position, body.angle, *body.velocity, body.angular_velocity)
            if tuple(row) != expected:
                return "the batch read has another order"
        return ""

    def _write_fault(self) -> str:
        count = WRITE_WIDTH * len(self.bodies)
        self.write[:count] = np.arange(1, count + 1)
        self.write_count[0] = 0
        lib.cpSpaceEachBody(
            self.space._space, ffi.addressof(lib, "pmSpaceBodySetIteratorFuncBatched"), self._data[1]
        )
        written = [value for body in self.bodies for value in (*body.force, body.torque)]
        wrong = written != self.write[:count].tolist()
        self.write[:count] = 0.0
        return "the batch write has another order" if wrong else ""


def _batch(buffer: pymunk.batch.Buffer, fields: int) -> Any:
    data = ffi.new("pmBatchedData *")
    data.fields, data.floatArray, data.intArray = fields, buffer._float_arr, buffer._int_arr
    return data


def _header(array: Any) -> npt.NDArray[np.int32]:
    """The C struct's `num` and `max` as a writable view."""
    return np.frombuffer(ffi.buffer(array, 8), dtype=np.int32)
