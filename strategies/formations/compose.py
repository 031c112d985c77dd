"""The programme and plan of a formation: rounds and tours as its site has them, the queue by its rule."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise

from strategies.formations.formation_plan import QueueRule, write_formation
from strategies.formations.formation_site import FleetOrder, FormationSite, OrderedRounds
from strategies.formations.round_order import DirectedRound
from strategies.programmes.programme import Programme
from vehicle.missions.plan import GATE_MARGIN_M, SWATH, Plan


@dataclass(frozen=True)
class FormationRule:
    """How the tractors of a formation leave the queue at the end of a round.

    Attributes:
        queue_rule: gives what a tractor waits for.
        move_up: whether those behind move up in the queue.
        in_rows: whether whole rows leave one after another.
    """

    queue_rule: QueueRule
    move_up: bool = True
    in_rows: bool = False


def compose_formation(site: FormationSite, tractors: int, headland: str, rule: FormationRule) -> tuple[Programme, Plan]:
    """The tours of a formation and its plan, with the headland first or last; raises StrategyError without a round."""
    found = site.share(FleetOrder(tractors, headland, rule.in_rows))
    plan = write_formation(found.table, found.rounds, found.tours, rule.queue_rule, move_up=rule.move_up)
    worked = {node // 2 for tour in found.tours for node in tour.nodes}
    left = tuple(number for number in range(len(found.table.lines)) if number not in worked)
    programme = Programme(found.table, tuple(tour.nodes for tour in found.tours), left)
    return programme, replace(plan, notes=_describe_share(found))


def bound_formation_s(site: FormationSite, tractors: int, headland: str, rule: FormationRule) -> list[float]:
    """Seconds that the tractors of a formation take at least, however the lines that are in no round are shared out.

    All begin a round together, when the slowest is in its place. Raises StrategyError without a round.
    """
    found = site.place(FleetOrder(tractors, headland, rule.in_rows))
    table, rounds, speed = found.table, found.rounds, found.table.site.rules.work_speed_mps
    begun_s = max(place.place_m for place in rounds[0].places) / speed
    for before, after in pairwise(rounds):
        pairs = zip(after.moves, after.places, strict=True)
        ways_s = [move.drive_s + place.place_m / speed for move, place in pairs]
        begun_s += max(map(sum, zip(_list_passes_s(before, speed), ways_s, strict=True))) - GATE_MARGIN_M / speed
    ends_s = [begun_s + pass_s for pass_s in _list_passes_s(rounds[-1], speed)]
    worked = {node // 2 for each in rounds for column in each.one.columns for node in column.nodes}
    rest_m2 = math.fsum(line.own_m2 for number, line in enumerate(table.lines) if number not in worked)
    total_s = math.fsum(ends_s) + rest_m2 * table.site.work_s_per_m2
    last_s = max(total_s / tractors, *ends_s)
    return [last_s, *[(total_s - last_s) / (tractors - 1)] * (tractors - 1)]


def _list_passes_s(each: DirectedRound, speed_mps: float) -> list[float]:
    """Per tractor the seconds from its place to the end of its column."""
    pairs = zip(each.one.columns, each.places, strict=True)
    return [(column.length_m - place.place_m) / speed_mps for column, place in pairs]


def _describe_share(found: OrderedRounds) -> dict[str, object]:
    """The share of the tracks that is worked side by side (percent), and which tractors work the rest (from 1)."""
    lines = found.table.lines
    beside_m = math.fsum(each.one.length_m for each in found.rounds)
    apart = [[node for node in tour.before + tour.after if lines[node // 2].task.kind == SWATH] for tour in found.tours]
    apart_m = math.fsum(lines[node // 2].length_m for nodes in apart for node in nodes)
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
