"""What measured effects do to the steering and the path: one formula each, for planning and for replay.

Every function takes a MODEL record of vehicle.layout; its fields of effects are filled by vehicle.effects and count
only where `affected` is set, so that a tractor without effects pays for one comparison.
"""

from __future__ import annotations

import math

from vehicle.jit import compiled, inlined
from vehicle.rest import FADE
from vehicle.series import knee_share, tangent
from vehicle.steering import corrected_angle

GRAVITY_MPS2 = 9.80665
DRIFT_LIMIT = 0.3  # grip that changes with time is not believed beyond this share of it
KNEE = 0.3  # of the limit of side force: below it nothing is lost, at four fifths of it 5 % of a curve (knee_share)
REST_LIMIT = 0.9  # of the curvature: a rest told at some speeds and angles must not turn a tractor the other way
SECANTS = 4  # chosen: each leaves a twentieth of what is left to settle, at usual losses
STRAIGHT_RAD = 1e-6  # below it nothing is lost
CRAWL_MPS = 0.1  # below it a push fades out: a tractor that stands stays


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
    if abs(angle) < STRAIGHT_RAD:
        return angle
    left, lost = angle, lost_share(forward, model)
    for _ in range(SECANTS):
        left = secant_step(angle, left, tangent(corrected_angle(left, table, model.lock)), lost)
    return left


@inlined
def lost_share(forward: float, model) -> float:  # type: ignore[no-untyped-def]
    """Wheel angle (rad) lost per tangent of what is left, at a speed."""
    return model.understeer * forward * forward / (model.front + model.rear)  # type: ignore[no-any-return]


@inlined
def secant_step(angle: float, left: float, bend: float, lost: float) -> float:
    """Wheel angle left (rad) of an `angle`, from a first answer and the tangent that it stands for."""
    return angle * left / (left + lost * bend)


@inlined
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
def beyond(value: float, low: float, high: float) -> float:
    """How far a value lies outside a range, as a share of the width within which trust fades."""
    return max(low - value, value - high, 0.0) / (FADE * (high - low))


@compiled
def rest_trust(angle: float, forward: float, model) -> float:  # type: ignore[no-untyped-def]
    """How far the rest is trusted at a wheel angle and speed: 1 where it was seen, 0 away from there."""
    far = max(beyond(abs(forward), model.rest_slow, model.rest_fast), beyond(angle, model.rest_left, model.rest_right))
    return max(1.0 - far, 0.0)


@compiled
def rest_angle(forward: float, cosine: float, sine: float, model) -> float:  # type: ignore[no-untyped-def]
    """Extra wheel angle (rad) of the rest."""
    pace = abs(forward)
    along = model.rest_angle_to_east * cosine + model.rest_angle_to_north * sine
    return model.rest_angle_by_speed * pace + model.rest_angle_by_square * pace * pace + along  # type: ignore[no-any-return]


@compiled
def rest_grip(  # type: ignore[no-untyped-def]
    angle: float, forward: float, cosine: float, sine: float, working: float, model
) -> float:
    """Extra share of the curvature of the rest, never so much that a turn comes to nothing or doubles."""
    share = model.rest_grip_by_speed * abs(forward) + model.rest_grip_by_angle * abs(angle)
    share += model.rest_grip_by_implement * working
    share += model.rest_grip_to_east * cosine + model.rest_grip_to_north * sine
    return min(max(share, -REST_LIMIT), REST_LIMIT)  # type: ignore[no-any-return]


@compiled
def affected_tangent(  # type: ignore[no-untyped-def]
    play: float, forward: float, east: float, north: float, cosine: float, sine: float, seconds: float,
    working: float, table, model,
) -> float:  # fmt: skip
    """Tangent of the mean front wheel angle the base model must have, with every effect between wheel and path.

    `cosine` and `sine` are those of the heading.
    """
    angle = play + model.offset
    extra = 0.0
    if model.rest != 0.0:
        trust = rest_trust(play, forward, model)
        angle += trust * rest_angle(forward, cosine, sine, model)
        extra = trust * rest_grip(play, forward, cosine, sine, working, model)
    if model.understeer != 0.0:
        angle = unstrained_angle(angle, forward, table, model)
    bend = tangent(corrected_angle(angle, table, model.lock)) * grip(angle, east, north, seconds, model)
    bend = worked(bend, extra, working, model)
    if model.slide > 0.0:
        bend = within_slide(bend, forward, model)
    return bend


@inlined
def worked(bend: float, extra: float, working: float, model) -> float:  # type: ignore[no-untyped-def]
    """Tangent with an extra share of the rest and the draft of a working implement."""
    return bend * (1.0 + extra) + (model.front + model.rear) * model.draft * working  # type: ignore[no-any-return]


@inlined
def within_slide(bend: float, forward: float, model) -> float:  # type: ignore[no-untyped-def]
    """Tangent of a curve that the side force of the tyres allows.

    `slide` is the inverse of the side force the tyres can give, per weight: 0 stands for no limit.
    """
    share = abs(bend) * forward * forward * model.slide / ((model.front + model.rear) * GRAVITY_MPS2)
    kept = knee_share(share)
    return bend * (kept if share > KNEE else 1.0)


@compiled
def ground_drift(  # type: ignore[no-untyped-def]
    play: float, forward: float, cosine: float, sine: float, model
) -> tuple[float, float]:
    """Speed (m/s, ahead and to the right) at which the ground itself carries the tractor.

    Down a cross slope only sideways; as the rest pushes a tractor that moves, either way.
    """
    ahead, right = 0.0, down_slope(forward, cosine, sine, model)
    if model.rest != 0.0:
        ahead, aside = pushed_along(play, forward, cosine, sine, model)
        right += aside
    return ahead, right


@compiled
def pushed_along(  # type: ignore[no-untyped-def]
    play: float, forward: float, cosine: float, sine: float, model
) -> tuple[float, float]:  # fmt: skip
    """Speed (m/s, ahead and to the right) of the push of the rest."""
    share = math.tanh(abs(forward) / CRAWL_MPS) * rest_trust(play, forward, model)
    ahead = share * (model.rest_push_to_east * cosine + model.rest_push_to_north * sine)
    return ahead, share * (model.rest_push_to_east * sine - model.rest_push_to_north * cosine)


@inlined
def down_slope(forward: float, cosine: float, sine: float, model) -> float:  # type: ignore[no-untyped-def]
    """Speed (m/s, to the right) down a cross slope."""
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
