"""Jobs drawn by a seed, on parcels and on made shapes: field, obstacles, working width, speed, radius, tractors."""

import json
import math
import random
from collections.abc import Mapping, Sequence

import numpy as np
import shapely
from shapely import affinity

from fields.geometry.field import Field
from fields.geometry.obstacles import Obstacle
from tests.benchmarks.machine_fields import draw_obstacles, measure_fit
from tests.benchmarks.planned_jobs import Job

WIDTHS_M = (3.0, 4.0, 4.5, 6.0, 9.0, 12.0, 18.0, 24.0, 36.0)
LEAST_WIDTHS = 3.0  # a field takes this many working widths across
SPEEDS_KMH, RADII_M = (5, 15), (4.0, 9.0)
MAX_TRACTORS, MAX_OBSTACLES = 3, 20
MADE_HA, PARCEL_HA = (1.0, 15.0), (0.5, 40.0)
JOB_KINDS: Mapping[str, int] = {"pole": 50, "trees": 30, "pond": 20}
"""Percent of the obstacles of a job that are of each kind."""
SHAPES = ("rectangle", "l", "trapezoid", "wedge", "curved")


def draw_job(seed: int, parcels: Sequence[Field], exact: bool = False) -> Job:
    """The job of a seed: even ones on a parcel, odd ones on a made shape; two of every four have obstacles.

    `parcels` are those of a folder in any order. `exact` asks for exactly one tractor instead of up to so many, of the
    same job.
    """
    rng = random.Random(f"job {seed}")
    place, boundary = _draw_parcel(rng, parcels) if seed % 2 == 0 else draw_shape(rng)
    across_m = measure_fit(Field(place, boundary), WIDTHS_M[0], 0.0).across_m
    width_m = rng.choice([width_m for width_m in WIDTHS_M if LEAST_WIDTHS * width_m <= across_m])
    speed_kmh, radius_m = rng.randint(*SPEEDS_KMH), round(2.0 * rng.uniform(*RADII_M)) / 2.0
    tractors, obstacles = rng.randint(1, MAX_TRACTORS), rng.randint(1, MAX_OBSTACLES)
    return build_job(
        f"{seed}-{place}",
        boundary,
        tuple(draw_obstacles(rng, boundary, obstacles if seed // 2 % 2 else 0, JOB_KINDS)),
        width_m=width_m,
        speed_kmh=float(speed_kmh),
        radius_m=radius_m,
        tractors=(1,) if exact else tuple(range(1, tractors + 1)),
    )


def build_job(
    name: str,
    boundary: shapely.Polygon,
    obstacles: Sequence[Obstacle],
    *,
    width_m: float,
    speed_kmh: float,
    radius_m: float,
    tractors: Sequence[int],
) -> Job:
    """The plain values of a job, which say its field to the last digit."""
    return {
        "name": name,
        "outline": _list_ring(boundary.exterior),
        "holes": [_list_ring(ring) for ring in boundary.interiors],
        "obstacles": [
            {
                "kind": one.kind,
                "name": one.name,
                "half_width_m": one.half_width_m,
                "geometry": json.loads(shapely.to_geojson(one.geometry)),
            }
            for one in obstacles
        ],
        "width_m": width_m,
        "speed_kmh": speed_kmh,
        "radius_m": radius_m,
        "tractors": list(tractors),
    }


def _list_ring(ring: shapely.LinearRing) -> list[list[float]]:
    return [[float(x), float(y)] for x, y in ring.coords]


def choose_parcels(parcels: Sequence[Field]) -> list[Field]:
    """The parcels of PARCEL_HA that take the narrowest implement, by their names."""
    low_ha, high_ha = PARCEL_HA
    chosen = [parcel for parcel in parcels if low_ha <= parcel.area_ha <= high_ha]
    wide = [one for one in chosen if measure_fit(one, WIDTHS_M[0], 0.0).across_m >= LEAST_WIDTHS * WIDTHS_M[0]]
    return sorted(wide, key=lambda parcel: parcel.name)


def _draw_parcel(rng: random.Random, parcels: Sequence[Field]) -> tuple[str, shapely.Polygon]:
    parcel = rng.choice(sorted(parcels, key=lambda one: one.name))
    return parcel.name, parcel.boundary


def draw_shape(rng: random.Random) -> tuple[str, shapely.Polygon]:
    """A made shape of MADE_HA, turned anyhow, and its name; small ones are as frequent as large ones."""
    name, ratio = rng.choice(SHAPES), rng.uniform(1.0, 3.5)
    area_m2, turn_deg = 1e4 * math.exp(rng.uniform(*map(math.log, MADE_HA))), rng.uniform(0.0, 360.0)
    plain = shapely.Polygon(_draw_ring(rng, name, ratio))
    scale = math.sqrt(area_m2 / plain.area)
    grown = affinity.scale(plain, scale, scale, origin=(0, 0))
    return name, affinity.rotate(grown, turn_deg, origin=(0, 0))


def _draw_ring(rng: random.Random, name: str, ratio: float) -> list[tuple[float, float]]:
    """The ring of a shape one high and `ratio` long, before it gets its size."""
    if name == "l":
        x, y = ratio * rng.uniform(0.35, 0.65), rng.uniform(0.35, 0.65)
        return [(0, 0), (ratio, 0), (ratio, y), (x, y), (x, 1), (0, 1)]
    if name == "trapezoid":
        left, right = ratio * rng.uniform(0.0, 0.3), ratio * rng.uniform(0.7, 1.1)
        return [(0, 0), (ratio, 0), (right, 1), (left, 1)]
    if name == "wedge":
        return [(0, 0), (ratio, 0), (ratio, rng.uniform(0.05, 0.35)), (0, 1)]
    if name == "curved":
        xs, bends = np.linspace(0.0, 1.0, 25), (rng.uniform(0.1, 0.3), rng.uniform(-0.2, 0.3))
        below, above = [bend * np.sin(math.pi * xs) for bend in bends]
        south = [(ratio * float(x), -float(y)) for x, y in zip(xs, below, strict=True)]
        return south + [(ratio * float(x), 1.0 + float(y)) for x, y in zip(xs, above, strict=True)][::-1]
    return [(0, 0), (ratio, 0), (ratio, 1), (0, 1)]
