"""Where in the memory of a pymunk body its numbers lie: found by a probe, never assumed.

A body of C is laid out in memory of our own, telling values are written through the functions of the library, and
looked for. A place counts only if it is the only one, is the same for other values, and what is written there is what
the functions of the library read. Otherwise there are no places, and bodies are read and written in batch.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt
from pymunk._chipmunk_cffi import ffi, lib

# Places of a body's numbers, in the order of the array of offsets.
(
    AT_X, AT_Y, AT_ANGLE, AT_VX, AT_VY, AT_SPIN, AT_COSINE, AT_SINE, AT_FORCE_X, AT_FORCE_Y, AT_TORQUE,
) = range(11)  # fmt: skip
ROOM, WORD = 1 << 14, 8  # bytes: far more than a body takes; of a number
NOWHERE: npt.NDArray[np.int64] = np.zeros(0, dtype=np.int64)
Values = tuple[float, ...]


@cache
def found_offsets() -> tuple[int, ...]:
    """Distance (bytes) of each number from the start of a body, in the order above; empty where the probe fails."""
    try:
        first, second = _offsets(1.0), _offsets(-2.0)
    except (AttributeError, TypeError, ffi.error):  # a function of the library has another name, or takes other things
        return ()
    return first if first == second else ()


def body_offsets(body: Any) -> npt.NDArray[np.int64]:
    """The offsets (11,) if this body of a space, which may be in motion, has its numbers there; empty if not."""
    offsets = found_offsets()
    if not offsets:
        return NOWHERE
    memory = ffi.buffer(ffi.cast("char *", body._body), max(offsets) + WORD)
    seen = tuple(struct.unpack_from("d", memory, offset)[0] for offset in offsets)
    told = (
        *body.position, body.angle, *body.velocity, body.angular_velocity, *body.rotation_vector, *body.force,
        body.torque,
    )  # fmt: skip
    return np.array(offsets, dtype=np.int64) if seen == told else NOWHERE


def _offsets(scale: float) -> tuple[int, ...]:
    """Offsets by telling values of one scale; empty where one is not found exactly once."""
    block = ffi.new("char[]", ROOM)
    body = ffi.cast("cpBody *", block)
    lib.cpBodyInit(body, 3.0, 7.0)
    # Without a lever, place and centre of gravity would be the same numbers.
    lib.cpBodySetCenterOfGravity(body, (0.375, 0.625))
    memory = ffi.buffer(block, ROOM)
    offsets: list[int] = []
    for write, read, values in _numbers(body, scale):
        write(*values)
        place = _only_place(memory, read())
        if place < 0 or not _obeyed(memory, place, read):
            return ()
        offsets += range(place, place + WORD * len(values), WORD)
    return tuple(offsets)


def _numbers(body: Any, scale: float) -> tuple[tuple[Callable[..., Any], Callable[[], Values], Values], ...]:
    """How each group of neighbouring numbers is written and read, and what is written; in the order of the places."""

    def vector(name: str) -> Callable[[], Values]:
        return lambda: (lambda found: (found.x, found.y))(getattr(lib, f"cpBodyGet{name}")(body))

    def number(name: str) -> Callable[[], Values]:
        return lambda: (getattr(lib, f"cpBodyGet{name}")(body),)

    def setting(name: str, many: bool = True) -> Callable[..., Any]:
        setter = getattr(lib, f"cpBodySet{name}")
        return (lambda *values: setter(body, values)) if many else (lambda value: setter(body, value))

    return (
        (setting("Position"), vector("Position"), (11.25 * scale, 23.5 * scale)),
        (setting("Angle", False), number("Angle"), (0.8125 * scale,)),
        (setting("Velocity"), vector("Velocity"), (5.75 * scale, 9.125 * scale)),
        (setting("AngularVelocity", False), number("AngularVelocity"), (0.6875 * scale,)),
        (lambda *_: None, vector("Rotation"), (0.0, 0.0)),
        (setting("Force"), vector("Force"), (101.5 * scale, 203.25 * scale)),
        (setting("Torque", False), number("Torque"), (307.5 * scale,)),
    )


def _only_place(memory: Any, values: Values) -> int:
    """Offset of neighbouring numbers in a memory that has them once; -1 if it has not, or one of them is 0."""
    words = bytes(memory)
    sought = struct.pack(f"{len(values)}d", *values)
    places = [at for at in range(0, ROOM - len(sought), WORD) if words[at : at + len(sought)] == sought]
    return places[0] if len(places) == 1 and 0.0 not in values else -1


def _obeyed(memory: Any, place: int, read: Callable[[], Values]) -> bool:
    """Whether numbers that are written at a place are read by the library; they are put back."""
    before = read()
    for values in (tuple(17.0 + value for value in before), before):
        struct.pack_into(f"{len(values)}d", memory, place, *values)
        if read() != values:
            return False
    return True
