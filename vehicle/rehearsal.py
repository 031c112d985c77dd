"""Simulate plans of one fleet one after another, each from where it first differs from one driven before.

Plans are mended by gates, slower legs and other turns, and driven again to see whether that helps. Up to the first leg
that was changed nothing can differ, so the run goes on from a snapshot of the other one, with the same result bit for
bit. That is the last one, or the last that was driven to its end: what is found wrong with it is mended after others.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from vehicle.control import ARRIVED_M
from vehicle.missions import Leg, Mission, Plan
from vehicle.run import DONE, Run
from vehicle.tractor import Implement, Tractor
from vehicle.world import Snapshot, World

SNAPSHOT_S = 60.0  # of simulated time
FASTER = 1.5  # than any leg asks for nobody drives
BESIDE_M = 1.0  # more than the guided point is ahead of where progress is counted to, errors of position included


@dataclass(eq=False)
class _Driven:
    """A plan that was driven, and the world at moments of its run."""

    plan: Plan
    kept: list[Snapshot] = field(default_factory=list)


class Rehearsal:
    """Drives the plans of a fleet; arguments as of World and its run. `began_s` is where the last run went on from."""

    def __init__(
        self, tractor: Tractor, implement: Implement, *, stop_clearance_m: float,
        beside_clearance_m: float | None = None, position_errors: Any = None, seed: int = 1,
    ) -> None:  # fmt: skip
        self.tractor, self.implement = tractor, implement
        self.stop_clearance_m, self.beside_clearance_m = stop_clearance_m, beside_clearance_m
        self.position_errors, self.seed = position_errors, seed
        self.began_s = 0.0
        self._last: _Driven | None = None
        self._done: _Driven | None = None

    def simulate(self, plan: Plan, max_time_s: float) -> Run:
        """The run of a plan, as a world of its own would drive it."""
        world = World(plan, self.tractor, self.implement, position_errors=self.position_errors, seed=self.seed)
        known = [self._common(driven, world, max_time_s) for driven in (self._last, self._done) if driven is not None]
        now = _Driven(plan, max(known, key=_last_s, default=[]))
        self.began_s = 0.0
        if now.kept:
            world.restore(now.kept[-1])
            self.began_s = now.kept[-1].time_s

        def keep(_: float) -> None:
            snapshot = world.snapshot()
            if snapshot is not None:
                now.kept.append(snapshot)

        run = world.run(
            stop_clearance_m=self.stop_clearance_m, beside_clearance_m=self.beside_clearance_m,
            max_time_s=max_time_s, progress=keep, chunk_s=SNAPSHOT_S,
        )  # fmt: skip
        now.kept = [one.within(run.record) for one in now.kept]
        self._last = now
        if run.outcome == DONE:
            self._done = now
        return run

    def _common(self, driven: _Driven, world: World, max_time_s: float) -> list[Snapshot]:
        """The snapshots of a run before which nobody heeded what the plan of this world has other than that one."""
        limits = self._limits(driven.plan, world)
        return [one for one in driven.kept if one.time_s < max_time_s and (one.states["progress"] < limits).all()]

    def _limits(self, before: Plan, world: World) -> npt.NDArray[np.float64]:
        """How far each tractor may have driven (m) without heeding what this plan has other than the one before."""
        plan, program = world.plan, world.program
        limits = np.full(plan.tractors, np.inf)
        for number, same in enumerate(same_legs(before, plan)):
            legs = plan.missions[number].legs
            if same < max(len(legs), len(before.missions[number].legs)):
                end = program.legs["end"][program.states["first_leg"][number] + same - 1] if same else 0.0
                limits[number] = end - self._sight_m(before.missions[number], plan.missions[number])
        return limits

    def _sight_m(self, *missions: Mission) -> float:
        """More than how far ahead a tractor heeds its legs.

        That is the way to stop in (vehicle.control.allowed_speed) and the point that it steers for, which is so far
        ahead of its antenna also where progress is counted from the rear axle.
        """
        fastest = FASTER * max(leg.speed_mps for mission in missions for leg in mission.legs)
        stop_m = fastest * fastest / (2.0 * self.tractor.speed.max_acceleration_mps2) + 1.0 + 2.0 * ARRIVED_M
        guidance = self.tractor.guidance
        aim_m = max(guidance.lookahead_m, guidance.turn_lookahead_m) + abs(self.tractor.antenna_forward_m) + BESIDE_M
        return max(stop_m, aim_m)


def _last_s(kept: list[Snapshot]) -> float:
    return kept[-1].time_s if kept else 0.0


def same_legs(before: Plan, after: Plan) -> list[int]:
    """How many legs at the start of each mission are driven the same in both plans; none where fleets differ.

    A gate or an order to follow that names a leg behind these holds in both for as long as they are driven.
    """
    if before.tractors != after.tractors:
        return [0] * after.tractors
    pairs = [list(zip(a.legs, b.legs, strict=False)) for a, b in zip(before.missions, after.missions, strict=True)]
    same = [_first(pair, _same_way) for pair in pairs]

    def same_links(a: Leg, b: Leg) -> bool:
        return a is b or _links(a, same) == _links(b, same)

    return [min(count, _first(pair[:count], same_links)) for count, pair in zip(same, pairs, strict=True)]


def _first(pairs: Sequence[tuple[Leg, Leg]], same: Callable[[Leg, Leg], bool]) -> int:
    """How many pairs at the start are the same."""
    return next((number for number, (a, b) in enumerate(pairs) if not same(a, b)), len(pairs))


def _same_way(a: Leg, b: Leg) -> bool:
    """Whether two legs are driven the same, but for whom they wait for and follow."""
    if a is b:
        return True
    told = [
        (leg.speed_mps, leg.gear, leg.implement, leg.ground, leg.task.kind, leg.stand_s, len(leg.points))
        for leg in (a, b)
    ]
    return told[0] == told[1] and (a.points is b.points or bool((a.points == b.points).all()))


def _links(leg: Leg, known: Sequence[int]) -> tuple[Any, ...]:
    """What a leg waits for and follows of so many legs of each tractor, and whether it waits for something later."""
    gates = {gate for gate in leg.gates if gate.leg < known[gate.tractor]}
    follow = leg.follow if leg.follow and leg.follow.leg < known[leg.follow.tractor] else None
    return gates, follow, len(gates) < len(set(leg.gates))
