"""The loop in plain Python with pymunk's ordinary API.

It is the oracle the compiled loop is compared with, and what runs when pymunk's batch layout is not the known one.
The formulas are the same functions; how bodies are read, pushed, stepped and watched for contact is written anew.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pymunk

from vehicle.clearance import closest_pair
from vehicle.control import control_tick
from vehicle.gnss import draw_error
from vehicle.loop import ALL_DONE, RUNNING, STALLED, TOO_CLOSE, drive_tractor, note

if TYPE_CHECKING:
    from vehicle.world import World


def run_slow(
    world: World, steps: int, dt: float, record: Any, stop_clearance: float, stall_s: float
) -> tuple[int, int, int, int]:
    """As vehicle.loop.run_loop, for a World; returns outcome, record rows and the closest pair."""
    program, states = world.program, world.program.states.view(np.recarray)
    models, grounds = world.models.view(np.recarray), world.grounds.view(np.recarray)
    legs, gates = program.legs.view(np.recarray), program.gates.view(np.recarray)
    _watch_contacts(world)
    rows = 0
    for _ in range(steps):
        step = int(world.clock[0])
        time = step * dt
        if step % world.every == 0:
            _read_poses(world)
            if len(world.fixes):
                for state in states:
                    draw_error(state, world.fixes)
            for me in range(len(states)):
                control_tick(
                    me, states, models, legs, gates, program.points, program.cumulative, time, world.every * dt
                )
            note(record, rows, states)
            rows += 1
            outcome, pair = _judge(world, time, stop_clearance, stall_s)
            if outcome != RUNNING:
                return outcome, rows, *pair
        for index, body in enumerate(world.bodies):
            ground = int(legs[states[index].leg].ground)
            pose = np.array([*body.position, body.angle, *body.velocity, body.angular_velocity])
            push = np.zeros(3)
            model = int(states[index].model)
            drive_tractor(
                states[index], models[model], grounds, ground, world.tables[model, ground], pose, push, dt
            )
            body.force, body.torque = (push[0], push[1]), push[2]
        world.space.step(dt)
        world.clock[0] += 1.0
    return RUNNING, rows, -1, -1


def _read_poses(world: World) -> None:
    for state, body in zip(world.program.states, world.bodies, strict=True):
        state["x"], state["y"] = body.position
        state["angle"] = body.angle


def _judge(world: World, time: float, stop_clearance: float, stall_s: float) -> tuple[int, tuple[int, int]]:
    states = world.program.states
    if len(states) > 1:
        closest, first, second = closest_pair(states, world.models, world.clearances)
        if closest < stop_clearance:
            return TOO_CLOSE, (first, second)
    if (states["done"] == 1).all():
        return ALL_DONE, (-1, -1)
    total = float(states["progress"].sum())
    if total > world.clock[1] + 0.05:
        world.clock[1], world.clock[2] = total, time
    elif time - world.clock[2] > stall_s:
        return STALLED, (-1, -1)
    return RUNNING, (-1, -1)


def _watch_contacts(world: World) -> None:
    """Note every touch in the same table the compiled loop uses."""

    def touched(arbiter: pymunk.Arbiter, space: pymunk.Space, data: Any) -> None:
        used = int(world.contacts[-1, 0])
        if used < len(world.contacts) - 1:
            first, second = (shape.body.id for shape in arbiter.shapes if shape.body)
            world.contacts[used] = world.clock[0] * (1.0 / 60.0), first, second
            world.contacts[-1, 0] += 1.0

    world.space.on_collision(None, None, begin=touched)
