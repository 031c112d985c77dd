"""Rounds of the headland before or after the tracks of a plan, and how long they took."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from planner.site import Site
from strategies.entrance import with_entrance
from strategies.errors import StrategyError
from strategies.headland.rounds import FIRST, PASSAGES, Passage, with_rounds
from strategies.job import Job
from strategies.record import Refined
from vehicle.layout import FINISHED
from vehicle.missions import ROUND, Plan
from vehicle.run import Run

SAME_M = 20.0  # of rounds left out: so little decides nothing


def with_headland(site: Site, job: Job, refined: Refined) -> Iterator[list[Refined]]:
    """The plan with the rounds of the headland in every order that may be, to be compared by driving them.

    After these the same with other passages, for where none can be driven. With an entrance the ways in and out are
    part of all. Raises StrategyError where no order can.
    """
    if not job.rounds:
        yield [refined] if job.gate is None else [Refined(with_entrance(job, refined.plan), None, refined.remark)]
        return
    for passage in PASSAGES if job.tractors > 1 else PASSAGES[:1]:
        orders = [order for order in site.scenario.headland_orders if not (passage.alone and order == FIRST)]
        if orders:  # with one alone on the rounds first the others would stand on the headland
            plans = _plans(job, refined.plan, passage, orders)
            yield [Refined(plan, None, _remark(refined, plan)) for plan in plans]


def _plans(job: Job, plan: Plan, passage: Passage, orders: Sequence[str]) -> list[Plan]:
    """One plan for every order that leaves least of the rounds out."""
    plans: list[Plan] = []
    refusal: StrategyError | None = None
    for order in orders:
        try:
            plans.append(with_entrance(job, with_rounds(job, plan, order, passage)))
        except StrategyError as error:
            refusal = refusal or error
    if refusal is not None and not plans:
        raise refusal
    least = min((float(each.notes["left_m"]) for each in plans), default=0.0)
    return [each for each in plans if each.notes["left_m"] <= least + SAME_M]


def _remark(refined: Refined, plan: Plan) -> str | None:
    """What a reader would not expect of a plan with rounds."""
    left = plan.notes["left_m"]
    told = [refined.remark, f"{left:.0f} m of the rounds are left out, as no way leads there" if left else None]
    return "; ".join(each for each in told if each) or None


def headland_s(run: Run) -> float | None:
    """Seconds from when the first tractor is on a round until the last has left its last; None without rounds."""
    times = []
    for tractor, mission in enumerate(run.plan.missions):
        rounds = np.array([leg.task.kind == ROUND for leg in mission.legs])
        on = np.flatnonzero(rounds[run.leg(tractor)] & (run.status(tractor) != FINISHED))
        times += [float(run.time_s[on[0]]), float(run.time_s[on[-1]])] if len(on) else []
    return max(times) - min(times) if times else None
