"""Bytes of jobs on their way through PostgreSQL: inputs to workers on other machines, results back to the service.

The folder of the service stays the place of all bytes: it lends inputs with a job, and fetches results when it is done.
Results may go by a store instead, an fsspec URL whose credentials come from the worker's own environment; the database
then holds their addresses.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cached_property
from typing import Any
from uuid import uuid4

import sqlalchemy as sa
from sqlalchemy.orm import Session

from planner.service.errors import (
    DatabaseError,
    NotFoundError,
    ResultPlaceError,
    ServiceError,
    StorageError,
    VersionError,
)
from planner.service.settings import ServiceSettings
from planner.service.store.database import (
    describe_version,
    get_current_version,
    name_database_in_errors,
    read_version,
    shorten_error,
)
from planner.service.store.disk_storage import hash_bytes
from planner.service.store.job_queue import UNFINISHED_STATUSES, JobStore, ResultFiles
from planner.service.store.tables import JobBytesRow, JobRow, WriteCheckRow

CONNECT_S, READ_S = 5, 60  # of a store that is asked: the service has other work too
_OPTIONS = {"s3": {"config_kwargs": {"connect_timeout": CONNECT_S, "read_timeout": READ_S}}}
MOST_FETCHED = 50  # at a time, so that what else is due does not wait for long


class ResultPlace:
    """A folder of a store, opened when it is used."""

    def __init__(self, address: str) -> None:
        self.address = address.rstrip("/")

    @cached_property
    def _files(self) -> Any:
        """The file system of fsspec. Raises ServiceError for an address that cannot be used."""
        scheme, mark, path = self.address.partition("://")
        try:
            import fsspec

            if not mark or not path.strip("/"):
                raise ValueError("it is no URL with a folder")
            return fsspec.filesystem(scheme, use_listings_cache=False, **_OPTIONS.get(scheme, {}))
        except Exception as error:  # libraries of stores raise anything
            raise ServiceError(
                f"Results cannot go to {self.address!r}: {_shorten(error)}; give an address such as "
                "s3://bucket/folder (--results) and install headland[s3], or what fsspec needs for another store.",
                parameter="results",
            ) from None

    def locate(self, name: str) -> str:
        """The address of what has a name here."""
        return f"{self.address}/{name}"

    def holds(self, address: str) -> bool:
        """Whether an address is of this place."""
        return address.rpartition("/")[0] == self.address

    def check(self) -> None:
        """Write something, read it and delete it. Raises ServiceError, ResultPlaceError where that does not work."""
        name = f"headland-check-{uuid4().hex}"  # processes that start together check apart
        self.put_bytes(name, b"Headland")
        with self._translate_errors():
            self._files.cat_file(self.locate(name))
        self.delete(self.locate(name))

    def put_bytes(self, name: str, content: bytes) -> None:
        """Store bytes by name. Raises ResultPlaceError."""
        files = self._files
        with self._translate_errors():
            files.auto_mkdir = True  # in a folder of this machine
            files.pipe_file(self.locate(name), content)

    def read_bytes(self, address: str) -> bytes:
        """The bytes at an address. Raises NotFoundError, ResultPlaceError."""
        files = self._files
        with self._translate_errors():
            try:
                return bytes(files.cat_file(address))
            except FileNotFoundError:
                raise NotFoundError(f"The result {address} is gone from its store; compute it again.") from None

    def delete(self, address: str) -> None:
        """Delete what is at an address. Raises ResultPlaceError."""
        files = self._files
        with self._translate_errors():
            files.rm_file(address)

    @contextmanager
    def _translate_errors(self) -> Iterator[None]:
        """Turn what a library of a store raises, which may be anything, into ResultPlaceError."""
        try:
            yield
        except NotFoundError:
            raise
        except Exception as error:
            raise ResultPlaceError(
                f"The store of results {self.address} does not answer as it should ({_shorten(error)}); see that it "
                "runs, that the bucket exists, and that the environment has credentials."
            ) from error


def check_result_place(settings: ServiceSettings) -> None:
    """Refuse results by a store that cannot be used, or where no PostgreSQL names them; raises ServiceError."""
    if settings.results and not settings.is_shared:
        raise ServiceError(
            "Results go by a store from workers on other machines, which need PostgreSQL; give its --database, or no "
            "--results.",
            parameter="results",
        )
    if settings.results:
        ResultPlace(settings.results).check()


def _shorten(error: Exception) -> str:
    return shorten_error(f"{type(error).__name__}: {error}").rstrip(".")


class CarryingJobStore(JobStore):
    """Jobs whose bytes are in the folder, or else on their way through the database."""

    def __init__(self, settings: ServiceSettings) -> None:
        super().__init__(settings)
        self.place = ResultPlace(settings.results) if settings.results else None
        if self.database.is_postgresql:
            self.blobs.read_elsewhere = self._read_carried

    def _read_carried(self, sha256: str) -> bytes | None:
        found = sa.select(JobBytesRow.content, JobBytesRow.address).where(JobBytesRow.sha256 == sha256)
        with self.database.open_read_session() as session:
            row = session.execute(found.order_by(JobBytesRow.address.is_not(None)).limit(1)).first()
        if row is None or row.address is None:
            return None if row is None else row.content
        return self._get_place(row.address).read_bytes(row.address)

    def _get_place(self, address: str) -> ResultPlace:
        """The store of an address; raises ResultPlaceError where these settings name another: a row names no file."""
        if self.place is None or not self.place.holds(address):
            folder = address.rpartition("/")[0]
            raise ResultPlaceError(
                f"The results of this job are in {folder}, which this service does not know; start it with --results "
                f"{folder}."
            )
        return self.place


class ServedJobStore(CarryingJobStore):
    """The jobs of the service, whose folder holds all bytes."""

    def lend_inputs(self, session: Session, row: JobRow) -> None:
        """Give workers on other machines the bytes of the inputs of a job."""
        if not self.database.is_postgresql:
            return
        lent = set(session.scalars(sa.select(JobBytesRow.sha256).where(JobBytesRow.job == row.number)))
        for sha256 in set(row.inputs.values()) - lent:
            with suppress(NotFoundError):  # the worker says so
                session.add(JobBytesRow(job=row.number, sha256=sha256, content=self.blobs.read_bytes(sha256)))

    def lend_all_inputs(self) -> None:
        """Lend the inputs of all unfinished jobs, those of a restored or older database too."""
        with self.database.open_write_session() as session:
            for row in session.scalars(sa.select(JobRow).where(JobRow.status.in_(UNFINISHED_STATUSES))):
                self.lend_inputs(session, row)

    def tend_queue(self) -> None:
        """Release what nobody reports, and fetch results; without room on the disk they stay where they are."""
        super().tend_queue()
        with suppress(StorageError):
            self.fetch_results()

    def fetch_results(self) -> None:
        """Bring bytes of ended jobs to the folder; the database forgets them.

        What a store does not give stays in its row: the store may be out of reach for a while.
        """
        if not self.database.is_postgresql:
            return
        rows = sa.select(JobBytesRow.job, JobBytesRow.sha256, JobBytesRow.address).join(JobRow)
        ended = rows.where(JobRow.status.not_in(UNFINISHED_STATUSES)).order_by(JobBytesRow.address.is_not(None))
        with self.database.open_read_session() as session:
            found = session.execute(ended).all()
        fetched, silent = 0, set[str]()
        for job, sha256, address in found:
            place = "" if address is None else address.rpartition("/")[0]
            if place in silent:
                continue
            if fetched == MOST_FETCHED:
                break
            try:
                self.blobs.put_bytes(self.blobs.read_bytes(sha256))
            except ResultPlaceError:
                silent.add(place)
                continue
            except NotFoundError:  # a row without an address was deleted meanwhile
                if address is not None:
                    continue
            fetched += 1
            if address is not None:
                with suppress(ResultPlaceError):
                    self._get_place(address).delete(address)
            with self.database.open_write_session() as session:
                session.execute(sa.delete(JobBytesRow).where(JobBytesRow.job == job, JobBytesRow.sha256 == sha256))


class RemoteStore(CarryingJobStore):
    """The jobs of a service as a worker on another machine sees them: all bytes come and go by the database.

    Raises DatabaseError where the database cannot be used, VersionError where the service is of another version.
    """

    def __init__(self, settings: ServiceSettings) -> None:
        super().__init__(settings)
        try:
            if not self.database.is_postgresql:
                raise DatabaseError(
                    "A worker takes jobs from PostgreSQL; give the --database of the service, such as "
                    "postgresql://user@host/name.",
                    parameter="database",
                )
            with name_database_in_errors(self.database.engine):  # it may be restarted just then
                with self.database.engine.connect() as connection:
                    tables = read_version(connection)
                if tables is None:
                    raise DatabaseError(
                        "The database has no tables of Headland yet; begin headland serve with it first.",
                        parameter="database",
                    )
                if tables != get_current_version():
                    raise _build_version_error(f"one with tables {tables}")
                self.check_version()
        except BaseException:
            self.close()
            raise

    def check_version(self) -> None:
        """Raise VersionError where the service is of another version; one that never ran is of any."""
        with self.database.open_read_session() as session:
            version = session.scalar(sa.select(WriteCheckRow.version))
        if version not in (None, describe_version()):
            raise _build_version_error(version)

    def claim_job(self, worker: str) -> JobRow | None:
        """Claim the next job for a worker; None where none waits or the service is of another version."""
        try:
            self.check_version()
        except VersionError:
            return None  # whoever watches the worker ends it
        return super().claim_job(worker)

    def keep_results(self, number: int, files: ResultFiles) -> None:
        """Nothing is kept here; a store gets the bytes. Raises ResultPlaceError."""
        if self.place is not None:
            for sha256, content in _name_by_hash(files).items():
                self.place.put_bytes(_name_result(number, sha256), content)

    def send_results(self, session: Session, number: int, files: ResultFiles) -> None:
        """Send results along with the end of the job; inputs may be among them."""
        session.execute(sa.delete(JobBytesRow).where(JobBytesRow.job == number))
        for sha256, content in _name_by_hash(files).items():
            row = JobBytesRow(job=number, sha256=sha256, content=content)
            if self.place is not None:
                row.content, row.address = b"", self.place.locate(_name_result(number, sha256))
            session.add(row)


def _name_by_hash(files: ResultFiles) -> ResultFiles:
    """The same bytes by SHA-256, each once."""
    return {hash_bytes(content): content for content in files.values()}


def _name_result(number: int, sha256: str) -> str:
    """The name in a store: that of the job is in it, as it is deleted for this job alone."""
    return f"{number}-{sha256}"


def _build_version_error(of_service: str) -> VersionError:
    return VersionError(
        f"This worker is Headland {describe_version()}, and the service is {of_service}; install the same version here."
    )
