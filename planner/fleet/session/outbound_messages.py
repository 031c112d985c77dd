"""Frames that the service sends to clients; units are as in inbound_frames."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict

AlarmCode = Literal[
    "astray", "broken", "clock", "contradiction", "doubt", "drives on", "error", "failed", "fence", "finding", "late",
    "leap", "near", "near fleet", "neighbour stopped", "obstacle", "replaced", "restarted", "unknown ground",
    "unread obstacle", "unrecorded",
]  # fmt: skip


class OutboundMessage(BaseModel):
    """Any frame of the service."""

    model_config = ConfigDict(extra="forbid")


class WelcomeMessage(OutboundMessage):
    """The answer to connect. `last_sequence` is the last recorded state of this tractor, -1 for none.

    `leg` and `leg_m` are its recorded progress, for a tractor that has forgotten it. In its last state its antenna was
    at `easting_m`, `northing_m` with `heading_deg`. `clock_s` is the clock of heartbeats, one every `heartbeat_s`.
    """

    kind: Literal["welcome"] = "welcome"
    fleet: str
    role: str
    tractor: int | None
    version: int
    last_sequence: int
    server_time: str
    clock_s: float
    heartbeat_s: float
    settings: dict[str, Any]
    plan: dict[str, Any] | None = None
    leg: int | None = None
    leg_m: float | None = None
    easting_m: float | None = None
    northing_m: float | None = None
    heading_deg: float | None = None


class RefusedMessage(OutboundMessage):
    """A frame was refused: why, and its sequence if it has one."""

    kind: Literal["refused"] = "refused"
    sentence: str
    sequence: int | None = None


class AckMessage(OutboundMessage):
    """All states of this tractor up to this sequence are recorded."""

    kind: Literal["ack"] = "ack"
    sequence: int


class HeartbeatMessage(OutboundMessage):
    """The fleet manager is alive; sent five times a second. `horizon_s` of a release counts from the last one.

    A tractor that hears nothing for a second stops at once if it is driven by remote control or follows another one,
    else after the `horizon_s` of its release.

    `clock_s` is a monotonic clock: a heartbeat a second later than the fastest of its link was delayed and does not
    count.
    """

    kind: Literal["heartbeat"] = "heartbeat"
    time: str
    clock_s: float


class ReleaseMessage(OutboundMessage):
    """The first `base_end` of `horizon_end` legs may be driven (base and horizon of VDA 5050); `limit_mps` is the
    highest speed behind a leader.

    A tractor that hears nothing for `horizon_s` stops wherever it is on them. Every frame in time renews that, also a
    heartbeat. These are seconds of real time, also where tractors run `times` as fast. A later frame over the same link
    sets it in motion again; over a new link it waits for a new order.
    """

    kind: Literal["release"] = "release"
    update: int
    base_end: int
    horizon_end: int
    limit_mps: float | None = None
    horizon_s: float


class CommandMessage(OutboundMessage):
    """Drive by remote control."""

    kind: Literal["command"] = "command"
    sequence: int
    steering_command_deg: float
    speed_command_mps: float
    shuttle: int
    start: int


class StopMessage(OutboundMessage):
    """Stop at once."""

    kind: Literal["stop"] = "stop"
    reason: str = ""


class ResumeMessage(OutboundMessage):
    """Drive the base legs."""

    kind: Literal["resume"] = "resume"


class PlanMessage(OutboundMessage):
    """Legs after the base are new."""

    kind: Literal["plan"] = "plan"
    version: int
    base_end: int
    plan: dict[str, Any]


class LeaseMessage(OutboundMessage):
    """Who drives a tractor."""

    kind: Literal["lease"] = "lease"
    tractor: int
    holder: str | None
    is_yours: bool


class SceneTractor(OutboundMessage):
    """One tractor of the scene."""

    tractor: int
    legs: list[dict[str, Any]]
    boxes_m: dict[str, float]
    antenna_forward_m: float
    wheelbase_m: float
    max_steering_deg: float


class SceneMessage(OutboundMessage):
    """What changes rarely: field, obstacles, machines and legs."""

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


class TickTractor(OutboundMessage):
    """One tractor of a tick; `time` and pose are those of its last state.

    `possible_area` is the circle that it may be in while it is in doubt: easting_m, northing_m, radius_m, growth_mps.
    """

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
    base_end: int
    waits_for: list[dict[str, int]]
    eta_s: float | None
    late_s: float | None
    error_m: float | None
    error_deg: float | None
    done_pct: float
    possible_area: dict[str, float] | None


class TickFleet(OutboundMessage):
    """The fleet in a tick; ETA and deadline in seconds from now."""

    state: Literal["ready", "running", "stopped", "done"]
    eta_s: float | None
    done_pct: float
    done_m2: float
    deadline_s: float | None
    probability: float | None


class TickMessage(OutboundMessage):
    """Tractors that have changed since the last tick, and all once a second."""

    kind: Literal["tick"] = "tick"
    time: str
    tractors: list[TickTractor]
    fleet: TickFleet


class CoverageMessage(OutboundMessage):
    """The line worked by a tractor after its `first` points; null where the implement was lifted."""

    kind: Literal["coverage"] = "coverage"
    tractor: int
    first: int
    points: list[list[float] | None]


class AlarmItem(OutboundMessage):
    """One alarm. `code` is its kind:

    - astray: a tractor reports a place where it cannot be
    - broken: its link is broken; the sentence says what it does now
    - clock: its clock is wrong, and its times are corrected
    - contradiction: its positions, speed and progress contradict each other; it is held until somebody resumes it
    - doubt, finding, leap: its twin does not match it, the cause of that, its position jumps
    - drives on: it was ordered to stop and does not, by its speed or by its positions
    - error: it reports errors
    - failed: it drives no more
    - fence: it will leave the fence
    - late: its states arrive late
    - near, near fleet: it comes too near tractor `related_number` of its own fleet, or of another one
    - neighbour stopped: stop-all of this fleet stopped its neighbours, or the other way round; without tractor
    - obstacle: the obstacle `related_number` is in the way; without tractor
    - replaced: another link claims to be this tractor; the previous one was ordered to stop and closed
    - restarted: the service restarted, and all tractors stand until they are resumed; without tractor
    - unknown ground: the distance to another fleet is unknown; without tractor. While it is critical and nobody has
      acknowledged it, this fleet does not move
    - unread obstacle: it stands because of an unreadable obstacle, and resumes once this is acknowledged
    - unrecorded: the database cannot be reached, nothing is recorded; without tractor

    The cause of an alarm that is `over` has gone; it is shown until somebody has `acknowledged` it (who did).
    """

    id: int
    code: AlarmCode
    related_number: int | None
    level: Literal["warning", "critical"]
    tractor: int | None
    sentence: str
    since: str
    acknowledged: str | None
    over: bool


class AlarmsMessage(OutboundMessage):
    """All alarms that are on or not yet acknowledged."""

    kind: Literal["alarms"] = "alarms"
    items: list[AlarmItem]


class ProposalMessage(OutboundMessage):
    """A new plan for the remaining work; `eta_s` is simulated, `tractors` have the new legs for the map.

    `reassigned_m` of work are planned anew; `unreachable_m` cannot be reached or are not worth the drive, `blocked_m`
    are blocked.
    """

    kind: Literal["proposal"] = "proposal"
    id: int
    state: Literal["planning", "ready", "failed", "accepted"]
    without: list[int]
    eta_s: float | None = None
    reassigned_m: float | None = None
    unreachable_m: float | None = None
    blocked_m: float | None = None
    sentence: str | None = None
    tractors: list[dict[str, Any]] = []


class EventMessage(OutboundMessage):
    """An event of the log: who did what."""

    kind: Literal["event"] = "event"
    time: str
    who: str
    what: str
    data: dict[str, Any]


def list_outbound_messages() -> tuple[type[OutboundMessage], ...]:
    """The frames that the service sends, in the order of this module; their parts have no kind."""
    return tuple(model for model in OutboundMessage.__subclasses__() if "kind" in model.model_fields)
