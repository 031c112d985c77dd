"""Frames that clients send; strict: unknown keys, values out of range and endless lists are refused.

Tractors are numbered from 1, legs from 0. Metres are eastings and northings in the coordinate system of the plan,
angles are degrees: headings clockwise from north, steering positive to the right.
"""

from __future__ import annotations

import re
from typing import Annotated, Any, Literal

from pydantic import AwareDatetime, BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from planner.request.validation import describe_fault, format_location

LARGEST_FRAME = 64 * 1024
VERSION = 1
MOST_TRACTORS = 999
OBSTACLE_PATTERN = re.compile(r'"kind"\s*:\s*"obstacle"|"polygon_m"\s*:')


class InboundFrame(BaseModel):
    """Any frame of a client."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


def _build_range_field(low: float, high: float) -> Any:
    return Field(ge=low, le=high, allow_inf_nan=False)


BoundedMetres = Annotated[float, _build_range_field(-1e8, 1e8)]
Heading = Annotated[float, _build_range_field(-360.0, 720.0)]
Steering = Annotated[float, _build_range_field(-90.0, 90.0)]
Speed = Annotated[float, _build_range_field(-50.0, 50.0)]
PLAIN_TEXT = r"^[^\x00-\x1f\x7f]*$"
"""No control characters: some databases cannot hold NUL, and logs have one line per entry."""
ShortText = Annotated[str, Field(min_length=1, max_length=80, pattern=PLAIN_TEXT)]
SequenceNumber = Annotated[int, Field(ge=0, le=2**53)]
TractorNumber = Annotated[int, Field(ge=1, le=MOST_TRACTORS)]
Corner = Annotated[list[BoundedMetres], Field(min_length=2, max_length=2)]
Polygon = Annotated[list[Corner], Field(min_length=3, max_length=200)]


class ConnectFrame(InboundFrame):
    """The first frame of every client."""

    kind: Literal["connect"]
    role: Literal["tractor", "twin", "control", "viewer"]
    version: Literal[1]
    tractor: TractorNumber | None = None
    token: Annotated[str, Field(max_length=200)] | None = None
    name: ShortText | None = None


class StateFrame(InboundFrame):
    """The state of a tractor: the fields of the thesis (5.2.2), and those that VDA 5050 needs in a state (6.6).

    `heartbeat_s` is the `clock_s` of the last heartbeat on this link, at first of the welcome. With it the service can
    tell a wrong clock from a slow link; without it a tractor whose clock is seconds off cannot be driven remotely.
    """

    kind: Literal["state"]
    id: ShortText
    sequence: SequenceNumber
    time: AwareDatetime
    easting_m: BoundedMetres
    northing_m: BoundedMetres
    heading_deg: Heading
    speed_mps: Annotated[float, _build_range_field(0.0, 50.0)]
    speed_command_mps: Speed
    steering_command_deg: Steering
    steering_deg: Steering | None = None
    shuttle: Literal[-1, 0, 1]
    start: Literal[0, 1]
    mode: Literal["automatic", "remote", "manual", "stopped"]
    leg: Annotated[int, Field(ge=0, le=10**6)]
    leg_m: Annotated[float, _build_range_field(-10.0, 1e6)]
    implement: Literal[0, 1]
    update: Annotated[int, Field(ge=0)] = 0
    done: bool = False
    heartbeat_s: Annotated[float, _build_range_field(0.0, 1e12)] | None = None
    errors: Annotated[tuple[Annotated[str, Field(max_length=200, pattern=PLAIN_TEXT)], ...], Field(max_length=10)] = ()


class DisconnectFrame(InboundFrame):
    """A client disconnects; without this frame its connection counts as broken."""

    kind: Literal["disconnect"]


class ObstacleFrame(InboundFrame):
    """An obstacle.

    If the frame of a tractor is refused, the tractor stands until an operator has looked, or it sends a readable one.
    """

    kind: Literal["obstacle"]
    polygon_m: Polygon
    name: ShortText = "obstacle"
    sequence: SequenceNumber | None = None


class _OrderFrame(InboundFrame):
    sequence: SequenceNumber | None = None


class TakeLeaseFrame(_OrderFrame):
    """Drive a tractor by remote control."""

    kind: Literal["lease"]
    tractor: TractorNumber
    takeover: bool = False


class ReturnLeaseFrame(_OrderFrame):
    """Give a tractor back; it stands until it is resumed."""

    kind: Literal["leave"]
    tractor: TractorNumber


class CommandFrame(InboundFrame):
    """A command to drive a leased tractor; send it at least every half second.

    `sequence` increases within a lease, `time` is of the service's clock (`server_time` of the welcome). A command
    older than half a second, or than a previous one, is ignored unless it means stop.
    """

    kind: Literal["command"]
    sequence: SequenceNumber
    time: AwareDatetime
    tractor: TractorNumber
    steering_command_deg: Steering
    speed_command_mps: Speed
    shuttle: Literal[-1, 0, 1] | None = None
    start: Literal[0, 1] | None = None


class StopAllFrame(_OrderFrame):
    """Stop all tractors."""

    kind: Literal["stop_all"]


class StartFrame(_OrderFrame):
    """Start the fleet. With `time` (service's clock) it is refused if it arrives more than two seconds late."""

    kind: Literal["start"]
    time: AwareDatetime | None = None


class PauseFrame(_OrderFrame):
    """Pause one tractor, or all."""

    kind: Literal["pause"]
    tractor: TractorNumber | None = None


class ResumeFrame(_OrderFrame):
    """Resume one tractor, or all. With `time` (service's clock) it is refused if it arrives more than two seconds late.

    Within a second of a stop by somebody else it is always refused, as the sender cannot have seen that stop.
    """

    kind: Literal["resume"]
    time: AwareDatetime | None = None
    tractor: TractorNumber | None = None


class ClearFrame(_OrderFrame):
    """Remove an obstacle."""

    kind: Literal["clear"]
    obstacle: Annotated[int, Field(ge=1)]


class AcknowledgeFrame(_OrderFrame):
    """Acknowledge an alarm.

    For an unreadable obstacle that resumes its tractor, and for an unknown distance from other fleets that keeps this
    one from moving it lets it move: with `time` (service's clock) it is then refused if it arrives
    more than two seconds late, and for an obstacle always within a second of the tractor's report.
    """

    kind: Literal["acknowledge"]
    time: AwareDatetime | None = None
    alarm: Annotated[int, Field(ge=1)]


class FailFrame(_OrderFrame):
    """Mark a tractor as failed."""

    kind: Literal["fail"]
    tractor: TractorNumber


class RecoverFrame(_OrderFrame):
    """A failed tractor works again; it stands until it is resumed."""

    kind: Literal["recover"]
    tractor: TractorNumber


class ReplanFrame(_OrderFrame):
    """Plan all that is left anew, from here on, without these tractors."""

    kind: Literal["replan"]
    without: Annotated[list[TractorNumber], Field(max_length=MOST_TRACTORS)] = []


class AcceptFrame(_OrderFrame):
    """Accept a proposal."""

    kind: Literal["accept"]
    proposal: Annotated[int, Field(ge=1)]


OrderFrame = (
    TakeLeaseFrame | ReturnLeaseFrame | CommandFrame | StopAllFrame | StartFrame | PauseFrame | ResumeFrame
    | ObstacleFrame | ClearFrame | AcknowledgeFrame | FailFrame | RecoverFrame | ReplanFrame | AcceptFrame
)  # fmt: skip
FromTractor = StateFrame | ObstacleFrame | DisconnectFrame
FromControl = OrderFrame | DisconnectFrame
FromViewer = DisconnectFrame

FRAMES_OF_ROLE: dict[str, TypeAdapter[Any]] = {
    "tractor": TypeAdapter(Annotated[FromTractor, Field(discriminator="kind")]),
    "control": TypeAdapter(Annotated[FromControl, Field(discriminator="kind")]),
    "viewer": TypeAdapter(FromViewer),
    "twin": TypeAdapter(FromViewer),
}
CONNECT: TypeAdapter[ConnectFrame] = TypeAdapter(ConnectFrame)


def is_about_obstacle(text: str) -> bool:
    """Whether an unusable frame of a tractor, even a truncated one, is about an obstacle."""
    return OBSTACLE_PATTERN.search(text, 0, LARGEST_FRAME) is not None


def describe_frame_fault(error: ValidationError) -> str:
    """The first fault of a frame as one sentence."""
    fault = error.errors(include_url=False)[0]
    place = fault["loc"][1:] if len(fault["loc"]) > 1 else fault["loc"]
    return f"The frame cannot be used: {describe_fault(fault, format_location(place) or 'it')}"
