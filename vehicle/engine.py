"""The door between compiled code and pymunk: C addresses, batch buffers, and a probe that they mean what we think.

`pymunk.batch` may change in any release, so the minor version is pinned and `Engine` checks, before the first
step, that reading and writing bodies in batch gives what the ordinary API gives.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pymunk
import pymunk.batch
from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from pymunk._chipmunk_cffi import ffi, lib

from vehicle.errors import VehicleError
from vehicle.layout import BODY_WIDTH

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


def _call_each(typingctx: Any, function: Any, space: Any, callback: Any, data: Any) -> Any:
    """Call `void function(void *space, void *callback, void *data)`, all given as integer addresses."""
    signature = types.void(types.int64, types.int64, types.int64, types.int64)

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        pointer = ir.IntType(8).as_pointer()
        kind = ir.FunctionType(ir.VoidType(), [pointer, pointer, pointer])
        target = builder.inttoptr(args[0], kind.as_pointer())
        builder.call(target, [builder.inttoptr(a, pointer) for a in args[1:]])
        return context.get_dummy_value()

    return signature, generate


def _call_step(typingctx: Any, function: Any, space: Any, dt: Any) -> Any:
    """Call `void function(void *space, double dt)` by integer address."""
    signature = types.void(types.int64, types.int64, types.float64)

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        pointer = ir.IntType(8).as_pointer()
        kind = ir.FunctionType(ir.VoidType(), [pointer, ir.DoubleType()])
        target = builder.inttoptr(args[0], kind.as_pointer())
        builder.call(target, [builder.inttoptr(args[1], pointer), args[2]])
        return context.get_dummy_value()

    return signature, generate


call_each: Any = intrinsic(_call_each)
call_step: Any = intrinsic(_call_step)


class Engine:
    """Batch access to the bodies of one space, for compiled code.

    `addresses` (10,) int64 in the order of the constants above; `read` (6 n + slack,) holds x, y, angle, vx, vy,
    spin per body after a read; `write` (3 n + slack,) takes fx, fy, torque per body before a write; `touching`
    holds pairs of body ids. The three `*_count` arrays are the C headers: element 0 is the number in use and must
    be set to zero before every call.
    """

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
        self._probe()

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

    def _probe(self) -> None:
        """Compare one batch read and one batch write with the ordinary API.

        Bodies at rest would read alike in any order, so they get telling velocities for the moment.
        """
        motion = [(body.velocity, body.angular_velocity) for body in self.bodies]
        for place, body in enumerate(self.bodies, start=1):
            body.velocity, body.angular_velocity = (place + 0.25, place + 0.5), place + 0.75
        fault = self._read_fault() or self._write_fault()
        for body, (velocity, spin) in zip(self.bodies, motion, strict=True):
            body.velocity, body.angular_velocity = velocity, spin
        if fault:
            raise EngineUnavailable(f"pymunk {pymunk.version}: {fault}; the fast path needs 7.3.")

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
        for body in self.bodies:
            body.force, body.torque = (0.0, 0.0), 0.0
        self.write[:count] = 0.0
        return "the batch write has another order" if wrong else ""


def _batch(buffer: pymunk.batch.Buffer, fields: int) -> Any:
    data = ffi.new("pmBatchedData *")
    data.fields, data.floatArray, data.intArray = fields, buffer._float_arr, buffer._int_arr
    return data


def _header(array: Any) -> npt.NDArray[np.int32]:
    """The C struct's `num` and `max` as a writable view."""
    return np.frombuffer(ffi.buffer(array, 8), dtype=np.int32)
