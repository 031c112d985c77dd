"""Steering system and drive line of one tractor: from commands to wheel angle and drive force.

The loop of planning and the replay of measured logs call the same two functions.
"""

from __future__ import annotations

from vehicle.chassis import GRAVITY
from vehicle.jit import compiled
from vehicle.speed import drive_force, lagging, ramp
from vehicle.steering import steering_step
from vehicle.terms import delayed, ground_speed, played

STOPPED_MPS = 0.03


@compiled
def turn_wheels(state, model, dt) -> None:  # type: ignore[no-untyped-def]
    """Advance the steering system by `dt`: the late command, Eq. 2.8, and the play behind the sensor."""
    command = state.command
    if model.affected != 0.0:
        state.commands[state.clock % len(state.commands)] = command
        command = delayed(state.commands, state.clock, min(model.dead_steps, float(state.clock)))
    state.steering, state.stage = steering_step(
        state.steering, command, state.stage, dt,
        model.dead_band, model.switch, model.rate, model.lag, model.gain, model.latch,
    )  # fmt: skip
    if model.affected != 0.0:
        state.play = played(state.play, state.steering, model)


@compiled
def propel(state, model, ground, forward, dt) -> float:  # type: ignore[no-untyped-def]
    """Drive force (N) of the speed controller for the target speed in the state, at a speed over ground."""
    target = state.target_speed
    if model.affected != 0.0:
        target = ground_speed(target, state.working, model)
    before = state.reference_speed
    if model.affected != 0.0 and model.speed_lag > 0.0:
        target = lagging(before, target, model.speed_lag, dt)
    state.reference_speed = ramp(before, target, model.acceleration * dt)
    error, per_second = state.reference_speed - forward, 1.0 / dt
    state.integral = min(max(state.integral + error * dt, -2.0), 2.0)
    drive = drive_force(
        error, state.integral, (error - state.last_error) * per_second, model.kp, model.ki, model.kd, model.max_drive
    )
    state.last_error = error
    # What the reference asks for goes to the wheels at once; the controller only mends the rest.
    drive += model.mass * (state.reference_speed - before) * per_second
    share = state.reference_speed / (abs(state.reference_speed) + 0.05)
    drive += ground.rolling * model.mass * GRAVITY * share
    if target == 0.0 and state.reference_speed == 0.0 and abs(forward) < STOPPED_MPS:
        state.integral = 0.0  # the brake holds
        drive = -model.mass * forward * per_second
    return float(min(max(drive, -model.max_drive), model.max_drive))
