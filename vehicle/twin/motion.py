"""One tractor moved step by step without a pymunk space: it touches nothing, so nothing is lost.

The forces are those of vehicle.loop, and the body is moved as pymunk moves it: place and angle with the velocity before
the step, then velocity with the force. A state can so be copied, wound back and driven again, many at little cost.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from vehicle.calibration import steering_tables
from vehicle.compile import compile_grounds, compile_model
from vehicle.control import control_tick
from vehicle.effects import effect
from vehicle.instruments import late_pose, lever, shown_heading
from vehicle.jit import compiled
from vehicle.layout import DT_S, STATE
from vehicle.loop import drive_tractor
from vehicle.tractor import EffectSetting, Implement, Tractor

Array = npt.NDArray[np.float64]
Records = npt.NDArray[Any]
SOIL_MEMORY_S, DRIFT_MEMORY_S = 0.5, 60.0  # of vehicle.measured.surprise.whitening


@dataclass(frozen=True)
class Noise:
    """Standard deviations of what no model foretells.

    White noise and slow drift (memory 60 s) of position (m) and heading (rad), white noise of speed (m/s), the soil
    that turns a tractor (rad per m driven, memory 0.5 s) and scatter of the way (m per root second). The values are
    those with which `headland diagnose --demo` makes logs: RTK with two antennas, ordinary soil.
    """

    position_m: float = 0.010
    position_drift_m: float = 0.015
    heading_rad: float = 0.002
    heading_drift_rad: float = 0.0017
    speed_mps: float = 0.02
    soil_per_m: float = 0.0025
    along_m: float = 0.006

    def scaled(self, factor: float) -> Noise:
        """All of it larger by a factor."""
        return Noise(*(factor * getattr(self, name) for name in self.__dataclass_fields__))


NO_NOISE = Noise().scaled(0.0)


@dataclass(frozen=True, eq=False)
class Machine:
    """A tractor with its implement as arrays: models (1,), grounds (g,), tables (g, k), antenna from the centre of
    mass ahead and to the right (m), and how late positions are (s), all as the file says with its effects."""

    models: Records
    grounds: Records
    tables: Array
    ahead_m: float
    right_m: float
    late_s: float
    every: int

    @property
    def bias_rad(self) -> float:
        """What the compass shows more than the heading."""
        return float(self.models["heading_bias"][0])


def make_machine(tractor: Tractor, implement: Implement) -> Machine:
    """The arrays of a tractor."""
    models = np.array([compile_model(tractor, implement)])
    model = models[0]
    return Machine(
        models, compile_grounds(), steering_tables(tractor),
        float(model["guide"] + model["shift_forward"]), float(tractor.antenna_right_m + model["shift_right"]),
        float(model["latency"] * DT_S), max(1, round(1.0 / (tractor.guidance.rate_hz * DT_S))),
    )  # fmt: skip


def with_hidden(tractor: Tractor, hidden: Mapping[str, float | Mapping[str, float]]) -> Tractor:
    """The tractor with effects on top of those of its file; a number stands for the first parameter of an effect.

    Raises VehicleError for an unknown effect or a value it cannot have.
    """
    settings = dict(tractor.effects)
    for name, value in hidden.items():
        values = dict(value) if isinstance(value, Mapping) else {effect(name).size.name: float(value)}
        settings[name] = EffectSetting(value=values)
    return Tractor.model_validate(tractor.model_dump() | {"effects": {k: v.model_dump() for k, v in settings.items()}})


def new_state(steering_rad: float = 0.0, speed_mps: float = 0.0) -> Records:
    """A STATE record (1,) of a tractor with its wheels at an angle, at a speed."""
    state = np.zeros(1, dtype=STATE)
    state["stage"] = 1
    state["steering"] = state["command"] = state["play"] = steering_rad
    state["commands"] = steering_rad
    state["reference_speed"] = state["target_speed"] = state["forward"] = speed_mps
    return state


def new_body(x_m: float, y_m: float, angle_rad: float, speed_mps: float = 0.0) -> Array:
    """A body (6,) as pymunk has it: place, angle, velocity, spin."""
    return np.array(
        [x_m, y_m, angle_rad, speed_mps * math.cos(angle_rad), speed_mps * math.sin(angle_rad), 0.0], dtype=np.float64
    )




@compiled
def move(body, force, mass, inertia, dt) -> None:  # type: ignore[no-untyped-def]
    """Move a body (6,) by one step under a force (3,), in the order of pymunk: place first, then velocity."""
    body[0] += body[3] * dt
    body[1] += body[4] * dt
    body[2] += body[5] * dt
    body[3] += force[0] * (1.0 / mass) * dt
    body[4] += force[1] * (1.0 / mass) * dt
    body[5] += force[2] * (1.0 / inertia) * dt


@compiled
def turn_body(body, angle) -> None:  # type: ignore[no-untyped-def]
    """Turn a body and its velocity on the spot by an angle (rad, counter-clockwise)."""
    cosine, sine = math.cos(angle), math.sin(angle)
    vx, vy = body[3], body[4]
    body[2] += angle
    body[3], body[4] = vx * cosine - vy * sine, vx * sine + vy * cosine


@compiled
def mission_steps(  # type: ignore[no-untyped-def]
    steps, dt, every, clock, body, states, models, grounds, tables, legs, gates, points, cumulative, given, errors,
    pushes, memory,
) -> None:  # fmt: skip
    """Drive tractor 0 of `states` for so many steps: on its legs, or by `given` (automatic, steering, speed, halted).

    `clock` (1,) is the step count and carried on, `errors` (ticks, 2) what guidance is wrong by at each tick,
    `pushes` (steps, 2) unit noise and `memory` (3,) the disturbance of the soil, how much of it stays per step, and
    the size of what comes anew; along the way the second column counts, in m per step.
    """
    state, model = states[0], models[0]
    force = np.zeros(3)
    tick = 0
    for step in range(steps):
        ground = legs[state.leg].ground
        if clock[0] % every == 0:
            state.x, state.y, state.angle = body[0], body[1], body[2]
            if given[0] != 0.0:
                state.error_x, state.error_y = errors[tick, 0], errors[tick, 1]
                control_tick(0, states, models, legs, gates, points, cumulative, clock[0] * dt, every * dt)
            else:
                state.command, state.target_speed, state.working = given[1], given[2], 0.0
            if given[3] != 0.0:
                state.target_speed = 0.0
            tick += 1
        drive_tractor(state, model, grounds, ground, tables[ground], body, force, dt)
        move(body, force, model.mass, model.inertia, dt)
        memory[0] = memory[1] * memory[0] + memory[2] * pushes[step, 0]
        pace = abs(state.forward)
        if memory[2] > 0.0:
            turn_body(body, memory[0] * pace * dt)
        scatter = pushes[step, 1] * min(pace, 1.0)
        body[0] += scatter * math.cos(body[2])
        body[1] += scatter * math.sin(body[2])
        clock[0] += 1


@compiled
def shown_pose(state, model, body, ahead, aside) -> tuple[float, float, float]:  # type: ignore[no-untyped-def]
    """East and north of the antenna and the heading as instruments show a body now, late and biased as it may be."""
    now, size = state.clock, len(state.xs)
    x, y, angle = body[0], body[1], body[2]
    if model.affected != 0.0 and model.latency > 0.0 and now > 0:
        place = now % size
        state.xs[place], state.ys[place], state.angles[place] = x, y, angle
        at = max(now - min(model.latency, size - 2.0), 0.0)
        before = min(int(at), now - 1)
        x, y, angle = late_pose(state.xs, state.ys, state.angles, before, float(before), before + 1.0, at)
    east, north = lever(x, y, math.cos(angle), math.sin(angle), ahead, aside)
    return east, north, shown_heading(angle, model.heading_bias)


