"""Simulate plans of one fleet one after another, each from where it first differs from one driven before.

Plans are mended by gates, slower legs and other turns, and driven again to see whether that helps. Up to the first leg
that was changed nothing can differ, so the run goes on from a snapshot of the other one, with the same result bit for
bit; a gate counts only where it was not open yet when its tractor came in sight of it. That run is the last one, the
last that was driven to its end, as what is found wrong with it is mended after others, or what each drives alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from vehicle.apart import Driven, Single, met_by, part, single, together
from vehicle.control import ARRIVED_M
from vehicle.missions import Follow, Gate, Leg, Mission, Plan
from vehicle.run import DONE, Run
from vehicle.tractor import Implement, Tractor
from vehicle.world import Snapshot, World

SNAPSHOT_S = 60.0  # of simulated time
CLOSE_S = 1.0  # where it matters which of two tractors was sooner
FASTER = 1.5  # than any leg asks for nobody drives
BESIDE_M = 1.0  # more than the guided point is ahead of where progress is counted to, errors of position included

Array = npt.NDArray[Any]


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
        self._last: Driven | None = None
        self._done: Driven | None = None
        self._singles: dict[int, Single] = {}
        self._fleet: tuple[list[Single], Driven] | None = None

    def simulate(self, plan: Plan, max_time_s: float) -> Run:
        """The run of a plan, as a world of its own would drive it."""
        world = self._world(plan)
        known = [self._common(driven, plan, max_time_s) for driven in (self._last, self._done) if driven is not None]
        now = Driven(plan, world.ends_m, max(known, key=_last_s, default=[]))
        begin = self._from_singles(plan, max_time_s, world.models)
        if begin is not None and begin.time_s > _last_s(now.kept):
            now.kept = []
        else:
            begin = now.kept[-1] if now.kept else None
        self.began_s = 0.0
        if begin is not None:
            world.restore(begin)
            self.began_s = begin.time_s

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

    def apart(self, plan: Plan, numbers: Sequence[int], most_s: Sequence[float]) -> list[Run | None]:
        """What some tractors of a plan in which nobody waits drive, each alone on the field, for so long at most.

        None where only a world of its own tells, as for tractors with errors of position: these are drawn for each.
        """
        if self.position_errors is not None and len(self.position_errors):
            return [None] * len(numbers)
        kept = ((n, one) for n, one in self._singles.items() if n < plan.tractors and n not in numbers)
        self._singles = {n: one for n, one in kept if _same_legs(one, plan.missions[n])}
        self._fleet = None
        world = self._world(Plan(tuple(plan.missions[number] for number in numbers)))
        known = max((self._driven_alike(each, plan, numbers) for each in (self._last, self._done)), key=len)
        moments = [(one, list(numbers)) for one in known]
        if known:
            world.restore(part(known[-1], numbers))

        def keep(_: float) -> None:
            snapshot = world.snapshot()
            if snapshot is not None:
                moments.append((snapshot, list(range(len(numbers)))))

        run = world.run(apart=True, max_time_s=max(most_s), progress=keep, chunk_s=SNAPSHOT_S)
        for place, (number, ends, most) in enumerate(zip(numbers, world.ends_m, most_s, strict=True)):
            own = single(run, place, ends, [(one, places[place]) for one, places in moments], most)
            if own is not None:
                self._singles[number] = own
        return [self._singles[number].run if number in self._singles else None for number in numbers]

    def _driven_alike(self, driven: Driven | None, plan: Plan, numbers: Sequence[int]) -> list[Snapshot]:
        """The snapshots of a run before which some tractors heeded nothing that a plan has other than that one."""
        if driven is None or driven.plan.tractors != plan.tractors or not driven.kept:
            return []
        return driven.kept[: self._moments(driven, plan, numbers)]

    def _from_singles(self, plan: Plan, max_time_s: float, models: npt.NDArray[np.void]) -> Snapshot | None:
        """The last moment up to which a plan is known from what its tractors drive alone, if that is known."""
        own = [self._singles.get(number) for number in range(plan.tractors)]
        singles = [one for one, mission in zip(own, plan.missions, strict=True) if one and _same_legs(one, mission)]
        if plan.tractors == 1 or len(singles) < plan.tractors:
            return None
        if self._fleet is None or self._fleet[0] != singles:
            self._fleet = singles, together(singles)
        fleet = self._fleet[1]
        fastest = FASTER * max(leg.speed_mps for mission in plan.missions for leg in mission.legs)
        stop = self.stop_clearance_m
        limits = stop, stop if self.beside_clearance_m is None else self.beside_clearance_m
        allowed = len(self._common(fleet, plan, max_time_s))
        return met_by(fleet, singles, allowed, models, limits, fastest / self.tractor.guidance.rate_hz)

    def _world(self, plan: Plan) -> World:
        return World(plan, self.tractor, self.implement, position_errors=self.position_errors, seed=self.seed)

    def _common(self, driven: Driven, plan: Plan, max_time_s: float) -> list[Snapshot]:
        """The snapshots of a run before which nobody heeded what a plan has other than that one."""
        return [one for one in self._driven_alike(driven, plan, range(plan.tractors)) if one.time_s < max_time_s]

    def _moments(self, driven: Driven, plan: Plan, numbers: Sequence[int]) -> int:
        """How many of the snapshots of a run are before some of the tractors heeded what a plan has other than it."""
        same, most = same_ways(driven.plan, plan), len(driven.kept)
        for number in numbers:
            before, mission = driven.plan.missions[number], plan.missions[number]
            sight_m = self._sight_m(before, mission)
            for leg in range(max(len(before.legs), len(mission.legs))):
                links = (before.legs[leg], mission.legs[leg]) if leg < same[number] else None
                if links and same_links(*links, same):
                    continue
                limit = (float(driven.ends[number][leg - 1]) if leg else 0.0) - sight_m
                unseen = int(np.count_nonzero(driven.progress[:, number] < limit))
                if unseen >= most:
                    break
                gates = _other_gates(*links, same) if links else None
                if gates is None or not self._open_by_then(driven, number, limit, gates):
                    most = unseen
                    break
            if not most:
                return 0
        return most

    def _open_by_then(self, driven: Driven, number: int, limit_m: float, gates: set[Gate]) -> bool:
        """Whether gates were open in a run while a tractor had not yet come so far as to see them."""
        moments = int(np.count_nonzero(driven.progress[:, number] < limit_m))

        def passed(progress: Array) -> bool:
            return all(progress[gate.tractor] >= driven.place_m(gate) for gate in gates)

        if moments and passed(driven.progress[moments - 1]):
            return True
        if not 0 < moments < len(driven.kept) or not passed(driven.progress[moments]):
            return False
        return any(passed(one) for one in self._closely(driven, moments - 1) if one[number] < limit_m)

    def _closely(self, driven: Driven, moment: int) -> list[Array]:
        """How far each tractor had come (m) every second until the next snapshot of a run."""
        if moment not in driven.close:
            world = self._world(driven.plan)
            world.restore(driven.kept[moment])
            driven.close[moment] = found = []
            world.run(
                stop_clearance_m=self.stop_clearance_m, beside_clearance_m=self.beside_clearance_m, chunk_s=CLOSE_S,
                max_time_s=driven.kept[moment + 1].time_s, apart=driven.apart,
                progress=lambda _: found.append(world.program.states["progress"].copy()),
            )  # fmt: skip
        return driven.close[moment]

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
    same, pairs = same_ways(before, after), zip(before.missions, after.missions, strict=True)
    return [
        next((n for n in range(count) if not same_links(a.legs[n], b.legs[n], same)), count)
        for count, (a, b) in zip(same, pairs, strict=True)
    ]


def _same_legs(one: Single, mission: Mission) -> bool:
    """Whether a mission has the legs of a tractor that was driven alone."""
    legs = one.mission.legs
    return len(legs) == len(mission.legs) and all(_same_way(*pair) for pair in zip(legs, mission.legs, strict=True))


def same_ways(before: Plan, after: Plan) -> list[int]:
    """As `same_legs` of plans for as many tractors, whoever waits for whom."""
    pairs = [list(zip(a.legs, b.legs, strict=False)) for a, b in zip(before.missions, after.missions, strict=True)]
    return [next((n for n, (a, b) in enumerate(pair) if not _same_way(a, b)), len(pair)) for pair in pairs]


def same_links(a: Leg, b: Leg, same: Sequence[int]) -> bool:
    """Whether two legs wait for and follow the same, where so many legs of each tractor are the same."""
    return a is b or _links(a, same) == _links(b, same)


def _other_gates(a: Leg, b: Leg, same: Sequence[int]) -> set[Gate] | None:
    """The gates that only one of two legs has; None where they differ in more, or these are on legs that differ."""
    (gates, follow, late), (others, leader, later) = _links(a, same), _links(b, same)
    return None if late or later or follow != leader else gates ^ others


def _same_way(a: Leg, b: Leg) -> bool:
    """Whether two legs are driven the same, but for whom they wait for and follow."""
    if a is b:
        return True
    told = [
        (leg.speed_mps, leg.gear, leg.implement, leg.ground, leg.task.kind, leg.stand_s, len(leg.points))
        for leg in (a, b)
    ]
    return told[0] == told[1] and (a.points is b.points or bool((a.points == b.points).all()))


def _links(leg: Leg, known: Sequence[int]) -> tuple[set[Gate], Follow | None, bool]:
    """What a leg waits for and follows of so many legs of each tractor, and whether it waits for something later."""
    gates = {gate for gate in leg.gates if gate.leg < known[gate.tractor]}
    follow = leg.follow if leg.follow and leg.follow.leg < known[leg.follow.tractor] else None
    return gates, follow, len(gates) < len(set(leg.gates))
