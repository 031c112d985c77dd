"""A plan as text that is driven again as it is, by `headland show`, by robots, by others, and that is exported."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import shapely

from planner.refill import on_earth
from planner.showing import machines_of
from planner.site import Site
from vehicle.missions import Plan
from vehicle.plan_file import plan_to_json

DECIMALS = 4


def saved_plan(site: Site, plan: Plan) -> str:
    """Legs and gates of a plan on a site as JSON, with the scenario and the machines they are for."""
    field = site.layout.field
    asked = asdict(site.scenario) | machines_of(site)
    text = plan_to_json(
        on_earth(plan, field), crs=field.crs, origin_m=field.origin_m, scenario=asked, ground=_ground(site)
    )
    return text + "\n"


def _ground(site: Site) -> dict[str, Any]:
    """Outlines of the field in metres to a tenth of a millimetre: what `headland export` writes beside the lines.

    Polygons are lists of rings, the outer one first, without the first point again at the end. ``inside_headland_m`` is
    what the rounds of the headland leave for tracks; empty where the headland is only room for turning.
    """
    layout, field = site.layout, site.layout.field
    inside = shapely.get_parts(layout.inner) if layout.rounds else ()
    return {
        "name": field.name,
        "boundary_m": _rings(field.outline or field.boundary),
        "inside_headland_m": [_rings(part) for part in inside if part.area > 0.0],
        "obstacles": [
            {"name": one.name or one.kind, "outline_m": _rings(part)}
            for one in field.obstacles
            for part in shapely.get_parts(one.shape)
        ],
        "entrance_m": None if field.entrance is None else [round(value, DECIMALS) for value in field.entrance],
    }


def _rings(polygon: shapely.Polygon) -> list[list[list[float]]]:
    loops = (polygon.exterior, *polygon.interiors)
    return [shapely.get_coordinates(loop)[:-1].round(DECIMALS).tolist() for loop in loops]
