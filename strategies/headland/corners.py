"""What an arc misses of the corners of a headland pass, in closed form."""

from __future__ import annotations

import math


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
