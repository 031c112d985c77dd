"""What all candidates of a scenario share: field, tracks, tractor, how the fleet drives and where it may."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from dataclasses import field as member
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from fields.entrances import check_entrance, with_entrance_at, with_entrance_on_outline
from fields.field import LEAST_FENCE_MARGIN_M, Field
from fields.free import beside_tracks, free_space, rim_of
from fields.guidance import bearing_along
from fields.handedness import handedness
from fields.layout import Layout
from fields.options import with_bearings
from fields.read import read_field
from fields.rounds import Round, lay_rounds
from planner.chance.settings import Chances
from planner.errors import ScenarioError, about, named
from planner.farm.times import Times, Yard
from planner.laying import layouts, quickest
from planner.outlook import Stakes, stakes_of
from planner.price.cost import Terms
from planner.refill import check_load, supplied
from planner.scenario import KMH, LEAST_CLEARANCE_M, SOW, STANDING, TURNING_MPS, Scenario
from planner.workday import FOLD, ROAD, UNFOLD, Workday, workday
from planner.yielding.courses import Known
from strategies.headland.shifts import backwards
from strategies.job import Job, Manner, starting_corner
from strategies.supply import Supply
from strategies.timing import TurnClock
from strategies.ways.around import Around, lay_around
from strategies.ways.bends import Bender, BendRules
from strategies.ways.connect import Connector, TurnCosts
from strategies.ways.fence import Body, Fence
from strategies.ways.finders import Finders
from strategies.ways.gateway import Gateway, gateway
from strategies.ways.sizing import Reach, allowed_kinds, headland_for, turning_room
from vehicle.compile import outline
from vehicle.gnss import NO_ERROR, Table, default_table, load_table
from vehicle.ground import ground_names
from vehicle.tractor import Implement, Tractor, as_tractor

# Planned turns are this much wider than full lock, so that guidance has something to correct with.
RADIUS_MARGIN = 1.08
BEND = 0.25 * math.pi  # radii of arc that turn by 45 degrees: what bends more on so short a way is a corner
SMALL = 4.0  # working widths across: smaller obstacles are driven round in the pass
SPARE, MOST_SPARE_M = 0.8, 0.3  # of the margin to a fence, at most so much, planned ways leave to guidance
SWING_SPARE_M = 0.1  # what swings out of a bend, and what guidance adds to it
BEND_RADIUS = 2.0  # planned radii, or halves of the machine: the wheels must be turned over while the implement works
_WORKED_OUT = ("_first", "driven", "gate", "roomier", "turns_tried")
ROOM_KEPT = 1.0 / 3.0  # of the room that neighbouring tracks leave between machines: the rest is for errors of guidance
WIDER = (1.0, 1.15, 1.3, 1.6)  # times the planned radius, for turns that were not followed well
GATE_M, GATE_SPARE_M = 5.0, 1.0  # to either side of the entrance a fence has its gate: that far, or as the machine asks
AHEAD_M = 3.0  # two of a row that turned side by side would come nearer to each other than a usual clearance
RIM_M = 0.3  # in the corners of a round the guided point keeps so far inside the outline
SHUNTING_MPS = 5.0 * KMH  # nobody reverses faster, nor turns faster with direction changes in the turn


@dataclass(frozen=True)
class Site:
    """Field, tracks, tractor, implement, and how the fleet drives; made once per scenario.

    The guided point may be anywhere in `free`, and tramples no track in `beside`. `turn_fits[k]` tells whether a turn
    over k lines fits a headland met squarely (index 0 unused); where none does, `manner.turn_s[k]` is an estimate and
    not simulated. `position_errors` is the GNSS table that errors of positions are drawn from. `rounds` are those of
    the headland that are worked; in their corners the guided point may be anywhere in `rim`. `around` has what is bent
    round small obstacles, `stakes` are draws and money, `supply` is what every tractor carries, `terms` the prices of a
    farm and `day` the clock of its day, None without one. `finders` of ways are shared by the layouts compared.
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
    around: Around = member(default_factory=Around)
    stakes: Stakes | None = None
    supply: Supply | None = None
    terms: Terms | None = None
    day: Workday | None = None
    finders: Finders = member(default_factory=Finders)

    def job(self, tractors: int) -> Job:
        """A job for this many tractors; all jobs of a site share what is once worked out of ways and turns."""
        return replace(self._first, tractors=tractors, used={})

    @cached_property
    def gate(self) -> Gateway | None:
        """The way through the entrance; None where there is none, or the headland is not worked: time is that of
        the tracks then."""
        field = self.layout.field
        if field.entrance is None or self.scenario.tracks_only or self.free.is_empty:
            return None
        return gateway(field.outline or field.boundary, self.free, field.entrance)

    @property
    def gate_m(self) -> float:
        """How far to either side of the entrance there is no fence: implements come in unfolded."""
        if self.gate is None:
            return GATE_M
        machine_m = max(self.implement.contact_width_m, self.tractor.width_m)
        return max(GATE_M, 0.5 * machine_m + GATE_SPARE_M)

    @cached_property
    def driven(self) -> Known:
        """What is worked out of tractors driven alone, for all plans of the site."""
        return Known()

    @cached_property
    def _first(self) -> Job:
        """The job that others are copies of."""
        anywhere, beside, rim = (
            None if region.is_empty else self.finders.of(region, self.manner.radius_m, self.costs, self.kinds)
            for region in (self.free, self.beside, self.rim)
        )
        if anywhere is None:
            raise ScenarioError(
                f"Field {self.layout.field.name!r} is nowhere wide enough to turn on: half the implement on either "
                "side leaves nothing; use a narrower implement."
            )
        fence, careful = self._fence()
        corner = starting_corner(self.layout) if self.gate is None else None
        return Job(
            self.layout, self.manner, anywhere, 1, beside, corner, rounds=self.rounds,
            rim=rim, square=self.scenario.corners == "square", spare_tracks=self.scenario.operation == SOW,
            standing=self.scenario.operation in STANDING,
            around=self.around, fence=fence, careful=careful, gate=self.gate, supply=self.supply,
        )  # fmt: skip

    @cached_property
    def roomier(self) -> tuple[Connector, ...]:
        """Finders of turns that are easier to follow, those that keep to the headland first, of these the tightest."""
        radius = self.manner.radius_m
        regions = [region for region in (self.beside, self.rim, self.free) if not region.is_empty]
        return tuple(
            self.finders.of(region, wider * radius, self.costs, self.kinds) for region in regions for wider in WIDER
        )

    def __getstate__(self) -> dict[str, Any]:
        """What is sent to another process: without what was worked out here."""
        return {name: value for name, value in self.__dict__.items() if name not in _WORKED_OUT}

    @cached_property
    def turns_tried(self) -> dict[bytes, float | None]:
        """How far off (m) a tractor comes out of turns tried alone, by what they are; None for not at all."""
        return {}

    def _fence(self) -> tuple[Fence | None, tuple[Connector, ...]]:
        """What ways keep off, and a finder of ways driven forwards, whose nose comes to no fence where others' does."""
        field, radius = self.layout.field, self.manner.radius_m
        if not field.fences and not field.solid:
            return None, ()
        body = body_of(self.tractor, self.implement)
        spare_m = min(SPARE * max(self.scenario.margin_m, LEAST_FENCE_MARGIN_M), MOST_SPARE_M)
        fences = shapely.union_all(field.fences)
        if self.gate is not None:
            fences = shapely.difference(fences, shapely.Point(self.gate.at[:2]).buffer(self.gate_m))
        obstacles = shapely.union_all([shape.boundary for shape in field.solid])
        fence = Fence(fences, obstacles, body, spare_m)
        forwards = tuple(kind for kind in self.kinds if kind != "switch-back")
        return fence, (self.finders.of(self.free, radius, self.costs, forwards),) if forwards else ()


def _along(scenario: Scenario, field: Field) -> Scenario:
    """The scenario with the bearing of the line it names."""
    if scenario.along is None:
        return scenario
    bearing_deg = bearing_along(field.lines, scenario.along, f"'{field.name}'")
    return replace(scenario, along=None, bearing_deg=bearing_deg)


def prepare(
    scenario: Scenario, field: Field | str | Path | None = None, tractor: Tractor | str | Path | None = None,
    implement: Implement | None = None, chances: Chances | None = None, terms: Terms | None = None,
    supply: Supply | None = None,
    times: Times | None = None, yard: Yard | None = None,
) -> Site:  # fmt: skip
    """Read the field and the tractor, time the turns, size the headland, lay the tracks.

    `field` and `tractor`, as objects, names or files, take the place of those that the scenario names; the `implement`
    is as wide as the scenario says. `chances`, `terms` (prices), `times` and `yard` are those of a farm, and so is the
    `supply`, which the scenario or the field says a place for. Raises FieldError, VehicleError, StrategyError or
    ScenarioError.
    """
    scenario = _with_names(scenario, field, tractor)
    with about("field"):
        if not isinstance(field, Field):
            name = scenario.field if field is None else str(field)
            field = read_field(name, local=scenario.local, crs=scenario.crs, swap=scenario.swap)
        if scenario.entrance is not None:
            field = with_entrance_at(field, scenario.entrance)
        _check_field(field)
        scenario = _along(scenario, field)
    with about("gnss_table"):
        position_errors = gnss_errors(scenario)
    with about("tractor"):
        tractor = as_tractor(scenario.tractor if tractor is None else tractor)
    with about("refill"):
        supply = supplied(scenario, field, supply)
    with about("farm"):
        day = None if times is None else workday(field, scenario.start_s, times, yard or Yard())
    if terms is not None and day is not None:
        terms = replace(
            terms, road_km=2e-3 * day.road_m, road_s=day.of(ROAD), handling_s=day.of(UNFOLD) + day.of(FOLD)
        )
    with about("rain"):
        stakes = stakes_of(scenario, chances, terms, day)
    implement = (implement or Implement()).model_copy(update={"width_m": scenario.width_m})
    radius = _planned_radius(scenario, tractor, field)
    reach = Reach(tractor.antenna_forward_m + implement.hitch_m, 0.5 * max(implement.width_m, tractor.width_m))
    kinds = allowed_kinds(scenario.turn)
    headland = scenario.headland_m or headland_for(scenario.turn, scenario.width_m, radius, reach)
    with about("entrance"):
        check_entrance(field, headland)
    if not scenario.tracks_only:
        field = with_entrance_on_outline(field)
    with about("field"):
        swing = max(0.0, body_of(tractor, implement).swing_m(radius) + SWING_SPARE_M - reach.margin_m)
        field = field.clear_of_obstacles(scenario.margin_m, SMALL * scenario.width_m, swing)
    bare = Manner(
        work_speed_mps=scenario.speed_mps,
        turn_speed_mps=scenario.turning_mps,
        reverse_speed_mps=min(scenario.turning_mps, SHUNTING_MPS),
        radius_m=radius,
        tool_m=reach.tool_m,
        boxes=_boxes(tractor, implement),
        ahead_m=AHEAD_M if scenario.clearance_m > LEAST_CLEARANCE_M else 0.0,
    )
    clock = TurnClock(tractor, implement, bare, field.default_ground)
    costs, free, finders = clock.costs(), free_space(field, reach.margin_m), Finders()

    def on(laid: Layout) -> Site:
        layout, around = _around(scenario, laid, tractor, implement, radius, reach)
        timed = clock.best_times(scenario.width_m, turning_room(layout.headland_m, reach), kinds)
        fits = tuple(seconds is not None for seconds in timed)
        manner = replace(bare, turn_s=tuple(clock.long_way_s() if s is None else s for s in timed))
        rounds = _rounds(field, scenario.width_m, layout.rounds, BEND * radius)
        rim = rim_of(field, reach.margin_m, RIM_M) if rounds else shapely.Polygon()
        return Site(
            scenario, layout, tractor, implement, manner, costs, free, beside_tracks(layout, free), kinds, fits,
            position_errors, rounds, rim, around, stakes, supply, terms, day, finders,
        )  # fmt: skip

    passing_m = max(implement.contact_width_m, tractor.width_m) + LEAST_CLEARANCE_M / ROOM_KEPT
    sites = [on(layout) for layout in layouts(scenario, field, headland, passing_m)]
    best = sites[quickest([site.job(1) for site in sites])]
    chosen = on(with_bearings(best.layout, dict(scenario.cell_bearings))) if scenario.cell_bearings else best
    check_load(supply, chosen.layout)
    return chosen


def _rounds(field: Field, width_m: float, count: int, bend_m: float) -> tuple[Round, ...]:
    """The rounds of the headland; the hand of the outline says which way: mirrored on a mirrored field."""
    rounds = lay_rounds(field, width_m, count, bend_m)
    outline = field.boundary
    rings = [np.asarray(ring.coords)[:-1, :2] for ring in (outline.exterior, *outline.interiors)]
    left = handedness(rings, [] if field.entrance is None else [field.entrance]) > 0
    return rounds if left else tuple(backwards(lap) for lap in rounds)


def body_of(tractor: Tractor, implement: Implement) -> Body:
    """The boxes of tractor and implement, ahead of the rear axle."""
    boxes, axle = outline(tractor, implement), tractor.rear_axle_m
    ends = (("tail", "nose", "half_width"), ("tool_tail", "tool_front", "tool_half_width"))
    sizes = tuple((boxes[low] + axle, boxes[high] + axle, boxes[half]) for low, high, half in ends)
    return Body(sizes, tractor.antenna_forward_m)


def _around(
    scenario: Scenario, layout: Layout, tractor: Tractor, implement: Implement, radius_m: float, reach: Reach
) -> tuple[Layout, Around]:
    """The tracks bent round small obstacles, or cut at them, and what else is bent by."""
    field = layout.field
    if not field.small:
        return layout, Around()
    boxes = outline(tractor, implement)
    guided_m = tractor.antenna_forward_m - tractor.rear_axle_m
    turned_over = max(1.0, scenario.speed_mps / TURNING_MPS)
    rules = BendRules(
        BEND_RADIUS * max(radius_m * turned_over, reach.margin_m),
        reach.margin_m,
        max(boxes["nose"], boxes["tool_front"]) - guided_m,
        guided_m - min(boxes["tail"], boxes["tool_tail"]),
    )
    return lay_around(layout, Bender(field.small, field.ground, rules), reach.tool_m)


def _boxes(tractor: Tractor, implement: Implement) -> tuple[tuple[float, float, float], ...]:
    """The outline of tractor and implement, counted from the guided point."""
    guided = tractor.antenna_forward_m - tractor.rear_axle_m
    ends = outline(tractor, implement)
    return (
        (ends["tail"] - guided, ends["nose"] - guided, ends["half_width"]),
        (ends["tool_tail"] - guided, ends["tool_front"] - guided, ends["tool_half_width"]),
    )


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
