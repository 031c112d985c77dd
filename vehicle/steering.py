"""From a steering command to the angles of the two front wheels. Positive is to the right; radians."""

from __future__ import annotations

import math

from vehicle.jit import compiled, inlined

HOLD, TRACK, SLEW = 1, 2, 3


@compiled
def steering_step(
    angle: float,
    command: float,
    stage: int,
    dt: float,
    dead_band: float,
    switch: float,
    rate: float,
    lag: float,
    gain: float,
    latch: float = 1.0,
) -> tuple[float, int]:
    """One step of the steering system simulator, Eq. 2.8.

    Stage 1 holds, stage 2 follows as a first-order lag, stage 3 slews at `rate` towards the command and never
    past it. Stage 3 is left only through stage 1 (section 2.3.2), so the stage is part of the state; with `latch` 0
    it gives way to stage 2 as soon as the gap allows, which the thesis found to be wrong.
    """
    gap = command - angle
    size = abs(gap)
    if size < dead_band:
        return angle, HOLD
    if size >= switch:
        stage = SLEW
    elif stage != SLEW or latch == 0.0:
        stage = TRACK
    if stage == SLEW:
        return angle + math.copysign(min(rate * dt, size), gap), stage
    share = min(dt / lag, 1.0)
    return angle * (1.0 - share) + share * command * gain, stage


@compiled
def ackermann(tangent: float, half: float) -> tuple[float, float, float, float]:
    """Cosine and sine of the left, then of the right front wheel's line, Eq. 2.1 and 2.2, from the mean tangent.

    `half` is half the track over the wheelbase. Of a wheel turned beyond a right angle the line points backwards.
    """
    share = half * tangent
    left, right = 1.0 + share, 1.0 - share
    one = 1.0 / math.sqrt(left * left + tangent * tangent)
    other = 1.0 / math.sqrt(right * right + tangent * tangent)
    return left * one, tangent * one, right * other, tangent * other


@inlined
def corrected_angle(angle: float, table: object, limit: float) -> float:
    """Angle the base model needs for the radius measured at the physical `angle`, by linear interpolation.

    `table` holds the answer at evenly spaced physical angles from -limit to limit (Eq. 2.9, 2.10, 5.1 in the
    sense of vehicle.calibration).
    """
    last = len(table) - 1  # type: ignore[arg-type]
    place = (min(max(angle, -limit), limit) + limit) / (2.0 * limit) * last
    cell = min(int(place), last - 1)
    share = place - cell
    return table[cell] * (1.0 - share) + table[cell + 1] * share  # type: ignore[index, no-any-return]
