"""One step of one tractor body: four wheels, Ackermann angles, side forces, drive force.

The body frame is forward / right / clockwise, in which Eq. 4.1 and 4.2 hold with positive steering to the right.
Sideways speed and spin are advanced with a linearised implicit step, because side forces of a tyre at a crawl are
far stiffer than a step of 1/60 s allows; the step is exact in steady state and stable at any speed.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from vehicle.jit import compiled
from vehicle.steering import ackermann_tangents
from vehicle.tyres import friction_curve, side_damping, side_friction, side_share, slip_angle

GRAVITY = 9.80665
Step = Callable[..., tuple[float, float, float]]


@compiled
def wheel(
    forward: float, right: float, spin: float, ahead: float, aside: float, cosine: float, sine: float,
    slope: float, limit: float, load: float,
) -> tuple[float, float, float]:  # fmt: skip
    """Side force of one wheel (N, to its right), its damping (N s/m) and its slip angle (rad).

    The wheel sits `ahead` and `aside` (to the right) of the centre of mass and is steered by the angle whose
    cosine and sine are given.
    """
    u = forward - aside * spin
    v = right + ahead * spin
    rolling = u * cosine + v * sine
    sliding = v * cosine - u * sine
    slip = slip_angle(rolling, sliding)
    force = side_friction(slip, slope, limit) * load
    return force, side_damping(rolling, sliding, slip, slope, limit) * load, slip


@compiled
def passed_share(
    forward: float, right: float, spin: float, ahead: float, aside: float, cosine: float, sine: float, slip: float,
    ground: object,
) -> float:  # fmt: skip
    """Share of a wheel's side force that the ground's friction curve passes, at its slip or at the eased one."""
    if ground.ease > 0.0:  # type: ignore[attr-defined]
        u, v = forward - aside * spin, right + ahead * spin
        rolling = abs(u * cosine + v * sine) + ground.ease  # type: ignore[attr-defined]
        slip = math.atan((v * cosine - u * sine) / rolling)
    return friction_curve(
        slip, ground.peak_slip, ground.peak, ground.slide_slip, ground.slide  # type: ignore[attr-defined]
    )


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
        base = model.front + model.rear  # type: ignore[attr-defined]
        half = 0.5 * model.track  # type: ignore[attr-defined]
        weight = model.mass * GRAVITY  # type: ignore[attr-defined]
        front_load = 0.5 * weight * model.rear / base  # type: ignore[attr-defined]
        rear_load = 0.5 * weight * model.front / base  # type: ignore[attr-defined]
        share = 1.0
        if shaped:
            grip = 2.0 * rear_load * ground.grip  # type: ignore[attr-defined]
            drive = min(max(drive, -grip), grip)
            share = side_share(drive, grip)
        tangents = ackermann_tangents(tangent, base, model.track)  # type: ignore[attr-defined]
        side = turn = pull = 0.0
        d11 = d12 = d13 = d22 = d23 = d33 = 0.0
        for index in range(4):
            aside = -half if index % 2 == 0 else half
            if index < 2:
                cosine = 1.0 / math.sqrt(1.0 + tangents[index] * tangents[index])
                sine = tangents[index] * cosine
                ahead = model.front  # type: ignore[attr-defined]
                force, damping, slip = wheel(
                    forward, right, spin, ahead, aside, cosine, sine,
                    ground.front_slope, ground.front_limit, front_load,  # type: ignore[attr-defined]
                )  # fmt: skip
            else:
                cosine, sine, ahead = 1.0, 0.0, -model.rear  # type: ignore[attr-defined]
                force, damping, slip = wheel(
                    forward, right, spin, ahead, aside, cosine, sine,
                    ground.rear_slope, ground.rear_limit, rear_load,  # type: ignore[attr-defined]
                )  # fmt: skip
            if shaped:
                passed = passed_share(forward, right, spin, ahead, aside, cosine, sine, slip, ground)
                passed *= share if index >= 2 else 1.0
                force, damping = passed * force, passed * damping
            arm = ahead * cosine + aside * sine
            side += force * cosine
            turn += force * arm
            pull -= force * sine
            d11 += damping * sine * sine
            d12 -= damping * sine * cosine
            d13 -= damping * sine * arm
            d22 += damping * cosine * cosine
            d23 += damping * cosine * arm
            d33 += damping * arm * arm
        mass, inertia = model.mass, model.inertia  # type: ignore[attr-defined]
        rolling = ground.rolling * weight * forward / (abs(forward) + 0.05)  # type: ignore[attr-defined]
        # (M + dt D) change = dt (force - M spin x velocity); forward is eliminated first.
        b1 = dt * (drive + pull - rolling + mass * right * spin)
        b2, b3 = dt * (side - mass * forward * spin), dt * turn
        inverse = 1.0 / (mass + dt * d11)
        share2, share3 = dt * d12 * inverse, dt * d13 * inverse
        m22, m23 = mass + dt * (d22 - share2 * d12), dt * (d23 - share2 * d13)
        m33 = inertia + dt * (d33 - share3 * d13)
        c2, c3 = b2 - share2 * b1, b3 - share3 * b1
        scale = 1.0 / (m22 * m33 - m23 * m23)
        right_change = (m33 * c2 - m23 * c3) * scale
        spin_change = (m22 * c3 - m23 * c2) * scale
        forward_change = inverse * b1 - share2 * right_change - share3 * spin_change
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
