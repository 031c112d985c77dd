"""Tracks among small obstacles: bent round them where there is room, cut at them where there is none."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from fields.layout import Layout, Track
from strategies.errors import StrategyError
from strategies.ways.bends import Bender, Bent, Line, Points, Span

SHORTEST_M = 5.0  # what is left of a track that is cut must be so long
Point = tuple[float, float]


@dataclass(frozen=True, eq=False)
class Around:
    """Ways along tracks that are bent, by the point where a pass of the track begins; and what bends other lines."""

    bent: Mapping[Point, Bent] = field(default_factory=dict)
    bender: Bender | None = None


def lay_around(layout: Layout, bender: Bender, tool_m: float) -> tuple[Layout, Around]:
    """The tracks as they can be driven among the obstacles of a bender, in either direction.

    A pass is driven `tool_m` past the end of its track. Where a track cannot be bent in both directions, it ends a
    headland before the obstacle and goes on a headland behind it. Raises StrategyError where no track is left.
    """
    tracks: list[Track] = []
    bent: dict[Point, Bent] = {}
    for track in layout.tracks:
        for piece in _pieces(track, bender, tool_m, layout.headland_m, bent):
            number = tracks[-1].piece + 1 if tracks and tracks[-1].line == track.line else 0
            tracks.append(replace(piece, piece=number))
    if not tracks:
        raise StrategyError(
            f"Small obstacles leave no track of {SHORTEST_M:g} m on field '{layout.field.name}'; check the obstacles."
        )
    return replace(layout, tracks=tuple(tracks)), Around(bent, bender)


def clear_parts(points: Points, bender: Bender) -> list[tuple[Points, float]] | None:
    """What can be driven of a polyline (n, 2), bent, and the length of each part along it; None: all, as it is."""
    line = Line(points)
    bent, spans = bender.bent(points)
    if bent is None and not spans:
        return None
    way = bent or line.bent([])
    room = bender.rules.radius_m + bender.rules.nose_m + bender.rules.tail_m
    left = list(_left(spans, line.length_m, room)) if spans else [(0.0, line.length_m)]
    return [(way.between(first, last), last - first) for first, last in left]


def _pieces(
    track: Track, bender: Bender, tool_m: float, room_m: float, bent: dict[Point, Bent]
) -> Iterator[Track]:
    """What can be driven of a track, from its start on; ways that are bent go to `bent`."""
    ways = [bender.bent(_line(track, direction, tool_m)) for direction in (1, -1)]
    spans = [*ways[0][1], *((track.length - high, track.length - low) for low, high in ways[1][1])]
    if spans:
        for first, last in _left(spans, track.length, room_m):
            yield from _pieces(_part(track, first, last), bender, tool_m, room_m, bent)
        return
    for start, (way, _) in zip((track.start, track.end), ways, strict=True):
        if way is not None:
            bent[start] = way
    yield track


def _line(track: Track, direction: int, tool_m: float) -> np.ndarray:
    """What the guided point drives along a track if nothing is in the way, (2, 2)."""
    a, b = (track.start, track.end) if direction > 0 else (track.end, track.start)
    past = np.array([b[0] - a[0], b[1] - a[1]]) * tool_m / math.dist(a, b)
    return np.array([a, b + past])


def _left(spans: list[Span], length_m: float, room_m: float) -> Iterator[Span]:
    """What spans, and room for turning on either side of them, leave of a length."""
    first = 0.0
    for low, high in sorted(spans):
        if low - room_m - first >= SHORTEST_M:
            yield first, low - room_m
        first = max(first, high + room_m)
    if length_m - first >= SHORTEST_M:
        yield first, length_m


def _part(track: Track, first_m: float, last_m: float) -> Track:
    """A track between two distances along it."""
    ends = np.array([track.start, track.end])
    ahead = (ends[1] - ends[0]) / track.length
    a, b = (ends[0] + first_m * ahead).tolist(), (ends[0] + last_m * ahead).tolist()
    start = track.start if first_m <= 0.0 else (a[0], a[1])
    return replace(track, start=start, end=track.end if last_m >= track.length else (b[0], b[1]))
