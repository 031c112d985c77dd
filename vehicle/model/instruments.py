"""What receiver and compass show of a tractor: the lever arm of the antenna, late positions and headings, a bias.

Guidance in the loop, the replay of logs and the filter of the twin all use these formulas.
"""

from __future__ import annotations

import math

from vehicle.jit import compile_function
from vehicle.records import DT_S


@compile_function
def apply_lever_arm(x: float, y: float, cosine: float, sine: float, ahead: float, aside: float) -> tuple[float, float]:
    """East and north (m) of a point `ahead` and `aside` (to the right) of (x, y), by cosine and sine of the heading."""
    return x + ahead * cosine + aside * sine, y + ahead * sine - aside * cosine


@compile_function
def interpolate_at_time(start_value: float, end_value: float, start: float, end: float, time: float) -> float:
    """Value at a time by linear interpolation between the values at `start` and `end`; constant outside."""
    if time <= start:
        return start_value
    if time >= end:
        return end_value
    return (end_value - start_value) / (end - start) * (time - start) + start_value


@compile_function
def interpolate_past_pose(  # type: ignore[no-untyped-def]
    xs, ys, angles, entry: int, start: float, end: float, time: float
) -> tuple[float, float, float]:
    """Pose (x, y, angle) at a past time, from ring buffers in which `entry` is of `start` and the next of `end`."""
    first, second = entry % len(xs), (entry + 1) % len(xs)
    return (
        interpolate_at_time(xs[first], xs[second], start, end, time),
        interpolate_at_time(ys[first], ys[second], start, end, time),
        interpolate_at_time(angles[first], angles[second], start, end, time),
    )


@compile_function
def add_heading_bias(angle: float, bias: float) -> float:
    """The heading that is shown for a true one (rad)."""
    return angle + bias


@compile_function
def show_late_pose(state, model, x: float, y: float, angle: float) -> tuple[float, float, float, float]:  # type: ignore[no-untyped-def]
    """Pose (x, y, angle) at the time of the shown position, and the shown heading without its bias.

    Writes the current pose (x, y, angle) to the ring buffers of the state, whose entries are one step apart.
    """
    now, size = state.clock, len(state.xs)
    place = now % size
    state.xs[place], state.ys[place], state.angles[place] = x, y, angle
    at = max(now - min(model.latency + model.position_late, size - 2.0), 0.0)
    before = min(int(at), now - 1)
    late_x, late_y, late_angle = interpolate_past_pose(
        state.xs, state.ys, state.angles, before, float(before), before + 1.0, at
    )
    shown = late_angle
    if model.heading_late != model.position_late:
        at = max(now - min(model.latency + model.heading_late, size - 2.0), 0.0)
        before = min(int(at), now - 1)
        _, _, shown = interpolate_past_pose(state.xs, state.ys, state.angles, before, float(before), before + 1.0, at)
    if model.heading_filter > 0.0:
        shown = _filter_angles(state.angles, now, at, shown, compute_filter_share(model.heading_filter))
    return late_x, late_y, late_angle, shown


@compile_function
def _filter_angles(angles, now: int, at: float, latest: float, share: float) -> float:  # type: ignore[no-untyped-def]
    """First-order low pass of the ring of angles up to step `at`, whose angle is `latest`.

    What is older than the ring counts as its oldest entry.
    """
    first, step = max(now - len(angles) + 1, 0), int(at)
    filtered = angles[first % len(angles)]
    for entry in range(first + 1, step + 1):
        filtered += (angles[entry % len(angles)] - filtered) * share
    return filtered + (latest - filtered) * share * (at - step)  # type: ignore[no-any-return]


@compile_function
def compute_filter_share(time_constant_s: float) -> float:
    """Share of the way to its input that a first-order low pass goes in one step."""
    return 1.0 - math.exp(-DT_S / time_constant_s) if time_constant_s > 0.0 else 1.0


@compile_function
def compute_guidance_pose(state, model) -> tuple[float, float, float]:  # type: ignore[no-untyped-def]
    """Centre of mass and heading as guidance sees them: what is shown, less the lever arm of the tractor file.

    Guidance allows for an antenna beside the centre line, so only a shift from there counts.
    """
    x, y, true, shown = show_late_pose(state, model, state.x, state.y, state.angle)
    heading = add_heading_bias(shown, model.heading_bias)
    back_x, back_y = -model.guide * math.cos(heading), -model.guide * math.sin(heading)
    ahead, aside = model.guide + model.shift_forward, model.shift_right
    east, north = apply_lever_arm(back_x, back_y, math.cos(true), math.sin(true), ahead, aside)
    return x + east, y + north, heading
