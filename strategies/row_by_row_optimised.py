"""Row-by-row with its waiting times optimised (thesis, section 6.3.2).

The headland is cut into stretches along its length. A simulated row-by-row run tells when, after its release, each
tractor is on each stretch; a constraint program (OR-Tools CP-SAT) finds the releases that bring the whole formation
into place soonest with no stretch used twice at a time. The releases become gates on how far the others have come,
and the result is simulated; where tractors come too close, the stretches are held longer.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

from strategies.formations.abreast import Slot
from strategies.formations.care import coming, driven, told
from strategies.formations.clear_rounds import AS_WRITTEN, Changes
from strategies.formations.formation import FORMATION_REPAIRS, Formation, form
from strategies.formations.passages import Passage, passages
from strategies.formations.queueing import Draft, past_release
from strategies.formations.releases import Releases, releases_of
from strategies.job import Job
from strategies.record import Refined, Simulate, Strategy
from strategies.row_by_row import row_by_row
from vehicle.missions import Gate, Leg, Mission, Plan
from vehicle.run import DONE
from vehicle.tractor import Implement, Tractor

NAME = "row-by-row-optimised"
ALONE = "one tractor waits for nobody, so it is driven as row-by-row"
NOT_QUICKER = "no optimised queue proved quicker, so it is driven as row-by-row"
HOLDS_S = (0.0, 1.0, 2.0, 4.0)


def row_by_row_timed(job: Job, releases: Releases, changes: Changes = AS_WRITTEN) -> Formation:
    """Row by row with given releases instead of the queue; nobody moves up before."""

    def released(draft: Draft, number: int, slot: Slot) -> list[Gate]:
        waits_for = releases.get((number, slot.tractor), ())
        return [
            past_release(draft.legs[other], draft.marks[number, other], other, metres) for other, metres in waits_for
        ]

    return form(job, NAME, released, move_up=False, changes=changes)


def optimised(job: Job, simulate: Simulate, tractor: Tractor, implement: Implement) -> Refined:
    """The timed plan and its run: per round the shortest hold that drives without conflict, else the plain queue."""
    queue = driven(lambda changes: row_by_row(job, changes=changes), simulate)
    plain = queue.refined
    if job.tractors == 1:
        return replace(plain, remark=ALONE)
    best = replace(plain, remark="; ".join(words for words in (NOT_QUICKER, plain.remark) if words))
    if plain.run is None:
        return best
    if max(slot.row for _, slot in queue.formation.slots) > 2:  # else nobody has a place to move up to
        queue = driven(lambda changes: row_by_row(job, move_up=False, changes=changes), simulate, queue)
    queued, measured, run = queue.formation, queue.refined.plan, queue.refined.run
    if run is None:
        return best

    def passed(number: int) -> list[Passage]:
        return passages(job, queued, run, number, tractor, implement)

    timed = _timed(job, queued, measured, simulate, passed)
    return timed if timed and timed.run and timed.run.duration_s < plain.run.duration_s else best


def _timed(
    job: Job, queued: Formation, measured: Plan, simulate: Simulate, passed: Callable[[int], list[Passage]]
) -> Refined | None:
    """The plan with optimised releases, driven; a round in which tractors meet is held longer, or queues as measured.

    Rounds that are reached from afar or driven by one alone are left as they are. None where it cannot be driven.
    """
    base = row_by_row_timed(job, {}, queued.changes)
    times = {
        number: _Timing(queued.rounds[number], passed(number), number)
        for number in range(1, len(queued.rounds))
        if not queued.moved[number] and len(queued.rounds[number]) > 1
    }
    for _ in range(1 + len(HOLDS_S) * len(times)):
        legs = {place: leg for timing in times.values() for place, leg in timing.released(base, measured).items()}
        plan = _with_legs(base.plan, legs)
        run = simulate(plan)
        if run.outcome == DONE:
            return Refined(plan, run, told(plan))
        met = set(coming(base, run.conflict)) if run.conflict else set()
        longer = [timing.hold_longer() for number, timing in times.items() if number in met]
        if not any(longer):
            return None
    return None


def _with_legs(plan: Plan, legs: Mapping[tuple[int, int], Leg]) -> Plan:
    """The plan with some legs in place of its own, by tractor and number."""
    return replace(plan, missions=tuple(
        Mission(tuple(legs.get((tractor, number), leg) for number, leg in enumerate(mission.legs)))
        for tractor, mission in enumerate(plan.missions)
    ))  # fmt: skip


@dataclass
class _Timing:
    """The releases of one round as they are tried: `tried` holds were too short."""

    slots: tuple[Slot, ...]
    group: list[Passage]
    number: int
    tried: int = 0
    legs: dict[tuple[int, int], Leg] = field(default_factory=dict)

    def hold_longer(self) -> bool:
        """Take the next hold, after the last one the plain queue; False when that was tried too."""
        if self.tried == len(HOLDS_S):
            return False
        self.tried, self.legs = self.tried + 1, {}
        return True

    def released(self, base: Formation, measured: Plan) -> dict[tuple[int, int], Leg]:
        """The legs with which the tractors of the round leave the queue, with what they wait for."""
        if not self.legs:
            waits = {} if self.tried == len(HOLDS_S) else releases_of(
                self.number, self.group, self.slots, HOLDS_S[self.tried]
            )
            for slot in self.slots:
                release = base.marks[self.number, slot.tractor].release
                gates = [
                    past_release(base.plan.missions[other].legs, base.marks[self.number, other], other, metres)
                    for other, metres in waits.get((self.number, slot.tractor), ())
                ]
                if self.tried == len(HOLDS_S):
                    gates = list(measured.missions[slot.tractor].legs[release].gates)
                self.legs[slot.tractor, release] = base.plan.missions[slot.tractor].legs[release].with_gates(gates)
        return self.legs


STRATEGY = Strategy(
    name=NAME,
    words="the same, with releases found by constraint programming from simulated turns, and simulated again; says so "
    "where none is quicker",
    build=lambda job: row_by_row(job).plan,
    abreast=True,
    refine=optimised,
    most_repairs=FORMATION_REPAIRS,
    least=lambda job: row_by_row_timed(job, {}).plan,
)
