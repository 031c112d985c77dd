"""What moves between lines cost in one search for programmes: as found and driven so far, else as guessed."""

from __future__ import annotations

import math
from bisect import insort
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from operator import attrgetter

import numpy as np

from fields.arrays import Flags, Floats
from strategies.lines.work_line import WorkLine
from strategies.moves.move import Move
from strategies.programmes.order_tours import DETOUR_S, NO_MOVE_S
from strategies.programmes.site_moves import SiteMoves
from strategies.site.site import Site
from vehicle.missions.plan import Mission

USUAL_SHARE = 0.75  # of moves: tours use those whose cost is expected too low
MOST_VAIN = 8  # searches from or to a place that found nothing, before it is given up


@dataclass(eq=False)
class MoveTable:
    """Costs of all moves between the lines of a site, as far as one search for programmes knows them.

    Attributes:
        moves: what is known of the site, shared by all searches.
        cost_s: (n + 1, n + 1) seconds from the end of a node to the begin of another, with charges; NO_MOVE_S where
            there is none.
        is_estimated: (n + 1, n + 1) which costs are more than guesses by distance.
        excesses_s: by how much moves were dearer than expected, of all that were driven.
        missions: by the nodes of a tour and the moves between them.
        clashes: by who says so, the nodes of which no two tractors may begin or end with both, those among them between
            which tours of this search got stuck.
    """

    moves: SiteMoves
    cost_s: Floats = field(init=False)
    is_estimated: Flags = field(init=False)
    excesses_s: list[float] = field(default_factory=list)
    missions: dict[tuple[Hashable, ...], Mission] = field(default_factory=dict)
    clashes: dict[Hashable, Flags] = field(default_factory=dict)
    _options: dict[tuple[int, int], list[Move]] = field(default_factory=dict)
    _cut_m: dict[tuple[int, int], float] = field(default_factory=dict)
    _searched: set[tuple[int, int]] = field(default_factory=set)
    _folded: set[tuple[int, int]] = field(default_factory=set)
    _proven: set[tuple[int, int]] = field(default_factory=set)
    _driven: set[Move] = field(default_factory=set)
    _failures: Floats = field(init=False)
    _searched_in_vain: dict[tuple[str, str, int], int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        costs, is_estimated = self.moves.estimates.near
        self.cost_s, self.is_estimated = costs.copy(), is_estimated.copy()
        self._failures = np.zeros((2, len(costs)))

    @property
    def site(self) -> Site:
        """Where and with what."""
        return self.moves.site

    @property
    def lines(self) -> Sequence[WorkLine]:
        """The lines that moves join."""
        return self.moves.lines

    @property
    def starts(self) -> tuple[int, ...]:
        """The nodes that tractors standing on the field begin with."""
        return self.moves.starts

    @property
    def gate(self) -> int:
        """The node of the entrance."""
        return self.moves.gate

    def estimate(self, pairs: Sequence[tuple[int, int]]) -> bool:
        """Estimate what moves between pairs of nodes cost; whether any was new."""
        new = [pair for pair in pairs if not self.is_estimated[pair] and self.cost_s[pair] < NO_MOVE_S]
        if new:
            places = tuple(np.array(new, np.int64).T)
            self.cost_s[places], self.is_estimated[places] = self.moves.estimates.estimate_s(new), True
        return bool(new)

    def get_move(self, u: int, v: int) -> Move | None:
        """The best move between two nodes that no drive has refused; None if none is known."""
        options = self._options.get((u, v))
        return options[0] if options else None

    def sum_drive_s(self, pairs: Sequence[tuple[int, int]]) -> float:
        """Seconds of the moves between pairs of nodes without charges: as found or driven, else as estimated."""
        moves = [self.get_move(*pair) for pair in pairs]
        unknown = [pair for pair, move in zip(pairs, moves, strict=True) if move is None]
        estimated_s = float(self.moves.estimates.estimate_s(unknown, is_charged=False).sum()) if unknown else 0.0
        return estimated_s + math.fsum(move.drive_s for move in moves if move is not None)

    def is_proven(self, u: int, v: int) -> bool:
        """Whether the move between two nodes was driven well."""
        return (u, v) in self._proven

    def get_proven_mask(self) -> Flags:
        """For all pairs of nodes (n + 1, n + 1) whether their move was driven well."""
        mask = np.zeros(self.cost_s.shape, bool)
        mask[tuple(np.array(list(self._proven), np.int64).reshape(-1, 2).T)] = True
        return mask

    def estimate_costs(self) -> Floats:
        """Costs (n + 1, n + 1) with what moves not yet driven are likely to take more, by those that were.

        From and to places where moves failed others are likely to fail as well, the more so the fewer did not: where
        none is driven well, a line is soon worth less than another try.
        """
        is_proven = self.get_proven_mask()
        leaving, entering = self._failures**2 / (1.0 + np.array([is_proven.sum(axis=1), is_proven.sum(axis=0)]))
        more_s = self._compute_usual_s() + DETOUR_S * np.add.outer(leaving, entering)
        return np.where(is_proven | (self.cost_s >= NO_MOVE_S), self.cost_s, self.cost_s + more_s)

    def _compute_usual_s(self) -> float:
        """By how much moves that tours use are usually dearer than expected, at most."""
        return max(0.0, float(np.quantile(self.excesses_s, USUAL_SHARE))) if self.excesses_s else 0.0

    def prove(self, pairs: Sequence[tuple[int, int]], are_chosen: bool = True) -> bool:
        """Find and drive the moves of all pairs of nodes until one of each was driven well that is likely to be the
        cheapest; whether all have one.

        A move that a drive refuses does not exist; of others the time is as driven, and beginning the next line beside
        it is charged. Those that tours chose (`are_chosen`) say what others are likely to take more.
        """
        todo = {pair: float(self.cost_s[pair]) for pair in pairs if pair not in self._proven}
        undriven = [pair for pair in todo if self.find(*pair) and not self._is_settled(pair)]
        usual_s = self._compute_usual_s()
        while undriven:
            self.moves.drive([(*pair, self._options[pair][0]) for pair in undriven])
            for pair in undriven:
                self._take_drive(pair, usual_s)
            undriven = [pair for pair in undriven if not self._is_settled(pair)]
        for pair, before_s in todo.items():
            self._update_cost(*pair)
            if not are_chosen:
                continue
            if pair not in self._proven:
                self._failures[[0, 1], pair] += 1
            self.excesses_s.append(
                min(self.cost_s[pair], self.moves.estimates.guess_detour_s(*pair)) - min(before_s, NO_MOVE_S)
            )
        return all(pair in self._proven for pair in pairs)

    def _take_drive(self, pair: tuple[int, int], usual_s: float) -> None:
        """Replace the cheapest move of a pair by what a drive made of it; others are dearer than they seem.

        Where none is left that a search found, there may be one with the implement folded.
        """
        options = self._options[pair]
        proven = self.moves.driven[options.pop(0)]
        if proven is not None:
            self._driven.add(proven)
            insort(options, proven, key=lambda one: one.cost_s + (0.0 if one in self._driven else usual_s))
        if not options and pair in self._searched:
            options += self._fold(*pair)

    def _is_settled(self, pair: tuple[int, int]) -> bool:
        """Whether the cheapest move of a pair was driven, or none is left."""
        options = self._options[pair]
        if options and options[0] in self._driven:
            self._proven.add(pair)
        return not options or pair in self._proven

    def strike(self, u: int, v: int) -> None:
        """Take the move between two nodes for one that does not exist: the next best has to be driven."""
        self._options[u, v].pop(0)
        self._proven.discard((u, v))
        self._update_cost(u, v)

    def find(self, u: int, v: int) -> bool:
        """Find moves between two nodes; whether any is.

        In closed form, else with lines cut back as little as any move needs, and by a search where that, or driving on
        a crop or a seedbed, is dearer than what searches usually find; else by a search, and with the implement folded
        where what it finds is dearer than that usually is.
        """
        if (u, v) not in self._options:
            options = list(self.moves.list_options(u, v))
            self._options[u, v] = self._search_if_dear(u, v, options) if self.site.wheels_spoil else options
        if not self._options[u, v]:
            self._options[u, v] = self._cut_back(u, v)
        if not self._options[u, v]:
            found = self._search(u, v)
            if not found or found[0].cost_s > self.moves.estimates.guess_folded_s(u, v):
                found = sorted([*found, *self._fold(u, v)], key=attrgetter("cost_s"))
            self._options[u, v] = found
        self._update_cost(u, v)
        return bool(self._options[u, v])

    def _cut_back(self, u: int, v: int) -> list[Move]:
        """The moves that cut as little more off the lines as any does, and where even that is dear, one by a search."""
        cut = list(self.moves.list_cut_moves(u, v, self._cut_m.get((u, v), 0.0)))
        self._cut_m[u, v] = cut[0].leave_m + cut[0].join_m if cut else math.inf
        return self._search_if_dear(u, v, cut)

    def _search_if_dear(self, u: int, v: int, options: list[Move]) -> list[Move]:
        """Moves, the cheapest first, with one by a search where the best is dearer than what these usually find."""
        is_dear = bool(options) and options[0].cost_s > self.moves.estimates.guess_searched_s(u, v)
        searched = self._search(u, v, is_needed=False) if is_dear else []
        return sorted([*options, *searched], key=attrgetter("cost_s"))

    def _update_cost(self, u: int, v: int) -> None:
        """The cost of the best move between two nodes that is left; dear where none is known yet."""
        options = self._options[u, v]
        if options:
            self.cost_s[u, v] = max(0.0, options[0].cost_s)
        else:
            may_find = self._cut_m.get((u, v), 0.0) < math.inf or self._may_search(u, v) or self._may_fold(u, v)
            self.cost_s[u, v] = self.moves.estimates.guess_detour_s(u, v) if may_find else NO_MOVE_S
        self.is_estimated[u, v] = True

    def _search(self, u: int, v: int, is_needed: bool = True) -> list[Move]:
        """The move by a search between two nodes that was not tried before; none where there is no hope of one.

        One that is needed and finds nothing lessens the hope for others at the same places.
        """
        if not self._may_search(u, v):
            return []
        self._searched.add((u, v))
        found = self.moves.search(u, v)
        if found is None and is_needed:
            self._lose_hope("up", u, v)
        return [] if found is None else [found]

    def _fold(self, u: int, v: int) -> Sequence[Move]:
        """The moves with the implement folded between two nodes that were not tried before."""
        if not self._may_fold(u, v):
            return ()
        self._folded.add((u, v))
        found = self.moves.list_folded_moves(u, v)
        if not found:
            self._lose_hope("folded", u, v)
        return found

    def _may_search(self, u: int, v: int) -> bool:
        """Whether a search may still find a move."""
        is_new = (u, v) not in self._searched and not self.moves.estimates.is_apart[0, u, v]
        return is_new and self._has_hope("up", u, v) and self.moves.has_way(u, v)

    def _may_fold(self, u: int, v: int) -> bool:
        """Whether a move with the implement folded may still be found."""
        is_new = (u, v) not in self._folded and not self.moves.estimates.is_apart[1, u, v]
        return is_new and self._has_hope("folded", u, v)

    def _has_hope(self, implement: str, u: int, v: int) -> bool:
        """Whether a search with the implement up or folded is likely to succeed: not where too many others from or to
        the same place were in vain."""
        return all(self._searched_in_vain.get((implement, *end), 0) < MOST_VAIN for end in (("end", u), ("begin", v)))

    def _lose_hope(self, implement: str, u: int, v: int) -> None:
        """Note that a search with the implement up or folded was in vain."""
        for end in (("end", u), ("begin", v)):
            self._searched_in_vain[implement, *end] = self._searched_in_vain.get((implement, *end), 0) + 1


def split_apart(numbers: Sequence[int], are_joined: Callable[[int, int], bool]) -> list[list[int]]:
    """The longest stretches of a sequence in which each number is joined to the next; one without any for none."""
    parts = [list(numbers[:1])]
    for before, after in pairwise(numbers):
        if are_joined(before, after):
            parts[-1].append(after)
        else:
            parts.append([after])
    return parts
