"""What the tractors of plans drive alone on the field, each way driven once, however often it is asked for."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

from planner.candidates.bounds import asked_s, ungated
from planner.site import Site
from planner.yielding.courses import mission_key
from vehicle.missions import Mission, Plan
from vehicle.rehearsal import Rehearsal
from vehicle.run import Run
from vehicle.world import World

MOST_ROWS = 5_000_000  # of the records that are kept: some 300 MB
MOST_OF_A_PLAN = 2_500_000  # rows of a plan: above it is driven one tractor after another, which holds fewer at once
ROWS_PER_S = 10.0
ABREAST = 8  # as many are driven in one world: it takes little for itself then, and all are done at nearly one time


@dataclass(eq=False)
class _Expected:
    """A plan, and whether one of its tractors has been asked for."""

    given: Plan
    asked: bool = False

    @cached_property
    def plan(self) -> Plan:
        """The plan with nobody waiting."""
        return ungated(self.given)

    @cached_property
    def keys(self) -> list[bytes]:
        """What each of its tractors drives."""
        return [mission_key(mission) for mission in self.plan.missions]


class Alone:
    """Drives one mission of a site with nobody else on the field.

    Of a plan that is expected the first tractor that is asked for is driven by itself, as it may suffice; with the
    second one come the others, in one world. What of it a fleet has driven in the `rehearsal` is taken from there. On
    large fields the ways of earlier plans are forgotten for those of later ones.
    """

    def __init__(self, site: Site, rehearsal: Rehearsal | None = None) -> None:
        self.site, self.rehearsal = site, rehearsal
        self._known: dict[bytes, Run] = {}
        self._expected: list[_Expected] = []

    def expect(self, plans: Iterable[Plan]) -> None:
        """These plans, and none of those before them, are what is asked about next."""
        self._expected = [_Expected(plan) for plan in plans]

    def expect_also(self, plan: Plan) -> None:
        """This plan too may be asked about."""
        if all(plan is not one.given for one in self._expected):
            self._expected.append(_Expected(plan))

    def __call__(self, mission: Mission) -> Run:
        """The run of a mission in which its tractor waits for nobody."""
        key = mission_key(mission)
        if key not in self._known:
            self._drive_of_plan(key)
        if key not in self._known:
            self._forget_for([mission])
            world = World(
                Plan((mission,)), self.site.tractor, self.site.implement, seed=self.site.scenario.seed,
                position_errors=self.site.position_errors,
            )  # fmt: skip
            self._known[key] = world.run(max_time_s=patience_s(Plan((mission,))))
        return self._known[key]

    def _drive_of_plan(self, key: bytes) -> None:
        """Drive the tractor of an expected plan that has a key, and others with it."""
        one = next((one for one in self._expected if key in one.keys), None) if self.rehearsal else None
        if one is None or self.rehearsal is None or _rows(one.plan.missions) > MOST_OF_A_PLAN:
            return
        number, missions = one.keys.index(key), one.plan.missions
        numbers = [number]
        if one.asked:
            left = [n for n, other in enumerate(one.keys) if other not in self._known and one.keys.index(other) == n]
            order = sorted(left, key=lambda n: (-asked_s(missions[n]), n))
            place = order.index(number) // ABREAST * ABREAST
            numbers = sorted(order[place : place + ABREAST])
        one.asked = True
        self._forget_for([missions[n] for n in numbers])
        runs = self.rehearsal.apart(one.plan, numbers, [patience_s(Plan((missions[n],))) for n in numbers])
        self._known.update({one.keys[n]: run for n, run in zip(numbers, runs, strict=True) if run is not None})

    def _forget_for(self, missions: Sequence[Mission]) -> None:
        """Make room for what is driven next."""
        coming = _rows(missions)
        while self._known and sum(len(run.time_s) for run in self._known.values()) + coming > MOST_ROWS:
            del self._known[next(iter(self._known))]


def _rows(missions: Sequence[Mission]) -> float:
    """About how many rows the records of missions have."""
    return ROWS_PER_S * math.fsum(asked_s(mission) for mission in missions)


def patience_s(plan: Plan) -> float:
    """More than the plan takes with only one tractor moving at a time: whoever is not done by then never will be."""
    driven = sum(leg.stand_s + leg.length_m / leg.speed_mps for mission in plan.missions for leg in mission.legs)
    return 600.0 + 2.0 * driven
