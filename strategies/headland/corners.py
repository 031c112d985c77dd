"""Corners of a round of the headland in closed form: how far the implement works into them, and how to turn in them.

A round of width w turns by the angle d at a corner. So that no ground is missed the side before it is worked until
the whole bar is inside what the next side covers, and the next side from where nothing is left behind the bar, both
measured from the corner along the side (positive: past it):

    d <= 90 degrees    before: -w/2 tan(d/2)       after: -w/2 tan(d/2) (1 + 2 cos d)
    d >= 90 degrees    before: -w/2 cot(d/2)       after: -w/2 tan(d/2)

The turn between two straight lines that cross is an arc that touches both: driven forwards on this side of the
crossing, or in reverse on the far side of it. Straights in either gear lead to it and from it.
"""

from __future__ import annotations

import math

from strategies.ways.paths import Path, Pose, Segment, ahead, make_path

SHARPEST = 3.0  # tangent of half the turn; nobody backs into a corner that is sharper
LEAST_SINE = 0.05  # lines that cross at less have no useful crossing
SNAP_M = 0.03  # shorter straights are left out


def worked_into(turn_rad: float, width_m: float) -> tuple[float, float]:
    """Where the bar ends before a corner and begins after it, metres past the corner along either side."""
    half_turn = min(0.5 * abs(turn_rad), math.atan(SHARPEST))
    tangent, half = math.tan(half_turn), 0.5 * width_m
    if tangent <= 1.0:
        return -half * tangent, -half * tangent * (1.0 + 2.0 * math.cos(2.0 * half_turn))
    return -half / tangent, -half * tangent


def missed_m2(turn_rad: float, width_m: float, radius_m: float) -> float:
    """Ground outside the arc of a corner that is driven round with the implement down; (1 - pi/4) (R + w/2)^2 for 90.

    The bar's outer end is on a circle of R + w/2; the corner of the outline lies outside it.
    """
    outer, half_turn = radius_m + 0.5 * width_m, 0.5 * abs(turn_rad)
    return outer**2 * (math.tan(half_turn) - half_turn)


def tangent_m(turn_rad: float, radius_m: float) -> float:
    """Distance from the crossing of two lines to where the arc touches them."""
    return radius_m * math.tan(0.5 * abs(turn_rad))


def corner_ways(a: Pose, b: Pose, radius_m: float) -> list[Path]:
    """Straight, arc, straight between two poses on crossing lines: the arc forwards, and the arc in reverse.

    Empty where the lines are all but parallel.
    """
    turn = math.remainder(b[2] - a[2], 2.0 * math.pi)
    sine = math.sin(turn)
    if abs(sine) < LEAST_SINE:
        return []
    dx, dy = b[0] - a[0], b[1] - a[1]
    on = (dx * math.sin(b[2]) - dy * math.cos(b[2])) / sine
    past = (dx * math.sin(a[2]) - dy * math.cos(a[2])) / -sine
    touch, hand = tangent_m(turn, radius_m), math.copysign(1.0, turn)
    ways = []
    for gear in (1, -1):
        lead, tail = on - gear * touch, past - gear * touch
        arc = Segment(radius_m * abs(turn), gear * hand / radius_m, gear)
        pieces = [*_straight(lead), arc, *_straight(tail)]
        kind = "switch-back" if any(piece.gear < 0 for piece in pieces) else "route"
        ways.append(make_path(a, pieces, kind))
    return ways


def corner_arc(corner: tuple[float, float], heading: float, turn_rad: float, radius_m: float) -> Path:
    """The arc alone that cuts a corner reached with a heading."""
    start = ahead((*corner, heading), -tangent_m(turn_rad, radius_m))
    hand = math.copysign(1.0, turn_rad)
    return make_path(start, [Segment(radius_m * abs(turn_rad), hand / radius_m, 1)], "route")


def _straight(length_m: float) -> list[Segment]:
    if abs(length_m) < SNAP_M:
        return []
    return [Segment(abs(length_m), 0.0, 1 if length_m > 0.0 else -1)]
