"""How long the rounds of a formation take at least: nobody begins one before all are in their places."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

from strategies.formations.round_order import DirectedRound
from strategies.formations.rounds import get_row
from vehicle.missions.plan import GATE_MARGIN_M


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
    count, early_s, (in_rows, in_file) = len(after.moves), GATE_MARGIN_M / speed_mps, leave
    queues_m = [(place.hold_m, *place.up_m)[-1] for place in before.places]
    queued_s = [(queue_m - place.place_m) / speed_mps for queue_m, place in zip(queues_m, before.places, strict=True)]
    trios = zip(before.one.columns, queues_m, after.moves, strict=True)
    turns_s = [(column.length_m - queue_m) / speed_mps + move.drive_s for column, queue_m, move in trios]
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


def list_passes_s(each: DirectedRound, speed_mps: float) -> list[float]:
    """Per tractor the seconds from its place to the end of its column."""
    pairs = zip(each.one.columns, each.places, strict=True)
    return [(column.length_m - place.place_m) / speed_mps for column, place in pairs]
