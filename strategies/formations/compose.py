"""The programme and plan of a formation: rounds and tours as its site has them, the queue by its rule."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from strategies.formations.formation_plan import QueueRule, write_formation
from strategies.formations.formation_site import OrderedRounds
from strategies.formations.queue_rules import measure_rounds_s
from strategies.programmes.programme import Programme, measure_way_s
from vehicle.missions.plan import SWATH, Plan, PlanNotes


@dataclass(frozen=True)
class FormationRule:
    """How the tractors of a formation leave the queue at the end of a round.

    Attributes:
        queue_rule: gives what a tractor waits for.
        move_up: whether those behind move up in the queue.
        in_rows: whether whole rows leave one after another.
        in_file: whether tractors leave one after another, each when the one before it has turned.
    """

    queue_rule: QueueRule
    move_up: bool = True
    in_rows: bool = False
    in_file: bool = False


@dataclass(frozen=True, eq=False)
class Formation:
    """Rounds and tours of a formation, and the rule by which its tractors turn."""

    found: OrderedRounds
    rule: FormationRule

    @property
    def programme(self) -> Programme:
        """Its tours, and the lines in none of them."""
        table, tours = self.found.table, [tour.nodes for tour in self.found.tours]
        worked = {node // 2 for nodes in tours for node in nodes}
        return Programme(table, tuple(tours), tuple(k for k in range(len(table.lines)) if k not in worked))

    def build_plan(self) -> Plan:
        """Its plan, with what is worked side by side in the notes."""
        found, rule = self.found, self.rule
        plan = write_formation(found.table, found.rounds, found.tours, rule.queue_rule, move_up=rule.move_up)
        return replace(plan, notes=_note_share(found))

    def compute_tractor_s(self) -> list[float]:
        """Seconds of every tractor; all begin a round together, when the last is in its place."""
        table, rounds = self.found.table, self.found.rounds
        speed, gate = table.site.rules.work_speed_mps, [] if table.site.lane is None else [table.gate]
        begun_s = max(
            measure_way_s(table, [*gate, *tour.before, tour.rounds[0]], tour.before) + place.place_m / speed
            for tour, place in zip(self.found.tours, rounds[0].places, strict=True)
        )
        begun_s += (
            measure_rounds_s(rounds, speed, in_rows=self.rule.in_rows, in_file=self.rule.in_file)
            + table.moves.drives.rest_s
        )
        last = zip(self.found.tours, rounds[-1].one.columns, rounds[-1].places, strict=True)
        return [
            begun_s
            + (column.length_m - place.place_m) / speed
            + measure_way_s(table, [tour.rounds[-1], *tour.after, *gate], tour.after)
            for tour, column, place in last
        ]


def _note_share(found: OrderedRounds) -> PlanNotes:
    """The share of the tracks that is worked side by side, and which tractors work the rest."""
    lines = found.table.lines
    beside_m = math.fsum(each.one.length_m for each in found.rounds)
    apart = [[node for node in tour.before + tour.after if lines[node // 2].task.kind == SWATH] for tour in found.tours]
    apart_m = math.fsum(lines[node // 2].length_m for nodes in apart for node in nodes)
    share_pct = 100.0 * beside_m / (beside_m + apart_m)
    separate = tuple(number for number, nodes in enumerate(apart) if nodes)
    return PlanNotes(formation_pct=round(share_pct, 3), apart=separate)


def describe_formation_share(plan: Plan) -> str | None:
    """A remark if not all of a plan is driven in formation; None otherwise."""
    share_pct, separate = plan.notes.formation_pct, plan.notes.apart
    if share_pct is None or not separate:
        return None
    names = [str(number + 1) for number in separate]
    workers = f"tractor {names[0]}" if len(names) == 1 else f"tractors {', '.join(names[:-1])} and {names[-1]}"
    return f"{min(round(share_pct), 99)} % of the tracks are worked in formation, the rest by {workers}"
