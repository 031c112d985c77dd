"""The moves of sites on disk, from run to run: a field is often planned more than once."""

from __future__ import annotations

import secrets
from contextlib import suppress
from dataclasses import dataclass, fields

from planner.evaluation.context import PlanningContext
from planner.pipeline.fingerprint import hash_content
from planner.pipeline.result_cache import ResultCache
from strategies.programmes.cached_moves import count_entries, describe_entries, load_entries
from strategies.programmes.site_moves import SiteMoves

DRIVES = "drive", "drive_level"  # of a site: functions of the tractor, its implement, heights and load
MOST_BYTES = 100_000_000


@dataclass(frozen=True)
class MoveCache:
    """Files by the hash of a site, its lines, what drives there and the code: each with what one process found."""

    results: ResultCache

    def load(self, context: PlanningContext, moves: SiteMoves) -> None:
        """Let moves of a context know what is stored of them."""
        with suppress(LookupError, TypeError, ValueError):  # a file that somebody changed
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
