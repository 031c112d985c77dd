"""Tractors of a fleet as each drives alone on the field, several in one world; and what a fleet drives, from these.

A tractor heeds others by gates, by orders to follow and where they touch. As long as none of this counts it drives in a
fleet what it drives alone, bit for bit, so that either is known from the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, reduce
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from vehicle.clearance import too_close
from vehicle.jit import compiled
from vehicle.layout import DT_S, FINISHED, REC_ANGLE, REC_STATUS, REC_X, REC_Y, STATE
from vehicle.loop import GETS_ON_M
from vehicle.missions import Gate, Mission, Plan
from vehicle.run import DONE, Run
from vehicle.world import STALL_S, Snapshot

TURNING = 3.0  # times as fast as a tractor its corners move at most
MORE = 1.01  # than what needs be, for what sums are rounded by
Array = npt.NDArray[np.float64]


@dataclass(eq=False)
class Driven:
    """A plan that was driven, where the legs of each tractor end (m), and the world at moments of its run.

    `close` is how far each tractor had come (m, each (n,)) every second from some of these moments to the next. `apart`
    tells whether each was driven as if it were alone.
    """

    plan: Plan
    ends: Sequence[Array]
    kept: list[Snapshot] = field(default_factory=list)
    close: dict[int, list[Array]] = field(default_factory=dict)
    apart: bool = False

    @cached_property
    def progress(self) -> Array:
        """How far each tractor had come at these moments (m), (k, n)."""
        return np.array([one.states["progress"] for one in self.kept]).reshape(len(self.kept), self.plan.tractors)

    def place_m(self, gate: Gate) -> float:
        """How far the tractor that a gate waits for has come when it opens."""
        return (float(self.ends[gate.tractor][gate.leg - 1]) if gate.leg else 0.0) + gate.after_m


@dataclass(frozen=True, eq=False)
class Single:
    """A tractor as it is driven alone to its end, where its legs end (m), and moments of that by their step.

    Each is a snapshot, without its rows, and the number of the tractor in it.
    """

    run: Run
    ends: Array
    moments: dict[int, tuple[Snapshot, int]]

    @property
    def mission(self) -> Mission:
        """What it drives."""
        return self.run.plan.missions[0]


def single(
    run: Run, number: int, ends: Array, moments: Sequence[tuple[Snapshot, int]], most_s: float
) -> Single | None:
    """A tractor out of a run in which all were driven apart; None where a world of its own may end otherwise.

    That is where it is not done within `most_s`, or may have stood for too long.
    """
    finish = float(run.finish_s[number])
    if not finish + 0.5 * DT_S < most_s or not _gets_on(moments, finish):
        return None
    rows = int(np.argmax(run.record[:, number, REC_STATUS] == FINISHED)) + 1
    own = Run(
        Plan((run.plan.missions[number],)), DONE, run.time_s[:rows], run.record[:rows, number : number + 1],
        run.finish_s[number : number + 1], (), np.inf,
    )  # fmt: skip
    before = (moment for moment in moments if moment[0].rows <= rows)
    return Single(own, ends, {one.step: (replace(one, chunks=()), place) for one, place in before})


def _gets_on(moments: Sequence[tuple[Snapshot, int]], finish_s: float) -> bool:
    """Whether a tractor gets on, or stands as it is asked to, from each moment to the next until it is done.

    Where these are no farther apart than half of the time in which it must, none can have gone by.
    """
    times, come, stands = [0.0], [0.0], [False]
    for one, number in moments:
        if one.time_s < finish_s:
            times.append(one.time_s)
            come.append(float(one.states["progress"][number]))
            stands.append(bool(one.states["stand_left"][number] > 0.0))
    seen = all(after - before <= 0.5 * STALL_S for before, after in pairwise([*times, finish_s]))
    gained = (after > before + GETS_ON_M for before, after in pairwise(come))
    return seen and all(more or any(pair) for more, pair in zip(gained, pairwise(stands), strict=True))


def together(singles: Sequence[Single]) -> Driven:
    """A fleet of these tractors, each of which drives as if it were alone, at the moments that are known of all."""
    steps = reduce(lambda known, one: known & one.moments.keys(), singles[1:], set(singles[0].moments))
    moments = ([one.moments[step] for one in singles] for step in sorted(steps))
    plan = Plan(tuple(one.mission for one in singles))
    return Driven(plan, [one.ends for one in singles], [_joined(each) for each in moments], apart=True)


def _joined(parts: Sequence[tuple[Snapshot, int]]) -> Snapshot:
    first, count = parts[0][0], len(parts)
    states = np.empty(count, dtype=STATE)
    for row, (one, number) in enumerate(parts):
        states[row] = one.states[number]
    motion = np.array([one.motion[number] for one, number in parts])
    near = np.zeros(count, dtype=np.bool_)
    return Snapshot(_clock(first, states), states, np.full(count, np.inf), motion, near, (), first.rows)


def _clock(one: Snapshot, states: npt.NDArray[np.void]) -> Array:
    """The clock of a snapshot for other tractors: as if they had got on at the last look."""
    return np.array([one.clock[0], states["progress"].sum(), one.time_s])


def part(one: Snapshot, numbers: Sequence[int]) -> Snapshot:
    """A snapshot of some of its tractors, of which none heeded the others."""
    states = one.states[numbers]
    return Snapshot(
        _clock(one, states), states, np.full(len(numbers), np.inf), one.motion[numbers],
        np.zeros(len(numbers), dtype=np.bool_), [rows[:, numbers] for rows in one.record()], one.rows,
    )  # fmt: skip


def met_by(
    fleet: Driven, singles: Sequence[Single], allowed: int, models: npt.NDArray[np.void], limits: tuple[float, float],
    reach_m: float,
) -> Snapshot | None:
    """The last of a fleet's first `allowed` moments from which its run goes on as driven apart up to the next of these.

    So it does until two come too close by `limits` (vehicle.clearance.too_close), or so close that they may touch
    before the next look: `reach_m` is what a tractor drives at most until then. In between all get on, so that it is
    the same then when they last did. None where there is no such moment.
    """
    if allowed < 2:
        return None
    record = np.concatenate([one.run.record[: fleet.kept[allowed - 1].rows] for one in singles], axis=1)
    clearances = np.full(len(singles), np.inf)
    leaves = np.array([one.mission.leaves for one in singles])
    least = (*limits, TURNING * reach_m)
    states = np.zeros(len(singles), dtype=STATE)
    free = _free_rows(record, states, leaves, models, clearances, *least)
    for number in range(allowed - 2, -1, -1):
        begin, end = fleet.kept[number], fleet.kept[number + 1]
        gained = fleet.progress[number + 1].sum() - fleet.progress[number].sum()
        if end.rows <= free and gained > MORE * GETS_ON_M * (end.rows - begin.rows):
            rows = record[: begin.rows]
            clearances[:] = np.inf
            _free_rows(rows, states, leaves, models, clearances, *least)
            return replace(begin, clearances=clearances, chunks=(rows,))
    return None


@compiled
def _free_rows(record, states, leaves, models, clearances, stop, beside, least):  # type: ignore[no-untyped-def]
    """The first row of a record at which two are too close or may come to touch, else their number; `clearances`."""
    for row in range(len(record)):
        for i in range(len(states)):
            states[i].x, states[i].y = record[row, i, REC_X], record[row, i, REC_Y]
            states[i].angle = record[row, i, REC_ANGLE]
            states[i].away = 1 if leaves[i] and record[row, i, REC_STATUS] == FINISHED else 0
        _, first, _ = too_close(states, models, clearances, stop, beside)
        if first >= 0 or clearances.min() < least:
            return row
    return len(record)
