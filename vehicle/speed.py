"""How fast a tractor should drive and the force that makes it so."""

from __future__ import annotations

import math

from vehicle.jit import compiled

ARRIVED_MPS = 0.02  # so that a brake that waits for a standstill is not kept waiting by the tail of a lag


@compiled
def drive_force(
    error: float, integral: float, derivative: float, kp: float, ki: float, kd: float, limit: float
) -> float:
    """Drive force of the speed controller, Eq. 2.3 with e = target - speed (see the source notes), limited."""
    return min(max(kp * error + ki * integral + kd * derivative, -limit), limit)


@compiled
def approach_speed(distance: float, end_speed: float, deceleration: float) -> float:
    """Largest speed from which `end_speed` is reached within `distance` at a constant deceleration."""
    return math.sqrt(end_speed * end_speed + 2.0 * deceleration * max(distance, 0.0))


@compiled
def follower_speed(distance: float, gap: float, leader_speed: float) -> float:
    """Speed of a follower in formation, Eq. 6.1, with the formation distance as `gap`."""
    if distance >= gap:
        return leader_speed
    return max(leader_speed - 0.5 * (gap - distance), 0.0)


@compiled
def lagging(value: float, target: float, lag_s: float, dt: float) -> float:
    """Where a first-order lag would take `value` on its way to `target` within `dt`; what is nearly there arrives."""
    gap = target - value
    if abs(gap) < ARRIVED_MPS:
        return target
    return value + gap * (1.0 - math.exp(-dt / lag_s))


@compiled
def ramp(value: float, target: float, step: float) -> float:
    """Move `value` towards `target` by at most `step`."""
    return value + min(max(target - value, -step), step)
