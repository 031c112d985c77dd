"""What measured effects do to the steering, the path and the antenna: one formula each, for planning and for replay.

Every function takes a MODEL record of vehicle.layout; its fields of effects are filled by vehicle.effects and count
only where `affected` is set, so that a tractor without effects pays for one comparison.
"""

from __future__ import annotations

import math

from vehicle.jit import compiled
from vehicle.steering import corrected_angle

GRAVITY_MPS2 = 9.80665
DRIFT_LIMIT = 0.3  # grip that changes with time is not believed beyond this share of it
KNEE = 8.0  # how sharply a curve meets the limit of side force


@compiled
def played(play: float, steering: float, model) -> float:  # type: ignore[no-untyped-def]
    """Wheel angle behind the play of the linkage (rad): the wheels stay until the play is taken up."""
    half = model.half_play
    return min(max(play, steering - half), steering + half)  # type: ignore[no-any-return]


@compiled
def unstrained_angle(angle: float, forward: float, table, model) -> float:  # type: ignore[no-untyped-def]
    """Wheel angle left when a share of it is lost per lateral acceleration (rad).

    The loss depends on the acceleration, which depends on what is left; a few secant steps settle it, and unlike the
    acceleration of the step before they cannot swing.
    """
    if abs(angle) < 1e-6:
        return angle
    left = angle
    per_tangent = model.understeer * forward * forward / (model.front + model.rear)
    for _ in range(4):
        left = angle / (1.0 + per_tangent * math.tan(corrected_angle(left, table, model.lock)) / left)
    return left


@compiled
def grip(angle: float, east: float, north: float, seconds: float, model) -> float:  # type: ignore[no-untyped-def]
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


@compiled
def affected_tangent(  # type: ignore[no-untyped-def]
    play: float, forward: float, east: float, north: float, seconds: float, working: float, table, model
) -> float:
    """Tangent of the mean front wheel angle the base model must have, with every effect between wheel and path."""
    angle = play + model.offset
    if model.understeer != 0.0:
        angle = unstrained_angle(angle, forward, table, model)
    base = model.front + model.rear
    tangent = math.tan(corrected_angle(angle, table, model.lock)) * grip(angle, east, north, seconds, model)
    tangent += base * model.draft * working
    if model.slide > 0.0:
        # `slide` is the inverse of the side force the tyres can give, per weight: 0 stands for no limit.
        share = abs(tangent) * forward * forward * model.slide / (base * GRAVITY_MPS2)
        if share > 0.3:
            tangent /= (1.0 + share**KNEE) ** (1.0 / KNEE)
    return tangent  # type: ignore[no-any-return]


@compiled
def side_drift(forward: float, cosine: float, sine: float, model) -> float:  # type: ignore[no-untyped-def]
    """Sideways speed (m/s, to the right) at which the ground lets the tractor slide down a cross slope."""
    return abs(forward) * (model.slope_east * sine - model.slope_north * cosine)  # type: ignore[no-any-return]


@compiled
def ground_speed(wheel_speed: float, working: float, model) -> float:  # type: ignore[no-untyped-def]
    """Speed over ground that a commanded speed comes to under wheel slip."""
    return wheel_speed * (1.0 - model.slip) * (1.0 - model.tool_slip * working)  # type: ignore[no-any-return]


@compiled
def delayed(ring, step: int, late: float) -> float:  # type: ignore[no-untyped-def]
    """Value `late` steps before `step` in a ring written once per step, by linear interpolation."""
    size = len(ring)
    late = min(max(late, 0.0), size - 2.0)
    whole = int(late)
    share = late - whole
    return ring[(step - whole) % size] * (1.0 - share) + ring[(step - whole - 1) % size] * share  # type: ignore[no-any-return]


@compiled
def seen_pose(state, model) -> tuple[float, float, float]:  # type: ignore[no-untyped-def]
    """Centre of mass and heading as guidance believes them: late, biased, with the antenna where the file says."""
    x, y, true = state.x, state.y, state.angle
    last = state.clock - 1
    if model.latency > 0.0 and last >= 0:
        # The rings end with the pose one step ago.
        late = min(max(model.latency - 1.0, 0.0), float(last))
        share = min(model.latency, 1.0)
        x += share * (delayed(state.xs, last, late) - x)
        y += share * (delayed(state.ys, last, late) - y)
        true += share * (delayed(state.angles, last, late) - true)
    angle = true + model.heading_bias
    # The antenna stands at (forward + shift, shift) of the true heading; the file's lever is taken off the seen one.
    ahead = model.guide + model.shift_forward
    x += ahead * math.cos(true) + model.shift_right * math.sin(true) - model.guide * math.cos(angle)
    y += ahead * math.sin(true) - model.shift_right * math.cos(true) - model.guide * math.sin(angle)
    return x, y, angle
