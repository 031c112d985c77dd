"""Swaths grouped for a formation: runs of neighbouring swaths, rounds of them worked side by side, and leftover swaths.

A run follows the swaths from line to line where they overlap most, so that a hole or a notch splits runs but a few
short swaths beside them do not. The quickest division of a run into rounds is found by working backwards from its
end; one tractor alone works swaths too short or too few for a round. Rounds are then moved clear of the paths that
others drive to them and from them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from fields.layout.swaths import Swath
from strategies.formations.slots import (
    Floats,
    FormationSlot,
    PassingClearance,
    build_slots,
    compute_missing_length_m,
    compute_needed_length_m,
    find_blocked_spans,
    project_begin_m,
    sample_poses,
)
from strategies.program.field_job import FieldJob, SwathPass

StartCorner = tuple[bool, int]
"""(begin at the last swath?, first direction)."""
START_CORNERS: tuple[StartCorner, ...] = tuple((last, way) for last in (False, True) for way in (1, -1))
SwathRun = list[Swath]
FormationRound = list[FormationSlot]

BarredRounds = frozenset[tuple[SwathPass, ...]]
"""Rounds found to have no room, by their passes."""

PARALLEL_TOLERANCE_RAD = 1e-6
NEIGHBOUR_WIDTHS = 1.5  # working widths within which a parallel swath is a neighbour
MAX_FEWER_TRACTORS = 3  # how many smaller rounds are tried where there is no room for all tractors


@dataclass(frozen=True)
class RunDivision:
    """A run divided into rounds of neighbouring swaths, in working order, and the leftover swaths.

    `seconds` is an estimate for all of it.
    """

    seconds: float
    rounds: tuple[FormationRound, ...]
    single_swaths: tuple[Swath, ...]


@dataclass(frozen=True)
class FormationGrouping:
    """All rounds in order, for each whether the tractors come to it from elsewhere, and the leftover swaths."""

    seconds: float
    rounds: list[FormationRound]
    from_afar: list[bool]
    single_swaths: list[Swath]


def find_swath_runs(job: FieldJob) -> list[SwathRun]:
    """Neighbouring straight swaths long enough for a formation, each joined to the next line's it overlaps most."""
    min_length_m = compute_needed_length_m(job, min(job.tractors, 2))
    swaths = [swath for swath in job.layout.swaths if swath.length_m >= min_length_m and not swath.via_m]
    pairs = sorted(_list_overlaps(job, swaths), key=lambda pair: (-pair[0], pair[1], pair[2]))
    after: dict[int, int] = {}
    taken: set[int] = set()
    for _, a, b in pairs:
        if a not in after and b not in taken:
            after[a] = b
            taken.add(b)
    runs = []
    for index in range(len(swaths)):
        if index not in taken:
            run = [index]
            while run[-1] in after:
                run.append(after[run[-1]])
            runs.append([swaths[swath_number] for swath_number in run])
    return runs


def _list_overlaps(job: FieldJob, swaths: list[Swath]) -> Iterator[tuple[float, int, int]]:
    """Pairs of neighbouring parallel swaths: by how many metres they overlap, and their indices."""
    by_line: dict[int, list[int]] = {}
    for index, swath in enumerate(swaths):
        by_line.setdefault(swath.line, []).append(index)
    for a, swath in enumerate(swaths):
        for b in by_line.get(swath.line + 1, []):
            overlap_m = _compute_overlap_m(job, SwathPass(swath, 1), SwathPass(swaths[b], 1))
            if overlap_m > 0.0:
                yield round(overlap_m, 3), a, b


def _compute_overlap_m(job: FieldJob, a: SwathPass, b: SwathPass) -> float:
    """How far two passes lie side by side (m); 0 or less if they do not."""
    (ax, ay, heading), (bx, by, other_heading) = job.get_entry_pose(a), job.get_entry_pose(b)
    across = abs((by - ay) * math.cos(heading) - (bx - ax) * math.sin(heading))
    if (
        abs(math.remainder(other_heading - heading, 2.0 * math.pi)) > PARALLEL_TOLERANCE_RAD
        or across > NEIGHBOUR_WIDTHS * job.layout.width_m
    ):
        return 0.0
    first, second = project_begin_m(job, a), project_begin_m(job, b)
    return min(first + a.swath.length_m, second + b.swath.length_m) - max(first, second)


def divide_run(
    job: FieldJob, run: SwathRun, from_last: bool, barred: BarredRounds = frozenset()
) -> dict[StartCorner, RunDivision]:
    """The quickest divisions of a run into rounds that are not barred, from the two corners at one of its sides."""
    swaths = run[::-1] if from_last else run
    best: dict[tuple[int, int], tuple[float, FormationRound | None]] = {
        (len(swaths), direction): (0.0, None) for direction in (1, -1)
    }
    for first in range(len(swaths) - 1, -1, -1):
        for direction in (1, -1):
            options: list[tuple[float, FormationRound | None]] = [
                (estimate_single_s(job, swaths[first]) + best[first + 1, direction][0], None)
            ]
            for slots in _list_rounds_at(job, swaths, first, direction, barred):
                next_swath = first + len(slots)
                back_s = _estimate_rejoin_s(job, slots) if next_swath < len(swaths) else 0.0
                options.append((estimate_round_s(job, slots) + back_s + best[next_swath, -direction][0], slots))
            best[first, direction] = min(options, key=lambda option: (round(option[0], 3), -len(option[1] or ())))
    return {(from_last, direction): _build_best_division(swaths, best, direction) for direction in (1, -1)}


def _build_best_division(
    swaths: list[Swath], best: dict[tuple[int, int], tuple[float, FormationRound | None]], direction: int
) -> RunDivision:
    """The division by `best`: the remaining seconds at (swath, direction), and the round that begins there."""
    rounds, single_swaths, first, current_direction = list[FormationRound](), list[Swath](), 0, direction
    while first < len(swaths):
        chosen = best[first, current_direction][1]
        if chosen is None:
            single_swaths.append(swaths[first])
            first += 1
        else:
            rounds.append(chosen)
            first, current_direction = first + len(chosen), -current_direction
    return RunDivision(best[0, direction][0], tuple(rounds), tuple(single_swaths))


def _list_rounds_at(
    job: FieldJob, swaths: list[Swath], first: int, direction: int, barred: BarredRounds
) -> Iterator[FormationRound]:
    """The largest round with room on the swaths from `first` on; a single swath only at the end of the run."""
    remaining = len(swaths) - first
    for count in range(min(job.tractors, remaining), max(min(job.tractors, remaining) - MAX_FEWER_TRACTORS, 0) - 1, -1):
        if count == 0 or (count == 1 < job.tractors and remaining > 1):
            return
        slots = build_slots(job, [SwathPass(swath, direction) for swath in swaths[first : first + count]])
        if compute_missing_length_m(slots) <= 0.0 and get_round_key(slots) not in barred:
            yield slots
            return


def get_round_key(slots: Sequence[FormationSlot]) -> tuple[SwathPass, ...]:
    """The passes of a round, which identify it when it is barred."""
    return tuple(slot.swath_pass for slot in slots)


def estimate_round_s(job: FieldJob, slots: FormationRound) -> float:
    """Estimated seconds of a round, from the first end of a swath to the last, and of the turns into it."""
    begins = [project_begin_m(job, slot.swath_pass) for slot in slots]
    ends = [begin + slot.swath_pass.swath.length_m for begin, slot in zip(begins, slots, strict=True)]
    rows, table = max(slot.row for slot in slots), job.driving_rules.turn_s
    return (max(ends) - min(begins)) / job.driving_rules.work_speed_mps + rows * table[min(len(slots), len(table) - 1)]


def estimate_single_s(job: FieldJob, swath: Swath) -> float:
    """Estimated seconds of a swath that one tractor works alone, with the turn to it."""
    return swath.length_m / job.driving_rules.work_speed_mps + job.driving_rules.turn_s[1]


def _estimate_rejoin_s(job: FieldJob, slots: FormationRound) -> float:
    """Estimated seconds for tractors without a swath in a round to drive to its other end."""
    if len(slots) == job.tractors:
        return 0.0
    return max(slot.swath_pass.swath.length_m for slot in slots) / job.driving_rules.turn_speed_mps


@dataclass(frozen=True)
class RunDivisionsByCorner:
    """All runs of a job, and the division of each from each of its corners."""

    runs: list[SwathRun]
    divisions: dict[tuple[int, StartCorner], RunDivision]


def divide_runs(job: FieldJob, barred: BarredRounds = frozenset()) -> RunDivisionsByCorner:
    """The runs of a job divided from every corner of the field; cached for all jobs of a field."""
    key = "divided", job.tractors, job.layout.swaths, barred
    if key not in job.formation_cache:
        runs, divisions = find_swath_runs(job), dict[tuple[int, StartCorner], RunDivision]()
        for index, run in enumerate(runs):
            for from_last in (False, True):
                divisions.update(
                    {(index, corner): division for corner, division in divide_run(job, run, from_last, barred).items()}
                )
        job.formation_cache[key] = RunDivisionsByCorner(runs, divisions)
    return job.formation_cache[key]  # type: ignore[no-any-return]


def group_swaths(job: FieldJob, divided: RunDivisionsByCorner) -> FormationGrouping:
    """All swaths of a job in rounds, run after run from its corner on, next the run that is reached soonest.

    The first run is the one with which everything takes least time, including the paths from the entrance and back;
    with an entrance but no lane through it, the run nearest to the entrance.
    """
    corner, runs, divisions = job.corner or (False, 1), divided.runs, divided.divisions
    usable_runs = [
        index
        for index in range(len(runs))
        if any(_has_formation_round(job, divisions[index, tried_corner]) for tried_corner in START_CORNERS)
    ]
    used_swaths = {swath for index in usable_runs for swath in runs[index]}
    unused_swaths = [swath for swath in job.layout.swaths if swath not in used_swaths]
    entrance = job.layout.field.entrance
    starts = [index for index in usable_runs if _has_formation_round(job, divisions[index, corner])]
    if entrance is not None and job.entrance_lane is None and starts:
        starts = [min(starts, key=lambda index: _measure_distance_to_run_m(job, divisions[index, corner], entrance))]
    tours = [_order_runs(job, divisions, usable_runs, start, corner, unused_swaths) for start in starts]
    empty_grouping = FormationGrouping(0.0, [], [], list(job.layout.swaths))
    return min(tours, key=lambda tour: round(tour.seconds, 3), default=empty_grouping)


def _has_formation_round(job: FieldJob, division: RunDivision) -> bool:
    """Whether a run has a round worth a formation."""
    return any(len(slots) >= min(job.tractors, 2) for slots in division.rounds)


def _measure_distance_to_run_m(job: FieldJob, division: RunDivision, place: tuple[float, float]) -> float:
    """How far from a place a run begins (m)."""
    return min(round(math.dist(place, job.get_entry_pose(slot.swath_pass)[:2]), 3) for slot in division.rounds[0])


def _order_runs(
    job: FieldJob,
    divisions: dict[tuple[int, StartCorner], RunDivision],
    usable_runs: list[int],
    start: int,
    corner: StartCorner,
    unused_swaths: list[Swath],
) -> FormationGrouping:
    """All runs with rounds, beginning with one of them at its corner."""
    groups, seconds = [divisions[start, corner]], 0.0
    remaining_runs = [index for index in usable_runs if index != start]
    while remaining_runs:
        options = [
            (
                round(_estimate_transfer_s(job, groups[-1].rounds[-1], divisions[index, tried_corner].rounds[0]), 3),
                place,
                index,
                tried_corner,
            )
            for index in remaining_runs
            for place, tried_corner in enumerate(START_CORNERS)
            if _has_formation_round(job, divisions[index, tried_corner])
        ]
        transfer_s, _, index, tried_corner = min(options)
        groups[-1] = _drop_last_single_swath(job, groups[-1])
        groups.append(divisions[index, tried_corner])
        remaining_runs.remove(index)
        seconds += transfer_s
    rounds = [slots for group in groups for slots in group.rounds]
    firsts = [number == 0 for group in groups for number in range(len(group.rounds))]
    present = [{slot.tractor for slot in slots} for slots in rounds]
    from_afar = [
        number > 0 and (firsts[number] or not present[number] <= present[number - 1]) for number in range(len(rounds))
    ]
    single_swaths = [swath for group in groups for swath in group.single_swaths] + unused_swaths
    seconds += sum(group.seconds for group in groups) + sum(estimate_single_s(job, swath) for swath in unused_swaths)
    seconds += job.estimate_entrance_time_s(rounds[0][0].swath_pass, rounds[-1][-1].swath_pass)
    return FormationGrouping(seconds, rounds, from_afar, single_swaths)


def _drop_last_single_swath(job: FieldJob, division: RunDivision) -> RunDivision:
    """The division of a run that others follow: a leftover swath at its end must not delay the formation."""
    last = division.rounds[-1]
    if len(last) > 1 or job.tractors == 1:
        return division
    return replace(
        division, rounds=division.rounds[:-1], single_swaths=(*division.single_swaths, last[0].swath_pass.swath)
    )


def _estimate_transfer_s(job: FieldJob, before: FormationRound, after: FormationRound) -> float:
    """Estimated seconds for a formation to move on to another run."""
    a, b = ({slot.row: slot.swath_pass for slot in slots}[1] for slots in (before, after))
    return max(slot.row for slot in after) * job.estimate_turn_time_s(a, b)


PathPoses = dict[tuple[int, int], Floats | None]
"""Poses on the path to a round by (round, tractor), None if there is no path; no entry for a tractor's first round."""

NO_POSES: Floats = np.empty((0, 4))
MAX_BARRED_ROUNDS = 20  # rounds divided again for lack of room; the rest is driven as it is


@dataclass(frozen=True)
class FormationChanges:
    """What simulation has shown to be needed.

    By pass, how much farther on its place and how much farther back its queue must be; rounds that are barred.
    """

    ahead_m: Mapping[SwathPass, float] = field(default_factory=dict)
    back_m: Mapping[SwathPass, float] = field(default_factory=dict)
    barred: BarredRounds = frozenset()


NO_CHANGES = FormationChanges()


def get_clear_grouping(job: FieldJob, changes: FormationChanges = NO_CHANGES) -> FormationGrouping:
    """The grouping of a job with every round clear of the paths to and from it; rounds without room are divided again.

    The grouping without changes is cached for all jobs of a field.
    """
    if changes is not NO_CHANGES:
        return _find_clear_grouping(job, changes)
    key = "clear", job.tractors, job.corner, job.layout.field.entrance, job.layout.swaths
    if key not in job.formation_cache:
        job.formation_cache[key] = _find_clear_grouping(job, changes)
    return job.formation_cache[key]  # type: ignore[no-any-return]


def _find_clear_grouping(job: FieldJob, changes: FormationChanges) -> FormationGrouping:
    barred = changes.barred
    while True:
        tried_grouping = group_swaths(job, divide_runs(job, barred))
        path_poses = _sample_paths(job, tried_grouping.rounds)
        rounds = _clear_rounds(job, tried_grouping.rounds, path_poses, changes)
        unfit = frozenset(
            get_round_key(slots)
            for number, slots in enumerate(rounds)
            if compute_missing_length_m(slots) > 0.0
            or any(path_poses.get((number, slot.tractor), NO_POSES) is None for slot in slots)
        )
        if not unfit or len(barred) >= len(changes.barred) + MAX_BARRED_ROUNDS:
            final_rounds = [
                new if compute_missing_length_m(new) <= 0.0 else old
                for new, old in zip(rounds, tried_grouping.rounds, strict=True)
            ]
            return replace(tried_grouping, rounds=final_rounds)
        barred |= unfit


def _clear_rounds(
    job: FieldJob, rounds: list[FormationRound], path_poses: PathPoses, changes: FormationChanges
) -> list[FormationRound]:
    """The rounds with places and queues clear of passing tractors, which may leave them no room."""
    cleared = []
    for number, slots in enumerate(rounds):
        clearances = []
        for slot in slots:
            blocked = (
                find_blocked_spans(job, slot.swath_pass, _list_arriving_poses(slots, path_poses, number, slot)),
                find_blocked_spans(job, slot.swath_pass, _list_departing_poses(rounds, path_poses, number, slot)),
            )
            ahead_m, back_m = changes.ahead_m.get(slot.swath_pass, 0.0), changes.back_m.get(slot.swath_pass, 0.0)
            clearances.append(PassingClearance(*blocked, ahead_m, back_m))
        cleared.append(build_slots(job, [slot.swath_pass for slot in slots], clearances))
    return cleared


def _sample_paths(job: FieldJob, rounds: list[FormationRound]) -> PathPoses:
    """The poses on the path of every tractor to each of its rounds except the first."""
    path_poses: PathPoses = {}
    last_slots: dict[int, FormationSlot] = {}
    for number, slots in enumerate(rounds):
        for slot in slots:
            if slot.tractor in last_slots:
                path = job.find_path(
                    job.get_exit_pose(last_slots[slot.tractor].swath_pass), job.get_entry_pose(slot.swath_pass)
                )
                path_poses[number, slot.tractor] = None if path is None else sample_poses(path)
            last_slots[slot.tractor] = slot
    return path_poses


def _list_arriving_poses(
    slots: FormationRound, path_poses: PathPoses, number: int, slot: FormationSlot
) -> Iterator[Floats]:
    """The paths of others that come to a round while a tractor is in its place."""
    is_first = (number, slot.tractor) not in path_poses  # stands there from the start
    for other_slot in slots:
        poses = path_poses.get((number, other_slot.tractor))
        if poses is not None and other_slot is not slot and (is_first or other_slot.row >= slot.row):
            yield poses


def _list_departing_poses(
    rounds: list[FormationRound], path_poses: PathPoses, number: int, slot: FormationSlot
) -> Iterator[Floats]:
    """The paths of others that drive on while a tractor waits at the end of a round."""
    for later in range(number + 1, len(rounds)):
        is_own_round = any(other_slot.tractor == slot.tractor for other_slot in rounds[later])
        for other_slot in rounds[later]:
            poses = path_poses.get((later, other_slot.tractor))
            if (
                poses is not None
                and other_slot.tractor != slot.tractor
                and (not is_own_round or other_slot.row <= slot.row)
            ):
                yield poses
        if is_own_round:
            return
