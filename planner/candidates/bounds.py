"""The least time a plan can take: every leg at the speed and with the stand it asks for, nobody before its gates open.

No tractor drives a leg faster than the leg's speed, so that no run of a plan is done sooner, whoever gives way in it.
"""

from __future__ import annotations

from collections.abc import Sequence

from vehicle.missions import Gate, Leg, Plan


class _Clock:
    """When each tractor begins its legs at the soonest (s): what is known so far."""

    def __init__(self, plan: Plan) -> None:
        self.legs: list[Sequence[Leg]] = [mission.legs for mission in plan.missions]
        self.begun: list[list[float]] = [[] for _ in self.legs]
        self.free = [0.0] * len(self.legs)

    def opened_s(self, gate: Gate) -> float | None:
        """When a gate opens; None where that is not known yet."""
        begun = self.begun[gate.tractor]
        if gate.leg >= len(begun):
            return None
        leg = self.legs[gate.tractor][gate.leg]
        stood = leg.stand_s if gate.after_m > 0.0 else 0.0
        return begun[gate.leg] + stood + min(gate.after_m, leg.length_m) / leg.speed_mps

    def advance(self, tractor: int) -> bool:
        """Let a tractor drive on to a gate that is not known to open; whether it drove."""
        begun, legs = self.begun[tractor], self.legs[tractor]
        before = len(begun)
        while len(begun) < len(legs):
            leg = legs[len(begun)]
            opened = [self.opened_s(gate) for gate in leg.gates]
            known = [at for at in opened if at is not None]
            if len(known) < len(opened):
                break
            begun.append(max([self.free[tractor], *known]))
            self.free[tractor] = begun[-1] + leg.stand_s + leg.length_m / leg.speed_mps
        return len(begun) > before


def least_s(plan: Plan) -> float:
    """Seconds before which no run of the plan can be done.

    Where tractors wait for each other and none can go on, what is driven until then counts.
    """
    clock, moved = _Clock(plan), True
    while moved:
        moved = sum(clock.advance(tractor) for tractor in range(plan.tractors)) > 0
    return max(clock.free)
