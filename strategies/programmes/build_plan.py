"""A programme as a plan."""

from __future__ import annotations

from typing import Any

from strategies.programmes.programme import Programme
from strategies.programmes.tour_legs import build_mission
from vehicle.missions.plan import Plan


def build_plan(programme: Programme, **notes: Any) -> Plan:
    """The plan of a programme, one mission per tractor that has lines."""
    missions = tuple(build_mission(programme.table, tour) for tour in programme.tours if tour)
    return Plan(missions, {"tractors": len(missions), **notes})
