"""The least time a plan can take: nobody drives faster than asked for, or before the gates let it.

With a pace it is also heeded how soon a tractor gains and loses speed, that it stands and shifts where it changes
direction, and that its antenna gets round a bend a little sooner than its wheels. Whoever gives way in a run of the
plan, it is not done sooner.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Protocol

import numpy as np
import numpy.typing as npt

from vehicle.compile import compile_model
from vehicle.control import ARRIVED_M
from vehicle.missions import Gate, Leg, Mission, Plan
from vehicle.run import DONE, Run
from vehicle.tractor import Implement, Tractor

ASIDE_M = 0.05  # so far inside a bend guidance may be
LATE_S = 0.4  # looks of the controller, and what its speed runs behind
NEAR_M = 1.0  # on a leg: the antenna may be so much farther than the middle of the tractor has been driven
OTHERWISE = 0.999
CLOSE = 0.96  # of what is driven: bounds of a pace come nearer to it
HARDLY = 1.01  # times the slowest alone: where gates make a plan longer, only driving all tells by how much
AT_ONCE = 1e9  # m/s2
Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Pace:
    """What a tractor cannot do sooner.

    It gains and loses `mps2`, takes `shift_s` to change direction, and may be `late_s` in slowing down for a leg.
    It has driven a leg when it stands `short_m` before its end, and saves `bend_m` per radian that a leg turns by. The
    ground lets it be `faster` than asked for, by a factor, and carries it along at `push_mps`. By default only the
    speed counts that is asked for.
    """

    mps2: float = AT_ONCE
    shift_s: float = 0.0
    late_s: float = 0.0
    short_m: float = 0.0
    bend_m: float = 0.0
    faster: float = 1.0
    push_mps: float = 0.0


BARE = Pace()


def pace_of(tractor: Tractor, implement: Implement, radius_m: float) -> Pace:
    """The pace of a tractor whose ways bend no tighter than `radius_m`, where the antenna is."""
    ahead = min(abs(tractor.antenna_forward_m), radius_m)
    wheels_m = math.sqrt(radius_m * radius_m - ahead * ahead)
    model = compile_model(tractor, implement)
    slips = [float(model["slip"]), float(model["tool_slip"])]
    push = math.hypot(float(model["rest_push_to_east"]), float(model["rest_push_to_north"]))
    return Pace(
        tractor.speed.max_acceleration_mps2, tractor.speed.shift_time_s, LATE_S, 2.0 * ARRIVED_M,
        radius_m - wheels_m + ASIDE_M, math.prod(max(1.0, 1.0 - slip) for slip in slips), push,
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Stretches:
    """The legs of a tractor as they are driven at best, each array (n,): metres, speed, speed at both ends (m/s).

    `before_s` are spent standing before a leg; less than none where it is slower and is come to a little too fast.
    `stand_s` more the tractor is asked to stand.
    """

    length_m: Floats
    speed: Floats
    first: Floats
    last: Floats
    mps2: float
    before_s: Floats
    stand_s: Floats

    @cached_property
    def seconds(self) -> list[float]:
        """From the end of the leg before to the end of each."""
        v, u, w, a, metres = self.speed, self.first, self.last, self.mps2, self.length_m
        whole = metres / v + ((v - u) ** 2 + (v - w) ** 2) / (2.0 * v * a)
        top = np.sqrt(a * metres + 0.5 * (u * u + w * w))
        short = np.maximum(2.0 * top - u - w, 0.0) / a
        moving = self.before_s + np.where(2.0 * a * metres >= 2.0 * v * v - u * u - w * w, whole, short)
        return (self.stand_s + moving).tolist()  # type: ignore[no-any-return]

    def reached_s(self, leg: int, metres: float) -> float:
        """From the end of the leg before until so many metres of one are driven, at the soonest."""
        before_s = float(self.before_s[leg])
        if metres <= 0.0:
            return min(before_s, 0.0)  # a leg has begun before anything is stood or shifted
        metres = min(metres, float(self.length_m[leg]))
        v, u, a = float(self.speed[leg]), float(self.first[leg]), self.mps2
        if 2.0 * a * metres >= v * v - u * u:
            moved_s = before_s + metres / v + (v - u) ** 2 / (2.0 * v * a)
        else:
            moved_s = before_s + (math.sqrt(u * u + 2.0 * a * metres) - u) / a
        return float(self.stand_s[leg]) + moved_s


def _stretches(mission: Mission, pace: Pace, saved_m: Floats) -> _Stretches:
    """The legs of a tractor that nobody keeps waiting, each by so much shorter."""
    legs = mission.legs
    asked = np.array([(leg.speed_mps, leg.length_m, leg.stand_s, leg.gear) for leg in legs])
    speeds = pace.faster * asked[:, 0] + pace.push_mps
    turns = asked[1:, 3] != asked[:-1, 3]
    lengths = np.maximum(asked[:, 1] - saved_m - np.where(np.append(turns, True), pace.short_m, 0.0), 0.0)
    through = np.where(turns, 0.0, np.minimum(speeds[:-1], speeds[1:]))
    limits = np.array(_limits([0.0, *through.tolist(), 0.0], (2.0 * pace.mps2 * lengths).tolist()))
    late = -pace.late_s * np.maximum(0.0, 1.0 - speeds[1:] / speeds[:-1])
    before = np.concatenate(([0.0], np.where(turns, pace.shift_s, late)))
    return _Stretches(lengths, speeds, limits[:-1], limits[1:], pace.mps2, before, asked[:, 2])


def _limits(limits: list[float], gains: Sequence[float]) -> list[float]:
    """Speeds at the ends of legs, none of which is above its limit or out of reach of the speeds beside it.

    `gains` is by how much the square of the speed can change on each leg, (m/s)^2.
    """
    for n in range(len(gains) - 1, -1, -1):
        limits[n] = min(limits[n], math.sqrt(limits[n + 1] * limits[n + 1] + gains[n]))
    for n in range(len(gains)):
        limits[n + 1] = min(limits[n + 1], math.sqrt(limits[n] * limits[n] + gains[n]))
    return limits


def _saved_m(legs: Sequence[Leg], pace: Pace) -> Floats:
    """What each of the legs (n,) may be shorter for who drives it."""
    saved = np.zeros(len(legs))
    bent = [number for number, leg in enumerate(legs) if len(leg.points) > 2]
    if not pace.bend_m or not bent:
        return saved
    east, north = np.diff(np.concatenate([legs[number].points for number in bent]), axis=0).T
    turns = np.diff(np.arctan2(north, east))
    turned = np.abs((turns + math.pi) % (2.0 * math.pi) - math.pi)
    last = np.cumsum([len(legs[number].points) for number in bent])
    first = np.concatenate(([0], last[:-1]))
    inner = np.column_stack([first, last - 2]).ravel()  # every other sum is over a joint of two legs
    saved[bent] = pace.bend_m * np.add.reduceat(np.append(turned, 0.0), inner)[::2]
    return saved


class _Ways(Protocol):
    """The legs of a tractor that nobody keeps waiting: seconds from the end of the one before to the end of each."""

    @property
    def seconds(self) -> list[float]: ...

    def reached_s(self, leg: int, metres: float) -> float: ...


@dataclass(frozen=True, eq=False)
class _Driven:
    """Legs as they were driven alone: seconds of each, and its metres driven at every row of a record (`step_s`)."""

    seconds: list[float]
    metres: list[Floats]
    step_s: float

    def reached_s(self, leg: int, metres: float) -> float:
        """Seconds until so many metres of a leg are driven, or as good as driven."""
        return min(float(np.searchsorted(self.metres[leg], metres - NEAR_M)) * self.step_s, self.seconds[leg])


def _ways_of(mission: Mission, run: Run) -> _Driven:
    """The legs of a tractor as it drove them with nobody else on the field."""
    at, end = run.leg(0), int(np.searchsorted(run.time_s, run.finish_s[0]))
    rows = np.append(np.searchsorted(at[:end], np.arange(len(mission.legs))), end).tolist()
    driven = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(run.poses(0)[:, :2], axis=0).T))))
    step_s = float(run.time_s[1])
    return _Driven(
        [float(last - first) * step_s for first, last in pairwise(rows)],
        [driven[first:last] - driven[first] for first, last in pairwise(rows)],
        step_s,
    )


class _Clock:
    """When each tractor begins its legs at the soonest (s): what is known so far."""

    def __init__(self, plan: Plan, ways: Sequence[_Ways], saved_m: Sequence[Floats]) -> None:
        self.ways, self.saved_m = ways, saved_m
        self.gates = [[leg.gates for leg in mission.legs] for mission in plan.missions]
        self.begun: list[list[float]] = [[] for _ in self.ways]
        self.free = [0.0] * len(self.ways)
        # Gates before the coming leg that are known to open, and when the last of them does.
        self._passed = [(0, -math.inf)] * len(self.ways)
        self._known: dict[tuple[int, int, float], float] = {}

    def opened_s(self, gate: Gate) -> float | None:
        """When a gate opens; None where that is not known yet."""
        key = gate.tractor, gate.leg, gate.after_m
        if key in self._known:
            return self._known[key]
        begun = self.begun[gate.tractor]
        if gate.leg >= len(begun):
            return None
        metres = gate.after_m - float(self.saved_m[gate.tractor][gate.leg])
        opened = begun[gate.leg] + self.ways[gate.tractor].reached_s(gate.leg, metres)
        self._known[key] = opened
        return opened

    def advance(self, tractor: int) -> bool:
        """Let a tractor drive on to a gate that is not known to open; whether it drove."""
        begun, seconds, gates = self.begun[tractor], self.ways[tractor].seconds, self.gates[tractor]
        before, free = len(begun), self.free[tractor]
        for leg in range(before, len(seconds)):
            if gates[leg]:
                self.free[tractor] = free
                if not self._through(tractor, gates[leg]):
                    break
                free = self.free[tractor]
            begun.append(free)
            free += seconds[leg]
        self.free[tractor] = free
        return len(begun) > before

    def _through(self, tractor: int, gates: Sequence[Gate]) -> bool:
        """Whether all gates before the coming leg of a tractor are known to open; it is kept waiting until they do."""
        passed, last_s = self._passed[tractor]
        for number in range(passed, len(gates)):
            opened = self.opened_s(gates[number])
            if opened is None:
                self._passed[tractor] = number, last_s
                return False
            last_s = max(last_s, opened)
        self.free[tractor] = max(self.free[tractor], last_s)
        self._passed[tractor] = 0, -math.inf
        return True


def done_s(plan: Plan, pace: Pace = BARE) -> list[float]:
    """Seconds for every tractor before which no run of the plan has it done.

    Where tractors wait for each other and none can go on, what is driven until then counts.
    """
    saved_m = [_saved_m(mission.legs, pace) for mission in plan.missions]
    ways = [_stretches(mission, pace, saved) for mission, saved in zip(plan.missions, saved_m, strict=True)]
    return _done_s(_Clock(plan, ways, [saved + pace.short_m for saved in saved_m]))


def _done_s(clock: _Clock) -> list[float]:
    moved = True
    while moved:
        moved = sum(clock.advance(tractor) for tractor in range(len(clock.free))) > 0
    return clock.free


def least_s(plan: Plan, pace: Pace = BARE) -> float:
    """Seconds before which no run of the plan can be done."""
    return max(done_s(plan, pace))


def alone_s(plan: Plan, alone: Callable[[Mission], Run], enough_s: float = math.inf) -> float:
    """Seconds that a plan takes where nobody waits but as its gates say, from what each tractor drives alone.

    Whoever has to give way as well is not sooner by more than a thousandth, as it may come out of a turn otherwise.
    0 where one does not get home even alone. Once one tractor alone takes more than `enough_s`, which is asked of the
    slowest first, the others are not driven, and what that one takes is returned. So it is where gates
    hardly count, and the plan would not take so long if others were held up on their ways as much as the slowest.
    """
    missions = ungated(plan).missions
    ways: dict[int, _Driven] = {}
    order = sorted(range(len(missions)), key=lambda number: (-asked_s(missions[number]), number))
    for number in order:
        run = alone(missions[number])
        if run.outcome != DONE:
            return 0.0
        ways[number] = _ways_of(missions[number], run)
        own_s = OTHERWISE * sum(ways[number].seconds)
        if own_s > enough_s:
            return own_s
        if number == order[0] and enough_s < math.inf:
            longer = least_s(plan) / asked_s(missions[number])
            if longer <= HARDLY and own_s * longer <= enough_s:
                return own_s
    unsaved = [np.zeros(len(mission.legs)) for mission in plan.missions]
    return OTHERWISE * max(_done_s(_Clock(plan, [ways[number] for number in range(len(missions))], unsaved)))


def asked_s(mission: Mission) -> float:
    """Seconds at the speeds that are asked for."""
    return round(math.fsum(leg.length_m / leg.speed_mps for leg in mission.legs), 3)


def ungated(plan: Plan) -> Plan:
    """The plan with nobody waiting for anybody."""
    free = (
        tuple(leg.linked(gates=(), follow=None) if leg.gates or leg.follow else leg for leg in mission.legs)
        for mission in plan.missions
    )
    return Plan(tuple(Mission(legs) for legs in free), plan.notes)
