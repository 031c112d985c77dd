"""Ground swept by the implements of a run: polygons, and between which rows of the record they were swept."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt
import shapely

from planner.ground.overlays import Areas, only_areas
from planner.site import Site
from vehicle.missions import ROUND
from vehicle.run import Run

EVERY = 3  # rows of the 10 Hz record between corners of a swath: under half a metre of driving, in a bend as well
BEND_RAD = math.radians(20.0)  # a polygon ends where the bar has turned so far: neither side of it crosses itself
SIMPLIFY_M = 0.003  # a corner driven round is short of what its outer end sweeps by two thirds of that
SHORTEST_M = 0.1
STILL_M = 1e-9
Points = npt.NDArray[np.float64]
Rows = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Swept:
    """What the bars of the implements passed over while they were down.

    `ground` (n,) polygons; for each of them `tractor`, the rows `first` and `last` of the record between which it was
    swept, and `on_round`, whether that was on a round of the headland.
    """

    ground: Areas
    tractor: Rows
    first: Rows
    last: Rows
    on_round: npt.NDArray[np.bool_]


def swept_ground(run: Run, site: Site) -> Swept:
    """Every polygon that an implement swept; a stretch of work that bends is in several, edge to edge."""
    pieces = [piece for tractor in range(run.plan.tractors) for piece in _pieces(run, site, tractor)]
    table = np.array([mark for mark, _ in pieces], dtype=np.int64).reshape(-1, 4)
    tractor, first, last, on_round = table.T
    return Swept(_polygons([ends for _, ends in pieces]), tractor, first, last, on_round.astype(bool))


def swept_until(run: Run, site: Site, pieces: list[tuple[int, int, int]]) -> Areas:
    """What a tractor swept from the first row of a piece of `swept_ground` to another row: (tractor, first, row)."""
    return _polygons([bar_ends(run.poses(tractor)[_rows(first, row)], site) for tractor, first, row in pieces])


def bar_ends(poses: Points, site: Site) -> Points:
    """Left and right end of the implement's bar, (2, t, 2), at poses (t, 3) of the centre of mass."""
    x, y, angle = poses.T
    reach = -(site.tractor.rear_axle_m + site.implement.hitch_m)
    middle = np.column_stack([x + reach * np.cos(angle), y + reach * np.sin(angle)])
    aside = 0.5 * site.implement.width_m * np.column_stack([-np.sin(angle), np.cos(angle)])
    return np.stack([middle + aside, middle - aside])


def _rows(first: int, last: int) -> Rows:
    return np.append(np.arange(first, last, EVERY), last)


def _pieces(run: Run, site: Site, tractor: int) -> Iterator[tuple[tuple[int, int, int, int], Points]]:
    """Stretches of work cut where they bend or change direction.

    Of each tractor, first row, last row, and whether on a round; and the ends of the bar (2, t, 2) as of `bar_ends`.
    """
    legs = run.plan.missions[tractor].legs
    kinds = np.array([(2 if leg.task.kind == ROUND else 1) if leg.implement else 0 for leg in legs], dtype=np.int8)
    kind = kinds[run.leg(tractor)]
    cuts = np.flatnonzero(np.diff(np.concatenate(([0], kind, [0]))))
    edges = [(first, end) for first, end in pairwise(cuts.tolist()) if kind[first]]
    if not edges:
        return
    # All stretches at once: there are hundreds, and each by itself takes longer than its rows do.
    each = [_rows(first, min(end, len(kind) - 1)) for first, end in edges]
    rows, borders = np.concatenate(each), np.cumsum([0, *map(len, each)]).tolist()
    poses = run.poses(tractor)[rows]
    ends, angle = bar_ends(poses, site), poses[:, 2]
    direction, steps = _direction(angle, ends), np.hypot(*np.diff(ends, axis=1).T)
    jumps = np.abs(np.diff(angle)) >= math.pi
    for begin, after in pairwise(borders):
        inner = slice(begin, after - 1)
        if after - begin < 2 or float(steps[inner].sum()) < 2.0 * SHORTEST_M:
            continue
        turned = angle[begin:after]
        on_round = int(kind[rows[begin]] == 2)
        for a, b in _straight(np.unwrap(turned) if jumps[inner].any() else turned, direction[inner]):
            first, last = begin + a, begin + b
            yield (tractor, int(rows[first]), int(rows[last]), on_round), ends[:, first : last + 1]


def _direction(angle: Points, ends: Points) -> npt.NDArray[np.int8]:
    """Per step of the bar: 1 where both its ends go forward, -1 where both go back, 0 where it turns on the spot."""
    ahead = np.column_stack([np.cos(angle[:-1]), np.sin(angle[:-1])])
    gone = np.einsum("etk,tk->et", np.diff(ends, axis=1), ahead)
    direction = np.where((gone >= -STILL_M).all(axis=0), 1, np.where((gone <= STILL_M).all(axis=0), -1, 0))
    return direction.astype(np.int8)


def _straight(angle: Points, direction: npt.NDArray[np.int8]) -> Iterator[tuple[int, int]]:
    """First and last pose of pieces in one direction that turn by less than BEND_RAD; steps on the spot one by one."""
    first = 0
    while first < len(direction):
        ends = (np.abs(angle[first + 1 :] - angle[first]) > BEND_RAD) | (direction[first:] != direction[first])
        steps = int(np.argmax(ends)) if ends.any() else len(ends)
        last = first + max(1, steps if direction[first] else 1)
        yield first, last
        first = last


def _polygons(ends: list[Points]) -> Areas:
    """The area between the paths of left and right end of a bar, one polygon per pair (2, t, 2)."""
    if not ends:
        return np.empty(0, dtype=np.object_)
    sides = [_simplified([pair[side] for pair in ends]) for side in (0, 1)]
    places, owners = zip(*sides, strict=True)
    owner = np.concatenate([owners[0], owners[1][::-1]])
    order = np.argsort(owner, kind="stable")
    rings = shapely.linearrings(np.concatenate([places[0], places[1][::-1]])[order], indices=owner[order])
    areas = shapely.polygons(rings)
    crossed = ~shapely.is_valid(areas)
    areas[crossed] = [only_areas(area) for area in shapely.make_valid(areas[crossed])]
    return np.asarray(areas, dtype=np.object_)


def _simplified(lines: list[Points]) -> tuple[Points, Rows]:
    """Points of polylines to SIMPLIFY_M, and the number of the line of each."""
    owner = np.repeat(np.arange(len(lines)), [len(line) for line in lines])
    whole = shapely.linestrings(np.concatenate(lines), indices=owner)
    plain = shapely.simplify(whole, SIMPLIFY_M, preserve_topology=False)
    return shapely.get_coordinates(plain, return_index=True)  # type: ignore[no-any-return]
