"""The plan of a formation: legs of every tour, the queue at the end of each round, and who waits for whom.

At the end of a round the rows queue inside their columns, a gap apart, and move up. When all are in place in the next
round, all start together (Eq. 6.1 keeps the distance).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from strategies.formations.round_order import DirectedRound
from strategies.formations.rounds import APPROACH_M, SHORTEST_M, RoundPlace, get_neighbour, get_row
from strategies.formations.tours import FormationTour
from strategies.programmes.move_table import MoveTable
from strategies.programmes.tour_legs import (
    build_move,
    build_way_in,
    build_way_out,
    iter_passes,
    split_work_leg,
    stand_to_unfold,
)
from strategies.rules.legs import make_mission
from vehicle.missions.plan import FollowOrder, Leg, LegGate, Plan

QUEUE_PART = 3  # of a pass: after its way to its place, what it works in formation, and its approach to the queue
MOVED_ON_GAP_SHARE = 0.8  # share of the gap the tractor in front must have driven


@dataclass(frozen=True)
class ColumnMarks:
    """Leg numbers of one tractor in one round.

    Attributes:
        turn_leg: the last leg of the move to its column.
        place_leg: ends at the place in formation.
        work_leg: the first that is worked in formation.
        queue_legs: those from the queue on, one for every place to wait; it leaves the queue with the last.
        is_whole: whether all that is worked in formation is one leg.
    """

    turn_leg: int
    place_leg: int
    work_leg: int
    queue_legs: tuple[int, ...]
    is_whole: bool

    @property
    def release_leg(self) -> int:
        """The leg with which it leaves the queue."""
        return self.queue_legs[-1]


@dataclass(frozen=True, eq=False)
class RoundDraft:
    """A formation plan while it is written: legs per tractor, and marks by round and tractor."""

    table: MoveTable
    rounds: Sequence[DirectedRound]
    legs: list[list[Leg]]
    marks: dict[tuple[int, int], ColumnMarks] = field(default_factory=dict)

    @property
    def tractors(self) -> int:
        """How many tractors there are."""
        return len(self.legs)

    def build_place_gate(self, number: int, tractor: int) -> LegGate:
        """Gate that opens when a tractor is at its place in a round."""
        return self._build_end_gate(tractor, self.marks[number, tractor].place_leg)

    def build_turn_gate(self, number: int, tractor: int) -> LegGate:
        """Gate that opens when a tractor has finished its move into a round."""
        return self._build_end_gate(tractor, self.marks[number, tractor].turn_leg)

    def build_release_gate(self, number: int, tractor: int, distance_m: float) -> LegGate:
        """Gate that opens when a tractor has driven a distance since it left its queue for a round."""
        leg, legs = self.marks[number - 1, tractor].release_leg, self.legs[tractor]
        while leg < len(legs) - 1 and distance_m > legs[leg].length_m:
            distance_m -= legs[leg].length_m
            leg += 1
        return LegGate(tractor, leg, min(distance_m, legs[leg].length_m))

    def add_wait(self, tractor: int, leg: int, gates: Sequence[LegGate]) -> None:
        """Let a tractor wait for gates before one of its legs."""
        if gates:
            self.legs[tractor][leg] = self.legs[tractor][leg].copy_with_gates(gates)

    def _build_end_gate(self, tractor: int, leg: int) -> LegGate:
        return LegGate.place(tractor, leg, self.legs[tractor][leg].length_m)


QueueRule = Callable[[RoundDraft, int, int], list[LegGate]]
"""Gives the gates that a tractor (round, tractor) waits for before it leaves its queue for a round."""


def write_formation(
    table: MoveTable,
    rounds: Sequence[DirectedRound],
    tours: Sequence[FormationTour],
    queue_rule: QueueRule,
    *,
    move_up: bool = True,
) -> Plan:
    """The plan of tours; without `move_up` each stays at its first place in the queue until it leaves it."""
    draft = RoundDraft(table, rounds, [[] for _ in tours])
    for tractor, tour in enumerate(tours):
        _write_tour(draft, tractor, tour, move_up)
    for number, each in enumerate(rounds):
        for tractor in range(draft.tractors):
            if number:
                rule = _queue_in_single_file if each.is_afar else queue_rule
                draft.add_wait(tractor, draft.marks[number - 1, tractor].release_leg, rule(draft, number, tractor))
            _add_round_gates(draft, number, tractor)
    if move_up:
        _add_moving_up(draft)
    return Plan(tuple(make_mission(stand_to_unfold(table.site, legs)) for legs in draft.legs))


def _queue_in_single_file(draft: RoundDraft, number: int, tractor: int) -> list[LegGate]:
    """On a longer way to a round the next follows when the one before it is in place, the first row first."""
    order = sorted(range(draft.tractors), key=lambda other: (get_row(other, draft.tractors), other))
    position = order.index(tractor)
    return [draft.build_place_gate(number, order[position - 1])] if position else []


def _write_tour(draft: RoundDraft, tractor: int, tour: FormationTour, move_up: bool) -> None:
    """All legs of a tractor, from the entrance and back."""
    table, legs = draft.table, draft.legs[tractor]
    passes = [(node,) for node in tour.before] + [each.list_nodes(tractor) for each in draft.rounds]
    passes += [(node,) for node in tour.after]
    legs += build_way_in(table, passes[0][0])
    for number, (nodes, join_m, leave_m, onward) in enumerate(iter_passes(table, passes), start=-len(tour.before)):
        if 0 <= number < len(draft.rounds):
            _write_pass(draft, number, tractor, (join_m, leave_m), move_up)
        else:
            legs += split_work_leg(table, nodes[0], leave_m, join_m)
        legs += onward
    legs += build_way_out(table, passes[-1][-1])


def _write_pass(draft: RoundDraft, number: int, tractor: int, cut_m: tuple[float, float], move_up: bool) -> None:
    """The legs of a tractor in a round: to its place, in formation, through the queue."""
    each, legs = draft.rounds[number], draft.legs[tractor]
    place, pass_legs = each.places[tractor], _list_pass_legs(draft.table, each.list_nodes(tractor), *cut_m)
    first, last = each.one.columns[tractor].project_span(each.way)
    stops_m = _list_stops_m(place, pass_legs, (cut_m[0], last - first - cut_m[1]), move_up)
    parts = [_cut_legs(pass_legs, a, b) for a, b in pairwise(stops_m)]
    begun = len(legs)
    numbers = np.cumsum([begun, *map(len, parts)]).tolist()
    for part in parts[QUEUE_PART:]:
        part[0] = replace(part[0], may_wait=part is parts[-1])
    legs += [leg for part in parts for leg in part]
    draft.marks[number, tractor] = ColumnMarks(
        turn_leg=begun - 1 if begun else numbers[1] - 1,
        place_leg=numbers[1] - 1,
        work_leg=numbers[1],
        queue_legs=tuple(numbers[QUEUE_PART:-1]),
        is_whole=len(parts[1]) == 1,
    )


def _list_pass_legs(table: MoveTable, nodes: Sequence[int], join_m: float, leave_m: float) -> list[Leg]:
    """The legs of a column: its pieces, and between them what is worked round an obstacle."""
    legs: list[Leg] = []
    for node, following in pairwise([*nodes, -1]):
        move = None if following < 0 else table.get_move(node, following)
        legs.append(table.moves.build_work_leg(node, leave_m if move is None else move.leave_m, join_m))
        if move is not None:
            legs += build_move(table, following, move)
            join_m = move.join_m
    return legs


def _list_stops_m(
    place: RoundPlace, legs: Sequence[Leg], straight_m: tuple[float, float], move_up: bool
) -> list[float]:
    """Where the legs of a pass are cut: places count from its begin, those in the queue from its end."""
    whole_m = sum(leg.length_m for leg in legs)
    begin_m, end_m = straight_m
    place_m = max(SHORTEST_M, place.place_m - begin_m)
    queue_m = [whole_m - (end_m - waits_m) for waits_m in (place.hold_m, *(place.up_m if move_up else ()))]
    stops_m = [0.0, place_m, queue_m[0] - APPROACH_M, *queue_m, whole_m]
    kept = [(stop, after) for stop, after in pairwise(stops_m)]
    assert all(after > stop for stop, after in kept)  # a round has room
    return stops_m


def _cut_legs(legs: Sequence[Leg], first_m: float, last_m: float) -> list[Leg]:
    """The legs between two distances along them, none shorter than SHORTEST_M unless it is all."""
    begin_m, parts = 0.0, list[Leg]()
    for leg in legs:
        low, high = max(first_m - begin_m, 0.0), min(last_m - begin_m, leg.length_m)
        if high > low + 1e-6:
            parts.append(leg.cut(low, high))
        begin_m += leg.length_m
    return parts


def _add_round_gates(draft: RoundDraft, number: int, tractor: int) -> None:
    """All start together, and each keeps its distance to the one it follows."""
    marks, legs = draft.marks[number, tractor], draft.legs[tractor]
    others = [other for other in range(draft.tractors) if other != tractor]
    draft.add_wait(tractor, marks.work_leg, [draft.build_place_gate(number, other) for other in others])
    neighbour = get_neighbour(tractor, draft.tractors)
    if neighbour is not None and marks.is_whole and draft.marks[number, neighbour].is_whole:
        follow = FollowOrder(neighbour, draft.marks[number, neighbour].work_leg, draft.table.site.rules.gap_m)
        legs[marks.work_leg] = replace(legs[marks.work_leg], follow=follow)


def _add_moving_up(draft: RoundDraft) -> None:
    """In the queue, move up a place when the tractor in front has moved on."""
    gap_m = MOVED_ON_GAP_SHARE * draft.table.site.rules.gap_m
    for (number, tractor), marks in draft.marks.items():
        neighbour = get_neighbour(tractor, draft.tractors)
        if neighbour is None or number == len(draft.rounds) - 1:  # from the last round all go as they can
            continue
        front = draft.marks[number, neighbour].queue_legs
        for own_leg, front_leg in zip(marks.queue_legs, front, strict=False):
            after_m = min(gap_m, draft.legs[neighbour][front_leg].length_m)
            draft.add_wait(tractor, own_leg, [LegGate(neighbour, front_leg, after_m)])
