"""Paths with the implement up: through a corner of the headland, and from any side or swath to another."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import chain, product
from typing import TypeGuard

import shapely

from strategies.headland.corners import find_corner_paths
from strategies.path_planning.connector import Connector
from strategies.path_planning.paths import (
    DrivePath,
    Pose,
    join_paths,
    make_straight_path,
    measure_longest_reverse_m,
    shift_pose_ahead,
)
from strategies.program.field_job import FieldJob

MAX_REVERSALS = 4  # a path with more turns on the spot in arcs too short to follow
MAX_CORNER_RADII = 6.0  # radii by which a path through a corner may exceed the distance of its ends
WIDE_RADIUS_FACTORS = (1.15, 1.35, 1.7)  # times the planned radius, for arcs that swing out less
BACK_UP_M = (0.0, 1.5, 3.0, 5.0, 8.0)  # straight back from a pose that no path joins


def find_raised_path(job: FieldJob, a: Pose, b: Pose, *, allow_rim: bool = False) -> DrivePath | None:
    """The path with the implement up from the end of a side or swath to the beginning of another; None for none.

    With `allow_rim` the implement may reach over the edge of the field all along the path.
    """
    rim = job.rim_connector or job.connector
    candidates = chain((find_quickest_turn(job, a, b),), _find_paths_with_straights(job, rim, a, b))
    followable: list[DrivePath] = []
    for candidate in candidates:
        if _is_followable(candidate):
            followable.append(candidate)
            if not job.crosses_fence(candidate) and not job.has_overhang(candidate):
                break
    path = _pick_clear_path(job, followable) or rim.connect_directly(a, b)
    if job.crosses_fence(path):
        path = job.find_path(a, b)
    if allow_rim and (not _is_followable(path) or job.has_long_reverse(path)):
        path = rim.connect(a, b) or path or rim.connect_in_reverse(a, b)
    return path if _is_followable(path) else None


def find_quickest_turn(job: FieldJob, a: Pose, b: Pose) -> DrivePath | None:
    """The quickest of the paths through a corner and the turns from one pose to another.

    Through corners wider arcs are driven only where all others reach too far over an open edge.
    """
    rim, radius_m = job.rim_connector or job.connector, job.driving_rules.radius_m
    timed = _list_corner_paths(job, a, b, radius_m)
    turn = job.find_turn(a, b)
    if turn is not None:
        timed.append((rim.compute_cost_s(turn), turn))
    path = _pick_clear_path(job, _sort_by_time(timed))
    if path is None or not job.has_overhang(path):
        return path
    wide = [pair for factor in WIDE_RADIUS_FACTORS for pair in _list_corner_paths(job, a, b, factor * radius_m)]
    clear_paths = (one for one in _sort_by_time(wide) if not job.has_overhang(one) and not job.crosses_fence(one))
    return next(clear_paths, path)


def _list_corner_paths(job: FieldJob, a: Pose, b: Pose, radius_m: float) -> list[tuple[float, DrivePath]]:
    """The paths through a corner by one arc that fit, each with its seconds."""
    rim = job.rim_connector or job.connector
    max_reverse_m = job.driving_rules.max_reverse_m if rim.can_reverse else 0.0
    max_length_m = math.dist(a[:2], b[:2]) + MAX_CORNER_RADII * radius_m
    return [
        (rim.costs.compute_time_s(path), path)
        for path in find_corner_paths(a, b, radius_m)
        if measure_longest_reverse_m(path) <= max_reverse_m and path.length_m <= max_length_m and rim.fits(path)
    ]


def _sort_by_time(timed: list[tuple[float, DrivePath]]) -> list[DrivePath]:
    """Paths with their seconds in the order of these, to the microsecond."""
    return [path for _, path in sorted(timed, key=lambda pair: round(pair[0], 6))]


def _pick_clear_path(job: FieldJob, paths: list[DrivePath]) -> DrivePath | None:
    """The first path that touches neither fence nor obstacle, else the first that touches no fence.

    Of those that touch nothing, the first that does not reach too far over an open edge.
    """
    clear_paths = [path for path in paths if not job.crosses_fence(path)]
    if not clear_paths:
        return next((path for path in paths if not job.crosses_fence(path, fences_only=True)), None)
    return next((path for path in clear_paths if not job.has_overhang(path)), clear_paths[0])


def _is_followable(path: DrivePath | None) -> TypeGuard[DrivePath]:
    """Whether there is a path and a tractor can be expected to follow it."""
    return path is not None and path.reversals <= MAX_REVERSALS


def _find_backed_up_ends(job: FieldJob, rim: Connector, a: Pose, b: Pose) -> Iterator[tuple[DrivePath, DrivePath]]:
    """Pairs of a straight back from a and one back to b between which a path may be looked for, the shortest first."""
    steps_m = BACK_UP_M if rim.can_reverse else BACK_UP_M[:1]
    leads = [
        path for lead_m in steps_m if _is_free(job, (path := make_straight_path(a, -lead_m)).end) and rim.fits(path)
    ][:2]
    tails = [
        path
        for tail_m in steps_m
        if _is_free(job, (path := make_straight_path(shift_pose_ahead(b, tail_m), -tail_m)).start) and rim.fits(path)
    ][:2]
    yield from sorted(product(leads, tails), key=lambda pair: pair[0].length_m + pair[1].length_m)


def _is_free(job: FieldJob, pose: Pose) -> bool:
    return bool(shapely.dwithin(job.connector.free, shapely.Point(pose[:2]), 1e-3))


def _find_paths_with_straights(job: FieldJob, rim: Connector, a: Pose, b: Pose) -> Iterator[DrivePath]:
    """Paths after a straight back from a and before one to b, the shortest straights first.

    If no path leads from one of these places to the other, none does from a few metres farther back either. Paths that
    reverse far come last.
    """
    reversing_paths: list[DrivePath] = []
    for lead, tail in _find_backed_up_ends(job, rim, a, b):
        path = _find_path_between(job, lead, tail)
        if path is None:
            break
        if job.has_long_reverse(path):
            reversing_paths.append(path)
        else:
            yield path
    yield from reversing_paths


def _find_path_between(job: FieldJob, lead: DrivePath, tail: DrivePath) -> DrivePath | None:
    path = job.find_path(lead.end, tail.start)
    return None if path is None else join_paths((lead, path, tail), path.kind)
