"""A programme as a plan: legs with their tasks, places to wait, and the drives in and out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

from strategies.lines.work_line import cut_line
from strategies.moves.move import Move
from strategies.path_planning.paths import join_paths
from strategies.program.legs import add_wait_points, make_mission
from strategies.programmes.move_table import MoveTable, build_path_legs
from strategies.programmes.programme import Programme
from vehicle.missions.plan import ENTER, HEADLAND_PASS, LEAVE, ROUTE, TURN, Leg, LegTask, Mission, Plan

HEADLAND_WAIT_M = 40.0  # between places to wait along a headland side
ROUTE_WAIT_M = 10.0  # between places to wait on a way in, out or across
LONG_MOVE_M = 40.0  # longer moves have places to wait


def build_plan(programme: Programme, **notes: Any) -> Plan:
    """The plan of a programme, one mission per tractor that has lines."""
    table = programme.table
    missions = tuple(_build_mission(table, tour) for tour in programme.tours if tour)
    return Plan(missions, {"tractors": len(missions), **notes})


def _build_mission(table: MoveTable, tour: Sequence[int]) -> Mission:
    legs = build_way_in(table, tour[0])
    join_m = 0.0
    for node, following in pairwise([*tour, table.gate]):
        is_last = following == table.gate
        move = None if is_last and table.site.lane is None else table.get_move(node, following)
        legs += split_work_leg(table, node, 0.0 if move is None else move.leave_m, join_m)
        if move is not None and not is_last:
            legs += build_move_legs(table, following, move)
            join_m = move.join_m
    return make_mission([*legs, *build_way_out(table, tour[-1])])


def build_move_legs(table: MoveTable, following: int, move: Move) -> list[Leg]:
    """The legs of a move between lines, named after the line that follows; places to wait where it is long."""
    task = table.lines[following // 2].task
    if move.is_work:
        return build_path_legs(table.site, move.path, task, is_work=True)
    kind = ROUTE if move.kind == "route" else TURN
    legs = build_path_legs(table.site, move.path, replace(task, kind=kind))
    return add_wait_points(legs, ROUTE_WAIT_M) if move.path.length_m > LONG_MOVE_M else legs


def split_work_leg(table: MoveTable, node: int, leave_m: float, join_m: float) -> list[Leg]:
    """The legs that work a node: places to wait along a headland side, and before the last part of any line."""
    whole = table.build_work_leg(node, leave_m, join_m)
    length_m, back_m = whole.length_m, table.site.rules.hold_back_m
    hold_m = max(length_m - back_m, 0.5 * length_m)
    parts = max(1, round(hold_m / HEADLAND_WAIT_M)) if whole.task.kind == HEADLAND_PASS else 1
    cuts = [0.0, *(hold_m * part / parts for part in range(1, parts + 1)), length_m]
    return [
        replace(whole, points=cut_line(whole.points, first, last), may_wait=first > 0.0)
        for first, last in pairwise(cuts)
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
