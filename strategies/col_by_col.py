"""Column by column: the tractors of a formation turn strictly one after another."""

from __future__ import annotations

from functools import partial

from strategies.formations.compose import FormationRule, compose_formation
from strategies.formations.formation import MAX_FORMATION_REPAIRS, Formation, build_formation, repair_formation
from strategies.formations.grouping import NO_CHANGES, FormationChanges
from strategies.formations.queue_rules import queue_by_columns
from strategies.formations.queueing import FormationDraft
from strategies.formations.slots import FormationSlot
from strategies.program.field_job import FieldJob
from strategies.program.strategy_record import RefinedPlan, Simulate, Strategy
from vehicle.missions.plan import LegGate

NAME = "col-by-col"


def form_col_by_col(job: FieldJob, *, changes: FormationChanges = NO_CHANGES) -> Formation:
    """Tractors turn one after another: the leader, then the side the turn leads to, then the other side."""
    return build_formation(job, NAME, _build_turn_gates, changes=changes)


def _build_turn_gates(draft: FormationDraft, number: int, slot: FormationSlot) -> list[LegGate]:
    """Gate of the column order: the tractor ahead in the queue has finished its turn."""
    slots = draft.rounds[number]
    heading_side = -1 if slots[0].swath_pass.swath.line > slots[-1].swath_pass.swath.line else 1
    leader = next(s for s in slots if s.row == 1)

    def rank_slot(s: FormationSlot) -> tuple[int, int]:
        is_on_turn_side = (s.swath_pass.swath.line - leader.swath_pass.swath.line) * heading_side > 0
        return (0 if s.row == 1 else 1 if is_on_turn_side else 2), s.row

    queue = sorted(slots, key=rank_slot)
    position = queue.index(slot)
    return [draft.build_turn_gate(number, queue[position - 1].tractor)] if position else []


def _refine_col_by_col(job: FieldJob, simulate: Simulate, *_: object) -> RefinedPlan:
    return repair_formation(lambda changes: form_col_by_col(job, changes=changes), simulate).refined


STRATEGY = Strategy(
    name=NAME,
    description="drive in a triangle; the leader turns first, then one side, then the other",
    build=lambda job: form_col_by_col(job).plan,
    side_by_side=True,
    refine=_refine_col_by_col,
    max_repairs=MAX_FORMATION_REPAIRS,
    build_bound=lambda job: form_col_by_col(job).plan,
    compose=partial(compose_formation, rule=FormationRule(NAME, queue_by_columns)),
)
