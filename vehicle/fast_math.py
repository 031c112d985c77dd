"""Fast tangent, arctangent, sine and cosine for the angles that wheels and headings of a tractor usually have.

Power series that agree with the math library to the last bit or two; terms are summed in pairs, so that few additions
wait for each other. Tangents of larger angles, up to full lock, use a continued fraction (Lambert 1768).
"""

from __future__ import annotations

import math

from vehicle.jit import compile_function, inline_function

ROUNDING_OFFSET = 6755399441055744.0  # 1.5 times 2^52: adding it rounds to a whole number
# A right angle in three parts, the first two of 33 bits: up to a million right angles can be subtracted exactly (Cody
# and Waite 1980).
RIGHT_ANGLE_PARTS_RAD = (1.57079632673412561417e00, 6.07710050630396597660e-11, 2.02226624879595063154e-21)
SMALL_RAD = 0.1  # rad; the first term left out is below 1e-17 of the first one
NEAR_RAD = 0.8  # rad; the ninth convergent of Lambert's continued fraction for the tangent is off by less than 1e-17


@inline_function
def _compute_small_tangent_excess(z: float) -> float:
    """(tan(a) - a) / (a z) for angles a up to SMALL_RAD, with `z` their square."""
    zz = z * z
    low = (1.0 / 3.0 + 2.0 / 15.0 * z) + (17.0 / 315.0 + 62.0 / 2835.0 * z) * zz
    high = (1382.0 / 155925.0 + 21844.0 / 6081075.0 * z) + 929569.0 / 638512875.0 * zz
    return low + high * (zz * zz)


@inline_function
def _compute_moderate_tangent_excess(z: float) -> float:
    """As _compute_small_tangent_excess, for angles up to NEAR_RAD."""
    zz = z * z
    over = (11486475.0 - 810810.0 * z) + (12870.0 - 44.0 * z) * zz
    under = (34459425.0 - 16216200.0 * z) + (945945.0 - 13860.0 * z) * zz + 45.0 * (zz * zz)
    return over / under


@compile_function
def compute_tangent(angle: float) -> float:
    """Tangent of an angle (rad)."""
    size, z = abs(angle), angle * angle
    if size <= SMALL_RAD:
        return angle + angle * z * _compute_small_tangent_excess(z)
    if size <= NEAR_RAD:
        return angle + angle * z * _compute_moderate_tangent_excess(z)
    return math.tan(angle)


@inline_function
def compute_small_arctangent_ratio(slope: float) -> float:
    """As compute_arctangent_ratio, for slopes up to SMALL_RAD."""
    z = slope * slope
    zz = z * z
    low = (1.0 - 1.0 / 3.0 * z) + (1.0 / 5.0 - 1.0 / 7.0 * z) * zz
    high = (1.0 / 9.0 - 1.0 / 11.0 * z) + (1.0 / 13.0 - 1.0 / 15.0 * z) * zz
    return low + high * (zz * zz)


@compile_function
def compute_arctangent_ratio(slope: float) -> float:
    """atan(slope) / slope for a `slope` of 0 or more; 1 for 0."""
    if slope > SMALL_RAD:
        return math.atan(slope) / slope
    return compute_small_arctangent_ratio(slope)


@inline_function
def round_number(number: float) -> float:
    """The nearest whole number to one below 2^51, without a branch."""
    return (number + ROUNDING_OFFSET) - ROUNDING_OFFSET


@inline_function
def compute_cosine_sine(angle: float) -> tuple[float, float]:
    """Cosine and sine of an angle (rad) up to a quarter of a million turns, without branches so that loops vectorise.

    The angle is reduced by whole right angles; their number decides the signs and whether sine and cosine are swapped.
    """
    turns = round_number(angle * (2.0 / math.pi))
    x = (angle - turns * RIGHT_ANGLE_PARTS_RAD[0]) - turns * RIGHT_ANGLE_PARTS_RAD[1]
    x -= turns * RIGHT_ANGLE_PARTS_RAD[2]
    side = turns - 4.0 * round_number(0.25 * turns)  # -2 to 2
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


@inline_function
def compute_saturation_factor(size: float) -> float:
    """(1 + size^5)^(-1/5) for a size of 0 or more, without branches: a fit, good to 2e-5, and two Newton steps."""
    over = 1.0 / max(size, 1.0)
    less = over if size > 1.0 else size  # 1 + x^5 is x^5 (1 + x^-5)
    fifth = (less * less) * (less * less) * less
    base, squared = 1.0 + fifth, fifth * fifth
    root = (0.99998 - 0.19887 * fifth) + (0.1102 - 0.05499 * fifth) * squared + 0.01425 * (squared * squared)
    for _ in range(2):
        square = root * root
        root += 0.2 * root * (1.0 - base * (square * square * root))
    return root * over
