"""Phases of a run (working, turning, transit, standing, unlogged), its turns, and its figures.

A stop lasts five seconds or more. Driving between two segments of work is a turn if it is no longer than `MAX_TURN_M`,
otherwise transit, as is driving before the first and after the last. Gaps of the log in which the machine moved are
unlogged.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from fields.arrays import Flags, Floats
from planner.task_logs.runs.run_records import ACTIVE_M, AREA_M2, FUEL_L, INACTIVE_M, STANDING_MPS, ProjectedRun
from reports.task_logs.run_results import ACTIVITY_KINDS, STANDING, TRANSIT, TURNING, UNLOGGED, WORKING, RunFigures
from vehicle.identification.logs.series import find_spans

MIN_STOP_S = 5.0
MAX_TURN_M = 200.0
GAP_STEP_RATIO = 5.0  # a step as long as a stop, and this many times the median one, is a gap
U_TURN_SLACK_DEG = 30.0
BEND_LENGTH_M = 5.0  # of work before and after a turn, for its direction
Kinds = npt.NDArray[np.int8]
MOVING_MPS = 0.2  # slower rows do not count for the working speed
COUNTER_TOLERANCE = 0.03
"""Relative difference of counters and positions above which there is a remark."""


@dataclass(frozen=True)
class LoggedTurn:
    """One turn between two segments of work.

    Attributes:
        first, last: rows, from the last of work to the first of work again.
        seconds, standing_s, length_m: duration, of which standing, and length.
        bend_deg: angle between the directions of work before and after, 0 to 180.
        offset_m: distance between the lines of work before and after; meaningful only if these are parallel.
    """

    first: int
    last: int
    seconds: float
    standing_s: float
    length_m: float
    bend_deg: float
    offset_m: float

    @property
    def is_u_turn(self) -> bool:
        """Whether it leads back without a stop."""
        return abs(self.bend_deg - 180.0) <= U_TURN_SLACK_DEG and self.standing_s < MIN_STOP_S


@dataclass(frozen=True, eq=False)
class RunPhases:
    """Kinds (n - 1,) of the steps from row to row as indices of ACTIVITY_KINDS, stops (s,) in seconds, lifts, turns."""

    kinds: Kinds
    stops_s: Floats
    lifts: int
    turns: tuple[LoggedTurn, ...]


def classify_phases(run: ProjectedRun) -> RunPhases:
    """The kind of every step of a run, and its stops and turns."""
    durations_s, steps_m = np.diff(run.time_s), np.hypot(*np.diff(run.xy, axis=0).T)
    gaps = (durations_s > MIN_STOP_S) & (durations_s > GAP_STEP_RATIO * np.median(durations_s))
    is_still = np.where(gaps, steps_m < STANDING_MPS * durations_s, run.speed_mps[:-1] < STANDING_MPS)
    is_standing, stops_s = np.zeros(len(durations_s), dtype=np.bool_), []
    for first, last in find_spans(is_still):
        seconds = float(run.time_s[last + 1] - run.time_s[first])
        if seconds >= MIN_STOP_S:
            is_standing[first : last + 1] = True
            stops_s.append(seconds)
    kinds = np.full(len(durations_s), ACTIVITY_KINDS.index(TRANSIT), dtype=np.int8)
    is_working = run.is_working[:-1] & ~gaps
    turns = tuple(_find_turns(run, is_standing)) if run.has_work_state else ()
    for turn in turns:
        kinds[turn.first : turn.last] = ACTIVITY_KINDS.index(TURNING)
    kinds[is_working] = ACTIVITY_KINDS.index(WORKING)
    kinds[gaps] = ACTIVITY_KINDS.index(UNLOGGED)
    kinds[is_standing] = ACTIVITY_KINDS.index(STANDING)
    return RunPhases(kinds, np.array(stops_s), int((run.is_working[:-1] & ~run.is_working[1:]).sum()), turns)


def _find_turns(run: ProjectedRun, is_standing: Flags) -> Iterator[LoggedTurn]:
    """Segments between two of work that are short enough for a turn."""
    durations_s, steps = np.diff(run.time_s), np.hypot(*np.diff(run.xy, axis=0).T)
    for (_, first), (last, _) in pairwise(find_spans(run.is_working)):
        length = float(steps[first:last].sum())
        if length > MAX_TURN_M:
            continue
        standing_s = float(durations_s[first:last][is_standing[first:last]].sum())
        before, after = _compute_direction(run.xy, first, -1), _compute_direction(run.xy, last, 1)
        bend_deg = float(np.degrees(np.arccos(np.clip(before @ after, -1.0, 1.0))))
        shift = run.xy[last] - run.xy[first]
        offset_m = abs(float(before[0] * shift[1] - before[1] * shift[0]))
        yield LoggedTurn(
            first, last, float(run.time_s[last] - run.time_s[first]), standing_s, length, bend_deg, offset_m
        )


def _compute_direction(xy: Floats, row: int, side: int) -> Floats:
    """The direction of driving (2,) at a row, over BEND_LENGTH_M before (-1) or after (1) it."""
    far_row = row
    while 0 <= far_row + side < len(xy) and np.hypot(*(xy[far_row] - xy[row])) < BEND_LENGTH_M:
        far_row += side
    displacement = side * (xy[far_row] - xy[row])
    return np.asarray(displacement / max(float(np.hypot(*displacement)), 1e-9))


def summarise_run(run: ProjectedRun) -> RunFigures:
    """The figures of a run."""
    run_phases = classify_phases(run)
    durations_s, steps = np.diff(run.time_s), np.hypot(*np.diff(run.xy, axis=0).T)
    by_kind = {kind: float(durations_s[run_phases.kinds == index].sum()) for index, kind in enumerate(ACTIVITY_KINDS)}
    has_work_state, counters = run.has_work_state, run.counters
    is_working = run.is_working[:-1]
    # Positions drift while a machine stands.
    is_moving = (run.speed_mps[:-1] >= STANDING_MPS) | (durations_s > MIN_STOP_S)
    active, inactive = (
        float(steps[rows & is_moving].sum()) if has_work_state else None for rows in (is_working, ~is_working)
    )
    total_m = counters[ACTIVE_M] + counters[INACTIVE_M] if {ACTIVE_M, INACTIVE_M} <= counters.keys() else None
    turns_without_stop = [turn for turn in run_phases.turns if not turn.standing_s]
    u_turns_s = [turn.seconds for turn in run_phases.turns if turn.is_u_turn]
    working_mps = run.speed_mps[run.is_working & (run.speed_mps > MOVING_MPS)]
    area_m2 = counters.get(AREA_M2)
    if area_m2 is None and run.width_m and active is not None:
        area_m2 = active * run.width_m
    return RunFigures(
        seconds=float(run.time_s[-1]),
        by_kind_s=by_kind,
        active_m=counters.get(ACTIVE_M, active),
        inactive_m=counters.get(INACTIVE_M, inactive),
        counted_m=total_m,
        placed_m=float(steps[is_moving].sum()),
        area_m2=area_m2,
        area_counted=AREA_M2 in counters,
        lifts=run_phases.lifts if has_work_state else None,
        turns=len(run_phases.turns) if has_work_state else None,
        u_turns=len(u_turns_s) if has_work_state else None,
        u_turn_s=float(np.median(u_turns_s)) if u_turns_s else None,
        stops=len(run_phases.stops_s),
        stops_s=float(run_phases.stops_s.sum()),
        working_mps=float(np.median(working_mps)) if len(working_mps) else None,
        turning_mps=sum(one.length_m for one in turns_without_stop) / sum(one.seconds for one in turns_without_stop)
        if turns_without_stop
        else None,
        fuel_l=counters.get(FUEL_L),
        width_m=run.width_m,
        rows=len(run.time_s),
    )


def find_run_inconsistencies(run: ProjectedRun, figures: RunFigures) -> list[str]:
    """Inconsistencies of a run, each a part of a sentence."""
    notes = list(run.notes)
    if figures.counted_m and abs(figures.placed_m / figures.counted_m - 1.0) > COUNTER_TOLERANCE:
        notes.append(
            f"{figures.placed_m / 1e3:.2f} km by positions, {figures.counted_m / 1e3:.2f} km by the machine's counter; "
            "the counter is used"
        )
    if run.outline is not None and run.outline_m2 and abs(run.outline.area / run.outline_m2 - 1.0) > COUNTER_TOLERANCE:
        notes.append(
            f"the field is {run.outline.area / 1e4:.2f} ha by its outline, {run.outline_m2 / 1e4:.2f} ha by its file"
        )
    return notes
