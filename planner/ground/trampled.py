"""Finished ground that wheels went over."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import shapely

from planner.ground.overlays import Areas, left_of, united, within
from planner.ground.swept import Points, Rows, Swept, swept_until
from planner.site import Site
from vehicle.run import Run
from vehicle.tractor import Tractor

TYRE_M = 0.4  # an assumption, for every wheel: tyres of tractors of some 75 kW are 0.34 m wide in front, 0.42 m behind
EVERY = 5  # rows of the 10 Hz record between points of a wheel's path
STILL_M = 1e-6
STRETCH = 20  # rows: two seconds of driving are looked at together


def trampled_m2(run: Run, site: Site, swept: Swept) -> float:
    """Ground (m2) off the headland that wheels went over after it was finished, each place once.

    The wheels of a tractor whose implement is down do not count: it works what they have trodden on. The headland is
    what is worked in rounds: turning there is what it is for.
    """
    lines, row = _wheel_paths(run, site.tractor)
    finished = np.flatnonzero(~swept.on_round)
    across = np.unique(_met(swept.ground[finished], lines)[0])
    tyres, row = shapely.buffer(lines[across], 0.5 * TYRE_M, cap_style="flat"), row[across]
    wheel, strip = _met(swept.ground[finished], tyres)
    strip = finished[strip]
    before = swept.first[strip] < row[wheel]
    parts = _swept_before(run, site, swept, strip[before], row[wheel[before]])
    pressed = shapely.intersection(tyres[wheel[before]], parts)
    inside = within(united(pressed), site.layout.field.ground)
    rounds = swept.ground[swept.on_round]
    near = np.sort(shapely.STRtree(rounds).query(inside, predicate="intersects"))
    return float(left_of(inside, united(rounds[near])).area)


def _met(strips: Areas, short: Areas) -> tuple[Rows, Rows]:
    """Which of many short geometries meet which strips: numbers of both, in the order of the short ones.

    The strips are looked up among the short ones: their own boxes, of long ones that lie askew, hold most of the field.
    """
    strip, number = shapely.STRtree(short).query(strips, predicate="intersects")
    order = np.lexsort((strip, number))
    return number[order], strip[order]


def _swept_before(run: Run, site: Site, swept: Swept, strip: Rows, row: Rows) -> Areas:
    """Of every strip, what was swept before a row of the record."""
    parts = swept.ground[strip]
    under_way = np.flatnonzero(swept.last[strip] > row)
    at = strip[under_way]
    pieces = zip(swept.tractor[at].tolist(), swept.first[at].tolist(), row[under_way].tolist(), strict=True)
    parts[under_way] = swept_until(run, site, list(pieces))
    return parts


def _wheel_paths(run: Run, tractor: Tractor) -> tuple[Areas, Rows]:
    """Paths of all wheels while the implement is up, in stretches of two seconds, and the row each begins at."""
    found = [_paths_of(run, number, tractor) for number in range(run.plan.tractors)]
    lines, rows = zip(*found, strict=True)
    return np.concatenate(lines), np.concatenate(rows)


def _paths_of(run: Run, number: int, tractor: Tractor) -> tuple[Areas, Rows]:
    """The same of one tractor."""
    up = ~np.array([leg.implement for leg in run.plan.missions[number].legs])[run.leg(number)]
    rows, owner, first = _stretches(up)
    if not len(first):
        return np.empty(0, dtype=np.object_), np.empty(0, dtype=np.int64)
    wheels = _wheels(run.poses(number)[rows], tractor)
    steps = np.hypot(*np.diff(wheels, axis=1).transpose(2, 0, 1)) * (owner[1:] == owner[:-1])
    moved = np.stack([np.bincount(owner[1:], each, len(first)) for each in steps], axis=1) > STILL_M
    lines = np.stack([shapely.linestrings(wheel, indices=owner) for wheel in wheels], axis=1)
    return lines[moved], np.repeat(first, moved.sum(axis=1))


def _stretches(up: npt.NDArray[np.bool_]) -> tuple[Rows, Rows, Rows]:
    """Stretches of at most STRETCH rows of the record with the implement up.

    Of all of them the rows, every EVERY one and the last; for each row the number of its stretch; their first rows.
    """
    edges = np.flatnonzero(np.diff(np.concatenate(([0], up.astype(np.int8), [0])))).reshape(-1, 2)
    counts = np.maximum(0, -(-(edges[:, 1] - 1 - edges[:, 0]) // STRETCH))
    end = np.repeat(edges[:, 1] - 1, counts)
    number = np.arange(len(end)) - np.repeat(np.cumsum(counts) - counts, counts)
    first = np.repeat(edges[:, 0], counts) + STRETCH * number
    last = np.minimum(first + STRETCH, end)
    rows = np.column_stack([first[:, None] + np.arange(0, STRETCH, EVERY), last])
    taken = np.column_stack([rows[:, :-1] < last[:, None], np.ones(len(last), dtype=np.bool_)])
    return rows[taken], np.nonzero(taken)[0], first


def _wheels(poses: Points, tractor: Tractor) -> Points:
    """Places (4, t, 2) of the wheels at poses (t, 3) of the centre of mass."""
    x, y, angle = poses.T
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.stack([
        np.column_stack([x + ahead * cosine - left * sine, y + ahead * sine + left * cosine])
        for ahead in (tractor.front_axle_m, -tractor.rear_axle_m)
        for left in (-0.5 * tractor.track_m, 0.5 * tractor.track_m)
    ])  # fmt: skip
