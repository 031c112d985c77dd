"""Row by row: a row leaves the queue when the row before it has reached its place in the next pass."""

from __future__ import annotations

from strategies.formations.abreast import Slot
from strategies.formations.care import driven
from strategies.formations.clear_rounds import AS_WRITTEN, Changes
from strategies.formations.formation import FORMATION_REPAIRS, Formation, form
from strategies.formations.queueing import Draft, past_release
from strategies.job import Job
from strategies.record import Refined, Simulate, Strategy
from vehicle.missions import Gate

NAME = "row-by-row"


def row_by_row(job: Job, *, move_up: bool = True, changes: Changes = AS_WRITTEN) -> Formation:
    """Rows turn one after another; each waits for the row before it to be in place."""
    return form(job, NAME, _row_before_in_place, move_up=move_up, changes=changes)


def _row_before_in_place(draft: Draft, number: int, slot: Slot) -> list[Gate]:
    """The row before is in place; of two in a row the one on the side that the turn leads to goes a little ahead."""
    row = [other for other in draft.rounds[number] if other.row == slot.row]
    gates = [draft.in_place(number, other.tractor) for other in draft.rounds[number] if other.row == slot.row - 1]
    if number and slot.row > 1 and slot is not row[-1] and draft.job.manner.ahead_m:
        beside, ahead_m = row[-1].tractor, draft.job.manner.ahead_m
        gates.append(past_release(draft.legs[beside], draft.marks[number, beside], beside, ahead_m))
    return gates


def _driven(job: Job, simulate: Simulate, *_: object) -> Refined:
    return driven(lambda changes: row_by_row(job, changes=changes), simulate).refined


STRATEGY = Strategy(
    name=NAME,
    words="triangle formation on neighbouring tracks; at the headland each row waits until the row before it is in "
    "place",
    build=lambda job: row_by_row(job).plan,
    abreast=True,
    refine=_driven,
    most_repairs=FORMATION_REPAIRS,
    least=lambda job: row_by_row(job).plan,
)
