"""What may be driven at the ends of a route: straights ahead and back, turning round, and straights into the region."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import shapely
from shapely.geometry.base import BaseGeometry

from strategies.path_planning.paths import DrivePath, Pose, join_paths, make_straight_path
from strategies.path_planning.turns import build_turn_on_spot

AHEAD_RADII = (0.0, 0.25, 0.5, 1.0, 1.5)  # radii straight on at the ends of a route
BACK_RADII = (0.5, 1.0, 2.0, 3.0, 5.0, 8.0)  # radii straight back
TURN_ROUND_OPTIONS = tuple((arcs, hand) for arcs in (3, 5, 9) for hand in (1, -1))  # arcs and first hand
MAX_OUTSIDE_M = 0.5  # an end farther outside is not joined
OUTSIDE_RADII, OUTSIDE_STEP_M = 2.0, 0.25  # most radii straight into the region, and the steps tried


def list_start_paths(pose: Pose, effort: int, radius_m: float, fits: Callable[[DrivePath], bool]) -> list[DrivePath]:
    """What may be driven from a pose before the first primitive of a route, as far as it fits.

    Effort 0 is straights ahead; 1 adds backing up and turning round in three arcs; 2 adds turning round in more,
    shorter arcs, also after backing up or going ahead.
    """
    paths = [make_straight_path(pose, radii * radius_m) for radii in AHEAD_RADII]
    if effort >= 1:
        paths += [make_straight_path(pose, -radii * radius_m) for radii in BACK_RADII]
    if effort >= 2:
        bases = [path for path in paths if fits(path)]
        paths += [
            join_paths((base, build_turn_on_spot(base.end, hand, arcs, radius_m)), "route")
            for base in bases
            for arcs, hand in TURN_ROUND_OPTIONS
        ]
    elif effort == 1:
        paths += [build_turn_on_spot(pose, hand, 3, radius_m) for hand in (1, -1)]
    return [path for path in paths if fits(path)]


def list_straights_inside(pose: Pose, region: BaseGeometry, radius_m: float, max_reverse_m: float) -> list[DrivePath]:
    """The shortest straights ahead and back from a pose a little outside a prepared region; none needed from within."""
    place = shapely.Point(pose[:2])
    if shapely.covers(region, place):
        return [make_straight_path(pose, 0.0)]
    if not shapely.dwithin(region, place, MAX_OUTSIDE_M):
        return []
    reach_m = OUTSIDE_RADII * radius_m
    options = (_iter_straights(pose, 1.0, reach_m), _iter_straights(pose, -1.0, min(reach_m, max_reverse_m)))
    paths = [
        next((path for path in straights if shapely.covers(region, shapely.Point(path.end[:2]))), None)
        for straights in options
    ]
    return [path for path in paths if path is not None]


def _iter_straights(pose: Pose, sign: float, most_m: float) -> Iterator[DrivePath]:
    return (make_straight_path(pose, sign * k * OUTSIDE_STEP_M) for k in range(1, int(most_m / OUTSIDE_STEP_M) + 1))
