"""Moves from the ends of lines to places where tractors are served, and from there to the begins of lines.

They are found and driven as moves between lines are: once, with the body in them, up to a standstill at the place or
from it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from operator import attrgetter
from typing import NamedTuple

import numpy as np

from fields.arrays import SHORTEST_PIECE_M, Floats
from strategies.moves.drives import Passage
from strategies.moves.move import Move
from strategies.path_planning.paths import Pose
from strategies.programmes.move_estimates import CUTS_M, DETOUR_FACTOR, MOST_CUT_SHARE
from strategies.programmes.move_table import MoveTable
from strategies.programmes.order_tours import DETOUR_S, NO_MOVE_S

STOP_CUTS_M = tuple(sorted({cut for cuts in CUTS_M for cut in cuts}))  # of one line, at its end or begin


class Trip(NamedTuple):
    """A way between a line and a place: to `place`, a pose of the guided point to stand in, after `at_m` metres of
    `node`, or from there on to work the rest."""

    node: int
    at_m: float
    place: Pose
    is_arriving: bool


@dataclass(eq=False)
class StopMoves:
    """The moves between the lines of a table and the places at which tractors are served, as far as one search knows
    them; each is found and driven once for a site.

    Attributes:
        places: poses of the guided point to stand in.
    """

    table: MoveTable
    places: tuple[Pose, ...]
    _moves: dict[Trip, Move | None] = field(default_factory=dict)
    _guesses_s: dict[Trip, float] = field(default_factory=dict)

    def estimate_trips_s(self, ends: Sequence[tuple[int, float, float]]) -> Floats:
        """Seconds (n, places, 2) to every place and on, for nodes with where a tractor leaves and joins them (m)."""
        trips = [self.list_trips((node, leave_m), (node, join_m)) for node, leave_m, join_m in ends]
        return np.array([[[self.estimate_s(trip) for trip in both] for both in of_node] for of_node in trips])

    def list_trips(self, before: tuple[int, float], after: tuple[int, float]) -> list[tuple[Trip, Trip]]:
        """For every place the trips to it and on, between two nodes after so many metres of each."""
        return [(Trip(*before, place, True), Trip(*after, place, False)) for place in self.places]

    def get_move(self, trip: Trip) -> Move | None:
        """The cheapest move that was driven well; None if there is none."""
        if trip not in self._moves:
            found = self.table.moves.stop_moves
            if trip not in found:
                found[trip] = None if self._is_barred(trip) else self._find(trip)
            self._moves[trip] = found[trip]
        return self._moves[trip]

    def estimate_s(self, trip: Trip) -> float:
        """Seconds with all charges: of the move if it is known, else of a closed form or of a guess; dear for none."""
        if self._is_barred(trip):
            return NO_MOVE_S
        if trip in self._moves:
            move = self._moves[trip]
            return NO_MOVE_S if move is None else move.cost_s
        if trip not in self._guesses_s:
            _, a, b = next(self._list_ends(trip, (0.0,)))
            forms = self.table.moves.finder.list_moves(a, b, most=1)
            plain_s = math.dist(a[:2], b[:2]) / self.table.site.rules.turn_speed_mps
            self._guesses_s[trip] = forms[0].cost_s if forms else DETOUR_FACTOR * plain_s + DETOUR_S
        return self._guesses_s[trip]

    def _is_barred(self, trip: Trip) -> bool:
        """Whether its line is not driven that way, or its tractor stands folded: it unfolds where it works first."""
        moves, line = self.table.moves, self.table.lines[trip.node // 2]
        return (trip.node % 2 == 1 and not line.both_ways) or (trip.is_arriving and trip.node in moves.folded)

    def bound_flight_m(self, trip: Trip) -> float:
        """Metres that no move is shorter than."""
        _, a, b = next(self._list_ends(trip, (0.0,)))
        return max(0.0, math.dist(a[:2], b[:2]) - max(STOP_CUTS_M))

    def _find(self, trip: Trip) -> Move | None:
        best: Move | None = None
        for move in sorted(self._list_options(trip), key=attrgetter("cost_s")):
            if best is not None and move.cost_s >= best.cost_s:
                return best
            driven = self._drive(trip, move)
            if driven is not None and (best is None or driven.cost_s < best.cost_s):
                best = driven
        return best or self._search(trip)

    def _list_options(self, trip: Trip) -> Iterator[Move]:
        """Closed forms on which the body has room, also with the line cut back."""
        for cut_m, a, b in self._list_ends(trip, STOP_CUTS_M):
            for move in self.table.moves.finder.list_moves(a, b):
                yield self._charge_cut(trip, move, cut_m)

    def _search(self, trip: Trip) -> Move | None:
        """A move by search, if need be with the line cut back by the turning radius."""
        for cut_m, a, b in self._list_ends(trip, (0.0, self.table.site.rules.radius_m)):
            found = self.table.moves.finder.search(a, b)
            driven = None if found is None else self._drive(trip, self._charge_cut(trip, found, cut_m))
            if driven is not None:
                return driven
        return None

    def _list_ends(self, trip: Trip, cuts_m: tuple[float, ...]) -> Iterator[tuple[float, Pose, Pose]]:
        """By how much the line is cut back, and from where to where a move then leads."""
        line, way, place = self.table.lines[trip.node // 2], trip.node % 2, trip.place
        worked_m = trip.at_m if trip.is_arriving else line.measure_path_m(way) - trip.at_m
        for cut_m in cuts_m:
            if cut_m > max(0.0, MOST_CUT_SHARE * worked_m - 1.0):
                return
            pose = line.get_pose(way, trip.at_m - cut_m if trip.is_arriving else trip.at_m + cut_m)
            yield (cut_m, pose, place) if trip.is_arriving else (cut_m, place, pose)

    def _charge_cut(self, trip: Trip, move: Move, cut_m: float) -> Move:
        return self.table.moves.charge_cuts(move, *((cut_m, 0.0) if trip.is_arriving else (0.0, cut_m)))

    def _drive(self, trip: Trip, move: Move) -> Move | None:
        """A move with its time as driven; None if it is not driven, leaves the ground or loses its line."""
        moves, node = self.table.moves, trip.node
        rest_m = self.table.lines[node // 2].measure_path_m(node % 2) - trip.at_m
        is_after_work = trip.is_arriving and trip.at_m > 0.0
        before = moves.cut_before(node, rest_m + move.leave_m) if is_after_work else None
        after = None if trip.is_arriving else moves.cut_after(node, trip.at_m + move.join_m)
        if before is None and after is None and move.path.length_m <= SHORTEST_PIECE_M:
            return move  # it stands at the place already
        return moves.drives.prove([Passage(move, before, after)])[0]
