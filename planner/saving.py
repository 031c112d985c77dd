"""A plan as text that is driven again as it is: by `headland show`, by robots, by others."""

from __future__ import annotations

from dataclasses import asdict

from planner.refill import on_earth
from planner.showing import machines_of
from planner.site import Site
from vehicle.missions import Plan
from vehicle.plan_file import plan_to_json


def saved_plan(site: Site, plan: Plan) -> str:
    """Legs and gates of a plan on a site as JSON, with the scenario and the machines they are for."""
    field = site.layout.field
    asked = asdict(site.scenario) | machines_of(site)
    return plan_to_json(on_earth(plan, field), crs=field.crs, origin_m=field.origin_m, scenario=asked) + "\n"
