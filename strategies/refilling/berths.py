"""Where a tractor stands to be served at a fixed place: near to it, along the edge of the field, one way or the other.

Only there is room to come and to go on; the hose or the loader reaches from the place to the tractor.
"""

from __future__ import annotations

import math

import shapely

from strategies.job import Job
from strategies.ways.paths import Pose, ahead, straight

INSIDE_M = (0.5, 0.05)  # from the edge of where the guided point may be, so that a way along a bent edge fits
STEPS, STEP = 8, 0.5  # places tried on either side, radii apart
ROOM = 1.0  # radii straight before and behind


def berths(job: Job) -> tuple[Pose, ...]:
    """The poses to stand in, one for each direction along the edge; none where the field has no room."""
    place = None if job.supply is None else job.supply.place
    edge = None if place is None else _edge(job, shapely.Point(place))
    if edge is None:
        return ()
    at, step = float(edge.project(shapely.Point(place))), STEP * job.manner.radius_m
    found = (_berth(job, edge, at, hand, step) for hand in (1, -1))
    return tuple(pose for pose in found if pose is not None)


def _edge(job: Job, place: shapely.Point) -> shapely.LinearRing | None:
    """The ring nearest to a place on which the guided point has a little room to spare."""
    for inside_m in INSIDE_M:
        parts = shapely.get_parts(job.connector.free.buffer(-inside_m))
        rings = [ring for part in parts if not part.is_empty for ring in (part.exterior, *part.interiors)]
        if rings:
            return min(rings, key=lambda ring: round(float(ring.distance(place)), 3))
    return None


def _berth(job: Job, edge: shapely.LinearRing, at: float, hand: int, step: float) -> Pose | None:
    """The first pose along the edge in one direction with room before and behind, from a place on to either side."""
    room = ROOM * job.manner.radius_m
    for number in sorted(range(-STEPS, STEPS + 1), key=abs):
        pose = _pose(edge, (at + number * step) % edge.length, hand)
        if job.connector.fits(straight(ahead(pose, -room), 2.0 * room)):
            return pose
    return None


def _pose(edge: shapely.LinearRing, at: float, hand: int) -> Pose:
    here = edge.interpolate(at)
    a, b = (edge.interpolate((at + off) % edge.length) for off in (-0.5, 0.5))
    return here.x, here.y, math.atan2(hand * (b.y - a.y), hand * (b.x - a.x))
