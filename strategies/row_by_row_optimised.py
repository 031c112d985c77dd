"""Row-by-row with its waiting times optimised (thesis, section 6.3.2).

The headland is cut into stretches along its length. A simulated row-by-row run tells when, after its release, each
tractor is on each stretch; a constraint program (OR-Tools CP-SAT) finds the releases that bring the whole formation
into place soonest with no stretch used twice at a time. The releases become gates on how far the others have come,
and the result is simulated; where tractors come too close, the stretches are held longer.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from strategies.abreast import Slot
from strategies.care import driven, met_on_way, told
from strategies.formation import FORMATION_REPAIRS, Formation, form
from strategies.job import Job
from strategies.queueing import Draft, past_release
from strategies.record import Refined, Simulate, Strategy
from strategies.row_by_row import row_by_row
from vehicle.compile import outline
from vehicle.layout import REC_ANGLE, REC_PLACE, REC_X, REC_Y
from vehicle.missions import Gate, Plan
from vehicle.run import DONE, Run
from vehicle.tractor import Implement, Tractor

if TYPE_CHECKING:
    from ortools.sat.python import cp_model

NAME = "row-by-row-optimised"
ALONE = "one tractor waits for nobody, so it is driven as row-by-row"
NOT_QUICKER = "no optimised queue proved quicker, so it is driven as row-by-row"
STRETCH_M = 1.5
BEFORE_LINE_M = 1.0  # a tractor is on the headland when any part of it is less than this short of the line
IN_PLACE_M = 0.3
TICKS_PER_S = 10
HOLDS_S = (0.0, 1.0, 2.0, 4.0)
Floats = npt.NDArray[np.float64]
Releases = Mapping[tuple[int, int], tuple[tuple[int, float], ...]]
"""For (round, tractor): it may leave the queue when each named tractor is so many metres past its own release."""


@dataclass(frozen=True)
class Passage:
    """One tractor's way through a headland after its release, measured in a run.

    `taken` maps a stretch to (first, last) seconds on it; `metres` (t,) is the distance at 10 Hz; `placed_s` when it
    is in place.
    """

    tractor: int
    taken: dict[int, tuple[float, float]]
    metres: Floats
    placed_s: float


def row_by_row_timed(job: Job, releases: Releases) -> Formation:
    """Row by row with given releases instead of the queue; nobody moves up before."""

    def released(draft: Draft, number: int, slot: Slot) -> list[Gate]:
        waits_for = releases.get((number, slot.tractor), ())
        return [
            past_release(draft.legs[other], draft.marks[number, other], other, metres) for other, metres in waits_for
        ]

    return form(job, NAME, released, move_up=False)


def optimised(job: Job, simulate: Simulate, tractor: Tractor, implement: Implement) -> Refined:
    """The timed plan and its run: per round the shortest hold that drives without conflict, else the plain queue."""
    plain = driven(row_by_row(job), simulate)
    if job.tractors == 1:
        return replace(plain, remark=ALONE)
    best = replace(plain, remark="; ".join(words for words in (NOT_QUICKER, plain.remark) if words))
    queued = row_by_row(job, move_up=False)
    alike = max(slot.row for slots in queued.rounds for slot in slots) <= 2  # nobody has a place to move up to
    measured = plain if alike else driven(queued, simulate)
    if measured.run is None or plain.run is None:
        return best
    timed = _timed(job, queued, measured.run, simulate, lambda number: _passages(
        job, queued, measured.run, number, tractor, implement
    ))
    return timed if timed and timed.run and timed.run.duration_s < plain.run.duration_s else best


def _timed(
    job: Job, queued: Formation, measured: Run, simulate: Simulate, passages: Callable[[int], list[Passage]]
) -> Refined | None:
    """The plan with optimised releases, driven; a round in which tractors meet is held longer, or queues as measured.

    Rounds that are reached from afar or driven by one alone are left as they are. None where it cannot be driven.
    """
    base = row_by_row_timed(job, {})
    times = {
        number: _Timing(queued.rounds[number], passages(number), number)
        for number in range(1, len(queued.rounds))
        if not queued.moved[number] and len(queued.rounds[number]) > 1
    }
    for _ in range(1 + len(HOLDS_S) * len(times)):
        plan = base.plan
        for number, timing in times.items():
            for slot in timing.slots:
                release = base.marks[number, slot.tractor].release
                for gate in timing.gates(base, measured.plan, slot):
                    plan = plan.with_gate(slot.tractor, release, gate)
        run = simulate(plan)
        if run.outcome == DONE:
            return Refined(plan, run, told(plan))
        met = met_on_way(base, run.conflict) if run.conflict else None
        if met not in times or not times[met].hold_longer():
            return None
    return None


@dataclass
class _Timing:
    """The releases of one round as they are tried: `tried` holds were too short."""

    slots: tuple[Slot, ...]
    group: list[Passage]
    number: int
    tried: int = 0
    found: Releases | None = None

    def hold_longer(self) -> bool:
        """Take the next hold, after the last one the plain queue; False when that was tried too."""
        self.tried, self.found = self.tried + 1, None
        return self.tried <= len(HOLDS_S)

    def gates(self, base: Formation, measured: Plan, slot: Slot) -> tuple[Gate, ...]:
        """What a tractor of the round waits for before its release."""
        if self.tried == len(HOLDS_S):
            return measured.missions[slot.tractor].legs[base.marks[self.number, slot.tractor].release].gates
        if self.found is None:
            self.found = _releases(self.number, self.group, self.slots, HOLDS_S[self.tried])
        waits_for = self.found.get((self.number, slot.tractor), ())
        return tuple(
            past_release(base.plan.missions[other].legs, base.marks[self.number, other], other, metres)
            for other, metres in waits_for
        )


def _passages(
    job: Job, formation: Formation, run: Run, number: int, tractor: Tractor, implement: Implement
) -> list[Passage]:
    return [_passage(job, formation, run, number, slot, tractor, implement) for slot in formation.rounds[number]]


def _passage(
    job: Job, formation: Formation, run: Run, number: int, slot: Slot, tractor: Tractor, implement: Implement
) -> Passage:
    """Cut one tractor's passage out of the record and note which stretches its outline covers when."""
    marks = formation.marks[number, slot.tractor]
    legs = run.leg(slot.tractor)
    first, last = int(np.argmax(legs >= marks.release)), int(np.argmax(legs >= marks.work))
    poses = run.poses(slot.tractor)[first : max(last, first + 2)]
    along, across = _outline_extents(job, slot, poses, tractor, implement)
    line = _line(job, slot)
    taken: dict[int, tuple[float, float]] = {}
    for index in np.flatnonzero(along > line - BEFORE_LINE_M):
        low, high = across[index]
        for stretch in range(math.floor(low / STRETCH_M), math.floor(high / STRETCH_M) + 1):
            start = taken.get(stretch, (index / TICKS_PER_S, 0.0))[0]
            taken[stretch] = start, (index + 1) / TICKS_PER_S
    metres = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(poses[:, REC_PLACE], axis=0).T))))
    placed = int(np.argmax(metres > metres[-1] - IN_PLACE_M))
    return Passage(slot.tractor, taken, metres, placed / TICKS_PER_S)


def _outline_extents(
    job: Job, slot: Slot, poses: Floats, tractor: Tractor, implement: Implement
) -> tuple[Floats, Floats]:
    """How far the outline reaches out of the track (t,), and its extent along the headland (t, 2)."""
    heading = job.heading(slot.this) + math.pi  # out of the track just worked is against the coming pass
    out = np.array([math.cos(heading), math.sin(heading)])
    side = np.array([-out[1], out[0]]) * (1 if slot.this.direction > 0 else -1)
    corners = _corners(outline(tractor, implement))
    cosine, sine = np.cos(poses[:, REC_ANGLE]), np.sin(poses[:, REC_ANGLE])
    x = poses[:, REC_X, None] + corners[:, 0] * cosine[:, None] - corners[:, 1] * sine[:, None]
    y = poses[:, REC_Y, None] + corners[:, 0] * sine[:, None] + corners[:, 1] * cosine[:, None]
    along = (x * out[0] + y * out[1]).max(axis=1)
    across = x * side[0] + y * side[1]
    return along, np.column_stack([across.min(axis=1), across.max(axis=1)])


def _corners(boxes: dict[str, float]) -> Floats:
    """Corners of the boxes of tractor and implement (8, 2), forward and to the left of the centre of mass."""
    ends = {"nose": "half_width", "tail": "half_width", "tool_front": "tool_half_width", "tool_tail": "tool_half_width"}
    return np.array([[boxes[end], sign * boxes[half]] for end, half in ends.items() for sign in (1, -1)])


def _line(job: Job, slot: Slot) -> float:
    """The headland line of the coming pass, measured out of the field."""
    x, y, heading = job.entry(slot.this)
    return -(x * math.cos(heading) + y * math.sin(heading))


def _releases(number: int, group: list[Passage], slots: tuple[Slot, ...], hold_s: float) -> Releases:
    """Optimal releases of one round as distances the others must have driven since their own release."""
    when = _solve(group, slots, hold_s)
    by_time = sorted(range(len(group)), key=lambda i: (when[i], slots[i].row, i))
    releases: dict[tuple[int, int], tuple[tuple[int, float], ...]] = {}
    for place, mine in enumerate(by_time):
        gates = []
        for other in by_time[:place]:
            lag = (when[mine] - when[other]) / TICKS_PER_S
            if lag > 0 and group[mine].taken.keys() & group[other].taken.keys():
                metres = group[other].metres
                gates.append((group[other].tractor, float(metres[min(round(lag * TICKS_PER_S), len(metres) - 1)])))
        releases[number, group[mine].tractor] = tuple(gates)
    return releases


def _solve(group: list[Passage], slots: tuple[Slot, ...], hold_s: float) -> list[int]:
    """Release of each tractor in ticks: all in place soonest, then released soonest, no stretch shared."""
    from ortools.sat.python import cp_model

    model = cp_model.CpModel()
    ticks = [math.ceil(passage.placed_s * TICKS_PER_S) for passage in group]
    horizon = sum(ticks) + round(hold_s * TICKS_PER_S) * len(group) * 2
    release = [model.new_int_var(0, horizon, f"release_{i}") for i in range(len(group))]
    stretches: dict[int, list[cp_model.IntervalVar]] = {}
    for start, passage in zip(release, group, strict=True):
        for stretch, (first, last) in sorted(passage.taken.items()):
            begin = math.floor(first * TICKS_PER_S)
            length = math.ceil((last + hold_s) * TICKS_PER_S) - begin
            interval = model.new_fixed_size_interval_var(start + begin, length, "")
            stretches.setdefault(stretch, []).append(interval)
    place = {slot.tractor: index for index, slot in enumerate(slots)}
    for index, slot in enumerate(slots):
        if slot.neighbour is not None:
            model.add(release[index] >= release[place[slot.neighbour]])
    for stretch in sorted(stretches):
        model.add_no_overlap(stretches[stretch])
    placed = model.new_int_var(0, horizon + max(ticks), "placed")
    for start, length in zip(release, ticks, strict=True):
        model.add(placed >= start + length)
    model.minimize(placed * (horizon * len(group) + 1) + sum(release))
    solver = cp_model.CpSolver()
    solver.parameters.num_workers = 1
    solver.parameters.random_seed = 1
    solver.parameters.max_deterministic_time = 2.0
    status = solver.solve(model)
    if status not in (cp_model.OPTIMAL, cp_model.FEASIBLE):
        return _one_after_another(ticks)
    return [solver.value(var) for var in release]


def _one_after_another(ticks: list[int]) -> list[int]:
    """Releases without any overlap, when the solver ran out of its share of time."""
    starts = [0]
    for length in ticks[:-1]:
        starts.append(starts[-1] + length)
    return starts


STRATEGY = Strategy(
    name=NAME,
    words="the same, with releases found by constraint programming from simulated turns, and simulated again; says so "
    "where none is quicker",
    build=lambda job: row_by_row(job).plan,
    abreast=True,
    refine=optimised,
    most_repairs=FORMATION_REPAIRS,
)
