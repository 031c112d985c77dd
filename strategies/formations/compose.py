"""A formation composed of work lines and proven moves: columns, rounds, their order, what is left over, the plan."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from strategies.formations.columns import Column, find_runs, list_columns
from strategies.formations.formation_plan import QueueRule, write_formation
from strategies.formations.placement import find_cramped_round, place_rounds
from strategies.formations.round_order import DirectedRound, order_rounds
from strategies.formations.rounds import ColumnRound, compute_needed_length_m, divide_runs, get_row
from strategies.formations.tours import FormationTour, share_lines
from strategies.path_planning.errors import StrategyError, build_too_many_error
from strategies.path_planning.turn_kinds import HEADLAND_FIRST
from strategies.programmes.build_plan import build_plan
from strategies.programmes.move_table import MoveTable
from strategies.programmes.programme import Programme, make_programme
from strategies.programmes.stages import list_stages
from strategies.programmes.waiting_places import StandsInWay
from vehicle.missions.plan import SWATH, Plan


@dataclass(frozen=True)
class FormationRule:
    """How the tractors of a formation leave the queue at the end of a round.

    Attributes:
        name: of the strategy.
        queue_rule: gives what a tractor waits for.
        move_up: whether those behind move up in the queue.
        in_rows: whether whole rows leave one after another.
    """

    name: str
    queue_rule: QueueRule
    move_up: bool = True
    in_rows: bool = False


def compose_formation(
    table: MoveTable, tractors: int, order: str, stands_in_way: StandsInWay, rule: FormationRule
) -> tuple[Programme, Plan]:
    """The tours of a formation and its plan, with the headland first or last; raises StrategyError without a round."""
    if tractors == 1:
        return _compose_alone(table, order, rule)
    columns = list_columns(table)
    rounds = _require_rounds(table, columns, tractors)
    directed, tours = _order_with_room(table, rounds, order, stands_in_way, in_rows=rule.in_rows)
    plan = write_formation(table, directed, tours, rule.queue_rule, move_up=rule.move_up)
    notes = {"strategy": rule.name, "tractors": tractors, "headland": order or None}
    share = _describe_share(table, directed, tours)
    worked = {node // 2 for tour in tours for node in tour.nodes}
    left = tuple(number for number in range(len(table.lines)) if number not in worked)
    programme = Programme(table, tuple(tour.nodes for tour in tours), left)
    return programme, replace(plan, notes={**notes, **share})


ADVICE = "use fewer tractors, or split-field or interleaved"


def _order_with_room(
    table: MoveTable, rounds: Sequence[ColumnRound], order: str, stands_in_way: StandsInWay, *, in_rows: bool
) -> tuple[list[DirectedRound], list[FormationTour]]:
    """The rounds in order with their places, and the tours they are part of; a round without room is no round.

    Raises StrategyError where none is left.
    """
    remaining, tractors = list(rounds), len(rounds[0].columns)
    ends = order != HEADLAND_FIRST, order in ("", HEADLAND_FIRST)
    while remaining:
        directed = order_rounds(table, remaining, ends)
        if not directed:
            break
        cramped = find_cramped_round(place_rounds(table, directed, None, stands_in_way, in_rows=in_rows))
        if cramped is None:
            tours = share_lines(table, directed, tractors, order, stands_in_way)
            if not tours:
                continue  # what a whole drive has struck is no move any more
            placed = place_rounds(table, directed, tours, stands_in_way, in_rows=in_rows)
            cramped = find_cramped_round(placed)
            if cramped is None:
                return placed, tours
        remaining = [one for one in remaining if one is not cramped]
    raise StrategyError(f"No round of {tractors} tractors has room clear of those that pass it; {ADVICE}.")


def _compose_alone(table: MoveTable, order: str, rule: FormationRule) -> tuple[Programme, Plan]:
    """One tractor has nobody to keep beside."""
    programme = make_programme(table, 1, list_stages(table.lines, order))
    return programme, build_plan(programme, strategy=rule.name, headland=order or None)


def _require_rounds(table: MoveTable, columns: Sequence[Column], tractors: int) -> list[ColumnRound]:
    """The rounds of all tractors; raises StrategyError where there is none."""
    swaths = {line.task.number for line in table.lines if line.task.kind == SWATH}
    if len(swaths) < tractors:
        raise build_too_many_error(tractors, len(swaths))
    if not columns:
        raise StrategyError(f"A formation needs straight tracks side by side, and those here are curved; {ADVICE}.")
    runs = find_runs(columns, table.site.width_m)
    rounds = divide_runs(runs, tractors, table.site.rules)
    if not rounds:
        rows = max(get_row(tractor, tractors) for tractor in range(tractors))
        needed_m = compute_needed_length_m(table.site.rules, rows)
        raise StrategyError(
            f"A formation of {tractors} tractors needs {tractors} tracks of at least {needed_m:.1f} m side by side, "
            f"and the field has none; {ADVICE}."
        )
    return rounds


def _describe_share(
    table: MoveTable, rounds: Sequence[DirectedRound], tours: Sequence[FormationTour]
) -> dict[str, object]:
    """The share of the tracks that is worked side by side (percent), and which tractors work the rest (from 1)."""
    beside_m = math.fsum(each.one.length_m for each in rounds)
    apart = [[node for node in tour.before + tour.after if table.lines[node // 2].task.kind == SWATH] for tour in tours]
    apart_m = math.fsum(table.lines[node // 2].length_m for nodes in apart for node in nodes)
    share_pct = 100.0 * beside_m / (beside_m + apart_m)
    return {"formation_pct": round(share_pct, 3), "apart": [number + 1 for number, nodes in enumerate(apart) if nodes]}


def describe_formation_share(plan: Plan) -> str | None:
    """A remark if not all of a plan is driven in formation; None otherwise."""
    share_pct, separate_tractors = plan.notes.get("formation_pct"), plan.notes.get("apart")
    if share_pct is None or not separate_tractors:
        return None
    names = [str(tractor) for tractor in separate_tractors]
    workers = f"tractor {names[0]}" if len(names) == 1 else f"tractors {', '.join(names[:-1])} and {names[-1]}"
    return f"{min(round(share_pct), 99)} % of the tracks are worked in formation, the rest by {workers}"
