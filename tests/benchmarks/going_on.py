"""Plans cut at random moments and gone on with, against what they would have taken: time, and share of ground worked.

    python -m tests.benchmarks.going_on [--cuts 20] [--seed 1] [--maps FOLDER]

A row is a plan cut at a moment, in every second one with a machine lost. `uncut` is what the plan would have taken for
the rest: to its end, or with a machine lost what was left of each line, with the move to it, dealt so that the machines
that go on are done soonest. They end the line that they are on, and all begin where they stand and leave by the
entrance: a move takes no less than the straight way.
"""

import argparse
import math
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

import numpy as np
import shapely
from scipy import optimize, sparse

from fields.arrays import Floats
from fields.geometry.overlays import unite_areas
from planner.evaluation.ground.coverage import measure_coverage
from planner.evaluation.ground.swept_area import compute_swept_area
from planner.pipeline.executors import SerialExecutor
from planner.pipeline.going_on import cut_run, read_continued_order
from planner.pipeline.planning import PlanningResult, plan
from planner.request.plan_request import PlanRequest
from vehicle.missions.plan import LEAVE
from vehicle.missions.run import SimulationRun

MOST_NODES = 2000  # of a search for the best deal, whose bound counts
JOBS = (
    PlanRequest(field="denmark", width_m=6.0, tractors=(2,), strategies=("split-field",)),
    PlanRequest(field="iwamizawa", width_m=3.0, tractors=(2,), strategies=("split-field",)),
    PlanRequest(field="netherlands", width_m=6.0, tractors=(3,), strategies=("split-field",)),
    PlanRequest(field="sweden", width_m=9.0, tractors=(2,), strategies=("interleaved",), operation="sow"),
    PlanRequest(field="iwamizawa", width_m=3.0, tractors=(3,), strategies=("row-by-row",)),
)


@dataclass(frozen=True)
class LineLeft:
    """What is left of a work line after a moment: where it begins and ends, and its seconds.

    `move_s` is that of the move to it and `home_s` of the way out behind it, as the plan drove them.
    """

    begin: Floats
    end: Floats
    move_s: float
    work_s: float
    home_s: float = 0.0

    def turn_round(self) -> Self:
        """The same line driven the other way, from whose end nobody has driven out."""
        return replace(self, begin=self.end, end=self.begin, home_s=0.0)


@dataclass(frozen=True)
class MachineLeft:
    """What a machine has before it after a moment: lines, and where it leaves the field, None where it may end."""

    place: Floats
    lines: list[LineLeft]
    gate: Floats | None


def measure_rest_s(whole: PlanningResult, cut_s: float, without: Sequence[int]) -> float:
    """What a plan takes after a moment, with all machines or without some (numbers from 1)."""
    assert whole.run is not None
    run, rules = whole.run, whole.context.driving_rules
    if not without:
        return run.duration_s - cut_s
    machines = [list_left(run, number, cut_s) for number in range(run.plan.tractors)]
    kept = [one for number, one in enumerate(machines, start=1) if number not in without]
    free = [line for one in kept for line in one.lines[1:]]
    free += [line for number in without for line in machines[number - 1].lines]
    return deal_soonest_s(kept, free, rules.turn_speed_mps)


def list_left(run: SimulationRun, number: int, cut_s: float) -> MachineLeft:
    """What a tractor has before it after a moment, by the legs that it drove then."""
    legs, at = run.plan.missions[number].legs, run.get_leg_numbers(number)
    place = run.get_poses(number)[np.searchsorted(run.time_s, cut_s), :2]
    begun_s = [run.time_s[np.searchsorted(at, leg)] if leg <= at[-1] else math.inf for leg in range(len(legs))]
    ends_s = np.minimum([*begun_s, math.inf], run.finish_s[number])
    lines, home_s, task = list[LineLeft](), 0.0, None
    for leg, begin_s, end_s in zip(legs, ends_s, ends_s[1:], strict=False):
        left_s = max(end_s - max(begin_s, cut_s), 0.0)
        if not leg.implement:
            home_s, task = home_s + left_s, None
        elif left_s > 0.0:
            if leg.task != task:
                begin = leg.points[0] if begin_s > cut_s else place
                lines.append(LineLeft(begin, leg.points[-1], home_s, 0.0))
                home_s, task = 0.0, leg.task
            lines[-1] = replace(lines[-1], end=leg.points[-1], work_s=lines[-1].work_s + left_s)
    if lines:
        lines[-1] = replace(lines[-1], home_s=home_s)
    return MachineLeft(place, lines, legs[-1].points[-1] if legs[-1].task.kind == LEAVE else None)


def deal_soonest_s(machines: Sequence[MachineLeft], free: Sequence[LineLeft], turn_mps: float) -> float:
    """A time before which machines are not done with their next lines and with all that are free, whole, in any order
    and direction: every move takes as long as in the plan, and no less than the straight way.

    Lines in circles that no machine comes to are allowed (assignment relaxation), so that machines cannot be quicker.
    """
    nodes = [way for line in free for way in (line, line.turn_round())]
    count, arcs, costs_s = len(nodes), list[tuple[int, int, int]](), list[float]()

    def cross_s(begin: Floats, end: Floats) -> float:
        return math.dist(begin, end) / turn_mps

    for number, machine in enumerate(machines):
        first = LineLeft(machine.place, machine.place, 0.0, 0.0)
        own = machine.lines[0] if machine.lines else first
        for u, before in enumerate([*nodes, own]):
            for v, line in enumerate(nodes):
                if u // 2 != v // 2 or u == count:
                    arcs.append((number, u, v))
                    costs_s.append(max(line.move_s, cross_s(before.end, line.begin)) + line.work_s)
            arcs.append((number, u, count))
            way_s = 0.0 if machine.gate is None else cross_s(before.end, machine.gate)
            costs_s.append(max(before.home_s, way_s))
    rows, least, most = list[Any](), list[float](), list[float]()
    machine_of, leaves, enters = np.array(arcs).T

    def add_row(row: Any, low: float, high: float) -> None:
        rows.append(row)
        least.append(low)
        most.append(high)

    for number in range(len(free)):
        add_row(np.append(enters // 2 == number, 0.0) * np.append(enters < count, 0.0), 1.0, 1.0)
    for number, machine in enumerate(machines):
        is_own = machine_of == number
        add_row(np.append(is_own & (leaves == count), 0.0), 1.0, 1.0)
        for node in range(count):
            add_row(np.append(is_own * ((enters == node) * 1.0 - (leaves == node)), 0.0), 0.0, 0.0)
        begun_s = sum(line.move_s + line.work_s for line in machine.lines[:1])
        add_row(np.append(is_own * np.array(costs_s), -1.0), -math.inf, -begun_s)
    found = optimize.milp(
        np.eye(1, len(arcs) + 1, len(arcs))[0],
        integrality=np.append(np.ones(len(arcs)), 0.0),
        bounds=optimize.Bounds(0.0, np.append(np.ones(len(arcs)), math.inf)),
        constraints=optimize.LinearConstraint(sparse.csr_array(np.array(rows, float)), least, most),
        options={"mip_rel_gap": 0.001, "node_limit": MOST_NODES},
    )
    return float(found.mip_dual_bound)


def measure_worked_pct(whole: PlanningResult, cut_s: float, rest: PlanningResult) -> float:
    """The share of the field worked by a plan up to a moment and by what followed (percent)."""
    assert whole.run is not None and rest.run is not None
    begun = compute_swept_area(cut_run(whole.run, cut_s), whole.context).ground
    later = compute_swept_area(rest.run, rest.context).ground
    field = whole.context.layout.field.region_without_obstacles
    worked = unite_areas(np.concatenate([begun, later]))
    return 100.0 * float(shapely.intersection(worked, field).area) / float(field.area)


def main() -> None:
    """Print a row per cut, and the worst."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cuts", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--maps", type=Path)
    given = parser.parse_args()
    random, rows, wholes = np.random.default_rng(given.seed), [], {}
    print("field        machines  cut s  lost  uncut s  rest s  more %  worked %  uncut %   less", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        for number in range(given.cuts):
            job = JOBS[number % len(JOBS)]
            if job not in wholes:
                wholes[job] = plan(job, executor=SerialExecutor())
                wholes[job].save(f"{folder}/{len(wholes) - 1}.json")
            whole, file = wholes[job], f"{folder}/{list(wholes).index(job)}.json"
            assert whole.run is not None
            cut_s = float(round(random.uniform(0.05, 0.9) * whole.run.duration_s))
            count = whole.run.plan.tractors
            lost = number % 2 == 1
            without = (int(random.integers(count)) + 1,) if lost else ()
            source = f"{file}@{int(cut_s) // 3600}:{int(cut_s) % 3600 // 60:02d}:{int(cut_s) % 60:02d}"
            continued = read_continued_order([source], without)
            assert continued is not None
            request = replace(continued.request, strategies=("split-field",))
            uncut_s = measure_rest_s(whole, cut_s, without)
            start = f"{job.field:12s} {count:8d} {cut_s:6.0f} {without or '-'!s:>5s} {uncut_s:8.0f}"
            try:
                rest = plan(request, done=source, without=without, executor=SerialExecutor())
            except Exception as refusal:
                print(start, refusal, flush=True)
                continue
            if rest.run is None:
                print(start, [one.reason for one in rest.ranking.plans], flush=True)
                continue
            worked_pct = measure_worked_pct(whole, cut_s, rest)
            whole_pct = measure_coverage(whole.run, whole.context).worked_pct
            rows.append((100.0 * (rest.run.duration_s / uncut_s - 1.0), whole_pct - worked_pct))
            print(
                f"{start} {rest.run.duration_s:7.0f} {rows[-1][0]:7.1f} {worked_pct:9.3f} {whole_pct:8.3f} "
                f"{rows[-1][1]:6.3f}",
                flush=True,
            )
            if given.maps is not None:
                given.maps.mkdir(parents=True, exist_ok=True)
                rest.save(str(given.maps / f"{number:02d}-{job.field}.png"))
    more_pct, less = np.array(rows).T
    print(f"{len(rows)} of {given.cuts}: {more_pct.max():.1f} % more at worst, {less.max():.3f} points less at worst")


if __name__ == "__main__":
    main()
