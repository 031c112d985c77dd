"""The state of one tractor (last report, link, holds, progress), and the orders and events of a fleet manager."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, NamedTuple

from planner.fleet.model.rules import FleetRules
from planner.fleet.model.timed_mission import TimedMission
from vehicle.missions.plan import Leg, LegGate

MOVING_MPS = 0.05  # slower tractors count as standing
AUTOMATIC, REMOTE, MANUAL, STOPPED = "automatic", "remote", "manual", "stopped"
BY_HAND = frozenset({MANUAL, REMOTE})
ONLINE, OFFLINE, BROKEN = "online", "offline", "broken"
POSITIONS, SPEED, PROGRESS = "positions", "speed", "progress"
"""Witnesses of the motion of a tractor, see planner.fleet.safety.credible_motion."""


@dataclass(frozen=True)
class TractorOrder:
    """An order to one tractor; `kind` and `data` become a frame, angles are in radians."""

    tractor: int
    kind: str
    data: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class FleetEvent:
    """An event of the log: who did what; `who` is "centre" for the fleet manager itself."""

    who: str
    what: str
    data: dict[str, Any] = field(default_factory=dict)


class Hold(StrEnum):
    """Why a tractor stands: while it has any hold, it does not drive by itself."""

    PAUSED = "paused"
    HALTED = "stopped by stop-all"
    TOO_NEAR = "too near another"
    FENCE = "outside the fence"
    OBSTACLE = "obstacle on its way"
    FAILED = "failed"
    REMOTE_CONTROL = "remote control"
    ASTRAY = "not where it can be"
    REASSIGNED = "its tracks were given to others"
    UNREADABLE = "an obstacle that cannot be read"
    WAITS_FOR_PLAN = "waits for another by the plan"
    SERVICE_RESTARTED = "the service began anew"
    DOUBTED = "its reports contradict each other"
    UNPLACED = "its place among other fleets is unknown"


UNTIL_RESUMED = frozenset({Hold.PAUSED, Hold.HALTED, Hold.SERVICE_RESTARTED})
"""Holds that end when an operator resumes a tractor."""
SAFE_TO_DRIVE = frozenset(
    {
        Hold.REMOTE_CONTROL, Hold.OBSTACLE, Hold.TOO_NEAR, Hold.FENCE, Hold.ASTRAY, Hold.REASSIGNED,
        Hold.WAITS_FOR_PLAN, Hold.SERVICE_RESTARTED,
    }
)  # fmt: skip
"""Holds under which remote control is still allowed; the guard allows only commands that lead away from danger."""


class TractorReport(NamedTuple):
    """A report of a tractor, in metres of the plan, m/s and radians.

    `heading_rad` is a mathematical angle, steering is positive to the right, as everywhere in `vehicle`; (x, y) is the
    guided point, beside the antenna. `time_s` is when that was, by its own clock (seconds since 1970).
    """

    x_m: float
    y_m: float
    heading_rad: float
    speed_mps: float
    speed_command_mps: float = 0.0
    steering_command_rad: float = 0.0
    steering_rad: float | None = None
    shuttle: int = 1
    mode: str = AUTOMATIC
    leg: int = 0
    leg_m: float = 0.0
    implement: int = 0
    done: bool = False
    errors: tuple[str, ...] = ()
    time_s: float | None = None

    @property
    def velocity_mps(self) -> float:
        """Speed with the sign of its direction."""
        return math.copysign(self.speed_mps, self.shuttle) if self.shuttle else self.speed_mps


@dataclass
class MotionDoubt:
    """The reports of a tractor contradict each other: `suspect` is the witness that is farthest from the others, which
    showed `moved_m` over `over_s` (simulated clock).

    Until an operator has looked the tractor may be anywhere within `radius_m` of `pose`, where it was before:
    `speed_mps`, the greatest credible speed since then, times the seconds since `since_s` (fleet manager's clock).
    """

    suspect: str
    over_s: float
    moved_m: dict[str, float]
    pose: tuple[float, float, float]
    speed_mps: float
    radius_m: float = 0.0
    since_s: float = 0.0


@dataclass
class DisobeyingMotion:
    """A tractor moves although it was ordered to stop: its speed when first seen, the time of its last such report,
    and the seconds of continuous reports since."""

    speed_mps: float
    last_report_s: float
    observed_s: float = 0.0


@dataclass
class TractorState:
    """One tractor and its mission. Times are of the fleet manager's clock in seconds; -inf for never.

    `last_contact_s` is when its link last worked, `last_fix_s` when it was at the place of `report`. `leg` and `leg_m`
    never go back. The first `base_end` legs may be driven. `driving_s` are seconds driven under its own guidance, and
    `planned_driving_s` the planned seconds for the same distance. `delay_s` is how long its last report was under way.
    `disobeying_motion` is set while it moves despite an order to stop, repeated at `stop_repeated_s`; `stood_at` is
    where it was when it said that it obeys one, which holds since `ordered_since_s`. `unreadable_s` and `readable_s`
    are when it last reported an unreadable and a readable obstacle; since `faced_since_s` it stands for an unreadable
    one, and `cleared_at` is where it stood when an operator had looked. `doubt` is set while its reports contradict
    each other, and `is_moving_unreported` while its positions move more than its speed says.
    """

    mission: TimedMission
    report: TractorReport | None = None
    last_contact_s: float = -math.inf
    last_fix_s: float = -math.inf
    is_linked: bool = False
    has_disconnected: bool = True
    leg: int = 0
    leg_m: float = 0.0
    base_end: int = 0
    update: int = 0
    limit_mps: float | None = None
    done: bool = False
    failed: bool = False
    driving_s: float = 0.0
    planned_driving_s: float = 0.0
    holds: set[str] = field(default_factory=set)
    standing_ordered: bool = True
    commanded_s: float = -math.inf
    remote_command: tuple[float, float] = (0.0, 0.0)
    delay_s: float = 0.0
    disobeying_motion: DisobeyingMotion | None = None
    stop_repeated_s: float = -math.inf
    stood_at: tuple[float, float] | None = None
    ordered_since_s: float | None = None
    unreadable_s: float = -math.inf
    readable_s: float = -math.inf
    faced_since_s: float = -math.inf
    cleared_at: tuple[float, float] | None = None
    doubt: MotionDoubt | None = None
    is_moving_unreported: bool = False

    @property
    def mode(self) -> str:
        """Its mode, as last reported."""
        return self.report.mode if self.report else STOPPED

    @property
    def present_leg(self) -> Leg:
        """The leg that it is on, at the end of its mission the last one."""
        return self.mission.legs[min(self.leg, len(self.mission.legs) - 1)]

    @property
    def position_m(self) -> float:
        """Metres from the start of its mission to where it is."""
        return self.mission.leg_starts_m[min(self.leg, len(self.mission.legs))] + self.leg_m

    @property
    def base_end_m(self) -> float:
        """Metres from the start of its mission to the end of its base."""
        return self.mission.leg_starts_m[min(self.base_end, len(self.mission.legs))]

    @property
    def worked_m(self) -> float:
        """Metres that it has worked so far."""
        return self.mission.worked_m[-1] if self.done else self.mission.compute_worked_m(self.leg, self.leg_m)

    @property
    def is_moving(self) -> bool:
        """Whether it moved when it reported last."""
        return self.report is not None and self.report.speed_mps > MOVING_MPS

    @property
    def is_standing(self) -> bool:
        """Whether it stands by order, and so can wait where it is."""
        return self.standing_ordered and self.report is not None and self.report.speed_mps < MOVING_MPS

    @property
    def stop_reason(self) -> str:
        """The reason in an order to stop."""
        return min(self.holds, default="not started")

    @property
    def has_no_more_legs(self) -> bool:
        """Whether it drives no more legs: it has failed, or its tracks were given to others."""
        return self.failed or Hold.REASSIGNED in self.holds

    def get_connection(self, now: float, silence_s: float) -> str:
        """One of online, offline (never connected, or disconnected by itself) and broken."""
        if self.is_linked and now - self.last_contact_s <= silence_s:
            return ONLINE
        return OFFLINE if self.has_disconnected and not self.is_linked else BROKEN

    # Which legs it may drive: base and horizon, as in VDA 5050 (6.1). The base is never taken back, and reaches only a
    # little ahead. A leg joins it once the leg before has, its gates are open by what the other tractors have really
    # driven, and nothing blocks it.

    def find_closed_gates(self, leg: int, states: Sequence[TractorState]) -> list[LegGate]:
        """The gates of a leg that are not open yet."""
        return [gate for gate in self.mission.legs[leg].gates if not is_passed(gate, states)]

    def find_gates_closed_on_base(self, states: Sequence[TractorState]) -> list[LegGate]:
        """Closed gates for which it stands on a base leg; only replanned plans have them."""
        return self.find_closed_gates(self.leg, states) if self.leg < self.base_end else []

    def compute_base_end(self, states: Sequence[TractorState], blocked: Mapping[int, str], rules: FleetRules) -> int:
        """The number of legs in its base now, at least as many as before."""
        base_end = self.base_end
        while base_end < len(self.mission.legs) and base_end not in blocked:
            is_beyond_reach = base_end > self.leg and not self.is_within_reach(base_end, rules)
            if is_beyond_reach or self.find_closed_gates(base_end, states):
                break
            base_end += 1
        return base_end

    def is_within_reach(self, leg: int, rules: FleetRules) -> bool:
        """Whether the base may reach as far ahead as the start of a leg."""
        speed_mps = max(self.present_leg.speed_mps, 0.0)
        reach_m = max(rules.base_m, rules.base_s * speed_mps * rules.times)
        return self.mission.leg_starts_m[leg] - self.position_m <= reach_m


def is_passed(gate: LegGate, states: Sequence[TractorState]) -> bool:
    """Whether a tractor has reached the place that a gate waits for."""
    awaited = states[gate.tractor]
    return awaited.done or (awaited.leg, awaited.leg_m) >= (gate.leg, gate.after_m) or awaited.leg > gate.leg
