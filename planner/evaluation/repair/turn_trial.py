"""A turn of a plan simulated alone: the end of the swath before it, the turn, and the start of the next swath.

This takes a minute of simulated time instead of hours for the whole plan. The controller acts ten times a second, so a
turn begins up to 0.15 m sooner or later and may touch something in one plan and not in another: it is simulated from
several starts within one control interval, and the worst counts.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from hashlib import blake2b

import numpy as np
import numpy.typing as npt

from planner.evaluation.context import PlanningContext
from planner.evaluation.repair.path_deviation import (
    MAX_TURN_M,
    TurnDeviation,
    find_first_turn_leg,
    find_turn_deviations,
    get_worst_offset_m,
)
from vehicle.missions.plan import Leg, Mission, Plan
from vehicle.missions.run import DONE
from vehicle.sim.world import World

LEAD_M, TAIL_M = 40.0, 2.0  # of the swaths before and after: enough to reach speed and to settle
MAX_TRIAL_S = 900.0
START_SHIFTS = 4  # a quarter of a control interval is 4 cm at working speed
MIN_LEG_PART_M = 1.0  # shorter parts of legs are not cut off, and starts are not shifted on them
Points = npt.NDArray[np.float64]


@dataclass(frozen=True)
class TurnTrial:
    """A turn of a plan: its legs, the end of the swath before (if any), and the start of the next one."""

    context: PlanningContext
    lead_legs: tuple[Leg, ...]
    legs: tuple[Leg, ...]
    next_leg: Leg

    def measure_offset_m(self, legs: Sequence[Leg]) -> float | None:
        """The deviation (m) with these legs in place of the turn's, as in `find_turn_deviations`; None if not finished.

        The same turn is simulated only once per context, whichever plans have it.
        """
        trial_legs = self._build_trial_legs(legs)
        key, cached_offsets = hash_legs(trial_legs), self.context.turn_deviations
        if key not in cached_offsets:
            cached_offsets[key] = self._measure_worst_m(trial_legs)
        return cached_offsets[key]

    @property
    def turn_hash(self) -> bytes:
        """A hash of the turn, the same in every plan that has it."""
        return hash_legs(self._build_trial_legs(self.legs))

    def _build_trial_legs(self, legs: Sequence[Leg]) -> tuple[Leg, ...]:
        return tuple(
            replace(leg, gates=(), follow=None, stand_s=0.0) for leg in (*self.lead_legs, *legs, self.next_leg)
        )

    def _measure_worst_m(self, legs: tuple[Leg, ...]) -> float | None:
        worst_m = 0.0
        for later_m in self._list_shifts_m(legs[0]):
            offset_m = self._simulate_offset_m(
                (_cut_leg(legs[0], later_m - legs[0].length_m), *legs[1:]) if later_m else legs
            )
            if offset_m is None:
                return None
            worst_m = max(worst_m, offset_m)
        return worst_m

    def _list_shifts_m(self, first: Leg) -> list[float]:
        """Shifts (m) of the start along the first leg within one control interval."""
        look_m = first.speed_mps / self.context.tractor.guidance.rate_hz
        if not self.lead_legs or first.length_m < look_m + MIN_LEG_PART_M:
            return [0.0]
        return [place * look_m / START_SHIFTS for place in range(START_SHIFTS)]

    def _simulate_offset_m(self, legs: tuple[Leg, ...]) -> float | None:
        context, physics = self.context, self.context.physics
        plan = Plan((Mission(legs),))
        world = World(plan, context.tractor, context.implement, terrain=physics.terrain, load=physics.driven_load)
        run = world.run(max_time_s=MAX_TRIAL_S)
        return get_worst_offset_m(find_turn_deviations(run, self.context)) if run.outcome == DONE else None

    @property
    def is_short_turn(self) -> bool:
        """Whether it is a turn and not a route."""
        return math.fsum(leg.length_m for leg in self.legs) < MAX_TURN_M

    def build_slowed_legs(self, factor: float) -> list[Leg]:
        """Its legs at a share of their speed; of a route only the last MAX_TURN_M."""
        remaining_m = np.cumsum([leg.length_m for leg in self.legs[::-1]])[::-1]
        return [
            replace(leg, speed_mps=factor * leg.speed_mps) if to_end_m < MAX_TURN_M else leg
            for leg, to_end_m in zip(self.legs, remaining_m.tolist(), strict=True)
        ]


def hash_legs(legs: tuple[Leg, ...]) -> bytes:
    """A hash of everything that decides how a tractor drives legs alone."""
    driving_values = [(len(leg.points), leg.speed_mps, leg.gear, leg.implement, leg.ground, leg.task) for leg in legs]
    content = repr(driving_values).encode() + np.concatenate([leg.points for leg in legs]).tobytes()
    return blake2b(content, digest_size=16).digest()


def build_turn_trial(plan: Plan, deviation: TurnDeviation, context: PlanningContext) -> TurnTrial:
    """The trial of the turn with this deviation."""
    legs = plan.missions[deviation.tractor].legs
    first = find_first_turn_leg(plan.missions[deviation.tractor], deviation.leg)
    return TurnTrial(
        context, _cut_lead_in_legs(legs, first), legs[first : deviation.leg], _cut_leg(legs[deviation.leg], TAIL_M)
    )


def _cut_lead_in_legs(legs: Sequence[Leg], first: int) -> tuple[Leg, ...]:
    """The last LEAD_M before a leg, of legs that work on the same swath."""
    lead: list[Leg] = []
    remaining_m, number = LEAD_M, first - 1
    while remaining_m > MIN_LEG_PART_M and number >= 0 and (not lead or _continues_same_work(legs[number], lead[0])):
        lead.insert(0, _cut_leg(legs[number], -remaining_m))
        remaining_m -= legs[number].length_m
        number -= 1
    return tuple(lead)


def _continues_same_work(leg: Leg, next_leg: Leg) -> bool:
    """Whether a tractor works on in the same task on the next leg without a halt."""
    return leg.task == next_leg.task and leg.task.is_work and leg.gear == next_leg.gear and next_leg.stand_s == 0.0


def cut_leg_between(leg: Leg, first_m: float, last_m: float) -> Leg:
    """The part of a leg between two distances along it, of which the first may be 0 and the last its length."""
    length_m = leg.length_m
    part = leg if last_m >= length_m else _cut_leg(leg, last_m)
    return part if first_m <= 0.0 else _cut_leg(part, first_m - min(last_m, length_m))


def _cut_leg(leg: Leg, metres: float) -> Leg:
    """The first `metres` of a leg, or its last if negative."""
    if leg.length_m <= abs(metres):
        return leg
    points = leg.points if metres > 0.0 else leg.points[::-1]
    along = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))))
    last = int(np.searchsorted(along, abs(metres)))
    share = (abs(metres) - along[last - 1]) / (along[last] - along[last - 1])
    end = points[last - 1] + share * (points[last] - points[last - 1])
    points_kept: Points = np.concatenate([points[:last], [end]])
    if np.hypot(*(points_kept[-1] - points_kept[-2])) < 1e-3:
        points_kept = np.delete(points_kept, -2, axis=0)
    return replace(leg, points=points_kept if metres > 0.0 else points_kept[::-1])
