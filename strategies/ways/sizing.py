"""How much headland turns need, and how much of it a turn may use."""

from __future__ import annotations

import math
from dataclasses import dataclass

from strategies.ways.turns import TURN_KINDS, turn_depth

HEADLAND_STEP_M = 0.5


@dataclass(frozen=True)
class Reach:
    """What a turn needs beyond its own depth (m).

    `tool_m`: the implement works so far behind the guided point, which must drive on to finish the track.
    `margin_m`: so far the tractor or its implement, whichever is wider, reaches to either side of the guided point.
    """

    tool_m: float
    margin_m: float


def allowed_kinds(turn: str) -> tuple[str, ...]:
    """The kinds of turn for "auto" or one that is asked for; the plain U is allowed beside it where it fits."""
    return TURN_KINDS if turn == "auto" else tuple(dict.fromkeys(("u", turn)))


def headland_for(turn: str, width_m: float, radius_m: float, reach: Reach) -> float:
    """Depth (m) in which the turn to a neighbouring track fits, by the half metre.

    "auto" is sized for the switch-back, the shallowest.
    """
    kind = turn if turn in ("omega", "switch-back") else "switch-back"
    depth = max(turn_depth(kind, min(width_m, 2.0 * radius_m), radius_m), radius_m)
    return math.ceil((reach.tool_m + depth + reach.margin_m) / HEADLAND_STEP_M) * HEADLAND_STEP_M


def turning_room(headland_m: float, reach: Reach) -> float:
    """What a headland met squarely leaves for the depth of a turn (m); negative where it is too shallow for any."""
    return headland_m - reach.tool_m - reach.margin_m
