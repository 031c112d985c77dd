"""Compiled access to the bodies of a space by a PymunkBridge: read motions, apply forces, step, count contacts."""

from __future__ import annotations

import math
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from vehicle.jit import compile_function, drop_owner
from vehicle.sim.body_memory import (
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
)  # fmt: skip
from vehicle.sim.pymunk_bridge import (
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
    TOUCH_WIDTH,
    WRITE_DATA,
    WRITE_WIDTH,
    PymunkBridge,
)  # fmt: skip


def _call_body_iterator(typingctx: Any, function: Any, space: Any, callback: Any, data: Any) -> Any:
    """Call `void function(void *space, void *callback, void *data)`, all given as integer addresses."""
    signature = types.void(types.int64, types.int64, types.int64, types.int64)

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        pointer = ir.IntType(8).as_pointer()
        kind = ir.FunctionType(ir.VoidType(), [pointer, pointer, pointer])
        target = builder.inttoptr(args[0], kind.as_pointer())
        builder.call(target, [builder.inttoptr(a, pointer) for a in args[1:]])
        return context.get_dummy_value()

    return signature, generate


def _call_space_step(typingctx: Any, function: Any, space: Any, dt: Any) -> Any:
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


_invoke_each: Any = intrinsic(_call_body_iterator)
_invoke_step: Any = intrinsic(_call_space_step)
_load_float: Any = intrinsic(_load)
_store_float: Any = intrinsic(_store)


@compile_function
def drop_bridge_owner(bridge):  # type: ignore[no-untyped-def]
    """The same bridge without owners of its arrays (vehicle.jit.drop_owner): the caller keeps them alive."""
    return PymunkBridge(
        drop_owner(bridge.addresses), drop_owner(bridge.places), drop_owner(bridge.offsets),
        drop_owner(bridge.read), drop_owner(bridge.write), drop_owner(bridge.touching),
        drop_owner(bridge.read_count), drop_owner(bridge.write_count), drop_owner(bridge.touch_count),
    )  # fmt: skip


@compile_function
def read_motions(bridge) -> None:  # type: ignore[no-untyped-def]
    """Read how the bodies move now, for get_motion; to be called once before every step."""
    if len(bridge.places) == 0:
        bridge.read_count[0], at = 0, bridge.addresses
        _invoke_each(at[EACH_BODY], at[SPACE], at[GET_BODY], at[READ_DATA])


@compile_function
def get_motion(bridge, i):  # type: ignore[no-untyped-def]
    """x, y, angle, vx, vy, spin of a body as pymunk has them, and cosine and sine of the angle."""
    if len(bridge.places) > 0:
        place, at = bridge.places[i], bridge.offsets
        return (
            _load_float(place + at[AT_X]), _load_float(place + at[AT_Y]), _load_float(place + at[AT_ANGLE]),
            _load_float(place + at[AT_VX]), _load_float(place + at[AT_VY]), _load_float(place + at[AT_SPIN]),
            _load_float(place + at[AT_COSINE]), _load_float(place + at[AT_SINE]),
        )  # fmt: skip
    k, read = READ_WIDTH * i, bridge.read
    cosine, sine = math.cos(read[k + 2]), math.sin(read[k + 2])
    return read[k], read[k + 1], read[k + 2], read[k + 3], read[k + 4], read[k + 5], cosine, sine


@compile_function
def apply_force(bridge, i, force) -> None:  # type: ignore[no-untyped-def]
    """Apply a force (N, east and north) and a torque (N m, counter-clockwise) to a body for the next step."""
    if len(bridge.places) > 0:
        place, at = bridge.places[i], bridge.offsets
        _store_float(place + at[AT_FORCE_X], force[0])
        _store_float(place + at[AT_FORCE_Y], force[1])
        _store_float(place + at[AT_TORQUE], force[2])
        return
    first, write = WRITE_WIDTH * i, bridge.write
    write[first], write[first + 1], write[first + 2] = force


@compile_function
def step_space(bridge, dt) -> None:  # type: ignore[no-untyped-def]
    """Advance the space by `dt` (s); to be called once forces are applied to every body."""
    if len(bridge.places) == 0:
        bridge.write_count[0], at = 0, bridge.addresses
        _invoke_each(at[EACH_BODY], at[SPACE], at[SET_BODY], at[WRITE_DATA])
    _invoke_step(bridge.addresses[STEP], bridge.addresses[SPACE], dt)


@compile_function
def count_contacts(bridge) -> int:  # type: ignore[no-untyped-def]
    """Number of pairs of boxes that touch, or did a few steps ago, or are let pass; they are in `bridge.touching`."""
    bridge.touch_count[0], at = 0, bridge.addresses
    _invoke_each(at[EACH_CONTACT], at[SPACE], at[GET_CONTACT], at[TOUCH_DATA])
    return bridge.touch_count[0] // TOUCH_WIDTH  # type: ignore[no-any-return]
