"""Where a tractor stands at a place: along the edge nearest to it, either way, with room straight before and behind."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import shapely

from strategies.moves.move_finder import MOVE_MARGIN_M
from strategies.path_planning.paths import Pose, shift_pose_ahead
from strategies.rules.supply import Point
from strategies.site.ground import measure_rooms
from strategies.site.site import Site

STEP_COUNT, STEP_RADII = 8, 0.5  # places tried on either side, and radii between them
INSET_COUNT, INSET_HALVES = 3, 0.5  # rows tried, the first as near to the edge as the body may be; half widths between
ROOM_RADII, ROOM_STEP_M = 1.0, 0.5  # radii straight before and behind, and between the poses looked at
TANGENT_M = 0.5  # to either side of a place on an edge, for its direction


def find_stop_poses(site: Site, place: Point) -> tuple[Pose, ...]:
    """The poses of the guided point to stand in, one for each direction along the edge; none where there is no room."""
    candidates = list(_list_candidates(site, place))
    poses = (
        next((pose for pose in candidates[hand] if _has_room(site, pose)), None) for hand in range(len(candidates))
    )
    return tuple(pose for pose in poses if pose is not None)


def _list_candidates(site: Site, place: Point) -> Iterator[list[Pose]]:
    """For either direction along the edge the poses near a place, the nearest first."""
    half_m = max(half for _, _, half in site.rules.boxes)
    rings = [
        ring
        for number in range(INSET_COUNT)
        if (ring := _find_nearest_ring(site, place, (1.0 + INSET_HALVES * number) * half_m + MOVE_MARGIN_M)) is not None
    ]
    for hand in (1, -1):
        poses = [pose for ring in rings for pose in _list_poses(site, ring, place, hand)]
        yield sorted(poses, key=lambda pose: round(math.dist(pose[:2], place), 3))


def _find_nearest_ring(site: Site, place: Point, inset_m: float) -> shapely.LinearRing | None:
    """The ring nearest to a place, so far inside the edges and obstacles."""
    parts = shapely.get_parts(site.layout.field.region_without_obstacles.buffer(-inset_m)).tolist()
    rings = [ring for part in parts if not part.is_empty for ring in (part.exterior, *part.interiors)]
    return min(rings, key=lambda ring: round(float(ring.distance(shapely.Point(place))), 3), default=None)


def _list_poses(site: Site, ring: shapely.LinearRing, place: Point, hand: int) -> Iterator[Pose]:
    place_m, step_m = float(ring.project(shapely.Point(place))), STEP_RADII * site.rules.radius_m
    for number in range(-STEP_COUNT, STEP_COUNT + 1):
        distance_m = (place_m + number * step_m) % ring.length
        point = ring.interpolate(distance_m)
        a, b = (ring.interpolate((distance_m + off_m) % ring.length) for off_m in (-TANGENT_M, TANGENT_M))
        yield point.x, point.y, math.atan2(hand * (b.y - a.y), hand * (b.x - a.x))


def _has_room(site: Site, pose: Pose) -> bool:
    """Whether the body has room on the straight line through a pose, so far that a move may begin and end there."""
    room_m = ROOM_RADII * site.rules.radius_m
    along_m = np.linspace(-room_m, room_m, max(2, math.ceil(2.0 * room_m / ROOM_STEP_M) + 1)).tolist()
    poses = np.array([shift_pose_ahead(pose, distance_m) for distance_m in along_m])
    body, ground = site.body, site.ground
    rooms = measure_rooms(
        poses, body.guide_m, body.points, body.reach_m, ground.grid, ground.frame, 2.0 * MOVE_MARGIN_M
    )
    return float(rooms.min()) >= MOVE_MARGIN_M
