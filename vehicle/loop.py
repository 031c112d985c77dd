"""The compiled loop. It owns no formula: it reads the bodies, runs control and chassis, and steps the space.

Fast because no Python runs inside: bodies are read and written through the door of vehicle.engine, and everything else
is plain arrays of records.
"""

from __future__ import annotations

import math

from vehicle.chassis import body_step
from vehicle.clearance import look_around, too_close
from vehicle.control import control_tick
from vehicle.door import look, motion, push, step, touches, unowned_door
from vehicle.driveline import propel, turn_wheels
from vehicle.gnss import draw_error
from vehicle.jit import compiled, unowned
from vehicle.layout import (
    BODY_ANGLE,
    BODY_SPIN,
    BODY_VX,
    BODY_VY,
    BODY_X,
    BODY_Y,
    REC_ANGLE,
    REC_LEG,
    REC_SPEED,
    REC_STATUS,
    REC_STEERING,
    REC_X,
    REC_Y,
)
from vehicle.series import tangent
from vehicle.steering import corrected_angle
from vehicle.terms import affected_tangent, ground_drift

# Nothing moves so slowly (m/s, rad/s). What dies away on a straight line gets ever smaller, and below 1e-307 processors
# calculate many times slower; the cube of this is above.
AT_REST = 1e-100
GETS_ON_M = 0.05  # of progress of all together, or they have not got on
APART = -math.inf  # as a clearance to stop at: tractors drive through each other
RUNNING, ALL_DONE, TOO_CLOSE, STALLED, NEIGHBOURS = 0, 1, 2, 3, 4


@compiled
def _moving(speed: float) -> float:
    """A speed, or 0 where it is none."""
    return speed if abs(speed) >= AT_REST else 0.0


@compiled
def tractor_force(state, model, ground, table, body, dt):  # type: ignore[no-untyped-def]
    """Advance steering and chassis of one tractor; the force (N, east and north) and torque (N m) pymunk must apply.

    `body` is x, y, angle, vx, vy, spin as pymunk has them, and cosine and sine of the angle. pymunk moves the body with
    its old velocity before it applies the force, so the new velocity is laid out in the frame of the coming heading.
    """
    x, y, angle, east, north, spin, cosine, sine = body
    state.x, state.y, state.angle = x, y, angle
    forward = _moving(_moving(east) * cosine + _moving(north) * sine)
    right = _moving(_moving(east) * sine - _moving(north) * cosine)
    turning = _moving(spin)
    state.forward = forward
    turn_wheels(state, model, dt)
    along = slide = 0.0
    if model.affected == 0.0:
        bend = tangent(corrected_angle(state.steering, table, model.lock))
    else:
        along, slide = ground_drift(state.play, forward, cosine, sine, model)
        seconds = state.clock * dt
        bend = affected_tangent(state.play, forward, x, y, cosine, sine, seconds, state.working, table, model)
        place = state.clock % len(state.xs)
        state.xs[place], state.ys[place], state.angles[place] = x, y, angle
        state.clock += 1
    drive = propel(state, model, ground, forward - along, dt)
    # Tyres hold on to the ground that moves with them.
    new_forward, new_right, new_spin = body_step(
        forward - along, right - slide, -turning, bend, drive, dt, model, ground
    )
    new_forward += along
    new_right += slide
    turn = turning * dt
    small, odd = 1.0 - 0.5 * turn * turn, turn - turn * turn * turn * (1.0 / 6.0)
    turned_cos, turned_sin = cosine * small - sine * odd, sine * small + cosine * odd
    per_second = 1.0 / dt
    per_speed = model.mass * per_second
    return (
        per_speed * (new_forward * turned_cos + new_right * turned_sin - east),
        per_speed * (new_forward * turned_sin - new_right * turned_cos - north),
        model.inertia * per_second * (-new_spin - spin),
    )


@compiled
def drive_tractor(state, model, grounds, ground, table, body, force, dt) -> None:  # type: ignore[no-untyped-def]
    """As tractor_force, for a body (6,) without cosine and sine, into an array `force` (3,)."""
    angle = body[BODY_ANGLE]
    force[0], force[1], force[2] = tractor_force(
        state, model, grounds[ground], table,
        (body[BODY_X], body[BODY_Y], angle, body[BODY_VX], body[BODY_VY], body[BODY_SPIN], math.cos(angle),
         math.sin(angle)),
        dt,
    )  # fmt: skip


@compiled
def note(record, row, states) -> None:  # type: ignore[no-untyped-def]
    """Write one row of the 10 Hz record, columns as in vehicle.layout.RECORD."""
    for i in range(len(states)):
        state = states[i]
        record[row, i, REC_X] = state.x
        record[row, i, REC_Y] = state.y
        record[row, i, REC_ANGLE] = state.angle
        record[row, i, REC_STEERING] = state.steering
        record[row, i, REC_SPEED] = state.forward
        record[row, i, REC_LEG] = state.leg - state.first_leg
        record[row, i, REC_STATUS] = state.status


@compiled
def run_loop(  # type: ignore[no-untyped-def]
    steps, dt, every, clock, door, states, models, grounds, tables, legs, gates, points, cumulative, record, clearances,
    contacts, stop_clearance, beside_clearance, stall_s, position_errors, near, wanted,
):  # fmt: skip
    """Drive all tractors for at most `steps` steps of `dt`; control, record and clearance every `every` steps.

    `clock` (3,) holds the step count, the best total progress and the time it was reached, and is carried on.
    `tables` (models, grounds, n) are the steering tables. `contacts` (k, 3) collects time and body ids; its last
    row counts. `position_errors` (k, 4) is a GNSS table of vehicle.gnss, without rows for no error. `near` (n,) tells
    which tractors have their contact boxes in the space: before a tick at which these are the wrong ones the loop ends
    with NEIGHBOURS and the right ones in `wanted` (n,). With a `stop_clearance` of APART none is near any. Returns an
    outcome of this module, the number of record rows, and the closest pair.
    """
    door, states, models = unowned_door(door), unowned(states), unowned(models)
    grounds, tables, legs, gates = unowned(grounds), unowned(tables), unowned(legs), unowned(gates)
    points, cumulative, record, near = unowned(points), unowned(cumulative), unowned(record), unowned(near)
    clearances, position_errors, wanted = unowned(clearances), unowned(position_errors), unowned(wanted)
    count = len(states)
    meeting = count > 1 and stop_clearance > APART
    touchable, rows = near.any(), 0
    for _ in range(steps):
        done = int(clock[0])
        time = done * dt
        look(door)
        if done % every == 0:
            total, running, standing = 0.0, 0, 0
            for i in range(count):
                state = states[i]
                state.x, state.y, state.angle = motion(door, i)[:3]
            if meeting and look_around(states, models, every * dt, near, wanted):
                return NEIGHBOURS, rows, -1, -1
            for i in range(count):
                if len(position_errors) > 0:
                    draw_error(states[i], position_errors)
            for i in range(count):
                control_tick(i, states, models, legs, gates, points, cumulative, time, every * dt)
                total += states[i].progress
                running += 1 - states[i].done
                standing += states[i].stand_left > 0.0 and states[i].started == 1
            note(record, rows, states)
            rows += 1
            if meeting:
                _, first, second = too_close(states, models, clearances, stop_clearance, beside_clearance)
                if first >= 0:
                    return TOO_CLOSE, rows, first, second
            if running == 0:
                return ALL_DONE, rows, -1, -1
            if total > clock[1] + GETS_ON_M or standing > 0:
                clock[1], clock[2] = total, time
            elif time - clock[2] > stall_s:
                return STALLED, rows, -1, -1
        for i in range(count):
            state = states[i]
            ground = legs[state.leg].ground
            force = tractor_force(
                state, models[state.model], grounds[ground], tables[state.model, ground], motion(door, i), dt
            )
            push(door, i, force)
        step(door, dt)
        clock[0] += 1.0
        if not touchable:
            continue
        touching = door.touching
        for pair in range(touches(door)):
            used = int(contacts[-1, 0])
            known = False
            for row in range(used):
                if contacts[row, 1] == touching[2 * pair] and contacts[row, 2] == touching[2 * pair + 1]:
                    known = True
            if not known and used < len(contacts) - 1:
                contacts[used, 0] = time
                contacts[used, 1] = touching[2 * pair]
                contacts[used, 2] = touching[2 * pair + 1]
                contacts[-1, 0] += 1.0
    return RUNNING, rows, -1, -1


@compiled
def run_fixed(steps, dt, door, states, models, grounds, ground, tables, track) -> None:  # type: ignore[no-untyped-def]
    """Drive one tractor with the command and target speed in its state; `track` (steps, 6) keeps its BODY columns."""
    table = tables[ground]
    for row in range(steps):
        look(door)
        body = motion(door, 0)
        track[row, BODY_X], track[row, BODY_Y], track[row, BODY_ANGLE] = body[0], body[1], body[2]
        track[row, BODY_VX], track[row, BODY_VY], track[row, BODY_SPIN] = body[3], body[4], body[5]
        push(door, 0, tractor_force(states[0], models[0], grounds[ground], table, body, dt))
        step(door, dt)
