"""Side-slip and side force of a tyre (chapter 4). Radians; positive to the right."""

from __future__ import annotations

import math

from vehicle.jit import compiled, inlined
from vehicle.series import arc_share

CREEP_MPS = 0.05  # below this speed slip angles are taken as if the wheel rolled this fast: no division by zero


@inlined
def per_rolling(rolling: float) -> float:
    """One over the speed (s/m) that slip is taken by."""
    return 1.0 / max(abs(rolling), CREEP_MPS)


@inlined
def limited(share: float, slide: float, limit: float) -> float:
    """Slip angle (rad), beyond `limit` that limit, over its tangent `slide`, of which it is the `share`."""
    if share * slide > limit:
        share = limit / slide
    return share


@compiled
def side_resistance(rolling: float, sliding: float, slope: float, limit: float) -> float:
    """Side force per load that a wheel sets against each m/s of sideways speed, from its velocity in its own frame.

    Times the sideways speed it is the side friction, linear in the slip angle up to `limit` and constant beyond
    (Eq. 4.1 to 4.4 at the wheel's place). The secant, not the derivative: it does not vanish beyond `limit`, where a
    derivative would leave the implicit step explicit and let saturated tyres throw a crawling tractor from one side to
    the other.
    """
    inverse = per_rolling(rolling)
    slide = abs(sliding) * inverse
    return slope * limited(arc_share(slide), slide, limit) * inverse


@compiled
def friction_curve(slip: float, peak_slip: float, peak: float, slide_slip: float, slide: float) -> float:
    """Share of the side friction a game engine's wheel passes on: straight up to (peak_slip, peak), then straight
    down to (slide_slip, slide), constant beyond. A `peak_slip` of 0 stands for no curve and gives 1.

    The side stiffness of Eq. 4.3 and 4.4 was written into the engine of the thesis, where it multiplies this curve.
    """
    if peak_slip == 0.0:
        return 1.0
    size = abs(slip)
    if size < peak_slip:
        return peak * size / peak_slip
    if size < slide_slip:
        return peak + (slide - peak) * (size - peak_slip) / (slide_slip - peak_slip)
    return slide


@compiled
def side_share(drive: float, grip: float) -> float:
    """Share of its side force a wheel keeps while it drives: the friction circle, with `grip` the most it can push.

    At the limit of the grip a twentieth stays, so that a spinning wheel still resists a little.
    """
    used = min(abs(drive) / grip, 1.0)
    return max(math.sqrt(1.0 - used * used), 0.05)
