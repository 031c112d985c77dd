"""Frames of the service to clients of the link; in which units, frames.py says."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict

AlarmCode = Literal[
    "astray", "broken", "doubt", "drives on", "error", "failed", "fence", "finding", "late", "leap", "near", "obstacle",
    "stood", "unread obstacle",
]  # fmt: skip


class Told(BaseModel):
    """Any frame of the service."""

    model_config = ConfigDict(extra="forbid")


class Welcome(Told):
    """The answer to hello. `last_sequence` is the last state that is kept of this tractor, -1 for none.

    `leg` and `leg_m` are how far it has driven by what is kept: where one that has forgotten it goes on. Its
    antenna was at `easting_m`, `northing_m` with `heading_deg` by its last state.
    """

    kind: Literal["welcome"] = "welcome"
    fleet: str
    role: str
    tractor: int | None
    version: int
    last_sequence: int
    server_time: str
    beat_s: float
    settings: dict[str, Any]
    plan: dict[str, Any] | None = None
    leg: int | None = None
    leg_m: float | None = None
    easting_m: float | None = None
    northing_m: float | None = None
    heading_deg: float | None = None


class Refused(Told):
    """A frame that is not taken: why, and its sequence where it has one."""

    kind: Literal["refused"] = "refused"
    sentence: str
    sequence: int | None = None


class Ack(Told):
    """All states of this tractor up to this sequence are kept."""

    kind: Literal["ack"] = "ack"
    sequence: int


class Beat(Told):
    """The centre is there; a tractor that hears none for a second acts as for a broken link.

    `clock_s` is a clock that only goes on: a beat that comes a second later than the quickest of its link was held up
    on its way, and counts as none.
    """

    kind: Literal["beat"] = "beat"
    time: str
    clock_s: float


class Release(Told):
    """The first `released` of `announced` legs may be driven; `limit_mps` is how fast, behind a leader."""

    kind: Literal["release"] = "release"
    update: int
    released: int
    announced: int
    limit_mps: float | None = None


class Command(Told):
    """Drive by remote control."""

    kind: Literal["command"] = "command"
    sequence: int
    steering_command_deg: float
    speed_command_mps: float
    shuttle: int
    start: int


class Stop(Told):
    """Stand at once."""

    kind: Literal["stop"] = "stop"
    reason: str = ""


class Resume(Told):
    """Drive the released legs."""

    kind: Literal["resume"] = "resume"


class PlanChanged(Told):
    """Legs after the released ones are new."""

    kind: Literal["plan"] = "plan"
    version: int
    released: int
    plan: dict[str, Any]


class LeaseTold(Told):
    """Who drives a tractor."""

    kind: Literal["lease"] = "lease"
    tractor: int
    holder: str | None
    mine: bool


class SceneTractor(Told):
    """One tractor of the scene."""

    tractor: int
    legs: list[dict[str, Any]]
    boxes_m: dict[str, float]
    antenna_forward_m: float
    wheelbase_m: float
    max_steering_deg: float


class Scene(Told):
    """What changes seldom."""

    kind: Literal["scene"] = "scene"
    version: int
    crs: str | None
    origin_m: list[float]
    field: list[list[list[float]]]
    field_obstacles: list[list[list[float]]]
    fence: list[list[list[float]]]
    obstacles: list[dict[str, Any]]
    width_m: float
    deadline_s: float | None
    tractors: list[SceneTractor]


class TickTractor(Told):
    """One tractor of a tick; `time` and pose are those of its last state."""

    tractor: int
    time: str | None
    easting_m: float | None
    northing_m: float | None
    heading_deg: float | None
    speed_mps: float | None
    steering_deg: float | None
    twin: dict[str, float] | None
    connection: Literal["online", "offline", "broken"]
    age_s: float | None
    mode: str
    holds: list[str]
    holder: str | None
    leg: int
    leg_m: float
    released: int
    waits_for: list[dict[str, int]]
    eta_s: float | None
    late_s: float | None
    error_m: float | None
    error_deg: float | None
    done_pct: float


class TickFleet(Told):
    """The fleet in a tick; ETA and deadline in seconds from now."""

    state: Literal["ready", "running", "stopped", "done"]
    eta_s: float | None
    done_pct: float
    done_m2: float
    deadline_s: float | None
    probability: float | None


class Tick(Told):
    """What has changed since the last tick; every tractor once a second at least."""

    kind: Literal["tick"] = "tick"
    time: str
    tractors: list[TickTractor]
    fleet: TickFleet


class Painted(Told):
    """What a tractor has worked after its `first` points: its line, null where the implement was lifted."""

    kind: Literal["painted"] = "painted"
    tractor: int
    first: int
    points: list[list[float] | None]


class AlarmTold(Told):
    """One alarm. `code` says of what kind it is:

    - astray: a tractor says it is where it cannot be
    - broken: its link is broken
    - doubt, finding, leap: its twin drives otherwise, why it does, its fixes leap
    - drives on: it was told to stand and does not
    - error: it reports errors of its own
    - failed: it drives no more
    - fence: it leaves the fence
    - late: its states come late
    - near: it comes too near to the tractor `other`
    - obstacle: the obstacle `other` is in the way; of no tractor
    - stood: it was told to stand just before the service ended
    - unread obstacle: it stands for an obstacle that cannot be read, and goes on once this is acknowledged

    One that is `over` has lost its cause and is told until somebody has `acknowledged` it, which is who did.
    """

    id: int
    code: AlarmCode
    other: int | None
    level: Literal["warning", "critical"]
    tractor: int | None
    sentence: str
    since: str
    acknowledged: str | None
    over: bool


class AlarmsTold(Told):
    """All alarms that are on or not yet acknowledged."""

    kind: Literal["alarms"] = "alarms"
    items: list[AlarmTold]


class ProposalTold(Told):
    """The rest of the work planned anew; `eta_s` is by simulation, `legs` per tractor for a picture.

    `moved_m` of work change hands; nobody can reach `left_m`, and on `blocked_m` somebody or something stands.
    """

    kind: Literal["proposal"] = "proposal"
    id: int
    state: Literal["planning", "ready", "failed", "accepted"]
    without: list[int]
    eta_s: float | None = None
    moved_m: float | None = None
    left_m: float | None = None
    blocked_m: float | None = None
    sentence: str | None = None
    tractors: list[dict[str, Any]] = []


class EventTold(Told):
    """Something for the log of who did what."""

    kind: Literal["event"] = "event"
    time: str
    who: str
    what: str
    data: dict[str, Any]


TOLD: tuple[type[Told], ...] = (
    Welcome, Refused, Ack, Beat, Release, Command, Stop, Resume, PlanChanged, LeaseTold, Scene, Tick, Painted,
    AlarmsTold, ProposalTold, EventTold,
)  # fmt: skip
