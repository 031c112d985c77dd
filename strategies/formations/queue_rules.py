"""How tractors leave the queue at the end of a round: row by row, or column by column."""

from __future__ import annotations

from strategies.formations.formation_plan import RoundDraft
from strategies.formations.rounds import get_row
from vehicle.missions.plan import LegGate


def queue_by_rows(draft: RoundDraft, number: int, tractor: int) -> list[LegGate]:
    """The row before is in place; of two in a row, the one on the side the turn leads to goes slightly ahead."""
    row, ahead_m = get_row(tractor, draft.tractors), draft.table.site.rules.ahead_m
    rows = {other: get_row(other, draft.tractors) for other in range(draft.tractors)}
    gates = [draft.build_place_gate(number, other) for other in rows if rows[other] == row - 1]
    beside = max(other for other in rows if rows[other] == row)
    if row > 1 and beside != tractor and ahead_m:
        gates.append(draft.build_release_gate(number, beside, ahead_m))
    return gates


def queue_by_columns(draft: RoundDraft, number: int, tractor: int) -> list[LegGate]:
    """The tractor ahead in the queue has finished its turn: the leader's, then the turn's side, then the other side."""
    leader = (draft.tractors - 1) // 2
    onward = 1 if _moves_up(draft, number) else -1

    def rank_tractor(other: int) -> tuple[int, int]:
        is_ahead = (other - leader) * onward > 0
        return (0 if other == leader else 1 if is_ahead else 2), get_row(other, draft.tractors)

    queue = sorted(range(draft.tractors), key=rank_tractor)
    position = queue.index(tractor)
    return [draft.build_turn_gate(number, queue[position - 1])] if position else []


def _moves_up(draft: RoundDraft, number: int) -> bool:
    """Whether a round lies on the side of the last columns of the round before it."""
    before, after = draft.rounds[number - 1].one, draft.rounds[number].one
    return after.columns[0].swath > before.columns[0].swath


def leave_when_clear(draft: RoundDraft, number: int, tractor: int) -> list[LegGate]:
    """Nobody waits for its turn: whoever is in whose way, the scheduler of the plan tells."""
    return []
