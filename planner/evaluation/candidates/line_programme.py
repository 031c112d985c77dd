"""One tractor on the work lines of a field, by moves that were driven well: what is measured of its programme."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np

from planner.evaluation.candidates.figures import MIN_BEYOND_M, CandidateRun, name_main_turns
from planner.evaluation.candidates.solo_runs import compute_timeout_s
from planner.evaluation.context import PlanningContext
from planner.evaluation.ground.contact_places import describe_position
from planner.evaluation.site import build_site
from planner.evaluation.time_share import NO_LIMIT
from reports.common.plan_results import PlanResult
from strategies.lines.lay_lines import lay_lines
from strategies.path_planning.turn_kinds import HEADLAND_FIRST
from strategies.programmes.build_plan import build_plan
from strategies.programmes.move_table import MoveTable
from strategies.programmes.programme import Programme, make_programme
from strategies.programmes.site_moves import SiteMoves
from vehicle.missions.plan import HEADLAND_PASS
from vehicle.missions.run import DONE, SimulationRun
from vehicle.sim.world import World

WELL_WORKED_PCT = 95.0  # of the field: with less worked by passes and turns, a programme is tried
MENTIONED_M2 = 20.0  # of ground on lines that are left: less is no remark


def run_programme(context: PlanningContext, by_passes: PlanResult) -> CandidateRun | None:
    """The run of the best programme of one tractor; None where nothing can be worked so, or not to its end.

    Not tried, so None, where passes and turns work the field well and inside its edges (`by_passes`), or with service
    stops, which programmes do not have, or in a share of time.
    """
    stays_inside = (by_passes.outside_along_m or 0.0) < MIN_BEYOND_M
    works_well = by_passes.feasible and stays_inside and (by_passes.worked_pct or 0.0) >= WELL_WORKED_PCT
    if works_well or by_passes.bound_s is not None or context.supply or context.time_share is not NO_LIMIT:
        return None
    site = build_site(context)
    lines = lay_lines(site)
    if not lines:
        return None
    table = MoveTable(SiteMoves(site, lines))
    programmes = [(order, _make_ordered(table, order)) for order in context.request.headland_orders or ("",)]
    order, programme = min(programmes, key=lambda one: _measure_cost_s(one[1]))
    if not any(programme.tours):
        return None
    plan = build_plan(programme, strategy=by_passes.strategy, headland=order or None)
    world = World(
        plan,
        context.tractor,
        context.implement,
        terrain=context.physics.terrain,
        load=context.physics.driven_load,
        seed=context.request.seed,
        position_errors=context.position_errors,
    )
    run: SimulationRun = world.run(max_time_s=compute_timeout_s(plan))
    if run.outcome != DONE:
        return None
    moves = (table.get_move(u, v) for u, v in programme.list_pairs())
    turns = Counter(move.kind for move in moves if move is not None and not move.is_work)
    return CandidateRun(run, None, name_main_turns(turns), describe_left(programme, context))


def _make_ordered(table: MoveTable, order: str) -> Programme:
    """The programme with the headland first or last; with no order every line may come at any time."""
    first = order == HEADLAND_FIRST
    stages = [int((line.task.kind == HEADLAND_PASS) != first) if order else 0 for line in table.lines]
    return make_programme(table, 1, stages)


def _measure_cost_s(programme: Programme) -> float:
    """Seconds of a programme with what its lines left would take, for comparing programmes."""
    if not any(programme.tours):
        return math.inf
    left_m2 = math.fsum(programme.table.lines[number].own_m2 for number in programme.left)
    worked_m2 = math.fsum(line.own_m2 for line in programme.table.lines) - left_m2
    return sum(programme.compute_tractor_s()) * (1.0 + left_m2 / max(worked_m2, 1.0))


def describe_left(programme: Programme, context: PlanningContext) -> str | None:
    """A remark on the lines that are left, with their area and the place of the largest; None without any to tell."""
    left = [programme.table.lines[number] for number in programme.left]
    area_m2 = math.fsum(line.own_m2 for line in left)
    if area_m2 < MENTIONED_M2:
        return None
    largest = max(left, key=lambda line: line.own_m2)
    x_m, y_m = np.mean(largest.paths[0], axis=0).tolist()
    count = "1 line of work is" if len(left) == 1 else f"{len(left)} lines of work are"
    return (
        f"{count} left, {area_m2:.0f} m2 in all, the largest {describe_position(x_m, y_m, context)}: not worth the "
        "drive for this machine; a smaller turning radius or a narrower implement may help"
    )
