"""A formation driven, and where two of its tractors meet on their way into a round, one lets the other go first.

Two of a row leave the queue together where that is clear. Where it is not, the one on the side the formation moves
away from waits: at first until the other has begun its turn, in the end until it is in its place.
"""

from __future__ import annotations

from strategies.formation import Formation
from strategies.queueing import ARRIVED_M, past_release
from strategies.record import Refined, Simulate
from vehicle.missions import Gate, Plan
from vehicle.run import CONFLICT, DONE, Conflict

BEGUN_M = (10.0, 20.0)  # how far the other has driven since it left the queue, before its place is waited for
Pair = tuple[int, int, int]
"""Round, tractor that waits, tractor it waits for."""


def driven(formation: Formation, simulate: Simulate) -> Refined:
    """The plan of a formation with as little waiting as it is found to need, and its run.

    Where waiting does not help, the plan is handed back as it was written, to be mended like any other.
    """
    plan, care = formation.plan, dict[Pair, int]()
    most = 1 + (len(BEGUN_M) + 1) * sum(len(slots) for slots in formation.rounds)
    for _ in range(most):
        run = simulate(plan)
        if run.outcome == DONE:
            return Refined(plan, run, told(plan))
        pair = _pair(formation, run.conflict) if run.outcome == CONFLICT and run.conflict else None
        if pair is None or care.get(pair, 0) > len(BEGUN_M):
            break
        level = care[pair] = care.get(pair, 0) + 1
        plan = plan.with_gate(pair[1], formation.marks[pair[:2]].release, _gate(formation, pair, level))
    return Refined(plan, None, told(plan))


def told(plan: Plan) -> str | None:
    """What a reader of a formation plan would not expect: that not all of it is driven in formation."""
    share, apart = plan.notes.get("formation_pct"), plan.notes.get("apart")
    if share is None or not apart:
        return None
    names = [str(tractor) for tractor in apart]
    by = f"tractor {names[0]}" if len(names) == 1 else f"tractors {', '.join(names[:-1])} and {names[-1]}"
    return f"{min(round(share), 99)} % of the tracks driven in formation, the rest by {by}"


def _pair(formation: Formation, clash: Conflict) -> Pair | None:
    """Who should wait for whom, where both are on their way into the same round."""
    one = met_on_way(formation, clash)
    if one is None:
        return None
    rows = {slot.tractor: slot.row for slot in formation.rounds[one]}
    first, waits = sorted((clash.first, clash.second), key=lambda tractor: (rows[tractor], -tractor))
    return one, waits, first


def met_on_way(formation: Formation, clash: Conflict) -> int | None:
    """The round into which both were on their way; None where they met elsewhere."""
    one, other = _coming(formation, clash.first, clash.first_leg), _coming(formation, clash.second, clash.second_leg)
    return one if one == other else None


def _coming(formation: Formation, tractor: int, leg: int) -> int | None:
    """The round a tractor is on its way to on a leg."""
    for number in range(1, len(formation.rounds)):
        marks = formation.marks.get((number, tractor))
        if marks and marks.release <= leg <= marks.placed:
            return number
    return None


def _gate(formation: Formation, pair: Pair, level: int) -> Gate:
    """What the one that waits waits for."""
    number, _, first = pair
    marks, legs = formation.marks[number, first], formation.plan.missions[first].legs
    if level > len(BEGUN_M):
        return Gate(first, marks.placed, max(0.0, legs[marks.placed].length_m - ARRIVED_M))
    return past_release(legs, marks, first, BEGUN_M[level - 1])
