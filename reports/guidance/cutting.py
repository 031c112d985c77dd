"""Curves cut into the straight stretches they are made of, for terminals that refuse curves."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import shapely

from fields.plane import Plane
from reports.guidance.lines import Guidance, Line

OFF_M = 0.05
"""A stretch leaves its curve by no more: half of what a tractor is steered to."""
MOST_STRETCHES = 8
"""A curve of more stretches is one to be steered as such: nobody chooses that many lines on the way."""
LETTERS = "abcdefgh"


def straight_alone(guidance: Guidance) -> Guidance:
    """The guidance in straight lines: curves of few stretches are cut, others left out. Other lines keep their names.

    Stretches have the order of their curve, and its name with a letter behind the number: ``T1 03b round 1 side 2``.
    """
    tractors = tuple(
        replace(each, lines=tuple(one for line in each.lines for one in _stretches(line))) for each in guidance.tractors
    )
    return replace(guidance, tractors=tractors)


def _stretches(line: Line) -> tuple[Line, ...]:
    """A straight line itself, a curve cut, or nothing for one that cannot be."""
    if line.straight:
        return (line,)
    plane = Plane(*line.points[0].tolist())
    metres = np.array([plane.metres(*point) for point in line.points.tolist()])
    kept = shapely.get_coordinates(shapely.linestrings(metres).simplify(OFF_M, preserve_topology=False))
    steps = np.diff(kept, axis=0)
    if not 1 <= len(steps) <= MOST_STRETCHES:
        return ()
    corners = np.array([plane.degrees(*point) for point in kept.tolist()])
    start = f"T{line.tractor} "
    number, _, rest = line.name.removeprefix(start).partition(" ")
    return tuple(
        replace(
            line,
            name=f"{start}{number}{LETTERS[place]} {rest}" if len(steps) > 1 else line.name,
            points=corners[place : place + 2],
            length_m=math.hypot(east_m, north_m),
            bearing_deg=math.degrees(math.atan2(east_m, north_m)) % 360.0,
        )
        for place, (east_m, north_m) in enumerate(steps.tolist())
    )
