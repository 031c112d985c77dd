"""One tractor's share of the rounds of the headland as legs.

The implement works behind the guided point, so that a side ends when the tractor is past its corner. A square corner is
worked whole: on, up, back, round and back again, down. A round one is driven through with the implement down. Where
neither fits, any way that leads from one side to the next is taken; a side that none leads to is left out and told.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, pairwise, product
from typing import Any, TypeGuard

import numpy as np
import numpy.typing as npt
import shapely

from strategies.headland.corners import corner_arc, corner_ways, tangent_m, worked_into
from strategies.headland.shifts import Stretch
from strategies.job import Job
from strategies.legs import STEP_M, driven_legs, with_stops
from strategies.ways.around import clear_parts
from strategies.ways.connect import Connector
from strategies.ways.paths import Path, Pose, ahead, join, straight
from vehicle.missions import ROUND, TURN, WAY, Leg, Task

Points = npt.NDArray[np.float64]

SHORT = 5.0  # widths: a side that may be left out where it leads nowhere
SHORTEST_M = 2.0  # a shorter side is worked with the corners at its ends
MOST_REVERSALS = 4  # a way with more is a turn on the spot in arcs too short to follow
TRIMS = ((0.0, 0.0), (0.0, 5.0), (5.0, 0.0), (5.0, 5.0), (10.0, 10.0))  # metres given up before and after a corner
PULL_M = 0.25  # steps in which the end of a side is drawn back into the field
LONGEST_CORNER = 6.0  # radii that the way through a corner may be longer than its ends are apart
STOPS_M = 40.0  # a tractor may be kept waiting so often along a side
BACK_M = (0.0, 1.5, 3.0, 5.0, 8.0)  # straight back from where nothing can be joined


@dataclass(frozen=True)
class Shift:
    """What one tractor drives of the rounds: its legs, the poses where they begin and end, and metres left out."""

    legs: tuple[Leg, ...]
    start: Pose
    end: Pose
    left_m: float = 0.0


@dataclass(frozen=True, eq=False)
class _Strip:
    """A stretch as the guided point drives it (n, 2), and whether arcs with the implement down lead to and from it."""

    points: Points
    task: Task
    length_m: float
    joined_in: bool
    joined_out: bool


def shift_of(job: Job, share: Sequence[Stretch]) -> Shift | None:
    """The legs of a share, written once for all jobs of a site; None where nothing of it can be driven."""
    laps = tuple((lap.number, lap.ring, len(lap.sides)) for lap in job.rounds)
    key = laps, tuple(_named(stretch) for stretch in share)
    if key not in job.shifts:
        own = replace(job, used={})
        job.shifts[key] = _shift_of(own, share), own.used
    shift, used = job.shifts[key]
    for kind, count in used.items():
        job.used[kind] = job.used.get(kind, 0) + count
    return shift  # type: ignore[no-any-return]


def _named(stretch: Stretch) -> tuple[Any, ...]:
    """What tells a stretch from all others of a site, driven the other way as well."""
    first, last = stretch.lap.sides[stretch.side].points[[0, -1]].tolist()
    return stretch.lap.number, stretch.lap.ring, stretch.side, stretch.first_m, stretch.last_m, *first, *last


def _shift_of(job: Job, share: Sequence[Stretch]) -> Shift | None:
    """As `shift_of`.

    Where no way leads on from a side, a short one of the two that it would join is left out; where both are long, the
    tractor goes on by any way there is, however near the edge of the field, and else leaves the next one out.
    """
    driven: list[tuple[_Strip, Path | None]] = []
    left = 0.0
    for strip in _strips(job, share):
        if not driven or strip.joined_in:
            driven.append((strip, None))
            continue
        met = _met(job, driven[-1][0], strip)
        last, short = driven[-1][0].length_m, SHORT * job.layout.width_m
        if met is None and len(driven) > 1 and last <= min(short, strip.length_m):
            met = _met(job, driven[-2][0], strip)
            if met is not None:
                left += driven.pop()[0].length_m
        if met is None and strip.length_m > short:
            way = link(job, _pose(driven[-1][0].points, -1), _pose(strip.points, 0), anyhow=True)
            met = None if way is None else (driven[-1][0], way, strip)
        if met is None:
            left += strip.length_m
            continue
        driven[-1] = met[0], driven[-1][1]
        driven.append((met[2], met[1]))
    return _legs_of(job, driven, left) if driven else None


def _legs_of(job: Job, driven: list[tuple[_Strip, Path | None]], left_m: float) -> Shift:
    """The legs of strips, each with the way that leads to it."""
    legs: list[Leg] = []
    for strip, way in driven:
        if way is not None:
            job.used[way.kind] = job.used.get(way.kind, 0) + 1
            task = replace(strip.task, kind=WAY if way.kind == "route" else TURN)
            between = driven_legs(job, way, task)
            legs += between if task.kind == TURN else with_stops(between, STOPS_M)
        legs += _working(job, strip)
    return Shift(tuple(legs), _pose(driven[0][0].points, 0), _pose(driven[-1][0].points, -1), left_m)


def _met(job: Job, last: _Strip, strip: _Strip) -> tuple[_Strip, Path, _Strip] | None:
    """The way from one strip to the next and both of them; where it is tight, their ends are given up for a turn."""
    for back, on in TRIMS:
        if back + SHORTEST_M < last.length_m and on + SHORTEST_M < strip.length_m:
            one, two = _trimmed(last, 0.0, back), _trimmed(strip, on, 0.0)
            way = _turn(job, _pose(one.points, -1), _pose(two.points, 0))
            if way is not None:
                return one, way, two
    way = link(job, _pose(last.points, -1), _pose(strip.points, 0))
    return None if way is None else (last, way, strip)


def _trimmed(strip: _Strip, first_m: float, last_m: float) -> _Strip:
    """A strip without so much at its beginning and its end."""
    if not first_m and not last_m:
        return strip
    length = float(np.hypot(*np.diff(strip.points, axis=0).T).sum())
    points = _along(strip.points, first_m, max(length - last_m, first_m + 0.5 * SHORTEST_M))
    return replace(strip, points=points, length_m=strip.length_m - first_m - last_m)


def link(job: Job, a: Pose, b: Pose, *, anyhow: bool = False, beside: bool = False) -> Path | None:
    """The way with the implement up from the end of a side or a track to the beginning of another; None for none.

    With `anyhow` the implement may reach over the edge of the field all along it. With `beside` a way that keeps to the
    headland is taken whatever longer it is, as others may stand on their tracks.
    """
    rim = job.rim or job.connector
    if beside and job.headland is not None:
        way = job.headland.connect(a, b)
        if _easy(way) and not job.crosses(way):
            return way
    ways = chain((_turn(job, a, b),), _all_between(job, rim, a, b))
    easy: list[Path] = []
    for each in ways:
        if _easy(each):
            easy.append(each)
            if not job.crosses(each):
                break
    way = _kept(job, easy) or rim.direct(a, b)
    if job.crosses(way):
        way = job.way(a, b)
    if not _easy(way) and anyhow:
        way = rim.connect(a, b)
    return way if _easy(way) else None


def _turn(job: Job, a: Pose, b: Pose) -> Path | None:
    """The quickest of the ways through a corner and the turns from one pose to another."""
    rim = job.rim or job.connector
    ways = [way for way in corner_ways(a, b, job.manner.radius_m) if rim.reversing or not way.reverse_m]
    most = math.dist(a[:2], b[:2]) + LONGEST_CORNER * job.manner.radius_m
    timed = [(rim.costs.time_s(way), way) for way in ways if way.length_m <= most and rim.fits(way)]
    turn = job.turn(a, b)
    if turn is not None:
        timed.append((rim.cost(turn), turn))
    return _kept(job, [way for _, way in sorted(timed, key=lambda pair: round(pair[0], 6))])


def _kept(job: Job, ways: list[Path]) -> Path | None:
    """The first of some ways that comes to neither fence nor obstacle, else the first that comes to no fence."""
    if not ways or job.fence is None:
        return ways[0] if ways else None
    clear = next((way for way in ways if not job.crosses(way)), None)
    return clear or next((way for way in ways if not job.crosses(way, fences_only=True)), None)


def _easy(way: Path | None) -> TypeGuard[Path]:
    """Whether there is a way, and a tractor can be expected to keep to it."""
    return way is not None and way.reversals <= MOST_REVERSALS


def _freed(job: Job, rim: Connector, a: Pose, b: Pose) -> Iterator[tuple[Path, Path]]:
    """Straights back from a, and back to b, between which a way may be looked for; few, the shortest first."""
    steps = BACK_M if rim.reversing else BACK_M[:1]
    leads = [way for back in steps if _held(job, (way := straight(a, -back)).end) and rim.fits(way)][:2]
    tails = [way for on in steps if _held(job, (way := straight(ahead(b, on), -on)).start) and rim.fits(way)][:2]
    yield from sorted(product(leads, tails), key=lambda pair: pair[0].length_m + pair[1].length_m)


def _held(job: Job, pose: Pose) -> bool:
    return bool(shapely.dwithin(job.connector.free, shapely.Point(pose[:2]), 1e-3))


def _all_between(job: Job, rim: Connector, a: Pose, b: Pose) -> Iterator[Path]:
    """Ways after a straight back from a and before one to b, the shortest straights first.

    Where no way at all leads from one of these places to the other, none does from a few metres farther back.
    """
    for lead, tail in _freed(job, rim, a, b):
        way = _between(job, lead, tail)
        if way is None:
            return
        yield way


def _between(job: Job, lead: Path, tail: Path) -> Path | None:
    way = job.way(lead.end, tail.start)
    return None if way is None else join((lead, way, tail), way.kind)


def _strips(job: Job, share: Sequence[Stretch]) -> list[_Strip]:
    """The stretches of a share as they are driven; those that their corners work anyhow are left out."""
    arcs = [_arc(job, a, b) for a, b in pairwise(share)]
    strips = []
    for index, stretch in enumerate(share):
        into, out = arcs[index - 1] if index else None, arcs[index] if index < len(arcs) else None
        first, last = _extent(job, stretch)
        side = stretch.lap.sides[stretch.side]
        radius = job.manner.radius_m
        if into is not None:
            first = tangent_m(side.before_rad, radius)
        if out is not None:
            last = side.length_m - tangent_m(side.after_rad, radius)
        if last - first < SHORTEST_M and into is None and out is None:
            continue
        points = _along(stretch.line, first, last)
        if out is not None:
            points = np.concatenate([points, *(run[1:] for _, run in out.sample(STEP_M))])
        task = Task(ROUND, stretch.lap.number, _piece(job, stretch))
        strips += _around(job, _Strip(points, task, stretch.length_m, into is not None, out is not None))
    return strips


def _around(job: Job, strip: _Strip) -> list[_Strip]:
    """A strip bent round small obstacles; in pieces where one leaves no room for that."""
    if job.around.bender is None:
        return [strip]
    parts = clear_parts(strip.points, job.around.bender)
    if parts is None:
        return [strip]
    last = len(parts) - 1
    return [
        _Strip(points, strip.task, length_m, strip.joined_in and index == 0, strip.joined_out and index == last)
        for index, (points, length_m) in enumerate(parts)
    ]


def _piece(job: Job, stretch: Stretch) -> int:
    """Number of a side among all sides of rounds of the same number, the same whichever way it is driven."""
    same = [lap for lap in job.rounds if lap.number == stretch.lap.number]
    before = sum(len(lap.sides) for lap in same if lap.ring < stretch.lap.ring)
    lap = next((lap for lap in same if lap.ring == stretch.lap.ring), stretch.lap)
    ends = stretch.lap.sides[stretch.side].points[[0, -1]]
    turned = not np.array_equal(lap.sides[stretch.side].points[[0, -1]], ends)
    return before + (len(lap.sides) - 1 - stretch.side if turned else stretch.side)


def _extent(job: Job, stretch: Stretch) -> tuple[float, float]:
    """Where the guided point is along a side when the implement is lowered and lifted, within the field (m)."""
    side, tool = stretch.lap.sides[stretch.side], job.manner.tool_m
    begin = worked_into(side.before_rad, job.layout.width_m)[1] if stretch.first_m is None else stretch.first_m
    if stretch.last_m is None:
        end = side.length_m + worked_into(side.after_rad, job.layout.width_m)[0]
    else:
        end = stretch.last_m
    first, last, line = begin + tool, end + tool, stretch.line
    while last > side.length_m and not _room_for(job, line, last):
        last -= PULL_M
    while first < 0.0 and not _room_for(job, line, first):
        first += PULL_M
    if job.fence is not None:
        middle = 0.5 * side.length_m
        while last > middle and job.fence.hits(_pose_at(line, last)):
            last -= PULL_M
        while first < middle and job.fence.hits(_pose_at(line, first)):
            first += PULL_M
    return first, last


def _room_for(job: Job, line: Points, distance_m: float) -> bool:
    return bool(shapely.covers((job.rim or job.connector).free, shapely.Point(_at(line, distance_m))))


def _pose_at(line: Points, distance_m: float) -> Pose:
    """Pose at a distance along a polyline, drawn on straight beyond its ends."""
    return _pose(_along(line, distance_m - PULL_M, distance_m), -1)


def _arc(job: Job, a: Stretch, b: Stretch) -> Path | None:
    """The arc that joins two stretches with the implement down; None where corners are square or it does not fit."""
    one_round = (a.lap.number, a.lap.ring) == (b.lap.number, b.lap.ring)
    if job.square or not one_round or a.last_m is not None or b.first_m is not None:
        return None
    side, after = a.lap.sides[a.side], b.lap.sides[b.side]
    if (a.side + 1) % len(a.lap.sides) != b.side or a.smooth:
        return None
    touch = tangent_m(side.after_rad, job.manner.radius_m)
    ends = [math.dist(*side.points[-2:]), math.dist(*after.points[:2])]
    if touch > min(ends) or touch > 0.5 * min(side.length_m, after.length_m):
        return None
    x, y, heading = _pose(side.points, -1)
    arc = corner_arc((x, y), heading, side.after_rad, job.manner.radius_m)
    return arc if job.connector.fits(arc) else None


def _working(job: Job, strip: _Strip) -> list[Leg]:
    """The legs of a strip: a tractor may be kept waiting before it, on a long one, and before its last stretch."""
    length = float(np.hypot(*np.diff(strip.points, axis=0).T).sum())
    hold = max(length - job.manner.hold_back_m, 0.5 * length)
    ends = [0.0, length] if strip.joined_out else [0.0, *_stops(hold), length]
    parts = list(pairwise(ends))
    legs = []
    for index, (first, last) in enumerate(parts):
        points = _along(strip.points, first, last)
        x, y = points[len(points) // 2]
        ground = job.layout.field.ground_at(float(x), float(y))
        wait = index > 0 or not strip.joined_in
        legs.append(Leg(points, job.manner.work_speed_mps, 1, True, ground, strip.task, wait))
    return legs


def _stops(hold_m: float) -> list[float]:
    """Where along a side a tractor may be kept waiting, up to the last place (m)."""
    count = max(1, round(hold_m / STOPS_M))
    return [hold_m * part / count for part in range(1, count + 1)]


def _at(line: Points, distance_m: float) -> tuple[float, float]:
    x, y = _along(line, distance_m, distance_m)[0]
    return float(x), float(y)


def _along(line: Points, first_m: float, last_m: float) -> Points:
    """A polyline (n, 2) between two distances along it, drawn on straight where they lie beyond its ends."""
    steps = np.hypot(*np.diff(line, axis=0).T)
    line = line[np.concatenate(([True], steps > 1e-9))]
    steps = steps[steps > 1e-9]
    place = np.concatenate(([0.0], np.cumsum(steps)))
    ends = []
    for at in (first_m, last_m):
        k = int(np.clip(np.searchsorted(place, at) - 1, 0, len(steps) - 1))
        ends.append(line[k] + (at - place[k]) / steps[k] * (line[k + 1] - line[k]))
    between = line[(place > first_m + 1e-6) & (place < last_m - 1e-6)]
    return np.concatenate([ends[:1], between, ends[1:]])


def _pose(points: Points, end: int) -> Pose:
    """Pose at the first (0) or the last (-1) point of a polyline, facing along it."""
    a, b = (points[0], points[1]) if end == 0 else (points[-2], points[-1])
    x, y = points[end]
    return float(x), float(y), math.atan2(b[1] - a[1], b[0] - a[0])
