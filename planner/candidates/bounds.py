"""The least time a plan can take: nobody drives faster than asked for, or before the gates let it.

With a pace it is also heeded how soon a tractor gains and loses speed, that it stands and shifts where it changes
direction, and that its antenna gets round a bend a little sooner than its wheels. Whoever gives way in a run of the
plan, it is not done sooner.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, repeat
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


@dataclass(frozen=True)
class _Stretch:
    """A leg as it is driven at best: metres, speed, and speed at its two ends (m/s).

    `before_s` are spent standing before it; less than none where it is slower and is come to a little too fast.
    `stand_s` more it is asked to stand.
    """

    length_m: float
    speed: float
    first: float
    last: float
    mps2: float
    before_s: float
    stand_s: float = 0.0

    @property
    def seconds(self) -> float:
        """From the end of the leg before to the end of this one."""
        return self.stand_s + self._moving_s

    @property
    def _moving_s(self) -> float:
        v, u, w, a = self.speed, self.first, self.last, self.mps2
        if 2.0 * a * self.length_m >= 2.0 * v * v - u * u - w * w:
            return self.before_s + self.length_m / v + ((v - u) ** 2 + (v - w) ** 2) / (2.0 * v * a)
        top = math.sqrt(a * self.length_m + 0.5 * (u * u + w * w))
        return self.before_s + max(2.0 * top - u - w, 0.0) / a

    def reached_s(self, metres: float) -> float:
        """From the end of the leg before until so many metres are driven, at the soonest."""
        if metres <= 0.0:
            return min(self.before_s, 0.0)  # a leg has begun before anything is stood or shifted
        return self.stand_s + self._moved_s(max(min(metres, self.length_m), 0.0))

    def _moved_s(self, metres: float) -> float:
        v, u, a = self.speed, self.first, self.mps2
        if 2.0 * a * metres >= v * v - u * u:
            return self.before_s + metres / v + (v - u) ** 2 / (2.0 * v * a)
        return self.before_s + (math.sqrt(u * u + 2.0 * a * metres) - u) / a


def _stretches(mission: Mission, pace: Pace, saved_m: Sequence[float]) -> list[_Stretch]:
    """The legs of a tractor that nobody keeps waiting, each by so much shorter."""
    legs = mission.legs
    speeds = [pace.faster * leg.speed_mps + pace.push_mps for leg in legs]
    turns = [a.gear != b.gear for a, b in pairwise(legs)]
    lengths = [
        max(leg.length_m - saved - (pace.short_m if stands else 0.0), 0.0)
        for leg, saved, stands in zip(legs, saved_m, [*turns, True], strict=True)
    ]
    limits = [0.0, *(0.0 if back else min(ends) for ends, back in zip(pairwise(speeds), turns, strict=True)), 0.0]
    for n in range(len(legs) - 1, -1, -1):
        gained = _gained(limits[n + 1], lengths[n], pace.mps2)
        if gained < limits[n]:
            limits[n] = gained
    for n in range(len(legs)):
        gained = _gained(limits[n], lengths[n], pace.mps2)
        if gained < limits[n + 1]:
            limits[n + 1] = gained
    before = [0.0, *(
        pace.shift_s if back else -pace.late_s * max(0.0, 1.0 - b / a)
        for (a, b), back in zip(pairwise(speeds), turns, strict=True)
    )]  # fmt: skip
    return [
        _Stretch(length, speed, *ends, pace.mps2, more, leg.stand_s)
        for leg, length, speed, ends, more in zip(legs, lengths, speeds, pairwise(limits), before, strict=True)
    ]


def _gained(speed: float, metres: float, mps2: float) -> float:
    """The speed that is reached from another within so many metres."""
    return math.sqrt(speed * speed + 2.0 * mps2 * metres)


def _saved_m(legs: Sequence[Leg], pace: Pace) -> list[float]:
    """What each of the legs may be shorter for who drives it."""
    saved = [0.0] * len(legs)
    bent = [number for number, leg in enumerate(legs) if len(leg.points) > 2]
    if not pace.bend_m or not bent:
        return saved
    east, north = np.diff(np.concatenate([legs[number].points for number in bent]), axis=0).T
    turns = np.diff(np.arctan2(north, east))
    turned = np.abs((turns + math.pi) % (2.0 * math.pi) - math.pi)
    first = 0
    for number in bent:
        last = first + len(legs[number].points)
        saved[number] = pace.bend_m * float(turned[first : last - 2].sum())
        first = last
    return saved


class _Way(Protocol):
    """A leg that nobody is kept waiting on: seconds from the end of the one before to its end, or to a place on it."""

    @property
    def seconds(self) -> float: ...

    def reached_s(self, metres: float) -> float: ...


@dataclass(frozen=True, eq=False)
class _Driven:
    """A leg as it was driven alone: seconds in all, and metres driven at every row of the record, `step_s` apart."""

    seconds: float
    metres: npt.NDArray[np.float64]
    step_s: float

    def reached_s(self, metres: float) -> float:
        """Seconds until so many metres are driven, or as good as driven."""
        return min(float(np.searchsorted(self.metres, metres - NEAR_M)) * self.step_s, self.seconds)


def _ways_of(mission: Mission, run: Run) -> list[_Driven]:
    """The legs of a tractor as it drove them with nobody else on the field."""
    at, end = run.leg(0), int(np.searchsorted(run.time_s, run.finish_s[0]))
    rows = np.append(np.searchsorted(at[:end], np.arange(len(mission.legs))), end)
    driven = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(run.poses(0)[:, :2], axis=0).T))))
    step_s = float(run.time_s[1])
    return [
        _Driven(float(last - first) * step_s, driven[first:last] - driven[first], step_s)
        for first, last in pairwise(rows.tolist())
    ]


class _Clock:
    """When each tractor begins its legs at the soonest (s): what is known so far."""

    def __init__(self, plan: Plan, ways: Sequence[Sequence[_Way]], saved_m: Sequence[Sequence[float]]) -> None:
        self.missions, self.ways, self.saved_m = plan.missions, ways, saved_m
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
        metres = gate.after_m - self.saved_m[gate.tractor][gate.leg]
        opened = begun[gate.leg] + self.ways[gate.tractor][gate.leg].reached_s(metres)
        self._known[key] = opened
        return opened

    def advance(self, tractor: int) -> bool:
        """Let a tractor drive on to a gate that is not known to open; whether it drove."""
        begun, legs = self.begun[tractor], self.missions[tractor].legs
        before = len(begun)
        ways = self.ways[tractor]
        while len(begun) < len(legs):
            leg = legs[len(begun)]
            if leg.gates and not self._through(tractor, leg.gates):
                break
            begun.append(self.free[tractor])
            self.free[tractor] += ways[len(begun) - 1].seconds
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
    ways = [_stretches(*each) for each in zip(plan.missions, repeat(pace), saved_m)]
    return _done_s(_Clock(plan, ways, [[saved + pace.short_m for saved in each] for each in saved_m]))


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
    ways: dict[int, list[_Driven]] = {}
    order = sorted(range(len(missions)), key=lambda number: (-asked_s(missions[number]), number))
    for number in order:
        run = alone(missions[number])
        if run.outcome != DONE:
            return 0.0
        ways[number] = _ways_of(missions[number], run)
        own_s = OTHERWISE * sum(way.seconds for way in ways[number])
        if own_s > enough_s:
            return own_s
        if number == order[0] and enough_s < math.inf:
            longer = least_s(plan) / asked_s(missions[number])
            if longer <= HARDLY and own_s * longer <= enough_s:
                return own_s
    unsaved = [[0.0] * len(mission.legs) for mission in plan.missions]
    return OTHERWISE * max(_done_s(_Clock(plan, [ways[number] for number in range(len(missions))], unsaved)))


def asked_s(mission: Mission) -> float:
    """Seconds at the speeds that are asked for."""
    return round(math.fsum(leg.length_m / leg.speed_mps for leg in mission.legs), 3)


def ungated(plan: Plan) -> Plan:
    """The plan with nobody waiting for anybody."""
    free = (
        tuple(replace(leg, gates=(), follow=None) if leg.gates or leg.follow else leg for leg in mission.legs)
        for mission in plan.missions
    )
    return Plan(tuple(Mission(legs) for legs in free), plan.notes)
