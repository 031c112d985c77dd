"""The planning context: what all candidates of a request share, from field and layout to tractor and driving rules."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, Protocol

import shapely

from fields.arrays import Floats, Integers
from fields.geometry.arithmetic import MITRE_LIMIT
from fields.layout.headland_passes import HeadlandPass
from fields.layout.swaths import Layout, compute_free_space
from planner.evaluation.field_physics import LEVEL_GROUND, FieldPhysics
from planner.evaluation.machine_outlines import (
    GATE_HALF_WIDTH_M,
    GATE_MARGIN_M,
    build_body,
    folds_at_gate,
    measure_half_m,
    measure_passage_m,
)
from planner.evaluation.pull_check import compute_pull_figures
from planner.evaluation.time_share import NO_LIMIT, TimeShare
from planner.farm.workday import Workday
from planner.request.plan_request import PlanRequest
from planner.risk.assessment import DecisionCriteria
from planner.risk.costs import CostTerms
from planner.traffic.trajectories import TrajectoryCache
from reports.common.plan_records import PullFigures
from strategies.path_planning.paths import EntranceLane, Pose, build_entrance_lane
from strategies.path_planning.turns import list_allowed_kinds
from strategies.programmes.site_moves import SiteMoves
from strategies.rules.driving_rules import DrivingRules
from strategies.rules.supply import Supply
from vehicle.model.tractor import Implement, Tractor

# Of the gap between machines on neighbouring swaths; the rest is for errors of guidance.
CLEARANCE_SHARE = 1.0 / 3.0


@dataclass(frozen=True)
class Stand:
    """Where a tractor stands, and what it was about to do.

    Attributes:
        pose: of its guided point, in metres of the field.
        used: what it has used of its load.
        ahead: poses in the middle of the lines that it was to work next, in order: the search for a plan begins so.
        is_folded: whether its implement is folded.
    """

    pose: Pose
    used: float = 0.0
    ahead: tuple[Pose, ...] = ()
    is_folded: bool = False

    def move_by(self, east_m: float, north_m: float) -> Stand:
        """The same stand in metres from another origin."""
        pose, *ahead = ((x + east_m, y + north_m, heading) for x, y, heading in (self.pose, *self.ahead))
        return replace(self, pose=pose, ahead=tuple(ahead))


@dataclass(frozen=True, eq=False)
class DoneWork:
    """Work that is done already, in metres of the field, known to `error_m`, and where machines stand after it.

    `numbers` are those that the machines which go on, first these, had in its plan. Tractors beyond those that stand on
    the field come in through the entrance. Where they `may_rest`, one for whom no work is worth the drive has none.
    """

    ground: shapely.Geometry
    error_m: float
    stands: tuple[Stand, ...] = ()
    notes: tuple[str, ...] = ()
    numbers: tuple[int, ...] = ()
    may_rest: bool = False


class MoveStore(Protocol):
    """A cache of what is known of the moves of sites (planner.pipeline.move_cache)."""

    def load(self, context: PlanningContext, moves: SiteMoves) -> None:
        """Let moves of a context know what is stored of them."""

    def store(self, context: PlanningContext) -> None:
        """Store what is new of the moves of a context that were loaded."""


@dataclass(frozen=True)
class StoredMoves:
    """What a cache has of the moves of a context: the name of their files, and how many entries of each table."""

    name: str
    counts: Mapping[str, int]


@dataclass(frozen=True, repr=False)
class PlanningContext:
    """Field, layout, tractor, implement and driving rules; made once per request.

    `tractor` is as it drives on the soil and heights of the field, `bare_tractor` without what these do to it.
    The guided point may be anywhere in `free_space`. `fitting_turns[k]` says whether a turn over k lines fits a
    headland at right angles (index 0 unused); if none does, `driving_rules.turn_s[k]` is an estimate instead of a
    simulated time. `position_errors` is the GNSS error table. `headland_passes` are worked. `criteria` are the risk
    settings, `supply` what every tractor carries, `cost_terms` the prices and `workday` the day of a farm (None without
    one). `physics` are heights and load. `going_on` is what is done already, from all sources together; its ground is
    that of the field (`Field.done`). `time_share` limits the computing where this context was made; it is not sent to
    another process. `move_cache` has what earlier runs found of moves; None for nothing.
    """

    request: PlanRequest
    layout: Layout
    tractor: Tractor
    bare_tractor: Tractor
    implement: Implement
    driving_rules: DrivingRules
    free_space: shapely.Geometry
    fitting_turns: tuple[bool, ...]
    position_errors: Integers
    headland_passes: tuple[HeadlandPass, ...] = ()
    criteria: DecisionCriteria | None = None
    supply: Supply | None = None
    cost_terms: CostTerms | None = None
    workday: Workday | None = None
    physics: FieldPhysics = LEVEL_GROUND
    going_on: DoneWork | None = None
    time_share: TimeShare = NO_LIMIT
    move_cache: MoveStore | None = None

    @cached_property
    def gateway(self) -> EntranceLane | None:
        """The lane through the entrance; None without an entrance or if the headland is not worked, as only the time
        on the swaths counts then."""
        field = self.layout.field
        if field.entrance is None or self.request.no_headland or self.free_space.is_empty:
            return None
        return build_entrance_lane(field.whole_boundary, self.free_space, field.entrance)

    @property
    def turn_kinds(self) -> tuple[str, ...]:
        """The kinds of turns that may be driven."""
        return list_allowed_kinds(self.request.turn)

    @property
    def main_lines_m(self) -> list[Floats]:
        """The lines (n, 2) that most work is on: tracks, or headland sides where there are none."""
        sides = (side for one in self.headland_passes for side in one.sides)
        return [swath.points_m for swath in self.layout.swaths] or [side.points for side in sides]

    @property
    def pull(self) -> PullFigures | None:
        """What the implement needs at the drawbar and the tractor has there; None if unknown."""
        farm_tractor = None if self.cost_terms is None else self.cost_terms.tractor
        return compute_pull_figures(self.request, self.tractor, farm_tractor, self.physics.soil)

    @property
    def gate_half_width_m(self) -> float:
        """How far to either side of the entrance the fence is open, so that machines come in."""
        if self.gateway is None:
            return GATE_HALF_WIDTH_M
        return max(GATE_HALF_WIDTH_M, measure_half_m(self.tractor, self.at_gate.implement) + GATE_MARGIN_M)

    @property
    def at_gate(self) -> PlanningContext:
        """The same with the implement as it passes the entrance."""
        return self.folded if folds_at_gate(self.tractor, self.implement) else self

    @cached_property
    def folded(self) -> PlanningContext:
        """The same with the implement folded."""
        return replace(self, implement=self.implement.folded)

    @cached_property
    def trajectory_cache(self) -> TrajectoryCache:
        """Trajectories of tractors driven alone, for all plans of the context."""
        return TrajectoryCache()

    @cached_property
    def site_cache(self) -> dict[type, Any]:
        """What candidates share, by its type, once one of them has asked for it (planner.evaluation.site)."""
        return {}

    def __getstate__(self) -> dict[str, Any]:
        """What is sent to another process: everything but caches."""
        sent = {each.name for each in fields(self)} - {"time_share"}
        return {name: value for name, value in self.__dict__.items() if name in sent}

    @cached_property
    def rooms(self) -> tuple[shapely.Polygon, ...]:
        """Ground wide enough for the (folded) machines, in parts without a passage between them, the largest first."""
        half_m = 0.5 * measure_passage_m(self.tractor, self.implement)
        parts = shapely.get_parts(compute_free_space(self.layout.field, half_m))
        largest_first = sorted(parts, key=lambda part: (-part.area, part.bounds))
        return tuple(part.buffer(half_m, join_style="mitre", mitre_limit=MITRE_LIMIT) for part in largest_first)

    @cached_property
    def gate_area(self) -> shapely.Geometry:
        """The ground about the entrance where machines come in from outside; empty without an entrance."""
        if self.gateway is None:
            return shapely.Polygon()
        reach_m = build_body(self.tractor, self.at_gate.implement).guided_reach_m
        return shapely.Point(self.gateway.in_pose[:2]).buffer(self.gate_half_width_m + reach_m)
