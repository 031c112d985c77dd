"""Finished ground that wheels went over."""

from __future__ import annotations

import numpy as np
import shapely

from planner.ground.overlays import Areas, left_of, united, within
from planner.ground.swept import Points, Rows, Swept, swept_until
from planner.site import Site
from vehicle.layout import REC_POSE
from vehicle.run import Run
from vehicle.tractor import Tractor

TYRE_M = 0.4  # an assumption, for every wheel: tyres of tractors of some 75 kW are 0.34 m wide in front, 0.42 m behind
EVERY = 5  # rows of the 10 Hz record between points of a wheel's path
SIMPLIFY_M = 0.0005  # of a path: chosen, half a millimetre of a tyre that is as wide as assumed
STILL_M = 1e-6
LONG = 200  # rows: twenty seconds of driving are looked at together
SHORT = 20  # rows: two seconds, where the ground is being worked meanwhile


def trampled_m2(run: Run, site: Site, swept: Swept) -> float:
    """Ground (m2) off the headland that wheels went over after it was finished, each place once.

    The wheels of a tractor whose implement is down do not count: it works what they have trodden on. The headland is
    what is worked in rounds: turning there is what it is for.
    """
    inside = within(united(_pressed(run, site, swept)), site.layout.field.ground)
    rounds = swept.ground[swept.on_round]
    near = np.sort(shapely.STRtree(rounds).query(inside, predicate="intersects"))
    return float(left_of(inside, united(rounds[near])).area)


def _pressed(run: Run, site: Site, swept: Swept) -> Areas:
    """What wheels went over of every strip off the headland after it was finished.

    It is looked at in long spans of driving, and in short ones where a strip is worked meanwhile: what of it is
    finished changes.
    """
    spans = _spans(run, LONG)
    tyres, number, strip = _marks(run, site, swept, spans)
    meanwhile = (swept.first[strip] < spans[number, 2]) & (swept.last[strip] > spans[number, 1])
    changing = np.unique(number[meanwhile])
    kept = ~np.isin(number, changing)
    short = _cut(spans[changing], SHORT)
    each = [(tyres[kept], spans[number[kept], 1], strip[kept])]
    if len(short):
        tyres, number, strip = _marks(run, site, swept, short)
        each.append((tyres, short[number, 1], strip))
    return np.concatenate([_on_finished(run, site, swept, *some) for some in each])


def _on_finished(run: Run, site: Site, swept: Swept, tyres: Areas, row: Rows, strip: Rows) -> Areas:
    """The marks of tyres on what was swept of strips before a row of the record."""
    before = swept.first[strip] < row
    tyres, row, strip = tyres[before], row[before], strip[before]
    return np.asarray(shapely.intersection(tyres, _swept_before(run, site, swept, strip, row)), dtype=np.object_)


def _marks(run: Run, site: Site, swept: Swept, spans: Rows) -> tuple[Areas, Rows, Rows]:
    """Marks of wheels on strips off the headland: for each the number of its span and that of the strip."""
    lines, number = _wheel_lines(run, site.tractor, spans)
    finished = np.flatnonzero(~swept.on_round)
    across = np.unique(_met(swept.ground[finished], lines)[0])
    tyres = shapely.buffer(lines[across], 0.5 * TYRE_M, cap_style="flat", join_style="round", quad_segs=2)
    wheel, strip = _met(swept.ground[finished], tyres)
    return tyres[wheel], number[across[wheel]], finished[strip]


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


def _spans(run: Run, most: int) -> Rows:
    """Spans of driving with the implement up, at most so many rows of the record: (n, 3) of tractor, first, last."""
    found = []
    for number in range(run.plan.tractors):
        up = ~np.array([leg.implement for leg in run.plan.missions[number].legs])[run.leg(number)]
        edges = np.flatnonzero(np.diff(np.concatenate(([0], up.astype(np.int8), [0])))).reshape(-1, 2)
        found.append(np.column_stack([np.full(len(edges), number), edges[:, 0], edges[:, 1] - 1]))
    return _cut(np.concatenate(found), most)


def _cut(spans: Rows, most: int) -> Rows:
    """Spans (n, 3) cut into such of at most so many rows; of single rows nothing is left."""
    counts = -(-(spans[:, 2] - spans[:, 1]) // most)
    tractor, first, last = np.repeat(spans, counts, axis=0).T
    first = first + most * (np.arange(len(first)) - np.repeat(np.cumsum(counts) - counts, counts))
    return np.column_stack([tractor, first, np.minimum(first + most, last)])


def _wheel_lines(run: Run, tractor: Tractor, spans: Rows) -> tuple[Areas, Rows]:
    """Paths of all wheels that moved in a span, and its number."""
    rows, owner = _rows(spans)
    wheels = _wheels(run.record[rows, spans[owner, 0], REC_POSE], tractor)
    steps = np.hypot(*np.diff(wheels, axis=1).transpose(2, 0, 1)) * (owner[1:] == owner[:-1])
    moved = np.stack([np.bincount(owner[1:], each, len(spans)) for each in steps], axis=1) > STILL_M
    lines = np.empty((len(spans), len(wheels)), dtype=np.object_)
    for k, wheel in enumerate(wheels if len(spans) else ()):
        lines[:, k] = shapely.linestrings(wheel, indices=owner)
    plain = shapely.simplify(lines[moved], SIMPLIFY_M, preserve_topology=False)
    return np.asarray(plain, dtype=np.object_), np.nonzero(moved)[0]


def _rows(spans: Rows) -> tuple[Rows, Rows]:
    """Rows of the record in spans (n, 3), every EVERY one and the last of each, and the number of the span of each."""
    counts = 1 - (spans[:, 1] - spans[:, 2]) // EVERY
    owner = np.repeat(np.arange(len(spans)), counts)
    place = np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)
    return np.minimum(spans[owner, 1] + EVERY * place, spans[owner, 2]), owner


def _wheels(poses: Points, tractor: Tractor) -> Points:
    """Places (4, t, 2) of the wheels at poses (t, 3) of the centre of mass."""
    x, y, angle = poses.T
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.stack([
        np.column_stack([x + ahead * cosine - left * sine, y + ahead * sine + left * cosine])
        for ahead in (tractor.front_axle_m, -tractor.rear_axle_m)
        for left in (-0.5 * tractor.track_m, 0.5 * tractor.track_m)
    ])  # fmt: skip
