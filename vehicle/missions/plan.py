"""Plans: a mission per tractor, made of legs to drive one after another, and gates that hold a tractor back.

A plan is data: the simulation executes any plan, and a plan can be saved, drawn and compared. Every leg says what it is
for (LegTask), so that nothing has to be guessed from the legs around it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from fields.arrays import Floats, cut_line
from vehicle.errors import MissionError
from vehicle.model.ground import list_ground_names

SWATH, HEADLAND_PASS, TURN, ROUTE = "track", "round", "turn", "way"
DRIVE_IN, DRIVE, REFILL, ENTER, LEAVE = "drive-in", "drive", "refill", "enter", "leave"
TASKS = (SWATH, HEADLAND_PASS, TURN, ROUTE, DRIVE_IN, DRIVE, ENTER, LEAVE, REFILL)
MAX_JOINT_GAP_M = 0.1  # ends of consecutive legs may differ by this much
GATE_MARGIN_M = 0.2  # gates open this far before the end of a leg: tractors stop a little short of it


@dataclass(frozen=True)
class LegGate:
    """Start the leg only when tractor `tractor` has driven `after_m` metres of its leg `leg`."""

    tractor: int
    leg: int
    after_m: float = 0.0

    @classmethod
    def place(cls, tractor: int, leg: int, length_m: float, after_m: float = math.inf) -> LegGate:
        """A gate on a leg of a length, just before its end at the farthest; to the micrometre, as processors differ."""
        return cls(tractor, leg, round(max(0.0, min(after_m, length_m - GATE_MARGIN_M)), 6))

    @classmethod
    def end(cls, tractor: int, leg: int, length_m: float) -> LegGate:
        """A gate past the end of the last leg of a tractor, of a length, which opens when that tractor is done."""
        return cls(tractor, leg, round(length_m + 0.25 * MAX_JOINT_GAP_M, 6))

    def compute_opening_m(self, leg_start_m: float, legs: Sequence[Leg]) -> float:
        """The progress (m) at which it opens, by where its leg begins; infinite past the end of the last of `legs`."""
        is_past = self.leg == len(legs) - 1 and self.after_m > legs[self.leg].length_m
        return math.inf if is_past else leg_start_m + self.after_m


@dataclass(frozen=True)
class FollowOrder:
    """While tractor `tractor` is on its leg `leg`, keep `gap_m` behind it (Eq. 6.1)."""

    tractor: int
    leg: int
    gap_m: float = 10.0


@dataclass(frozen=True)
class LegTask:
    """What a leg is for.

    `kind` is "track" (working a swath), "round" (working a headland pass), "turn" (to the next swath, in one go), "way"
    (a longer route to it), "drive-in" (from the headland line until the implement is over it), "enter" (from the
    entrance of the field to where work begins), "leave" (back to the entrance), "refill" (to where the tank is filled)
    or "drive" (anything else). `number` is the swath or headland pass that is worked or driven to, None where there is
    none; `piece` counts the pieces of an interrupted swath or the sides of a headland pass, and `is_piece` is whether
    the layout has several.
    """

    kind: str = DRIVE
    number: int | None = None
    piece: int = 0
    is_piece: bool = field(default=False, compare=False)

    @property
    def is_work(self) -> bool:
        """Whether the leg is work: guidance then uses the lookahead of swaths."""
        return self.kind in (SWATH, HEADLAND_PASS)

    @property
    def whole(self) -> LegTask:
        """The same for all pieces of its swath, or all sides of its headland pass."""
        return LegTask(self.kind, self.number)

    def has_same_goal(self, task: LegTask) -> bool:
        """Whether both work or lead to the same swath or headland pass."""
        return (self.number, self.piece) == (task.number, task.piece)


@dataclass(frozen=True, eq=False)
class Leg:
    """A polyline (n, 2) in metres to be driven in one gear at one target speed.

    `gear` is 1 or -1; `implement` is whether the implement works. `may_wait` marks a hold point: a tractor that gives
    way may wait before this leg, where it blocks nobody. Once the gates are open the tractor stands for `stand_s`
    seconds before the leg, to refill or unload, and for `fold_s` to fold or unfold the implement. `folded` is whether
    that is folded on the leg.
    """

    points: Floats
    speed_mps: float
    gear: int = 1
    implement: bool = False
    ground: str = "soil"
    task: LegTask = LegTask()
    may_wait: bool = False
    gates: tuple[LegGate, ...] = ()
    follow: FollowOrder | None = None
    stand_s: float = 0.0
    fold_s: float = 0.0
    folded: bool = False

    @cached_property
    def length_m(self) -> float:
        """Length of the polyline."""
        steps = self.points[1:] - self.points[:-1]
        return float(np.hypot(steps[:, 0], steps[:, 1]).sum())

    @property
    def standing_s(self) -> float:
        """How long the tractor stands before the leg, to be served and to fold or unfold (s)."""
        return self.stand_s + self.fold_s

    @cached_property
    def ends(self) -> tuple[float, float, float, float]:
        """x and y of the first point, then of the last."""
        (x0, y0), (x1, y1) = self.points[[0, -1]].tolist()
        return x0, y0, x1, y1

    @cached_property
    def fault(self) -> str:
        """Why the leg cannot be driven, whatever the legs around it; "" if it can."""
        return _find_leg_fault(self)

    def copy_with_length(self, length_m: float) -> Leg:
        """This leg with a length that is known already, such as after cutting it, instead of one to be measured."""
        self.__dict__["length_m"] = length_m
        return self

    def copy_with(self, **changes: Any) -> Leg:
        """The same leg with other values of anything but its points, so that it is not measured again."""
        leg = replace(self, points=self.points, **changes)
        leg.__dict__.update((name, self.__dict__[name]) for name in ("length_m", "ends") if name in self.__dict__)
        return leg

    def cut(self, first_m: float, last_m: float) -> Leg:
        """The part between two distances along it (m); gates, hold point and stops stay with its first part."""
        if first_m <= 0.0 and last_m >= self.length_m:
            return self
        part = replace(self, points=cut_line(self.points, max(first_m, 0.0), min(last_m, self.length_m)))
        return part if first_m <= 0.0 else part.copy_with(gates=(), may_wait=False, stand_s=0.0, fold_s=0.0)

    def copy_with_gates(self, gates: Iterable[LegGate]) -> Leg:
        """The same leg with further gates."""
        return self.copy_with(gates=self.gates + tuple(gates))


@dataclass(frozen=True)
class Mission:
    """The legs of one tractor, in order. It starts at the first point, facing along the first segment.

    A tractor that enters the field blocks nobody before it begins, one that leaves it blocks nobody once it is done.
    """

    legs: tuple[Leg, ...]

    @property
    def enters(self) -> bool:
        """Whether the tractor comes through the entrance."""
        return self.legs[0].task.kind == ENTER

    @property
    def leaves(self) -> bool:
        """Whether it goes through the entrance at the end."""
        return self.legs[-1].task.kind == LEAVE

    @property
    def works(self) -> bool:
        """Whether it works a line."""
        return any(leg.task.is_work for leg in self.legs)

    @property
    def rests(self) -> bool:
        """Whether the tractor begins with a stand, with nothing to do but to drive out of the way of others."""
        is_stand = self.legs[0].task.kind == DRIVE and self.legs[0].length_m < MAX_JOINT_GAP_M
        return is_stand and not (self.leaves or self.works)

    @property
    def start(self) -> tuple[float, float, float]:
        """x, y and heading (mathematical angle) at the start."""
        first = self.legs[0]
        (x, y), (x1, y1) = first.points[0], first.points[1]
        heading = math.atan2(first.gear * (y1 - y), first.gear * (x1 - x))
        return float(x), float(y), heading

    @property
    def end(self) -> tuple[float, float, float]:
        """x, y and heading at the end, facing along the last segment."""
        last = self.legs[-1]
        (x0, y0), (x, y) = last.points[-2], last.points[-1]
        return float(x), float(y), math.atan2(last.gear * (y - y0), last.gear * (x - x0))


@dataclass(frozen=True)
class NotedStop:
    """What a tractor takes in or hands over where it stands before a leg: units of the implement, or kWh.

    `lon` and `lat` (degrees) are given where the field has a coordinate system.
    """

    tractor: int
    leg: int
    amount: float
    x_m: float
    y_m: float
    lon: float | None = None
    lat: float | None = None


@dataclass(frozen=True)
class PlanNotes:
    """What is known of a plan besides its legs; a tractor without them drives the same.

    Attributes:
        strategy: its name; "" if unknown.
        headland: the order of headland and swaths; "" if either does.
        tractors: how many were asked for, of which some may rest; None for one per mission.
        stops: those to be filled, emptied or charged; None where nothing is carried.
        collects: whether a tractor is emptied at its stops.
        service: what is done at the stops.
        formation_pct: the share of the tracks that is worked side by side; None where none is asked for.
        apart: the tractors that work the rest of them.
        loosened: legs before which a tractor no longer waits, as all would wait for one another.
        others: further entries of its file, which nothing here reads.
    """

    strategy: str = ""
    headland: str = ""
    tractors: int | None = None
    stops: tuple[NotedStop, ...] | None = None
    collects: bool = False
    service: str = REFILL
    formation_pct: float | None = None
    apart: tuple[int, ...] = ()
    loosened: int = 0
    others: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Plan:
    """One mission per tractor, and what is known of it besides."""

    missions: tuple[Mission, ...]
    notes: PlanNotes = PlanNotes()

    @property
    def tractors(self) -> int:
        """Number of tractors."""
        return len(self.missions)

    @property
    def resting(self) -> tuple[int, ...]:
        """Numbers, from 1, of the tractors that work nothing while others work."""
        works = [mission.works for mission in self.missions]
        return tuple(number for number, one in enumerate(works, start=1) if any(works) and not one)

    def copy_with_gate(self, tractor: int, leg: int, gate: LegGate) -> Plan:
        """The same plan with one more gate."""
        legs, missions = list(self.missions[tractor].legs), list(self.missions)
        legs[leg] = legs[leg].copy_with_gates([gate])
        missions[tractor] = Mission(tuple(legs))
        return replace(self, missions=tuple(missions))


def check_plan(plan: Plan) -> None:
    """Raise MissionError at the first leg or gate that cannot be executed."""
    if not plan.missions:
        raise MissionError("The plan has no tractor; it needs at least one.")
    for number, mission in enumerate(plan.missions):
        if not mission.legs:
            raise MissionError(f"Tractor {number} has no legs; give it at least one or leave it out.")
        for index, leg in enumerate(mission.legs):
            where = f"Tractor {number}, leg {index}"
            if leg.fault:
                raise MissionError(f"{where}: {leg.fault}")
            if leg.gates or leg.follow:
                _check_leg_references(plan, number, leg, where)
            gap_m = math.dist(mission.legs[index - 1].ends[2:], leg.ends[:2]) if index else 0.0
            if gap_m > MAX_JOINT_GAP_M:
                raise MissionError(
                    f"{where}: starts {gap_m:.2f} m from where the leg before ends; they must meet within "
                    f"{MAX_JOINT_GAP_M} m."
                )


def _find_leg_fault(leg: Leg) -> str:
    points = leg.points
    if points.ndim != 2 or points.shape[1] != 2 or len(points) < 2:
        return f"points have shape {points.shape}; a leg needs two or more (x, y) points."
    if not np.isfinite(points).all():
        return "a coordinate is not a number; every point needs finite metres."
    if leg.length_m < 1e-3:
        return f"the leg is {leg.length_m:.4f} m long; it must be at least 1 mm."
    if np.hypot(*(points[1] - points[0])) < 1e-6:
        return "the first two points coincide, which gives no direction; leave one out."
    if leg.gear not in (1, -1):
        return f"gear {leg.gear} is unknown; use 1 (forward) or -1 (reverse)."
    if not (leg.speed_mps > 0 and math.isfinite(leg.speed_mps)):
        return f"speed {leg.speed_mps} m/s is not above 0; gear -1 drives backwards."
    for stop_s in (leg.stand_s, leg.fold_s):
        if not (stop_s >= 0 and math.isfinite(stop_s)):
            return f"a stop of {stop_s} s before the leg is not a time; use 0 or more."
    if leg.ground not in list_ground_names():
        return f"ground {leg.ground!r} is unknown; use one of: {', '.join(list_ground_names())}."
    if leg.follow and not (leg.follow.gap_m > 0 and math.isfinite(leg.follow.gap_m)):
        return f"a follow gap of {leg.follow.gap_m} m is not a distance; use one above 0."
    if leg.folded and leg.implement:
        return "the implement works while it is folded; it can do one of both."
    task = leg.task
    if task.kind not in TASKS:
        return f"task {task.kind!r} is unknown; use one of: {', '.join(TASKS)}."
    if (task.number is not None and task.number < 0) or task.piece < 0:
        return f"task {task.kind!r} has number {task.number} and piece {task.piece}; both count from 0."
    return ""


def _check_leg_references(plan: Plan, tractor: int, leg: Leg, where: str) -> None:
    links: list[LegGate | FollowOrder] = [*leg.gates, *([leg.follow] if leg.follow else [])]
    for link in links:
        if not 0 <= link.tractor < plan.tractors or link.tractor == tractor:
            raise MissionError(f"{where}: refers to tractor {link.tractor}; name another tractor of this plan.")
        if not 0 <= link.leg < len(plan.missions[link.tractor].legs):
            raise MissionError(f"{where}: refers to leg {link.leg} of tractor {link.tractor}, which has no such leg.")
    for gate in leg.gates:
        length = plan.missions[gate.tractor].legs[gate.leg].length_m
        if not -1e-9 <= gate.after_m <= length + MAX_JOINT_GAP_M:
            raise MissionError(
                f"{where}: waits for {gate.after_m} m of leg {gate.leg} of tractor {gate.tractor}, "
                f"which is {length:.2f} m long; use a distance on that leg."
            )
