"""Finished ground that wheels went over."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import shapely

from planner.site import Site
from planner.swept import GRID_M, Areas, Points, Rows, Swept, only_areas, swept_until
from vehicle.run import Run
from vehicle.tractor import Tractor

TYRE_M = 0.4  # an assumption, for every wheel: tyres of tractors of some 75 kW are 0.34 m wide in front, 0.42 m behind
EVERY = 5  # rows of the 10 Hz record between points of a wheel's path
STRETCH = 20  # rows: two seconds of driving are looked at together


def trampled_m2(run: Run, site: Site, swept: Swept) -> float:
    """Ground (m2) off the headland that wheels went over after it was finished, each place once.

    The wheels of a tractor whose implement is down do not count: it works what they have trodden on. The headland is
    what is worked in rounds: turning there is what it is for.
    """
    lines, row = _wheel_paths(run, site.tractor)
    finished = np.flatnonzero(~swept.on_round)
    ground = only_areas(shapely.union_all(swept.ground[finished], grid_size=GRID_M))
    shapely.prepare(ground)
    across = shapely.intersects(ground, lines)
    tyres, row = shapely.buffer(lines[across], 0.5 * TYRE_M, cap_style="flat"), row[across]
    wheel, strip = shapely.STRtree(swept.ground[finished]).query(tyres, predicate="intersects")
    strip = finished[strip]
    before = swept.first[strip] < row[wheel]
    parts = _swept_before(run, site, swept, strip[before], row[wheel[before]])
    pressed = shapely.intersection(tyres[wheel[before]], parts, grid_size=GRID_M)
    trodden = only_areas(shapely.union_all([only_areas(one) for one in pressed], grid_size=GRID_M))
    headland = only_areas(shapely.union_all(swept.ground[swept.on_round], grid_size=GRID_M))
    inside = shapely.intersection(trodden, site.layout.field.ground, grid_size=GRID_M)
    return float(shapely.difference(only_areas(inside), headland, grid_size=GRID_M).area)


def _swept_before(run: Run, site: Site, swept: Swept, strip: Rows, row: Rows) -> Areas:
    """Of every strip, what was swept before a row of the record."""
    parts = swept.ground[strip]
    for n in np.flatnonzero(swept.last[strip] > row):
        at = strip[n]
        began = int(swept.tractor[at]), int(swept.first[at])
        parts[n] = only_areas(swept_until(run, site, began, int(row[n])))
    return parts


def _wheel_paths(run: Run, tractor: Tractor) -> tuple[Areas, Rows]:
    """Paths of all wheels while the implement is up, in stretches of two seconds, and the row each begins at."""
    paths: list[Points] = []
    rows: list[int] = []
    for number, mission in enumerate(run.plan.missions):
        up = ~np.array([leg.implement for leg in mission.legs])[run.leg(number)]
        for stretch in _stretches(up):
            wheels = _wheels(run.poses(number)[stretch], tractor)
            moved = np.hypot(*(wheels[:, 1:] - wheels[:, :-1]).transpose(2, 0, 1)).sum(axis=1) > GRID_M
            paths += list(wheels[moved])
            rows += [int(stretch[0])] * int(moved.sum())
    if not paths:
        return np.empty(0, dtype=np.object_), np.empty(0, dtype=np.int64)
    owner = np.repeat(np.arange(len(paths)), [len(path) for path in paths])
    return shapely.linestrings(np.concatenate(paths), indices=owner), np.array(rows)


def _stretches(up: npt.NDArray[np.bool_]) -> list[Rows]:
    """Rows of the record, every EVERY one and the last, of stretches of at most STRETCH with the implement up."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], up.astype(np.int8), [0])))).reshape(-1, 2)
    return [
        np.append(np.arange(first, last, EVERY), last)
        for start, end in edges.tolist()
        for first in range(start, end - 1, STRETCH)
        if (last := min(first + STRETCH, end - 1)) > first
    ]


def _wheels(poses: Points, tractor: Tractor) -> Points:
    """Places (4, t, 2) of the wheels at poses (t, 3) of the centre of mass."""
    x, y, angle = poses.T
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.stack([
        np.column_stack([x + ahead * cosine - left * sine, y + ahead * sine + left * cosine])
        for ahead in (tractor.front_axle_m, -tractor.rear_axle_m)
        for left in (-0.5 * tractor.track_m, 0.5 * tractor.track_m)
    ])  # fmt: skip
