"""The whole store."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from planner.service.settings import Settings
from planner.service.store.database import migrate
from planner.service.store.files import Files
from planner.service.store.fleets import Fleets
from planner.service.store.jobs import Jobs
from planner.service.store.tokens import Tokens


class Store(Tokens, Files, Jobs, Fleets):
    """All that is kept; every method may be called from any thread and any process.

    Raises DatabaseError where the database cannot be reached, is newer than this software or is somebody else's; one
    that is older is brought up to date.
    """

    def __init__(self, settings: Settings) -> None:
        super().__init__(settings)
        try:
            migrate(self.database.engine)
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Let go of the database."""
        self.database.close()


@contextmanager
def opened(settings: Settings) -> Iterator[Store]:
    """A store for as long as the body takes."""
    store = Store(settings)
    try:
        yield store
    finally:
        store.close()
