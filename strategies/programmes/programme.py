"""A programme: which lines each tractor works, in which order and direction, by moves that were driven well.

A sketch is one by moves that are only estimated.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise

import numpy as np
import numpy.typing as npt

from strategies.moves.drives import BRAKE_M, SETTLE_M, build_move_legs
from strategies.programmes.driven_search import search_driven_tours, search_estimated_tours
from strategies.programmes.move_table import MoveTable
from strategies.programmes.order_search import OrderProblem
from strategies.programmes.site_moves import SiteMoves
from strategies.programmes.tour_legs import build_mission, build_run_parts, stand_to_unfold
from strategies.programmes.waiting_places import WAIT_STEP_M, find_clashes
from strategies.programmes.ways_home import Way, WayBook
from strategies.site.site import LEFT_FACTOR
from vehicle.missions.plan import ROUTE, Leg, LegTask, Mission, Plan
from vehicle.sim.path_conflicts import ClearanceCheck

Floats = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
Pose = tuple[float, float, float]

START_VALUE_S = 1e4  # of the line that a tractor begins with: more than any way home takes
SETTLED_M = SETTLE_M + BRAKE_M  # longer lines pass on nothing of how they were begun


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
    work_m = sum(table.lines[node // 2].measure_path_m(node % 2) for node in tour)
    moves_s = table.sum_drive_s(list_pairs(table, [tour]))
    return work_m / table.site.rules.work_speed_mps + moves_s + table.moves.drives.rest_s


def list_pairs(table: MoveTable | SiteMoves, tours: Sequence[Sequence[int]]) -> list[tuple[int, int]]:
    """Neighbouring nodes of all tours, with the entrance before and after each where there is one to pass."""
    return [pair for tour in tours if tour for pair in pairwise(add_gates(table, tour))]


def add_gates(table: MoveTable | SiteMoves, tour: Sequence[int]) -> list[int]:
    """A tour with the entrance at its end, and before it unless the tractor stands on the field, where there is one."""
    gate = [] if table.site.lane is None else [table.gate]
    return [*([] if tour and tour[0] in table.starts else gate), *tour, *gate]


def make_programme(
    table: MoveTable,
    tractors: int,
    stages: Sequence[int] | None = None,
    allowed: npt.NDArray[np.bool_] | None = None,
    seed: int = 1,
    stands_in_way: ClearanceCheck | None = None,
    served_s: Floats | None = None,
    start: Sequence[Sequence[int]] | None = None,
    charged_s: Floats | float = 0.0,
    barred: Sequence[int] = (),
) -> Programme:
    """The best programme whose moves were all driven well.

    `stages` (n,) say which lines come first; `allowed` (tractors, n) which lines a tractor may work, all by default.
    With `stands_in_way` no two tractors of a field without an entrance begin or end where they never get on. `served_s`
    (n,) says how long a tractor takes to be served for each line, so that all finish together. The search begins with
    the tours `start`; moves cost `charged_s` (n + 1, n + 1) more than they take; nodes `barred` are in no tour.
    """
    stage = np.zeros(len(table.lines), np.int64) if stages is None else np.array(stages, np.int64)
    may = np.ones((tractors, len(table.lines)), bool) if allowed is None else allowed
    extra_s = np.zeros(len(table.lines)) if served_s is None else served_s
    clashes, book = list_clashes(table, stands_in_way, tractors), WayBook(table.site.back_m)

    def can_be_driven(tours: list[list[int]]) -> bool:
        if False in [prove_short_runs(table, tour) for tour in tours]:
            return False
        return clashes is None or stands_in_way is None or not _bar_stuck(table, clashes, book, stands_in_way, tours)

    best = search_driven_tours(
        table,
        lambda costs: pose_problem(table.moves, costs + charged_s, stage, may, extra_s, clashes, barred),
        lambda tours: list_pairs(table, tours),
        can_be_driven,
        seed,
        None if start is None else [list(tour) for tour in start],
    )
    tours = [_keep_connected(table, tour) for tour in best]
    driven = {node // 2 for tour in tours for node in tour}
    left = tuple(k for k in range(len(table.lines)) if k not in driven)
    return Programme(table, tuple(map(tuple, tours)), left)


def sketch_programme(
    table: MoveTable,
    tractors: int,
    stages: Sequence[int],
    allowed: npt.NDArray[np.bool_] | None = None,
    served_s: Floats | None = None,
    stands_in_way: ClearanceCheck | None = None,
    charged_s: Floats | float = 0.0,
    barred: Sequence[int] = (),
) -> Sketch:
    """The best tours by moves that were estimated, lines in stages; the rest as in `make_programme`."""
    moves, count = table.moves, len(table.lines)
    stage = np.array(stages, np.int64)
    may = np.ones((tractors, count), bool) if allowed is None else allowed
    extra_s = np.zeros(count) if served_s is None else served_s
    clashes = list_clashes(table, stands_in_way, tractors)
    orders = [[n for n in own if n == own[0] or may[k, n // 2]] for k, own in enumerate(moves.orders)]
    tours, cost_s = search_estimated_tours(
        table,
        lambda costs: pose_problem(moves, costs + charged_s, stage, may, extra_s, clashes, barred),
        lambda tours: list_pairs(moves, tours),
        orders + [[] for _ in range(tractors - len(orders))] if any(len(order) > 1 for order in orders) else None,
    )
    return Sketch(tours, [compute_tour_s(table, tour) for tour in tours], cost_s)


def list_clashes(table: MoveTable, check: ClearanceCheck | None, tractors: int) -> Flags | None:
    """The nodes (2, nodes, nodes) of which no two tractors may begin (0) or end (1) with both, as far as a search
    knows; None for a single one, and with an entrance to wait outside."""
    if check is None or table.site.lane is not None or tractors == 1:
        return None
    if check not in table.clashes:
        table.clashes[check] = find_clashes(table.moves, check).copy()
    return table.clashes[check]


def _bar_stuck(
    table: MoveTable, clashes: Flags, book: WayBook, check: ClearanceCheck, tours: Sequence[Sequence[int]]
) -> bool:
    """Bar pairs of nodes where two tours begin or end and never get on, however they wait; whether there were any."""
    connected = [_keep_connected(table, tour) for tour in tours]
    ways = {number: book.build_way(build_mission(table, tour)) for number, tour in enumerate(connected) if tour}
    sides = [(book.find_stuck_side(ways[a], ways[b], check), a, b) for a, b in combinations(ways, 2)]
    first_side = 1 if table.starts else 0  # those on the field stand where they stand
    stuck = [(side, a, b) for side, a, b in sides if side is not None and side >= first_side]
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


def pose_problem(
    moves: SiteMoves,
    costs: Floats,
    stage: npt.NDArray[np.int64],
    may: npt.NDArray[np.bool_],
    extra_s: Floats,
    clashes: Flags | None = None,
    barred: Sequence[int] = (),
) -> OrderProblem:
    """The search for the tours of tractors that may work lines (tractors, n), with costs (n + 1, n + 1) of moves.

    `stage` (n,) says which lines come first, `extra_s` (n,) what each takes beside driving on it, `clashes` as in
    `list_clashes`, `barred` as in `make_programme`.
    """
    site, lines = moves.site, moves.lines
    may, stage = _place_starts(moves, may, stage)
    own_s = np.array([line.own_m2 for line in lines]) * site.work_s_per_m2
    is_barred = np.array([not line.both_ways and way == 1 for line in lines for way in (0, 1)], bool)
    is_barred[list(barred)] = True
    costs = costs.copy()
    costs[list(barred)], costs[:, list(barred)] = np.inf, np.inf
    ends_s = [
        np.repeat(np.where(is_barred, np.inf, row)[None], len(may), axis=0)
        for row in ((costs[-1, :-1], costs[:-1, -1]) if site.lane is not None else moves.edge_ways_s)
    ]
    starts = list(moves.starts)
    ends_s[0][:, starts], ends_s[0][: len(starts)] = np.inf, np.inf
    ends_s[0][range(len(starts)), starts] = 0.0
    return OrderProblem(
        move_s=costs[:-1, :-1],
        work_s=np.array([line.length_m for line in lines]) / site.rules.work_speed_mps + extra_s,
        value_s=LEFT_FACTOR * own_s + extra_s + START_VALUE_S * np.isin(np.arange(len(lines)), np.array(starts) // 2),
        begin_s=ends_s[0],
        end_s=ends_s[1],
        allowed=may,
        stage=stage,
        clashes=clashes,
    )


def _place_starts(
    moves: SiteMoves, may: npt.NDArray[np.bool_], stage: npt.NDArray[np.int64]
) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.int64]]:
    """What tractors may work and when, with every start for its own tractor and in the first stage."""
    lines = [node // 2 for node in moves.starts]
    may, stage = may.copy(), stage.copy()
    may[:, lines], stage[lines] = False, stage.min(initial=0)
    may[range(len(lines)), lines] = True
    return may, stage


def _keep_connected(table: MoveTable, tour: Sequence[int]) -> list[int]:
    """The longest stretch of a tour all of whose moves were driven well; a search without a way on ends so.

    Nothing for a tractor that stands on the field, has nothing to work there, and no entrance to leave by.
    """
    parts: list[list[int]] = [[]]
    for node in tour:
        if parts[-1] and not table.is_proven(parts[-1][-1], node):
            parts.append([])
        parts[-1].append(node)
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
