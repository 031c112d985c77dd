"""Column by column: tractors turn strictly one after another."""

from __future__ import annotations

from strategies.formations.abreast import Slot
from strategies.formations.care import driven
from strategies.formations.clear_rounds import AS_WRITTEN, Changes
from strategies.formations.formation import FORMATION_REPAIRS, Formation, form
from strategies.formations.queueing import Draft
from strategies.job import Job
from strategies.record import Refined, Simulate, Strategy
from vehicle.missions import Gate

NAME = "col-by-col"


def col_by_col(job: Job, *, changes: Changes = AS_WRITTEN) -> Formation:
    """Tractors turn one after another: the leader, the side the turn leads to, the other side."""
    return form(job, NAME, _after_previous, changes=changes)


def _after_previous(draft: Draft, number: int, slot: Slot) -> list[Gate]:
    """Gate of column order: the tractor before this one has finished its turn."""
    slots = draft.rounds[number]
    heading_side = -1 if slots[0].this.track.line > slots[-1].this.track.line else 1
    leader = next(s for s in slots if s.row == 1)

    def order(s: Slot) -> tuple[int, int]:
        towards = (s.this.track.line - leader.this.track.line) * heading_side > 0
        return (0 if s.row == 1 else 1 if towards else 2), s.row

    queue = sorted(slots, key=order)
    place = queue.index(slot)
    return [draft.turned(number, queue[place - 1].tractor)] if place else []


def _driven(job: Job, simulate: Simulate, *_: object) -> Refined:
    return driven(lambda changes: col_by_col(job, changes=changes), simulate).refined


STRATEGY = Strategy(
    name=NAME,
    words="triangle formation; leader, then one side, then the other turn one after another",
    build=lambda job: col_by_col(job).plan,
    abreast=True,
    refine=_driven,
    most_repairs=FORMATION_REPAIRS,
    least=lambda job: col_by_col(job).plan,
)
