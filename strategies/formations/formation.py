"""Triangle formation (thesis, section 6.3): neighbouring swaths are worked side by side, with the rows 10 m apart.

A formation plan is built from rounds of swaths (grouping), their places (slots) and the queue at the headland
(queueing), then simulated and repaired. Two of a row leave the queue together where that is clear. Where they meet on
their way to a round, the one on the side the formation moves away from waits: first until the other has begun its
turn, at last until it is in its place. A tractor in the way waits farther back in its queue or takes a place farther
on. Where none of that helps, the swaths are divided into other rounds.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

from strategies.formations.grouping import (
    NO_CHANGES,
    START_CORNERS,
    FormationChanges,
    FormationGrouping,
    FormationRound,
    divide_runs,
    find_swath_runs,
    get_clear_grouping,
    get_round_key,
    group_swaths,
)
from strategies.formations.leftover import assign_leftover_swaths, hold_others_clear, order_leftover_swaths
from strategies.formations.queueing import (
    FormationDraft,
    QueueRule,
    RoundMarks,
    build_release_gate,
    hold_back_idle,
    write_formation_legs,
)
from strategies.formations.slots import FormationSlot, build_slots, compute_missing_length_m, compute_needed_length_m
from strategies.path_planning.errors import StrategyError, build_too_many_error
from strategies.program.field_job import FieldJob, SwathPass
from strategies.program.legs import make_mission
from strategies.program.strategy_record import RefinedPlan, Simulate
from vehicle.missions.plan import GATE_MARGIN_M, LegGate, Plan
from vehicle.missions.run import CONFLICT, DONE, Conflict

MAX_FORMATION_REPAIRS = 8  # a formation has its own queue: where that needs more repairs, the field does not suit it


@dataclass(frozen=True)
class Formation:
    """A formation plan with what is needed to time its queues: slots per round, and marks by round and tractor.

    `from_afar` tells for each round whether the tractors come to it one after another from elsewhere; `single_order`
    are the passes that one tractor works after the last round, `changes` those the plan was written with.
    """

    plan: Plan
    rounds: tuple[tuple[FormationSlot, ...], ...]
    marks: Mapping[tuple[int, int], RoundMarks]
    from_afar: tuple[bool, ...]
    single_order: tuple[SwathPass, ...]
    changes: FormationChanges = NO_CHANGES

    @property
    def slots(self) -> Iterator[tuple[int, FormationSlot]]:
        """Every slot with the number of its round."""
        return ((number, slot) for number, slots in enumerate(self.rounds) for slot in slots)


def build_formation(
    job: FieldJob, name: str, queue_rule: QueueRule, *, move_up: bool = True, changes: FormationChanges = NO_CHANGES
) -> Formation:
    """The plan of a formation whose tractors leave the queue by `queue_rule`; raises StrategyError.

    Without `move_up` each tractor stays at its first place in the queue until it is released. `changes` are those that
    simulation has shown to be needed.
    """
    swath_grouping = _require_full_round(job, get_clear_grouping(job, changes))
    single_order = order_leftover_swaths(job, swath_grouping)
    rounds = hold_others_clear(job, swath_grouping.rounds, single_order)
    draft = FormationDraft(job, rounds, swath_grouping.from_afar, {}, [[] for _ in range(job.tractors)])
    write_formation_legs(draft, queue_rule, move_up=move_up)
    separate_tractors = {slot.tractor for slots in rounds if len(slots) == 1 for slot in slots}
    if single_order:
        separate_tractors.add(assign_leftover_swaths(draft, single_order))
    else:
        hold_back_idle(draft)
    notes = {
        "strategy": name,
        "tractors": job.tractors,
        **_compute_formation_share(job, swath_grouping, separate_tractors),
    }
    plan = Plan(tuple(make_mission(tractor_legs) for tractor_legs in draft.legs), notes)
    return Formation(plan, tuple(map(tuple, rounds)), draft.marks, tuple(draft.from_afar), tuple(single_order), changes)


def _compute_formation_share(
    job: FieldJob, swath_grouping: FormationGrouping, separate_tractors: set[int]
) -> dict[str, object]:
    """The share of the swath length that two or more tractors work side by side (percent), and who works the rest."""
    if job.tractors == 1:
        return {}
    side_by_side_m = math.fsum(
        slot.swath_pass.swath.length_m for slots in swath_grouping.rounds if len(slots) > 1 for slot in slots
    )
    share_pct = 100.0 * side_by_side_m / math.fsum(swath.length_m for swath in job.layout.swaths)
    return {"formation_pct": round(share_pct, 3), "apart": [tractor + 1 for tractor in sorted(separate_tractors)]}


def _require_full_round(job: FieldJob, swath_grouping: FormationGrouping) -> FormationGrouping:
    """The grouping if it has a round of all tractors; raises StrategyError otherwise."""
    if any(len(slots) == job.tractors for slots in swath_grouping.rounds):
        return swath_grouping
    count = len(job.layout.swaths)
    if count < job.tractors:
        raise build_too_many_error(job.tractors, count)
    raise StrategyError(f"{_explain_no_room(job)}; {_suggest_alternative(job)}.")


def _explain_no_room(job: FieldJob) -> str:
    """Why there is no round of all tractors: the round that lacks least, and how much room it would need."""
    if any(swath.via_m for swath in job.layout.swaths):
        return "A formation needs straight tracks side by side, and those along contours are curved"
    tightest_round = _find_tightest_round(job)
    if tightest_round is None:
        return (
            f"A formation of {job.tractors} tractors needs {job.tractors} tracks of at least "
            f"{compute_needed_length_m(job, min(job.tractors, 2)):.1f} m side by side, and the field has none"
        )
    swath = min((slot.swath_pass.swath for slot in tightest_round), key=lambda swath: swath.length_m)
    rows, gap = max(slot.row for slot in tightest_round), job.driving_rules.gap_m
    shape = f"a formation of {rows} rows {gap:g} m apart with its queue" if rows > 1 else "a queue at its end"
    return (
        f"Track {swath.line} is {swath.length_m:.1f} m long, too short for {shape}: that needs "
        f"{compute_needed_length_m(job, rows):.1f} m where tracks end side by side, "
        f"{compute_missing_length_m(tightest_round):.1f} m more than here"
    )


def _find_tightest_round(job: FieldJob) -> FormationRound | None:
    """The round of all tractors that lacks least room; None if there is none."""
    rounds = [
        build_slots(job, [SwathPass(swath, direction) for swath in run[first : first + job.tractors]])
        for run in find_swath_runs(job)
        for first in range(len(run) - job.tractors + 1)
        for direction in (1, -1)
    ]
    return min(rounds, key=lambda slots: round(compute_missing_length_m(slots), 3), default=None)


def _suggest_alternative(job: FieldJob) -> str:
    """The largest smaller formation that has room somewhere, if any, and other strategies."""
    corners = START_CORNERS if job.corner is None else (job.corner,)
    for tractors in range(job.tractors - 1, 1, -1):
        parts = divide_runs(replace(job, tractors=tractors))
        for corner in corners:
            smaller_grouping = group_swaths(replace(job, tractors=tractors, corner=corner), parts)
            if any(len(slots) == tractors for slots in smaller_grouping.rounds):
                return f"use {tractors} tractors, or split-field or interleaved"
    other_strategies = "use split-field or interleaved"
    return f"no smaller formation fits either, {other_strategies}" if job.tractors > 2 else other_strategies


TURN_BEGUN_M = (10.0, 20.0)  # distances driven by the other since it left the queue; tried before waiting for its place
EXTRA_STEP_M = 5.0  # how much farther off a tractor in the way waits, per attempt
MAX_EXTRA_M = 20.0
NO_SLOT: tuple[int, FormationSlot | None] = (-1, None)
SAME_CONFLICT_S = 1.0
MAX_REWRITES = 16  # times a formation is rewritten
FormationWriter = Callable[[FormationChanges], Formation]
WaitingPair = tuple[SwathPass, SwathPass]
"""Passes of the tractor that waits, and of the one it waits for."""
AttemptKey = tuple[object, ...]
"""Identifies an attempt."""


@dataclass(frozen=True)
class SimulatedFormation:
    """A formation as it was simulated last: its plan and run, and the changes and waits it was found to need."""

    formation: Formation
    refined: RefinedPlan
    changes: FormationChanges
    wait_levels: dict[WaitingPair, int]


def repair_formation(
    write: FormationWriter, simulate: Simulate, similar: SimulatedFormation | None = None
) -> SimulatedFormation:
    """A formation with as little waiting as it is found to need, starting with the waits of a `similar` one if given.

    If nothing helps, the plan is returned as first written, to be repaired like any other.
    """
    changes, wait_levels = (similar.changes, dict(similar.wait_levels)) if similar else (NO_CHANGES, {})
    first, initial = write(changes), (changes, dict(wait_levels))
    formation, plan, failed_keys, rewrites = first, _add_waits(first.plan, first, wait_levels), set[AttemptKey](), 1
    last_attempt: tuple[AttemptKey, Conflict] | None = None
    while rewrites <= MAX_REWRITES:
        run = simulate(plan)
        if run.outcome == DONE:
            return SimulatedFormation(
                formation, RefinedPlan(plan, run, describe_formation_share(plan)), changes, wait_levels
            )
        conflict = run.conflict if run.outcome == CONFLICT else None
        if conflict is None:
            break
        if last_attempt is not None and _is_same_conflict(conflict, last_attempt[1]):
            failed_keys.add(last_attempt[0])
        waiting_pair = _find_waiting_pair(formation, conflict)
        if waiting_pair is not None and wait_levels.get(waiting_pair, 0) < len(TURN_BEGUN_M) + 1:
            wait_levels[waiting_pair] = (
                len(TURN_BEGUN_M) + 1
                if ("wait", *waiting_pair) in failed_keys
                else wait_levels.get(waiting_pair, 0) + 1
            )
            plan = _add_waits(plan, formation, {waiting_pair: wait_levels[waiting_pair]})
            last_attempt = ("wait", *waiting_pair), conflict
            continue
        rewrite = _change_formation(formation, conflict, changes, failed_keys)
        if rewrite is None:
            break
        try:
            formation, changes, rewrites = write(rewrite[1]), rewrite[1], rewrites + 1
        except StrategyError:
            break
        plan, last_attempt = _add_waits(formation.plan, formation, wait_levels), (rewrite[0], conflict)
    return SimulatedFormation(first, RefinedPlan(first.plan, None, describe_formation_share(first.plan)), *initial)


def _is_same_conflict(conflict: Conflict, previous: Conflict) -> bool:
    """Whether the same two tractors met at the same time as before."""
    alike = (conflict.first, conflict.second) == (previous.first, previous.second)
    return alike and abs(conflict.time_s - previous.time_s) < SAME_CONFLICT_S


def describe_formation_share(plan: Plan) -> str | None:
    """A remark if not all of a plan is driven in formation; None otherwise."""
    share_pct, separate_tractors = plan.notes.get("formation_pct"), plan.notes.get("apart")
    if share_pct is None or not separate_tractors:
        return None
    names = [str(tractor) for tractor in separate_tractors]
    workers = f"tractor {names[0]}" if len(names) == 1 else f"tractors {', '.join(names[:-1])} and {names[-1]}"
    return f"{min(round(share_pct), 99)} % of the tracks are worked in formation, the rest by {workers}"


def find_target_rounds(formation: Formation, conflict: Conflict) -> tuple[int | None, int | None]:
    """The rounds that two tractors that met were driving to or standing in; None for one that was in its queue."""
    return _find_target_round(formation, conflict.first, conflict.first_leg), _find_target_round(
        formation, conflict.second, conflict.second_leg
    )


def _find_waiting_pair(formation: Formation, conflict: Conflict) -> WaitingPair | None:
    """Who should wait for whom if both were on their way to the same round; None otherwise."""
    number, other_number = find_target_rounds(formation, conflict)
    if number is None or number != other_number:
        return None
    slots = {slot.tractor: slot for slot in formation.rounds[number]}
    first_slot, waiting_slot = sorted((slots[conflict.first], slots[conflict.second]), key=_build_departure_sort_key)
    return waiting_slot.swath_pass, first_slot.swath_pass


def _build_departure_sort_key(slot: FormationSlot) -> tuple[int, int]:
    """Sort key of two that could leave together: the one on the side the formation moves to goes first."""
    return slot.row, -slot.tractor


def _add_waits(plan: Plan, formation: Formation, wait_levels: dict[WaitingPair, int]) -> Plan:
    """The plan of a formation with more gates, before the legs of tractors that wait for others."""
    slots_by_pass = {slot.swath_pass: (number, slot) for number, slot in formation.slots}
    for (waiting_pass, first_pass), level in wait_levels.items():
        (number, first_slot), (other_number, waiting_slot) = (
            slots_by_pass.get(first_pass, NO_SLOT),
            slots_by_pass.get(waiting_pass, NO_SLOT),
        )
        if (
            first_slot is None
            or waiting_slot is None
            or number != other_number
            or _build_departure_sort_key(waiting_slot) < _build_departure_sort_key(first_slot)
        ):
            continue
        other_tractor, tractor = first_slot.tractor, waiting_slot.tractor
        marks, legs = formation.marks[number, other_tractor], formation.plan.missions[other_tractor].legs
        placed = LegGate(other_tractor, marks.place_leg, max(0.0, legs[marks.place_leg].length_m - GATE_MARGIN_M))
        gates = [build_release_gate(legs, marks, other_tractor, metres) for metres in TURN_BEGUN_M] + [placed]
        plan = plan.copy_with_gate(tractor, formation.marks[number, tractor].release_leg, gates[level - 1])
    return plan


def _find_target_round(formation: Formation, tractor: int, leg: int) -> int | None:
    """The round that a tractor on a leg is driving to or standing in; None for none."""
    for number in range(len(formation.rounds)):
        marks = formation.marks.get((number, tractor))
        if marks and marks.release_leg <= leg <= marks.place_leg:
            return number
    return None


def _change_formation(
    formation: Formation, conflict: Conflict, changes: FormationChanges, failed_keys: set[AttemptKey]
) -> tuple[AttemptKey, FormationChanges] | None:
    """What to write differently after two met, and its key; None if all that is left is in `failed_keys`."""
    sides = [(conflict.first, conflict.first_leg), (conflict.second, conflict.second_leg)]
    for tractor, leg in sides:
        for number, slot in formation.slots:
            marks = formation.marks[number, slot.tractor]
            if slot.tractor != tractor or not marks.place_leg <= leg < marks.queue_legs[-1]:
                continue
            is_ahead = leg == marks.place_leg
            key = "ahead" if is_ahead else "back", slot.swath_pass
            extra_m_by_pass = changes.ahead_m if is_ahead else changes.back_m
            farther_m = {**extra_m_by_pass, slot.swath_pass: extra_m_by_pass.get(slot.swath_pass, 0.0) + EXTRA_STEP_M}
            if key not in failed_keys and farther_m[slot.swath_pass] <= MAX_EXTRA_M:
                return key, replace(changes, ahead_m=farther_m) if is_ahead else replace(changes, back_m=farther_m)
    for number in sorted({number for number in find_target_rounds(formation, conflict) if number is not None}):
        passes = get_round_key(formation.rounds[number])
        if passes not in changes.barred:
            return ("barred", *passes), replace(changes, barred=changes.barred | {passes})
    return None
