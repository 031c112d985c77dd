"""The headland passes in the order in which one tractor would drive them, for the estimate of a layout."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import shapely

from fields.layout.headland_passes import HeadlandPass, HeadlandPassSide
from strategies.program.field_job import FieldJob

Point = tuple[float, float]

NEIGHBOUR_WIDTHS = 1.05  # working widths between passes that lie inside one another
MIN_NEST_LENGTH_RATIO = 0.7  # a pass shorter than this share of the one before begins a new nest


@dataclass(frozen=True, eq=False)
class HeadlandSegment:
    """A side of a pass."""

    headland_pass: HeadlandPass
    side: int

    @property
    def line(self) -> npt.NDArray[np.float64]:
        """Centre line of the whole side (n, 2); twice round if the pass has no corner."""
        points = self.headland_pass.sides[self.side].points
        return np.concatenate([points, points[1:]]) if self.has_no_corner else points

    @property
    def has_no_corner(self) -> bool:
        """Whether the pass has no corner."""
        return (
            self.headland_pass.is_closed
            and len(self.headland_pass.sides) == 1
            and self.headland_pass.sides[0].start_turn_rad == 0.0
        )

    @property
    def length_m(self) -> float:
        """Worked length without corners (m)."""
        return self.headland_pass.sides[self.side].length_m


def list_segments(job: FieldJob) -> list[HeadlandSegment]:
    """The sides of all passes from outside in, those inside one another after each other, from near the entrance."""
    nests = _group_nested_passes(job)
    return list(_list_sides((one for nest in nests for one in nest), job.layout.field.entrance))


def _group_nested_passes(job: FieldJob) -> list[list[HeadlandPass]]:
    """Passes that lie inside one another, in the order they are driven."""
    remaining = sorted(
        job.headland_passes,
        key=lambda headland_pass: (headland_pass.number, -round(headland_pass.length_m, 3), headland_pass.ring),
    )
    nests: list[list[HeadlandPass]] = []
    while remaining:
        nest = [remaining.pop(0)]
        while nest[-1].is_closed:
            inner = next(
                (
                    headland_pass
                    for headland_pass in remaining
                    if _is_next_inner_pass(headland_pass, nest[-1], job.layout.width_m)
                ),
                None,
            )
            if inner is None:
                break
            remaining.remove(inner)
            nest.append(inner)
        nests.append(nest)
    return nests


def _is_next_inner_pass(headland_pass: HeadlandPass, outer: HeadlandPass, width_m: float) -> bool:
    """Whether a pass is the next one inside another and of similar length."""
    if (
        not headland_pass.is_closed
        or headland_pass.number != outer.number + 1
        or headland_pass.length_m < MIN_NEST_LENGTH_RATIO * outer.length_m
    ):
        return False
    return bool(shapely.dwithin(headland_pass.line, outer.line, NEIGHBOUR_WIDTHS * width_m))


def _list_sides(headland_passes: Iterable[HeadlandPass], place: Point | None) -> Iterator[HeadlandSegment]:
    """All sides of some passes, each from its side nearest to `place`; without a place from its longest side."""
    for headland_pass in headland_passes:
        directed_passes = [headland_pass] if headland_pass.is_closed else [headland_pass, reverse_pass(headland_pass)]
        options = [
            (directed_pass, side)
            for directed_pass in directed_passes
            for side in range(len(directed_pass.sides) if directed_pass.is_closed else 1)
        ]
        directed_pass, first = (
            max(options, key=_measure_first_side) if place is None else min(options, key=_measure_distance_from(place))
        )
        yield from (
            HeadlandSegment(directed_pass, (first + step) % len(directed_pass.sides))
            for step in range(len(directed_pass.sides))
        )
        place = _make_point(directed_pass.sides[first - 1].points[-1])


def _measure_first_side(option: tuple[HeadlandPass, int]) -> float:
    return round(option[0].sides[option[1]].length_m, 3)


def _measure_distance_from(place: Point) -> Callable[[tuple[HeadlandPass, int]], float]:
    return lambda option: round(math.dist(option[0].sides[option[1]].points[0], place), 3)


def reverse_pass(headland_pass: HeadlandPass) -> HeadlandPass:
    """A headland pass driven the other way."""
    return replace(
        headland_pass,
        sides=tuple(
            HeadlandPassSide(s.points[::-1], -s.end_turn_rad, -s.start_turn_rad) for s in headland_pass.sides[::-1]
        ),
    )


def _make_point(xy: npt.NDArray[np.float64]) -> Point:
    return float(xy[0]), float(xy[1])
