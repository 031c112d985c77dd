"""Many stretches at a measured speed driven side by side: what one step needs of each is worked out in vectors.

One replay waits for itself, step after step, most of the time. Where the speed is measured, all that a step takes from
the log is known before (see replay.foretelling): sideways speed and spin are stepped for many stretches at once, each
in a lane of its own that the next one takes when it has ended; then the places follow. Each stretch is driven as it
would be alone, bit for bit, with the formulas of vehicle.chassis: the engine holds the speed against all that rolls.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from vehicle.chassis import GRAVITY, axle_damping, body_step, pushed, wheel_motion
from vehicle.jit import compiled, inlined
from vehicle.measured.replay.states import ANGLE, X, Y
from vehicle.series import SMALL, arc_share, cosine_sine, small_arc_share
from vehicle.tyres import CREEP_MPS

ABREAST = 8  # chosen: lanes side by side; twice as many take nearly twice as long, and more of them stay empty
STEPS = 128  # chosen: of every lane before one that has ended is taken anew; together they stay near the processor
FEW = 2  # chosen: so few lanes are quicker one by one
# Rows of a step, a value per lane: what is known of it, and sideways speed and spin before it.
SPEED, SLIDE, TANGENT, RIGHT, SPIN, PER_STEP = range(6)
ROW = PER_STEP * ABREAST


class _Body(NamedTuple):
    """A tractor on its ground, as numbers: vectors are made of nothing else.

    `slope` and `stiff` are those of axle_damping, `limit` and `most` the largest slip angles of the front and the rear
    wheels (rad), `steep` and `steeper` their tangents.
    """

    dt: Any
    slope: Any
    stiff: Any
    limit: Any
    most: Any
    steep: Any
    steeper: Any
    front: Any
    rear: Any
    half: Any
    mass: Any
    inertia: Any


@inlined
def _body(dt, model, ground):  # type: ignore[no-untyped-def]
    slope, stiff = axle_damping(dt, model, ground)
    return _Body(
        dt, slope, stiff, ground.front_limit, ground.rear_limit, _steepest(ground.front_limit),
        _steepest(ground.rear_limit), model.front, model.rear, 0.5 * model.track, model.mass, model.inertia,
    )  # fmt: skip


@compiled
def _steepest(limit: float) -> float:
    """Slip whose angle is the limit (rad); none is, of a right angle and more."""
    return math.tan(limit) if limit < 0.5 * math.pi else math.inf


@compiled
def turn_abreast(begins, ends, speed, bend, slide, dt, model, ground, right, spin) -> None:  # type: ignore[no-untyped-def]
    """Drive stretches from steps `begins` to before `ends`, the longest first: the lanes end together then.

    `speed`, and `bend` and `slide` of foretell, have a value per step (n,); `right` and `spin` (n,) get the sideways
    speed and the spin before each.
    """
    if ground.shaped != 0.0:
        for one in range(len(begins)):
            _turn_shaped(begins[one], ends[one], speed, bend, slide, dt, model, ground, right, spin)
        return
    steps, body = np.zeros((STEPS + 1) * ROW), _body(dt, model, ground)
    at, end = np.zeros(ABREAST, dtype=np.int64), np.zeros(ABREAST, dtype=np.int64)
    counts, coming = np.zeros(ABREAST, dtype=np.int64), 0
    while True:
        rows, busy = 0, 0
        for lane in range(ABREAST):
            if at[lane] == end[lane] and coming < len(begins):
                at[lane], end[lane] = begins[coming], ends[coming]
                steps[RIGHT * ABREAST + lane] = steps[SPIN * ABREAST + lane] = 0.0
                coming += 1
            counts[lane] = min(end[lane] - at[lane], STEPS)
            _lay(steps, lane, at[lane], counts[lane], speed, bend, slide)
            rows, busy = max(rows, counts[lane]), busy + min(counts[lane], 1)
        if rows == 0:
            break
        if busy <= FEW:
            for lane in range(ABREAST):
                _turn_lane(steps, lane, counts[lane], body)
        else:
            _turn_lanes(steps, rows, body)
        for lane in range(ABREAST):
            _take(steps, lane, at[lane], counts[lane], right, spin)
            at[lane] += counts[lane]


@compiled
def _lay(steps, lane, first, count, speed, bend, slide) -> None:  # type: ignore[no-untyped-def]
    """Lay what is known of some steps of a stretch, from its `first`, in a lane."""
    for row in range(count):
        place, i = row * ROW + lane, first + row
        steps[place + SPEED * ABREAST], steps[place + SLIDE * ABREAST] = speed[i], slide[i]
        steps[place + TANGENT * ABREAST] = bend[i]


@compiled
def _take(steps, lane, first, count, right, spin) -> None:  # type: ignore[no-untyped-def]
    """Take out the sideways speed and spin before the steps of _lay; those behind the last go before the next."""
    for row in range(count):
        place, i = row * ROW + lane, first + row
        right[i], spin[i] = steps[place + RIGHT * ABREAST], steps[place + SPIN * ABREAST]
    last = count * ROW + lane
    steps[RIGHT * ABREAST + lane] = steps[last + RIGHT * ABREAST]
    steps[SPIN * ABREAST + lane] = steps[last + SPIN * ABREAST]


@inlined
def _axle(rolling_1, rolling_2, sliding_1, sliding_2, steepest):  # type: ignore[no-untyped-def]
    """Of two wheels, what turns sliding into slip or, beyond the limit, into 1 (s/m), the slip, and whether beyond.

    `steepest` is the slip at the limit. The speeds are those of tyres.side_resistance; both are divided by at once.
    """
    one, two = max(abs(rolling_1), CREEP_MPS), max(abs(rolling_2), CREEP_MPS)
    size_1, size_2 = abs(sliding_1), abs(sliding_2)
    far_1, far_2 = size_1 > steepest * one, size_2 > steepest * two
    one, two = (size_1 if far_1 else one), (size_2 if far_2 else two)
    both = 1.0 / (one * two)
    one, two = two * both, one * both
    return one, two, size_1 * one, size_2 * two, far_1, far_2


@inlined
def _turn(forward, right, spin, tangent, body, share):  # type: ignore[no-untyped-def]
    """Sideways speed and spin after a step, and 1 where a wheel slips farther than by SMALL: `share` is arc_share."""
    cos_1, sin_1, cos_2, sin_2, sliding_1, sliding_2, sliding, rolling_1, rolling_2, left, right_side = wheel_motion(
        forward, right, spin, tangent, body.front, body.rear, body.half
    )
    over_1, over_2, slip_1, slip_2, far_1, far_2 = _axle(rolling_1, rolling_2, sliding_1, sliding_2, body.steep)
    over_3, over_4, slip_3, slip_4, far_3, far_4 = _axle(left, right_side, sliding, sliding, body.steeper)
    share_1, share_2, share_3, share_4 = share(slip_1), share(slip_2), share(slip_3), share(slip_4)
    _, right_change, spin_change = pushed(
        forward, right, spin, 0.0, body.dt, cos_1, sin_1, cos_2, sin_2, sliding_1, sliding_2, sliding,
        body.slope * (body.limit if far_1 else share_1) * over_1,
        body.slope * (body.limit if far_2 else share_2) * over_2,
        body.stiff * (body.most if far_3 else share_3) * over_3,
        body.stiff * (body.most if far_4 else share_4) * over_4,
        body.front, body.rear, body.half, body.mass, body.inertia,
    )  # fmt: skip
    front = max(0.0 if far_1 else slip_1, 0.0 if far_2 else slip_2)
    wide = max(front, max(0.0 if far_3 else slip_3, 0.0 if far_4 else slip_4))
    return right + right_change, spin + spin_change, 1 if wide > SMALL else 0


@inlined
def _turn_row(steps, at, body):  # type: ignore[no-untyped-def]
    """Step all lanes; how many slip too far for it."""
    wide = 0
    for lane in range(ABREAST):
        slide = steps[at + SLIDE * ABREAST + lane]
        right, spin, far = _turn(
            steps[at + SPEED * ABREAST + lane], steps[at + RIGHT * ABREAST + lane] - slide,
            steps[at + SPIN * ABREAST + lane], steps[at + TANGENT * ABREAST + lane], body, small_arc_share,
        )  # fmt: skip
        steps[at + ROW + RIGHT * ABREAST + lane] = right + slide
        steps[at + ROW + SPIN * ABREAST + lane] = spin
        wide += far
    return wide


@compiled
def _turn_one(steps, place, body) -> None:  # type: ignore[no-untyped-def]
    """Step one lane, however far its wheels slip."""
    slide = steps[place + SLIDE * ABREAST]
    right, spin, _ = _turn(
        steps[place + SPEED * ABREAST], steps[place + RIGHT * ABREAST] - slide, steps[place + SPIN * ABREAST],
        steps[place + TANGENT * ABREAST], body, arc_share,
    )  # fmt: skip
    steps[place + ROW + RIGHT * ABREAST], steps[place + ROW + SPIN * ABREAST] = right + slide, spin


@compiled
def _turn_lanes(steps, rows, body) -> None:  # type: ignore[no-untyped-def]
    """Step sideways speed and spin of all lanes at once; those that have ended step on unseen."""
    for row in range(rows):
        if _turn_row(steps, row * ROW, body) > 0:
            for lane in range(ABREAST):
                _turn_one(steps, row * ROW + lane, body)


@compiled
def _turn_lane(steps, lane, rows, body) -> None:  # type: ignore[no-untyped-def]
    """Step sideways speed and spin of one lane."""
    for row in range(rows):
        _turn_one(steps, row * ROW + lane, body)


@compiled
def _turn_shaped(begin, end, speed, bend, slide, dt, model, ground, right, spin) -> None:  # type: ignore[no-untyped-def]
    """Drive one stretch on a ground whose friction has a curve, as turn_abreast."""
    across = turning = 0.0
    for i in range(begin, end):
        right[i], spin[i] = across, turning
        drive = ground.rolling * model.mass * GRAVITY * speed[i] / (abs(speed[i]) + 0.05)
        _, across, turning = body_step(speed[i], across - slide[i], turning, bend[i], drive, dt, model, ground)
        across += slide[i]


@compiled
def move_on(speed, ahead, right, spin, x, y, angle, dt, out) -> None:  # type: ignore[no-untyped-def]
    """Move a stretch from a pose as pymunk moves it, with the velocity before each step (n,).

    `out` (5, n) gets x, y and angle before each.
    """
    xs, ys, angles = out[X], out[Y], out[ANGLE]
    count = len(speed)
    cosines, sines = np.empty(count), np.empty(count)
    for i in range(count):
        angles[i] = angle
        angle -= spin[i] * dt
    for i in range(count):
        cosines[i], sines[i] = cosine_sine(angles[i])
    for i in range(count):
        xs[i] = ((speed[i] + ahead[i]) * cosines[i] + right[i] * sines[i]) * dt
    for i in range(count):
        ys[i] = ((speed[i] + ahead[i]) * sines[i] - right[i] * cosines[i]) * dt
    for i in range(count):
        east, north = xs[i], ys[i]
        xs[i], ys[i] = x, y
        x += east
        y += north
