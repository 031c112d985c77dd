"""The moves of sites on disk, from run to run: a field is often planned more than once.

Nothing of what is known of moves depends on what was asked before: what several processes found of the same site may be
put together, and a move is meant by the table that it was found for, its key there and its place among others of that
key.
"""

from __future__ import annotations

import secrets
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from itertools import islice
from typing import Any

import numpy as np

from planner.evaluation.context import PlanningContext, StoredMoves
from planner.pipeline.fingerprint import hash_content
from planner.pipeline.result_cache import ResultCache
from strategies.moves.move import Move
from strategies.programmes.site_moves import SiteMoves

Known = dict[str, list[Any]]
"""Entries (key, value) of tables by their names."""
DRIVEN = "driven"  # the table whose keys are moves of other tables
DRIVES = "drive", "drive_level"  # of a site: functions of the tractor, its implement, heights and load


@dataclass(frozen=True)
class MoveCache:
    """Files by the hash of a site, its lines, what drives there and the code: each with what one process found."""

    results: ResultCache

    def load(self, context: PlanningContext, moves: SiteMoves) -> None:
        """Let moves of a context know what is stored of them."""
        name = _hash_site(context, moves)
        load_entries(moves, self.results.read_all(name))
        context.site_cache[StoredMoves] = StoredMoves(name, count_entries(moves))

    def store(self, context: PlanningContext) -> None:
        """Store what is new of the moves of a context that were loaded."""
        moves, stored = context.site_cache[SiteMoves], context.site_cache.get(StoredMoves)
        if stored is None:
            return
        if new := describe_entries(moves, stored.counts):
            self.results.write(f"{stored.name}-{secrets.token_hex(4)}", new)
            self.results.remove_oldest()
        context.site_cache[StoredMoves] = replace(stored, counts=count_entries(moves))


def _hash_site(context: PlanningContext, moves: SiteMoves) -> str:
    """A hash of all that moves depend on."""
    site, physics = moves.site, context.physics
    ground = {each.name: getattr(site, each.name) for each in fields(site) if each.name not in DRIVES}
    machine = context.tractor, context.implement, physics.terrain, physics.driven_load
    stands = moves.starts, moves.used, moves.orders, sorted(moves.folded)
    return hash_content(ground, machine, moves.lines, stands)


def count_entries(moves: SiteMoves) -> dict[str, int]:
    """How many entries each table of what is known has."""
    return {name: len(table) for name, table in moves.tables.items()}


def describe_entries(moves: SiteMoves, counts: Mapping[str, int]) -> Known:
    """What is known of a site beyond the first entries of each table, so many by its name; empty for nothing."""
    tables = moves.tables
    places = dict(_iter_places(tables))
    places |= {one: (DRIVEN, place) for move, one in moves.driven.items() if one and (place := places.get(move))}
    found: Known = {name: [] for name in tables}
    for name, table in tables.items():
        for key, value in islice(table.items(), counts.get(name, 0), None):
            with suppress(KeyError):  # of a move that no table has
                found[name].append([_flatten(key, places), _flatten(value)])
    return {name: entries for name, entries in found.items() if entries}


def load_entries(moves: SiteMoves, described: Sequence[Known]) -> None:
    """Let a site know what `describe_entries` gave of it; without what refers to files that are gone."""
    tables = moves.tables

    def read_place(place: Any) -> Move:
        name, key, *number = place
        found = tables[name][read_place(key) if name == DRIVEN else key]
        return found[number[0]] if isinstance(found, tuple) else found  # type: ignore[no-any-return]

    for name, table in tables.items():
        for known in described:
            with suppress(LookupError):
                for key, value in known.get(name, ()):
                    table.setdefault(_restore(key, read_place), _restore(value, read_place))


def _iter_places(tables: Mapping[str, Mapping[Any, Any]]) -> Iterator[tuple[Move, tuple[Any, ...]]]:
    """The moves that were found, with where they are."""
    for name in ("options", "cut", "folded", "searched"):
        for key, value in tables[name].items():
            found = value if isinstance(value, tuple) else (value,)
            yield from ((move, (name, key, number)) for number, move in enumerate(found) if move)


def _flatten(value: Any, places: Mapping[Move, Any] | None = None) -> Any:
    """A key or value of a table with lists for tuples and arrays, and with moves by their places if these are given."""
    if isinstance(value, Move):
        if places is not None:
            return {"place": _flatten(places[value])}
        return {each.name: _flatten(getattr(value, each.name)) for each in fields(value)}
    if isinstance(value, tuple):
        return [_flatten(one, places) for one in value]
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
