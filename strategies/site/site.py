"""The site of a job: the ground as machines meet it, the machine, how it drives, and how a drive is simulated."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt
import shapely

from fields.arrays import Floats
from fields.layout.headland_passes import HeadlandPass
from fields.layout.swaths import Layout
from strategies.path_planning.machine_body import MachineBody
from strategies.path_planning.paths import PATH_KINDS, EntranceLane
from strategies.path_planning.turn_kinds import TURN_KINDS
from strategies.rules.driving_rules import DrivingRules
from strategies.site.ground import Ground
from vehicle.missions.plan import Leg, Mission, Plan
from vehicle.missions.run import SimulationRun

MISSED_FACTOR = 12.0  # seconds to finish ground later, to those that it takes to work it now
LEFT_FACTOR = 2.0 * MISSED_FACTOR  # the same for a whole line: a machine comes back for it, as for no tip of a corner
ORDER_S = 120.0  # charged for a move that leaves the order of passes or furrows: more than any such move saves
WHEELS_S_PER_M, SPOILING_S_PER_M = 0.3, 2.0  # charge for a metre on ground of swaths, and on a crop or a seedbed
KEPT_DEPTH_M = 0.5  # ground counts as driven on from so far inside
SETTLE_M = 20.0  # of a line: a tractor that begins it, or starts on it, has settled by then
BRAKE_M = 10.0  # beyond, so that stopping at the end is not measured
SETTLED_M = SETTLE_M + BRAKE_M  # longer lines pass on nothing of how they were begun
STRAIGHT_M = 2.0 * SETTLED_M  # driven from rest to rest, to see what starting and stopping take
Drive = Callable[[Plan], SimulationRun]
"""Simulates tractors that pass each other by, each as if it were alone, without errors of position."""


@dataclass(frozen=True, eq=False)
class Site:
    """Where and with what a job is done.

    Attributes:
        layout, headland_passes: what is to be worked.
        rules: how every tractor drives.
        body: the machine with its implement.
        folded: the same with it folded for moves that have no room else; None for one that does not fold.
        fold_s: how long it stands to fold or to unfold it (s).
        ground: what the body may touch in plans.
        proof_ground: what it may touch in a drive; a little more, as a drive errs.
        gate_grounds: both on the way in or out, with the lane through the entrance; None without one.
        crop_stands: whether a crop stands that must not be driven over before it is worked.
        keeps_ground: whether finished ground must not be driven over again.
        furrow_s: seconds charged for a move from a track to one that is not beside it, where each needs the furrow of
            the one before; else 0.
        kept: ground of swaths, where wheels are charged `wheels_s_per_m`.
        standing: the ground inside the outline, where a machine works its way into a crop that stands.
        axle_m: rear axle behind the centre of mass.
        turn_kinds: kinds of turns that may be driven.
        lane: through the entrance, None without one; `folds_at_gate` is whether it is too narrow for the implement.
        drive, drive_level: simulate tractors, on the ground of the field and on level ground.
        is_alike: whether its ground is level and the same everywhere.
        corner_factor: seconds to finish ground left in corners of the headland, to those that it takes to work it with
            the corner; infinite where every corner is worked whole.
    """

    layout: Layout
    headland_passes: tuple[HeadlandPass, ...]
    rules: DrivingRules
    body: MachineBody
    folded: MachineBody | None
    fold_s: float
    ground: Ground
    proof_ground: Ground
    gate_grounds: tuple[Ground, Ground] | None
    crop_stands: bool
    keeps_ground: bool
    furrow_s: float
    kept: Ground
    standing: Ground | None
    axle_m: float
    turn_kinds: tuple[str, ...]
    lane: EntranceLane | None
    folds_at_gate: bool
    drive: Drive
    drive_level: Drive
    is_alike: bool
    corner_factor: float = MISSED_FACTOR

    @property
    def wheels_spoil(self) -> bool:
        """Whether wheels spoil a crop that stands or a seedbed that is finished."""
        return self.crop_stands or self.keeps_ground

    @property
    def wheels_s_per_m(self) -> float:
        """Charge for a metre of wheels on `kept` ground (s/m)."""
        return SPOILING_S_PER_M if self.wheels_spoil else WHEELS_S_PER_M

    def get_kept(self, passes: int | None = None) -> tuple[npt.NDArray[np.float32], Floats, float, float]:
        """Where wheels are charged when so many headland passes are worked, all by default, for compiled functions:
        grid and frame, how deep inside (m), and the charge (s/m)."""
        if passes is None or self.standing is None:
            return self.kept.grid, self.kept.frame, KEPT_DEPTH_M, self.wheels_s_per_m
        depth_m = passes * self.width_m + KEPT_DEPTH_M
        return self.standing.grid, self.standing.frame, depth_m, self.wheels_s_per_m

    @property
    def back_m(self) -> float:
        """How far the centre of mass is behind the guided point."""
        return self.body.guide_m - self.axle_m

    @property
    def bar_m(self) -> float:
        """How far the implement is behind the centre of mass."""
        return self.rules.tool_m - self.back_m

    def get_body(self, is_folded: bool) -> MachineBody:
        """The machine, with its implement folded or not."""
        return self.folded if is_folded and self.folded is not None else self.body

    def get_fold_s(self, is_folded: bool) -> float:
        """How long a tractor stands before and after a move with its implement folded or not (s)."""
        return self.fold_s if is_folded and self.folded is not None else 0.0

    @cached_property
    def at_gate(self) -> Site:
        """The site as it is for ways in and out."""
        if self.gate_grounds is None:
            return self
        ground, proof_ground = self.gate_grounds
        return replace(self, ground=ground, proof_ground=proof_ground)

    @cached_property
    def straight_run(self) -> SimulationRun:
        """A drive along a line of STRAIGHT_M due east from rest to rest, on level ground: it lies nowhere."""
        leg = Leg(np.array([[0.0, 0.0], [STRAIGHT_M, 0.0]]), self.rules.work_speed_mps, 1, True)
        return self.drive_level(Plan((Mission((leg,)),)))

    @property
    def width_m(self) -> float:
        """Working width (m)."""
        return self.layout.width_m

    @cached_property
    def allowed_kinds(self) -> np.ndarray:
        """Which kinds of primitives, in their order, may be driven; a route may always."""
        return np.array([kind not in TURN_KINDS or kind in self.turn_kinds for kind in PATH_KINDS])

    @cached_property
    def work_ground(self) -> shapely.Geometry:
        """The ground that is to be worked."""
        return self.layout.field.due_region

    @property
    def work_s_per_m2(self) -> float:
        """Seconds to work a square metre (s/m2)."""
        return 1.0 / (self.width_m * self.rules.work_speed_mps)
