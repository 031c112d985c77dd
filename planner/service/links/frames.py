"""Frames of clients of the link, which are strict: nothing unknown, nothing out of range, nothing endless passes.

Tractors are numbered from 1, legs from 0. Metres are eastings and northings in the coordinate system of the plan,
angles are degrees: headings clockwise from north, steering positive to the right.
"""

from __future__ import annotations

import re
from typing import Annotated, Any, Literal

from pydantic import AwareDatetime, BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from planner.service.faults import place_of, told_of

LARGEST_FRAME = 64 * 1024
VERSION = 1
MOST_TRACTORS = 999
OBSTACLE_NAMED = re.compile(r'"kind"\s*:\s*"obstacle"|"polygon_m"\s*:')


class Frame(BaseModel):
    """Any frame."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


def _number(low: float, high: float) -> Any:
    return Field(ge=low, le=high, allow_inf_nan=False)


Metres = Annotated[float, _number(-1e8, 1e8)]
Heading = Annotated[float, _number(-360.0, 720.0)]
Steering = Annotated[float, _number(-90.0, 90.0)]
Speed = Annotated[float, _number(-50.0, 50.0)]
PLAIN = r"^[^\x00-\x1f\x7f]*$"
"""Without control characters: not every database can hold a NUL, and no line of a log is broken."""
Word = Annotated[str, Field(min_length=1, max_length=80, pattern=PLAIN)]
Sequence = Annotated[int, Field(ge=0, le=2**53)]
Number = Annotated[int, Field(ge=1, le=MOST_TRACTORS)]
Corner = Annotated[list[Metres], Field(min_length=2, max_length=2)]
Polygon = Annotated[list[Corner], Field(min_length=3, max_length=200)]


class Hello(Frame):
    """The first frame of every client."""

    kind: Literal["hello"]
    role: Literal["tractor", "twin", "control", "viewer"]
    version: Literal[1]
    tractor: Number | None = None
    token: Annotated[str, Field(max_length=200)] | None = None
    name: Word | None = None


class State(Frame):
    """A tractor says where it is: the fields of the thesis (5.2.2), and what VDA 5050 asks of a state (6.6)."""

    kind: Literal["state"]
    id: Word
    sequence: Sequence
    time: AwareDatetime
    easting_m: Metres
    northing_m: Metres
    heading_deg: Heading
    speed_mps: Annotated[float, _number(0.0, 50.0)]
    speed_command_mps: Speed
    steering_command_deg: Steering
    steering_deg: Steering | None = None
    shuttle: Literal[-1, 0, 1]
    start: Literal[0, 1]
    mode: Literal["automatic", "remote", "manual", "stopped"]
    leg: Annotated[int, Field(ge=0, le=10**6)]
    leg_m: Annotated[float, _number(-10.0, 1e6)]
    implement: Literal[0, 1]
    update: Annotated[int, Field(ge=0)] = 0
    done: bool = False
    errors: Annotated[list[Annotated[str, Field(max_length=200, pattern=PLAIN)]], Field(max_length=10)] = []


class Goodbye(Frame):
    """A client goes; without it the connection counts as broken."""

    kind: Literal["goodbye"]


class ObstacleSeen(Frame):
    """Something stands there.

    A tractor that tells of it in a frame that is refused stands until an operator has looked, or it tells of one that
    can be read.
    """

    kind: Literal["obstacle"]
    polygon_m: Polygon
    name: Word = "obstacle"
    sequence: Sequence | None = None


class _Order(Frame):
    sequence: Sequence | None = None


class TakeLease(_Order):
    """Drive a tractor by remote control."""

    kind: Literal["lease"]
    tractor: Number
    takeover: bool = False


class Leave(_Order):
    """Give a tractor back; it stands until it is resumed."""

    kind: Literal["leave"]
    tractor: Number


class Drive(Frame):
    """How a leased tractor is to be driven; to be sent again at least every half second.

    `sequence` rises from command to command of a lease, `time` is that of the service's clock (`server_time` of the
    welcome). One that is older than half a second, or than one before, is not carried out unless it says stand.
    """

    kind: Literal["command"]
    sequence: Sequence
    time: AwareDatetime
    tractor: Number
    steering_command_deg: Steering
    speed_command_mps: Speed
    shuttle: Literal[-1, 0, 1] | None = None
    start: Literal[0, 1] | None = None


class StopAll(_Order):
    """Everybody stands."""

    kind: Literal["stop_all"]


class Begin(_Order):
    """The fleet starts. With its `time` by the service's clock it is refused when it comes two seconds late."""

    kind: Literal["start"]
    time: AwareDatetime | None = None


class Pause(_Order):
    """One tractor stands, or all."""

    kind: Literal["pause"]
    tractor: Number | None = None


class GoOn(_Order):
    """One tractor goes on, or all. With its `time` by the service's clock it is refused when it comes two seconds late.

    Within a second after somebody else has told them to stand it is refused in any case: who orders it cannot know.
    """

    kind: Literal["resume"]
    time: AwareDatetime | None = None
    tractor: Number | None = None


class Clear(_Order):
    """An obstacle is gone."""

    kind: Literal["clear"]
    obstacle: Annotated[int, Field(ge=1)]


class Acknowledge(_Order):
    """An alarm was seen.

    That of an obstacle that cannot be read lets its tractor go on: with its `time` by the service's clock it is then
    refused when it comes two seconds late, and within a second after the tractor has told of it in any case.
    """

    kind: Literal["acknowledge"]
    time: AwareDatetime | None = None
    alarm: Annotated[int, Field(ge=1)]


class Fail(_Order):
    """A tractor drives no more."""

    kind: Literal["fail"]
    tractor: Number


class Repaired(_Order):
    """A tractor that has failed can drive again; it stands until it is resumed."""

    kind: Literal["repaired"]
    tractor: Number


class Replan(_Order):
    """Plan the rest of the tracks of these tractors for the others."""

    kind: Literal["replan"]
    without: Annotated[list[Number], Field(max_length=MOST_TRACTORS)] = []


class Accept(_Order):
    """Go on by a proposal."""

    kind: Literal["accept"]
    proposal: Annotated[int, Field(ge=1)]


Orders = (
    TakeLease | Leave | Drive | StopAll | Begin | Pause | GoOn | ObstacleSeen | Clear | Acknowledge | Fail | Repaired
    | Replan | Accept
)  # fmt: skip
FromTractor = State | ObstacleSeen | Goodbye
FromControl = Orders | Goodbye
FromViewer = Goodbye

OF_ROLE: dict[str, TypeAdapter[Any]] = {
    "tractor": TypeAdapter(Annotated[FromTractor, Field(discriminator="kind")]),
    "control": TypeAdapter(Annotated[FromControl, Field(discriminator="kind")]),
    "viewer": TypeAdapter(FromViewer),
    "twin": TypeAdapter(FromViewer),
}
HELLO: TypeAdapter[Hello] = TypeAdapter(Hello)


def names_obstacle(text: str) -> bool:
    """Whether a frame of a tractor that cannot be used says that it is about an obstacle, even one that is cut off."""
    return OBSTACLE_NAMED.search(text, 0, LARGEST_FRAME) is not None


def told_why(error: ValidationError) -> str:
    """The first fault of a frame in one sentence."""
    fault = error.errors(include_url=False)[0]
    place = fault["loc"][1:] if len(fault["loc"]) > 1 else fault["loc"]
    return f"The frame cannot be used: {told_of(fault, place_of(place) or 'it')}"
