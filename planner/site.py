"""What all candidates of a scenario share: field, tracks, tractor, how the fleet drives and where it may."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import shapely

from fields.field import Field
from fields.free import beside_tracks, free_space
from fields.layout import Layout, lay_tracks
from fields.read import read_field
from planner.errors import ScenarioError, named
from planner.scenario import KMH, Scenario
from strategies.connect import Connector, TurnCosts
from strategies.job import Job, Manner, starting_corner
from strategies.sizing import Reach, allowed_kinds, headland_for, turning_room
from strategies.timing import TurnClock
from vehicle.gnss import NO_ERROR, Table, default_table, load_table
from vehicle.ground import ground_names
from vehicle.tractor import Implement, Tractor, as_tractor

# Planned turns are this much wider than full lock, so that guidance has something to correct with.
RADIUS_MARGIN = 1.08
FARTHEST_ENTRANCE_M = 500.0
SHUNTING_MPS = 5.0 * KMH  # nobody reverses faster, nor turns faster with direction changes in the turn


@dataclass(frozen=True)
class Site:
    """Field, tracks, tractor, implement, and how the fleet drives; made once per scenario.

    The guided point may be anywhere in `free`, and tramples no track in `beside`. `turn_fits[k]` tells whether a turn
    over k lines fits a headland met squarely (index 0 unused); where none does, `manner.turn_s[k]` is an estimate and
    not simulated. `fixes` are the errors of positions.
    """

    scenario: Scenario
    layout: Layout
    tractor: Tractor
    implement: Implement
    manner: Manner
    costs: TurnCosts
    free: shapely.Geometry
    beside: shapely.Geometry
    kinds: tuple[str, ...]
    turn_fits: tuple[bool, ...]
    fixes: Table

    def job(self, tractors: int) -> Job:
        """A job for this many tractors, with an empty memory of ways."""
        anywhere, beside = (
            None if region.is_empty else Connector(region, self.manner.radius_m, self.costs, self.kinds)
            for region in (self.free, self.beside)
        )
        if anywhere is None:
            raise ScenarioError(
                f"Field {self.layout.field.name!r} is nowhere wide enough to turn on: half the implement on either "
                "side leaves nothing; use a narrower implement."
            )
        return Job(self.layout, self.manner, anywhere, tractors, beside, starting_corner(self.layout))


def prepare(
    scenario: Scenario, field: Field | str | Path | None = None, tractor: Tractor | str | Path | None = None
) -> Site:
    """Read the field and the tractor, time the turns, size the headland, lay the tracks.

    `field` and `tractor`, as objects, names or files, take the place of those that the scenario names. Raises
    FieldError, VehicleError, StrategyError or ScenarioError.
    """
    if not isinstance(field, Field):
        field = read_field(scenario.field if field is None else str(field), local=scenario.local)
    _check_field(field)
    field = field.clear_of_obstacles(scenario.margin_m)
    fixes = gnss_errors(scenario)
    tractor = as_tractor(scenario.tractor if tractor is None else tractor)
    implement = Implement(width_m=scenario.width_m)
    radius = _planned_radius(scenario, tractor, field.default_ground)
    reach = Reach(tractor.antenna_forward_m + implement.hitch_m, 0.5 * max(implement.width_m, tractor.width_m))
    kinds = allowed_kinds(scenario.turn)
    headland = scenario.headland_m or headland_for(scenario.turn, scenario.width_m, radius, reach)
    layout = lay_tracks(field, scenario.width_m, headland, scenario.bearing_deg)
    bare = Manner(
        work_speed_mps=scenario.speed_mps,
        turn_speed_mps=scenario.turning_mps,
        reverse_speed_mps=min(scenario.turning_mps, SHUNTING_MPS),
        radius_m=radius,
        tool_m=reach.tool_m,
    )
    clock = TurnClock(tractor, implement, bare, field.default_ground)
    timed = clock.best_times(scenario.width_m, turning_room(headland, reach), kinds)
    manner = replace(bare, turn_s=tuple(clock.long_way_s() if s is None else s for s in timed))
    free = free_space(field, reach.margin_m)
    beside = beside_tracks(layout, free)
    fits = tuple(seconds is not None for seconds in timed)
    return Site(scenario, layout, tractor, implement, manner, clock.costs(), free, beside, kinds, fits, fixes)


def gnss_errors(scenario: Scenario) -> Table:
    """The table of position errors a scenario asks for; raises VehicleError for a file that holds none."""
    if not scenario.gnss:
        return NO_ERROR
    return default_table() if scenario.gnss_table is None else load_table(scenario.gnss_table)


def _check_field(field: Field) -> None:
    """Refuse what a field file may hold but no plan can use."""
    for zone in field.grounds:
        if zone.name not in ground_names():
            raise ScenarioError(
                f"The field has a ground zone of {zone.name!r}, which is unknown; use one of: "
                f"{', '.join(ground_names())}."
            )
    if field.entrance is not None:
        away = float(field.boundary.distance(shapely.Point(field.entrance)))
        if away > FARTHEST_ENTRANCE_M:
            raise ScenarioError(
                f"The entrance lies {away:.0f} m from the field; it must be within {FARTHEST_ENTRANCE_M:g} m of it."
            )


def _planned_radius(scenario: Scenario, tractor: Tractor, ground: str) -> float:
    smallest = tractor.smallest_radius_m(ground)
    if scenario.radius_m is None:
        return RADIUS_MARGIN * smallest
    if scenario.radius_m < smallest:
        raise ScenarioError(
            f"A turning radius ({named('radius_m')}) of {scenario.radius_m:g} m is tighter than {tractor.name} can "
            f"drive on {ground} ({smallest:.2f} m); use {smallest:.2f} m or more."
        )
    return scenario.radius_m
