"""The headland passes in the order they are driven, shared out among tractors.

Passes that lie inside one another are a nest. Nests are dealt out in equal time: a tractor gets a whole nest, which it
drives pass by pass, or a sector of it, which it drives to and fro. So all tractors stay as far apart as their sectors
are long, and at the border of two sectors one turns while the other is away.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import shapely

from fields.layout.headland_passes import HeadlandPass, HeadlandPassSide
from strategies.headland.corners import find_corner_paths
from strategies.path_planning.turn_kinds import SQUARE_CORNERS
from strategies.program.field_job import FieldJob

Point = tuple[float, float]

NEIGHBOUR_WIDTHS = 1.05  # working widths between passes that lie inside one another
MIN_NEST_LENGTH_RATIO = 0.7  # a pass shorter than this share of the one before begins a new nest
MIN_CUT_SIDE_M = 15.0  # least length of the parts of a cut side
MIN_SHARE_S = 40.0  # least time of the parts of a cut nest
UNSHARED_TOLERANCE_M = 5.0  # of a pass that sectors may leave out: rounding, and pieces too short to drive
BALANCE_TOLERANCE = 0.05  # by which a share may be too large so that nests stay whole


@dataclass(frozen=True, eq=False)
class HeadlandSegment:
    """A side of a pass from one distance along it (m) to another; None where it reaches into the corner there."""

    headland_pass: HeadlandPass
    side: int
    first_m: float | None = None
    last_m: float | None = None

    @property
    def line(self) -> npt.NDArray[np.float64]:
        """Centre line of the whole side (n, 2); twice round if the pass has no corner."""
        points = self.headland_pass.sides[self.side].points
        return np.concatenate([points, points[1:]]) if self.has_no_corner else points

    @property
    def start(self) -> Point:
        """Where it begins on the centre line."""
        return self._locate(self.first_m or 0.0)

    @property
    def end(self) -> Point:
        """Where it ends on the centre line."""
        return self._locate((self.first_m or 0.0) + self.length_m)

    def _locate(self, distance_m: float) -> Point:
        return _make_point(np.asarray(shapely.LineString(self.line).interpolate(distance_m).coords[0]))

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
        first, last = self.first_m or 0.0, self.last_m
        return (self.headland_pass.sides[self.side].length_m if last is None else last) - first


@dataclass(frozen=True)
class _NestSector:
    """A tractor's part of a nest, from one share of its length to another; (0, 1) is the whole."""

    headland_passes: list[HeadlandPass]
    first_share: float
    last_share: float


def share_headland(
    job: FieldJob, *, outside_in: bool, begin: Point | None = None, origin: float = 0.0
) -> list[list[HeadlandSegment]]:
    """The segments of every tractor in order; a tractor may have none.

    A tractor that drives a whole nest starts at `begin` or near it. Borders of sectors are counted from `origin`, a
    share of the length of the outer pass from the middle of its longest side. Borders run square through a nest; where
    they do not meet one of its passes well, a new nest begins with that pass.
    """
    nests = _group_nested_passes(job, outside_in)
    while True:
        shares = _build_shares(job, nests, begin, origin)
        split_nests = _split_nests(nests, shares)
        if len(split_nests) == len(nests):
            return shares
        nests = split_nests


def _split_nests(nests: list[list[HeadlandPass]], shares: list[list[HeadlandSegment]]) -> list[list[HeadlandPass]]:
    """The nests, with a new one before every pass that the shares do not cover completely."""
    driven_m: dict[tuple[int, int], float] = {}
    for segment in (segment for share in shares for segment in share):
        key = segment.headland_pass.number, segment.headland_pass.ring
        driven_m[key] = driven_m.get(key, 0.0) + segment.length_m
    split: list[list[HeadlandPass]] = []
    for nest in nests:
        for index, headland_pass in enumerate(nest):
            if (
                not index
                or driven_m.get((headland_pass.number, headland_pass.ring), 0.0)
                < headland_pass.length_m - UNSHARED_TOLERANCE_M
            ):
                split.append([])
            split[-1].append(headland_pass)
    return split


def _build_shares(
    job: FieldJob, nests: list[list[HeadlandPass]], begin: Point | None, origin: float
) -> list[list[HeadlandSegment]]:
    shares, corner_m = [], _estimate_corner_s(job) * job.driving_rules.work_speed_mps
    for sectors in _assign_sectors(job, nests):
        place, share = begin, list[HeadlandSegment]()
        for sector in sectors:
            is_whole = sector.last_share - sector.first_share > 1.0 - 1e-9
            share += (
                _list_nest_sides(sector.headland_passes, place)
                if is_whole
                else _list_sector_segments(sector, origin, corner_m)
            )
            place = share[-1].end if share else place
        shares.append(share)
    return shares


def _group_nested_passes(job: FieldJob, outside_in: bool) -> list[list[HeadlandPass]]:
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
    return nests if outside_in else [nest[::-1] for nest in nests[::-1]]


def _is_next_inner_pass(headland_pass: HeadlandPass, outer: HeadlandPass, width_m: float) -> bool:
    """Whether a pass is the next one inside another and of similar length."""
    if (
        not headland_pass.is_closed
        or headland_pass.number != outer.number + 1
        or headland_pass.length_m < MIN_NEST_LENGTH_RATIO * outer.length_m
    ):
        return False
    return bool(shapely.dwithin(headland_pass.line, outer.line, NEIGHBOUR_WIDTHS * width_m))


def _assign_sectors(job: FieldJob, nests: list[list[HeadlandPass]]) -> list[list[_NestSector]]:
    """The sectors of every tractor, of equal time."""
    nest_times_s = [
        sum(_estimate_seconds(job, headland_pass.length_m, len(headland_pass.sides)) for headland_pass in nest)
        for nest in nests
    ]
    share_s, used_s, number = sum(nest_times_s) / job.tractors, 0.0, 0
    shares: list[list[_NestSector]] = [[] for _ in range(job.tractors)]
    for nest, seconds in zip(nests, nest_times_s, strict=True):
        first = 0.0
        while first < 1.0:
            spare_s, rest_s = share_s - used_s, (1.0 - first) * seconds
            is_rest_taken = (
                number == job.tractors - 1 or rest_s <= spare_s + BALANCE_TOLERANCE * share_s or not nest[0].is_closed
            )
            last = 1.0 if is_rest_taken or rest_s - spare_s < MIN_SHARE_S else first + spare_s / seconds
            if last < 1.0 and spare_s < MIN_SHARE_S:
                last = first
            if last > first:
                shares[number].append(_NestSector(nest, first, last))
            used_s += (last - first) * seconds
            first = last
            if number < job.tractors - 1 and share_s - used_s < MIN_SHARE_S:
                number, used_s = number + 1, 0.0
    return shares


def _list_nest_sides(headland_passes: list[HeadlandPass], place: Point | None) -> Iterator[HeadlandSegment]:
    """All sides of a nest, each pass from its side nearest to `place`; without a place from its longest side."""
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


def _list_sector_segments(sector: _NestSector, origin: float, corner_m: float) -> Iterator[HeadlandSegment]:
    """The sector of every pass of a nest, in alternating directions; borders run square through the nest."""
    outer = sector.headland_passes[0]
    ends = [_locate_border(outer, share + origin, corner_m) for share in (sector.first_share, sector.last_share)]
    expected_m = (sector.last_share - sector.first_share) * outer.length_m
    for index, headland_pass in enumerate(sector.headland_passes):
        line, length = shapely.LinearRing(headland_pass.line), headland_pass.length_m
        first, last = (_move_off_corners(headland_pass, float(line.project(shapely.Point(end)))) for end in ends)
        run_m = (last - first) % length
        if run_m > MIN_CUT_SIDE_M and run_m < 1.5 * expected_m + MIN_CUT_SIDE_M:
            pieces = list(_cut_segments(headland_pass, first, run_m))
            yield from pieces if index % 2 == 0 else [_reverse_segment(piece) for piece in pieces[::-1]]
            expected_m = run_m
        ends = [_make_point(np.asarray(line.interpolate(at).coords[0])) for at in (first, last)]


def _locate_border(headland_pass: HeadlandPass, share: float, corner_m: float) -> Point:
    """Where the border between sectors lies on the first pass of a nest, counted from the middle of its longest side.

    `share` is a share of the time for the pass, in which a corner takes as long as driving `corner_m`.
    """
    lengths = [side.length_m for side in headland_pass.sides]
    longest = max(range(len(lengths)), key=lambda side: round(lengths[side], 3))
    lengths_with_corner_m = [length + corner_m for length in lengths]
    remaining_m = (
        sum(lengths_with_corner_m[:longest]) + 0.5 * lengths[longest] + share * sum(lengths_with_corner_m)
    ) % sum(lengths_with_corner_m)
    distance_m = 0.0
    for length, span in zip(lengths, lengths_with_corner_m, strict=True):
        distance_m += min(remaining_m, length)
        remaining_m -= span
        if remaining_m < 0.0:
            break
    return _make_point(
        np.asarray(
            shapely.LineString(headland_pass.line).interpolate(_move_off_corners(headland_pass, distance_m)).coords[0]
        )
    )


def _move_off_corners(headland_pass: HeadlandPass, distance_m: float) -> float:
    """A place along a pass moved away from the corners, or into one on a short side (m)."""
    start = 0.0
    for side in headland_pass.sides:
        length = side.length_m
        if distance_m <= start + length + 1e-6:
            if length < 2.0 * MIN_CUT_SIDE_M:
                return start if distance_m - start < 0.5 * length else start + length
            return min(max(distance_m, start + MIN_CUT_SIDE_M), start + length - MIN_CUT_SIDE_M)
        start += length
    return distance_m


def _cut_segments(headland_pass: HeadlandPass, first: float, run: float) -> Iterator[HeadlandSegment]:
    """The sides of a pass, or parts of them, from a place along it on for a length (m)."""
    count = len(headland_pass.sides)
    starts = np.cumsum([0.0, *(side.length_m for side in headland_pass.sides)]).tolist()
    for turn, side in ((turn, side) for turn in (0, 1) for side in range(count)):
        low, high = starts[side] + turn * starts[-1], starts[side + 1] + turn * starts[-1]
        begin, end = max(low, first), min(high, first + run)
        if end - begin > 1.0:
            yield HeadlandSegment(
                headland_pass,
                side,
                None if begin - low < 1e-3 else begin - low,
                None if high - end < 1e-3 else end - low,
            )


def _reverse_segment(piece: HeadlandSegment) -> HeadlandSegment:
    """The same segment driven the other way."""
    length = piece.headland_pass.sides[piece.side].length_m
    first = None if piece.last_m is None else length - piece.last_m
    last = None if piece.first_m is None else length - piece.first_m
    return HeadlandSegment(
        reverse_pass(piece.headland_pass), len(piece.headland_pass.sides) - 1 - piece.side, first, last
    )


def reverse_pass(headland_pass: HeadlandPass) -> HeadlandPass:
    """A headland pass driven the other way."""
    return replace(
        headland_pass,
        sides=tuple(
            HeadlandPassSide(s.points[::-1], -s.end_turn_rad, -s.start_turn_rad) for s in headland_pass.sides[::-1]
        ),
    )


def _estimate_seconds(job: FieldJob, length_m: float, corners: int) -> float:
    return length_m / job.driving_rules.work_speed_mps + corners * _estimate_corner_s(job)


def _estimate_corner_s(job: FieldJob) -> float:
    """Seconds of a right-angled corner, for sharing out."""
    tool, half = job.driving_rules.tool_m, 0.5 * job.layout.width_m
    a, b = (tool - half, 0.0, 0.0), (0.0, tool - half, 0.5 * math.pi)
    paths = find_corner_paths(a, b, job.driving_rules.radius_m) if job.corners == SQUARE_CORNERS else []
    return min((job.connector.costs.compute_time_s(path) for path in paths), default=0.0)


def _make_point(xy: npt.NDArray[np.float64]) -> Point:
    return float(xy[0]), float(xy[1])
