"""Functions by their power series: of what the wheels of a tractor mostly turn and slip by, and of its heading.

Each is the library's function to the last bit or two. The terms are summed in pairs, so that few wait for each other.
Tangents of larger angles, up to those of full lock, are those of a continued fraction (Lambert 1768).
"""

from __future__ import annotations

import math

from vehicle.jit import compiled, inlined

WHOLE = 6755399441055744.0  # 1.5 times 2^52: what is added to it is rounded to a whole number
# A right angle in three parts, the first two of 33 bits: up to a million of them are taken off an angle exactly (Cody
# and Waite 1980).
RIGHT_ANGLE = (1.57079632673412561417e00, 6.07710050630396597660e-11, 2.02226624879595063154e-21)
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


@inlined
def rounded(number: float) -> float:
    """The whole number next to one that is not huge, without a branch."""
    return (number + WHOLE) - WHOLE


@inlined
def cosine_sine(angle: float) -> tuple[float, float]:
    """Cosine and sine of an angle (rad) up to a quarter of a million turns, without a branch for the sake of vectors.

    Both of what is left beside whole right angles change places and signs by how many of those there were.
    """
    turns = rounded(angle * (2.0 / math.pi))
    x = ((angle - turns * RIGHT_ANGLE[0]) - turns * RIGHT_ANGLE[1]) - turns * RIGHT_ANGLE[2]
    side = turns - 4.0 * rounded(0.25 * turns)  # -2 to 2
    z = x * x
    zz = z * z
    low = (1.0 / 6.0 - 1.0 / 120.0 * z) + (1.0 / 5040.0 - 1.0 / 362880.0 * z) * zz
    high = (1.0 / 39916800.0 - 1.0 / 6227020800.0 * z) + 1.0 / 1307674368000.0 * zz
    sine = x - x * z * (low + high * (zz * zz))
    low = (1.0 / 24.0 - 1.0 / 720.0 * z) + (1.0 / 40320.0 - 1.0 / 3628800.0 * z) * zz
    high = (1.0 / 479001600.0 - 1.0 / 87178291200.0 * z) + 1.0 / 20922789888000.0 * zz
    cosine = (1.0 - 0.5 * z) + zz * (low + high * (zz * zz))
    odd = abs(side) == 1.0
    along, across = (sine if odd else cosine), (cosine if odd else sine)
    along = -along if abs(side + 0.5) > 1.0 else along
    across = -across if abs(side - 0.5) > 1.0 else across
    return along, across


@inlined
def knee_share(size: float) -> float:
    """(1 + size^5)^(-1/5) of a size of 0 or more, without a branch.

    A curve through it, good to 2e-5, and two steps of Newton's.
    """
    over = 1.0 / max(size, 1.0)
    less = over if size > 1.0 else size  # 1 + x^5 is x^5 (1 + x^-5)
    fifth = (less * less) * (less * less) * less
    one, two = 1.0 + fifth, fifth * fifth
    root = (0.99998 - 0.19887 * fifth) + (0.1102 - 0.05499 * fifth) * two + 0.01425 * (two * two)
    for _ in range(2):
        square = root * root
        root += 0.2 * root * (1.0 - one * (square * square * root))
    return root * over
