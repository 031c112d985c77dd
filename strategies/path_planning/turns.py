"""Turns from the end of one swath to the start of a parallel one, and the headland they need."""

from __future__ import annotations

import math

import numpy as np

from fields.layout.swaths import WIDTH_STEP_M
from strategies.path_planning.paths import PATH_KINDS, DrivePath, build_path_from_rows
from strategies.path_planning.primitives import (
    MAX_PIECES,
    MAX_PRIMITIVES,
    add_forward_primitives,
    add_reverse_arc_primitives,
    add_reverse_straight_primitives,
)
from strategies.path_planning.turn_kinds import TURN_KINDS

DEPTH_STEP_M = 0.1
TURN_FAMILIES = add_forward_primitives, add_reverse_arc_primitives, add_reverse_straight_primitives


def list_turns(spacing_m: float, radius_m: float) -> list[DrivePath]:
    """The shortest turn of each family of primitives from a swath end that heads north to the next swath on its right.

    Of equally long ones it is that which bends towards the swath first. Where there is a plain U it is the only turn:
    nothing is quicker.
    """
    a, b = (0.0, 0.0, 0.5 * math.pi), (spacing_m, 0.0, -0.5 * math.pi)
    rows, kinds = np.empty((MAX_PRIMITIVES, MAX_PIECES, 3)), np.empty(MAX_PRIMITIVES, np.int64)
    turns = []
    for add_primitives in TURN_FAMILIES:
        count = add_primitives(np.array(a), np.array(b), radius_m, rows, kinds, 0)
        paths = [build_path_from_rows(a, rows[k], PATH_KINDS[kinds[k]]) for k in range(count)]
        turns.append(min(paths, key=lambda path: (round(path.length_m, 6), path.segments[0].curvature)))
        if turns[0].kind == "u":
            break
    return turns


def measure_turn_depth_m(turn: DrivePath) -> float:
    """How far beyond the end of the swath, which heads north, the turn reaches (m)."""
    return max(float(points[:, 1].max()) for _, points in turn.sample(DEPTH_STEP_M))


def list_allowed_kinds(turn: str) -> tuple[str, ...]:
    """The kinds of turn allowed by an option "auto" or a kind; the plain U is always allowed where it fits."""
    return TURN_KINDS if turn == "auto" else tuple(dict.fromkeys(("u", turn)))


def compute_headland_m(turn: str, width_m: float, radius_m: float, tool_m: float, margin_m: float) -> float:
    """Depth of headland in which the turn to a neighbouring swath fits (m), rounded up to half a metre.

    The implement works `tool_m` behind the guided point, which must drive on to finish the swath; the tractor or its
    implement, whichever is wider, reaches `margin_m` to either side of that point.

    The omega swings out: its middle arc, of the same radius R, touches the two outer ones, whose centres are R + s / 2
    beside it for tracks s apart, so that it lies sqrt((2 R)^2 - (R + s / 2)^2) farther out. Every other kind is one
    radius deep at most.
    """
    depth = radius_m
    if turn == "omega":
        depth += math.sqrt(4.0 * radius_m**2 - (radius_m + min(0.5 * width_m, radius_m)) ** 2)
    return math.ceil((tool_m + depth + margin_m) / WIDTH_STEP_M) * WIDTH_STEP_M
