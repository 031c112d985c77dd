"""Families of compiled primitives as paths, the shortest first, for comparing them with other geometry."""

from collections.abc import Callable

import numpy as np

from strategies.path_planning.paths import PATH_KINDS, DrivePath, Pose, build_path_from_rows
from strategies.path_planning.primitives import (
    MAX_PIECES,
    MAX_PRIMITIVES,
    add_forward_primitives,
    add_reverse_arc_primitives,
    add_reverse_straight_primitives,
)


def find_dubins_paths(a: Pose, b: Pose, radius_m: float) -> list[DrivePath]:
    """LSL, RSR, LSR, RSL, LRL and RLR where they exist, the last two with both places of the middle circle."""
    return _build_family_paths(add_forward_primitives, a, b, radius_m)


def find_three_arc_paths(a: Pose, b: Pose, radius_m: float) -> list[DrivePath]:
    """C|C|C (forward, reverse, forward) to either hand; those that turn by at most a full turn."""
    return _build_family_paths(add_reverse_arc_primitives, a, b, radius_m)


def find_backing_paths(a: Pose, b: Pose, radius_m: float) -> list[DrivePath]:
    """Arc forward, straight in reverse, arc forward; those that turn by at most a full turn."""
    return _build_family_paths(add_reverse_straight_primitives, a, b, radius_m)


def _build_family_paths(add_primitives: Callable[..., int], a: Pose, b: Pose, radius_m: float) -> list[DrivePath]:
    rows, kinds = np.empty((MAX_PRIMITIVES, MAX_PIECES, 3)), np.empty(MAX_PRIMITIVES, np.int64)
    count = add_primitives(np.array(a, float), np.array(b, float), float(radius_m), rows, kinds, 0)
    paths = [build_path_from_rows(a, rows[index], PATH_KINDS[kinds[index]]) for index in range(count)]
    return sorted(paths, key=lambda path: round(path.length_m, 9))
