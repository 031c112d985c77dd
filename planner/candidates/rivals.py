"""Candidates that cannot win are told so with their bound, and not simulated.

One strategy whose tractors have tracks of their own is driven first with every number of tractors. Another plan of as
many tractors that takes longer than that, however well it is driven, would be ranked behind it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from planner.candidates.beaten import Beaten, Rival, beaten, from_any_corner, result_of, surely
from planner.candidates.bounds import least_s, pace_of, ungated
from planner.candidates.evaluate import Candidate, corners_of
from planner.candidates.headland import with_headland
from planner.candidates.within_reach import built_within_reach
from planner.scenario import SUREST
from planner.site import Site
from reports.results import PlanResult, finish_s
from strategies.errors import StrategyError
from strategies.job import Job
from strategies.record import Refined, Strategy
from strategies.registry import STRATEGIES
from vehicle.missions import Plan

WORTH_S = 900.0  # of work in tracks: on smaller fields every plan is simulated, as that is quick
WORTH_WHOLE_S = 1800.0  # or of work in tracks and rounds


def waves(site: Site, todo: Sequence[Candidate]) -> list[list[int]]:
    """Numbers of the candidates in the order they are simulated: one strategy before all others, save on small fields.

    All are simulated where the surest is asked for: a slower plan may be that.

    That is the first one of the registry, of those asked for, whose tractors have tracks of their own.
    """
    surest = site.stakes is not None and site.stakes.prefer == SUREST
    if surest or not worth_bounds(site):
        return [list(range(len(todo)))]
    asked = {one.strategy for one in todo}
    first = next((name for name in STRATEGIES if name in asked and not STRATEGIES[name].abreast), None)
    parts = [[n for n, one in enumerate(todo) if (one.strategy == first) is early] for early in (True, False)]
    return [part for part in parts if part]


def worth_bounds(site: Site) -> bool:
    """Whether one tractor works so long on tracks, or on tracks and rounds, that bounds save more than they take."""
    speed = site.manner.work_speed_mps
    tracks_s, rounds_s = site.layout.total_m / speed, math.fsum(lap.length_m for lap in site.rounds) / speed
    return tracks_s >= WORTH_S or tracks_s + rounds_s >= WORTH_WHOLE_S


def rivals(results: Mapping[int, PlanResult]) -> dict[int, Rival]:
    """The quickest feasible plan for every number of tractors, of those driven so far."""
    order = sorted((one for one in results.values() if one.feasible), key=_place, reverse=True)
    return {one.tractors: Rival(one.strategy, round(finish_s(one), 3), _tractor_s(one)) for one in order}


def _place(plan: PlanResult) -> tuple[float, str, int]:
    return round(finish_s(plan), 3), plan.strategy, plan.tractors


def _tractor_s(plan: PlanResult) -> float:
    """Seconds of all tractors together, with those that the ground left open would take."""
    return round((plan.tractor_time_s or 0.0) * (finish_s(plan) / plan.time_s if plan.time_s else 1.0), 3)


def hopeless(site: Site, candidate: Candidate, rival: Rival | None) -> PlanResult | None:
    """The candidate as one that cannot win; None where it might, or where only trying tells."""
    if rival is None:
        return None
    starts = _starts(site, candidate)
    first = next(starts, None)
    try:
        found = beaten(site, first.plans, rival) if first else None
    except StrategyError:
        return None
    if first is None or found is None:
        return None
    if STRATEGIES[candidate.strategy].abreast:
        found = from_any_corner(found) if surely(found) else _from_all(found, first, starts)
    return None if found is None else result_of(found, site, candidate.strategy, candidate.tractors)


def _from_all(found: Beaten, first: _Start, others: Iterator[_Start]) -> Beaten | None:
    """A formation that is beaten from the first corner, with the least from all; None where another might win."""
    more_s = found.seconds - first.tracks_s
    seconds = [found.seconds, *(more_s + other.tracks_s for other in others)]
    return replace(found, seconds=min(seconds)) if min(seconds) > found.rival.seconds else None


@dataclass(frozen=True)
class _Start:
    """What a candidate may do from one corner: the plan of its tracks, with no more waiting than it will have."""

    site: Site
    job: Job
    refined: Refined

    @property
    def tracks_s(self) -> float:
        """Seconds that the tracks take at least."""
        return least_s(self.refined.plan, pace_of(self.site.tractor, self.site.implement, self.site.manner.radius_m))

    @property
    def plans(self) -> list[Plan]:
        """The whole plan for every order of headland and tracks."""
        return [choice.plan for choice in next(with_headland(self.site, self.job, self.refined))]


def _starts(site: Site, candidate: Candidate) -> Iterator[_Start]:
    """A candidate from where it is driven first; a formation then from other corners, where that one cannot be driven.

    Where the rounds of the headland can be driven only by ways that keep the tractors farther apart, that takes longer.
    """
    strategy = STRATEGIES[candidate.strategy]
    job = replace(site.job(candidate.tractors), jump=candidate.jump)
    for corner in corners_of(job) if strategy.abreast else (job.corner,):
        try:
            refined, reached = built_within_reach(
                replace(job, corner=corner, used={}), lambda job: Refined(_least(strategy, job))
            )
            yield _Start(site, reached.job, refined)
        except StrategyError:
            continue


def _least(strategy: Strategy, job: Job) -> Plan:
    """A plan of a strategy; of one that is refined by driving, the plan that waits least."""
    if strategy.refine is None:
        return strategy.build(job)
    return strategy.least(job) if strategy.least else ungated(strategy.build(job))
