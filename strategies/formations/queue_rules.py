"""How tractors leave the queue at the end of a round, row by row or column by column, and the least time it takes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

from strategies.formations.formation_plan import RoundDraft
from strategies.formations.round_order import DirectedRound
from strategies.formations.rounds import get_row
from vehicle.missions.plan import GATE_MARGIN_M, LegGate


def queue_by_rows(draft: RoundDraft, number: int, tractor: int) -> list[LegGate]:
    """The row before is in place; of two in a row, the one on the side the turn leads to goes slightly ahead."""
    row, ahead_m = get_row(tractor, draft.tractors), draft.table.site.rules.ahead_m
    rows = {other: get_row(other, draft.tractors) for other in range(draft.tractors)}
    gates = [draft.build_place_gate(number, other) for other in rows if rows[other] == row - 1]
    onward = max if _moves_up(draft, number) else min
    beside = onward(other for other in rows if rows[other] == row)
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


def measure_rounds_s(
    rounds: Sequence[DirectedRound], speed_mps: float, *, in_rows: bool = False, in_file: bool = False
) -> float:
    """Seconds from the begin of the first round to that of the last, whose gates open a little early.

    Rows leave one after another `in_rows`, tractors `in_file`.
    """
    early_s = GATE_MARGIN_M / speed_mps
    turns_s = [_measure_turn_s(*pair, speed_mps, (in_rows, in_file)) - early_s for pair in pairwise(rounds)]
    return math.fsum(turns_s) - early_s


def _measure_turn_s(before: DirectedRound, after: DirectedRound, speed_mps: float, leave: tuple[bool, bool]) -> float:
    """Seconds from the begin of a round to that of the next; who waits leaves when others are in place or turned."""
    count, early_s, (in_rows, in_file) = len(after.come_s), GATE_MARGIN_M / speed_mps, leave
    queues_m = [(place.hold_m, *place.up_m)[-1] for place in before.places]
    queued_s = [(queue_m - place.place_m) / speed_mps for queue_m, place in zip(queues_m, before.places, strict=True)]
    trios = zip(before.one.columns, queues_m, after.come_s, strict=True)
    turns_s = [(column.length_m - queue_m) / speed_mps + come_s for column, queue_m, come_s in trios]
    last_s = [place.place_m / speed_mps for place in after.places]
    if in_file and not after.is_afar:
        return min(queued_s) + math.fsum(turns_s) - (count - 1) * early_s + min(last_s)
    rows = [(get_row(k, count) if in_rows or after.is_afar else 0, k if after.is_afar else 0) for k in range(count)]
    begun_s = 0.0
    for row in sorted(set(rows)):
        ready_s = begun_s - early_s
        these = [k for k in range(count) if rows[k] == row]
        begun_s = max(max(queued_s[k], ready_s) + turns_s[k] + last_s[k] for k in these)
    return begun_s
