"""Offsets of the numbers of a pymunk body in memory: found by a probe, never assumed.

Distinct values are written to a C body through the functions of the library and searched for in its memory. An offset
counts only if it is unique, is the same for other values, and the library reads back what is written there. Otherwise
there are no offsets, and bodies are read and written in batch.
"""

from __future__ import annotations

import struct
from functools import cache
from typing import Any

import numpy as np
from pymunk._chipmunk_cffi import ffi, lib

from fields.arrays import Integers

# Rows of the array of offsets.
AT_X, AT_Y, AT_ANGLE, AT_VX, AT_VY, AT_SPIN, AT_COSINE, AT_SINE, AT_FORCE_X, AT_FORCE_Y, AT_TORQUE = range(11)
PROBE_BYTES = 1 << 14  # far more than a body takes
NUMBER_BYTES = 8
NO_OFFSETS: Integers = np.zeros(0, dtype=np.int64)
Values = tuple[float, ...]
NUMBERS: dict[str, Values] = {
    "Position": (11.25, 23.5), "Angle": (0.8125,), "Velocity": (5.75, 9.125), "AngularVelocity": (0.6875,),
    "Rotation": (), "Force": (101.5, 203.25), "Torque": (307.5,),
}  # fmt: skip
"""Groups of neighbouring numbers in the order of the rows, and what is written to find them; rotation follows."""


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
    for name, values in NUMBERS.items():
        scaled = tuple(scale * value for value in values)
        if scaled:
            getattr(lib, f"cpBodySet{name}")(body, scaled if len(scaled) > 1 else scaled[0])
        found = _read(body, name)
        place = _find_only_place(memory, found)
        if place < 0 or not _is_written_value_used(memory, place, body, name):
            return ()
        offsets += range(place, place + NUMBER_BYTES * len(found), NUMBER_BYTES)
    return tuple(offsets)


def _read(body: Any, name: str) -> Values:
    """The neighbouring numbers of this name, one or two, as the library reads them."""
    found = getattr(lib, f"cpBodyGet{name}")(body)
    return (found,) if isinstance(found, float) else (found.x, found.y)


def _find_only_place(memory: Any, values: Values) -> int:
    """Offset of neighbouring numbers that occur once in a memory; -1 if they do not, or one of them is 0."""
    words = bytes(memory)
    sought = struct.pack(f"{len(values)}d", *values)
    places = [at for at in range(0, PROBE_BYTES - len(sought), NUMBER_BYTES) if words[at : at + len(sought)] == sought]
    return places[0] if len(places) == 1 and 0.0 not in values else -1


def _is_written_value_used(memory: Any, place: int, body: Any, name: str) -> bool:
    """Whether the library reads numbers that are written at an offset; they are restored."""
    before = _read(body, name)
    for values in (tuple(17.0 + value for value in before), before):
        struct.pack_into(f"{len(values)}d", memory, place, *values)
        if _read(body, name) != values:
            return False
    return True
