"""Offsets of the numbers of a pymunk body in memory: found by a probe, never assumed.

Distinct values are written to a C body through the functions of the library and searched for in its memory. An offset
counts only if it is unique, is the same for other values, and the library reads back what is written there. Otherwise
there are no offsets, and bodies are read and written in batch.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from pymunk._chipmunk_cffi import ffi, lib

from vehicle.arrays import Integers

# Rows of the array of offsets.
AT_X, AT_Y, AT_ANGLE, AT_VX, AT_VY, AT_SPIN, AT_COSINE, AT_SINE, AT_FORCE_X, AT_FORCE_Y, AT_TORQUE = range(11)
PROBE_BYTES = 1 << 14  # far more than a body takes
NUMBER_BYTES = 8
NO_OFFSETS: Integers = np.zeros(0, dtype=np.int64)
Values = tuple[float, ...]


@cache
def find_offsets() -> tuple[int, ...]:
    """Offset (bytes) of each number from the start of a body, in the order above; empty if the probe fails."""
    try:
        first, second = _probe_offsets(1.0), _probe_offsets(-2.0)
    except (AttributeError, TypeError, ffi.error):  # a library function has another name or other arguments
        return ()
    return first if first == second else ()


def find_body_offsets(body: Any) -> Integers:
    """The offsets (11,) if this body of a space, which may be moving, has its numbers there; else empty."""
    offsets = find_offsets()
    if not offsets:
        return NO_OFFSETS
    memory = ffi.buffer(ffi.cast("char *", body._body), max(offsets) + NUMBER_BYTES)
    stored = tuple(struct.unpack_from("d", memory, offset)[0] for offset in offsets)
    motion = (*body.position, body.angle, *body.velocity, body.angular_velocity)
    expected = (*motion, *body.rotation_vector, *body.force, body.torque)
    return np.array(offsets, dtype=np.int64) if stored == expected else NO_OFFSETS


def _probe_offsets(scale: float) -> tuple[int, ...]:
    """Offsets found with distinct values of one scale; empty if one is not found exactly once."""
    block = ffi.new("char[]", PROBE_BYTES)
    body = ffi.cast("cpBody *", block)
    lib.cpBodyInit(body, 3.0, 7.0)
    # Without an offset, position and centre of gravity would be the same numbers.
    lib.cpBodySetCenterOfGravity(body, (0.375, 0.625))
    memory = ffi.buffer(block, PROBE_BYTES)
    offsets: list[int] = []
    for write, read, values in _list_accessors(body, scale):
        write(*values)
        place = _find_only_place(memory, read())
        if place < 0 or not _is_written_value_used(memory, place, read):
            return ()
        offsets += range(place, place + NUMBER_BYTES * len(values), NUMBER_BYTES)
    return tuple(offsets)


def _list_accessors(body: Any, scale: float) -> tuple[tuple[Callable[..., Any], Callable[[], Values], Values], ...]:
    """Writer, reader and values of each group of neighbouring numbers, in the order of the offsets."""

    def make_vector_reader(name: str) -> Callable[[], Values]:
        return lambda: (lambda found: (found.x, found.y))(getattr(lib, f"cpBodyGet{name}")(body))

    def make_number_reader(name: str) -> Callable[[], Values]:
        return lambda: (getattr(lib, f"cpBodyGet{name}")(body),)

    def make_setter(name: str, many: bool = True) -> Callable[..., Any]:
        setter = getattr(lib, f"cpBodySet{name}")
        return (lambda *values: setter(body, values)) if many else (lambda value: setter(body, value))

    return (
        (make_setter("Position"), make_vector_reader("Position"), (11.25 * scale, 23.5 * scale)),
        (make_setter("Angle", False), make_number_reader("Angle"), (0.8125 * scale,)),
        (make_setter("Velocity"), make_vector_reader("Velocity"), (5.75 * scale, 9.125 * scale)),
        (make_setter("AngularVelocity", False), make_number_reader("AngularVelocity"), (0.6875 * scale,)),
        (lambda *_: None, make_vector_reader("Rotation"), (0.0, 0.0)),
        (make_setter("Force"), make_vector_reader("Force"), (101.5 * scale, 203.25 * scale)),
        (make_setter("Torque", False), make_number_reader("Torque"), (307.5 * scale,)),
    )


def _find_only_place(memory: Any, values: Values) -> int:
    """Offset of neighbouring numbers that occur once in a memory; -1 if they do not, or one of them is 0."""
    words = bytes(memory)
    sought = struct.pack(f"{len(values)}d", *values)
    places = [at for at in range(0, PROBE_BYTES - len(sought), NUMBER_BYTES) if words[at : at + len(sought)] == sought]
    return places[0] if len(places) == 1 and 0.0 not in values else -1


def _is_written_value_used(memory: Any, place: int, read: Callable[[], Values]) -> bool:
    """Whether the library reads numbers that are written at an offset; they are restored."""
    before = read()
    for values in (tuple(17.0 + value for value in before), before):
        struct.pack_into(f"{len(values)}d", memory, place, *values)
        if read() != values:
            return False
    return True
