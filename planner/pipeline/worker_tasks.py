"""Candidates as tasks for an executor, with inputs and results that can be sent to another process.

`warm_up_simulation` loads every compiled function by a small simulation and a small schedule.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from threading import current_thread

import numpy as np

from planner.evaluation.candidates.evaluate import Candidate, Outcome, simulate_candidates
from planner.evaluation.context import PlanningContext
from planner.evaluation.site import store_moves, take_moves, tell_moves
from planner.evaluation.time_share import TimeSpentError
from planner.pipeline.executors import iter_completed
from planner.pipeline.outputs.pictures import build_run_picture
from planner.traffic.precedence import schedule_plan
from vehicle.missions.plan import FollowOrder, Leg, LegGate, Mission, Plan
from vehicle.missions.run import DONE, SimulationRun
from vehicle.model.tractor import Implement, Tractor, load_tractor
from vehicle.sim.path_conflicts import ClearanceCheck
from vehicle.sim.world import simulate

CONTEXT_ATTRIBUTE = "headland_context"  # under this name a thread keeps its context
Progress = Callable[[int, int], None]


def pack_context(context: PlanningContext) -> bytes:
    """The pickled context that every task takes, with what is known of its moves; each thread unpacks its own, so that
    threads share nothing.

    The thread that packs it keeps using the original with its cached paths.
    """
    packed = pickle.dumps((context, tell_moves(context)))
    _cache_context(packed, context)
    return packed


def evaluate_task(
    packed_context: bytes, candidates: Sequence[Candidate], with_pictures: bool = False, prunes: bool = False
) -> list[tuple[int, Outcome]]:
    """Evaluate candidates of one number of tractors in a packed context, with their numbers; see simulate_candidates.

    Only feasible plans keep their run.
    Where time does not suffice for all, those that it sufficed for; raises TimeSpentError without any.
    """
    context, outcomes = unpack_context(packed_context), list[tuple[int, Outcome]]()
    try:
        for number, one in simulate_candidates(context, candidates, prunes):
            result, run, picture = one.result, one.run, None
            if run is not None and run.outcome == DONE and with_pictures:
                picture = build_run_picture(context, run, result)
            outcomes.append((number, replace(one, run=run if result.feasible else None, picture=picture)))
    except TimeSpentError:
        if not outcomes:
            raise
    store_moves(context)
    return outcomes


def unpack_context(packed_context: bytes) -> PlanningContext:
    """The context, unpacked once for consecutive tasks of a thread, so that paths found for one serve the next.

    The thread keeps it until it ends or gets another one.
    """
    cached: tuple[bytes, PlanningContext] | None = getattr(current_thread(), CONTEXT_ATTRIBUTE, None)
    if cached is None or cached[0] != packed_context:
        context, moves = pickle.loads(packed_context)
        if moves is not None:
            take_moves(context, moves)
        return _cache_context(packed_context, context)
    return cached[1]


def _cache_context(packed_context: bytes, context: PlanningContext) -> PlanningContext:
    setattr(current_thread(), CONTEXT_ATTRIBUTE, (packed_context, context))
    return context


def group_candidates(candidates: Sequence[Candidate]) -> list[list[int]]:
    """Numbers of the candidates of every task: one for every number of tractors, the largest first."""
    counts = sorted({one.tractors for one in candidates}, reverse=True)
    return [[index for index, one in enumerate(candidates) if one.tractors == count] for count in counts]


def iter_outcomes(
    executor: Executor,
    packed_context: bytes,
    candidates: Sequence[Candidate],
    progress: Progress | None = None,
    *,
    prunes: bool = False,
    with_pictures: bool = False,
) -> Iterator[tuple[int, Outcome]]:
    """Yield (index, outcome) of candidates as tasks finish, one for every number of tractors, the largest first.

    `progress` is called with (done, total). With `prunes` only what may be the quickest of its number is driven.
    """
    groups = group_candidates(candidates)
    tasks = [(packed_context, [candidates[index] for index in group], with_pictures, prunes) for group in groups]
    done = 0
    for task, outcomes in iter_completed(executor, evaluate_task, tasks):
        for number, outcome in outcomes:
            done += 1
            if progress:
                progress(done, len(candidates))
            yield groups[task][number], outcome


def warm_up_simulation() -> None:
    """Drive two tractors a few metres, with a gate, a follower and a reverse leg."""
    tractor, implement = load_tractor("eg105"), Implement()

    def build_leg(y: float, start: float, end: float, **more: object) -> Leg:
        return Leg(np.array([[start, y], [end, y]]), 1.4, **more)  # type: ignore[arg-type]

    first = Mission((build_leg(0, 0, 8), build_leg(0, 8, 6, gear=-1)))
    second = Mission((build_leg(9, 0, 4, gates=(LegGate(0, 0, 2.0),), follow=FollowOrder(0, 0, 10.0)),))
    simulate(Plan((first, second)), tractor, implement, stop_clearance_m=0.05)
    _warm_up_scheduling(tractor, implement)


def _warm_up_scheduling(tractor: Tractor, implement: Implement) -> None:
    """Schedule two tractors whose paths cross."""

    def build_mission(heading: tuple[float, float]) -> Mission:
        steps = [np.outer([begin, begin + 12.0], heading) for begin in (-24.0, -12.0, 0.0)]
        return Mission(tuple(Leg(points, 1.4, may_wait=True) for points in steps))

    def simulate_alone(plan: Plan, numbers: Sequence[int]) -> Iterator[SimulationRun]:
        return (simulate(Plan((plan.missions[number],)), tractor, implement) for number in numbers)

    schedule_plan(
        Plan((build_mission((1.0, 0.0)), build_mission((0.0, 1.0)))),
        ClearanceCheck.for_machine(tractor, implement, 0.5, 0.5),
        simulate_alone,
    )
