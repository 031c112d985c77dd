"""The 10 Hz tick of one tractor: where it is on its mission, how it should steer, how fast it should go.

All functions take the record arrays of vehicle.layout.
"""

from __future__ import annotations

import math

from vehicle.driveline import STOPPED_MPS
from vehicle.guidance import project, steering_command, target_point, wrapped
from vehicle.instruments import seen_pose
from vehicle.jit import compiled
from vehicle.layout import FINISHED, REVERSING, STANDING, TURNING, WAITING, WORKING
from vehicle.speed import approach_speed, follower_speed

ARRIVED_M = 0.08
CREEP_MPS = 0.12
ALIGNED_RAD = math.radians(3.0)
ALIGN_LIMIT_S = 6.0


@compiled
def gates_open(leg: int, legs, gates, states) -> bool:  # type: ignore[no-untyped-def]
    """Whether every gate of a leg is open."""
    for gate in range(legs[leg].first_gate, legs[leg].last_gate):
        tractor = gates[gate].tractor
        if states[tractor].progress < gates[gate].progress and states[tractor].done == 0:
            return False
    return True


@compiled
def steer(state, model, leg, points, cumulative) -> None:  # type: ignore[no-untyped-def]
    """Project the guided point on the path and set the steering command (Eq. 2.5); in reverse, mirrored.

    In reverse the rear axle is guided, but a leg is driven when the point guided forwards is at its end: progress is
    counted from there, so that the next leg begins where this one was planned to end.
    """
    reach = model.guide if leg.gear > 0 else model.guide_reverse
    x, y, angle = state.x, state.y, state.angle
    if model.affected != 0.0:
        x, y, angle = seen_pose(state, model)
    x += reach * math.cos(angle) + state.error_x
    y += reach * math.sin(angle) + state.error_y
    state.segment, progress, state.lateral = project(points, cumulative, state.segment, leg.last_segment, x, y)
    ahead = 0.0 if leg.gear > 0 else model.guide - model.guide_reverse
    state.progress = max(progress - ahead, state.progress)
    tx, ty = target_point(points, cumulative, state.segment, leg.last_segment, progress + leg.lookahead)
    travel = angle if leg.gear > 0 else angle + math.pi
    heading = wrapped(travel - math.atan2(ty - y, tx - x))
    command = steering_command(
        state.lateral, heading, model.lateral_gain, model.heading_gain, model.lateral_limit, model.lock
    )
    state.command = command if leg.gear > 0 else -command


@compiled
def rolls_on(leg: int, legs) -> bool:  # type: ignore[no-untyped-def]
    """Whether the leg after this one is begun without a halt."""
    return legs[leg + 1].gear == legs[leg].gear and legs[leg + 1].stand == 0.0  # type: ignore[no-any-return]


@compiled
def allowed_speed(state, model, legs, gates, states) -> tuple[float, bool]:  # type: ignore[no-untyped-def]
    """Speed that still respects every leg end, gate, stand and gear change ahead, and whether a closed gate binds.

    A tractor whose speed lags its command brakes earlier, by the way it drives meanwhile.
    """
    deceleration = model.acceleration
    late = model.speed_lag * abs(state.forward)
    brake_range = 0.5 * state.forward * state.forward / deceleration + 1.0 + late
    leg = state.leg
    speed = legs[leg].speed
    while True:
        distance = legs[leg].end - state.progress - late
        closed = leg < state.last_leg and not gates_open(leg + 1, legs, gates, states)
        if leg == state.last_leg or closed or not rolls_on(leg, legs):
            if distance < ARRIVED_M:
                return 0.0, closed
            return min(speed, max(approach_speed(distance - ARRIVED_M, 0.0, deceleration), CREEP_MPS)), False
        if distance > brake_range:
            return speed, False
        speed = min(speed, approach_speed(distance, legs[leg + 1].speed, deceleration))
        leg += 1


@compiled
def advance_leg(state, model, legs, gates, states, time) -> None:  # type: ignore[no-untyped-def]
    """Enter the next leg when this one is driven, its gates are open and, where it must halt, the tractor stands.

    One that has still to stand before this leg drives none of it, however short it is.
    """
    while True:
        if state.stand_left > 0.0:
            return
        leg = state.leg
        left = legs[leg].end - state.progress
        standing = abs(state.forward) < STOPPED_MPS
        if leg == state.last_leg:
            if left < 2.0 * ARRIVED_M and standing:
                state.done, state.done_time, state.status = 1, time, FINISHED
                state.away = state.leaves
            return
        rolls = rolls_on(leg, legs)
        if rolls and left > 0.0 and not (left < 2.0 * ARRIVED_M and standing):
            return
        if not rolls and not (left < 2.0 * ARRIVED_M and standing):
            return
        if not gates_open(leg + 1, legs, gates, states):
            return
        state.leg = leg + 1
        state.stand_left = legs[leg + 1].stand
        if legs[leg + 1].gear != legs[leg].gear:
            state.progress = legs[leg].end
            state.segment = legs[leg + 1].first_segment
            state.shift_left, state.align_left = model.shift_time, ALIGN_LIMIT_S
        if not rolls:
            return


@compiled
def control_tick(me, states, models, legs, gates, points, cumulative, time, period) -> None:  # type: ignore[no-untyped-def]
    """Everything the on-board controller does once per period for tractor `me`."""
    state = states[me]
    if state.done == 1:
        state.target_speed = 0.0
        return
    if state.started == 0:
        if not gates_open(state.leg, legs, gates, states):
            state.status = WAITING
            return
        state.started, state.away = 1, 0
    model = models[state.model]
    steer(state, model, legs[state.leg], points, cumulative)
    advance_leg(state, model, legs, gates, states, time)
    if state.done == 1:
        state.target_speed = 0.0
        return
    if state.stand_left > 0.0:
        state.stand_left -= period
        state.target_speed, state.working, state.status = 0.0, 0.0, STANDING
        return
    leg = legs[state.leg]
    speed, held = allowed_speed(state, model, legs, gates, states)
    if leg.leader >= 0 and states[leg.leader].leg == leg.leader_leg and states[leg.leader].done == 0:
        leader = states[leg.leader]
        gap = (leader.x - state.x) * math.cos(state.angle) + (leader.y - state.y) * math.sin(state.angle)
        follow = follower_speed(gap, leg.gap, abs(leader.forward))
        held = held or (follow < speed and follow < CREEP_MPS)
        speed = min(speed, follow)
    if state.shift_left > 0.0:
        state.shift_left -= period
        speed = 0.0
    elif state.align_left > 0.0:
        # Wheels go over to the new lock before the tractor moves off.
        state.align_left -= period
        if abs(state.command - state.steering) < ALIGNED_RAD:
            state.align_left = 0.0
        else:
            speed = 0.0
    state.target_speed = speed * leg.gear
    state.working = leg.implement
    if leg.gear < 0:
        state.status = REVERSING
    elif held and abs(state.forward) < 2.0 * CREEP_MPS:
        state.status = WAITING
    else:
        state.status = WORKING if leg.implement == 1 else TURNING
