"""Repairs of turns that a tractor does not follow well: driven more slowly, or with wider arcs.

A short arc at full lock is over before guidance has converged. Slowing makes some turns worse, so every repair is
tried by simulating the turn alone.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from planner.evaluation.context import PlanningContext
from planner.evaluation.repair.path_deviation import (
    MAX_OFFSET_M,
    TurnDeviation,
    find_first_turn_leg,
    find_first_working_legs,
)
from planner.evaluation.repair.turn_trial import TurnTrial, build_turn_trial
from strategies.path_planning.paths import DrivePath, Pose
from strategies.program.field_job import FieldJob
from strategies.program.legs import build_path_legs
from vehicle.missions.plan import GATE_MARGIN_M, ROUTE, TURN, Leg, LegGate, Mission, Plan

TOLERANCE_M = 1e-6
TurnKey = tuple[int, int, int]
"""(tractor, first leg of a turn, first leg after it)."""


def find_wider_turn(trial: TurnTrial, job: FieldJob) -> tuple[float | None, list[Leg]]:
    """Deviation (m) and legs of the first wider turn that is followed, else of the best one; (None, []) without any."""
    best: tuple[float | None, list[Leg]] = None, []
    if not trial.lead_legs or not trial.legs or not trial.is_short_turn:
        return best
    for path in _iter_wider_turns(trial, job):
        legs = build_path_legs(job, path, replace(trial.legs[0].task, kind=ROUTE if path.kind == "route" else TURN))
        offset_m = trial.measure_offset_m(legs) if legs else None
        if offset_m is not None and (best[0] is None or offset_m < best[0] - TOLERANCE_M):
            best = offset_m, legs
        if best[0] is not None and best[0] <= MAX_OFFSET_M:
            break
    return best


def _iter_wider_turns(trial: TurnTrial, job: FieldJob) -> Iterator[DrivePath]:
    """Turns between the same poses: those that keep to the headland first, of these the tightest first.

    Those that reach too far over an open edge come last.
    """
    a, b = _get_end_pose(trial.lead_legs[-1], -1), _get_end_pose(trial.next_leg, 0)
    over_edge = []
    for finder in trial.context.wide_turn_finders:
        path = finder.connect_directly(a, b)
        if path is None or job.crosses_fence(path):
            continue
        if job.has_overhang(path):
            over_edge.append(path)
        else:
            yield path
    yield from over_edge


def _get_end_pose(leg: Leg, end: int) -> Pose:
    """Pose of the guided point at one end of a leg, 0 or -1."""
    (x0, y0), (x1, y1) = leg.points[:2] if end == 0 else leg.points[-2:]
    x, y = leg.points[end]
    return float(x), float(y), math.atan2(leg.gear * (y1 - y0), leg.gear * (x1 - x0))


def replace_turns(plan: Plan, turns: Mapping[TurnKey, tuple[Leg, ...]]) -> Plan:
    """The plan with other legs for some of its turns.

    Gates on a leg of an old turn move to the end of the new one, standing in a turn moves to its start, and the notes
    on service stops are renumbered.
    """
    missions, refills = list(plan.missions), plan.notes.get("refills")
    for (tractor, first, last), legs in sorted(turns.items(), reverse=True):
        old = missions[tractor].legs
        if [id(leg.points) for leg in legs] == [id(leg.points) for leg in old[first:last]]:
            # Only speeds change; gates stay those of the plan, whose legs may have been renumbered.
            slower = (replace(leg, speed_mps=new.speed_mps) for leg, new in zip(old[first:last], legs, strict=True))
            missions[tractor] = Mission((*old[:first], *slower, *old[last:]))
            continue
        gates = tuple(gate for leg in old[first:last] for gate in leg.gates)
        stand_s = math.fsum(leg.stand_s for leg in old[first:last])
        first_leg = replace(legs[0], may_wait=old[first].may_wait, gates=gates, stand_s=stand_s)
        missions[tractor] = Mission((*old[:first], first_leg, *legs[1:], *old[last:]))
        missions = [_renumber_mission(mission, tractor, first, last, legs) for mission in missions]
        refills = refills and [_renumber_service_stop(one, tractor, first, last, len(legs)) for one in refills]
    notes = plan.notes if refills is None else {**plan.notes, "refills": refills}
    return replace(plan, missions=tuple(missions), notes=notes)


def _renumber_service_stop(
    service_stop: Mapping[str, Any], tractor: int, first: int, last: int, count: int
) -> dict[str, Any]:
    """The note on a service stop with its leg renumbered for a new turn of `count` legs."""
    leg = service_stop["leg"]
    if service_stop["tractor"] != tractor + 1 or leg < first:
        return dict(service_stop)
    return {**service_stop, "leg": first if leg < last else leg + count - (last - first)}


def _renumber_mission(mission: Mission, tractor: int, first: int, last: int, turn: tuple[Leg, ...]) -> Mission:
    """A mission with the gates and follow orders on a tractor's legs renumbered for its new turn."""
    added_legs, end = len(turn) - (last - first), first + len(turn) - 1

    def renumber_gate(gate: LegGate) -> LegGate:
        if gate.tractor != tractor or gate.leg < first:
            return gate
        if gate.leg >= last:
            return replace(gate, leg=gate.leg + added_legs)
        return replace(gate, leg=end, after_m=max(0.0, turn[-1].length_m - GATE_MARGIN_M))

    legs = []
    for leg in mission.legs:
        if not leg.gates and leg.follow is None:
            legs.append(leg)
            continue
        follow = leg.follow
        if follow is not None and follow.tractor == tractor and follow.leg >= last:
            follow = replace(follow, leg=follow.leg + added_legs)
        legs.append(replace(leg, gates=tuple(renumber_gate(gate) for gate in leg.gates), follow=follow))
    return Mission(tuple(legs))


SLOW_FACTORS = (0.6, 0.36)
MIN_IMPROVEMENT_M = 0.05  # a smaller gain is not worth the time


RepairedTurns = dict[bytes, tuple[Leg, ...]]
"""Better legs of turns, by the key of the turn."""


@dataclass(frozen=True)
class TurnRepair:
    """A deviation, better legs for its turn, and the deviation (m) with these."""

    deviation: TurnDeviation
    legs: tuple[Leg, ...]
    offset_m: float


def find_repairs(plan: Plan, deviations: list[TurnDeviation], context: PlanningContext) -> list[TurnRepair]:
    """Repairs for those of the deviations that have one."""
    repairs = (_find_repair(plan, deviation, context) for deviation in deviations)
    return [repair for repair in repairs if repair is not None]


def sum_excess_offset_m(deviations: list[TurnDeviation], repairs: list[TurnRepair] | None = None) -> float:
    """Sum (m) of the deviations beyond MAX_OFFSET_M, with repaired turns as repaired."""
    repaired_offsets = {(repair.deviation.tractor, repair.deviation.leg): repair.offset_m for repair in repairs or ()}
    offsets_m = (
        repaired_offsets.get((deviation.tractor, deviation.leg), deviation.offset_m) for deviation in deviations
    )
    return math.fsum(max(0.0, metres - MAX_OFFSET_M) for metres in offsets_m)


def apply_repairs(plan: Plan, repairs: list[TurnRepair]) -> Plan:
    """The plan with these turns repaired."""
    turns = {}
    for repair in repairs:
        tractor, leg = repair.deviation.tractor, repair.deviation.leg
        turns[tractor, find_first_turn_leg(plan.missions[tractor], leg), leg] = repair.legs
    return replace_turns(plan, turns)


def collect_repaired_turns(plan: Plan, repairs: Iterable[TurnRepair], context: PlanningContext) -> RepairedTurns:
    """Repairs of a plan for other plans with the same turns; only turns that do not depend on other tractors."""
    return {
        build_turn_trial(plan, repair.deviation, context).turn_hash: repair.legs
        for repair in repairs
        if _is_independent_of_others(repair.legs)
    }


def apply_repaired_turns(plan: Plan, repaired_turns: Mapping[bytes, tuple[Leg, ...]], context: PlanningContext) -> Plan:
    """The plan with known repairs applied; the same object if it has none of these turns."""
    turns = {}
    for tractor, mission in enumerate(plan.missions if repaired_turns else ()):
        for leg in find_first_working_legs(mission):
            first = find_first_turn_leg(mission, leg)
            better_legs = repaired_turns.get(
                build_turn_trial(plan, TurnDeviation(tractor, leg, 0.0), context).turn_hash
            )
            if better_legs is not None and _is_independent_of_others(mission.legs[first:leg]):
                turns[tractor, first, leg] = _copy_leg_gates(mission.legs[first:leg], better_legs)
    return replace_turns(plan, turns) if turns else plan


def _is_independent_of_others(legs: Sequence[Leg]) -> bool:
    """Whether a tractor neither follows another nor stands on some legs."""
    return not any(leg.follow or leg.stand_s for leg in legs)


def _copy_leg_gates(legs: Sequence[Leg], better: Sequence[Leg]) -> tuple[Leg, ...]:
    """Better legs of a turn; on the same path they keep the gates of the plan's legs."""
    pairs = list(zip(legs, better, strict=False))
    if len(legs) == len(better) and all(np.array_equal(leg.points, other.points) for leg, other in pairs):
        return tuple(replace(leg, speed_mps=other.speed_mps) for leg, other in pairs)
    return tuple(replace(leg, gates=()) for leg in better)


def _find_repair(plan: Plan, deviation: TurnDeviation, context: PlanningContext) -> TurnRepair | None:
    """The quickest repair that keeps the tractor near its line, or else the nearest; None if nothing helps."""
    trial = build_turn_trial(plan, deviation, context)
    current_m = trial.measure_offset_m(trial.legs) if trial.legs else None
    if current_m is None:
        return None
    options = [
        (trial.measure_offset_m(legs), legs) for legs in (trial.build_slowed_legs(factor) for factor in SLOW_FACTORS)
    ]
    options.append(find_wider_turn(trial, context.build_job(plan.tractors)))
    improving = [(off, tuple(legs)) for off, legs in options if off is not None and current_m - off > MIN_IMPROVEMENT_M]
    better = [(deviation.offset_m - (current_m - off), legs) for off, legs in improving]
    if not better:
        return None
    metres, legs = min(
        better, key=lambda option: (max(MAX_OFFSET_M, round(option[0], 6)), _compute_leg_seconds(option[1]))
    )
    return TurnRepair(deviation, legs, metres)


def _compute_leg_seconds(legs: tuple[Leg, ...]) -> float:
    """Seconds of legs at planned speed."""
    return round(math.fsum(leg.length_m / leg.speed_mps for leg in legs), 1)
