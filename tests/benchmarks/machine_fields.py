"""Fields for the benchmark of machines: parcels with obstacles and edges set in by a seed, and what fits them.

The same parcel, count, edge and seed give the same field, whatever else runs. All lengths are metres of the field.
"""

import math
import random
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import shapely
from shapely import affinity

from fields.geometry.field import Field
from fields.geometry.obstacles import Obstacle

OBSTACLE_COUNTS = (0, 1, 5, 20)
OPEN, ENTRANCE, FENCE_PART, FENCE = "open", "entrance", "fence-part", "fence"
EDGES = (OPEN, ENTRANCE, FENCE_PART, FENCE)
"""The outline: open, with an entrance, fenced on the longer half, or fenced all round with an entrance as its gate."""
KINDS: Mapping[str, int] = {"pole": 50, "tree": 25, "pond": 15, "hedge": 10}
"""Percent of the obstacles that are of each kind."""
APART_M = 1.0  # between two obstacles
GROUP_TREES, GROUP_M = 5, 8.0  # in a group of trees, and how far from its middle they stand at most
MAX_TRIES = 2000
POND_SHARE = 0.12  # of the width of the parcel at most, so that ponds leave a field
MITRE_LIMIT = 3.0  # corners down to 40 degrees count as reachable: the implement is driven straight into them
FIT_WIDTHS = 3.0  # a field is a swath with a headland pass on either side of it
FIT_SHARE_PCT = 50.0  # in one connected piece
WIDE_WIDTHS = 10.0  # two headland passes all round and six swaths


@dataclass(frozen=True)
class Condition:
    """What is set into a parcel: a number of obstacles, and the kind of its edge."""

    obstacles: int = 0
    edge: str = OPEN

    def __str__(self) -> str:
        return f"{self.obstacles}:{self.edge}"


@dataclass(frozen=True)
class Fit:
    """How an implement fits a field.

    `across_m` is the diameter of the largest circle within the outline and beside its holes, `reachable_pct` the share
    of the ground without obstacles that a bar of the working width reaches without leaving it, in one connected piece.
    """

    across_m: float
    reachable_pct: float
    width_m: float
    radius_m: float

    @property
    def fits(self) -> bool:
        """Whether a plan is asked for: room for a swath with a headland pass on either side and for a full turn."""
        room_m = max(FIT_WIDTHS * self.width_m, 2.0 * self.radius_m + self.width_m)
        return self.across_m >= room_m and self.reachable_pct >= FIT_SHARE_PCT

    @property
    def is_wide(self) -> bool:
        """Whether a formation of two tractors is asked for."""
        return self.fits and self.across_m >= WIDE_WIDTHS * self.width_m


def measure_fit(field: Field, width_m: float, radius_m: float) -> Fit:
    """How a working width and a turning radius fit the ground of a field without its obstacles."""
    free = field.boundary
    if field.obstacles:
        free = shapely.difference(free, shapely.union_all([one.shape for one in field.obstacles]))
    largest = max(shapely.get_parts(free), key=lambda part: part.area)
    circle = shapely.maximum_inscribed_circle(field.boundary, tolerance=0.5)
    reachable_m2 = max((_compute_reachable_m2(part, width_m) for part in shapely.get_parts(largest)), default=0.0)
    return Fit(2.0 * float(circle.length), 100.0 * reachable_m2 / float(free.area), width_m, radius_m)


def _compute_reachable_m2(ground: shapely.Polygon, width_m: float) -> float:
    """The largest connected ground that a bar of this width covers without leaving the ground."""
    cores = shapely.get_parts(ground.buffer(-0.5 * width_m))
    grown = [core.buffer(0.5 * width_m, join_style="mitre", mitre_limit=MITRE_LIMIT) for core in cores]
    return max((float(shapely.intersection(one, ground).area) for one in grown), default=0.0)


def build_field(parcel: Field, condition: Condition, seed: int) -> Field:
    """The parcel with the obstacles, fences and entrance of a condition."""
    rng = random.Random(f"{seed} {parcel.name} {condition}")
    obstacles = tuple(draw_obstacles(rng, parcel.boundary, condition.obstacles))
    ring = shapely.LineString(parcel.boundary.exterior.coords)
    entrance = find_entrance(rng, ring, obstacles) if condition.edge in (ENTRANCE, FENCE) else None
    fences: tuple[shapely.LineString, ...] = ()
    if condition.edge == FENCE:
        fences = (ring,)
    if condition.edge == FENCE_PART:
        fences = (shapely.ops.substring(ring, 0.0, 0.6, normalized=True),)
    return replace(parcel, obstacles=obstacles, fences=fences, entrance=entrance)


def draw_obstacles(
    rng: random.Random, boundary: shapely.Polygon, count: int, kinds: Mapping[str, int] = KINDS
) -> Iterator[Obstacle]:
    """Obstacles at random places within the outline, at least APART_M from each other; of each kind by its weight.

    Kinds are poles, trees, groups of trees, ponds and hedges. As many as there is room for, at most `count`.
    """
    across_m = math.sqrt(float(boundary.area))
    west, south, east, north = boundary.bounds
    taken: list[shapely.Geometry] = []
    for _ in range(MAX_TRIES):
        if len(taken) == count:
            return
        place = (rng.uniform(west, east), rng.uniform(south, north))
        obstacle = _draw_obstacle(rng, place, across_m, f"{len(taken) + 1}", kinds)
        shape = obstacle.shape
        if boundary.contains(shape) and all(shape.distance(other) >= APART_M for other in taken):
            taken.append(shape)
            yield obstacle


def _draw_obstacle(
    rng: random.Random, place: tuple[float, float], across_m: float, name: str, kinds: Mapping[str, int]
) -> Obstacle:
    """One obstacle of a kind drawn by the weights; ponds and hedges are longer on larger parcels."""
    kind = rng.choices(tuple(kinds), tuple(kinds.values()))[0]
    turn_deg, long_share, wide_share = rng.uniform(0.0, 180.0), rng.uniform(0.4, 1.0), rng.uniform(0.5, 1.0)
    if kind == "pole":
        return Obstacle(kind, shapely.Point(place), 0.25, name)
    if kind == "tree":
        return Obstacle(kind, shapely.Point(place), 1.0 + 1.5 * wide_share, name)
    if kind == "trees":
        reach_m = long_share * GROUP_M
        stems = [[at + rng.uniform(-reach_m, reach_m) for at in place] for _ in range(GROUP_TREES)]
        crowns = shapely.multipoints(stems).buffer(1.0 + 1.5 * wide_share, quad_segs=4)
        return Obstacle(kind, shapely.convex_hull(crowns), name=name)
    long_m = long_share * POND_SHARE * across_m
    if kind == "pond":
        ellipse = affinity.scale(shapely.Point(place).buffer(1.0, quad_segs=6), long_m, wide_share * long_m)
        return Obstacle(kind, affinity.rotate(ellipse, turn_deg), name=name)
    line = shapely.LineString([(place[0] - long_m, place[1]), (place[0] + long_m, place[1])])
    return Obstacle(kind, affinity.rotate(line, turn_deg), 1.0, name)


def find_entrance(rng: random.Random, ring: shapely.LineString, obstacles: tuple[Obstacle, ...]) -> tuple[float, float]:
    """A place on the outline away from its corners and from obstacles: the best of 40 drawn."""
    corners = shapely.multipoints(shapely.get_coordinates(ring.simplify(1.0)))
    blocked = shapely.union_all([one.shape for one in obstacles])

    def measure_room_m(place: shapely.Point) -> float:
        return min(float(corners.distance(place)), float(blocked.distance(place)) if obstacles else math.inf, 15.0)

    places = [ring.interpolate(rng.random(), normalized=True) for _ in range(40)]
    best = max(places, key=measure_room_m)
    return float(best.x), float(best.y)
