"""The compiled loop without pymunk: the same formulas on plain arrays, no shapes, no contacts.

Its time is that of the formulas; the remaining time of the full loop is pymunk.
"""

from typing import Any

import numba
import numpy as np

from vehicle.control.guidance import run_control_tick
from vehicle.jit import drop_owner
from vehicle.records import DT_S
from vehicle.sim.clearance import find_too_close
from vehicle.sim.loop import drive_tractor, write_record_row
from vehicle.sim.world import World


@numba.njit(error_model="numpy")  # type: ignore[untyped-decorator]
def run_bare_steps(  # type: ignore[no-untyped-def]
    steps, dt, every, bodies, force, states, models, grounds, tables, legs, gates, points, cumulative, record,
    clearances,
):  # fmt: skip
    """Advance `bodies` (n, 6: x, y, angle, vx, vy, spin) as pymunk does: places first, with the old velocity."""
    bodies, force, states, models = drop_owner(bodies), drop_owner(force), drop_owner(states), drop_owner(models)
    grounds, tables, legs, gates = drop_owner(grounds), drop_owner(tables), drop_owner(legs), drop_owner(gates)
    points, cumulative, record, clearances = (
        drop_owner(points),
        drop_owner(cumulative),
        drop_owner(record),
        drop_owner(clearances),
    )
    count = len(states)
    for step in range(steps):
        if step % every == 0:
            for i in range(count):
                states[i].x, states[i].y, states[i].angle = bodies[i, 0], bodies[i, 1], bodies[i, 2]
            for i in range(count):
                run_control_tick(i, states, models, legs, gates, points, cumulative, step * dt, every * dt)
            write_record_row(record, step // every, states)
            find_too_close(states, models, clearances, -1.0, -1.0)
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
    """The bodies and arrays of a World, driven without pymunk."""

    def __init__(self, world: World, steps: int) -> None:
        self.world = world
        self.bodies = np.array([[*b.position, b.angle, *b.velocity, b.angular_velocity] for b in world.bodies])
        self.record: Any = np.empty((steps // world.steps_per_tick + 1, len(world.bodies), 7))

    def run(self, steps: int) -> None:
        """Advance by `steps` of 1/60 s."""
        world, program = self.world, self.world.program
        run_bare_steps(
            steps, DT_S, world.steps_per_tick, self.bodies, np.zeros(3), program.states, world.models, world.grounds,
            world.tables, program.legs, program.gates, program.points, program.cumulative, self.record,
            world.clearances,
        )  # fmt: skip
