"""How tractors drive, and a field by its swaths with a finder of paths between them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from fields.layout.swaths import Layout, Swath
from strategies.path_planning.collision_check import FenceChecker, pick_quickest_inside
from strategies.path_planning.connector import Connector
from strategies.path_planning.obstacle_avoidance import ObstacleBends
from strategies.path_planning.paths import DrivePath, EntranceLane, Pose, measure_longest_reverse_m
from vehicle.control.speed_profile import UNLIMITED, DrivingLimits

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

PLAIN_TURN_S = 40.0  # a quicker turn in the headland is not compared with one across swaths
MAX_REVERSE_LENGTHS = 2.0  # lengths of tractor and implement that one manoeuvre may be driven in reverse
DETOUR_FACTOR, DETOUR_S = 1.25, 5.0  # how much longer a path round swaths may take than one across: factor, seconds
THESIS_MACHINE_M = 5.0  # length of tractor and implement that rows 10 m apart are for


@dataclass(frozen=True)
class DrivingRules:
    """How every tractor of the fleet drives.

    `tool_m` is how far the implement works behind the guided point. `turn_s[k]` are the simulated seconds of the best
    turn over k lines (index 0 unused); beyond its end the last entry grows by driving straight across. A tractor that
    must give way waits `hold_back_m` before the end of its swath, clear of the headland. Two that would turn side by
    side go `ahead_m` one after the other. `boxes` are the outline of tractor and implement: rear and front end ahead of
    the guided point, and half the width (m). `limits` hold in bends.
    """

    work_speed_mps: float
    turn_speed_mps: float
    reverse_speed_mps: float
    radius_m: float
    tool_m: float
    gap_m: float = 10.0
    stagger_m: float = 12.0
    hold_back_m: float = 8.0
    ahead_m: float = 0.0
    turn_s: tuple[float, ...] = (0.0, 20.0)
    boxes: tuple[tuple[float, float, float], ...] = ((-1.8, 2.4, 1.0), (-2.7, -1.9, 1.4))
    limits: DrivingLimits = UNLIMITED

    def get_path_speed_mps(self, gear: float) -> float:
        """Largest speed on a turn or route in a gear; bends are driven more slowly (vehicle.control.speed_profile)."""
        speed_mps: float = self.turn_speed_mps if gear > 0 else self.reverse_speed_mps
        return speed_mps

    @property
    def length_m(self) -> float:
        """Length of tractor and implement together (m)."""
        rears, fronts, _ = zip(*self.boxes, strict=True)
        return float(max(fronts) - min(rears))

    def scale_spacing(self) -> DrivingRules:
        """The same with the distances between tractors shortened for machines shorter than that of the thesis."""
        share = min(1.0, self.length_m / THESIS_MACHINE_M)
        spacing_m = {key: share * getattr(self, key) for key in ("gap_m", "stagger_m", "hold_back_m", "ahead_m")}
        return replace(self, **spacing_m)

    @property
    def max_reverse_m(self) -> float:
        """The most that is driven in reverse in one manoeuvre, wherever another path leads on (m)."""
        return MAX_REVERSE_LENGTHS * self.length_m


@dataclass(frozen=True)
class SwathPass:
    """One swath driven in one direction (+1 along the bearing of its cell, -1 against it)."""

    swath: Swath
    direction: int


@dataclass
class FieldJob:
    """A field whose remaining work is shared out anew among `tractors`.

    Paths: `connector` finds them anywhere in the field, `headland_connector` only beside the swaths, `rim_connector` in
    the corners of headland passes, where the guided point may be anywhere on the field. With `avoids_swaths` no path
    crosses swaths if it can keep to the headland, however much longer it is. `obstacle_bends` are the passes bent
    round small obstacles. No path crosses `fence` (fences and obstacles) as long as one of the `careful_connectors`
    finds another. No part of a machine should reach over an `open_edge`.

    Tractors enter and leave by the `entrance_lane`;
    without one they stand where work begins and stay where it ends. `path_cache` holds paths by pair of poses, for all
    jobs of one field.
    """

    layout: Layout
    driving_rules: DrivingRules
    connector: Connector
    tractors: int
    headland_connector: Connector | None = None
    rim_connector: Connector | None = None
    avoids_swaths: bool = False
    obstacle_bends: ObstacleBends = field(default_factory=ObstacleBends)
    fence: FenceChecker | None = None
    open_edge: FenceChecker | None = None
    careful_connectors: tuple[Connector, ...] = ()
    entrance_lane: EntranceLane | None = None
    path_cache: dict[tuple[Pose, Pose], DrivePath | None] = field(default_factory=dict)

    def find_path(self, a: Pose, b: Pose) -> DrivePath | None:
        """The quickest drivable path from a to b, or None.

        It keeps to the headland, where no crop is driven on, unless a path across swaths is much quicker and swaths
        need not be avoided. More than a manoeuvre in reverse is driven only where no other path leads on.
        """
        if (a, b) not in self.path_cache:
            path = self.find_turn(a, b) or self._choose_route(a, b)
            if self.crosses_fence(path):
                path = (
                    pick_quickest_inside(
                        self.fence,
                        [connector.connect(a, b) for connector in self.careful_connectors],
                        self.connector.compute_cost_s,
                    )
                    or path
                )
            path = path or (self._choose_turn(a, b) if self.fence else None)
            self.path_cache[a, b] = path or self._find_reversing_path(a, b)
        return self.path_cache[a, b]

    def has_long_reverse(self, path: DrivePath | None) -> bool:
        """Whether a path holds a manoeuvre with more reversing than there is reason for where another path leads on."""
        return path is not None and measure_longest_reverse_m(path) > self.driving_rules.max_reverse_m

    def _find_reversing_path(self, a: Pose, b: Pose) -> DrivePath | None:
        """A path with any length in reverse, where no other leads on: by the headland if there is one."""
        for connector in (self.headland_connector, self.connector):
            path = None if connector is None else connector.connect_in_reverse(a, b)
            if path is not None and not self.crosses_fence(path):
                return path
        return None

    def has_overhang(self, path: DrivePath) -> bool:
        """Whether any part of the machine reaches too far over an open edge on a path."""
        return self.open_edge is not None and self.open_edge.has_path_contact(path)

    def crosses_fence(self, path: DrivePath | None, *, fences_only: bool = False) -> bool:
        """Whether any part of the machine touches a fence, or an obstacle, on a path."""
        return (
            path is not None and self.fence is not None and self.fence.has_path_contact(path, fences_only=fences_only)
        )

    def find_turn(self, a: Pose, b: Pose) -> DrivePath | None:
        """A turn beside the swaths, or one across them that is much quicker; None if all cross the fence."""
        turn = self._choose_turn(a, b)
        if not self.crosses_fence(turn):
            return turn
        return pick_quickest_inside(
            self.fence,
            [connector.connect_directly(a, b) for connector in self.careful_connectors],
            self.connector.compute_cost_s,
        )

    def _choose_turn(self, a: Pose, b: Pose) -> DrivePath | None:
        cost = self.connector.compute_cost_s
        headland_turn = self.headland_connector.connect_directly(a, b) if self.headland_connector else None
        if self.avoids_swaths or (headland_turn and cost(headland_turn) <= PLAIN_TURN_S):
            return headland_turn
        field_turn = self.connector.connect_directly(a, b)
        if field_turn and (headland_turn is None or cost(headland_turn) > DETOUR_FACTOR * cost(field_turn) + DETOUR_S):
            return field_turn
        return headland_turn

    def _choose_route(self, a: Pose, b: Pose) -> DrivePath | None:
        """A route along the headland if it is hardly longer than the straight line, else the quickest one."""
        headland_route = self.headland_connector.connect(a, b) if self.headland_connector else None
        flight_s = math.dist(a[:2], b[:2]) / self.driving_rules.turn_speed_mps
        cost = self.connector.compute_cost_s
        if headland_route and (self.avoids_swaths or cost(headland_route) <= DETOUR_FACTOR * flight_s + PLAIN_TURN_S):
            return headland_route
        field_route = self.connector.connect(a, b)
        if field_route and (
            headland_route is None or cost(headland_route) > DETOUR_FACTOR * cost(field_route) + DETOUR_S
        ):
            return field_route
        return headland_route

    def get_entry_pose(self, swath_pass: SwathPass) -> Pose:
        """Pose of the guided point where a pass begins: on the headland line, facing along the swath."""
        x, y = swath_pass.swath.start_m if swath_pass.direction > 0 else swath_pass.swath.end_m
        return x, y, self.compute_heading(swath_pass)

    def get_exit_pose(self, swath_pass: SwathPass) -> Pose:
        """Pose of the guided point where the implement has reached the end of the swath."""
        x, y = swath_pass.swath.end_m if swath_pass.direction > 0 else swath_pass.swath.start_m
        heading = self.compute_heading(swath_pass, at_end=True)
        tool = self.driving_rules.tool_m
        return x + tool * math.cos(heading), y + tool * math.sin(heading), heading

    def compute_heading(self, swath_pass: SwathPass, *, at_end: bool = False) -> float:
        """Mathematical angle of travel where a pass begins, or ends (rad)."""
        swath = swath_pass.swath
        bearing = swath.get_headings_rad(self.layout.get_bearing_rad(swath))[at_end == (swath_pass.direction > 0)]
        return math.remainder(bearing if swath_pass.direction > 0 else bearing + math.pi, 2.0 * math.pi)
