"""Legs of a mission: places to wait on them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from vehicle.missions.plan import Leg, Mission

PATH_STEP_M = 0.25  # between the points of a path, and between places on a line where the body's room is measured
MIN_STEP_M = 1e-3  # of a path: no leg begins with a shorter one, which would give it no direction


def add_wait_points(legs: Sequence[Leg], every_m: float) -> list[Leg]:
    """The same legs with a place to wait before each, and about every `every_m` metres on those driven forwards."""
    split_legs: list[Leg] = []
    for leg in legs:
        steps_m = np.hypot(*np.diff(leg.points, axis=0).T)
        distances_m = np.concatenate(([0.0], np.cumsum(steps_m)))
        parts = max(1, round(distances_m[-1] / every_m)) if leg.gear > 0 else 1
        cuts = np.searchsorted(distances_m, distances_m[-1] * np.arange(1, parts) / parts)
        cuts = cuts[steps_m[np.minimum(cuts, len(steps_m) - 1)] > MIN_STEP_M]
        for a, b in pairwise([0, *sorted(set(cuts.tolist()) - {0, len(distances_m) - 1}), len(distances_m) - 1]):
            may_wait = leg.may_wait if a == 0 and split_legs and split_legs[-1].gear != leg.gear else True
            part = replace(leg, points=leg.points[a : b + 1], may_wait=may_wait, fold_s=0.0 if a else leg.fold_s)
            split_legs.append(part.copy_with_length(float(steps_m[a:b].sum())))
    return split_legs


def make_mission(legs: Sequence[Leg]) -> Mission:
    """The legs as a mission in which the tractor may wait before it starts."""
    return Mission((legs[0].copy_with(may_wait=True), *legs[1:]))
