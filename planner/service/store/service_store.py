"""The store of the service, made of its parts."""

from __future__ import annotations

from contextlib import closing

from planner.service.settings import ServiceSettings
from planner.service.store.database import migrate_database
from planner.service.store.file_table import FileStore
from planner.service.store.fleet_table import FleetStore
from planner.service.store.job_queue import JobStore
from planner.service.store.store_part import format_utc_now_ms
from planner.service.store.tables import WriteCheckRow
from planner.service.store.token_table import TokenStore


class Store(TokenStore, FileStore, JobStore, FleetStore):
    """All stored data; every method may be called from any thread and any process.

    An older database is brought up to date. Raises DatabaseError where it cannot be reached, is newer than this
    software or belongs to another program.
    """

    def __init__(self, settings: ServiceSettings) -> None:
        super().__init__(settings)
        try:
            migrate_database(self.database.engine)
            self.database.keep_to_file()
        except BaseException:
            self.close()
            raise

    def check_write(self) -> None:
        """Write something. Raises SQLAlchemyError, StorageError where nothing can be written."""
        with self.database.open_write_session() as session:
            session.merge(WriteCheckRow(id=1, time=format_utc_now_ms()))

    def close(self) -> None:
        """Close the database."""
        self.database.close()


def open_store(settings: ServiceSettings) -> closing[Store]:
    """A store that is closed at the end of a `with` statement."""
    return closing(Store(settings))
