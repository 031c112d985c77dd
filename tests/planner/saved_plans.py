"""Saved plans made by hand, with known lines, anywhere on the earth."""

import math
from dataclasses import replace

import numpy as np

from fields.geometry.geodesy import find_utm_crs, project
from vehicle.missions.plan import Leg, LegGate, LegTask, Mission, Plan, PlanNotes
from vehicle.missions.plan_file import SavedPlan

SQUARE = [[0.0, 0.0], [100.0, 0.0], [100.0, 60.0], [0.0, 60.0]]
HOLE = [[40.0, 20.0], [40.0, 30.0], [55.0, 30.0], [55.0, 20.0]]
POND = [[70.0, 20.0], [80.0, 20.0], [80.0, 28.0]]
GROUND = {
    "name": "Søndre Mark",
    "boundary_m": [SQUARE, HOLE],
    "inside_headland_m": [[[[6, 6], [94, 6], [94, 54], [6, 54]], [[34, 14], [34, 36], [61, 36], [61, 14]]]],
    "obstacles": [{"name": "pond", "outline_m": [POND]}],
    "entrance_m": [0.0, 30.0],
}
BEND = [[3.0 + 94.0 * k / 20, 3.0 + 4.0 * math.sin(math.pi * k / 20)] for k in range(21)]


def leg(kind: str, number: int | None, piece: int, *points: list[float], **more: object) -> Leg:
    works = kind in ("track", "round")
    return replace(
        Leg(
            np.array(points, dtype=float),
            1.4,
            implement=works,
            task=LegTask(kind, number, piece, works and number == 1),
        ),
        **more,  # type: ignore[arg-type]
    )


def plan() -> Plan:
    """Two tractors: one on a bent side of round 1, then track 1 in two legs; one on tracks 2a and 2b."""
    first = (
        leg("round", 1, 0, *BEND),
        leg("turn", 0, 0, BEND[-1], [97.0, 9.0]),
        leg("track", 0, 0, [97.0, 9.0], [50.0, 9.0], gates=(LegGate(1, 0, 1.0),)),
        leg("track", 0, 0, [50.0, 9.0], [7.0, 9.004]),
    )
    second = (
        leg("enter", None, 0, [0.0, 30.0], [7.0, 25.0]),
        leg("track", 1, 0, [7.0, 25.0], [33.0, 25.0]),
        leg("way", 1, 1, [33.0, 25.0], [33.0, 12.0], [62.0, 12.0], [62.0, 25.0]),
        leg("track", 1, 1, [62.0, 25.0], [93.0, 25.0]),
    )
    return Plan((Mission(first), Mission(second)), PlanNotes("split-field"))


def saved(longitude_deg: float = 9.94, latitude_deg: float = 56.97) -> SavedPlan:
    """The plan with its field, whose corner in the south-west is at this place."""
    crs = find_utm_crs(longitude_deg, latitude_deg)
    east, north = project(np.array([[longitude_deg, latitude_deg]]), "EPSG:4326", crs)[0]
    origin = (float(round(east)), float(round(north)))
    return SavedPlan(plan(), crs, origin, {"field": "field.geojson"}, GROUND)


def in_metres(one: SavedPlan, degrees: np.ndarray) -> np.ndarray:
    """Longitude and latitude in the metres of a plan."""
    assert one.crs is not None
    return project(np.asarray(degrees, dtype=float), "EPSG:4326", one.crs) - np.asarray(one.origin_m)
