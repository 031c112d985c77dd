"""What receiver and compass show of a tractor: the lever arm of the antenna, late positions, a biased heading.

One formula each, for guidance in the loop, for the replay of logs and for the filter that judges them.
"""

from __future__ import annotations

import math

from vehicle.jit import compiled
from vehicle.series import cosine_sine

# Rows of shown_rows: the late centre of mass and its true heading, then antenna and heading as they are shown.
LATE_X, LATE_Y, LATE_ANGLE, SHOWN_EAST, SHOWN_NORTH, SHOWN_HEADING = range(6)


@compiled
def lever(x: float, y: float, cosine: float, sine: float, ahead: float, aside: float) -> tuple[float, float]:
    """East and north (m) of a point `ahead` and `aside` (to the right) of a place, at a heading by cosine and sine."""
    return x + ahead * cosine + aside * sine, y + ahead * sine - aside * cosine


@compiled
def between(one: float, two: float, start: float, end: float, at: float) -> float:
    """Value at a time, from those at `start` and `end`: along the line between them, never beyond."""
    if at <= start:
        return one
    if at >= end:
        return two
    return (two - one) / (end - start) * (at - start) + one


@compiled
def late_pose(  # type: ignore[no-untyped-def]
    xs, ys, angles, entry: int, start: float, end: float, at: float
) -> tuple[float, float, float]:
    """Pose of a time gone by: x, y, angle from rings of poses, of which `entry` was at `start`, the next at `end`."""
    one, two = entry % len(xs), (entry + 1) % len(xs)
    return (
        between(xs[one], xs[two], start, end, at),
        between(ys[one], ys[two], start, end, at),
        between(angles[one], angles[two], start, end, at),
    )


@compiled
def shown_heading(angle: float, bias: float) -> float:
    """Heading that is shown of a true one (rad)."""
    return angle + bias


@compiled
def seen_pose(state, model) -> tuple[float, float, float]:  # type: ignore[no-untyped-def]
    """Centre of mass and heading as guidance believes them: what is shown, less the lever that the file says.

    Guidance allows for an antenna aside of the centre line, so only a shift from there counts. Notes the pose of now
    in the rings of the state, whose entries are one step apart.
    """
    now, size = state.clock, len(state.xs)
    place = now % size
    state.xs[place], state.ys[place], state.angles[place] = state.x, state.y, state.angle
    at = max(now - min(model.latency, size - 2.0), 0.0)
    before = min(int(at), now - 1)
    x, y, true = late_pose(state.xs, state.ys, state.angles, before, float(before), before + 1.0, at)
    heading = shown_heading(true, model.heading_bias)
    east, north = lever(
        -model.guide * math.cos(heading), -model.guide * math.sin(heading), math.cos(true), math.sin(true),
        model.guide + model.shift_forward, model.shift_right,
    )  # fmt: skip
    return x + east, y + north, heading


@compiled
def late_rows(time, grid, xs, ys, angles, latency: float, late_xs, late_ys, late_angles) -> None:  # type: ignore[no-untyped-def]
    """Poses (k,) of the times gone by `latency` before increasing ones (k,), of poses (n,) at the times `grid` (n,).

    All times and the latency in s.
    """
    entry = 0
    for row in range(len(time)):
        at = time[row] - latency
        while entry + 2 < len(grid) and grid[entry + 1] <= at:
            entry += 1
        share = min(max((at - grid[entry]) / (grid[entry + 1] - grid[entry]), 0.0), 1.0)
        late_xs[row] = xs[entry] + (xs[entry + 1] - xs[entry]) * share
        late_ys[row] = ys[entry] + (ys[entry + 1] - ys[entry]) * share
        late_angles[row] = angles[entry] + (angles[entry + 1] - angles[entry]) * share


@compiled
def shown_rows(  # type: ignore[no-untyped-def]
    time, grid, xs, ys, angles, latency: float, ahead: float, aside: float, bias: float, out
) -> None:
    """What is shown at increasing times (k,) of poses (n,) at the times `grid` (n,); `out` (6, k) gets it.

    All times and the latency in s. The antenna stands `ahead` and `aside` (m) of the centre of mass; `bias` (rad) is
    added to the heading that is shown and to nothing else.
    """
    late_xs, late_ys, late_angles = out[LATE_X], out[LATE_Y], out[LATE_ANGLE]
    late_rows(time, grid, xs, ys, angles, latency, late_xs, late_ys, late_angles)
    easts, norths, headings = out[SHOWN_EAST], out[SHOWN_NORTH], out[SHOWN_HEADING]
    for row in range(len(time)):
        cosine, sine = cosine_sine(late_angles[row])
        easts[row], norths[row] = lever(late_xs[row], late_ys[row], cosine, sine, ahead, aside)
    for row in range(len(time)):
        headings[row] = shown_heading(late_angles[row], bias)
