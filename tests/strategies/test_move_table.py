"""Costs of moves in a search for programmes: how often what fails is tried again."""

from types import SimpleNamespace
from typing import Any

import numpy as np

from strategies.programmes.move_table import MOST_VAIN, MoveTable

NODES = 40


def build_vain_table() -> tuple[MoveTable, list[tuple[int, int]]]:
    """A table of nodes between which no move is found, with the pairs that are searched with the implement folded."""
    folded, costs = list[tuple[int, int]](), np.full((NODES + 1, NODES + 1), 20.0)
    estimates = SimpleNamespace(
        near=(costs, np.ones(costs.shape, bool)),
        guess_detour_s=lambda *_: 100.0,
        guess_searched_s=lambda *_: 50.0,
        is_apart=np.zeros((2, *costs.shape), bool),
    )

    def list_folded_moves(u: int, v: int) -> tuple[()]:
        folded.append((u, v))
        return ()

    moves: Any = SimpleNamespace(
        estimates=estimates,
        site=SimpleNamespace(folded=object(), wheels_spoil=False),
        list_options=lambda *_: (),
        list_cut_moves=lambda *_: (),
        search=lambda *_: None,
        has_way=lambda *_: True,
        list_folded_moves=list_folded_moves,
    )
    return MoveTable(moves), folded


def test_searches_with_the_implement_folded_end_where_too_many_were_in_vain() -> None:
    table, folded = build_vain_table()
    found = [table.find(0, v) for v in range(2, NODES)]
    assert not any(found)
    assert folded == [(0, v) for v in range(2, 2 + MOST_VAIN)]
    assert not table.find(1, 5)
    assert folded[-1] == (1, 5)
