"""Everything about a place and a fleet that all candidates share: tracks, turns timed by simulation, free space."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import shapely

from fields.field import Field
from fields.layout import Layout, lay_tracks
from fields.read import read_field
from planner.errors import ScenarioError
from planner.scenario import KMH, Scenario
from strategies.connect import Connector, TurnCosts
from strategies.job import Job, Manner, starting_corner
from strategies.legs import STEP_M
from strategies.paths import Path, Pose
from strategies.turns import TURN_KINDS, fishtail, omega_turn, switch_back, turn_depth, u_turn
from vehicle.gnss import NO_ERROR, Table, default_table, load_table
from vehicle.ground import ground_names
from vehicle.missions import TRACK, TURN, Leg, Mission, Plan, Task
from vehicle.tractor import Implement, Tractor, load_tractor
from vehicle.world import simulate

# Planned turns are this much wider than full lock, so that guidance has something to correct with.
RADIUS_MARGIN = 1.08
HEADLAND_STEP_M = 0.5
FARTHEST_ENTRANCE_M = 500.0
SHUNTING_MPS = 5.0 * KMH  # nobody reverses faster, nor turns faster with direction changes in the turn
LEAD_M = 15.0
GRID_M = 1e-6
TURNS = {"u": (u_turn,), "omega": (omega_turn,), "switch-back": (switch_back, fishtail)}


@dataclass(frozen=True)
class Site:
    """Field, tracks, tractor, implement, and how the fleet drives; made once per scenario.

    `turn_fits[k]` tells whether a turn over k lines fits the headland (index 0 unused); where none does,
    `manner.turn_s[k]` is an estimate and not simulated.
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


def prepare(scenario: Scenario, field: Field | None = None) -> Site:
    """Read the field and the tractor, time the turns, size the headland, lay the tracks.

    Raises FieldError, VehicleError or ScenarioError.
    """
    field = field or read_field(scenario.field, local=scenario.local)
    _check_field(field)
    gnss_errors(scenario)
    tractor, implement = load_tractor(scenario.tractor), Implement(width_m=scenario.width_m)
    radius = _planned_radius(scenario, tractor, field.default_ground)
    tool = tractor.antenna_forward_m + implement.hitch_m
    margin = 0.5 * max(implement.width_m, tractor.width_m)
    kinds = TURN_KINDS if scenario.turn == "auto" else tuple(dict.fromkeys(("u", scenario.turn)))
    headland = scenario.headland_m or _headland(scenario, radius, tool, margin)
    layout = lay_tracks(field, scenario.width_m, headland, scenario.bearing_deg)
    bare = Manner(
        work_speed_mps=scenario.speed_mps,
        turn_speed_mps=scenario.turn_speed_mps,
        reverse_speed_mps=min(scenario.turn_speed_mps, SHUNTING_MPS),
        radius_m=radius,
        tool_m=tool,
    )
    clock = TurnClock(tractor, implement, bare, field.default_ground)
    depth = headland - tool - margin
    timed = clock.best_times(scenario.width_m, depth, kinds)
    manner = Manner(**{**bare.__dict__, "turn_s": tuple(clock.long_way_s() if s is None else s for s in timed)})
    free = field.boundary.buffer(-margin, join_style="mitre", mitre_limit=2.0)
    beside = _beside(layout, free)
    fits = tuple(seconds is not None for seconds in timed)
    return Site(scenario, layout, tractor, implement, manner, clock.costs(), free, beside, kinds, fits)


def gnss_errors(scenario: Scenario) -> Table:
    """The table of position errors a scenario asks for; raises VehicleError for a file that holds none."""
    if not scenario.gnss:
        return NO_ERROR
    return load_table(scenario.gnss_table) if scenario.gnss_table else default_table()


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
            f"A turning radius of {scenario.radius_m:g} m is tighter than {tractor.name} can drive on {ground} "
            f"({smallest:.2f} m); use {smallest:.2f} m or more."
        )
    return scenario.radius_m


def _headland(scenario: Scenario, radius: float, tool: float, margin: float) -> float:
    """Depth in which the turn fits: the implement out of the track, the turn, and half the implement beside it."""
    kind = scenario.turn if scenario.turn in ("omega", "switch-back") else "switch-back"
    depth = max(turn_depth(kind, min(scenario.width_m, 2.0 * radius), radius), radius)
    return math.ceil((tool + depth + margin) / HEADLAND_STEP_M) * HEADLAND_STEP_M


def _beside(layout: Layout, free: shapely.Geometry) -> shapely.Geometry:
    """The free region without the swaths: where turning tramples nothing that is worked in tracks."""
    swaths = shapely.linestrings([[track.start, track.end] for track in layout.tracks])
    worked = shapely.buffer(swaths, 0.55 * layout.width_m, cap_style="flat")
    rest = shapely.difference(free, shapely.union_all(worked, grid_size=GRID_M), grid_size=GRID_M)
    return shapely.buffer(rest, GRID_M)


@dataclass(frozen=True)
class TurnClock:
    """Times turns by simulating one tractor that drives them."""

    tractor: Tractor
    implement: Implement
    manner: Manner
    ground: str

    def mission(self, path: Path) -> Mission:
        """Some way of straight track, the turn, some way of straight track."""
        speed = self.manner.reverse_speed_mps if path.reverse_m else self.manner.turn_speed_mps
        turn = [Leg(points, speed, gear, ground=self.ground, task=Task(TURN)) for gear, points in path.sample(STEP_M)]
        return Mission((self._straight(path.start, -LEAD_M, 0.0), *turn, self._straight(path.end, 0.0, LEAD_M)))

    def seconds(self, path: Path) -> float:
        """Simulated seconds from the end of one track to the start of the next."""
        straight = Mission((self._straight(path.start, -LEAD_M, LEAD_M),))
        with_turn, without = (
            simulate(Plan((mission,)), self.tractor, self.implement, max_time_s=600.0)
            for mission in (self.mission(path), straight)
        )
        return with_turn.duration_s - without.duration_s

    def _straight(self, pose: Pose, start: float, end: float) -> Leg:
        ahead = np.array([math.cos(pose[2]), math.sin(pose[2])])
        points = np.array([pose[:2] + start * ahead, pose[:2] + end * ahead])
        return Leg(points, self.manner.work_speed_mps, ground=self.ground, task=Task(TRACK), implement=True)

    def best_times(self, width_m: float, depth_m: float, kinds: tuple[str, ...]) -> tuple[float | None, ...]:
        """Seconds of the quickest fitting turn over 0, 1, 2 ... lines, up to the first plain U-turn and one more.

        None where no turn of these kinds fits a headland that leaves `depth_m` for it.
        """
        times: list[float | None] = [0.0]
        most = math.ceil(2.0 * self.manner.radius_m / width_m) + 1
        for lines in range(1, most + 1):
            options = self._options(lines * width_m, depth_m, kinds)
            times.append(min((self.seconds(path) for path in options), default=None))
        return tuple(times)

    def _options(self, spacing: float, depth_m: float, kinds: tuple[str, ...]) -> list[Path]:
        a, b = (0.0, 0.0, 0.5 * math.pi), (spacing, 0.0, -0.5 * math.pi)
        radius = self.manner.radius_m
        found = []
        for kind in kinds:
            if (kind == "u" and spacing < 2.0 * radius) or turn_depth(kind, spacing, radius) > depth_m + 1e-6:
                continue
            found += [path for make in TURNS[kind] if (path := make(a, b, radius))]
        return found

    def long_way_s(self) -> float:
        """What a way round is taken to cost where no turn fits, for comparing orders: two full circles."""
        return 4.0 * math.pi * self.manner.radius_m / self.manner.turn_speed_mps

    def costs(self) -> TurnCosts:
        """What a direction change costs, from two simulated turns: arc to arc, and arc to straight."""
        radius, manner = self.manner.radius_m, self.manner
        a, b = (0.0, 0.0, 0.5 * math.pi), (0.75 * radius, 0.0, -0.5 * math.pi)
        free = TurnCosts(manner.turn_speed_mps, manner.reverse_speed_mps, 0.0)
        three, tail = switch_back(a, b, radius), fishtail(a, b, radius)
        assert three is not None and tail is not None
        lost_three = (self.seconds(three) - free.time_s(three)) / 2.0
        lost_tail = (self.seconds(tail) - free.time_s(tail)) / 2.0
        swing = max(lost_three - lost_tail, 0.0) * radius
        cusp = max(lost_tail - swing / radius, 0.0)
        return TurnCosts(manner.turn_speed_mps, manner.reverse_speed_mps, cusp, swing)
