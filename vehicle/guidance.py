"""Path following: projection on a polyline, lookahead target, steering command (Eq. 2.5)."""

from __future__ import annotations

import math

from vehicle.jit import compiled

TURN = 2.0 * math.pi


@compiled
def wrapped(angle: float) -> float:
    """Angle in (-pi, pi] but for rounding, by whole turns."""
    return angle - TURN * math.ceil((angle - math.pi) / TURN)


@compiled
def steering_command(
    lateral: float, heading: float, lateral_gain: float, heading_gain: float, lateral_limit: float, lock: float
) -> float:
    """Eq. 2.5: positive `lateral` means the path lies to the right, positive `heading` the target does.

    The lateral error counts up to `lateral_limit`: with the slew limit of Eq. 2.8 the plain law never converges
    from offsets of 1.5 m and more but weaves about the path.
    """
    lateral = min(max(lateral, -lateral_limit), lateral_limit)
    return min(max(lateral_gain * lateral + heading_gain * heading, -lock), lock)


@compiled
def project(
    points: object, cumulative: object, segment: int, last: int, x: float, y: float
) -> tuple[int, float, float]:
    """Advance along a polyline to the segment abreast of (x, y).

    `points` (n, 2) and `cumulative` (n,) describe the path; the search starts at `segment`, never goes back and
    never beyond `last`. A segment without length is a jump to another path and passed at once. Returns the segment,
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


@compiled
def target_point(points: object, cumulative: object, segment: int, last: int, progress: float) -> tuple[float, float]:
    """Point at `progress` along the path, at or after `segment`; straight on beyond the end of `last`."""
    while segment < last and cumulative[segment + 1] < progress:  # type: ignore[index]
        segment += 1
    length = cumulative[segment + 1] - cumulative[segment]  # type: ignore[index]
    share = (progress - cumulative[segment]) / length  # type: ignore[index]
    x = points[segment, 0] + share * (points[segment + 1, 0] - points[segment, 0])  # type: ignore[index]
    y = points[segment, 1] + share * (points[segment + 1, 1] - points[segment, 1])  # type: ignore[index]
    return x, y
