"""One tractor moved step by step without a pymunk space, as it touches nothing; its noise, and hidden effects.

The forces are those of vehicle.sim.loop, and the body moves as in pymunk: place and angle with the velocity before the
step, then velocity with the force. So states can be copied, restored and driven again at little cost.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fields.arrays import Floats, Records
from vehicle.control.guidance import run_control_tick
from vehicle.jit import compile_function
from vehicle.model.effects import get_effect
from vehicle.model.instruments import add_heading_bias, apply_lever_arm, show_late_pose
from vehicle.model.tractor import EffectSetting, Implement, Tractor
from vehicle.records import DT_S, STATE
from vehicle.sim.calibration import build_steering_tables
from vehicle.sim.compile import build_ground_records, build_model_record
from vehicle.sim.loop import drive_tractor


@dataclass(frozen=True)
class TractorNoise:
    """Standard deviations of noise.

    White noise and slow drift (memory 60 s) of position (m) and heading (rad), white noise of speed (m/s), turning by
    the soil (rad per m driven, memory 0.5 s) and scatter of the distance (m per root second). The values are chosen, of
    RTK with two antennas on ordinary soil.
    """

    position_m: float = 0.010
    position_drift_m: float = 0.015
    heading_rad: float = 0.002
    heading_drift_rad: float = 0.0017
    speed_mps: float = 0.02
    soil_per_m: float = 0.0025
    along_m: float = 0.006

    def scale(self, factor: float) -> TractorNoise:
        """All noise times a factor."""
        return TractorNoise(*(factor * getattr(self, name) for name in self.__dataclass_fields__))


NO_NOISE = TractorNoise().scale(0.0)


@dataclass(frozen=True, eq=False)
class TractorArrays:
    """A tractor with its implement as arrays: models (1,), grounds (g,), tables (g, k), antenna ahead and to the right
    of the centre of mass (m), and latency of positions (s), all from the file with its effects."""

    models: Records
    grounds: Records
    tables: Floats
    ahead_m: float
    right_m: float
    latency_s: float
    steps_per_tick: int

    @property
    def bias_rad(self) -> float:
        """Shown heading less true heading."""
        return float(self.models["heading_bias"][0])

    def locate_antenna(self, pose: Floats) -> tuple[float, float]:
        """East and north (m) of the antenna of a body at a pose (x, y, angle)."""
        return locate_lever(pose, self.ahead_m, self.right_m)


def make_tractor_arrays(tractor: Tractor, implement: Implement) -> TractorArrays:
    """The arrays of a tractor."""
    models = np.array([build_model_record(tractor, implement)])
    model = models[0]
    return TractorArrays(
        models,
        build_ground_records(),
        build_steering_tables(tractor),
        float(model["guide"] + model["shift_forward"]),
        float(tractor.antenna_right_m + model["shift_right"]),
        float(model["latency"] * DT_S),
        tractor.guidance.count_steps(DT_S),
    )


def add_hidden_effects(tractor: Tractor, hidden_effects: Mapping[str, float | Mapping[str, float]]) -> Tractor:
    """The tractor with effects on top of those of its file; a number stands for the first parameter of an effect.

    Raises VehicleError for an unknown effect or a value it cannot have.
    """
    settings = dict(tractor.effects)
    for name, value in hidden_effects.items():
        values = dict(value) if isinstance(value, Mapping) else {get_effect(name).size.name: float(value)}
        settings[name] = EffectSetting(value=values)
    return Tractor.model_validate(tractor.model_dump() | {"effects": {k: v.model_dump() for k, v in settings.items()}})


def create_state(steering_rad: float = 0.0, speed_mps: float = 0.0) -> Records:
    """A STATE record (1,) of a tractor with its wheels at an angle, at a speed."""
    state = np.zeros(1, dtype=STATE)
    state["stage"] = 1
    state["steering"] = state["command"] = state["play"] = steering_rad
    state["commands"] = steering_rad
    state["reference_speed"] = state["target_speed"] = state["forward"] = speed_mps
    return state


def create_body(x_m: float, y_m: float, angle_rad: float, speed_mps: float = 0.0) -> Floats:
    """A body (6,) with BODY_COLUMNS: place, angle, velocity, spin."""
    velocity = speed_mps * math.cos(angle_rad), speed_mps * math.sin(angle_rad)
    return np.array([x_m, y_m, angle_rad, *velocity, 0.0])


def locate_lever(pose: Floats, ahead_m: float, right_m: float) -> tuple[float, float]:
    """East and north (m) of a point `ahead_m` and `right_m` of the centre of mass of a body at a pose (x, y, angle)."""
    x, y, angle = (float(value) for value in pose)
    cosine, sine = math.cos(angle), math.sin(angle)
    return x + ahead_m * cosine + right_m * sine, y + ahead_m * sine - right_m * cosine


@compile_function
def move_body(body, force, mass, inertia, dt) -> None:  # type: ignore[no-untyped-def]
    """Move a body (6,) by one step under a force (3,), in the order of pymunk: place first, then velocity."""
    body[0] += body[3] * dt
    body[1] += body[4] * dt
    body[2] += body[5] * dt
    body[3] += force[0] * (1.0 / mass) * dt
    body[4] += force[1] * (1.0 / mass) * dt
    body[5] += force[2] * (1.0 / inertia) * dt


@compile_function
def turn_body(body, angle) -> None:  # type: ignore[no-untyped-def]
    """Turn a body and its velocity on the spot by an angle (rad, counter-clockwise)."""
    cosine, sine = math.cos(angle), math.sin(angle)
    vx, vy = body[3], body[4]
    body[2] += angle
    body[3], body[4] = vx * cosine - vy * sine, vx * sine + vy * cosine


@compile_function
def run_mission_steps(  # type: ignore[no-untyped-def]
    steps, dt, steps_per_tick, clock, body, states, models, grounds, tables,
    legs, gates, points, cumulative, commands, errors, pushes, soil_memory,
) -> None:  # fmt: skip
    """Drive tractor 0 of `states` for `steps` steps, on its legs or by `commands` (automatic, steering, speed, halted).

    `clock` (1,) is the step count and is updated, `errors` (ticks, 2) are position errors of guidance. The first column
    of `pushes` (steps, 2) is unit noise of the soil, with `soil_memory` (3,) its present value, its persistence per
    step and the size of new noise; the second column is scatter of the distance (m per step).
    """
    state, model = states[0], models[0]
    force = np.zeros(3)
    tick = 0
    for step in range(steps):
        ground = legs[state.leg].ground
        if clock[0] % steps_per_tick == 0:
            state.x, state.y, state.angle = body[0], body[1], body[2]
            if commands[0] != 0.0:
                state.error_x, state.error_y = errors[tick, 0], errors[tick, 1]
                run_control_tick(0, states, models, legs, gates, points, cumulative, clock[0] * dt, steps_per_tick * dt)
            else:
                state.command, state.target_speed, state.working = commands[1], commands[2], 0.0
            if commands[3] != 0.0:
                state.target_speed = 0.0
            tick += 1
        drive_tractor(state, model, grounds, ground, tables[ground], body, force, dt)
        move_body(body, force, model.mass, model.inertia, dt)
        soil_memory[0] = soil_memory[1] * soil_memory[0] + soil_memory[2] * pushes[step, 0]
        pace = abs(state.forward)
        if soil_memory[2] > 0.0:
            turn_body(body, soil_memory[0] * pace * dt)
        scatter = pushes[step, 1] * min(pace, 1.0)
        body[0] += scatter * math.cos(body[2])
        body[1] += scatter * math.sin(body[2])
        clock[0] += 1


@compile_function
def measure_pose(state, model, body, ahead, aside) -> tuple[float, float, float]:  # type: ignore[no-untyped-def]
    """East and north of the antenna and the heading as instruments show them now, with latency and bias."""
    x, y, angle = body[0], body[1], body[2]
    shown = angle
    is_late = model.latency + model.position_late + model.heading_late + model.heading_filter > 0.0
    if model.affected != 0.0 and is_late and state.clock > 0:
        x, y, angle, shown = show_late_pose(state, model, x, y, angle)
    east, north = apply_lever_arm(x, y, math.cos(angle), math.sin(angle), ahead, aside)
    return east, north, add_heading_bias(shown, model.heading_bias)
