"""Corners of a headland pass in closed form: what an arc misses of them, and how to turn in them.

The turn between two straight lines that cross is an arc that touches both: driven forwards on this side of the
crossing, or in reverse on the far side of it. Straights in either gear lead to it and from it.
"""

from __future__ import annotations

import math

from strategies.path_planning.paths import DrivePath, PathSegment, Pose, merge_segments

MIN_CROSSING_SINE = 0.05  # lines at a smaller angle have no useful crossing
SNAP_M = 0.03  # shorter straights are left out


def compute_missed_m2(turn_rad: float, width_m: float, radius_m: float, *, inside_round: bool = False) -> float:
    """Ground outside the arc of a corner driven with the implement down (m2); (1 - pi/4) (R + w/2)^2 for 90 degrees.

    The bar's outer end is on a circle of R + w/2; the corner of the outline lies outside it. With `inside_round` the
    next pass outside turned in an arc too: its bar's inner end, on a circle of R - w/2 that touches the same lines,
    took part of the corner, and 2 R w stands in place of (R + w/2)^2.
    """
    half_turn, half_width_m = 0.5 * abs(turn_rad), 0.5 * width_m
    inner_m = max(0.0, radius_m - half_width_m) if inside_round else 0.0
    return ((radius_m + half_width_m) ** 2 - inner_m**2) * (math.tan(half_turn) - half_turn)


def compute_tangent_m(turn_rad: float, radius_m: float) -> float:
    """Distance from the crossing of two lines to where the arc touches them (m)."""
    return radius_m * math.tan(0.5 * abs(turn_rad))


def find_corner_paths(a: Pose, b: Pose, radius_m: float) -> list[DrivePath]:
    """Straight, arc, straight between two poses on crossing lines: once with the arc forwards, once in reverse.

    Empty where the lines are almost parallel.
    """
    turn = math.remainder(b[2] - a[2], 2.0 * math.pi)
    sine = math.sin(turn)
    if abs(sine) < MIN_CROSSING_SINE:
        return []
    dx, dy = b[0] - a[0], b[1] - a[1]
    first_straight_m = (dx * math.sin(b[2]) - dy * math.cos(b[2])) / sine
    second_straight_m = (dx * math.sin(a[2]) - dy * math.cos(a[2])) / -sine
    touch_m, hand = compute_tangent_m(turn, radius_m), math.copysign(1.0, turn)
    paths = []
    for gear in (1, -1):
        lead, tail = first_straight_m - gear * touch_m, second_straight_m - gear * touch_m
        arc = PathSegment(radius_m * abs(turn), gear * hand / radius_m, gear)
        pieces = [*_make_straight_segment(lead), arc, *_make_straight_segment(tail)]
        kind = "switch-back" if any(piece.gear < 0 for piece in pieces) else "route"
        paths.append(merge_segments(a, pieces, kind))
    return paths


def _make_straight_segment(length_m: float) -> list[PathSegment]:
    if abs(length_m) < SNAP_M:
        return []
    return [PathSegment(abs(length_m), 0.0, 1 if length_m > 0.0 else -1)]
