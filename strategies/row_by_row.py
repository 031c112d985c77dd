"""Row by row: a row leaves the queue when the row before it is in its place for the next round."""

from __future__ import annotations

from functools import partial

from strategies.formations.compose import FormationRule, compose_formation
from strategies.formations.formation import MAX_FORMATION_REPAIRS, Formation, build_formation, repair_formation
from strategies.formations.grouping import NO_CHANGES, FormationChanges
from strategies.formations.queue_rules import queue_by_rows
from strategies.formations.queueing import FormationDraft, build_release_gate
from strategies.formations.slots import FormationSlot
from strategies.program.field_job import FieldJob
from strategies.program.strategy_record import RefinedPlan, Simulate, Strategy
from vehicle.missions.plan import LegGate

NAME = "row-by-row"


def form_row_by_row(job: FieldJob, *, move_up: bool = True, changes: FormationChanges = NO_CHANGES) -> Formation:
    """Rows turn one after another; each waits until the row before it is in place."""
    return build_formation(job, NAME, _build_row_gates, move_up=move_up, changes=changes)


def _build_row_gates(draft: FormationDraft, number: int, slot: FormationSlot) -> list[LegGate]:
    """The row before is in place; of two in a row, the one on the side the turn leads to goes slightly ahead."""
    own_row = [other_slot for other_slot in draft.rounds[number] if other_slot.row == slot.row]
    gates = [
        draft.build_place_gate(number, other_slot.tractor)
        for other_slot in draft.rounds[number]
        if other_slot.row == slot.row - 1
    ]
    if number and slot.row > 1 and slot is not own_row[-1] and draft.job.driving_rules.ahead_m:
        beside_tractor, ahead_m = own_row[-1].tractor, draft.job.driving_rules.ahead_m
        gates.append(
            build_release_gate(draft.legs[beside_tractor], draft.marks[number, beside_tractor], beside_tractor, ahead_m)
        )
    return gates


def _refine_row_by_row(job: FieldJob, simulate: Simulate, *_: object) -> RefinedPlan:
    return repair_formation(lambda changes: form_row_by_row(job, changes=changes), simulate).refined


STRATEGY = Strategy(
    name=NAME,
    description="drive in a triangle on neighbouring swaths; "
    "at the headland each row waits until the row before it is in place",
    build=lambda job: form_row_by_row(job).plan,
    side_by_side=True,
    refine=_refine_row_by_row,
    max_repairs=MAX_FORMATION_REPAIRS,
    build_bound=lambda job: form_row_by_row(job).plan,
    compose=partial(compose_formation, rule=FormationRule(NAME, queue_by_rows, in_rows=True)),
)
