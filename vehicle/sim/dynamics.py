"""Dynamics of one tractor: tyre forces (chapter 4), one step of the body, steering system and drive line.

The body frame is forward / right / clockwise, in which Eq. 4.1 and 4.2 hold with positive steering to the right.
Sideways speed and spin are advanced with a linearised implicit step, because side forces of a tyre at a crawl are
far stiffer than a step of 1/60 s allows; the step is exact in steady state and stable at any speed. Planning and the
replay of measured logs call the same functions.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from vehicle.control.speed import STANDSTILL_MPS, apply_lag, apply_ramp, compute_drive_force
from vehicle.control.steering import compute_ackermann_directions, step_steering_simulator
from vehicle.energy.traction import compute_friction_circle_share
from vehicle.fast_math import compute_arctangent_ratio
from vehicle.jit import compile_function, inline_function
from vehicle.records import GRAVITY_MPS2
from vehicle.sim.effect_terms import CREEP_MPS, apply_play, compute_ground_speed, read_delayed
from vehicle.sim.load_terms import compute_pull, compute_slopes, limit_drive, note_overturning

StepFunction = Callable[..., tuple[float, float, float]]


@compile_function
def compute_side_resistance(rolling: float, sliding: float, slope: float, limit: float) -> float:
    """Side force of a wheel per load and m/s of sideways speed, from its velocity in its own frame.

    Times the sideways speed it is the side friction, linear in the slip angle up to `limit` and constant beyond
    (Eq. 4.1 to 4.4 at the position of the wheel). This is the secant, not the derivative: the derivative vanishes
    beyond `limit`, which would make the step explicit, and saturated tyres would throw a crawling tractor from side to
    side.
    """
    inverse = 1.0 / max(abs(rolling), CREEP_MPS)
    slide = abs(sliding) * inverse
    share = compute_arctangent_ratio(slide)  # of the slip angle over its tangent
    if share * slide > limit:
        share = limit / slide
    return slope * share * inverse


@compile_function
def compute_friction_share(slip: float, peak_slip: float, peak: float, slide_slip: float, slide: float) -> float:
    """Share of the side friction by a game engine's curve: linear up to (peak_slip, peak), linear down to
    (slide_slip, slide), constant beyond. A `peak_slip` of 0 stands for no curve and gives 1.

    In the engine of the thesis the side stiffness of Eq. 4.3 and 4.4 multiplies this curve.
    """
    if peak_slip == 0.0:
        return 1.0
    size = abs(slip)
    if size < peak_slip:
        return peak * size / peak_slip
    if size < slide_slip:
        return peak + (slide - peak) * (size - peak_slip) / (slide_slip - peak_slip)
    return slide


@inline_function
def compute_soil_limits(thrust: float, model: object, ground: object) -> tuple[float, float]:
    """Slip angles (rad) at which side forces of front and rear tyres stop growing, on soil that wheels slip on.

    No wheel pushes harder than the soil bears, in any direction: `envelope` of its load (vehicle.energy.traction). Of
    driven wheels the friction circle leaves what their thrust (N) does not take. The limits of the ground count where
    they are lower.
    """
    envelope = model.envelope  # type: ignore[attr-defined]
    rear = envelope * compute_friction_circle_share(thrust, model.driven_weight * envelope)  # type: ignore[attr-defined]
    front = rear if model.front_driven != 0.0 else envelope  # type: ignore[attr-defined]
    return (
        min(ground.front_limit, front / ground.front_slope),  # type: ignore[attr-defined]
        min(ground.rear_limit, rear / ground.rear_slope),  # type: ignore[attr-defined]
    )


@inline_function
def compute_rolling_resistance(forward: float, model: object, ground: object) -> float:
    """Rolling resistance (N) against a forward speed (m/s); it fades at standstill."""
    weight = model.mass * GRAVITY_MPS2  # type: ignore[attr-defined]
    return ground.rolling * weight * forward / (abs(forward) + CREEP_MPS)  # type: ignore[attr-defined, no-any-return]


@compile_function
def compute_friction_curve_share(rolling: float, sliding: float, ground: object) -> float:
    """Share of a wheel's side force by the friction curve of the ground, at its slip or at the eased one."""
    size = max(abs(rolling), CREEP_MPS)
    if ground.ease > 0.0:  # type: ignore[attr-defined]
        size = abs(rolling) + ground.ease  # type: ignore[attr-defined]
    return compute_friction_share(
        math.atan(sliding / size),
        ground.peak_slip, ground.peak, ground.slide_slip, ground.slide,  # type: ignore[attr-defined]
    )  # fmt: skip


@inline_function
def compute_wheel_motion(
    forward: float, right: float, spin: float, tangent: float, front: float, rear: float, half: float
) -> tuple[float, float, float, float, float, float, float, float, float, float, float]:
    """Directions, sliding and rolling of the wheels of a body.

    Cosine and sine of the direction of the left, then of the right front wheel; speeds (m/s) across that direction of
    the left front, the right front and either rear wheel; speeds along it of front left, front right, rear left and
    rear right. `front` and `rear` are the distances from the centre of mass to the axles, `half` is half the track (m).
    """
    cos_1, sin_1, cos_2, sin_2 = compute_ackermann_directions(tangent, half * (1.0 / (front + rear)))
    left, right_side, v = forward + half * spin, forward - half * spin, right + front * spin
    rolling_1, sliding_1 = left * cos_1 + v * sin_1, v * cos_1 - left * sin_1
    rolling_2, sliding_2 = right_side * cos_2 + v * sin_2, v * cos_2 - right_side * sin_2
    sliding = right - rear * spin
    return cos_1, sin_1, cos_2, sin_2, sliding_1, sliding_2, sliding, rolling_1, rolling_2, left, right_side


@inline_function
def compute_half_load(model: object) -> float:
    """Half the weight per wheelbase (N/m): times the distance of the other axle it is the load of a wheel."""
    return 0.5 * (model.mass * GRAVITY_MPS2) * (1.0 / (model.front + model.rear))  # type: ignore[attr-defined, no-any-return]


@inline_function
def compute_velocity_changes(
    forward: float, right: float, spin: float, force: float, dt: float,
    cos_1: float, sin_1: float, cos_2: float, sin_2: float, sliding_1: float, sliding_2: float, sliding: float,
    d_1: float, d_2: float, d_3: float, d_4: float,
    front: float, rear: float, half: float, mass: float, inertia: float,
) -> tuple[float, float, float]:  # fmt: skip
    """Changes of the forward and right speed and the spin in `dt`, from the motion and damping of the wheels.

    `d_1` to `d_4` are damping times dt (N s2/m) of the front left, front right, rear left and rear right wheel, `force`
    is drive less rolling resistance (N). Takes numbers instead of records, which would prevent vectorised loops.
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


def _make_step(shaped: bool, slips: bool = False) -> StepFunction:
    """The step for plain tyres, or with friction curve and friction circle, or on soil that wheels slip on.

    Both are constants at compile time, so that the plain step, which plans use, costs nothing more. With `slips` the
    step takes the thrust of the driven wheels as well (N).
    """

    @compile_function
    def step(
        forward: float, right: float, spin: float, tangent: float, drive: float, dt: float,
        model: object, ground: object, thrust: float = 0.0,
    ) -> tuple[float, float, float]:  # fmt: skip
        front, rear, half = model.front, model.rear, 0.5 * model.track  # type: ignore[attr-defined]
        cos_1, sin_1, cos_2, sin_2, sliding_1, sliding_2, sliding, rolling_1, rolling_2, left, right_side = (
            compute_wheel_motion(forward, right, spin, tangent, front, rear, half)
        )
        load = dt * compute_half_load(model)
        # Side slope of one front and one rear wheel under its load, times `dt` (N s).
        front_damping, rear_damping = load * model.rear * ground.front_slope, load * model.front * ground.rear_slope  # type: ignore[attr-defined]
        front_limit, rear_limit = ground.front_limit, ground.rear_limit  # type: ignore[attr-defined]
        if slips:
            front_limit, rear_limit = compute_soil_limits(thrust, model, ground)
        d_1 = compute_side_resistance(rolling_1, sliding_1, front_damping, front_limit)
        d_2 = compute_side_resistance(rolling_2, sliding_2, front_damping, front_limit)
        d_3 = compute_side_resistance(left, sliding, rear_damping, rear_limit)
        d_4 = compute_side_resistance(right_side, sliding, rear_damping, rear_limit)
        if shaped:
            grip = 2.0 * compute_half_load(model) * front * ground.grip  # type: ignore[attr-defined]
            drive = min(max(drive, -grip), grip)
            share = compute_friction_circle_share(drive, grip)
            d_1 *= compute_friction_curve_share(rolling_1, sliding_1, ground)
            d_2 *= compute_friction_curve_share(rolling_2, sliding_2, ground)
            d_3 *= share * compute_friction_curve_share(left, sliding, ground)
            d_4 *= share * compute_friction_curve_share(right_side, sliding, ground)
        resistance = compute_rolling_resistance(forward, model, ground)
        forward_change, right_change, spin_change = compute_velocity_changes(
            forward, right, spin, drive - resistance, dt, cos_1, sin_1, cos_2, sin_2, sliding_1, sliding_2, sliding,
            d_1, d_2, d_3, d_4,
            front, rear, half, model.mass, model.inertia,  # type: ignore[attr-defined]
        )  # fmt: skip
        return forward + forward_change, right + right_change, spin + spin_change

    return step


_plain_step, _shaped_step, _soil_step = _make_step(False), _make_step(True), _make_step(False, True)


@compile_function
def step_body(
    forward: float, right: float, spin: float, tangent: float, drive: float, dt: float, model: object, ground: object
) -> tuple[float, float, float]:
    """Velocities after `dt`: forward and right (m/s) and clockwise spin (rad/s) in the body frame.

    `tangent` belongs to the mean front wheel angle, `drive` is the force of the rear wheels (N); `model` and `ground`
    are records of vehicle.records. The centre of mass determines the load per axle, which its two wheels share.
    """
    if ground.shaped != 0.0:  # type: ignore[attr-defined]
        return _shaped_step(forward, right, spin, tangent, drive, dt, model, ground)
    return _plain_step(forward, right, spin, tangent, drive, dt, model, ground)


@compile_function
def step_loaded_body(
    forward: float, right: float, spin: float, tangent: float, drive: float, thrust: float, dt: float,
    model: object, ground: object,
) -> tuple[float, float, float]:  # fmt: skip
    """As step_body, for a tractor with a load: on a soil with a cone index its tyres hold as much as that bears.

    `thrust` is the force of the driven wheels (N), of which slope and implement have taken their part in `drive`.
    """
    if model.driven_weight > 0.0:  # type: ignore[attr-defined]
        return _soil_step(forward, right, spin, tangent, drive, dt, model, ground, thrust)
    return step_body(forward, right, spin, tangent, drive, dt, model, ground)


@compile_function
def step_steering_system(state, model, dt) -> None:  # type: ignore[no-untyped-def]
    """Advance the steering system by `dt`: the delayed command, Eq. 2.8, and the play behind the sensor."""
    command = state.command
    if model.affected != 0.0:
        state.commands[state.clock % len(state.commands)] = command
        command = read_delayed(state.commands, state.clock, min(model.dead_steps, float(state.clock)))
    state.steering, state.stage = step_steering_simulator(
        state.steering, command, state.stage, dt,
        model.dead_band, model.switch, model.rate, model.lag, model.gain, model.latch,
    )  # fmt: skip
    if model.affected != 0.0:
        state.play = apply_play(state.play, state.steering, model)


@inline_function
def compute_wanted_drive(state, model, ground, forward, dt) -> float:  # type: ignore[no-untyped-def]
    """Drive force (N) that the speed controller would give on level ground without a load, and without limits."""
    target = state.target_speed
    if model.affected != 0.0:
        target = compute_ground_speed(target, state.working, model)
    before = state.reference_speed
    if model.affected != 0.0 and model.speed_lag > 0.0:
        target = apply_lag(before, target, model.speed_lag, dt)
    state.reference_speed = apply_ramp(before, target, model.acceleration * dt)
    error, per_second = state.reference_speed - forward, 1.0 / dt
    state.integral = min(max(state.integral + error * dt, -2.0), 2.0)
    drive = compute_drive_force(
        error, state.integral, (error - state.last_error) * per_second, model.kp, model.ki, model.kd, model.max_drive
    )
    state.last_error = error
    # Feed-forward of the reference acceleration; the controller only corrects the remaining error.
    drive += model.mass * (state.reference_speed - before) * per_second
    share = state.reference_speed / (abs(state.reference_speed) + 0.05)
    drive += ground.rolling * model.mass * GRAVITY_MPS2 * share
    if target == 0.0 and state.reference_speed == 0.0 and abs(forward) < STANDSTILL_MPS:
        state.integral = 0.0  # the brake holds
        drive = -model.mass * forward * per_second
    return float(drive)


@compile_function
def step_speed_control(state, model, ground, forward, dt) -> float:  # type: ignore[no-untyped-def]
    """Drive force (N) of the speed controller for the target speed in the state, at the speed over ground `forward`."""
    drive = compute_wanted_drive(state, model, ground, forward, dt)
    return float(min(max(drive, -model.max_drive), model.max_drive))


@compile_function
def step_loaded_drive(  # type: ignore[no-untyped-def]
    state, model, ground, forward, spin, cosine, sine, dt
) -> tuple[float, float]:
    """As step_speed_control, on terrain or with a load: the force ahead (N) of wheels, slope and implement together,
    and the speed to the right (m/s) that the slope gives in `dt`.

    The speed controller knows slope and draft, as a governor feels them. `spin` is counter-clockwise. Across a slope a
    wheel creeps in proportion to its speed; as slip angles of slower wheels are computed for CREEP_MPS, the push is
    less by as much, so that a tractor that stands stays. Tyres with a friction circle take the force for that of the
    wheels alone: they are for trials on level ground.
    """
    ahead, aside = compute_slopes(state, cosine, sine)
    pull = compute_pull(model, ground, ahead, forward, state.working)
    drive = compute_wanted_drive(state, model, ground, forward, dt) + pull
    note_overturning(state, aside, forward, spin)
    creep = min(abs(forward) * (1.0 / CREEP_MPS), 1.0)
    return limit_drive(state, model, ground, drive, forward, dt) - pull, -dt * creep * GRAVITY_MPS2 * aside
