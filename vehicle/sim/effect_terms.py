"""Formulas of the effects and the discrepancy model on steering and path, for planning and for replay.

Every function takes a MODEL record, whose effect fields vehicle.model.effects fills. They count only
where `affected` is set, so that a tractor without effects costs one comparison.
"""

from __future__ import annotations

import math

from vehicle.control.steering import convert_to_base_angle
from vehicle.fast_math import compute_saturation_factor, compute_tangent
from vehicle.jit import compile_function, inline_function
from vehicle.model.discrepancy_model import FADE_SHARE
from vehicle.records import GRAVITY_MPS2

DRIFT_LIMIT = 0.3  # largest change of grip with time, as a share of it
KNEE = 0.3  # of the limit of side force: below it nothing is lost, at four fifths of the limit 5 % of the curvature
DISCREPANCY_LIMIT = 0.9  # of the curvature: a discrepancy model must not turn a tractor the other way
SECANT_STEPS = 4  # chosen: at usual losses each step leaves a twentieth of the error
STRAIGHT_RAD = 1e-6  # below it nothing is lost
CREEP_MPS = 0.05  # slip angles and resistances of slower wheels are those at this speed: no division by zero, no jump
CRAWL_MPS = 0.1  # below it a push fades out: a tractor that stands stays


@compile_function
def apply_play(play: float, steering: float, model) -> float:  # type: ignore[no-untyped-def]
    """Wheel angle behind the play of the linkage (rad): the wheels stay until the play is taken up."""
    half = model.half_play
    return min(max(play, steering - half), steering + half)  # type: ignore[no-any-return]


@compile_function
def solve_understeer(angle: float, forward: float, table, model) -> float:  # type: ignore[no-untyped-def]
    """Wheel angle that remains when a share of it is lost per lateral acceleration (rad).

    The loss depends on the acceleration, which depends on the remaining angle. A few secant steps solve this; using the
    acceleration of the previous time step instead could oscillate.
    """
    if abs(angle) < STRAIGHT_RAD:
        return angle
    remaining, loss = angle, model.understeer * forward * forward / (model.front + model.rear)
    for _ in range(SECANT_STEPS):
        bend = compute_tangent(convert_to_base_angle(remaining, table, model.lock))
        remaining = angle * remaining / (remaining + loss * bend)
    return remaining


@inline_function
def compute_curvature_factor(angle: float, east: float, north: float, seconds: float, model) -> float:  # type: ignore[no-untyped-def]
    """Factor on the curvature: gain, side, place in the field and time since the start of the run."""
    factor = model.bend
    if angle < 0.0:
        factor *= model.bend_left
    factor *= 1.0 + min(max(model.drift * seconds, -DRIFT_LIMIT), DRIFT_LIMIT)
    if model.patch != 1.0:
        dx, dy = east - model.patch_east, north - model.patch_north
        if dx * dx + dy * dy < model.patch_radius * model.patch_radius:
            factor *= model.patch
    return factor  # type: ignore[no-any-return]


@compile_function
def compute_excess(value: float, low: float, high: float) -> float:
    """How far a value lies outside a range, as a share of the width within which trust fades."""
    return max(low - value, value - high, 0.0) / (FADE_SHARE * (high - low))


@compile_function
def compute_discrepancy_trust(angle: float, forward: float, model) -> float:  # type: ignore[no-untyped-def]
    """Trust in the discrepancy model at a wheel angle and speed: 1 inside the ranges of its logs, 0 far outside."""
    far = max(
        compute_excess(abs(forward), model.discrepancy_slow, model.discrepancy_fast),
        compute_excess(angle, model.discrepancy_left, model.discrepancy_right),
    )
    return max(1.0 - far, 0.0)


@compile_function
def compute_discrepancy_angle(forward: float, cosine: float, sine: float, model) -> float:  # type: ignore[no-untyped-def]
    """Extra wheel angle (rad) of the discrepancy model."""
    pace = abs(forward)
    along = model.discrepancy_angle_to_east * cosine + model.discrepancy_angle_to_north * sine
    return model.discrepancy_angle_by_speed * pace + model.discrepancy_angle_by_square * pace * pace + along  # type: ignore[no-any-return]


@compile_function
def compute_discrepancy_grip(  # type: ignore[no-untyped-def]
    angle: float, forward: float, cosine: float, sine: float, working: float, model
) -> float:
    """Extra share of the curvature by the discrepancy model, limited so that a turn neither vanishes nor doubles."""
    share = model.discrepancy_grip_by_speed * abs(forward) + model.discrepancy_grip_by_angle * abs(angle)
    share += model.discrepancy_grip_by_implement * working
    share += model.discrepancy_grip_to_east * cosine + model.discrepancy_grip_to_north * sine
    return min(max(share, -DISCREPANCY_LIMIT), DISCREPANCY_LIMIT)  # type: ignore[no-any-return]


@compile_function
def compute_affected_tangent(  # type: ignore[no-untyped-def]
    play: float, forward: float, east: float, north: float, cosine: float, sine: float, seconds: float,
    working: float, table, model,
) -> float:  # fmt: skip
    """Tangent of the mean front wheel angle the base model must have, with every effect between wheel and path.

    `cosine` and `sine` are those of the heading.
    """
    angle = play + model.offset
    extra = 0.0
    if model.discrepancy_model != 0.0:
        trust = compute_discrepancy_trust(play, forward, model)
        angle += trust * compute_discrepancy_angle(forward, cosine, sine, model)
        extra = trust * compute_discrepancy_grip(play, forward, cosine, sine, working, model)
    if model.understeer != 0.0:
        angle = solve_understeer(angle, forward, table, model)
    bend = compute_tangent(convert_to_base_angle(angle, table, model.lock)) * compute_curvature_factor(
        angle, east, north, seconds, model
    )
    bend = bend * (1.0 + extra) + (model.front + model.rear) * model.draft * working
    if model.slide > 0.0:
        bend = limit_curve_tangent(bend, forward, model)
    return bend


@compile_function
def compute_draft_crab_share(model, ground) -> float:  # type: ignore[no-untyped-def]
    """Share of a side draft's curvature times the wheelbase by which the rear axle slides out of the curve.

    A moment M turns a tractor on a wheelbase L with a curvature of M (1 / C_f + 1 / C_r) / L^2, where C is the side
    stiffness of an axle (its load times the slope of its tyres): the front axle slides in by M / (C_f L), the rear one
    out by M / (C_r L), a share C_f / (C_f + C_r) of both. A side force at the front axle has a share of 0, one at the
    rear axle 1, and one h behind the rear axle (L + h) C_f / (h C_r + (L + h) C_f).
    """
    front, rear = model.rear * ground.front_slope, model.front * ground.rear_slope
    return front / (front + rear)  # type: ignore[no-any-return]


@inline_function
def compute_draft_crab(forward: float, working: float, model, ground) -> float:  # type: ignore[no-untyped-def]
    """Speed (m/s, to the right) of the rear axle under the side draft of a working implement."""
    crab_m = compute_draft_crab_share(model, ground) * (model.front + model.rear)
    return -forward * working * model.draft * crab_m  # type: ignore[no-any-return]


@inline_function
def limit_curve_tangent(bend: float, forward: float, model) -> float:  # type: ignore[no-untyped-def]
    """Tangent of the curve that the side force of the tyres allows.

    `model.slide` is the inverse of the largest side force per weight: 0 stands for no limit.
    """
    share = abs(bend) * forward * forward * model.slide / ((model.front + model.rear) * GRAVITY_MPS2)
    remaining_share = compute_saturation_factor(share)
    return bend * (remaining_share if share > KNEE else 1.0)


@compile_function
def compute_ground_drift(  # type: ignore[no-untyped-def]
    play: float, forward: float, cosine: float, sine: float, model
) -> tuple[float, float]:
    """Drift speed (m/s, ahead and to the right) over the ground.

    A cross slope causes drift sideways only, the push of a discrepancy model in both directions.
    """
    ahead, right = 0.0, compute_slope_drift(forward, cosine, sine, model)
    if model.discrepancy_model != 0.0:
        ahead, aside = compute_discrepancy_push(play, forward, cosine, sine, model)
        right += aside
    return ahead, right


@compile_function
def compute_discrepancy_push(  # type: ignore[no-untyped-def]
    play: float, forward: float, cosine: float, sine: float, model
) -> tuple[float, float]:
    """Speed (m/s, ahead and to the right) of the push of the discrepancy model; none at standstill."""
    share = math.tanh(abs(forward) / CRAWL_MPS) * compute_discrepancy_trust(play, forward, model)
    ahead = share * (model.discrepancy_push_to_east * cosine + model.discrepancy_push_to_north * sine)
    return ahead, share * (model.discrepancy_push_to_east * sine - model.discrepancy_push_to_north * cosine)


@inline_function
def compute_slope_drift(forward: float, cosine: float, sine: float, model) -> float:  # type: ignore[no-untyped-def]
    """Speed (m/s, to the right) down a cross slope."""
    return abs(forward) * (model.slope_east * sine - model.slope_north * cosine)  # type: ignore[no-any-return]


@compile_function
def compute_ground_speed(wheel_speed: float, working: float, model) -> float:  # type: ignore[no-untyped-def]
    """Speed over ground at a commanded speed (below 0 in reverse), less wheel slip."""
    return wheel_speed * (1.0 - model.slip) * (1.0 - model.tool_slip * working)  # type: ignore[no-any-return]


@compile_function
def read_delayed(ring, step: int, late: float) -> float:  # type: ignore[no-untyped-def]
    """Value `late` steps before `step` in a ring written once per step, by linear interpolation."""
    size = len(ring)
    late = min(max(late, 0.0), size - 2.0)
    whole = int(late)
    share = late - whole
    return ring[(step - whole) % size] * (1.0 - share) + ring[(step - whole - 1) % size] * share  # type: ignore[no-any-return]
