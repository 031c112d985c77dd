"""A plan with refills: every tractor's own stops, and who is served first where only one is served at a time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from strategies.errors import StrategyError
from strategies.job import Job
from strategies.legs import mission_from
from strategies.refilling.stops import CLEAR_M, Filled, Stop, filled
from strategies.supply import PLACE, Supply
from vehicle.missions import DRIVE_IN, Gate, Leg, Plan

SERVED_M = 0.5  # a tender when the one before has moved off


def with_refills(job: Job, plan: Plan, *, abreast: bool = False, staggered: bool = True) -> Plan:
    """The plan with all stops of its tractors, noted as `refills`, none where a load is enough for each.

    `collects` is noted as well: whether the amounts are taken out of the tanks.

    With `staggered` a tractor heeds when those before it are served, where only one is served at a time. Tractors
    `abreast` are served on the headland, where the others wait at their gates until all are in place. Raises
    StrategyError where a load cannot be made good in time, or a formation would have to part for it.
    """
    supply = job.supply
    if supply is None:
        return plan
    own: list[Filled] = []
    for mission in plan.missions:
        busy = [span for each in own for span in each.served] if supply.alone and staggered else []
        own.append(filled(job, supply, mission, busy))
    if not any(each.stops for each in own):
        return replace(plan, notes={**plan.notes, "refills": []})
    if abreast and job.tractors > 1 and supply.alone:
        raise StrategyError(no_leave(job, supply))
    legs = [_renumbered(each.legs, own) for each in own]
    if supply.alone and job.tractors > 1:
        queue(legs, [each.stops for each in own], supply)
    notes = {key: value for key, value in plan.notes.items() if key != "order_gap_pct"}
    notes["refills"] = [entry for number, each in enumerate(own) for entry in _entries(number, each)]
    notes["collects"] = supply.collects
    return Plan(tuple(mission_from(each) for each in legs), notes)


def no_leave(job: Job, supply: Supply) -> str:
    """Why a formation does without refills, and what helps."""
    hectares = supply.capacity / supply.rate_per_m2 / 1e4
    return (
        f"Tractors that work abreast wait for each other, so none is served alone, and a load of {supply.capacity:g} "
        f"lasts for {hectares:.3g} ha of its share; refill on the headland, use split-field or interleaved, or a "
        "larger tank."
    )


def _entries(number: int, own: Filled) -> list[dict[str, float | int]]:
    """The stops of a tractor for the notes of a plan: tractor from 1, leg from 0, amount, place in metres."""
    entries: list[dict[str, float | int]] = []
    for stop in own.stops:
        x, y = own.legs[stop.leg].points[0].tolist()
        entries.append({"tractor": number + 1, "leg": stop.leg, "amount": round(stop.amount, 3), "x_m": x, "y_m": y})
    return entries


def _renumbered(legs: Sequence[Leg], own: Sequence[Filled]) -> list[Leg]:
    """Legs whose gates and follow orders name the legs of others by their new numbers."""

    def gate(old: Gate) -> Gate:
        moved = own[old.tractor].moved
        gone = old.leg + 1 < len(moved) and moved[old.leg + 1] == moved[old.leg]
        return replace(old, leg=moved[old.leg], after_m=0.0 if gone else old.after_m)

    return [
        replace(
            leg,
            gates=tuple(gate(old) for old in leg.gates),
            follow=leg.follow and replace(leg.follow, leg=own[leg.follow.tractor].moved[leg.follow.leg]),
        )
        if leg.gates or leg.follow
        else leg
        for leg in legs
    ]


@dataclass
class _Clock:
    """When each tractor has begun its legs at the soonest (s), and when it is through with the last of them."""

    legs: list[list[Leg]]
    begun: list[list[float]]
    free_s: list[float]

    def ready_s(self, tractor: int) -> float:
        """When a tractor can begin its next leg; infinite where that is not known, or it has none."""
        number = len(self.begun[tractor])
        if number == len(self.legs[tractor]):
            return math.inf
        return max([self.free_s[tractor], *(self._opened_s(gate) for gate in self.legs[tractor][number].gates)])

    def _opened_s(self, gate: Gate) -> float:
        begun = self.begun[gate.tractor]
        if gate.leg >= len(begun):
            return math.inf
        leg = self.legs[gate.tractor][gate.leg]
        return begun[gate.leg] + leg.stand_s + min(gate.after_m, leg.length_m) / leg.speed_mps

    def begin(self, tractor: int, at: float) -> None:
        """Let a tractor begin its next leg."""
        leg = self.legs[tractor][len(self.begun[tractor])]
        self.begun[tractor].append(at)
        self.free_s[tractor] = at + leg.stand_s + leg.length_m / leg.speed_mps


def queue(legs: list[list[Leg]], stops: Sequence[Sequence[Stop]], supply: Supply) -> None:
    """Give legs the gates by which tractors are served one at a time, in the order in which they would come.

    Tractors are moved leg by leg in the order of time at the speeds that their legs ask for, so that whoever waits does
    so for one that gets on: no two wait for each other.
    """
    clock = _Clock(legs, [[] for _ in legs], [0.0] * len(legs))
    asks = [{_asks(stop, supply): stop for stop in each} for each in stops]
    queued: set[tuple[int, int]] = set()
    before: tuple[int, Gate] | None = None
    while True:
        ready = [round(clock.ready_s(tractor), 3) for tractor in range(len(legs))]
        tractor = ready.index(min(ready))
        number = len(clock.begun[tractor])
        if math.isinf(ready[tractor]):
            return
        if number not in asks[tractor] or (tractor, number) in queued:
            clock.begin(tractor, ready[tractor])
            continue
        queued.add((tractor, number))
        if before is not None and before[0] != tractor:
            legs[tractor][number] = legs[tractor][number].with_gates([before[1]])
        before = tractor, _left(legs[tractor], tractor, asks[tractor][number], supply)


def _asks(stop: Stop, supply: Supply) -> int:
    """The leg before which a tractor waits until it is its turn."""
    return stop.hold if supply.where == PLACE else stop.leg


def _left(legs: Sequence[Leg], tractor: int, stop: Stop, supply: Supply) -> Gate:
    """Gate that opens when a tractor has left where it is served."""
    leg, metres = stop.leg, CLEAR_M if supply.where == PLACE else SERVED_M
    while metres > legs[leg].length_m and leg + 1 < len(legs) and legs[leg].task.kind != DRIVE_IN:
        metres -= legs[leg].length_m
        leg += 1
    return Gate(tractor, leg, max(0.0, min(metres, legs[leg].length_m)))
