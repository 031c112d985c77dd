"""The moves of sites on disk, from run to run: a field is often planned more than once.

Nothing of what is known of moves depends on what was asked before: what several processes found of the same site may be
put together, and a move is meant by the table that it was found for, its key there and its place among others of that
key.
"""

from __future__ import annotations

import secrets
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, fields
from functools import partial
from itertools import islice
from typing import Any

import numpy as np

from planner.evaluation.context import PlanningContext
from planner.pipeline.fingerprint import hash_content
from planner.pipeline.result_cache import ResultCache
from strategies.moves.move import Move
from strategies.programmes.site_moves import SiteMoves

Known = dict[str, list[Any]]
"""Entries (key, value) of tables by their names."""
MOVE_FIELDS = tuple(each.name for each in fields(Move))
DRIVEN, LOST = "driven", "lost"
DRIVES = "drive", "drive_level"  # of a site: functions of the tractor, its implement, heights and load
MOST_BYTES = 100_000_000


@dataclass(frozen=True)
class MoveCache:
    """Files by the hash of a site, its lines, what drives there and the code: each with what one process found."""

    results: ResultCache

    def load(self, context: PlanningContext, moves: SiteMoves) -> None:
        """Let moves of a context know what is stored of them."""
        load_entries(moves, self.results.read_all(_hash_site(context, moves)))
        moves.stored_counts.update(count_entries(moves))

    def store(self, context: PlanningContext, moves: SiteMoves) -> None:
        """Store what is new of the moves of a context."""
        if new := describe_entries(moves, moves.stored_counts):
            self.results.write(f"{_hash_site(context, moves)}-{secrets.token_hex(4)}", new)
            self.results.remove_oldest(MOST_BYTES)
        moves.stored_counts.update(count_entries(moves))


def _hash_site(context: PlanningContext, moves: SiteMoves) -> str:
    """A hash of all that moves depend on."""
    site, physics = moves.site, context.physics
    ground = {each.name: getattr(site, each.name) for each in fields(site) if each.name not in DRIVES}
    machine = context.tractor, context.implement, physics.terrain, physics.driven_load
    stands = moves.starts, moves.used, moves.orders, sorted(moves.folded)
    return hash_content(ground, machine, moves.lines, stands)


def count_entries(moves: SiteMoves) -> dict[str, int]:
    """How many entries each table of what is known has."""
    return {name: len(table) for name, table in _get_tables(moves).items()}


def describe_entries(moves: SiteMoves, counts: Mapping[str, int]) -> Known:
    """What is known of a site beyond the first entries of each table, so many by its name; empty for nothing."""
    tables = _get_tables(moves)
    places = dict(_iter_places(tables))
    places |= {one: (DRIVEN, place) for move, one in moves.driven.items() if one and (place := places.get(move))}
    by_place = partial(_flatten, write_move=lambda move: {"place": _flatten(places[move])})
    found: Known = {}
    for name, table in tables.items():
        write_key = by_place if name in (DRIVEN, LOST) else _flatten
        new = list(islice(table.items(), counts.get(name, 0), None))
        if new:
            found[name] = [[write_key(key), _flatten(value)] for key, value in new if _list_moves(key) <= places.keys()]
    return found


def load_entries(moves: SiteMoves, described: Iterable[Known]) -> None:
    """Let a site know what `describe_entries` gave of it; without what refers to files that are gone."""
    tables, given = _get_tables(moves), list(described)

    def read_place(place: Any) -> Move:
        name, key, *number = place
        found = tables[name][read_place(key) if name == DRIVEN else key]
        return found[number[0]] if isinstance(found, tuple) else found  # type: ignore[no-any-return]

    for name, table in tables.items():  # moves before what is known of them
        for known in given:
            with suppress(LookupError):
                for key, value in known.get(name, ()):
                    table.setdefault(_restore(key, read_place), _restore(value, read_place))


def _get_tables(moves: SiteMoves) -> dict[str, dict[Any, Any]]:
    return {
        "estimates": moves.estimates.known,
        "options": moves.options,
        "cut": moves.cut_moves,
        "folded": moves.folded_moves,
        "searched": moves.searched_moves,
        DRIVEN: moves.driven,
        LOST: moves.lost_in_runs,
    }


def _list_moves(key: Any) -> set[Move]:
    """The moves in the key of a table."""
    return {one for one in (key if isinstance(key, tuple) else (key,)) if isinstance(one, Move)}


def _iter_places(tables: Mapping[str, Mapping[Any, Any]]) -> Iterator[tuple[Move, tuple[Any, ...]]]:
    """The moves that were found, with where they are."""
    for name in ("options", "cut", "folded", "searched"):
        for key, value in tables[name].items():
            found = value if isinstance(value, tuple) else (value,)
            yield from ((move, (name, key, number)) for number, move in enumerate(found) if move)


def _write_move(move: Move) -> dict[str, Any]:
    return {name: _flatten(getattr(move, name)) for name in MOVE_FIELDS}


def _flatten(value: Any, write_move: Callable[[Move], Any] = _write_move) -> Any:
    """A key or value of a table with lists for tuples and arrays, and with moves as they are written."""
    if isinstance(value, Move):
        return write_move(value)
    if isinstance(value, tuple):
        return [_flatten(one, write_move) for one in value]
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value


def _restore(value: Any, read_place: Callable[[Any], Move]) -> Any:
    """A key or value that was flattened."""
    if isinstance(value, list):
        return tuple(_restore(one, read_place) for one in value)
    if not isinstance(value, dict):
        return value
    if "place" in value:
        return read_place(_restore(value["place"], read_place))
    rows = np.array(value["rows"], np.float64).reshape(-1, 3)
    return Move(**(value | {"start": tuple(value["start"]), "rows": rows}))
