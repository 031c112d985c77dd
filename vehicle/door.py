"""Compiled access to the bodies of a space through the door of vehicle.engine: read, push, step, contacts."""

from __future__ import annotations

import math
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from vehicle.engine import (
    EACH_BODY,
    EACH_CONTACT,
    GET_BODY,
    GET_CONTACT,
    READ_DATA,
    READ_WIDTH,
    SET_BODY,
    SPACE,
    STEP,
    TOUCH_DATA,
    WRITE_DATA,
    WRITE_WIDTH,
    Door,
)
from vehicle.jit import compiled, unowned
from vehicle.memory import (
    AT_ANGLE,
    AT_COSINE,
    AT_FORCE_X,
    AT_FORCE_Y,
    AT_SINE,
    AT_SPIN,
    AT_TORQUE,
    AT_VX,
    AT_VY,
    AT_X,
    AT_Y,
)


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


def _load(typingctx: Any, address: Any) -> Any:
    """The number at an integer address."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.load(builder.inttoptr(args[0], ir.DoubleType().as_pointer()))

    return types.float64(types.int64), generate


def _store(typingctx: Any, address: Any, value: Any) -> Any:
    """Put a number at an integer address."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        builder.store(args[1], builder.inttoptr(args[0], ir.DoubleType().as_pointer()))
        return context.get_dummy_value()

    return types.void(types.int64, types.float64), generate


_each: Any = intrinsic(_call_each)
_step: Any = intrinsic(_call_step)
_number: Any = intrinsic(_load)
_put: Any = intrinsic(_store)


@compiled
def unowned_door(door):  # type: ignore[no-untyped-def]
    """The same door without owners of its arrays, as in vehicle.jit: whoever called keeps them alive."""
    return Door(
        unowned(door.addresses), unowned(door.places), unowned(door.offsets), unowned(door.read),
        unowned(door.write), unowned(door.touching), unowned(door.read_count), unowned(door.write_count),
        unowned(door.touch_count),
    )  # fmt: skip


@compiled
def look(door) -> None:  # type: ignore[no-untyped-def]
    """Make `motion` tell how the bodies move now: called once before every step."""
    if len(door.places) == 0:
        door.read_count[0] = 0
        _each(door.addresses[EACH_BODY], door.addresses[SPACE], door.addresses[GET_BODY], door.addresses[READ_DATA])


@compiled
def motion(door, i):  # type: ignore[no-untyped-def]
    """x, y, angle, vx, vy, spin of a body as pymunk has them, and cosine and sine of the angle."""
    if len(door.places) > 0:
        place, at = door.places[i], door.offsets
        return (
            _number(place + at[AT_X]), _number(place + at[AT_Y]), _number(place + at[AT_ANGLE]),
            _number(place + at[AT_VX]), _number(place + at[AT_VY]), _number(place + at[AT_SPIN]),
            _number(place + at[AT_COSINE]), _number(place + at[AT_SINE]),
        )  # fmt: skip
    first, read = READ_WIDTH * i, door.read
    angle = read[first + 2]
    return (
        read[first], read[first + 1], angle, read[first + 3], read[first + 4], read[first + 5],
        math.cos(angle), math.sin(angle),
    )  # fmt: skip


@compiled
def push(door, i, force) -> None:  # type: ignore[no-untyped-def]
    """Let a force (N, east and north) and a torque (N m, counter-clockwise) act on a body in the step to come."""
    if len(door.places) > 0:
        place, at = door.places[i], door.offsets
        _put(place + at[AT_FORCE_X], force[0])
        _put(place + at[AT_FORCE_Y], force[1])
        _put(place + at[AT_TORQUE], force[2])
        return
    first, write = WRITE_WIDTH * i, door.write
    write[first], write[first + 1], write[first + 2] = force


@compiled
def step(door, dt) -> None:  # type: ignore[no-untyped-def]
    """Advance the space by `dt` (s), once every body was pushed."""
    if len(door.places) == 0:
        door.write_count[0] = 0
        _each(door.addresses[EACH_BODY], door.addresses[SPACE], door.addresses[SET_BODY], door.addresses[WRITE_DATA])
    _step(door.addresses[STEP], door.addresses[SPACE], dt)


@compiled
def touches(door) -> int:  # type: ignore[no-untyped-def]
    """Number of pairs of bodies in contact; their ids are in the door, one pair after another."""
    door.touch_count[0] = 0
    _each(
        door.addresses[EACH_CONTACT], door.addresses[SPACE], door.addresses[GET_CONTACT], door.addresses[TOUCH_DATA]
    )
    return door.touch_count[0] // 2  # type: ignore[no-any-return]
