"""One step of one tractor body: four wheels, Ackermann angles, side forces, drive force.

The body frame is forward / right / clockwise, in which Eq. 4.1 and 4.2 hold with positive steering to the right.
Sideways speed and spin are advanced with a linearised implicit step, because side forces of a tyre at a crawl are
far stiffer than a step of 1/60 s allows; the step is exact in steady state and stable at any speed.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from vehicle.jit import compiled, inlined
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


@inlined
def wheel_motion(
    forward: float, right: float, spin: float, tangent: float, front: float, rear: float, half: float
) -> tuple[float, float, float, float, float, float, float, float, float, float, float]:
    """How the wheels of a body move: lines, sliding and rolling.

    Cosine and sine of the line of the left, then of the right front wheel; speeds across its line of the left front,
    the right front and either rear wheel (m/s); speeds along it of front left, front right, rear left and rear right.
    `front` and `rear` are the ways from the centre of mass to the axles, `half` is half the track (m).
    """
    cos_1, sin_1, cos_2, sin_2 = ackermann(tangent, half * (1.0 / (front + rear)))
    left, right_side, v = forward + half * spin, forward - half * spin, right + front * spin
    rolling_1, sliding_1 = left * cos_1 + v * sin_1, v * cos_1 - left * sin_1
    rolling_2, sliding_2 = right_side * cos_2 + v * sin_2, v * cos_2 - right_side * sin_2
    sliding = right - rear * spin
    return cos_1, sin_1, cos_2, sin_2, sliding_1, sliding_2, sliding, rolling_1, rolling_2, left, right_side


@inlined
def half_load(model: object) -> float:
    """Half the weight per wheelbase (N/m): a wheel carries so much per metre from the centre of mass to the other axle.
    """
    return 0.5 * (model.mass * GRAVITY) * (1.0 / (model.front + model.rear))  # type: ignore[attr-defined, no-any-return]


@inlined
def axle_damping(dt: float, model: object, ground: object) -> tuple[float, float]:
    """Side slope of one front and one rear wheel under its load, times `dt` (N s)."""
    load = dt * half_load(model)
    return load * model.rear * ground.front_slope, load * model.front * ground.rear_slope  # type: ignore[attr-defined]


@inlined
def pushed(
    forward: float, right: float, spin: float, force: float, dt: float,
    cos_1: float, sin_1: float, cos_2: float, sin_2: float, sliding_1: float, sliding_2: float, sliding: float,
    d_1: float, d_2: float, d_3: float, d_4: float,
    front: float, rear: float, half: float, mass: float, inertia: float,
) -> tuple[float, float, float]:  # fmt: skip
    """Changes of the forward and right speed and the spin in `dt`, from the motion and damping of the wheels.

    `d_1` to `d_4` are the damping times dt (N s2/m) of the front left, front right, rear left and rear right wheel,
    `force` is that of the drive less what rolling takes (N). Numbers instead of records: vectors are made of nothing
    else.
    """
    arm_1, arm_2 = front * cos_1 - half * sin_1, front * cos_2 + half * sin_2
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
    b1 = (along_1 * sliding_1 + along_2 * sliding_2) + dt * (force + mass * right * spin)
    b2 = -((side_1 * sliding_1 + side_2 * sliding_2) + (d_34 * sliding + dt * mass * forward * spin))
    b3 = d_34 * (sliding * rear) - (turn_1 * sliding_1 + turn_2 * sliding_2)
    m22, m23, m33 = a11 * a22 - a12 * a12, a11 * a23 - a12 * a13, a11 * a33 - a13 * a13
    c2, c3 = a11 * b2 - a12 * b1, a11 * b3 - a13 * b1
    scale = 1.0 / (m22 * m33 - m23 * m23)
    right_change = (m33 * c2 - m23 * c3) * scale
    spin_change = (m22 * c3 - m23 * c2) * scale
    forward_change = (b1 - (a12 * right_change + a13 * spin_change)) * (1.0 / a11)
    return forward_change, right_change, spin_change


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
        cos_1, sin_1, cos_2, sin_2, sliding_1, sliding_2, sliding, rolling_1, rolling_2, left, right_side = (
            wheel_motion(forward, right, spin, tangent, front, rear, half)
        )
        slope, stiff = axle_damping(dt, model, ground)
        limit, most = ground.front_limit, ground.rear_limit  # type: ignore[attr-defined]
        d_1 = side_resistance(rolling_1, sliding_1, slope, limit)
        d_2 = side_resistance(rolling_2, sliding_2, slope, limit)
        d_3 = side_resistance(left, sliding, stiff, most)
        d_4 = side_resistance(right_side, sliding, stiff, most)
        if shaped:
            grip = 2.0 * half_load(model) * front * ground.grip  # type: ignore[attr-defined]
            drive = min(max(drive, -grip), grip)
            share = side_share(drive, grip)
            d_1 *= passed_share(rolling_1, sliding_1, ground)
            d_2 *= passed_share(rolling_2, sliding_2, ground)
            d_3 *= share * passed_share(left, sliding, ground)
            d_4 *= share * passed_share(right_side, sliding, ground)
        weight = model.mass * GRAVITY  # type: ignore[attr-defined]
        resistance = ground.rolling * weight * forward / (abs(forward) + 0.05)  # type: ignore[attr-defined]
        forward_change, right_change, spin_change = pushed(
            forward, right, spin, drive - resistance, dt, cos_1, sin_1, cos_2, sin_2, sliding_1, sliding_2, sliding,
            d_1, d_2, d_3, d_4,
            front, rear, half, model.mass, model.inertia,  # type: ignore[attr-defined]
        )  # fmt: skip
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
