"""The compiled loop without pymunk: the same formulas on plain arrays, no shapes, no contacts.

What it costs is what the formulas cost; the rest of the finished loop's time is pymunk.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np

from vehicle.clearance import too_close
from vehicle.control import control_tick
from vehicle.jit import unowned
from vehicle.layout import DT_S
from vehicle.loop import drive_tractor, note
from vehicle.world import World


@numba.njit(error_model="numpy")  # type: ignore[untyped-decorator]
def bare_steps(  # type: ignore[no-untyped-def]
    steps, dt, every, bodies, force, states, models, grounds, tables, legs, gates, points, cumulative, record,
    clearances,
):  # fmt: skip
    """Advance `bodies` (n, 6: x, y, angle, vx, vy, spin) as pymunk does: places with the old velocity first."""
    bodies, force, states, models = unowned(bodies), unowned(force), unowned(states), unowned(models)
    grounds, tables, legs, gates = unowned(grounds), unowned(tables), unowned(legs), unowned(gates)
    points, cumulative, record, clearances = unowned(points), unowned(cumulative), unowned(record), unowned(clearances)
    count = len(states)
    for step in range(steps):
        if step % every == 0:
            for i in range(count):
                states[i].x, states[i].y, states[i].angle = bodies[i, 0], bodies[i, 1], bodies[i, 2]
            for i in range(count):
                control_tick(i, states, models, legs, gates, points, cumulative, step * dt, every * dt)
            note(record, step // every, states)
            too_close(states, models, clearances, -1.0, -1.0)
        for i in range(count):
            model = models[states[i].model]
            ground = legs[states[i].leg].ground
            drive_tractor(states[i], model, grounds, ground, tables[states[i].model, ground], bodies[i], force, dt)
            bodies[i, 0] += bodies[i, 3] * dt
            bodies[i, 1] += bodies[i, 4] * dt
            bodies[i, 2] += bodies[i, 5] * dt
            bodies[i, 3] += force[0] / model.mass * dt
            bodies[i, 4] += force[1] / model.mass * dt
            bodies[i, 5] += force[2] / model.inertia * dt


class BareWorld:
    """A World taken out of pymunk."""

    def __init__(self, world: World, steps: int) -> None:
        self.world = world
        self.bodies = np.array([[*b.position, b.angle, *b.velocity, b.angular_velocity] for b in world.bodies])
        self.record: Any = np.empty((steps // world.every + 1, len(world.bodies), 7))

    def run(self, steps: int) -> None:
        """Advance by `steps` of 1/60 s."""
        world, program = self.world, self.world.program
        bare_steps(
            steps, DT_S, world.every, self.bodies, np.zeros(3), program.states, world.models, world.grounds,
            world.tables, program.legs, program.gates, program.points, program.cumulative, self.record,
            world.clearances,
        )  # fmt: skip
