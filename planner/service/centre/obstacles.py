"""What stands in the way: reported by a tractor or drawn by an operator, and which legs it blocks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely

from planner.service.centre.course import Course
from planner.service.centre.errors import CentreError

MOST, MOST_POINTS = 100, 200
SAME_M = 0.5  # by which what is seen again and again is seen elsewhere
Ring = tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Block:
    """One obstacle in metres of the plan."""

    id: int
    name: str
    who: str
    ring: Ring
    shape: shapely.Polygon


class Obstacles:
    """Those that are there now; `version` rises with every change."""

    def __init__(self, reach_m: float) -> None:
        self.reach_m = reach_m  # a leg whose line comes nearer than this to an obstacle is blocked
        self.items: dict[int, Block] = {}
        self.version = 0
        self._last = 0

    def add(self, ring: Ring, name: str, who: str) -> Block:
        """Raises CentreError for what is no outline."""
        if len(self.items) >= MOST:
            raise CentreError(f"There are {MOST} obstacles already; clear those that are gone first.")
        if len(ring) > MOST_POINTS:
            raise CentreError(f"The outline has {len(ring)} points; at most {MOST_POINTS} can be used.",
                              parameter="polygon_m")  # fmt: skip
        shape = shapely.Polygon(ring) if len(ring) > 2 else None
        if shape is None or not shape.is_valid or shape.area <= 0.0:
            raise CentreError("The outline of the obstacle is not a polygon; give three or more corners that do not "
                              "cross.", parameter="polygon_m")  # fmt: skip
        self._last += 1
        block = Block(self._last, name, who, ring, shape)
        self.items[block.id] = block
        self.version += 1
        return block

    def known(self, ring: Ring, who: str) -> Block | None:
        """One that the same client has told of and that holds this outline, up to SAME_M; None where there is none."""
        shape = shapely.Polygon(ring) if len(ring) > 2 else None
        if shape is None or not shape.is_valid:
            return None
        own = (block for block in self.items.values() if block.who == who)
        return next((block for block in own if shapely.buffer(block.shape, SAME_M).contains(shape)), None)

    def clear(self, number: int) -> Block:
        """Raises CentreError where there is none of this number."""
        if number not in self.items:
            raise CentreError(f"There is no obstacle {number}; it was cleared already.", parameter="obstacle")
        self.version += 1
        return self.items.pop(number)

    def blocked(self, course: Course) -> dict[int, str]:
        """Legs of a course that an obstacle touches, with its name."""
        if not self.items:
            return {}
        lines = np.array([shapely.LineString(leg.points) for leg in course.legs])
        found: dict[int, str] = {}
        for block in self.items.values():
            for leg in np.flatnonzero(shapely.dwithin(lines, block.shape, self.reach_m)).tolist():
                found.setdefault(leg, block.name)
        return found

    def ahead(self, course: Course, leg: int, leg_m: float, released: int) -> str | None:
        """The name of an obstacle on what is left of the released legs, None where there is none."""
        if not self.items or leg >= released:
            return None
        end_m = course.before_m[min(released, len(course.legs))]
        left_m = end_m - course.before_m[leg] - leg_m
        metres = np.append(np.arange(0.0, max(left_m, 0.0), 0.5), max(left_m, 0.0))
        points = course.along(leg, leg_m, metres.tolist(), released)[:, :2]
        line = shapely.LineString(points) if len(points) > 1 else shapely.Point(points[0])
        for block in self.items.values():
            if shapely.dwithin(line, block.shape, self.reach_m):
                return block.name
        return None
