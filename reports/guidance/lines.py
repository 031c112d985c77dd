"""The guidance of a plan, as the planner hands it over."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

Degrees = npt.NDArray[np.float64]
"""Longitude and latitude (WGS 84) of points, (n, 2). Rings do not come back to their first point."""
TRACK, ROUND = "track", "round"


@dataclass(frozen=True, eq=False)
class Line:
    """A line that a tractor drives with its implement down, from its first point to its last.

    `order` counts the lines of a tractor in driving order from 1. `kind` is TRACK or ROUND, `words` say which one, as
    ``track 14a`` or ``round 2 side 3``; `name` has all of it and is different for every line of a plan. `bearing_deg`
    leads from the first to the last point, clockwise from true north. A straight line has two points.
    """

    name: str
    tractor: int
    order: int
    kind: str
    words: str
    points: Degrees
    length_m: float
    bearing_deg: float

    @property
    def place(self) -> tuple[int, int]:
        """Tractor and order; the stretches of a curve that was cut share theirs."""
        return self.tractor, self.order

    @property
    def straight(self) -> bool:
        """Whether it is a line from A to B."""
        return len(self.points) == 2


@dataclass(frozen=True, eq=False)
class Area:
    """Rings of a polygon, the outer one first, and what it is called."""

    name: str
    rings: tuple[Degrees, ...]


@dataclass(frozen=True, eq=False)
class TractorLines:
    """The lines of one tractor, counted from 1, in driving order."""

    number: int
    lines: tuple[Line, ...]


@dataclass(frozen=True, eq=False)
class Guidance:
    """What is driven on a field.

    `boundary` is None where the plan was saved without; `inside_headland` is what the rounds of the headland leave for
    tracks. `area_m2` is that of the boundary without its holes. `several` says whether the plan has other tractors than
    those of `tractors`, so that names tell which one is meant. `left_out` counts what of the plan is no guidance, in
    words.
    """

    field: str
    boundary: Area | None
    area_m2: float
    inside_headland: tuple[Area, ...]
    obstacles: tuple[Area, ...]
    entrance: tuple[float, float] | None
    tractors: tuple[TractorLines, ...]
    several: bool
    left_out: tuple[tuple[str, int], ...] = ()

    @property
    def lines(self) -> tuple[Line, ...]:
        """All lines, tractor after tractor in driving order."""
        return tuple(line for each in self.tractors for line in each.lines)

    def alone(self) -> tuple[Guidance, ...]:
        """The guidance of every tractor by itself."""
        return tuple(replace(self, tractors=(each,)) for each in self.tractors)
