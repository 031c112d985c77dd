"""Many segments at measured speeds replayed side by side, with vectorised steps.

Stepping one replay is latency-bound. With a measured speed all inputs of a step are known beforehand (see
compute_tangents_and_drift), so sideways speed and yaw rate are stepped for many segments at once, each in its own
lane that the next segment takes over when it has ended; positions are integrated afterwards. Each segment is driven
bit for bit as it would be alone, with the formulas of vehicle.sim.dynamics and vehicle.sim.effect_terms. Loops have no
branches, so that they compile to vector instructions.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from vehicle.control.steering import convert_to_base_angle
from vehicle.fast_math import (
    NEAR_RAD,
    SMALL_RAD,
    compute_arctangent_ratio,
    compute_cosine_sine,
    compute_moderate_tangent,
    compute_small_arctangent_ratio,
    compute_tangent,
)
from vehicle.identification.replay.state_cache import ANGLE_COLUMN, X_COLUMN, Y_COLUMN
from vehicle.jit import compile_function, inline_function
from vehicle.records import GRAVITY_MPS2
from vehicle.sim.dynamics import (
    CREEP_MPS,
    compute_axle_damping,
    compute_velocity_changes,
    compute_wheel_motion,
    step_body,
)
from vehicle.sim.effect_terms import (
    SECANT_STEPS,
    STRAIGHT_RAD,
    add_implement_draft,
    compute_curvature_factor,
    compute_discrepancy_angle,
    compute_discrepancy_grip,
    compute_discrepancy_push,
    compute_discrepancy_trust,
    compute_draft_crab,
    compute_secant_step,
    compute_slope_drift,
    compute_understeer_loss,
    limit_curve_tangent,
    solve_understeer,
)

LANES = 8  # chosen: lanes side by side; twice as many take nearly twice as long, and more of them are empty
# Chosen: steps per lane before ended lanes are refilled; together they fit in the processor's cache.
STEPS_PER_BATCH = 128
FEW_LANES = 2  # chosen: this few lanes are faster one by one
# Rows of a step, a value per lane: its inputs, and sideways speed and spin before it.
SPEED_ROW, SLIDE_ROW, TANGENT_ROW, RIGHT_ROW, SPIN_ROW, ROWS_PER_STEP = range(6)
STEP_SIZE = ROWS_PER_STEP * LANES


class _BodyNumbers(NamedTuple):
    """A tractor on its ground as plain numbers, which can be vectorised.

    `slope` and `stiff` are those of axle_damping, `limit` and `most` the largest slip angles of the front and rear
    wheels (rad), `steep` and `steeper` their tangents.
    """

    dt: Any
    slope: Any
    stiff: Any
    limit: Any
    most: Any
    steep: Any
    steeper: Any
    front: Any
    rear: Any
    half: Any
    mass: Any
    inertia: Any


@inline_function
def _collect_body_numbers(dt, model, ground):  # type: ignore[no-untyped-def]
    slope, stiff = compute_axle_damping(dt, model, ground)
    return _BodyNumbers(
        dt,
        slope,
        stiff,
        ground.front_limit,
        ground.rear_limit,
        _compute_steepest_slip(ground.front_limit),
        _compute_steepest_slip(ground.rear_limit),
        model.front,
        model.rear,
        0.5 * model.track,
        model.mass,
        model.inertia,
    )


@compile_function
def _compute_steepest_slip(limit: float) -> float:
    """Return the slip whose angle is the limit (rad); infinite for a right angle or more."""
    return math.tan(limit) if limit < 0.5 * math.pi else math.inf


@compile_function
def simulate_turning_lanes(begins, ends, speed, bend, slide, dt, model, ground, right, spin) -> None:  # type: ignore[no-untyped-def]
    """Drive segments from steps `begins` to before `ends`; the longest come first, so that the lanes end together.

    `speed`, and `bend` and `slide` of compute_tangents_and_drift, have a value per step (n,); `right` and `spin` (n,)
    get the
    sideways speed and the yaw rate before each.
    """
    if ground.shaped != 0.0:
        for segment_index in range(len(begins)):
            _simulate_turning_by_friction(
                begins[segment_index], ends[segment_index], speed, bend, slide, dt, model, ground, right, spin
            )
        return
    steps, body = np.zeros((STEPS_PER_BATCH + 1) * STEP_SIZE), _collect_body_numbers(dt, model, ground)
    next_step, end = np.zeros(LANES, dtype=np.int64), np.zeros(LANES, dtype=np.int64)
    counts, next_segment = np.zeros(LANES, dtype=np.int64), 0
    while True:
        rows, busy_lanes = 0, 0
        for lane in range(LANES):
            if next_step[lane] == end[lane] and next_segment < len(begins):
                next_step[lane], end[lane] = begins[next_segment], ends[next_segment]
                steps[RIGHT_ROW * LANES + lane] = steps[SPIN_ROW * LANES + lane] = 0.0
                next_segment += 1
            counts[lane] = min(end[lane] - next_step[lane], STEPS_PER_BATCH)
            _load_lane(steps, lane, next_step[lane], counts[lane], speed, bend, slide)
            rows, busy_lanes = max(rows, counts[lane]), busy_lanes + min(counts[lane], 1)
        if rows == 0:
            break
        if busy_lanes <= FEW_LANES:
            for lane in range(LANES):
                _simulate_single_lane(steps, lane, counts[lane], body)
        else:
            _simulate_all_lanes(steps, rows, body)
        for lane in range(LANES):
            _unload_lane(steps, lane, next_step[lane], counts[lane], right, spin)
            next_step[lane] += counts[lane]


@compile_function
def _load_lane(steps, lane, first, count, speed, bend, slide) -> None:  # type: ignore[no-untyped-def]
    """Copy the inputs of some steps of a segment, from `first`, into a lane."""
    for row in range(count):
        place, i = row * STEP_SIZE + lane, first + row
        steps[place + SPEED_ROW * LANES], steps[place + SLIDE_ROW * LANES] = speed[i], slide[i]
        steps[place + TANGENT_ROW * LANES] = bend[i]


@compile_function
def _unload_lane(steps, lane, first, count, right, spin) -> None:  # type: ignore[no-untyped-def]
    """Copy out sideways speed and spin before the steps of _load_lane; the values after the last step precede the next
    one."""
    for row in range(count):
        place, i = row * STEP_SIZE + lane, first + row
        right[i], spin[i] = steps[place + RIGHT_ROW * LANES], steps[place + SPIN_ROW * LANES]
    last = count * STEP_SIZE + lane
    steps[RIGHT_ROW * LANES + lane] = steps[last + RIGHT_ROW * LANES]
    steps[SPIN_ROW * LANES + lane] = steps[last + SPIN_ROW * LANES]


@inline_function
def _compute_axle_slips(rolling_1, rolling_2, sliding_1, sliding_2, steepest):  # type: ignore[no-untyped-def]
    """For two wheels: the factor from sliding to slip or, beyond the limit, to 1 (s/m), the slip, and whether it is
    beyond.

    `steepest` is the slip at the limit. The speeds are those of tyres.side_resistance; one division serves both.
    """
    scale_1, scale_2 = max(abs(rolling_1), CREEP_MPS), max(abs(rolling_2), CREEP_MPS)
    size_1, size_2 = abs(sliding_1), abs(sliding_2)
    is_beyond_1, is_beyond_2 = size_1 > steepest * scale_1, size_2 > steepest * scale_2
    scale_1, scale_2 = (size_1 if is_beyond_1 else scale_1), (size_2 if is_beyond_2 else scale_2)
    inverse_product = 1.0 / (scale_1 * scale_2)
    scale_1, scale_2 = scale_2 * inverse_product, scale_1 * inverse_product
    return scale_1, scale_2, size_1 * scale_1, size_2 * scale_2, is_beyond_1, is_beyond_2


@inline_function
def _step_lateral_motion(forward, right, spin, tangent, body, share):  # type: ignore[no-untyped-def]
    """Return sideways speed and spin after a step, and 1 where a wheel slips more than SMALL; `share` is arc_share."""
    cos_1, sin_1, cos_2, sin_2, sliding_1, sliding_2, sliding, rolling_1, rolling_2, rolling_left, rolling_right = (
        compute_wheel_motion(forward, right, spin, tangent, body.front, body.rear, body.half)
    )
    over_1, over_2, slip_1, slip_2, far_1, far_2 = _compute_axle_slips(
        rolling_1, rolling_2, sliding_1, sliding_2, body.steep
    )
    over_3, over_4, slip_3, slip_4, far_3, far_4 = _compute_axle_slips(
        rolling_left, rolling_right, sliding, sliding, body.steeper
    )
    share_1, share_2, share_3, share_4 = share(slip_1), share(slip_2), share(slip_3), share(slip_4)
    _, right_change, spin_change = compute_velocity_changes(
        forward,
        right,
        spin,
        0.0,
        body.dt,
        cos_1,
        sin_1,
        cos_2,
        sin_2,
        sliding_1,
        sliding_2,
        sliding,
        body.slope * (body.limit if far_1 else share_1) * over_1,
        body.slope * (body.limit if far_2 else share_2) * over_2,
        body.stiff * (body.most if far_3 else share_3) * over_3,
        body.stiff * (body.most if far_4 else share_4) * over_4,
        body.front,
        body.rear,
        body.half,
        body.mass,
        body.inertia,
    )
    front = max(0.0 if far_1 else slip_1, 0.0 if far_2 else slip_2)
    largest_slip = max(front, max(0.0 if far_3 else slip_3, 0.0 if far_4 else slip_4))
    return right + right_change, spin + spin_change, 1 if largest_slip > SMALL_RAD else 0


@inline_function
def _step_lanes_at_small_slip(steps, row_start, body):  # type: ignore[no-untyped-def]
    """Step all lanes; returns how many slip too far for it."""
    wide_count = 0
    for lane in range(LANES):
        slide = steps[row_start + SLIDE_ROW * LANES + lane]
        right, spin, is_wide = _step_lateral_motion(
            steps[row_start + SPEED_ROW * LANES + lane],
            steps[row_start + RIGHT_ROW * LANES + lane] - slide,
            steps[row_start + SPIN_ROW * LANES + lane],
            steps[row_start + TANGENT_ROW * LANES + lane],
            body,
            compute_small_arctangent_ratio,
        )
        steps[row_start + STEP_SIZE + RIGHT_ROW * LANES + lane] = right + slide
        steps[row_start + STEP_SIZE + SPIN_ROW * LANES + lane] = spin
        wide_count += is_wide
    return wide_count


@compile_function
def _step_lane_at_any_slip(steps, place, body) -> None:  # type: ignore[no-untyped-def]
    """Step one lane, whatever its slip."""
    slide = steps[place + SLIDE_ROW * LANES]
    right, spin, _ = _step_lateral_motion(
        steps[place + SPEED_ROW * LANES],
        steps[place + RIGHT_ROW * LANES] - slide,
        steps[place + SPIN_ROW * LANES],
        steps[place + TANGENT_ROW * LANES],
        body,
        compute_arctangent_ratio,
    )
    steps[place + STEP_SIZE + RIGHT_ROW * LANES], steps[place + STEP_SIZE + SPIN_ROW * LANES] = right + slide, spin


@compile_function
def _simulate_all_lanes(steps, rows, body) -> None:  # type: ignore[no-untyped-def]
    """Step sideways speed and spin of all lanes at once; ended lanes step on unused."""
    for row in range(rows):
        if _step_lanes_at_small_slip(steps, row * STEP_SIZE, body) > 0:
            for lane in range(LANES):
                _step_lane_at_any_slip(steps, row * STEP_SIZE + lane, body)


@compile_function
def _simulate_single_lane(steps, lane, rows, body) -> None:  # type: ignore[no-untyped-def]
    """Step sideways speed and spin of one lane."""
    for row in range(rows):
        _step_lane_at_any_slip(steps, row * STEP_SIZE + lane, body)


@compile_function
def _simulate_turning_by_friction(begin, end, speed, bend, slide, dt, model, ground, right, spin) -> None:  # type: ignore[no-untyped-def]
    """Drive one segment on a ground whose friction has a curve, as simulate_turning_lanes."""
    sideways = spin_rate = 0.0
    for i in range(begin, end):
        right[i], spin[i] = sideways, spin_rate
        drive = ground.rolling * model.mass * GRAVITY_MPS2 * speed[i] / (abs(speed[i]) + 0.05)
        _, sideways, spin_rate = step_body(speed[i], sideways - slide[i], spin_rate, bend[i], drive, dt, model, ground)
        sideways += slide[i]


@compile_function
def integrate_poses(speed, ahead, right, spin, x, y, angle, dt, out) -> None:  # type: ignore[no-untyped-def]
    """Move a segment from a pose as pymunk moves it, with the velocity before each step (n,).

    `out` (5, n) gets x, y, angle and speeds before each step.
    """
    xs, ys, angles = out[X_COLUMN], out[Y_COLUMN], out[ANGLE_COLUMN]
    count = len(speed)
    cosines, sines = np.empty(count), np.empty(count)
    for i in range(count):
        angles[i] = angle
        angle -= spin[i] * dt
    for i in range(count):
        cosines[i], sines[i] = compute_cosine_sine(angles[i])
    for i in range(count):
        xs[i] = ((speed[i] + ahead[i]) * cosines[i] + right[i] * sines[i]) * dt
    for i in range(count):
        ys[i] = ((speed[i] + ahead[i]) * sines[i] - right[i] * cosines[i]) * dt
    for i in range(count):
        east, north = xs[i], ys[i]
        xs[i], ys[i] = x, y
        x += east
        y += north


class _ModelNumbers(NamedTuple):
    """The model parameters of the formulas as plain numbers, which can be vectorised."""

    front: Any
    rear: Any
    lock: Any
    bend: Any
    bend_left: Any
    drift: Any
    patch: Any
    patch_east: Any
    patch_north: Any
    patch_radius: Any
    understeer: Any
    draft: Any
    slope_east: Any
    slope_north: Any
    offset: Any
    slide: Any


@inline_function
def _collect_model_numbers(model) -> Any:  # type: ignore[no-untyped-def]
    return _ModelNumbers(
        model.front,
        model.rear,
        model.lock,
        model.bend,
        model.bend_left,
        model.drift,
        model.patch,
        model.patch_east,
        model.patch_north,
        model.patch_radius,
        model.understeer,
        model.draft,
        model.slope_east,
        model.slope_north,
        model.offset,
        model.slide,
    )


@compile_function
def compute_tangents_and_drift(  # type: ignore[no-untyped-def]
    speed, working, east, north, cosines, sines, wheel_angle, start_s, dt, table, model, bend, ahead, slide
) -> None:
    """Write, per step (n,), the tangent of affected_tangent to `bend`, and the ground drift to `ahead` and `slide`.

    The columns are those of a segment, `turned` its wheel angle behind the play. On entry `slide` holds the drift to
    the right (m/m) on a measured slope, to which the model's is added.
    """
    rows, numbers = len(speed), _collect_model_numbers(model)
    angle, extra_curvature = np.empty(rows), np.zeros(rows)
    for k in range(rows):
        angle[k] = wheel_angle[k] + numbers.offset
    for k in range(rows):
        ahead[k] = 0.0
    for k in range(rows):
        slide[k] = compute_slope_drift(speed[k], cosines[k], sines[k], numbers) + abs(speed[k]) * slide[k]
    if model.discrepancy_model != 0.0:
        _add_discrepancy(speed, working, cosines, sines, wheel_angle, model, angle, extra_curvature, ahead, slide)
    if np.abs(table).max() > NEAR_RAD:
        _compute_tangents_of_large_angles(angle, bend, speed, table, model)
    else:
        _compute_tangents(angle, bend, speed, table, numbers)
    for k in range(rows):
        factor = compute_curvature_factor(angle[k], east[k], north[k], start_s + k * dt, numbers)
        bend[k] = add_implement_draft(bend[k] * factor, extra_curvature[k], working[k], numbers)
    if numbers.slide > 0.0:
        for k in range(rows):
            bend[k] = limit_curve_tangent(bend[k], speed[k], numbers)


@compile_function
def add_draft_crab(speed, working, model, ground, slide) -> None:  # type: ignore[no-untyped-def]
    """Add the crab under the side draft of a working implement to the ground drift `slide` (n,)."""
    for k in range(len(speed)):
        slide[k] += compute_draft_crab(speed[k], working[k], model, ground)


@compile_function
def _add_discrepancy(speed, working, cosines, sines, wheel_angle, model, angle, extra_curvature, ahead, slide) -> None:  # type: ignore[no-untyped-def]
    """Add the discrepancy model to wheel angles, curvature and ground drift."""
    for k in range(len(speed)):
        trust = compute_discrepancy_trust(wheel_angle[k], speed[k], model)
        angle[k] += trust * compute_discrepancy_angle(speed[k], cosines[k], sines[k], model)
        extra_curvature[k] = trust * compute_discrepancy_grip(
            wheel_angle[k], speed[k], cosines[k], sines[k], working[k], model
        )
    if model.discrepancy_push_to_east == 0.0 and model.discrepancy_push_to_north == 0.0:
        return
    for k in range(len(speed)):
        ahead[k], right = compute_discrepancy_push(wheel_angle[k], speed[k], cosines[k], sines[k], model)
        slide[k] += right


@inline_function
def _compute_tangents(angle, bend, speed, table, numbers) -> None:  # type: ignore[no-untyped-def]
    """Return the tangents of wheel angles (n,), reduced by the steering lost under load (unstrained_angle)."""
    rows = len(angle)
    if numbers.understeer != 0.0:
        strained_angle, lost_shares = np.empty(rows), np.empty(rows)
        for k in range(rows):
            lost_shares[k] = compute_understeer_loss(speed[k], numbers)
        for k in range(rows):
            strained_angle[k] = _avoid_zero_angle(angle[k])
        for _ in range(SECANT_STEPS):
            _look_up_tangents(strained_angle, bend, table, numbers.lock)
            for k in range(rows):
                strained_angle[k] = compute_secant_step(
                    _avoid_zero_angle(angle[k]), strained_angle[k], bend[k], lost_shares[k]
                )
        for k in range(rows):
            angle[k] = angle[k] if abs(angle[k]) < STRAIGHT_RAD else strained_angle[k]
    _look_up_tangents(angle, bend, table, numbers.lock)


@inline_function
def _look_up_tangents(angle, bend, table, lock) -> None:  # type: ignore[no-untyped-def]
    """Look up tangents of angles (n,) in the table; lookups do not vectorise, so they have their own loop."""
    for k in range(len(angle)):
        bend[k] = convert_to_base_angle(angle[k], table, lock)
    for k in range(len(angle)):
        bend[k] = compute_moderate_tangent(bend[k])


@inline_function
def _avoid_zero_angle(angle: float) -> float:
    """Return the angle, or a small one for nearly straight wheels, to avoid a division by 0."""
    return angle if abs(angle) >= STRAIGHT_RAD else STRAIGHT_RAD


@compile_function
def _compute_tangents_of_large_angles(angle, bend, speed, table, model) -> None:  # type: ignore[no-untyped-def]
    """As _compute_tangents with a table, one by one, where some angles are large."""
    for k in range(len(angle)):
        if model.understeer != 0.0:
            angle[k] = solve_understeer(angle[k], speed[k], table, model)
        bend[k] = compute_tangent(convert_to_base_angle(angle[k], table, model.lock))
