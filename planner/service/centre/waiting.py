"""Where tractors of a plan made anew wait: not on legs released to one that drives, as those are not taken back.

A plan made anew begins where everybody is, and may have a tractor wait there. One that drives is elsewhere when the
plan is accepted: it can wait at the end of its released legs at the earliest. One that stands because it was told to
waits where it stands: the centre holds it until what it waits for has been driven.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from planner.service.centre.errors import CentreError
from planner.service.centre.remaining import Rest
from vehicle.missions import Gate, Leg, Mission, Plan
from vehicle.run import DONE, Run


def waiting_where_it_can(rest: Rest, run: Run, simulate: Callable[[Plan], Run]) -> Run:
    """The run of a plan of what is left in which nobody waits where it cannot; its legs count from the present ones.

    Raises CentreError where the plan is not driven to its end so, and says which tractor is to be paused.
    """
    plan, drive_on = _moved(rest, run.plan)
    if plan is run.plan:
        return run
    again = simulate(plan)
    if again.outcome == DONE:
        return again
    if drive_on:
        who = " and ".join(f"tractor {number + 1}" for number in drive_on)
        raise CentreError(
            f"{who.capitalize()} would have to wait on what is driven already: pause {who} and ask again once all who "
            "are paused stand; resumed after the plan is accepted, they wait where they stand.", parameter="without",
        )  # fmt: skip
    raise CentreError("The rest cannot be planned from where tractors stand: they would wait for each other. Let those "
                      "that are paused go on, and ask again.", parameter="without")  # fmt: skip


def _moved(rest: Rest, plan: Plan) -> tuple[Plan, list[int]]:
    """The plan with all gates on released legs moved to where they can be waited at, and who of those drives on; the
    plan itself where there are none."""
    missions, drive_on, changed = list(plan.missions), [], False
    for number, mission in enumerate(plan.missions):
        own = released_legs(rest, number)
        if not any(gate.tractor not in rest.without for leg in mission.legs[:own] for gate in leg.gates):
            continue
        place = 0 if rest.stands(number) else own
        if place:
            drive_on.append(number)
        if own == 1 and place == 0:
            continue  # it waits where it stands already
        missions[number], changed = Mission(_gathered(mission.legs, own, place)), True
    return (Plan(tuple(missions), plan.notes) if changed else plan), drive_on


def released_legs(rest: Rest, number: int) -> int:
    """How many legs of a tractor, from the present one on, it may drive already."""
    state = rest.states[number]
    return max(state.released - state.leg, 1 if rest.begun(number) else 0)


def _gathered(legs: tuple[Leg, ...], own: int, place: int) -> tuple[Leg, ...]:
    """Legs with the gates of the first `own` at another one, or nowhere where there is none so far on; of those on one
    tractor the last to open stands for all."""
    last: dict[int, Gate] = {}
    for gate in (gate for leg in (*legs[:own], *legs[place : place + 1]) for gate in leg.gates):
        known = last.setdefault(gate.tractor, gate)
        last[gate.tractor] = max(known, gate, key=lambda each: (each.leg, each.after_m))
    free = [replace(leg, gates=()) if k < own else leg for k, leg in enumerate(legs)]
    if place < len(free):
        free[place] = replace(free[place], gates=tuple(last.values()))
    return tuple(free)
