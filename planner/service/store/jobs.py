"""The table of jobs as a queue: asked for, claimed by one worker at a time, reported on, finished once."""

from __future__ import annotations

import secrets
import time
from collections.abc import Mapping, Sequence
from typing import Any

import sqlalchemy as sa

from planner.service.errors import BusyError, MissingError, TakenError
from planner.service.store.base import Part, checked_name, is_text, now
from planner.service.store.models import Job, Result

QUEUED, RUNNING, DONE, FAILED, CANCELLED = "queued", "running", "done", "failed", "cancelled"
OPEN = (QUEUED, RUNNING)
MOST_LISTED = 500
MOST_WORDS = 200

Made = tuple[str, bytes, str]
"""What a job made: the name of a file, its bytes, its media type."""


class Jobs(Part):
    """The jobs."""

    def add_job(
        self,
        kind: str,
        name: str,
        request: Mapping[str, Any],
        inputs: Mapping[str, str] | None = None,
        work: Mapping[str, Any] | None = None,
    ) -> Job:
        """Put work in the queue, what was asked for and (where it differs) as it is worked on.

        Raises BusyError where too much waits.
        """
        row = Job(
            id=secrets.token_hex(6), kind=kind, name=checked_name(name), status=QUEUED, request=dict(request),
            work=dict(request if work is None else work), inputs=dict(inputs or {}), created=now(), done=0, all=0,
            words="", tries=0, results=[],
        )  # fmt: skip
        with self.database.writes() as session:
            waiting = session.scalar(sa.select(sa.func.count()).where(Job.status == QUEUED)) or 0
            if waiting >= self.settings.jobs_waiting:
                raise BusyError(f"{waiting} jobs are waiting; cancel some, or ask again when they are done.")
            session.add(row)
        return row

    def job(self, id: str, kind: str | None = None) -> Job:
        """One job; raises MissingError."""
        with self.database.reads() as session:
            row = session.scalar(sa.select(Job).where(Job.id == id, *_of(kind))) if is_text(id) else None
        if row is None:
            raise MissingError(f"There is no {kind or 'job'} {id[:60]!r}; the list shows all.", parameter="id")
        return row

    def jobs(self, kind: str | None = None) -> list[Job]:
        """Jobs of a kind or all, the newest first."""
        wanted = sa.select(Job).where(*_of(kind)).order_by(Job.number.desc()).limit(MOST_LISTED)
        with self.database.reads() as session:
            return list(session.scalars(wanted))

    def result(self, id: str, name: str, kind: str | None = None) -> Result:
        """One file that a job made; raises MissingError."""
        found = next((each for each in self.job(id, kind).results if each.name == name), None)
        if found is None:
            raise MissingError(f"The job {id!r} has no result {name!r}; it names those it has.", parameter="name")
        return found

    def cancel_job(self, id: str, kind: str | None = None) -> Job:
        """End a job that is not done; its worker stops within a moment. Raises MissingError, TakenError."""
        there = self.job(id, kind)
        ended = sa.update(Job).where(Job.number == there.number, Job.status.in_(OPEN))
        with self.database.writes() as session:
            done = session.execute(ended.values(status=CANCELLED, finished=now(), worker=None, lease=None))
        row = self.job(id, kind)
        if not done.rowcount:  # type: ignore[attr-defined]
            raise TakenError(f"The job {id!r} is {row.status}; only one that is queued or running can be cancelled.")
        return row

    def delete_job(self, id: str, kind: str | None = None) -> None:
        """Forget a job and its results; raises MissingError, or TakenError while it runs."""
        row = self.job(id, kind)
        if row.status == RUNNING:
            raise TakenError(f"The job {id!r} is running; cancel it first.")
        with self.database.writes() as session:
            session.execute(sa.delete(Job).where(Job.id == id, Job.status != RUNNING))

    def claim_job(self, worker: str) -> Job | None:
        """Take the job that is next for a worker, None where none waits.

        What was begun before comes after what was not, so that one job that takes its worker with it holds up nothing.
        """
        if not self._waiting():
            return None
        first = sa.select(Job.number).where(Job.status == QUEUED).order_by(Job.tries, Job.number).limit(1)
        first = first.with_for_update(skip_locked=True)
        taken = sa.update(Job).where(Job.number == first.scalar_subquery(), Job.status == QUEUED)
        values = {"status": RUNNING, "worker": worker, "lease": self._until(), "done": 0, "all": 0, "words": ""}
        with self.database.writes() as session:
            number = session.scalar(taken.values(**values, tries=Job.tries + 1).returning(Job.number))
            return None if number is None else session.get(Job, number)

    def _waiting(self) -> bool:
        with self.database.reads() as session:
            return session.scalar(sa.select(Job.number).where(Job.status == QUEUED).limit(1)) is not None

    def _until(self) -> float:
        return time.time() + self.settings.lease_s

    def report_job(self, number: int, worker: str, progress: tuple[int, int, str] | None = None) -> bool:
        """Hold a job for longer, and say how far it is; False where it is this worker's no more."""
        values: dict[str, Any] = {"lease": self._until()}
        if progress is not None:
            values |= {"done": progress[0], "all": progress[1], "words": progress[2][:MOST_WORDS]}
        with self.database.writes() as session:
            held = session.execute(_held(number, worker).values(**values))
            return bool(held.rowcount)  # type: ignore[attr-defined]

    def finish_job(self, number: int, worker: str, made: Sequence[Made]) -> bool:
        """Keep all that a job made, or nothing where it is this worker's no more."""
        kept = [(name, self.blobs.put(content), len(content), media) for name, content, media in made]
        ended = {"status": DONE, "finished": now(), "worker": None, "lease": None}
        with self.database.writes() as session:
            if not session.execute(_held(number, worker).values(**ended)).rowcount:  # type: ignore[attr-defined]
                return False
            session.execute(sa.delete(Result).where(Result.job == number))
            session.add_all(
                Result(job=number, name=name, sha256=sha256, size=size, media=media)
                for name, sha256, size, media in kept
            )
        return True

    def fail_job(self, number: int, worker: str, sentence: str) -> bool:
        """End a job with the reason; False where it is this worker's no more."""
        ended = {"status": FAILED, "error": sentence, "finished": now(), "worker": None, "lease": None}
        with self.database.writes() as session:
            held = session.execute(_held(number, worker).values(**ended))
            return bool(held.rowcount)  # type: ignore[attr-defined]

    def release_jobs(self, worker: str, *, blame: bool) -> None:
        """Put back what a worker that is gone had; with no `blame` the try is not counted."""
        back = {"status": QUEUED, "worker": None, "lease": None}
        mine = (Job.status == RUNNING, Job.worker == worker)
        with self.database.writes() as session:
            if blame:
                self._give_up(session, *mine)
            else:
                back["tries"] = Job.tries - 1  # type: ignore[assignment]
            session.execute(sa.update(Job).where(*mine).values(**back))

    def release_expired(self) -> None:
        """Put back what workers have that no more report."""
        late = (Job.status == RUNNING, Job.lease < time.time())
        with self.database.reads() as session:
            if session.scalar(sa.select(Job.number).where(*late).limit(1)) is None:
                return
        with self.database.writes() as session:
            self._give_up(session, *late)
            session.execute(sa.update(Job).where(*late).values(status=QUEUED, worker=None, lease=None))

    def _give_up(self, session: Any, *which: Any) -> None:
        """Fail those that were begun as often as they may."""
        tries = self.settings.tries
        sentence = (
            f"The process that worked on this ended {tries} times before it was done, as when memory runs out; try a "
            "smaller field or fewer tractors."
        )
        session.execute(
            sa.update(Job)
            .where(*which, Job.tries >= tries)
            .values(status=FAILED, error=sentence, finished=now(), worker=None, lease=None)
        )


def _of(kind: str | None) -> tuple[Any, ...]:
    return () if kind is None else (Job.kind == kind,)


def _held(number: int, worker: str) -> Any:
    return sa.update(Job).where(Job.number == number, Job.worker == worker, Job.status == RUNNING)
