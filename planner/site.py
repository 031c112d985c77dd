"""What all candidates of a scenario share: field, tracks, tractor, how the fleet drives and where it may."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

import shapely

from fields.errors import FieldError
from fields.field import Field
from fields.free import beside_tracks, free_space
from fields.layout import Layout, lay_tracks
from fields.read import read_field
from fields.rounds import Round, lay_rounds
from planner.chance.settings import Chances
from planner.errors import ScenarioError, about, named
from planner.outlook import Stakes, stakes_of
from planner.price.cost import Terms
from planner.scenario import KMH, SOW, Scenario
from strategies.connect import Connector, TurnCosts
from strategies.job import Job, Manner, starting_corner
from strategies.sizing import Reach, allowed_kinds, headland_for, turning_room
from strategies.timing import TurnClock
from vehicle.gnss import NO_ERROR, Table, default_table, load_table
from vehicle.ground import ground_names
from vehicle.tractor import Implement, Tractor, as_tractor

# Planned turns are this much wider than full lock, so that guidance has something to correct with.
RADIUS_MARGIN = 1.08
BEND = 0.25 * math.pi  # radii of arc that turn by 45 degrees: what bends more on so short a way is a corner
MOST_ROUNDS = 50
FARTHEST_ENTRANCE_M = 500.0
RIM_M = 0.3  # in the corners of a round the guided point keeps so far inside the outline
SHUNTING_MPS = 5.0 * KMH  # nobody reverses faster, nor turns faster with direction changes in the turn


@dataclass(frozen=True)
class Site:
    """Field, tracks, tractor, implement, and how the fleet drives; made once per scenario.

    The guided point may be anywhere in `free`, and tramples no track in `beside`. `turn_fits[k]` tells whether a turn
    over k lines fits a headland met squarely (index 0 unused); where none does, `manner.turn_s[k]` is an estimate and
    not simulated. `position_errors` is the GNSS table that errors of positions are drawn from. `rounds` are those of
    the headland that are worked; in their corners the guided point may be anywhere in `rim`. `stakes` are
    draws and money.
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
    position_errors: Table
    rounds: tuple[Round, ...] = ()
    rim: shapely.Geometry = shapely.Polygon()  # noqa: RUF009 - no geometry ever changes
    stakes: Stakes | None = None

    def job(self, tractors: int) -> Job:
        """A job for this many tractors, with an empty memory of ways."""
        anywhere, beside, rim = (
            None if region.is_empty else Connector(region, self.manner.radius_m, self.costs, self.kinds)
            for region in (self.free, self.beside, self.rim)
        )
        if anywhere is None:
            raise ScenarioError(
                f"Field {self.layout.field.name!r} is nowhere wide enough to turn on: half the implement on either "
                "side leaves nothing; use a narrower implement."
            )
        return Job(
            self.layout, self.manner, anywhere, tractors, beside, starting_corner(self.layout), rounds=self.rounds,
            rim=rim, square=self.scenario.corners == "square", spare_tracks=self.scenario.operation == SOW,
        )  # fmt: skip


def prepare(
    scenario: Scenario, field: Field | str | Path | None = None, tractor: Tractor | str | Path | None = None,
    implement: Implement | None = None, chances: Chances | None = None, terms: Terms | None = None,
) -> Site:  # fmt: skip
    """Read the field and the tractor, time the turns, size the headland, lay the tracks.

    `field` and `tractor`, as objects, names or files, take the place of those that the scenario names; the `implement`
    is as wide as the scenario says. `chances` and `terms` (prices) are those of a farm. Raises FieldError,
    VehicleError, StrategyError or ScenarioError.
    """
    scenario = _with_names(scenario, field, tractor)
    with about("field"):
        if not isinstance(field, Field):
            field = read_field(scenario.field if field is None else str(field), local=scenario.local)
        _check_field(field)
        field = field.clear_of_obstacles(scenario.margin_m)
    with about("gnss_table"):
        position_errors = gnss_errors(scenario)
    with about("tractor"):
        tractor = as_tractor(scenario.tractor if tractor is None else tractor)
    with about("rain"):
        stakes = stakes_of(scenario, chances, terms)
    implement = (implement or Implement()).model_copy(update={"width_m": scenario.width_m})
    radius = _planned_radius(scenario, tractor, field)
    reach = Reach(tractor.antenna_forward_m + implement.hitch_m, 0.5 * max(implement.width_m, tractor.width_m))
    kinds = allowed_kinds(scenario.turn)
    headland = scenario.headland_m or headland_for(scenario.turn, scenario.width_m, radius, reach)
    layout = _layout(scenario, field, headland)
    rounds = lay_rounds(field, scenario.width_m, layout.rounds, BEND * radius)
    bare = Manner(
        work_speed_mps=scenario.speed_mps,
        turn_speed_mps=scenario.turning_mps,
        reverse_speed_mps=min(scenario.turning_mps, SHUNTING_MPS),
        radius_m=radius,
        tool_m=reach.tool_m,
    )
    clock = TurnClock(tractor, implement, bare, field.default_ground)
    timed = clock.best_times(scenario.width_m, turning_room(layout.headland_m, reach), kinds)
    manner = replace(bare, turn_s=tuple(clock.long_way_s() if s is None else s for s in timed))
    free = free_space(field, reach.margin_m)
    beside = beside_tracks(layout, free)
    rim = _rim(field, free) if rounds else shapely.Polygon()
    fits = tuple(seconds is not None for seconds in timed)
    return Site(
        scenario, layout, tractor, implement, manner, clock.costs(), free, beside, kinds, fits, position_errors, rounds,
        rim, stakes,
    )


def _layout(scenario: Scenario, field: Field, headland_m: float) -> Layout:
    """The tracks and, unless there are to be none, as many rounds as the headland takes and the field has room for."""
    width, bearing = scenario.width_m, scenario.bearing_deg
    if scenario.tracks_only:
        return lay_tracks(field, width, headland_m, bearing)
    most = min(max(1, math.ceil(headland_m / width - 1e-6)), MOST_ROUNDS)
    for count in range(most, 1, -1):
        try:
            depth = headland_m if count == most else count * width
            return lay_tracks(field, width, depth, bearing, rounds=count)
        except FieldError:
            if scenario.headland_m is not None:
                raise
    return lay_tracks(field, width, width, bearing, rounds=1)


def _rim(field: Field, free: shapely.Geometry) -> shapely.Geometry:
    """The field a little drawn in, and as far from obstacles as anywhere else."""
    outline = shapely.Polygon(field.boundary.exterior).buffer(-RIM_M, join_style="mitre")
    solid = shapely.union_all([shapely.Polygon(part.exterior) for part in shapely.get_parts(free)])
    return shapely.difference(outline, shapely.difference(solid, free))


def _with_names(
    scenario: Scenario, field: Field | str | Path | None, tractor: Tractor | str | Path | None
) -> Scenario:
    """The scenario naming the field and tractor that take the place of its own."""
    def name(given: Field | Tractor | str | Path | None, asked: str) -> str:
        return asked if given is None else given.name if isinstance(given, Field | Tractor) else str(given)

    return replace(scenario, field=name(field, scenario.field), tractor=name(tractor, scenario.tractor))


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


def _planned_radius(scenario: Scenario, tractor: Tractor, field: Field) -> float:
    ground = field.default_ground
    smallest = tractor.smallest_radius_m(ground)
    if scenario.radius_m is None:
        return RADIUS_MARGIN * smallest
    if scenario.radius_m < smallest:
        raise ScenarioError(
            f"A turning radius ({named('radius_m')}) of {scenario.radius_m:g} m is tighter than {tractor.name} can "
            f"drive on {ground} ({smallest:.2f} m); use {smallest:.2f} m or more."
        )
    west, south, east, north = field.boundary.bounds
    across = math.hypot(east - west, north - south)
    if scenario.radius_m > across:
        raise ScenarioError(
            f"A turning radius ({named('radius_m')}) of {scenario.radius_m:g} m has no room on field {field.name!r}, "
            f"{across:.0f} m across; use a smaller one, {smallest:.2f} m or more."
        )
    return scenario.radius_m
