"""The loop in plain Python with pymunk's ordinary API.

It is the oracle the compiled loop is compared with, and what runs when pymunk's batch layout is not the known one.
The formulas are the same functions; how bodies are read, pushed, stepped and watched for contact is written anew.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import pymunk

from vehicle.bodies import ContactBoxes
from vehicle.clearance import too_close
from vehicle.compile import CompiledPlan
from vehicle.control import control_tick
from vehicle.gnss import draw_error
from vehicle.loop import ALL_DONE, APART, GETS_ON_M, RUNNING, STALLED, TOO_CLOSE, drive_tractor, note

Array = npt.NDArray[Any]


@dataclass(frozen=True, eq=False)
class Scene:
    """What the compiled loop is given as arrays, with the bodies as pymunk's own objects; arrays are written to."""

    space: pymunk.Space
    bodies: list[pymunk.Body]
    boxes: ContactBoxes
    program: CompiledPlan
    models: Array
    grounds: Array
    tables: Array
    position_errors: Array
    every: int
    clock: Array
    clearances: Array
    contacts: Array


def run_slow(
    scene: Scene, steps: int, dt: float, record: Any, stop: tuple[float, float], stall_s: float
) -> tuple[int, int, int, int]:
    """As vehicle.loop.run_loop, for a scene; returns outcome, record rows and the closest pair."""
    program, states = scene.program, scene.program.states.view(np.recarray)
    models, grounds = scene.models.view(np.recarray), scene.grounds.view(np.recarray)
    legs, gates = program.legs.view(np.recarray), program.gates.view(np.recarray)
    _watch_contacts(scene, dt)
    rows = 0
    for _ in range(steps):
        step = int(scene.clock[0])
        time = step * dt
        if step % scene.every == 0:
            _read_poses(scene)
            if len(scene.position_errors):
                for state in states:
                    draw_error(state, scene.position_errors)
            for me in range(len(states)):
                control_tick(
                    me, states, models, legs, gates, program.points, program.cumulative, time, scene.every * dt
                )
            scene.boxes.wanted[:] = (states["away"] == 0) & (stop[0] > APART)
            scene.boxes.bring()
            note(record, rows, states)
            rows += 1
            outcome, pair = _judge(scene, time, stop, stall_s)
            if outcome != RUNNING:
                return outcome, rows, *pair
        for index, body in enumerate(scene.bodies):
            ground = int(legs[states[index].leg].ground)
            pose = np.array([*body.position, body.angle, *body.velocity, body.angular_velocity])
            push = np.zeros(3)
            model = int(states[index].model)
            drive_tractor(
                states[index], models[model], grounds, ground, scene.tables[model, ground], pose, push, dt
            )
            body.force, body.torque = (push[0], push[1]), push[2]
        scene.space.step(dt)
        scene.clock[0] += 1.0
    return RUNNING, rows, -1, -1


def _read_poses(scene: Scene) -> None:
    for state, body in zip(scene.program.states, scene.bodies, strict=True):
        state["x"], state["y"] = body.position
        state["angle"] = body.angle


def _judge(scene: Scene, time: float, stop: tuple[float, float], stall_s: float) -> tuple[int, tuple[int, int]]:
    states = scene.program.states
    if len(states) > 1 and stop[0] > APART:
        _, first, second = too_close(states, scene.models, scene.clearances, *stop)
        if first >= 0:
            return TOO_CLOSE, (first, second)
    if (states["done"] == 1).all():
        return ALL_DONE, (-1, -1)
    total = float(states["progress"].sum())
    standing = ((states["stand_left"] > 0.0) & (states["started"] == 1)).any()
    if total > scene.clock[1] + GETS_ON_M or standing:
        scene.clock[1], scene.clock[2] = total, time
    elif time - scene.clock[2] > stall_s:
        return STALLED, (-1, -1)
    return RUNNING, (-1, -1)


def _watch_contacts(scene: Scene, dt: float) -> None:
    """Note every touch in the same table the compiled loop uses."""

    def touched(arbiter: pymunk.Arbiter, space: pymunk.Space, data: Any) -> None:
        used = int(scene.contacts[-1, 0])
        if used < len(scene.contacts) - 1:
            first, second = (shape.body.id for shape in arbiter.shapes if shape.body)
            scene.contacts[used] = scene.clock[0] * dt, first, second
            scene.contacts[-1, 0] += 1.0

    scene.space.on_collision(None, None, begin=touched)
