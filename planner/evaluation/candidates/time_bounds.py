"""Lower bounds on the time of a plan: no tractor drives faster than planned, or before its gates can be open.

With a pace the bound includes acceleration, standing and shifting where the direction changes, and the shorter path of
the antenna in bends. It holds for every run of the plan, whoever gives way.
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

from vehicle.control.guidance import ARRIVAL_TOLERANCE_M
from vehicle.missions.plan import Leg, LegGate, Mission, Plan
from vehicle.missions.run import DONE, SimulationRun
from vehicle.model.tractor import Implement, Tractor
from vehicle.sim.compile import build_model_record

BEND_OFFSET_M = 0.05  # how far guidance may cut a bend on the inside
CONTROLLER_DELAY_S = 0.4  # control interval, and lag of the speed
ANTENNA_SLACK_M = 1.0  # on a leg: how much farther the antenna may be than the path of the centre
SOLO_FACTOR = 0.999
CLOSE_FACTOR = 0.96  # of the simulated time: bounds from the pace are closer than this
GATE_FACTOR = 1.01  # times the slowest tractor alone: if gates add more, all tractors must be simulated
UNLIMITED_MPS2 = 1e9  # m/s2
Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class SpeedLimits:
    """The limits on how fast a tractor can be; by default only the planned speed.

    It changes speed by `acceleration_mps2`, takes `shift_s` to change direction, and may brake `braking_delay_s` late
    for a leg. A leg counts as driven `end_tolerance_m` before its end, and the antenna saves `bend_saving_m` per radian
    of a bend. The ground lets it drive up to `slip_factor` times faster than planned, and drift at `drift_mps`.
    """

    acceleration_mps2: float = UNLIMITED_MPS2
    shift_s: float = 0.0
    braking_delay_s: float = 0.0
    end_tolerance_m: float = 0.0
    bend_saving_m: float = 0.0
    slip_factor: float = 1.0
    drift_mps: float = 0.0


SPEED_LIMIT_ONLY = SpeedLimits()


def build_speed_limits(tractor: Tractor, implement: Implement, radius_m: float) -> SpeedLimits:
    """The pace of a tractor whose paths, those of the antenna, bend no tighter than `radius_m`."""
    antenna_m = min(abs(tractor.antenna_forward_m), radius_m)
    wheels_m = math.sqrt(radius_m * radius_m - antenna_m * antenna_m)
    model = build_model_record(tractor, implement)
    slips = [float(model["slip"]), float(model["tool_slip"])]
    drift_mps = math.hypot(float(model["discrepancy_push_to_east"]), float(model["discrepancy_push_to_north"]))
    return SpeedLimits(
        tractor.speed.max_acceleration_mps2,
        tractor.speed.shift_time_s,
        CONTROLLER_DELAY_S,
        2.0 * ARRIVAL_TOLERANCE_M,
        radius_m - wheels_m + BEND_OFFSET_M,
        math.prod(max(1.0, 1.0 - slip) for slip in slips),
        drift_mps,
    )


@dataclass(frozen=True, eq=False)
class _BestLegTimes:
    """The legs of a tractor at best, arrays (n,): metres, speed, and speed at both ends (m/s).

    `pre_leg_s` is spent shifting before a leg; it is negative before a slower leg, which may be entered too fast.
    `stand_s` is planned standing.
    """

    length_m: Floats
    speed: Floats
    start_speed: Floats
    end_speed: Floats
    acceleration_mps2: float
    pre_leg_s: Floats
    stand_s: Floats

    @cached_property
    def leg_s(self) -> list[float]:
        """Seconds from the end of the previous leg to the end of each leg."""
        v, u, w, a, metres = self.speed, self.start_speed, self.end_speed, self.acceleration_mps2, self.length_m
        cruising_s = metres / v + ((v - u) ** 2 + (v - w) ** 2) / (2.0 * v * a)
        top = np.sqrt(a * metres + 0.5 * (u * u + w * w))
        accelerating_s = np.maximum(2.0 * top - u - w, 0.0) / a
        moving = self.pre_leg_s + np.where(2.0 * a * metres >= 2.0 * v * v - u * u - w * w, cruising_s, accelerating_s)
        return (self.stand_s + moving).tolist()  # type: ignore[no-any-return]

    def get_seconds_to_distance(self, leg: int, metres: float) -> float:
        """Earliest seconds from the end of the previous leg until this many metres of a leg are driven."""
        before_s = float(self.pre_leg_s[leg])
        if metres <= 0.0:
            return min(before_s, 0.0)  # a leg begins before standing and shifting
        metres = min(metres, float(self.length_m[leg]))
        v, u, a = float(self.speed[leg]), float(self.start_speed[leg]), self.acceleration_mps2
        if 2.0 * a * metres >= v * v - u * u:
            moved_s = before_s + metres / v + (v - u) ** 2 / (2.0 * v * a)
        else:
            moved_s = before_s + (math.sqrt(u * u + 2.0 * a * metres) - u) / a
        return float(self.stand_s[leg]) + moved_s


def _compute_leg_times(mission: Mission, pace: SpeedLimits, saved_m: Floats) -> _BestLegTimes:
    """The legs of a tractor that never waits, each shorter by `saved_m` (n,)."""
    legs = mission.legs
    leg_values = np.array([(leg.speed_mps, leg.length_m, leg.stand_s, leg.gear) for leg in legs])
    speeds = pace.slip_factor * leg_values[:, 0] + pace.drift_mps
    is_reversing = leg_values[1:, 3] != leg_values[:-1, 3]
    lengths = np.maximum(
        leg_values[:, 1] - saved_m - np.where(np.append(is_reversing, True), pace.end_tolerance_m, 0.0), 0.0
    )
    joint_speeds = np.where(is_reversing, 0.0, np.minimum(speeds[:-1], speeds[1:]))
    limits = np.array(
        _limit_speeds([0.0, *joint_speeds.tolist(), 0.0], (2.0 * pace.acceleration_mps2 * lengths).tolist())
    )
    braking_s = -pace.braking_delay_s * np.maximum(0.0, 1.0 - speeds[1:] / speeds[:-1])
    pre_leg_s = np.concatenate(([0.0], np.where(is_reversing, pace.shift_s, braking_s)))
    return _BestLegTimes(lengths, speeds, limits[:-1], limits[1:], pace.acceleration_mps2, pre_leg_s, leg_values[:, 2])


def _limit_speeds(limits: list[float], gains: Sequence[float]) -> list[float]:
    """Speeds at the ends of legs that respect their limits and the acceleration between them.

    `gains` is how much the square of the speed can change on each leg, (m/s)^2.
    """
    for n in range(len(gains) - 1, -1, -1):
        limits[n] = min(limits[n], math.sqrt(limits[n + 1] * limits[n + 1] + gains[n]))
    for n in range(len(gains)):
        limits[n + 1] = min(limits[n + 1], math.sqrt(limits[n] * limits[n] + gains[n]))
    return limits


def _compute_leg_shortening_m(legs: Sequence[Leg], pace: SpeedLimits) -> Floats:
    """How much shorter each of the legs (n,) may be when driven (m)."""
    saved = np.zeros(len(legs))
    bent = [number for number, leg in enumerate(legs) if len(leg.points) > 2]
    if not pace.bend_saving_m or not bent:
        return saved
    east, north = np.diff(np.concatenate([legs[number].points for number in bent]), axis=0).T
    turns = np.diff(np.arctan2(north, east))
    turned = np.abs((turns + math.pi) % (2.0 * math.pi) - math.pi)
    last = np.cumsum([len(legs[number].points) for number in bent])
    first = np.concatenate(([0], last[:-1]))
    inner = np.column_stack([first, last - 2]).ravel()  # every other sum spans a joint of two legs
    saved[bent] = pace.bend_saving_m * np.add.reduceat(np.append(turned, 0.0), inner)[::2]
    return saved


class _LegTiming(Protocol):
    """Times of the legs of a tractor that never waits: seconds from the end of the previous leg to the end of each."""

    @property
    def leg_s(self) -> list[float]: ...

    def get_seconds_to_distance(self, leg: int, metres: float) -> float: ...


@dataclass(frozen=True, eq=False)
class _SimulatedLegs:
    """Legs simulated alone: seconds of each, and metres driven on it at every row of the record (`step_s` apart)."""

    leg_s: list[float]
    driven_m: list[Floats]
    step_s: float

    def get_seconds_to_distance(self, leg: int, metres: float) -> float:
        """Seconds until this many metres of a leg are driven, less ANTENNA_SLACK_M."""
        return min(float(np.searchsorted(self.driven_m[leg], metres - ANTENNA_SLACK_M)) * self.step_s, self.leg_s[leg])


def _read_simulated_legs(mission: Mission, run: SimulationRun) -> _SimulatedLegs:
    """The legs of a tractor as simulated with nobody else on the field."""
    leg_of_row, end = run.get_leg_numbers(0), int(np.searchsorted(run.time_s, run.finish_s[0]))
    rows = np.append(np.searchsorted(leg_of_row[:end], np.arange(len(mission.legs))), end).tolist()
    driven_m = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(run.get_poses(0)[:, :2], axis=0).T))))
    step_s = float(run.time_s[1])
    return _SimulatedLegs(
        [float(last - first) * step_s for first, last in pairwise(rows)],
        [driven_m[first:last] - driven_m[first] for first, last in pairwise(rows)],
        step_s,
    )


class _EarliestTimes:
    """The earliest times (s) at which tractors begin their legs, as far as known."""

    def __init__(self, plan: Plan, timings: Sequence[_LegTiming], saved_m: Sequence[Floats]) -> None:
        self.timings, self.saved_m = timings, saved_m
        self.gates = [[leg.gates for leg in mission.legs] for mission in plan.missions]
        self.begin_times_s: list[list[float]] = [[] for _ in self.timings]
        self.free_s = [0.0] * len(self.timings)
        # Per tractor: gates before its next leg with a known opening, and the last opening so far.
        self._passed_gates = [(0, -math.inf)] * len(self.timings)
        self._opening_times: dict[tuple[int, int, float], float] = {}

    def find_opening_s(self, gate: LegGate) -> float | None:
        """The earliest opening of a gate; None if not known yet."""
        key = gate.tractor, gate.leg, gate.after_m
        if key in self._opening_times:
            return self._opening_times[key]
        begin_times_s = self.begin_times_s[gate.tractor]
        if gate.leg >= len(begin_times_s):
            return None
        metres = gate.after_m - float(self.saved_m[gate.tractor][gate.leg])
        opening_s = begin_times_s[gate.leg] + self.timings[gate.tractor].get_seconds_to_distance(gate.leg, metres)
        self._opening_times[key] = opening_s
        return opening_s

    def advance_tractor(self, tractor: int) -> bool:
        """Let a tractor drive to the next gate without a known opening; returns whether it drove."""
        begin_times_s, seconds, gates = self.begin_times_s[tractor], self.timings[tractor].leg_s, self.gates[tractor]
        begun_count, free_s = len(begin_times_s), self.free_s[tractor]
        for leg in range(begun_count, len(seconds)):
            if gates[leg]:
                self.free_s[tractor] = free_s
                if not self._pass_gates(tractor, gates[leg]):
                    break
                free_s = self.free_s[tractor]
            begin_times_s.append(free_s)
            free_s += seconds[leg]
        self.free_s[tractor] = free_s
        return len(begin_times_s) > begun_count

    def _pass_gates(self, tractor: int, gates: Sequence[LegGate]) -> bool:
        """Whether all gates before the next leg of a tractor have known openings; it waits until the last of them."""
        passed_count, last_s = self._passed_gates[tractor]
        for number in range(passed_count, len(gates)):
            opening_s = self.find_opening_s(gates[number])
            if opening_s is None:
                self._passed_gates[tractor] = number, last_s
                return False
            last_s = max(last_s, opening_s)
        self.free_s[tractor] = max(self.free_s[tractor], last_s)
        self._passed_gates[tractor] = 0, -math.inf
        return True


def compute_done_s(plan: Plan, pace: SpeedLimits = SPEED_LIMIT_ONLY) -> list[float]:
    """Earliest finish (s) of every tractor in any run of the plan.

    In a deadlock the time until then counts.
    """
    saved_m = [_compute_leg_shortening_m(mission.legs, pace) for mission in plan.missions]
    timings = [_compute_leg_times(mission, pace, saved) for mission, saved in zip(plan.missions, saved_m, strict=True)]
    return _advance_all(_EarliestTimes(plan, timings, [saved + pace.end_tolerance_m for saved in saved_m]))


def _advance_all(earliest: _EarliestTimes) -> list[float]:
    has_moved = True
    while has_moved:
        has_moved = sum(earliest.advance_tractor(tractor) for tractor in range(len(earliest.free_s))) > 0
    return earliest.free_s


def compute_earliest_finish_s(plan: Plan, pace: SpeedLimits = SPEED_LIMIT_ONLY) -> float:
    """Earliest finish (s) of the plan in any run."""
    return max(compute_done_s(plan, pace))


def compute_finish_from_solo_s(
    plan: Plan, solo_runs: Callable[[Mission], SimulationRun], enough_s: float = math.inf
) -> float:
    """Seconds of a plan in which tractors wait only at its gates, from simulating each tractor alone.

    Giving way makes a tractor at most 0.1 % quicker, as it may leave a turn differently. 0 if a tractor does not finish
    even alone. The slowest tractor is simulated first; if it alone takes more than `enough_s`, its time is returned
    and the others are not simulated. The same holds if gates add little and the plan would stay below `enough_s` with
    the others delayed as much as the slowest.
    """
    missions = remove_gates(plan).missions
    timings: dict[int, _SimulatedLegs] = {}
    order = sorted(range(len(missions)), key=lambda number: (-compute_planned_s(missions[number]), number))
    for number in order:
        run = solo_runs(missions[number])
        if run.outcome != DONE:
            return 0.0
        timings[number] = _read_simulated_legs(missions[number], run)
        own_s = SOLO_FACTOR * sum(timings[number].leg_s)
        if own_s > enough_s:
            return own_s
        if number == order[0] and enough_s < math.inf:
            gate_ratio = compute_earliest_finish_s(plan) / compute_planned_s(missions[number])
            if gate_ratio <= GATE_FACTOR and own_s * gate_ratio <= enough_s:
                return own_s
    unsaved = [np.zeros(len(mission.legs)) for mission in plan.missions]
    return SOLO_FACTOR * max(
        _advance_all(_EarliestTimes(plan, [timings[number] for number in range(len(missions))], unsaved))
    )


def compute_planned_s(mission: Mission) -> float:
    """Seconds at planned speeds."""
    return round(math.fsum(leg.length_m / leg.speed_mps for leg in mission.legs), 3)


def remove_gates(plan: Plan) -> Plan:
    """The plan without gates and follow orders."""
    free_legs = (
        tuple(leg.copy_with(gates=(), follow=None) if leg.gates or leg.follow else leg for leg in mission.legs)
        for mission in plan.missions
    )
    return Plan(tuple(Mission(legs) for legs in free_legs), plan.notes)
