"""What is left of a fleet that is driven: taken out of its centre, and held against the fleet as it is later."""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from dataclasses import dataclass

import shapely

from planner.service.centre.core import Core
from planner.service.centre.errors import CentreError
from planner.service.centre.fleet_plan import FleetPlan
from planner.service.centre.foresight import braking_m
from planner.service.centre.guard import MOVING_MPS
from planner.service.centre.tractors import DRIVEN, MANUAL, REMOTE, TractorState

MOVED_M = 1.0  # of a tractor that stands
LEAST_M = 0.05


@dataclass(frozen=True, eq=False)
class Rest:
    """A fleet as it is: plan, tractors, who drives no more, and what stands in the way."""

    plan: FleetPlan
    states: tuple[TractorState, ...]
    without: tuple[int, ...]
    obstacles: tuple[shapely.Polygon, ...]
    driven_s: float
    times: float

    def begun(self, number: int) -> bool:
        """Whether a tractor has driven anything of its plan."""
        state = self.states[number]
        return state.leg > 0 or state.leg_m > LEAST_M

    def stands(self, number: int) -> bool:
        """Whether a tractor stands because it has been told to, and so can wait where it is."""
        return stands(self.states[number])


def stands(state: TractorState) -> bool:
    """Whether a tractor stands because it has been told to."""
    return state.standing_ordered and state.report is not None and state.report.speed_mps < MOVING_MPS


def rest_of(centre: Core, without: Sequence[int], now: float) -> Rest:
    """What is left of a fleet without these tractors and those that have failed. Raises CentreError."""
    gone = tuple(sorted({*without, *(n for n, state in enumerate(centre.states) if state.out)}))
    if not gone and not centre.obstacles.items:
        raise CentreError("No tractor has failed and nothing stands in the way; say without whom to plan.",
                          parameter="without")  # fmt: skip
    if len(gone) == len(centre.states):
        raise CentreError("No tractor is left to take over; leave one in.", parameter="without")
    if centre.plan.field is None:
        raise CentreError("The field of this plan is not known here; make the fleet with its field file.",
                          parameter="field")  # fmt: skip
    _check_on_legs(centre, gone)
    states = tuple(copy.copy(state) for state in centre.states)
    driven_s = 0.0 if centre.started_s is None else (now - centre.started_s) * centre.rules.times
    shapes = tuple(block.shape for block in centre.obstacles.items.values())
    return Rest(centre.plan, states, gone, shapes, driven_s, centre.rules.times)


def _check_on_legs(centre: Core, gone: Sequence[int]) -> None:
    """Raise CentreError for a tractor that is to drive on and was led off its leg: a plan would begin on the leg."""
    for number, (state, course) in enumerate(zip(centre.states, centre.courses, strict=True)):
        report = state.report
        led = DRIVEN in state.holds or state.mode in (REMOTE, MANUAL)
        if number in gone or state.done or report is None or not led:
            continue
        off_m = course.off_m(state.leg, (report.x_m, report.y_m))
        if off_m > centre.rules.rejoin_m:
            raise CentreError(
                f"Tractor {number + 1} stands {off_m:.1f} m off its leg; drive it back to within "
                f"{centre.rules.rejoin_m:g} m, or plan without it.", parameter="without",
            )  # fmt: skip


def check_still(rest: Rest, centre: Core, made: FleetPlan | None = None) -> None:
    """Raise CentreError where a plan `made` of this rest is no plan for the fleet as it is now.

    That is for another plan, for a tractor that has failed since, and for one that was to drive no more, or to wait
    where it stood, and is not where it was, rolling to a stand aside. How far the others are is seen when the plan is
    adopted.
    """
    if centre.plan is not rest.plan:
        raise CentreError("Another plan is driven since this one was made; plan the rest anew.", parameter="proposal")
    for number, (state, before) in enumerate(zip(centre.states, rest.states, strict=True)):
        if state.failed and number not in rest.without:
            raise CentreError(f"Tractor {number + 1} has failed since the plan was made; plan the rest anew.",
                              parameter="proposal")  # fmt: skip
        moved = state.leg > before.leg or _moved_m(before, state) > _rolls_m(before, rest, centre)
        waits = made is not None and rest.begun(number) and bool(made.courses[number].legs[before.leg].gates)
        if waits and moved:
            raise CentreError(
                f"Tractor {number + 1} was to wait where it stood and has moved {_moved_m(before, state):.1f} m; pause "
                "it and plan the rest anew.", parameter="proposal",
            )  # fmt: skip
        if number in rest.without and moved:
            raise CentreError(
                f"Tractor {number + 1} has moved {_moved_m(before, state):.1f} m since the plan was made without it; "
                "stop it and plan the rest anew.", parameter="proposal",
            )  # fmt: skip
    _check_on_legs(centre, rest.without)


def _moved_m(before: TractorState, state: TractorState) -> float:
    """How far a tractor is from where it was; one that is heard of for the first time might be anywhere."""
    if state.report is None:
        return 0.0
    if before.report is None:
        return math.inf
    return math.dist((state.report.x_m, state.report.y_m), (before.report.x_m, before.report.y_m))


def _rolls_m(before: TractorState, rest: Rest, centre: Core) -> float:
    """How far it may have rolled until it stood."""
    speed = 0.0 if before.report is None else before.report.speed_mps
    return MOVED_M + speed * centre.rules.reaction_s * rest.times + braking_m(speed, centre.rules)
