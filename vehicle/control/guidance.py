"""The 10 Hz control tick of one tractor: progress on its mission, steering command (Eq. 2.5) and target speed.

Path following is by projection on a polyline and a lookahead target. Functions take the records of vehicle.records.
"""

from __future__ import annotations

import math

from vehicle.control.speed import STANDSTILL_MPS, compute_approach_speed, compute_follower_speed
from vehicle.control.speed_profile import BRAKE_SHARE, UNLIMITED_MPS, compute_correction_speed
from vehicle.jit import compile_function
from vehicle.model.instruments import compute_guidance_pose
from vehicle.records import FINISHED, REVERSING, STANDING, TURNING, WAITING, WORKING

FULL_TURN_RAD = 2.0 * math.pi
ARRIVAL_TOLERANCE_M = 0.08
MIN_APPROACH_MPS = 0.12
ALIGNMENT_TOLERANCE_RAD = math.radians(3.0)
ALIGN_LIMIT_S = 6.0


@compile_function
def wrap_angle(angle: float) -> float:
    """The angle, less whole turns, in (-pi, pi] up to rounding."""
    return angle - FULL_TURN_RAD * math.ceil((angle - math.pi) / FULL_TURN_RAD)


@compile_function
def compute_steering_command(
    lateral: float, heading: float, lateral_gain: float, heading_gain: float, lateral_limit: float, lock: float
) -> float:
    """Eq. 2.5: a positive `lateral` means that the path, a positive `heading` that the target lies to the right.

    The lateral error is limited to `lateral_limit`: with the slew limit of Eq. 2.8 the plain law does not converge
    from offsets of 1.5 m and more but weaves about the path.
    """
    lateral = min(max(lateral, -lateral_limit), lateral_limit)
    return min(max(lateral_gain * lateral + heading_gain * heading, -lock), lock)


@compile_function
def project_point(
    points: object, cumulative: object, segment: int, last: int, x: float, y: float
) -> tuple[int, float, float]:
    """Advance along a polyline to the segment next to (x, y).

    `points` (n, 2 or more) and `cumulative` (n,) describe the path; the search starts at `segment`, never goes back and
    never beyond `last`. A segment of zero length is a jump to another path and is skipped. Returns the segment,
    the progress along the path (m) and the lateral error (m, positive when the path lies to the right of the point
    in the direction of travel).
    """
    while True:
        ax, ay = points[segment, 0], points[segment, 1]  # type: ignore[index]
        length = cumulative[segment + 1] - cumulative[segment]  # type: ignore[index]
        if length == 0.0 and segment < last:
            segment += 1
            continue
        ux = (points[segment + 1, 0] - ax) / length  # type: ignore[index]
        uy = (points[segment + 1, 1] - ay) / length  # type: ignore[index]
        along = (x - ax) * ux + (y - ay) * uy
        if along <= length or segment >= last:
            return segment, cumulative[segment] + along, ux * (y - ay) - uy * (x - ax)  # type: ignore[index]
        segment += 1


@compile_function
def find_target_point(
    points: object, cumulative: object, segment: int, last: int, progress: float
) -> tuple[float, float]:
    """Point at `progress` along the path, on or after `segment`; extended straight beyond the end of `last`."""
    while segment < last and cumulative[segment + 1] < progress:  # type: ignore[index]
        segment += 1
    length = cumulative[segment + 1] - cumulative[segment]  # type: ignore[index]
    share = (progress - cumulative[segment]) / length  # type: ignore[index]
    x = points[segment, 0] + share * (points[segment + 1, 0] - points[segment, 0])  # type: ignore[index]
    y = points[segment, 1] + share * (points[segment + 1, 1] - points[segment, 1])  # type: ignore[index]
    return x, y


@compile_function
def has_open_gates(leg: int, legs, gates, states) -> bool:  # type: ignore[no-untyped-def]
    """Whether every gate of a leg is open."""
    for gate in range(legs[leg].first_gate, legs[leg].last_gate):
        tractor = gates[gate].tractor
        if states[tractor].progress < gates[gate].progress and states[tractor].done == 0:
            return False
    return True


@compile_function
def update_steering_command(state, model, leg, points, cumulative) -> None:  # type: ignore[no-untyped-def]
    """Project the guided point on the path and set the steering command (Eq. 2.5); in reverse, mirrored.

    The lateral error is limited further the faster the tractor drives (vehicle.sim.compile.compute_lateral_ease).
    In reverse the rear axle is guided, but a leg is finished when the point that is guided forwards reaches its end:
    progress counts from that point, so that the next leg begins where this one was planned to end.
    """
    reach = model.guide if leg.gear > 0 else model.guide_reverse
    x, y, angle = state.x, state.y, state.angle
    if model.affected != 0.0:
        x, y, angle = compute_guidance_pose(state, model)
    x += reach * math.cos(angle) + state.error_x
    y += reach * math.sin(angle) + state.error_y
    state.segment, progress, state.lateral = project_point(points, cumulative, state.segment, leg.last_segment, x, y)
    ahead = 0.0 if leg.gear > 0 else model.guide - model.guide_reverse
    state.progress = max(progress - ahead, state.progress)
    lookahead = max(leg.lookahead, model.lookahead_s * abs(state.forward))
    tx, ty = find_target_point(points, cumulative, state.segment, leg.last_segment, progress + lookahead)
    limit = min(model.lateral_limit, model.lateral_ease / max(abs(state.forward), STANDSTILL_MPS))
    travel = angle if leg.gear > 0 else angle + math.pi
    heading = wrap_angle(travel - math.atan2(ty - y, tx - x))
    command = compute_steering_command(
        state.lateral, heading, model.lateral_gain, model.heading_gain, limit, model.lock
    )
    state.command = command if leg.gear > 0 else -command


@compile_function
def can_enter_without_halt(leg: int, legs) -> bool:  # type: ignore[no-untyped-def]
    """Whether the next leg begins without a halt."""
    return legs[leg + 1].gear == legs[leg].gear and legs[leg + 1].stand == 0.0  # type: ignore[no-any-return]


@compile_function
def compute_path_speed(state, model, points, cumulative) -> float:  # type: ignore[no-untyped-def]
    """Speed that respects the limit of the next point of the path, which respects those of all points after it.

    Where wheels have far to turn it is lower. Infinite on a path without limits.
    """
    goal = state.segment + 1
    limit = points[goal, 2]
    if limit == UNLIMITED_MPS:
        return limit  # type: ignore[no-any-return]
    distance = cumulative[goal] - state.progress - model.speed_lag * abs(state.forward)
    speed = compute_approach_speed(distance, limit, BRAKE_SHARE * model.acceleration)
    return min(speed, compute_correction_speed(max(abs(state.command), abs(state.steering)), model.wheel_pace))


@compile_function
def compute_allowed_speed(state, model, legs, gates, states, limit) -> tuple[float, bool]:  # type: ignore[no-untyped-def]
    """Speed of at most `limit` that respects every leg end, gate, stop and gear change ahead, and whether a closed gate
    limits it.

    A tractor whose speed lags its command brakes earlier, by the distance it drives meanwhile.
    """
    deceleration = model.acceleration
    lag_distance_m = model.speed_lag * abs(state.forward)
    brake_range = 0.5 * state.forward * state.forward / deceleration + 1.0 + lag_distance_m
    leg = state.leg
    speed = min(legs[leg].speed, limit)
    while True:
        distance = legs[leg].end - state.progress - lag_distance_m
        closed = leg < state.last_leg and not has_open_gates(leg + 1, legs, gates, states)
        if leg == state.last_leg or closed or not can_enter_without_halt(leg, legs):
            if distance < ARRIVAL_TOLERANCE_M:
                return 0.0, closed
            return min(
                speed, max(compute_approach_speed(distance - ARRIVAL_TOLERANCE_M, 0.0, deceleration), MIN_APPROACH_MPS)
            ), False
        if distance > brake_range:
            return speed, False
        speed = min(speed, compute_approach_speed(distance, legs[leg + 1].speed, deceleration))
        leg += 1


@compile_function
def advance_leg(state, model, legs, gates, states, time) -> None:  # type: ignore[no-untyped-def]
    """Enter the next leg when this one is finished, the gates are open and, where it must halt, the tractor stands.

    Before the stop at the start of this leg is over, none of it is driven, however short it is.
    """
    while True:
        if state.stand_left > 0.0:
            return
        leg = state.leg
        remaining_m = legs[leg].end - state.progress
        standing = abs(state.forward) < STANDSTILL_MPS
        if leg == state.last_leg:
            if remaining_m < 2.0 * ARRIVAL_TOLERANCE_M and standing:
                state.done, state.done_time, state.status = 1, time, FINISHED
                state.away = state.leaves
            return
        rolls_on = can_enter_without_halt(leg, legs)
        if rolls_on and remaining_m > 0.0 and not (remaining_m < 2.0 * ARRIVAL_TOLERANCE_M and standing):
            return
        if not rolls_on and not (remaining_m < 2.0 * ARRIVAL_TOLERANCE_M and standing):
            return
        if not has_open_gates(leg + 1, legs, gates, states):
            return
        state.leg = leg + 1
        state.stand_left = legs[leg + 1].stand
        if legs[leg + 1].gear != legs[leg].gear:
            state.progress = legs[leg].end
            state.segment = legs[leg + 1].first_segment
            state.shift_left, state.align_left = model.shift_time, ALIGN_LIMIT_S
        if not rolls_on:
            return


@compile_function
def run_control_tick(  # type: ignore[no-untyped-def]
    tractor, states, models, legs, gates, points, cumulative, time, period
) -> None:
    """Everything the on-board controller does once per `period` (s) for the tractor of this number."""
    state = states[tractor]
    if state.done == 1:
        state.target_speed = 0.0
        return
    if state.started == 0:
        if not has_open_gates(state.leg, legs, gates, states):
            state.status = WAITING
            return
        state.started, state.away = 1, 0
    model = models[state.model]
    update_steering_command(state, model, legs[state.leg], points, cumulative)
    advance_leg(state, model, legs, gates, states, time)
    if state.done == 1:
        state.target_speed = 0.0
        return
    if state.stand_left > 0.0:
        state.stand_left -= period
        state.target_speed, state.working, state.status = 0.0, 0.0, STANDING
        return
    leg = legs[state.leg]
    limit = compute_path_speed(state, model, points, cumulative)
    speed, is_held = compute_allowed_speed(state, model, legs, gates, states, limit)
    if leg.leader >= 0 and states[leg.leader].leg == leg.leader_leg and states[leg.leader].done == 0:
        leader = states[leg.leader]
        gap = (leader.x - state.x) * math.cos(state.angle) + (leader.y - state.y) * math.sin(state.angle)
        follow_speed = compute_follower_speed(gap, leg.gap, abs(leader.forward))
        is_held = is_held or (follow_speed < speed and follow_speed < MIN_APPROACH_MPS)
        speed = min(speed, follow_speed)
    if state.shift_left > 0.0:
        state.shift_left -= period
        speed = 0.0
    elif state.align_left > 0.0:
        # The wheels turn to the new angle before the tractor moves off.
        state.align_left -= period
        if abs(state.command - state.steering) < ALIGNMENT_TOLERANCE_RAD:
            state.align_left = 0.0
        else:
            speed = 0.0
    state.target_speed = speed * leg.gear
    state.working = leg.implement
    if leg.gear < 0:
        state.status = REVERSING
    elif is_held and abs(state.forward) < 2.0 * MIN_APPROACH_MPS:
        state.status = WAITING
    else:
        state.status = WORKING if leg.implement == 1 else TURNING
