"""The compiled loop: it reads the bodies, runs control and dynamics, and steps the space.

No Python runs inside: bodies are reached through a PymunkBridge, and everything else is plain arrays of records.
"""

from __future__ import annotations

import math

from vehicle.control.guidance import run_control_tick
from vehicle.control.steering import convert_to_base_angle
from vehicle.fast_math import compute_tangent
from vehicle.jit import compile_function, drop_owner
from vehicle.model.gnss import draw_error
from vehicle.model.terrain import compute_gradient
from vehicle.records import (
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
)  # fmt: skip
from vehicle.sim.clearance import find_too_close, mark_contact_candidates
from vehicle.sim.compiled_access import (
    apply_force,
    count_contacts,
    drop_bridge_owner,
    get_motion,
    read_motions,
    step_space,
)
from vehicle.sim.dynamics import (
    step_body,
    step_loaded_body,
    step_loaded_drive,
    step_speed_control,
    step_steering_system,
)
from vehicle.sim.effect_terms import compute_affected_tangent, compute_draft_crab, compute_ground_drift
from vehicle.sim.load_terms import STALL_AFTER_S
from vehicle.sim.pymunk_bridge import TOUCH_WIDTH

# m/s, rad/s. Speeds that decay on a straight line become ever smaller, and processors calculate many times slower with
# numbers below 1e-307; the cube of this limit is above that.
NEGLIGIBLE_SPEED = 1e-100
MIN_PROGRESS_M = 0.05  # of all tractors together; less counts as a stall
IGNORE_CLEARANCE_M = -math.inf  # a stop clearance with which tractors drive through each other
RUNNING, ALL_DONE, TOO_CLOSE, STALLED, NEIGHBOURS_CHANGED = range(5)


@compile_function
def _drop_negligible(speed: float) -> float:
    """The speed, or 0 if it is negligible."""
    return speed if abs(speed) >= NEGLIGIBLE_SPEED else 0.0


@compile_function
def compute_tractor_force(state, model, ground, table, body, dt):  # type: ignore[no-untyped-def]
    """Advance steering and body of one tractor; the force (N, east and north) and torque (N m) that pymunk must apply.

    `body` is x, y, angle, vx, vy, spin of pymunk, and cosine and sine of the angle. pymunk moves the body with its old
    velocity before it applies the force, so the new velocity is expressed in the frame of the next heading.
    """
    x, y, angle, east, north, spin, cosine, sine = body
    state.x, state.y, state.angle = x, y, angle
    forward = _drop_negligible(_drop_negligible(east) * cosine + _drop_negligible(north) * sine)
    right = _drop_negligible(_drop_negligible(east) * sine - _drop_negligible(north) * cosine)
    turning = _drop_negligible(spin)
    state.forward = forward
    step_steering_system(state, model, dt)
    drift_ahead = drift_right = 0.0
    if model.affected == 0.0:
        bend = compute_tangent(convert_to_base_angle(state.steering, table, model.lock))
    else:
        drift_ahead, drift_right = compute_ground_drift(state.play, forward, cosine, sine, model)
        if model.draft != 0.0:
            drift_right += compute_draft_crab(forward, state.working, model, ground)
        seconds = state.clock * dt
        bend = compute_affected_tangent(state.play, forward, x, y, cosine, sine, seconds, state.working, table, model)
        place = state.clock % len(state.xs)
        state.xs[place], state.ys[place], state.angles[place] = x, y, angle
        state.clock += 1
    # Relative to drifting ground, the tyres hold as usual.
    ahead, aside = forward - drift_ahead, right - drift_right
    if model.loaded == 0.0:
        drive = step_speed_control(state, model, ground, ahead, dt)
        new_forward, new_right, new_spin = step_body(ahead, aside, -turning, bend, drive, dt, model, ground)
    else:
        drive, push = step_loaded_drive(state, model, ground, ahead, turning, cosine, sine, dt)
        new_forward, new_right, new_spin = step_loaded_body(
            ahead, aside + push, -turning, bend, drive, state.thrust, dt, model, ground
        )
    new_forward += drift_ahead
    new_right += drift_right
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


@compile_function
def drive_tractor(state, model, grounds, ground, table, body, force, dt) -> None:  # type: ignore[no-untyped-def]
    """As compute_tractor_force, for a body (6,) without cosine and sine; writes to `force` (3,)."""
    angle = body[BODY_ANGLE]
    place = body[BODY_X], body[BODY_Y], angle
    motion = body[BODY_VX], body[BODY_VY], body[BODY_SPIN], math.cos(angle), math.sin(angle)
    force[0], force[1], force[2] = compute_tractor_force(state, model, grounds[ground], table, place + motion, dt)


@compile_function
def write_record_row(record, row, states) -> None:  # type: ignore[no-untyped-def]
    """Write one row of the 10 Hz record; columns as in vehicle.records.RECORD_COLUMNS."""
    for i in range(len(states)):
        state = states[i]
        record[row, i, REC_X] = state.x
        record[row, i, REC_Y] = state.y
        record[row, i, REC_ANGLE] = state.angle
        record[row, i, REC_STEERING] = state.steering
        record[row, i, REC_SPEED] = state.forward
        record[row, i, REC_LEG] = state.leg - state.first_leg
        record[row, i, REC_STATUS] = state.status


@compile_function
def find_stuck_tractor(states) -> int:  # type: ignore[no-untyped-def]
    """Number of the first tractor that cannot go on, or -1."""
    for i in range(len(states)):
        if states[i].short_time > STALL_AFTER_S:
            return i
    return -1


@compile_function
def note_contacts(bridge, contacts, time) -> None:  # type: ignore[no-untyped-def]
    """Add the pairs that touch for the first time to `contacts` (k, 3), whose last row counts them."""
    for pair in range(count_contacts(bridge)):
        at, used = TOUCH_WIDTH * pair, int(contacts[-1, 0])
        first, second, points = bridge.touching[at], bridge.touching[at + 1], bridge.touching[at + 2]
        is_known = points == 0
        for row in range(used):
            if contacts[row, 1] == first and contacts[row, 2] == second:
                is_known = True
        if not is_known and used < len(contacts) - 1:
            contacts[used, 0] = time
            contacts[used, 1] = first
            contacts[used, 2] = second
            contacts[-1, 0] += 1.0


@compile_function
def run_loop(  # type: ignore[no-untyped-def]
    steps, dt, steps_per_tick, clock, bridge, states, models, grounds, tables, legs, gates, points, cumulative, record,
    clearances, start_distances, contacts, stop_clearance, beside_clearance, stall_s, position_errors, present,
    required, heights, frame,
):  # fmt: skip
    """Drive all tractors for at most `steps` steps of `dt`; control, record and clearance every `steps_per_tick`.

    `clock` (3,) holds the step count, the best total progress and the time it was reached, and is updated. `tables`
    (models, grounds, n) are the steering tables. `clearances` (n,) and `start_distances` (n, n) are as for
    find_too_close. `contacts` (k, 3) collects time and body ids; its last row counts.
    `position_errors` (k, 4) is a GNSS table of vehicle.model.gnss, without rows for no error. `present` (n,) says which
    tractors have their contact boxes in the space: if these are not the required ones before a tick, the loop returns
    NEIGHBOURS_CHANGED and writes the required ones to `required` (n,). With a `stop_clearance` of IGNORE_CLEARANCE_M
    clearances are not checked. `heights` and `frame` are those of a Terrain, without rows for level ground. Returns an
    outcome of this module, the number of record rows, and the closest pair, or the tractor that is stuck.
    """
    bridge, states, models = drop_bridge_owner(bridge), drop_owner(states), drop_owner(models)
    grounds, tables, legs, gates = drop_owner(grounds), drop_owner(tables), drop_owner(legs), drop_owner(gates)
    points, cumulative, record = drop_owner(points), drop_owner(cumulative), drop_owner(record)
    clearances, position_errors, required = drop_owner(clearances), drop_owner(position_errors), drop_owner(required)
    present, heights, frame = drop_owner(present), drop_owner(heights), drop_owner(frame)
    start_distances = drop_owner(start_distances)
    count, is_level = len(states), len(heights) == 0
    checks_clearance = count > 1 and stop_clearance > IGNORE_CLEARANCE_M
    touchable, rows = present.any(), 0
    for _ in range(steps):
        steps_done = int(clock[0])
        time = steps_done * dt
        read_motions(bridge)
        if steps_done % steps_per_tick == 0:
            total, running, standing = 0.0, 0, 0
            for i in range(count):
                states[i].x, states[i].y, states[i].angle = get_motion(bridge, i)[:3]
            if checks_clearance and mark_contact_candidates(states, models, steps_per_tick * dt, present, required):
                return NEIGHBOURS_CHANGED, rows, -1, -1
            for i in range(count):
                if len(position_errors) > 0:
                    draw_error(states[i], position_errors)
                run_control_tick(i, states, models, legs, gates, points, cumulative, time, steps_per_tick * dt)
                total += states[i].progress
                running += 1 - states[i].done
                standing += states[i].stand_left > 0.0 and states[i].started == 1
            write_record_row(record, rows, states)
            rows += 1
            if checks_clearance:
                _, first, second = find_too_close(
                    states, models, clearances, start_distances, stop_clearance, beside_clearance
                )
                if first >= 0:
                    return TOO_CLOSE, rows, first, second
            stuck = find_stuck_tractor(states)
            if stuck >= 0:
                return STALLED, rows, stuck, -1
            if running == 0:
                return ALL_DONE, rows, -1, -1
            if total > clock[1] + MIN_PROGRESS_M or standing > 0:
                clock[1], clock[2] = total, time
            elif time - clock[2] > stall_s:
                return STALLED, rows, -1, -1
        for i in range(count):
            state = states[i]
            ground = legs[state.leg].ground
            motion = get_motion(bridge, i)
            if not is_level:
                # Of the place that pymunk moves the body to before it applies the force: only so is energy kept.
                x, y = motion[0] + dt * motion[3], motion[1] + dt * motion[4]
                state.slope_east, state.slope_north = compute_gradient(heights, frame, x, y)
            force = compute_tractor_force(
                state, models[state.model], grounds[ground], tables[state.model, ground], motion, dt
            )
            apply_force(bridge, i, force)
        step_space(bridge, dt)
        clock[0] += 1.0
        if touchable:
            note_contacts(bridge, contacts, time)
    return RUNNING, rows, -1, -1


@compile_function
def run_fixed(steps, dt, bridge, states, models, grounds, ground, tables, body_rows) -> None:  # type: ignore[no-untyped-def]
    """Drive one tractor with the command and target speed in its state; `body_rows` (steps, 6) gets BODY_COLUMNS."""
    table = tables[ground]
    for row in range(steps):
        read_motions(bridge)
        body = get_motion(bridge, 0)
        body_rows[row, BODY_X], body_rows[row, BODY_Y], body_rows[row, BODY_ANGLE] = body[0], body[1], body[2]
        body_rows[row, BODY_VX], body_rows[row, BODY_VY], body_rows[row, BODY_SPIN] = body[3], body[4], body[5]
        apply_force(bridge, 0, compute_tractor_force(states[0], models[0], grounds[ground], table, body, dt))
        step_space(bridge, dt)
