"""The compiled loop of the trials: the same functions as vehicle.loop, every step recorded, no contacts.

Tractors of one space may stand on different tyres, so that a sweep is one call.
"""

from __future__ import annotations

from vehicle.control import control_tick
from vehicle.door import look, motion, push, step
from vehicle.gnss import draw_error
from vehicle.jit import compiled
from vehicle.layout import BODY_WIDTH
from vehicle.loop import tractor_force

# Columns of the track: the body as pymunk has it, then steering (rad) and what the controller knew.
COLUMNS = ("x", "y", "angle", "vx", "vy", "spin", "steering", "command", "stage", "lateral", "leg", "done")


@compiled
def run_trials(  # type: ignore[no-untyped-def]
    steps, dt, every, keep, door, states, models, grounds, tables, legs, gates, points, cumulative, commands,
    position_errors, track,
) -> int:  # fmt: skip
    """Drive all tractors for `steps` of `dt`, on their paths or, when there are `commands` (steps, n), by these.

    `tables` (grounds, k) are the steering tables; the last one serves all further grounds. Control comes every `every`
    steps; every `keep`-th step goes into `track` (rows, n, columns). Returns the rows filled: fewer than asked for
    once all tractors are done.
    """
    count, rows = len(states), 0
    for done in range(steps):
        look(door)
        for i in range(count):
            state = states[i]
            state.x, state.y, state.angle = motion(door, i)[:3]
            if len(commands) > 0:
                state.command, state.target_speed = commands[done, i], legs[state.leg].speed
        if len(commands) == 0 and done % every == 0:
            running = 0
            for i in range(count):
                if len(position_errors) > 0:
                    draw_error(states[i], position_errors)
                control_tick(i, states, models, legs, gates, points, cumulative, done * dt, every * dt)
                running += 1 - states[i].done
            if running == 0:
                return rows
        for i in range(count):
            state, body = states[i], motion(door, i)
            ground = legs[state.leg].ground
            table = tables[min(ground, len(tables) - 1)]
            push(door, i, tractor_force(state, models[state.model], grounds[ground], table, body, dt))
            if done % keep == 0:
                note_step(track[rows, i], body, state)
        rows += done % keep == 0
        step(door, dt)
    return rows


@compiled
def note_step(row, body, state) -> None:  # type: ignore[no-untyped-def]
    """Write the columns of one tractor at one step: the body before the step, the steering that acts during it."""
    for column in range(BODY_WIDTH):
        row[column] = body[column]
    row[6], row[7], row[8] = state.steering, state.command, float(state.stage)
    row[9], row[10], row[11] = state.lateral, float(state.leg - state.first_leg), float(state.done)
