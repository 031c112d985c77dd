"""Tracks on a field: parallel lines evenly spaced, ending where the headland begins.

A headland is either room for turning at the ends of tracks, or worked in rounds all along the outline.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import shapely

from fields.bearings import candidate_bearings
from fields.cells import Cell, compass_deg
from fields.errors import FieldError, named
from fields.field import Field
from fields.filling import filled
from fields.handedness import onward
from fields.lines import SHIFTS, Comb, CombRules, axes, better, comb, region_edges
from fields.rounds import inner_region

FloatArray = npt.NDArray[np.float64]

EDGE_SLACK_M = 1e-6
"""The region is eroded this much less, so that a line exactly on its edge counts as inside."""
MITRE_LIMIT = 2.0
MOST_LINES = 20_000
DEEPEST_M = 1e5
GRID_M = 1e-6
SLIVER_M = 1e-5
"""Parts of the inner region thinner than this are rounding."""
PROMISING = 1.25
"""Directions this much dearer than the cheapest may still win once their outer lines are shifted."""


@dataclass(frozen=True)
class Track:
    """One straight piece of a swath.

    Attributes:
        line: number of the parallel line, counted from one side of its cell to the other, cell after cell.
        piece: 0 and up along +u where a hole or a notch interrupts the line.
        start, end: ends of the centre line, metres; end - start points along +u.
        cell: number of the cell it belongs to.
    """

    line: int
    piece: int
    start: tuple[float, float]
    end: tuple[float, float]
    cell: int = 1

    @property
    def length(self) -> float:
        """Length in metres."""
        return math.dist(self.start, self.end)


@dataclass(frozen=True)
class Layout:
    """The tracks of a field.

    Attributes:
        field: the field they are laid on.
        bearing_rad: direction +u of the tracks of the largest cell as a mathematical angle, radians: in (-pi/2, pi/2],
            or inside rounds the way that the outline points (handedness.onward), so that it turns with the field.
        width_m: working width. Lines of a cell are evenly spaced by at most that, so that the whole width is covered.
        headland_m: room left along the tracks beyond their ends.
        tracks: sorted by line and piece; no line number is used in two cells.
        inner: region in which the centre lines of tracks may lie; with rounds, what these leave for tracks.
        rounds: number of rounds of the headland that are worked; 0 where it is only room for turning.
        cells: parts of `inner`, each with tracks in one direction, in order of their numbers; one where none are given.
        apart_m: inside rounds, lines lie no nearer to each other than this or, where that is less, than the width.
    """

    field: Field
    bearing_rad: float
    width_m: float
    headland_m: float
    tracks: tuple[Track, ...]
    inner: shapely.Geometry
    rounds: int = 0
    cells: tuple[Cell, ...] = ()
    apart_m: float = 0.0

    def __post_init__(self) -> None:
        if not self.cells:
            object.__setattr__(self, "cells", (Cell(1, self.bearing_rad, self.inner),))

    def bearing_of(self, track: Track) -> float:
        """Direction +u of a track: that of its cell, radians."""
        return self.cells[track.cell - 1].bearing_rad

    @property
    def lines(self) -> int:
        """Number of parallel lines up to the last with a track; a line in between may carry none."""
        return max(track.line for track in self.tracks) + 1

    @property
    def bearing_deg(self) -> float:
        """Direction of the tracks of the largest cell clockwise from north, degrees in [0, 180)."""
        return compass_deg(self.bearing_rad)

    @property
    def total_m(self) -> float:
        """Length of all tracks together, metres."""
        return math.fsum(track.length for track in self.tracks)


def lay_tracks(
    field: Field,
    width_m: float,
    headland_m: float,
    bearing_deg: float | None = None,
    min_length_m: float = 5.0,
    rounds: int = 0,
    apart_m: float = 0.0,
) -> Layout:
    """Lay parallel tracks on a field.

    The boundary (obstacles included) is first drawn in by half the width; what remains is then shortened
    at both ends of every chord along the tracks by headland - width / 2. An edge at the angle a to the
    tracks is thus kept clear by width / 2 + (headland - width / 2) |sin a|: the full headland where
    tracks end squarely, half a width where they run alongside.

    The outer lines touch the lateral extremes of the drawn-in boundary, or stand off by less than a
    width where that saves more than it leaves uncovered (a notch or a bulge in the side).

    Args:
        field: the field.
        width_m: working width.
        headland_m: room for turning along the tracks; 0 lets them run up to the boundary.
        bearing_deg: direction clockwise from north; None tries the directions of the boundary and of the
            smallest rectangle around it and takes the one with the least estimated driving.
        min_length_m: shorter pieces are left out; with rounds they are driven this far.
        rounds: rounds of the headland that are worked. With any, the headland is as deep as they are wide, all along
            the outline and every hole, and tracks cover whatever lies inside it: each reaches as far as its swath
            meets that, also where the headland lies aslant.
        apart_m: with rounds, lines lie no nearer to each other than this or, where that is less, than the width: with
            a machine's width and some room, machines can pass each other on neighbouring tracks.

    Raises:
        FieldError: a value is out of range, or no track is left.
    """
    _check(width_m, headland_m, bearing_deg, min_length_m)
    region = _room(field, width_m)
    if rounds:
        return _inside_rounds(field, width_m, headland_m, rounds, bearing_deg, min_length_m, apart_m)
    edges = region_edges(region)
    trim = max(headland_m - width_m / 2.0, 0.0) + EDGE_SLACK_M
    rules = CombRules(width_m, trim, min_length_m, EDGE_SLACK_M, field.area_m2)
    choice = _choose(field, edges, rules, bearing_deg)
    if choice is None:
        raise FieldError(
            f"No track of {min_length_m:g} m is left on field '{field.name}' ({field.area_ha:.3g} ha) with a "
            f"headland of {headland_m:g} m{_along(bearing_deg)}; use a smaller headland or another bearing."
        )
    bearing_rad, teeth = choice
    inner = _inner(region, edges, axes(bearing_rad), trim)
    return Layout(field, bearing_rad, width_m, headland_m, tracks_of(teeth, axes(bearing_rad)), inner)


def check_width(field: Field, width_m: float) -> None:
    """Raise FieldError for a working width that no track of a field, or too many, would have."""
    _check(width_m, 0.0, None, 1.0)
    _room(field, width_m)


def _room(field: Field, width_m: float) -> shapely.Geometry:
    """The boundary drawn in by half the width; refuses a width that no track or too many would have."""
    region = field.boundary.buffer(EDGE_SLACK_M - width_m / 2.0, join_style="mitre", mitre_limit=MITRE_LIMIT)
    if region.is_empty:
        kept = "" if field.outline is None else "What obstacles and the margin to them leave of "
        helps = "check the obstacles, or use a smaller margin or" if kept else "use"
        raise FieldError(
            f"{kept}{'f' if kept else 'F'}ield '{field.name}' is nowhere wider than the working width {width_m:g} m; "
            f"{helps} a narrower implement.",
            parameter="width_m",
        )
    span_m = math.dist(region.bounds[:2], region.bounds[2:])
    if span_m > MOST_LINES * width_m:
        raise FieldError(
            f"Working width {width_m:g} m would give more than {MOST_LINES} lines on field '{field.name}', "
            f"{span_m:.0f} m across; give the width in metres.",
            parameter="width_m",
        )
    return region


def _inside_rounds(
    field: Field, width_m: float, headland_m: float, rounds: int, bearing_deg: float | None, min_length_m: float,
    apart_m: float,
) -> Layout:  # fmt: skip
    """Tracks over everything inside the rounds of the headland."""
    depth = rounds * width_m
    region = inner_region(field, depth)
    rules = CombRules(width_m, 0.0, min_length_m, 0.5 * width_m, region.area, apart_m)
    edges = region_edges(region)
    choice = _choose(field, edges, rules, bearing_deg) if len(edges) else None
    if choice is None and len(edges):
        choice = _choose(field, edges, replace(rules, shortest_m=SLIVER_M), bearing_deg)
    bearing_rad = pointing(field, choice[0]) if choice else 0.0
    teeth = filled(region, bearing_rad, rules) if choice else None
    if teeth is None:
        raise FieldError(
            f"No track is left on field '{field.name}' ({field.area_ha:.3g} ha) inside a headland of {headland_m:g} "
            f"m, worked in rounds of {width_m:g} m{_along(bearing_deg)}; use a smaller headland "
            f"({named('headland_m')}).",
        )
    tracks = from_longer_side(tracks_of(teeth, axes(bearing_rad)))
    return Layout(field, bearing_rad, width_m, depth, tracks, region, rounds, apart_m=apart_m)


def _check(width_m: float, headland_m: float, bearing_deg: float | None, min_length_m: float) -> None:
    """Refuse numbers that mean nothing."""
    if not (math.isfinite(width_m) and width_m > 0.0):
        raise FieldError(f"Working width {width_m} m is not usable; give a width above 0 m.", parameter="width_m")
    if not 0.0 <= headland_m <= DEEPEST_M:
        raise FieldError(f"Headland {headland_m:g} m is not usable; give 0 to {DEEPEST_M:g} m.", parameter="headland_m")
    if bearing_deg is not None and not math.isfinite(bearing_deg):
        raise FieldError(
            f"Bearing {bearing_deg} is not usable; give degrees clockwise from north, or none.", parameter="bearing_deg"
        )
    if not (math.isfinite(min_length_m) and min_length_m > 0.0):
        raise FieldError(f"Shortest track {min_length_m} m is not usable; give a length above 0 m.")


def _choose(field: Field, edges: FloatArray, rules: CombRules, bearing_deg: float | None) -> tuple[float, Comb] | None:
    """Direction in (-pi/2, pi/2] and comb: the one asked for, or the cheapest of the candidates.

    Candidates are first compared without shifts; those that come close are then worked out in full. On
    equal cost and length the one with the longest edge, which comes first, wins.
    """
    if bearing_deg is not None:
        angles = [math.radians(90.0 - bearing_deg % 180.0)]
    else:
        angles = _promising(candidate_bearings(field.boundary), edges, rules)
    best: tuple[float, Comb] | None = None
    for angle in angles:
        teeth = comb(edges @ axes(angle).T, rules, SHIFTS)
        if teeth is not None and (best is None or better(teeth, best[1])):
            best = angle, teeth
    return best


def _promising(angles: list[float], edges: FloatArray, rules: CombRules) -> list[float]:
    """The directions, in their order and in (-pi/2, pi/2], whose plain comb is near the cheapest."""
    plain = [(angle, comb(edges @ axes(angle).T, rules)) for angle in angles]
    cost = [(angle, teeth.cost_m) for angle, teeth in plain if teeth is not None]
    limit = min((value for _, value in cost), default=0.0) * PROMISING
    return [half_turn(angle) for angle, value in cost if value <= limit]


def pointing(field: Field, bearing_rad: float) -> float:
    """A direction, or the one against it, in (-pi, pi]: as the outline of a field with its holes points."""
    outline = field.boundary
    rings = [np.asarray(ring.coords)[:-1, :2] for ring in (outline.exterior, *outline.interiors)]
    return onward(bearing_rad, rings, [] if field.entrance is None else [field.entrance])


def half_turn(angle: float) -> float:
    """A direction in [0, pi) without sense, in (-pi/2, pi/2]."""
    return angle - math.pi if angle > math.pi / 2.0 + 1e-12 else angle


def tracks_of(teeth: Comb, frame: FloatArray) -> tuple[Track, ...]:
    """The pieces of a comb as tracks in metres; empty lines before the first piece are not counted."""
    q = teeth.q[teeth.line]
    start = np.column_stack([teeth.s0, q]) @ frame
    end = np.column_stack([teeth.s1, q]) @ frame
    tracks: list[Track] = []
    for line, a, b in zip((teeth.line - teeth.line[0]).tolist(), start.tolist(), end.tolist(), strict=True):
        piece = tracks[-1].piece + 1 if tracks and tracks[-1].line == line else 0
        tracks.append(Track(line, piece, (a[0], a[1]), (b[0], b[1])))
    return tuple(tracks)


def from_longer_side(tracks: tuple[Track, ...]) -> tuple[Track, ...]:
    """Tracks with lines counted from the side where they are longer, whichever way the field lies."""
    metres: dict[int, float] = {}
    for track in tracks:
        metres[track.line] = metres.get(track.line, 0.0) + track.length
    rounded = [round(metres[line], 2) for line in sorted(metres)]
    return counted_back(tracks) if rounded[::-1] > rounded else tracks


def counted_back(tracks: tuple[Track, ...]) -> tuple[Track, ...]:
    """Tracks with lines counted from the other side."""
    last = tracks[-1].line
    turned = (replace(track, line=last - track.line) for track in tracks)
    return tuple(sorted(turned, key=lambda track: (track.line, track.piece)))


def _inner(region: shapely.Geometry, edges: FloatArray, frame: FloatArray, trim: float) -> shapely.Geometry:
    """The region without everything that lies within ``trim`` of its edge along the tracks."""
    reach = trim * frame[0]
    slanted = np.abs((edges[:, 1] - edges[:, 0]) @ frame[1]) > 1e-9
    if not slanted.any():
        return region
    a, b = edges[slanted, 0], edges[slanted, 1]
    swept = shapely.polygons(np.stack([a - reach, b - reach, b + reach, a + reach], axis=1))
    # Without a grid GEOS loses whole pieces when it unites shapes whose edges all but coincide.
    blocked = shapely.union_all(swept, grid_size=GRID_M)
    parts = shapely.get_parts(shapely.difference(region, blocked, grid_size=GRID_M))
    return shapely.union_all(parts[shapely.area(parts) > SLIVER_M * shapely.length(parts)], grid_size=GRID_M)


def _along(bearing_deg: float | None) -> str:
    return "" if bearing_deg is None else f" at bearing {bearing_deg:g} degrees"
