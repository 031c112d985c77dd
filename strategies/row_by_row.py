"""Row by row: a row leaves the queue when the row before it has reached its place in the next pass."""

from __future__ import annotations

from strategies.abreast import Slot
from strategies.care import driven
from strategies.formation import FORMATION_REPAIRS, Formation, form
from strategies.job import Job
from strategies.queueing import Draft
from strategies.record import Strategy
from vehicle.missions import Gate

NAME = "row-by-row"


def row_by_row(job: Job, *, move_up: bool = True) -> Formation:
    """Rows turn one after another; each waits for the row before it to be in place."""
    return form(job, NAME, _row_before_in_place, move_up=move_up)


def _row_before_in_place(draft: Draft, number: int, slot: Slot) -> list[Gate]:
    return [draft.in_place(number, other.tractor) for other in draft.rounds[number] if other.row == slot.row - 1]


STRATEGY = Strategy(
    name=NAME,
    words="triangle formation on neighbouring tracks; at the headland each row waits until the row before it is in "
    "place",
    build=lambda job: row_by_row(job).plan,
    abreast=True,
    refine=lambda job, simulate, tractor, implement: driven(row_by_row(job), simulate),
    most_repairs=FORMATION_REPAIRS,
)
