"""The queue of jobs: its users take turns, and each job is claimed by one worker at a time and finished once.

Inputs go to workers on other machines, and results back to the service, through PostgreSQL; results may go by a store
instead, the database then holds their addresses.
"""

from __future__ import annotations

import secrets
import time
from collections.abc import Mapping
from contextlib import suppress
from pathlib import PurePosixPath
from typing import Any, Literal, get_args

import sqlalchemy as sa
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.orm import Session

from planner.fleet.session.frame_timing import format_utc
from planner.service.errors import (
    BusyError,
    ConflictError,
    DatabaseError,
    NotFoundError,
    ResultPlaceError,
    StorageError,
    VersionError,
)
from planner.service.settings import LIMITS, ServiceSettings
from planner.service.store.carried_bytes import ResultPlace
from planner.service.store.database import (
    describe_version,
    get_current_version,
    name_database_in_errors,
    read_version,
)
from planner.service.store.disk_storage import hash_bytes
from planner.service.store.store_part import (
    StorePart,
    check_name,
    choose_copy_name,
    find_media,
    is_found,
    is_storable_text,
)
from planner.service.store.tables import JobBytesRow, JobRow, Owner, ResultRow, TurnRow, WriteCheckRow

JobStatus = Literal["queued", "running", "done", "failed", "cancelled"]
QUEUED, RUNNING, DONE, FAILED, CANCELLED = JOB_STATUSES = get_args(JobStatus)
UNFINISHED_STATUSES = (QUEUED, RUNNING)
LONGEST_PROGRESS_CHARS = 200
MOST_FETCHED = 50  # at a time, so that what else is due does not wait for long

ResultFiles = Mapping[str, bytes]
"""The results of a job by file name, whose ending gives the media type."""


class JobStore(StorePart):
    """Jobs and their results, whose bytes are in the folder, or else on their way through the database.

    The folder of the service stays the place of all bytes: it lends inputs to workers on other machines with a job, and
    fetches results when it is done.
    """

    def __init__(self, settings: ServiceSettings) -> None:
        super().__init__(settings)
        self.place = ResultPlace(settings.results) if settings.results else None
        if self.database.is_postgresql:
            self.blobs.read_elsewhere = self._read_carried

    def add_job(
        self,
        kind: str,
        name: str,
        request: Mapping[str, Any],
        inputs: Mapping[str, str] | None = None,
        work: Mapping[str, Any] | None = None,
        owner: Owner | None = None,
    ) -> JobRow:
        """Queue a job: its request, and `work`, the same as the worker takes it where that differs.

        Raises BusyError where too many of the owner's jobs wait.
        """
        row = JobRow(
            id=secrets.token_hex(6), kind=kind, name=check_name(name), created=format_utc(),
            request=dict(request), work=dict(request if work is None else work), inputs=dict(inputs or {}),
            status=QUEUED, done=0, all=0, words="", tries=0, results=[],
        )  # fmt: skip
        row.owner, row.owner_identity = owner or (None, None)
        with self.database.open_write_session() as session:
            own = (JobRow.status == QUEUED, JobRow.owner_identity == row.owner_identity)
            waiting = session.scalar(sa.select(sa.func.count()).where(*own)) or 0
            if waiting >= self.settings.jobs_waiting:
                raise BusyError(f"{waiting} jobs of yours are waiting; cancel some, or ask again when they are done.")
            session.add(row)
            session.flush()
            self.lend_inputs(session, row)
        return row

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

    def rename_job(self, id: str, kind: str, name: str) -> JobRow:
        """Give a job another name; raises NotFoundError, ServiceError."""
        row = self.get_job(id, kind)
        self.database.change_rows(sa.update(JobRow).where(JobRow.number == row.number).values(name=check_name(name)))
        return self.get_job(id, kind)

    def copy_job(self, id: str, kind: str, name: str | None = None, owner: Owner | None = None) -> JobRow:
        """Copy a job that has ended, with its results; raises NotFoundError, or ConflictError for a job under way."""
        source = self.get_job(id, kind)
        if source.status in UNFINISHED_STATUSES:
            raise ConflictError(f"The job {id!r} is {source.status}; copy it when it has ended.")
        kept = ("kind", "status", "request", "work", "inputs", "done", "all", "words", "error", "finished")
        row = JobRow(
            **{each: getattr(source, each) for each in kept},
            id=secrets.token_hex(6),
            name=check_name(name or choose_copy_name(source.name)),
            created=format_utc(),
            results=[
                ResultRow(name=each.name, sha256=each.sha256, size=each.size, media=each.media)
                for each in source.results
            ],
        )
        row.owner, row.owner_identity = owner or (None, None)
        with self.database.open_write_session() as session:
            session.add(row)
        return row

    def get_job(self, id: str, kind: str | None = None) -> JobRow:
        """One job; raises NotFoundError."""
        query = sa.select(JobRow).where(JobRow.id == id, *_build_kind_filter(kind))
        row = self.database.find_row(query) if is_storable_text(id) else None
        if row is None:
            raise NotFoundError(f"There is no {kind or 'job'} {id[:60]!r}; the list shows all.", parameter="id")
        return row

    def list_jobs(self, kind: str | None = None, search: str = "") -> list[JobRow]:
        """Jobs of a kind or all whose names have every word of the search, the newest first."""
        filters = _build_kind_filter(kind)
        with self.database.open_read_session() as session:
            if search.strip():
                names = session.execute(sa.select(JobRow.number, JobRow.name).where(*filters).order_by(JobRow.number))
                numbers = [number for number, name in names if is_found(name, search)]
                filters = (JobRow.number.in_(numbers[-LIMITS.most_listed_jobs :]),)
            query = sa.select(JobRow).where(*filters).order_by(JobRow.number.desc()).limit(LIMITS.most_listed_jobs)
            return list(session.scalars(query))

    def count_jobs(self) -> dict[str, int]:
        """Number of jobs by status."""
        with self.database.open_read_session() as session:
            rows = session.execute(sa.select(JobRow.status, sa.func.count()).group_by(JobRow.status))
            return {status: int(count) for status, count in rows}

    def get_result(self, id: str, name: str, kind: str | None = None) -> ResultRow:
        """One result of a job; raises NotFoundError."""
        result = next((each for each in self.get_job(id, kind).results if each.name == name), None)
        if result is None:
            raise NotFoundError(f"The job {id!r} has no result {name!r}; it names those it has.", parameter="name")
        return result

    def read_result(self, id: str, name: str, kind: str) -> bytes:
        """The bytes of one result of a job; raises NotFoundError."""
        return self.blobs.read_bytes(self.get_result(id, name, kind).sha256)

    def cancel_job(self, id: str, kind: str | None = None) -> JobRow:
        """Cancel a job that is not done; its worker stops soon. Raises NotFoundError, ConflictError."""
        job = self.get_job(id, kind)
        ended = sa.update(JobRow).where(JobRow.number == job.number, JobRow.status.in_(UNFINISHED_STATUSES))
        has_ended = self.database.change_rows(ended.values(_build_end_values(CANCELLED)))
        row = self.get_job(id, kind)
        if not has_ended:
            raise ConflictError(f"The job {id!r} is {row.status}; only one that is queued or running can be cancelled.")
        return row

    def delete_job(self, id: str, kind: str | None = None) -> None:
        """Delete a job and its results; the worker of a running one stops soon. Raises NotFoundError."""
        self.database.change_rows(sa.delete(JobRow).where(JobRow.number == self.get_job(id, kind).number))

    def claim_job(self, worker: str) -> JobRow | None:
        """Claim the next job for a worker; None where none waits.

        Owners take turns: nobody waits while two jobs of another are begun. Of one owner, what was begun before comes
        after what was not, so that one job that takes its worker with it holds up nothing.
        """
        if self.database.find_row(sa.select(JobRow.number).where(JobRow.status == QUEUED).limit(1)) is None:
            return None
        first = _select_next_job().scalar_subquery()
        claim = sa.update(JobRow).where(JobRow.number == first, JobRow.status == QUEUED)
        values = {"status": RUNNING, "worker": worker, "lease": self._now_s + self.settings.lease_s}
        values |= {"done": 0, "all": 0, "words": "", "tries": JobRow.tries + 1}
        with self.database.open_write_session() as session:
            number = session.scalar(claim.values(**values).returning(JobRow.number))
            job = None if number is None else session.get(JobRow, number)
            if job is not None:
                last = session.scalar(sa.select(sa.func.max(TurnRow.turn))) or 0
                insert = postgresql.insert if self.database.is_postgresql else sqlite.insert
                turn = insert(TurnRow).values(owner_identity=(job.owner_identity or ""), turn=last + 1)
                session.execute(turn.on_conflict_do_update(index_elements=["owner_identity"], set_={"turn": last + 1}))
            return job

    @property
    def _now_s(self) -> Any:
        """Seconds since 1970: those of PostgreSQL, as clocks of machines differ."""
        if self.database.is_postgresql:
            return sa.cast(sa.extract("epoch", sa.func.clock_timestamp()), sa.Float)
        return time.time()

    def report_job(self, number: int, worker: str, progress: tuple[int, int, str] | None = None) -> bool:
        """Renew the lease of a job and store its progress; False where the worker has lost the job."""
        values: dict[str, Any] = {"lease": self._now_s + self.settings.lease_s}
        if progress is not None:
            values |= {"done": progress[0], "all": progress[1], "words": progress[2][:LONGEST_PROGRESS_CHARS]}
        return bool(self.database.change_rows(_update_claimed_job(number, worker, values)))

    def finish_job(self, number: int, worker: str, files: ResultFiles) -> bool:
        """Name all results of a job, whose bytes are kept; none, and False, where the worker has lost the job."""
        with self.database.open_write_session() as session:
            if not self.database.execute_change(session, _update_claimed_job(number, worker, _build_end_values(DONE))):
                return False
            session.execute(sa.delete(ResultRow).where(ResultRow.job == number))
            for name, content in files.items():
                sha256, media = hash_bytes(content), find_media(PurePosixPath(name).suffix)
                session.add(ResultRow(job=number, name=name, sha256=sha256, size=len(content), media=media))
            self.send_results(session, number, files)
        return True

    def keep_results(self, number: int, files: ResultFiles) -> None:
        """Keep the bytes of results before they are named. Raises StorageError where there is no room."""
        for content in files.values():
            self.blobs.put_bytes(content)

    def send_results(self, session: Session, number: int, files: ResultFiles) -> None:
        """Where the service cannot read what this keeps: send it the bytes of results."""

    def fail_job(self, number: int, worker: str, sentence: str) -> bool:
        """Fail a job with a sentence; False where the worker has lost the job."""
        values = _build_end_values(FAILED) | {"error": sentence}
        return bool(self.database.change_rows(_update_claimed_job(number, worker, values)))

    def release_jobs(self, worker: str, *, counts_try: bool) -> None:
        """Put the jobs of a worker that is gone back into the queue; without `counts_try` the try is not counted."""
        self._release_running(JobRow.worker == worker, counts_try=counts_try)

    def renew_leases(self) -> None:
        """Renew the lease of every running job.

        For use after a time without writes: living workers report now, and jobs of dead ones are released later.
        """
        lease_end_s = self._now_s + self.settings.lease_s
        self.database.change_rows(sa.update(JobRow).where(JobRow.status == RUNNING).values(lease=lease_end_s))

    def tend_queue(self) -> None:
        """Release what nobody reports, and fetch results; without room on the disk they stay where they are."""
        self.release_expired()
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

    def release_expired(self) -> None:
        """Put jobs with an expired lease back into the queue."""
        is_late = JobRow.lease < self._now_s
        if self.database.find_row(sa.select(JobRow.number).where(JobRow.status == RUNNING, is_late).limit(1)):
            self._release_running(is_late, counts_try=True)

    def _release_running(self, condition: sa.ColumnElement[bool], *, counts_try: bool) -> None:
        """Put running jobs back into the queue, or fail those that have used up their tries."""
        tries, running = self.settings.tries, sa.update(JobRow).where(JobRow.status == RUNNING, condition)
        sentence = (
            f"The worker process ended {tries} times before this job was done, probably for lack of memory; try a "
            "smaller field or fewer tractors."
        )
        released: dict[str, Any] = {"status": QUEUED, "worker": None, "lease": None}
        with self.database.open_write_session() as session:
            if counts_try:
                failed = running.where(JobRow.tries >= tries)
                session.execute(failed.values(_build_end_values(FAILED) | {"error": sentence}))
            else:
                released["tries"] = JobRow.tries - 1
            session.execute(running.values(**released))


class RemoteStore(JobStore):
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
        version = self.database.find_row(sa.select(WriteCheckRow.version))
        if version not in (None, describe_version()):
            raise _build_version_error(version)

    def tend_queue(self) -> None:
        """Release what nobody reports; results are fetched by the service."""
        self.release_expired()

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


def _select_next_job() -> sa.Select[Any]:
    """The number of the next job, locked: the first of the owner whose last turn is the longest ago.

    Who claims at the same moment skips it, and takes the first of the next owner before the second of this one.
    """
    owner = sa.func.coalesce(JobRow.owner_identity, "")
    order = (JobRow.tries, JobRow.number)
    place = sa.func.row_number().over(partition_by=owner, order_by=order)
    waiting = sa.select(JobRow.number, owner.label("owner"), place.label("place")).where(JobRow.status == QUEUED)
    queue = waiting.subquery()
    return (
        sa.select(JobRow.number)
        .join(queue, queue.c.number == JobRow.number)
        .outerjoin(TurnRow, TurnRow.owner_identity == queue.c.owner)
        .where(JobRow.status == QUEUED)
        .order_by(queue.c.place, sa.func.coalesce(TurnRow.turn, 0), *order)
        .limit(1)
        .with_for_update(of=JobRow, skip_locked=True)
    )


def _build_kind_filter(kind: str | None) -> tuple[Any, ...]:
    return () if kind is None else (JobRow.kind == kind,)


def _build_end_values(status: str) -> dict[str, Any]:
    """The columns of a job that ends now."""
    return {"status": status, "finished": format_utc(), "worker": None, "lease": None}


def _update_claimed_job(number: int, worker: str, values: Mapping[str, Any]) -> sa.Update:
    """The change of columns of a job; of no row where the worker does not hold it."""
    held = sa.update(JobRow).where(JobRow.number == number, JobRow.worker == worker, JobRow.status == RUNNING)
    return held.values(**values)


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
