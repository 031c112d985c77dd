"""Many stretches at a measured speed driven side by side: what one step needs of each is worked out in vectors.

One replay waits for itself, step after step, most of the time. Where the speed is measured, all that a step takes from
the log is known before (see replay.foretelling): sideways speed and spin are stepped for all stretches at once, then
the places follow. Each stretch is driven as it would be alone, bit for bit, with the formulas of vehicle.chassis.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from vehicle.chassis import GRAVITY, axle_damping, body_step, pushed, wheel_motion
from vehicle.jit import compiled, inlined
from vehicle.measured.logs.record import Array
from vehicle.measured.replay.course import Stretch
from vehicle.measured.replay.states import ANGLE, X, Y
from vehicle.series import SMALL, small_arc_share
from vehicle.tyres import limited, per_rolling

ABREAST = 16  # chosen: stretches side by side; a constant, so that the compiler knows how far values lie apart
STEPS = 128  # chosen: of every stretch before its place follows; together they stay near the processor
FEW = 4  # chosen: fewer stretches are quicker one by one
# Rows of what is known of a step, a value per stretch: read before it, and sideways speed and spin before it.
SPEED, SLIDE, TANGENT, AHEAD, RIGHT, SPIN, PER_STEP = range(7)
# Rows of the step being driven: sideways speed, spin, the wheels' motion, one over their rolling, slip, its share.
NOW_RIGHT, NOW_SPIN, LINES, INVERSE, SLIP, SHARE, PER_NOW = 0, 1, 2, 9, 13, 17, 21
WHEELS = 4


class Abreast(NamedTuple):
    """Stretches one after another, the longest first: stretch i has the steps `begins` to before `ends`.

    `starts` (s, 3) are the poses they begin at, `speed` (n,) the speeds measured.
    """

    begins: npt.NDArray[np.int64]
    ends: npt.NDArray[np.int64]
    starts: Array
    speed: Array


def abreast_of(stretches: Sequence[Stretch]) -> Abreast:
    """Stretches laid one after another, as they come: the longest has to be the first."""
    counts = np.array([len(one.grids["speed"]) for one in stretches])
    ends = np.cumsum(counts)
    starts = [[one.grids[name][0] for name in ("east", "north", "heading")] for one in stretches]
    speed = np.concatenate([one.grids["speed"] for one in stretches], dtype=np.float64)
    return Abreast(ends - counts, ends, np.array(starts), speed)


@compiled
def drive_abreast(  # type: ignore[no-untyped-def]
    begins, ends, starts, speed, bend, ahead, slide, dt, model, ground, out
) -> None:
    """Drive at most ABREAST stretches, from `begins` to before `ends`, the longest first, from poses `starts` (s, 3).

    `speed`, and `bend`, `ahead` and `slide` of foretell, have a value per step (n,); `out` (n, 5) gets x, y and angle
    before each.
    """
    steps, now, places = np.zeros(STEPS * PER_STEP * ABREAST), np.zeros(PER_NOW * ABREAST), starts.copy()
    done, longest = 0, ends[0] - begins[0]
    while done < longest:
        count = 0
        while count < len(begins) and begins[count] + done < ends[count]:
            first, last = begins[count] + done, min(begins[count] + done + STEPS, ends[count])
            for i in range(first, last):
                at = (i - first) * PER_STEP * ABREAST + count
                steps[at + SPEED * ABREAST], steps[at + TANGENT * ABREAST] = speed[i], bend[i]
                steps[at + AHEAD * ABREAST], steps[at + SLIDE * ABREAST] = ahead[i], slide[i]
            count += 1
        rows = min(STEPS, longest - done)
        if count < FEW or ground.shaped != 0.0:
            _turn_each(steps, now, rows, count, dt, model, ground)
        elif count <= ABREAST // 2:
            _turn_abreast(steps, now, rows, ABREAST // 2, dt, model, ground)
        else:
            _turn_abreast(steps, now, rows, ABREAST, dt, model, ground)
        for lane in range(count):
            first, last = begins[lane] + done, min(begins[lane] + done + STEPS, ends[lane])
            _move(steps, lane, first, last, places[lane], dt, out)
        done += STEPS


@compiled
def _turn_each(steps, now, rows, count, dt, model, ground) -> None:  # type: ignore[no-untyped-def]
    """Step sideways speed and spin, stretch by stretch."""
    for lane in range(count):
        right, spin = now[NOW_RIGHT * ABREAST + lane], now[NOW_SPIN * ABREAST + lane]
        for row in range(rows):
            at = row * PER_STEP * ABREAST + lane
            steps[at + RIGHT * ABREAST], steps[at + SPIN * ABREAST] = right, spin
            forward, slide = steps[at + SPEED * ABREAST], steps[at + SLIDE * ABREAST]
            drive = _rolling_force(forward, model.mass, ground.rolling)
            _, right, spin = body_step(
                forward, right - slide, spin, steps[at + TANGENT * ABREAST], drive, dt, model, ground
            )
            right += slide
        now[NOW_RIGHT * ABREAST + lane], now[NOW_SPIN * ABREAST + lane] = right, spin


@inlined
def _rolling_force(forward: float, mass: float, rolling: float) -> float:
    """What rolling takes at a speed (N)."""
    return rolling * mass * GRAVITY * forward / (abs(forward) + 0.05)


@inlined
def _slip(steps, now, at, lanes, front, rear, half) -> None:  # type: ignore[no-untyped-def]
    """Slip of all wheels, and the share of it that its angle is where it is small."""
    for lane in range(lanes):
        forward, slide = steps[at + SPEED * ABREAST + lane], steps[at + SLIDE * ABREAST + lane]
        right, spin = now[NOW_RIGHT * ABREAST + lane], now[NOW_SPIN * ABREAST + lane]
        steps[at + RIGHT * ABREAST + lane], steps[at + SPIN * ABREAST + lane] = right, spin
        cos_1, sin_1, cos_2, sin_2, sliding_1, sliding_2, sliding, rolling_1, rolling_2, left, right_side = (
            wheel_motion(forward, right - slide, spin, steps[at + TANGENT * ABREAST + lane], front, rear, half)
        )
        now[LINES * ABREAST + lane], now[(LINES + 1) * ABREAST + lane] = cos_1, sin_1
        now[(LINES + 2) * ABREAST + lane], now[(LINES + 3) * ABREAST + lane] = cos_2, sin_2
        now[(LINES + 4) * ABREAST + lane], now[(LINES + 5) * ABREAST + lane] = sliding_1, sliding_2
        now[(LINES + 6) * ABREAST + lane] = sliding
        one, two, three, four = (
            per_rolling(rolling_1), per_rolling(rolling_2), per_rolling(left), per_rolling(right_side)
        )  # fmt: skip
        now[INVERSE * ABREAST + lane], now[(INVERSE + 1) * ABREAST + lane] = one, two
        now[(INVERSE + 2) * ABREAST + lane], now[(INVERSE + 3) * ABREAST + lane] = three, four
        now[SLIP * ABREAST + lane], now[(SLIP + 1) * ABREAST + lane] = abs(sliding_1) * one, abs(sliding_2) * two
        now[(SLIP + 2) * ABREAST + lane] = abs(sliding) * three
        now[(SLIP + 3) * ABREAST + lane] = abs(sliding) * four
    for place in range(WHEELS * ABREAST):
        now[SHARE * ABREAST + place] = small_arc_share(now[SLIP * ABREAST + place])


@inlined
def _push(  # type: ignore[no-untyped-def]
    steps, now, at, lanes, dt, slope, stiff, limit, most, front, rear, half, mass, inertia, rolling
) -> None:
    """Sideways speed and spin after the step."""
    for lane in range(lanes):
        forward, slide = steps[at + SPEED * ABREAST + lane], steps[at + SLIDE * ABREAST + lane]
        right, spin = now[NOW_RIGHT * ABREAST + lane] - slide, now[NOW_SPIN * ABREAST + lane]
        slip, share, inverse = SLIP * ABREAST + lane, SHARE * ABREAST + lane, INVERSE * ABREAST + lane
        d_1 = slope * limited(now[share], now[slip], limit) * now[inverse]
        d_2 = slope * limited(now[share + ABREAST], now[slip + ABREAST], limit) * now[inverse + ABREAST]
        d_3 = stiff * limited(now[share + 2 * ABREAST], now[slip + 2 * ABREAST], most) * now[inverse + 2 * ABREAST]
        d_4 = stiff * limited(now[share + 3 * ABREAST], now[slip + 3 * ABREAST], most) * now[inverse + 3 * ABREAST]
        line = LINES * ABREAST + lane
        _, right_change, spin_change = pushed(
            forward, right, spin, _rolling_force(forward, mass, rolling), dt,
            now[line], now[line + ABREAST], now[line + 2 * ABREAST], now[line + 3 * ABREAST],
            now[line + 4 * ABREAST], now[line + 5 * ABREAST], now[line + 6 * ABREAST],
            d_1, d_2, d_3, d_4, front, rear, half, mass, inertia, rolling,
        )  # fmt: skip
        now[NOW_RIGHT * ABREAST + lane] = right + right_change + slide
        now[NOW_SPIN * ABREAST + lane] = spin + spin_change


@compiled
def _turn_abreast(steps, now, rows, lanes, dt, model, ground) -> None:  # type: ignore[no-untyped-def]
    """Step sideways speed and spin of so many stretches at once; those that have ended step on unseen."""
    slope, stiff = axle_damping(dt, model, ground)
    limit, most, rolling = ground.front_limit, ground.rear_limit, ground.rolling
    front, rear, half, mass, inertia = model.front, model.rear, 0.5 * model.track, model.mass, model.inertia
    for row in range(rows):
        at = row * PER_STEP * ABREAST
        if lanes == ABREAST:  # each number is written out: loops of a length that varies are not made of vectors
            _slip(steps, now, at, ABREAST, front, rear, half)
        else:
            _slip(steps, now, at, ABREAST // 2, front, rear, half)
        for place in range(SLIP * ABREAST, SHARE * ABREAST):
            if now[place] > SMALL:
                now[place + WHEELS * ABREAST] = math.atan(now[place]) / now[place]
        if lanes == ABREAST:
            _push(
                steps, now, at, ABREAST, dt, slope, stiff, limit, most, front, rear, half, mass, inertia, rolling
            )
        else:
            _push(
                steps, now, at, ABREAST // 2, dt, slope, stiff, limit, most, front, rear, half, mass, inertia, rolling
            )


@compiled
def _move(steps, lane, first, last, place, dt, out) -> None:  # type: ignore[no-untyped-def]
    """Move the place of a stretch through some steps, as pymunk moves it, with the velocity before each."""
    x, y, angle = place[0], place[1], place[2]
    for i in range(first, last):
        at = (i - first) * PER_STEP * ABREAST + lane
        out[i, X], out[i, Y], out[i, ANGLE] = x, y, angle
        forward, along = steps[at + SPEED * ABREAST], steps[at + AHEAD * ABREAST]
        right, cosine, sine = steps[at + RIGHT * ABREAST], math.cos(angle), math.sin(angle)
        x += ((forward + along) * cosine + right * sine) * dt
        y += ((forward + along) * sine - right * cosine) * dt
        angle -= steps[at + SPIN * ABREAST] * dt
    place[0], place[1], place[2] = x, y, angle
