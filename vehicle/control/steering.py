"""The steering system: from a command to the angles of the two front wheels. Radians; positive is to the right."""

from __future__ import annotations

import math

from vehicle.jit import compile_function, inline_function

HOLD, FOLLOW, SLEW = range(1, 4)


@compile_function
def step_steering_simulator(
    angle: float, command: float, stage: int, dt: float,
    dead_band: float, switch: float, rate: float, lag: float, gain: float, latch: float = 1.0,
) -> tuple[float, int]:  # fmt: skip
    """One step of the steering system simulator, Eq. 2.8.

    Stage 1 holds, stage 2 follows as a first-order lag, stage 3 slews at `rate` towards the command and never
    past it. Stage 3 ends only in stage 1 (section 2.3.2), so the stage is part of the state; with `latch` 0 it
    changes to stage 2 as soon as the gap allows, which the thesis found to be wrong.
    """
    gap = command - angle
    size = abs(gap)
    if size < dead_band:
        return angle, HOLD
    if size >= switch:
        stage = SLEW
    elif stage != SLEW or latch == 0.0:
        stage = FOLLOW
    if stage == SLEW:
        return angle + math.copysign(min(rate * dt, size), gap), stage
    share = min(dt / lag, 1.0)
    return angle * (1.0 - share) + share * command * gain, stage


@compile_function
def compute_ackermann_directions(tangent: float, half: float) -> tuple[float, float, float, float]:
    """Cosine and sine of the left, then of the right front wheel's line, Eq. 2.1 and 2.2, from the mean tangent.

    `half` is half the track over the wheelbase. The line of a wheel turned beyond a right angle points backwards.
    """
    share = half * tangent
    left, right = 1.0 + share, 1.0 - share
    left_scale = 1.0 / math.sqrt(left * left + tangent * tangent)
    right_scale = 1.0 / math.sqrt(right * right + tangent * tangent)
    return left * left_scale, tangent * left_scale, right * right_scale, tangent * right_scale


@inline_function
def convert_to_base_angle(angle: float, table: object, limit: float) -> float:
    """Angle the base model needs for the radius measured at the physical `angle`, by linear interpolation.

    `table` holds the base-model angle at evenly spaced physical angles from -limit to limit (Eq. 2.9, 2.10, 5.1 as
    read in vehicle.sim.calibration).
    """
    last = len(table) - 1  # type: ignore[arg-type]
    place = (min(max(angle, -limit), limit) + limit) / (2.0 * limit) * last
    cell = min(int(place), last - 1)
    share = place - cell
    return table[cell] * (1.0 - share) + table[cell + 1] * share  # type: ignore[index, no-any-return]
