"""Functions of small arguments by their power series: what the wheels of a tractor mostly turn and slip by.

Each is the library's function to the last bit or two. The terms are summed in pairs, so that few wait for each other.
Tangents of larger angles, up to those of full lock, are those of a continued fraction (Lambert 1768).
"""

from __future__ import annotations

import math

from vehicle.jit import compiled, inlined

SMALL = 0.1  # rad; the first term left out is below 1e-17 of the first one
NEAR = 0.8  # rad; the ninth convergent of Lambert's continued fraction for the tangent is off by less than 1e-17


@inlined
def _of_small(z: float) -> float:
    """What a tangent exceeds its angle by, over the angle and its square `z`, of angles up to SMALL."""
    zz = z * z
    low = (1.0 / 3.0 + 2.0 / 15.0 * z) + (17.0 / 315.0 + 62.0 / 2835.0 * z) * zz
    high = (1382.0 / 155925.0 + 21844.0 / 6081075.0 * z) + 929569.0 / 638512875.0 * zz
    return low + high * (zz * zz)


@inlined
def _of_near(z: float) -> float:
    """As _of_small, of angles up to NEAR."""
    zz = z * z
    over = (11486475.0 - 810810.0 * z) + (12870.0 - 44.0 * z) * zz
    under = (34459425.0 - 16216200.0 * z) + (945945.0 - 13860.0 * z) * zz + 45.0 * (zz * zz)
    return over / under


@inlined
def near_tangent(angle: float) -> float:
    """tangent of an angle up to NEAR, worked out both ways: only without a branch are loops made of vectors."""
    z = angle * angle
    small, near = _of_small(z), _of_near(z)
    return angle + angle * z * (small if abs(angle) <= SMALL else near)


@compiled
def tangent(angle: float) -> float:
    """Tangent of an angle (rad)."""
    size, z = abs(angle), angle * angle
    if size <= SMALL:
        return angle + angle * z * _of_small(z)
    if size <= NEAR:
        return angle + angle * z * _of_near(z)
    return math.tan(angle)


@inlined
def small_arc_share(slope: float) -> float:
    """arc_share of a tangent up to SMALL."""
    z = slope * slope
    zz = z * z
    low = (1.0 - 1.0 / 3.0 * z) + (1.0 / 5.0 - 1.0 / 7.0 * z) * zz
    high = (1.0 / 9.0 - 1.0 / 11.0 * z) + (1.0 / 13.0 - 1.0 / 15.0 * z) * zz
    return low + high * (zz * zz)


@compiled
def arc_share(slope: float) -> float:
    """The angle (rad) of a tangent `slope` of 0 or more, over that tangent; 1 for none."""
    if slope > SMALL:
        return math.atan(slope) / slope
    return small_arc_share(slope)
