"""Figures of merit of a run: what was worked, how far outside, how long, how close."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt
import shapely

from planner.site import Site
from vehicle.run import Run

SIMPLIFY_M = 0.01
EVERY = 5  # rows of the 10 Hz record between corners of a swath: under a metre of driving
GRID_M = 1e-6  # without a grid GEOS loses area when it unites swaths whose edges all but coincide
Points = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Coverage:
    """Shares of the field area, in percent."""

    worked_pct: float
    overlap_pct: float


def guided_point(run: Run, site: Site, tractor: int) -> Points:
    """Track of the antenna, shape (t, 2)."""
    return _ahead(run, tractor, site.tractor.antenna_forward_m - site.tractor.rear_axle_m)


def _ahead(run: Run, tractor: int, reach: float) -> Points:
    x, y, angle = run.poses(tractor).T
    return np.column_stack([x + reach * np.cos(angle), y + reach * np.sin(angle)])


def coverage(run: Run, site: Site) -> Coverage:
    """Area the implements swept while working: once or more, and more than once, within the field."""
    strips = [strip for tractor in range(run.plan.tractors) for strip in _strips(run, site, tractor)]
    if not strips:
        return Coverage(0.0, 0.0)
    field = site.layout.field.boundary
    inside = shapely.intersection(np.array(strips), field, grid_size=GRID_M)
    worked = float(shapely.union_all(inside, grid_size=GRID_M).area)
    total = float(shapely.area(inside).sum())
    return Coverage(100.0 * worked / field.area, 100.0 * max(total - worked, 0.0) / field.area)


def _strips(run: Run, site: Site, tractor: int) -> list[shapely.Geometry]:
    """One polygon per uninterrupted stretch of work."""
    working = np.array([leg.implement for leg in run.plan.missions[tractor].legs])
    down = working[run.leg(tractor)]
    edges = np.flatnonzero(np.diff(np.concatenate(([0], down.astype(np.int8), [0]))))
    strips = []
    for first, last in edges.reshape(-1, 2):
        rows = np.append(np.arange(first, min(last, len(down) - 1), EVERY), min(last, len(down) - 1))
        strip = _strip(run.poses(tractor)[rows], site)
        if strip is not None:
            strips.append(strip)
    return strips


def _strip(poses: Points, site: Site) -> shapely.Geometry | None:
    """Area swept by the implement's bar over consecutive poses (t, 3) of the centre of mass."""
    x, y, angle = poses.T
    reach = -(site.tractor.rear_axle_m + site.implement.hitch_m)
    half = 0.5 * site.implement.width_m
    middle = np.column_stack([x + reach * np.cos(angle), y + reach * np.sin(angle)])
    aside = half * np.column_stack([-np.sin(angle), np.cos(angle)])
    sides = [shapely.simplify(shapely.linestrings(side), SIMPLIFY_M) for side in (middle + aside, middle - aside)]
    if any(side.length < 0.1 for side in sides):
        return None
    ring = np.concatenate([np.asarray(sides[0].coords), np.asarray(sides[1].coords)[::-1]])
    return shapely.make_valid(shapely.polygons(ring))


@dataclass(frozen=True)
class Excursion:
    """Path length outside the boundary and the farthest distance from it, metres."""

    length_m: float
    depth_m: float


def excursion(run: Run, site: Site) -> Excursion:
    """How much of the guided points' paths lies outside the field."""
    boundary = site.layout.field.boundary
    shapely.prepare(boundary)
    length = depth = 0.0
    for tractor in range(run.plan.tractors):
        path = guided_point(run, site, tractor)
        outside = ~shapely.contains_xy(boundary, path[:, 0], path[:, 1])
        if outside.any():
            steps = np.hypot(*np.diff(path, axis=0).T)
            length += float(steps[outside[1:] & outside[:-1]].sum())
            depth = max(depth, float(shapely.distance(shapely.points(path[outside]), boundary).max()))
    return Excursion(length, depth)


def reversals(run: Run) -> int:
    """Gear changes planned and driven."""
    return sum(a.gear != b.gear for mission in run.plan.missions for a, b in pairwise(mission.legs))


def finite_or_none(value: float) -> float | None:
    """None for a value that does not exist."""
    return value if math.isfinite(value) else None
