"""Formations that cannot win on a big field are told so with their bound, and not simulated.

Strategies whose tractors have tracks of their own are driven first. A formation of the same number of tractors that
takes longer than the best of them, however well it is driven, would be ranked behind it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from planner.candidates.bounds import least_s
from planner.candidates.evaluate import Candidate
from planner.candidates.headland import with_headland
from planner.site import Site
from reports.results import PlanResult, finish_s
from strategies.errors import StrategyError
from strategies.formations.promise import corners_by_promise
from strategies.job import Job
from strategies.record import Refined
from strategies.registry import STRATEGIES
from vehicle.missions import Mission, Plan

BIG_S = 30_000.0  # of work in tracks: on smaller fields every plan is simulated


@dataclass(frozen=True)
class Rival:
    """The quickest feasible plan of as many tractors: its strategy, and seconds until it has finished the field."""

    strategy: str
    seconds: float


def waves(site: Site, todo: Sequence[Candidate]) -> list[list[int]]:
    """Numbers of the candidates in the order they are simulated: on a big field formations after all others."""
    if site.layout.total_m / site.manner.work_speed_mps < BIG_S:
        return [list(range(len(todo)))]
    abreast = [STRATEGIES[one.strategy].abreast and one.tractors > 1 for one in todo]
    parts = [[number for number, late in enumerate(abreast) if late is part] for part in (False, True)]
    return [part for part in parts if part]


def rivals(results: Mapping[int, PlanResult]) -> dict[int, Rival]:
    """The quickest feasible plan for every number of tractors, of those driven so far."""
    order = sorted((round(finish_s(one), 3), one.strategy, one.tractors) for one in results.values() if one.feasible)
    return {tractors: Rival(strategy, seconds) for seconds, strategy, tractors in reversed(order)}


def hopeless(site: Site, candidate: Candidate, rival: Rival | None) -> PlanResult | None:
    """The candidate as one that cannot win; None where it might, or where only trying tells."""
    strategy = STRATEGIES[candidate.strategy]
    if rival is None or not strategy.abreast:
        return None
    least = min(_bounds(replace(site.job(candidate.tractors), jump=candidate.jump), site, strategy.name), default=0.0)
    if least <= rival.seconds:
        return None
    reason = f"cannot win: at least {least:.0f} s, {rival.strategy} takes {rival.seconds:.0f} s"
    return PlanResult(
        candidate.strategy, candidate.tractors, site.scenario.turn, False, reason, bound_s=round(least, 3)
    )


def _bounds(job: Job, site: Site, name: str) -> Iterator[float]:
    """The least seconds of a formation from every corner, its headland in every order.

    What it waits for is found by driving where it is refined, so that there only its ways count.
    """
    strategy = STRATEGIES[name]
    for corner in corners_by_promise(job):
        begun = replace(job, corner=corner, used={})
        try:
            for choice in next(with_headland(site, begun, Refined(strategy.build(begun)))):
                yield least_s(ungated(choice.plan) if strategy.refine else choice.plan)
        except StrategyError:
            continue


def ungated(plan: Plan) -> Plan:
    """The plan with nobody waiting for anybody."""
    free = (tuple(replace(leg, gates=(), follow=None) for leg in mission.legs) for mission in plan.missions)
    return Plan(tuple(Mission(legs) for legs in free), plan.notes)
