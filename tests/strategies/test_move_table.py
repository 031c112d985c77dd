"""Costs of moves in a search for programmes: how often what fails is tried again."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from strategies.moves.move import Move
from strategies.programmes.move_table import MOST_VAIN, MoveTable

NODES = 40


def build_move(cost_s: float) -> Move:
    """A straight move that takes so long."""
    return Move((0.0, 0.0, 0.0), np.array([[10.0, 0.0, 1.0]]), "route", cost_s)


def build_table(up_s: float | None = None, folded_s: float | None = None) -> tuple[MoveTable, list[tuple[int, int]]]:
    """A table of nodes between which a search finds moves of this cost, or none, with the implement up and folded, and
    the pairs that are searched with it folded; these usually take 60 s."""
    folded, costs = list[tuple[int, int]](), np.full((NODES + 1, NODES + 1), 20.0)
    estimates = SimpleNamespace(
        near=(costs, np.ones(costs.shape, bool)),
        guess_detour_s=lambda *_: 100.0,
        guess_searched_s=lambda *_: 50.0,
        guess_folded_s=lambda *_: 60.0,
        is_apart=np.zeros((2, *costs.shape), bool),
    )

    def list_folded_moves(u: int, v: int) -> list[Move]:
        folded.append((u, v))
        return [] if folded_s is None else [build_move(folded_s)]

    moves: Any = SimpleNamespace(
        estimates=estimates,
        site=SimpleNamespace(folded=object(), wheels_spoil=False),
        list_options=lambda *_: (),
        list_cut_moves=lambda *_: (),
        search=lambda *_: None if up_s is None else build_move(up_s),
        has_way=lambda *_: True,
        list_folded_moves=list_folded_moves,
    )
    return MoveTable(moves), folded


def test_searches_with_the_implement_folded_end_where_too_many_were_in_vain() -> None:
    table, folded = build_table()
    found = [table.find(0, v) for v in range(2, NODES)]
    assert not any(found)
    assert folded == [(0, v) for v in range(2, 2 + MOST_VAIN)]
    assert not table.find(1, 5)
    assert folded[-1] == (1, 5)


@pytest.mark.parametrize(
    ("up_s", "best_s", "is_searched"), [(59.0, 59.0, False), (61.0, 55.0, True), (None, 55.0, True)]
)
def test_a_move_with_the_implement_folded_is_searched_where_one_with_it_up_is_dear(
    up_s: float | None, best_s: float, is_searched: bool
) -> None:
    table, folded = build_table(up_s, 55.0)
    assert table.find(0, 2)
    assert (table.cost_s[0, 2], bool(folded)) == (best_s, is_searched)


def test_a_move_with_the_implement_folded_takes_the_place_of_one_that_a_drive_refuses() -> None:
    table, folded = build_table(50.0, 55.0)
    assert table.find(0, 2) and not folded
    table.strike(0, 2)
    assert table.find(0, 2)
    assert (table.cost_s[0, 2], folded) == (55.0, [(0, 2)])
