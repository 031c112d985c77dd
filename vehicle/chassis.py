"""One step of one tractor body: four wheels, Ackermann angles, side forces, drive force.

The body frame is forward / right / clockwise, in which Eq. 4.1 and 4.2 hold with positive steering to the right.
Sideways speed and spin are advanced with a linearised implicit step, because side forces of a tyre at a crawl are
far stiffer than a step of 1/60 s allows; the step is exact in steady state and stable at any speed.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from vehicle.jit import compiled
from vehicle.steering import ackermann
from vehicle.tyres import CREEP_MPS, friction_curve, side_resistance, side_share

GRAVITY = 9.80665
Step = Callable[..., tuple[float, float, float]]


@compiled
def passed_share(rolling: float, sliding: float, ground: object) -> float:
    """Share of a wheel's side force that the ground's friction curve passes, at its slip or at the eased one."""
    size = max(abs(rolling), CREEP_MPS)
    if ground.ease > 0.0:  # type: ignore[attr-defined]
        size = abs(rolling) + ground.ease  # type: ignore[attr-defined]
    return friction_curve(
        math.atan(sliding / size),
        ground.peak_slip, ground.peak, ground.slide_slip, ground.slide,  # type: ignore[attr-defined]
    )  # fmt: skip


def _make_step(shaped: bool) -> Step:
    """The step for plain tyres, or with friction curve and friction circle.

    Two functions out of one text: what `shaped` leaves out is left out when it is compiled, so that the plain step
    that plans are driven with costs nothing more.
    """

    @compiled
    def step(
        forward: float, right: float, spin: float, tangent: float, drive: float, dt: float, model: object,
        ground: object,
    ) -> tuple[float, float, float]:  # fmt: skip
        front, rear, half = model.front, model.rear, 0.5 * model.track  # type: ignore[attr-defined]
        mass, inertia = model.mass, model.inertia  # type: ignore[attr-defined]
        weight = mass * GRAVITY
        per_base = 1.0 / (front + rear)
        load = 0.5 * weight * per_base
        slope, limit = dt * load * rear * ground.front_slope, ground.front_limit  # type: ignore[attr-defined]
        stiff, most = dt * load * front * ground.rear_slope, ground.rear_limit  # type: ignore[attr-defined]
        cos_1, sin_1, cos_2, sin_2 = ackermann(tangent, half * per_base)
        arm_1, arm_2 = front * cos_1 - half * sin_1, front * cos_2 + half * sin_2
        left, right_side, v = forward + half * spin, forward - half * spin, right + front * spin
        rolling_1, sliding_1 = left * cos_1 + v * sin_1, v * cos_1 - left * sin_1
        rolling_2, sliding_2 = right_side * cos_2 + v * sin_2, v * cos_2 - right_side * sin_2
        sliding = right - rear * spin
        # Damping times dt (N s2/m) of the front left, front right, rear left and rear right wheel.
        d_1 = side_resistance(rolling_1, sliding_1, slope, limit)
        d_2 = side_resistance(rolling_2, sliding_2, slope, limit)
        d_3 = side_resistance(left, sliding, stiff, most)
        d_4 = side_resistance(right_side, sliding, stiff, most)
        if shaped:
            grip = 2.0 * load * front * ground.grip  # type: ignore[attr-defined]
            drive = min(max(drive, -grip), grip)
            share = side_share(drive, grip)
            d_1 *= passed_share(rolling_1, sliding_1, ground)
            d_2 *= passed_share(rolling_2, sliding_2, ground)
            d_3 *= share * passed_share(left, sliding, ground)
            d_4 *= share * passed_share(right_side, sliding, ground)
        along_1, along_2, d_34 = d_1 * sin_1, d_2 * sin_2, d_3 + d_4
        side_1, side_2 = d_1 * cos_1, d_2 * cos_2
        turn_1, turn_2 = d_1 * arm_1, d_2 * arm_2
        # (M + dt D) change = dt (force - D velocity - M spin x velocity); forward is eliminated first.
        a11 = mass + along_1 * sin_1 + along_2 * sin_2
        a12 = -(along_1 * cos_1 + along_2 * cos_2)
        a13 = -(along_1 * arm_1 + along_2 * arm_2)
        a22 = (mass + d_34) + (side_1 * cos_1 + side_2 * cos_2)
        a23 = (side_1 * arm_1 + side_2 * arm_2) - d_34 * rear
        a33 = (inertia + d_34 * (rear * rear)) + (turn_1 * arm_1 + turn_2 * arm_2)
        resistance = ground.rolling * weight * forward / (abs(forward) + 0.05)  # type: ignore[attr-defined]
        b1 = (along_1 * sliding_1 + along_2 * sliding_2) + dt * (drive - resistance + mass * right * spin)
        b2 = -((side_1 * sliding_1 + side_2 * sliding_2) + (d_34 * sliding + dt * mass * forward * spin))
        b3 = d_34 * (sliding * rear) - (turn_1 * sliding_1 + turn_2 * sliding_2)
        m22, m23, m33 = a11 * a22 - a12 * a12, a11 * a23 - a12 * a13, a11 * a33 - a13 * a13
        c2, c3 = a11 * b2 - a12 * b1, a11 * b3 - a13 * b1
        scale = 1.0 / (m22 * m33 - m23 * m23)
        right_change = (m33 * c2 - m23 * c3) * scale
        spin_change = (m22 * c3 - m23 * c2) * scale
        forward_change = (b1 - (a12 * right_change + a13 * spin_change)) * (1.0 / a11)
        return forward + forward_change, right + right_change, spin + spin_change

    return step


_plain_step, _shaped_step = _make_step(False), _make_step(True)


@compiled
def body_step(
    forward: float, right: float, spin: float, tangent: float, drive: float, dt: float, model: object, ground: object
) -> tuple[float, float, float]:  # fmt: skip
    """Velocities after `dt`: forward and right (m/s) and clockwise spin (rad/s) in the body frame.

    `tangent` is that of the mean front wheel angle, `drive` the force of the rear wheels (N); `model` and `ground`
    are records of vehicle.layout. Load per axle follows from the centre of mass, shared by its two wheels.
    """
    if ground.shaped != 0.0:  # type: ignore[attr-defined]
        return _shaped_step(forward, right, spin, tangent, drive, dt, model, ground)
    return _plain_step(forward, right, spin, tangent, drive, dt, model, ground)
