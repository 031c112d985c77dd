"""A programme as a plan."""

from __future__ import annotations

from typing import Any

from strategies.programmes.programme import Programme
from strategies.programmes.tour_legs import build_mission, build_stand
from vehicle.missions.plan import Plan


def build_plan(programme: Programme, **notes: Any) -> Plan:
    """The plan of a programme, one mission per tractor that has lines or stands on the field."""
    table, tours = programme.table, programme.tours
    missions = tuple(
        build_mission(table, tours[number]) if tours[number] else build_stand(table, table.starts[number])
        for number in programme.list_present()
    )
    return Plan(missions, {"tractors": len(missions), **notes})
