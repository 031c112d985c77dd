"""What the centre knows of one tractor: its last report, its link, what holds it, and how far it is."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

AUTOMATIC, REMOTE, MANUAL, STOPPED = "automatic", "remote", "manual", "stopped"
MODES = (AUTOMATIC, REMOTE, MANUAL, STOPPED)
BY_HAND = frozenset({MANUAL, REMOTE})
ONLINE, OFFLINE, BROKEN = "online", "offline", "broken"
# What keeps a tractor from driving its legs; while any holds, it stands.
PAUSED, HALTED, NEAR, FENCE, OBSTACLE, FAILED, DRIVEN, ASTRAY, GIVEN, UNREAD, WAITS = (
    "paused", "stopped by stop-all", "too near another", "outside the fence", "obstacle on its way", "failed",
    "remote control", "not where it can be", "its tracks were given to others",
    "an obstacle that cannot be read", "waits for another by the plan",
)  # fmt: skip
SAFE_TO_DRIVE = frozenset({DRIVEN, OBSTACLE, NEAR, FENCE, ASTRAY, GIVEN, WAITS})
"""Holds under which an operator may still drive by remote control; away from danger only, which the guard sees to."""


@dataclass(frozen=True)
class Report:
    """What a tractor says of itself, in metres of the plan, m/s and radians.

    `heading_rad` is a mathematical angle, steering is positive to the right, as everywhere in `vehicle`; (x, y) is the
    guided point, abreast of the antenna. `time_s` is when that was, by its own clock (seconds since 1970).
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
class DrivingOn:
    """A tractor that moves though it was told to stand: how fast it was first seen to, when its last report of that
    came, and for how long there were such reports without a break."""

    speed_mps: float
    heard_s: float
    seen_s: float = 0.0


@dataclass
class TractorState:
    """One tractor. Times are of the clock that the centre is told; -inf for never.

    `heard_s` is when its link was last known to work, `seen_s` when it was where `report` says, `joined_s` when it was
    linked. `doubtful` is one that drove when the centre's memory ends, and may have been told to stand after that.
    `leg` and `leg_m` never go back. `released` legs may be driven. `driving_s` counts seconds of moving under its own
    guidance, against which the plan is scaled. `delay_s` is how long its last report was on its way. `driving_on` is
    there while it is seen to move though it was told to stand, `told_again_s` when it was told once more. `unread_s`
    and `read_s` are when it told last of an obstacle that could not be read, and of one that could; `faces_s` since
    when it stands for one, `looked_at` where it stood when somebody had looked.
    """

    report: Report | None = None
    heard_s: float = -math.inf
    seen_s: float = -math.inf
    joined_s: float = -math.inf
    doubtful: bool = False
    linked: bool = False
    said_goodbye: bool = True
    leg: int = 0
    leg_m: float = 0.0
    released: int = 0
    update: int = 0
    limit_mps: float | None = None
    done: bool = False
    failed: bool = False
    driving_s: float = 0.0
    driven_plan_s: float = 0.0
    holds: set[str] = field(default_factory=set)
    standing_ordered: bool = True
    commanded_s: float = -math.inf
    remote_command: tuple[float, float] = (0.0, 0.0)
    delay_s: float = 0.0
    driving_on: DrivingOn | None = None
    told_again_s: float = -math.inf
    unread_s: float = -math.inf
    read_s: float = -math.inf
    faces_s: float = -math.inf
    looked_at: tuple[float, float] | None = None

    @property
    def mode(self) -> str:
        """How it is driven, as it said last."""
        return self.report.mode if self.report else STOPPED

    @property
    def out(self) -> bool:
        """Whether it drives no more legs: it has failed, or its tracks were given to others."""
        return self.failed or GIVEN in self.holds

    def connection(self, now: float, silence_s: float) -> str:
        """One of online, offline (never there or gone with a goodbye) and broken."""
        if self.linked and now - self.heard_s <= silence_s:
            return ONLINE
        return OFFLINE if self.said_goodbye and not self.linked else BROKEN
