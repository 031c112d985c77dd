"""The compiled loop of the trials: the same functions as vehicle.loop, every step recorded, no contacts.

Tractors of one space may stand on different tyres, so that a sweep is one call.
"""

from __future__ import annotations

from vehicle.control import control_tick
from vehicle.engine import (
    EACH_BODY,
    GET_BODY,
    READ_DATA,
    READ_WIDTH,
    SET_BODY,
    SPACE,
    STEP,
    WRITE_DATA,
    WRITE_WIDTH,
    call_each,
    call_step,
)
from vehicle.gnss import draw_error
from vehicle.jit import compiled
from vehicle.loop import drive_tractor

# Columns of the track: the body as pymunk has it, then steering (rad) and what the controller knew.
COLUMNS = ("x", "y", "angle", "vx", "vy", "spin", "steering", "command", "stage", "lateral", "leg", "done")


@compiled
def run_trials(  # type: ignore[no-untyped-def]
    steps, dt, every, keep, addresses, read, write, read_count, write_count, states, models, grounds, tables, legs,
    gates, points, cumulative, commands, position_errors, track,
) -> int:  # fmt: skip
    """Drive all tractors for `steps` of `dt`, on their paths or, when there are `commands` (steps, n), by these.

    `tables` (grounds, k) are the steering tables; the last one serves all further grounds. Control comes every `every`
    steps; every `keep`-th step goes into `track` (rows, n, columns). Returns the rows filled: fewer than asked for
    once all tractors are done.
    """
    count, rows = len(states), 0
    for step in range(steps):
        read_count[0] = 0
        call_each(addresses[EACH_BODY], addresses[SPACE], addresses[GET_BODY], addresses[READ_DATA])
        for i in range(count):
            state = states[i]
            state.x, state.y, state.angle = read[READ_WIDTH * i], read[READ_WIDTH * i + 1], read[READ_WIDTH * i + 2]
            if len(commands) > 0:
                state.command, state.target_speed = commands[step, i], legs[state.leg].speed
        if len(commands) == 0 and step % every == 0:
            running = 0
            for i in range(count):
                if len(position_errors) > 0:
                    draw_error(states[i], position_errors)
                control_tick(i, states, models, legs, gates, points, cumulative, step * dt, every * dt)
                running += 1 - states[i].done
            if running == 0:
                return rows
        for i in range(count):
            state = states[i]
            ground = legs[state.leg].ground
            drive_tractor(
                state, models[state.model], grounds, ground,
                tables[min(ground, len(tables) - 1)],
                read[READ_WIDTH * i : READ_WIDTH * (i + 1)], write[WRITE_WIDTH * i : WRITE_WIDTH * (i + 1)], dt,
            )  # fmt: skip
        if step % keep == 0:
            for i in range(count):
                note_step(track[rows, i], read[READ_WIDTH * i : READ_WIDTH * (i + 1)], states[i])
            rows += 1
        write_count[0] = 0
        call_each(addresses[EACH_BODY], addresses[SPACE], addresses[SET_BODY], addresses[WRITE_DATA])
        call_step(addresses[STEP], addresses[SPACE], dt)
    return rows


@compiled
def note_step(row, body, state) -> None:  # type: ignore[no-untyped-def]
    """Write the columns of one tractor at one step: the body before the step, the steering that acts during it."""
    for column in range(READ_WIDTH):
        row[column] = body[column]
    row[6], row[7], row[8] = state.steering, state.command, float(state.stage)
    row[9], row[10], row[11] = state.lateral, float(state.leg - state.first_leg), float(state.done)
