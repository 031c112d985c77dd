"""The legs of a tour: its lines and moves with their tasks, places to wait, and the drives in and out."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise

from fields.arrays import SHORTEST_PIECE_M, cut_line
from strategies.moves.drives import build_move_legs, build_work_leg
from strategies.moves.move import Move
from strategies.programmes.move_table import MoveTable
from strategies.programmes.waiting_places import WAIT_STEP_M, list_parts_m
from strategies.rules.legs import add_wait_points, make_mission
from strategies.site.site import Site
from vehicle.missions.plan import DRIVE, ENTER, LEAVE, ROUTE, TURN, Leg, LegTask, Mission

ROUTE_WAIT_M = 10.0  # between places to wait on a way in, out or across


Pair = tuple[int, int]


def build_mission(table: MoveTable, tour: Sequence[int]) -> Mission:
    """The mission of a tractor that works the nodes of a tour in order, built once for the same moves."""
    nodes = [table.gate, *tour, table.gate]
    key = (*nodes, *(table.get_move(*pair) for pair in pairwise(nodes)))
    if key not in table.missions:
        table.missions[key] = _build_mission(table, tour)
    return table.missions[key]


def build_stand(table: MoveTable, node: int) -> Mission:
    """The mission of a tractor that stays where it stands, at the begin of its first line."""
    points, is_folded = cut_line(table.lines[node // 2].paths[0], 0.0, SHORTEST_PIECE_M), node in table.moves.folded
    return make_mission([Leg(points, table.site.rules.turn_speed_mps, task=LegTask(DRIVE), folded=is_folded)])


def _build_mission(table: MoveTable, tour: Sequence[int]) -> Mission:
    legs = build_way_in(table, tour[0])
    for (node,), join_m, leave_m, onward in iter_passes(table, [(node,) for node in tour]):
        legs += [*split_work_leg(table, node, leave_m, join_m), *onward]
    return make_mission(stand_to_unfold(table.site, [*legs, *build_way_out(table, tour[-1])]))


def iter_passes(
    table: MoveTable, passes: Sequence[Sequence[int]]
) -> Iterator[tuple[Sequence[int], float, float, Sequence[Leg]]]:
    """Every pass of a tour, a row of nodes, with what moves cut from its begin and its end (m), and the legs of the
    move to the next."""
    join_m = 0.0
    for nodes, following in pairwise([*passes, ()]):
        if not following:
            yield nodes, join_m, 0.0, ()
            return
        move = _require_move(table, nodes[-1], following[0])
        yield nodes, join_m, move.leave_m, build_move(table, following[0], move)
        join_m = move.join_m


def stand_to_unfold(site: Site, legs: Sequence[Leg]) -> list[Leg]:
    """The legs with the time that a tractor stands to unfold before each that follows a move with it folded."""
    befores = [None, *legs]
    return [
        leg.copy_with(fold_s=site.get_fold_s(True)) if before and before.folded and not leg.folded else leg
        for before, leg in zip(befores, legs, strict=False)
    ]


def build_run_parts(table: MoveTable, nodes: Sequence[int]) -> list[tuple[Pair, Sequence[Leg]]]:
    """The legs of the moves between nodes, with lines between two moves, and what is driven of the first and the last.

    Each part comes with the move that it is, or that led to the line it works; the first with that which follows it.
    """
    pairs, join_m = list(pairwise(nodes)), 0.0
    parts: list[tuple[Pair, Sequence[Leg]]] = [(pairs[0], _build_begin(table, *pairs[0]))]
    for number, (u, v) in enumerate(pairs):
        move = _require_move(table, u, v)
        if number:
            parts.append((pairs[number - 1], split_work_leg(table, u, move.leave_m, join_m)))
        if table.gate not in (u, v):
            parts.append(((u, v), build_move(table, v, move)))
        join_m = move.join_m
    return [*parts, (pairs[-1], _build_end(table, *pairs[-1]))]


def _build_begin(table: MoveTable, u: int, v: int) -> list[Leg]:
    """What is driven before a move: the end of its line, or the way in."""
    if u == table.gate:
        return build_way_in(table, v)
    if table.lines[u // 2].is_place:
        return []
    points = table.moves.cut_before(u, _require_move(table, u, v).leave_m)
    return [build_work_leg(table.site, points, table.lines[u // 2].task)]


def _build_end(table: MoveTable, u: int, v: int) -> list[Leg]:
    """What is driven after a move: the begin of the line it leads to, or the way out."""
    if v == table.gate:
        return build_way_out(table, u)
    points = table.moves.cut_after(v, _require_move(table, u, v).join_m)
    return [build_work_leg(table.site, points, table.lines[v // 2].task)]


def _require_move(table: MoveTable, u: int, v: int) -> Move:
    move = table.get_move(u, v)
    assert move is not None  # a programme uses moves that exist
    return move


def build_move(table: MoveTable, following: int, move: Move) -> tuple[Leg, ...]:
    """The legs of a move between lines, named after the line that follows; places to wait where it is long."""
    known, key = table.moves.legs, (following, move)
    if key not in known:
        task = table.lines[following // 2].task
        if not move.is_work:
            task = replace(task, kind=ROUTE if move.kind == "route" else TURN)
        legs = build_move_legs(table.site, move, task)
        if not move.is_work and move.path.length_m > WAIT_STEP_M:
            legs = add_wait_points(legs, ROUTE_WAIT_M)
        known[key] = tuple(legs)
    return known[key]


def split_work_leg(table: MoveTable, node: int, leave_m: float, join_m: float) -> tuple[Leg, ...]:
    """The legs that work a node, cut at the places to wait (waiting_places.list_parts_m)."""
    if table.lines[node // 2].is_place:
        return ()
    known, key = table.moves.legs, (node, leave_m, join_m)
    if key not in known:
        whole = table.moves.build_work_leg(node, leave_m, join_m)
        known[key] = tuple(
            whole.cut(first, last).copy_with(may_wait=first > 0.0)
            for first, last in pairwise(list_parts_m(table.moves, node, whole.length_m))
        )
    return known[key]


def build_way_in(table: MoveTable, node: int) -> list[Leg]:
    """From the entrance to the first line; nothing without one, or if the tractor stands where work begins."""
    if table.site.lane is None or node in table.starts:
        return []
    move, task = _require_move(table, table.gate, node), table.lines[node // 2].task
    return add_wait_points(build_move_legs(table.site, move, replace(task, kind=ENTER)), ROUTE_WAIT_M)


def build_way_out(table: MoveTable, node: int) -> list[Leg]:
    if table.site.lane is None:
        return []
    move = _require_move(table, node, table.gate)
    return add_wait_points(build_move_legs(table.site, move, LegTask(LEAVE)), ROUTE_WAIT_M)
