"""A plan as a table of geometries: what every tractor works and drives, what is missed, and the field itself."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import groupby
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely

from fields.geometry.geodesy import DEGREES_CRS
from planner.errors import RequestError
from planner.evaluation.context import PlanningContext
from planner.evaluation.ground.coverage import measure_coverage
from strategies.lines.line_wishes import name_line
from vehicle.missions.plan import ENTER, HEADLAND_PASS, LEAVE, REFILL, SWATH, Plan
from vehicle.missions.run import SimulationRun

if TYPE_CHECKING:
    from geopandas import GeoDataFrame

COLUMNS = ("kind", "name", "tractor", "order", "length_m", "area_m2", "geometry")
KIND_OF_TASK = {
    SWATH: "swath", HEADLAND_PASS: "headland pass", ENTER: "way in", LEAVE: "way out", REFILL: "way to refill"
}  # fmt: skip
TURN_KIND = "turn"
"""What legs are called that only lead to the next swath or headland pass."""
MISSED_KIND, BOUNDARY_KIND, OBSTACLE_KIND = "missed ground", "boundary", "obstacle"
FENCE_KIND, ENTRANCE_KIND = "fence", "entrance"

Row = dict[str, Any]


def build_plan_layers(context: PlanningContext, run: SimulationRun | None) -> GeoDataFrame:
    """The plan of a run and its field, one geometry per row.

    Columns: `kind`, `name`, `tractor` and `order` (from 1, of what a tractor does), `length_m`, `area_m2`. Rows of kind
    "swath", "headland pass", "turn" and the ways in, out and to refill are lines; "missed ground", "boundary" and
    "obstacle" are areas. Lengths and areas are measured in metres; coordinates are WGS84 degrees, or metres without a
    system for a field in local metres. Without a run the field alone. Raises RequestError without geopandas.
    """
    try:
        import geopandas
    except ImportError:
        raise RequestError(
            "to_geodataframe() needs geopandas, which is not installed; install it with pip install 'headland[geo]'."
        ) from None
    rows = [] if run is None else list(_iter_driven_rows(run.plan))
    missed = () if run is None else measure_coverage(run, context).unworked_pieces
    rows += [{"kind": MISSED_KIND, "area_m2": float(piece.area), "geometry": piece} for piece in missed]
    rows += _iter_field_rows(context)
    frame = geopandas.GeoDataFrame(
        [dict.fromkeys(COLUMNS) | row for row in rows], columns=list(COLUMNS), geometry="geometry"
    )
    frame = frame.astype({"tractor": "Int64", "order": "Int64", "length_m": "float64", "area_m2": "float64"})
    field = context.layout.field
    if field.crs is None:
        return frame
    frame.geometry = frame.geometry.translate(*field.origin_m)
    return frame.set_crs(field.crs).to_crs(DEGREES_CRS)


def _iter_driven_rows(plan: Plan) -> Iterator[Row]:
    """What every tractor drives: legs of one task one after another are one line."""
    for number, mission in enumerate(plan.missions, start=1):
        for order, (task, group) in enumerate(groupby(mission.legs, key=lambda leg: leg.task), start=1):
            legs = list(group)
            yield {
                "kind": KIND_OF_TASK.get(task.kind, TURN_KIND),
                "name": name_line(task) if task.is_work else None,
                "tractor": number,
                "order": order,
                "length_m": math.fsum(leg.length_m for leg in legs),
                "geometry": shapely.LineString(np.concatenate([legs[0].points, *(leg.points[1:] for leg in legs[1:])])),
            }


def _iter_field_rows(context: PlanningContext) -> Iterator[Row]:
    """Boundary, obstacles, fences and entrance of the field."""
    field = context.layout.field
    outline = field.whole_boundary
    yield {
        "kind": BOUNDARY_KIND, "name": field.name, "length_m": float(outline.exterior.length),
        "area_m2": float(outline.area), "geometry": outline,
    }  # fmt: skip
    for name, shape in zip(field.obstacle_names, field.solid_obstacles, strict=True):
        yield {"kind": OBSTACLE_KIND, "name": name, "area_m2": float(shape.area), "geometry": shape}
    for fence in field.fences:
        yield {"kind": FENCE_KIND, "length_m": float(fence.length), "geometry": fence}
    if field.entrance is not None:
        yield {"kind": ENTRANCE_KIND, "geometry": shapely.Point(field.entrance)}
