"""Re-anchoring in closed form: every piece of a replay gets its own best turn and shift before its error is taken."""

from __future__ import annotations

import math

import numpy as np

from vehicle.jit import compiled
from vehicle.series import cosine_sine, rounded

HEADING_TRUST_RAD = 0.035  # 2 degrees, what a compass may be off
POSITION_TRUST_M = 0.01  # a centimetre, what a receiver with corrections is off


@compiled
def best_motion(  # type: ignore[no-untyped-def]
    first, end, east, north, heading, x, y, angle
) -> tuple[float, float, float, float, float]:
    """Turn that lays rows `first` to `end` of a simulation on the measurement, and the middles of both (east, north).

    Positions decide the turn; headings only where the tractor hardly moves.
    """
    cosines, sines = np.empty(end), np.empty(end)
    _turned(heading[:end], angle, cosines, sines)
    cosine, sine, pe, pn, qe, qn = _motion(first, end, east, north, x, y, cosines, sines)
    return math.atan2(sine, cosine), pe, pn, qe, qn


@compiled
def _turned(heading, angle, cosines, sines) -> None:  # type: ignore[no-untyped-def]
    """Cosines and sines (k,) of what headings (k,) exceed angles by."""
    for k in range(len(heading)):
        cosines[k], sines[k] = cosine_sine(heading[k] - angle[k])


@compiled
def _motion(  # type: ignore[no-untyped-def]
    first, end, east, north, x, y, cosines, sines
) -> tuple[float, float, float, float, float, float]:
    """Cosine and sine of the turn of best_motion, and the middles, from those of what headings exceed angles by."""
    pe = pn = qe = qn = sine = cosine = 0.0
    for k in range(first, end):
        pe += east[k]
        pn += north[k]
        qe += x[k]
        qn += y[k]
        sine += sines[k]
        cosine += cosines[k]
    rows = end - first
    pe, pn, qe, qn = pe / rows, pn / rows, qe / rows, qn / rows
    cosine, sine = _unit(cosine, sine)
    trust = rows * (POSITION_TRUST_M / HEADING_TRUST_RAD) ** 2
    cosine, sine = trust * cosine, trust * sine
    for k in range(first, end):
        ae, an, be, bn = east[k] - pe, north[k] - pn, x[k] - qe, y[k] - qn
        sine += be * an - bn * ae
        cosine += be * ae + bn * an
    cosine, sine = _unit(cosine, sine)
    return cosine, sine, pe, pn, qe, qn


@compiled
def _unit(cosine: float, sine: float) -> tuple[float, float]:
    """The direction of a sum of directions, by its cosine and sine; straight ahead where they cancel."""
    size = math.hypot(cosine, sine)
    if size == 0.0:
        return 1.0, 0.0
    return cosine / size, sine / size


@compiled
def anchor_pieces(starts, ends, east, north, heading, x, y, angle, out) -> None:  # type: ignore[no-untyped-def]
    """Errors per row after the best rigid motion of each simulated piece: `out` (k, 3) gets cross, along, heading.

    `starts`, `ends` (p,) bound the pieces in rows; `east`, `north`, `heading` are measured, `x`, `y`, `angle`
    simulated. Rows outside every piece are left as they are.
    """
    rows = len(east)
    cosines, sines, there, across = np.empty(rows), np.empty(rows), np.empty(rows), np.empty(rows)
    _turned(heading, angle, cosines, sines)
    for k in range(rows):
        there[k], across[k] = cosine_sine(heading[k])
    for piece in range(len(starts)):
        first, end = starts[piece], ends[piece]
        cosine, sine, pe, pn, qe, qn = _motion(first, end, east, north, x, y, cosines, sines)
        turn = math.atan2(sine, cosine)
        for k in range(first, end):
            be, bn = x[k] - qe, y[k] - qn
            off_east, off_north = east[k] - pe - be * cosine + bn * sine, north[k] - pn - be * sine - bn * cosine
            out[k, 0] = off_east * across[k] - off_north * there[k]
            out[k, 1] = off_east * there[k] + off_north * across[k]
            left = heading[k] - angle[k] - turn
            out[k, 2] = left - 2.0 * math.pi * rounded(left / (2.0 * math.pi))


@compiled
def add_off_middle(starts, ends, values, out) -> None:  # type: ignore[no-untyped-def]
    """Add values (k,) to `out` (k,), in every piece (of anchor_pieces) about their own middle there."""
    for piece in range(len(starts)):
        first, end = starts[piece], ends[piece]
        whole = 0.0
        for k in range(first, end):
            whole += values[k]
        middle = whole / (end - first)
        for k in range(first, end):
            out[k] += values[k] - middle
