"""A programme: which lines each tractor works, in which order and direction, by moves that were driven well; its plan,
and what a drive of that says of its moves.

A sketch is one by moves that are only estimated.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise

import numpy as np

from fields.arrays import Flags, Floats, Integers
from strategies.moves.drives import build_move_legs
from strategies.path_planning.paths import Pose
from strategies.programmes.driven_search import TourProblem, search_driven_tours, search_estimated_tours
from strategies.programmes.move_table import MoveTable, split_apart
from strategies.programmes.order_tours import DETOUR_S
from strategies.programmes.site_moves import SiteMoves
from strategies.programmes.tour_legs import build_mission, build_run_parts, build_stand, stand_to_unfold
from strategies.programmes.waiting_places import WAIT_STEP_M
from strategies.programmes.ways_home import Way, WayBook
from strategies.site.site import SETTLED_M
from vehicle.missions.plan import ROUTE, Leg, LegTask, Mission, Plan
from vehicle.missions.run import SimulationRun
from vehicle.sim.path_conflicts import ClearanceCheck


@dataclass(frozen=True, eq=False)
class Programme:
    """The nodes of every tractor in order; lines in none of them are left.

    Attributes:
        table: lines and moves.
        tours: (per tractor) nodes in order.
        left: numbers of the lines that are left.
    """

    table: MoveTable
    tours: tuple[tuple[int, ...], ...]
    left: tuple[int, ...]

    @property
    def left_m2(self) -> float:
        """The ground of the lines that are left."""
        return math.fsum(self.table.lines[number].own_m2 for number in self.left)

    def list_present(self) -> list[int]:
        """Numbers of the tractors with a mission: with lines to work, or standing on the field, those first."""
        return [number for number, tour in enumerate(self.tours) if tour or number < len(self.table.starts)]

    def list_pairs(self) -> list[tuple[int, int]]:
        """The moves it uses, as pairs of nodes."""
        return list_pairs(self.table, self.tours)

    def compute_tractor_s(self) -> list[float]:
        """Seconds that every tractor drives: its lines and its moves, without what these are charged."""
        return [compute_tour_s(self.table, tour) for tour in self.tours]


@dataclass(frozen=True, eq=False)
class Sketch:
    """Tours by moves in closed form: what the best programme is likely to take, nothing is driven.

    Attributes:
        tours: (per tractor) nodes in order.
        tractor_s: seconds of every tractor, as driven without stops.
        cost_s: what the search makes small: seconds with charges for what drivers avoid and for lines that are left.
    """

    tours: list[list[int]]
    tractor_s: list[float]
    cost_s: float


def compute_tour_s(table: MoveTable, tour: Sequence[int]) -> float:
    """Seconds that a tour is driven from rest to rest: its lines and its moves, without what these are charged."""
    if not tour:
        return 0.0
    return measure_way_s(table, add_gates(table, tour), tour) + table.moves.drives.rest_s


def measure_way_s(table: MoveTable, nodes: Sequence[int], worked: Sequence[int]) -> float:
    """Seconds of the moves between nodes, and of the lines of those that are worked."""
    work_m = math.fsum(table.lines[node // 2].measure_path_m(node % 2) for node in worked)
    return work_m / table.site.rules.work_speed_mps + table.sum_drive_s(list(pairwise(nodes)))


def list_pairs(table: MoveTable | SiteMoves, tours: Sequence[Sequence[int]]) -> list[tuple[int, int]]:
    """Neighbouring nodes of all tours, with the entrance before and after each where there is one to pass."""
    return [pair for tour in tours if tour for pair in pairwise(add_gates(table, tour))]


def add_gates(table: MoveTable | SiteMoves, tour: Sequence[int]) -> list[int]:
    """A tour with the entrance at its end, and before it unless the tractor stands on the field, where there is one."""
    gate = [] if table.site.lane is None else [table.gate]
    return [*([] if tour and tour[0] in table.starts else gate), *tour, *gate]


def make_programme(problem: TourProblem, start: Sequence[Sequence[int]] | None = None, seed: int = 1) -> Programme:
    """The best programme whose moves were all driven well, in a search that begins with the tours `start`."""
    table, check, book = problem.table, problem.check, WayBook(problem.table.site.back_m)

    def can_be_driven(tours: list[list[int]]) -> bool:
        if False in [prove_short_runs(table, tour) for tour in tours]:
            return False
        clashes = problem.clashes
        return clashes is None or check is None or not _bar_stuck(table, clashes, book, check, tours)

    best = search_driven_tours(
        table,
        problem.pose,
        lambda tours: list_pairs(table, tours),
        can_be_driven,
        seed,
        None if start is None else [list(tour) for tour in start],
    )
    tours = [_keep_connected(table, tour) for tour in best]
    driven = {node // 2 for tour in tours for node in tour}
    left = tuple(k for k in range(len(table.lines)) if k not in driven)
    return Programme(table, tuple(map(tuple, tours)), left)


def sketch_programme(problem: TourProblem) -> Sketch:
    """The best tours by moves that were estimated; where work goes on a search begins with what tractors were to do."""
    table, orders = problem.table, problem.table.moves.orders
    known = [[n for n in own if n == own[0] or problem.allowed[k, n // 2]] for k, own in enumerate(orders)]
    tours, cost_s = search_estimated_tours(
        table,
        problem.pose,
        lambda tours: list_pairs(table, tours),
        known + [[] for _ in range(problem.tractors - len(known))] if any(len(order) > 1 for order in known) else None,
    )
    return Sketch(tours, [compute_tour_s(table, tour) for tour in tours], cost_s)


def _bar_stuck(
    table: MoveTable, clashes: Flags, book: WayBook, check: ClearanceCheck, tours: Sequence[Sequence[int]]
) -> bool:
    """Bar pairs of nodes where two tours begin or end and never get on, however they wait; whether there were any."""
    connected = [_keep_connected(table, tour) for tour in tours]
    ways = {number: book.build_way(build_mission(table, tour)) for number, tour in enumerate(connected) if tour}
    sides = [(book.find_stuck_side(ways[a], ways[b], check), a, b) for a, b in combinations(ways, 2)]
    stand = set(table.starts)  # two that stand on the field stand where they stand
    stuck = [
        (side, a, b)
        for side, a, b in sides
        if side is not None and (side or not {connected[a][0], connected[b][0]} <= stand)
    ]
    for side, a, b in stuck:
        pair = [connected[a][-side], connected[b][-side]]
        clashes[side, pair, pair[::-1]] = True
    return bool(stuck)


def prove_short_runs(table: MoveTable, tour: Sequence[int]) -> bool:
    """Whether a tour keeps to the ground over lines too short to settle on; moves at which it does not are struck.

    Such lines pass on how they were begun, which a move driven alone does not show.
    """
    runs = _list_short_runs(table, _keep_connected(table, tour))
    lost = dict.fromkeys(pair for run in runs for pair in _find_lost_moves(table, run))
    for pair in lost:
        table.strike(*pair)
    return not lost


def _list_short_runs(table: MoveTable, tour: Sequence[int]) -> list[tuple[int, ...]]:
    """Stretches of a tour from one line to settle on to the next, over one or more that are driven for less."""
    nodes, runs = add_gates(table, tour), list[list[int]]([[]])
    moves = [None, *(table.get_move(*pair) for pair in pairwise(nodes)), None]
    for node, came, goes in zip(nodes, moves, moves[1:], strict=False):
        runs[-1].append(node)
        cut_m = (0.0 if came is None else came.join_m) + (0.0 if goes is None else goes.leave_m)
        if node == table.gate or table.lines[node // 2].measure_path_m(node % 2) - cut_m >= SETTLED_M:
            runs.append([node])
    return [tuple(run) for run in runs if len(run) > 2]


def _find_lost_moves(table: MoveTable, run: Sequence[int]) -> tuple[tuple[int, int], ...]:
    """The moves of a stretch of a tour at which a drive of it leaves the ground; each is driven once for a site."""
    known, key = table.moves.lost_in_runs, (*run, *(table.get_move(*pair) for pair in pairwise(run)))
    if key not in known:
        parts = build_run_parts(table, run)
        owners = [pair for pair, legs in parts for _ in legs]
        legs = stand_to_unfold(table.site, [leg for _, legs in parts for leg in legs])
        known[key] = tuple(owners[number] for number in table.moves.find_lost_legs(legs))
    return known[key]


def _keep_connected(table: MoveTable, tour: Sequence[int]) -> list[int]:
    """The longest stretch of a tour all of whose moves were driven well; a search without a way on ends so.

    Nothing for a tractor that stands on the field, has nothing to work there, and no entrance to leave by.
    """
    parts = split_apart(tour, table.is_proven)
    if table.site.lane is not None:
        gate = table.gate
        parts = [p for p in parts if p and _is_begun(table, tour, p) and table.is_proven(p[-1], gate)] or [[]]
    elif tour and tour[0] in table.starts:
        parts = parts[:1]
        if all(table.lines[node // 2].is_place for node in parts[0]):
            return []
    return max(parts, key=lambda part: sum(table.lines[node // 2].length_m for node in part))


def _is_begun(table: MoveTable, tour: Sequence[int], part: Sequence[int]) -> bool:
    """Whether a tractor gets to the first node of a part of its tour: from where it stands, or through the entrance."""
    if tour[0] in table.starts:
        return part[0] == tour[0]
    return table.is_proven(table.gate, part[0])


def clear_ways(plan: Plan, table: MoveTable, check: ClearanceCheck) -> Plan:
    """The plan with every tractor that rests in the way of others driving to the nearest place where it is in none.

    It stays where it stands if no such place is reached.
    """
    missions, book = list(plan.missions), WayBook(table.site.back_m)
    for number in [number for number, mission in enumerate(missions) if mission.rests]:
        ways = [book.build_way(mission) for place, mission in enumerate(missions) if place != number]
        places = _iter_free_places(missions[number].end, ways, book.back_m, check)
        ways_there = (_list_parking_legs(table, missions[number], pose) for pose in places)
        missions[number] = next((Mission(legs) for legs in ways_there if legs is not None), missions[number])
    return replace(plan, missions=tuple(missions))


def _list_parking_legs(table: MoveTable, mission: Mission, pose: Pose) -> tuple[Leg, ...] | None:
    """The legs of a tractor that rests, to a pose; None where no way leads there."""
    finder, (stand, *_) = table.moves.finder, mission.legs
    if math.dist(mission.end[:2], pose[:2]) == 0.0:
        return mission.legs
    if not (finder.has_way_on(mission.end, backwards=False) and finder.has_way_on(pose, backwards=True)):
        return None
    moves = finder.list_folded_moves(mission.end, pose) if stand.folded else finder.list_moves(mission.end, pose)
    found = next(iter(moves), None) or (None if stand.folded else finder.search(mission.end, pose))
    if found is None:
        return None
    return (stand, *build_move_legs(table.site, replace(found, begins_folded=stand.folded), LegTask(ROUTE)))


def _iter_free_places(stand: Pose, ways: list[Way], back_m: float, check: ClearanceCheck) -> Iterator[Pose]:
    """Poses beside one, itself first and then the nearest, at which a tractor is in the way of no others."""
    (x, y, heading), step_m = stand, 0.5 * check.reach_m
    most = math.ceil(WAIT_STEP_M / step_m)  # no farther than to another place to wait
    steps_m = step_m * np.arange(-most, most + 1)
    ahead_m, aside_m = (values.ravel() for values in np.meshgrid(steps_m, steps_m))
    nearest = np.argsort(np.hypot(ahead_m, aside_m), kind="stable")
    ahead_m, aside_m = ahead_m[nearest], aside_m[nearest]
    cosine, sine = math.cos(heading), math.sin(heading)
    xs, ys = x + ahead_m * cosine - aside_m * sine, y + ahead_m * sine + aside_m * cosine
    middles = np.column_stack([xs - back_m * cosine, ys - back_m * sine, np.full(len(xs), heading)])
    blocked = check.find_blocked(middles, [way.path for way in ways])
    for place in np.flatnonzero(~blocked).tolist():
        yield float(xs[place]), float(ys[place]), heading


def build_plan(programme: Programme) -> Plan:
    """The plan of a programme, one mission per tractor that has lines or stands on the field."""
    table, tours = programme.table, programme.tours
    return Plan(
        tuple(
            build_mission(table, tours[number]) if tours[number] else build_stand(table, table.starts[number])
            for number in programme.list_present()
        )
    )


def charge_waiting(programme: Programme, tours: Sequence[Sequence[int]], plan: Plan, run: SimulationRun) -> Floats:
    """Seconds (n + 1, n + 1) that tractors waited at each move in a run of the plan of a programme, DETOUR_S where two
    met.

    `tours` are its nodes in the order in which they are worked. A tractor waits before the last part of a line for the
    move that follows. Gates of the plan itself do not count.
    """
    charged_s = np.zeros_like(programme.table.cost_s)
    present = [tours[number] for number in programme.list_present()]
    moves = [_list_leg_moves(programme, *each) for each in zip(plan.missions, present, strict=True)]
    for tractor, (mission, of_legs) in enumerate(zip(plan.missions, moves, strict=True)):
        waited_s = np.where([bool(leg.gates) for leg in mission.legs], 0.0, run.sum_waits_s(tractor))
        np.add.at(charged_s, tuple(of_legs.T), waited_s)
    if run.conflict is not None:
        met = run.conflict
        for tractor, leg in ((met.first, met.first_leg), (met.second, met.second_leg)):
            charged_s[tuple(moves[tractor][leg])] += DETOUR_S
    return charged_s


def _list_leg_moves(programme: Programme, mission: Mission, tour: Sequence[int]) -> Integers:
    """The move (legs, 2) that each leg of a tour is part of, or that follows the line it works."""
    table = programme.table
    nodes, worked, pairs = [table.gate, *tour, table.gate], None, []
    line = int(any(table.lines[u // 2].is_place for u in tour[:1]))
    for leg in mission.legs:
        if leg.task.is_work and leg.task != worked:
            line, worked = line + 1, leg.task
        pairs.append(nodes[min(line, len(tour)) :][:2])
    return np.array(pairs, np.int64)
