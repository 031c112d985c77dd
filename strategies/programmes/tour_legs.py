"""The legs of a tour: its lines and moves with their tasks, places to wait, and the drives in and out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

from strategies.lines.work_line import cut_line
from strategies.moves.drives import build_path_legs
from strategies.moves.move import Move
from strategies.path_planning.paths import join_paths
from strategies.program.legs import add_wait_points, make_mission
from strategies.programmes.move_table import MoveTable
from strategies.programmes.waiting_places import list_parts_m
from vehicle.missions.plan import ENTER, LEAVE, ROUTE, TURN, Leg, LegTask, Mission

ROUTE_WAIT_M = 10.0  # between places to wait on a way in, out or across
LONG_MOVE_M = 40.0  # longer moves have places to wait


Pair = tuple[int, int]


def build_mission(table: MoveTable, tour: Sequence[int]) -> Mission:
    """The mission of a tractor that works the nodes of a tour in order."""
    return make_mission([leg for _, legs in build_tour_parts(table, tour) for leg in legs])


def build_tour_parts(table: MoveTable, tour: Sequence[int]) -> list[tuple[Pair, list[Leg]]]:
    """The legs of a tour, each part with the move that it is, or that led to the line it works."""
    pairs = list(pairwise([table.gate, *tour, table.gate]))
    parts, join_m = [(pairs[0], build_way_in(table, tour[0]))], 0.0
    for came, (node, following) in pairwise(pairs):
        is_last = following == table.gate
        move = None if is_last and table.site.lane is None else table.get_move(node, following)
        parts.append((came, split_work_leg(table, node, 0.0 if move is None else move.leave_m, join_m)))
        if move is not None and not is_last:
            parts.append(((node, following), build_move(table, following, move)))
            join_m = move.join_m
    return [*parts, (pairs[-1], build_way_out(table, tour[-1]))]


def build_move(table: MoveTable, following: int, move: Move) -> list[Leg]:
    """The legs of a move between lines, named after the line that follows; places to wait where it is long."""
    task = table.lines[following // 2].task
    if move.is_work:
        return build_path_legs(table.site, move.path, task, is_work=True)
    kind = ROUTE if move.kind == "route" else TURN
    legs = build_path_legs(table.site, move.path, replace(task, kind=kind))
    return add_wait_points(legs, ROUTE_WAIT_M) if move.path.length_m > LONG_MOVE_M else legs


def split_work_leg(table: MoveTable, node: int, leave_m: float, join_m: float) -> list[Leg]:
    """The legs that work a node: places to wait along a headland side, and before the last part of any line."""
    whole = table.moves.build_work_leg(node, leave_m, join_m)
    return [
        replace(whole, points=cut_line(whole.points, first, last), may_wait=first > 0.0)
        for first, last in pairwise(list_parts_m(table, node, whole.length_m))
    ]


def build_way_in(table: MoveTable, node: int) -> list[Leg]:
    """From the entrance to the first line; nothing without one, as the tractor then stands where work begins."""
    lane, line = table.site.lane, table.lines[node // 2]
    if lane is None:
        return []
    move = table.get_move(table.gate, node)
    assert move is not None  # a programme uses moves that exist
    path = join_paths([lane.build_path_in(), move.path], move.kind)
    legs = build_path_legs(table.site, path, replace(line.task, kind=ENTER))
    return add_wait_points(legs, ROUTE_WAIT_M)


def build_way_out(table: MoveTable, node: int) -> list[Leg]:
    lane = table.site.lane
    if lane is None:
        return []
    move = table.get_move(node, table.gate)
    assert move is not None
    path = join_paths([move.path, lane.build_path_out()], move.kind)
    return add_wait_points(build_path_legs(table.site, path, LegTask(LEAVE)), ROUTE_WAIT_M)
