"""Target speeds of a tractor, and the drive force that reaches them."""

from __future__ import annotations

import math

from vehicle.jit import compile_function

STANDSTILL_MPS = 0.03
ARRIVAL_TOLERANCE_MPS = 0.02  # so that a brake does not wait for the slow end of an exponential


@compile_function
def compute_drive_force(
    error: float, integral: float, derivative: float, kp: float, ki: float, kd: float, limit: float
) -> float:
    """Drive force of the speed controller, Eq. 2.3 with e = target - speed (see the source notes), limited."""
    return min(max(kp * error + ki * integral + kd * derivative, -limit), limit)


@compile_function
def compute_approach_speed(distance: float, end_speed: float, deceleration: float) -> float:
    """Largest speed from which `end_speed` is reached within `distance` at a constant deceleration."""
    return math.sqrt(end_speed * end_speed + 2.0 * deceleration * max(distance, 0.0))


@compile_function
def compute_follower_speed(distance: float, gap: float, leader_speed: float) -> float:
    """Speed of a follower in formation, Eq. 6.1, with the formation distance as `gap`."""
    if distance >= gap:
        return leader_speed
    return max(leader_speed - 0.5 * (gap - distance), 0.0)


@compile_function
def apply_lag(value: float, target: float, lag_s: float, dt: float) -> float:
    """`value` after `dt` of a first-order lag towards `target`; within the arrival tolerance, `target` itself."""
    gap = target - value
    if abs(gap) < ARRIVAL_TOLERANCE_MPS:
        return target
    return value + gap * (1.0 - math.exp(-dt / lag_s))


@compile_function
def apply_ramp(value: float, target: float, step: float) -> float:
    """Move `value` towards `target` by at most `step`."""
    return value + min(max(target - value, -step), step)
