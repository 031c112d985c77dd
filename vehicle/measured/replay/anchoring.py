"""Re-anchoring in closed form: every piece of a replay gets its own best turn and shift before its error is taken."""

from __future__ import annotations

import math

from vehicle.jit import compiled

HEADING_TRUST_RAD = 0.035  # 2 degrees, what a compass may be off
POSITION_TRUST_M = 0.01  # a centimetre, what a receiver with corrections is off


@compiled
def best_motion(  # type: ignore[no-untyped-def]
    first, end, east, north, heading, x, y, angle
) -> tuple[float, float, float, float, float]:
    """Turn that lays rows `first` to `end` of a simulation on the measurement, and the middles of both (east, north).

    Positions decide the turn; headings only where the tractor hardly moves.
    """
    rows = end - first
    pe = pn = qe = qn = sine = cosine = 0.0
    for k in range(first, end):
        pe += east[k] / rows
        pn += north[k] / rows
        qe += x[k] / rows
        qn += y[k] / rows
        sine += math.sin(heading[k] - angle[k])
        cosine += math.cos(heading[k] - angle[k])
    mean = math.atan2(sine, cosine)
    trust = rows * (POSITION_TRUST_M / HEADING_TRUST_RAD) ** 2
    sine, cosine = trust * math.sin(mean), trust * math.cos(mean)
    for k in range(first, end):
        ae, an, be, bn = east[k] - pe, north[k] - pn, x[k] - qe, y[k] - qn
        sine += be * an - bn * ae
        cosine += be * ae + bn * an
    return math.atan2(sine, cosine), pe, pn, qe, qn


@compiled
def anchor_pieces(starts, ends, east, north, heading, x, y, angle, out) -> None:  # type: ignore[no-untyped-def]
    """Errors per row after the best rigid motion of each simulated piece: `out` (k, 3) gets cross, along, heading.

    `starts`, `ends` (p,) bound the pieces in rows; `east`, `north`, `heading` are measured, `x`, `y`, `angle`
    simulated. Rows outside every piece are left as they are.
    """
    for piece in range(len(starts)):
        first, end = starts[piece], ends[piece]
        turn, pe, pn, qe, qn = best_motion(first, end, east, north, heading, x, y, angle)
        cosine, sine = math.cos(turn), math.sin(turn)
        for k in range(first, end):
            be, bn = x[k] - qe, y[k] - qn
            off_east, off_north = east[k] - pe - be * cosine + bn * sine, north[k] - pn - be * sine - bn * cosine
            there, across = math.cos(heading[k]), math.sin(heading[k])
            out[k, 0] = off_east * across - off_north * there
            out[k, 1] = off_east * there + off_north * across
            left = heading[k] - angle[k] - turn
            out[k, 2] = math.atan2(math.sin(left), math.cos(left))


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
