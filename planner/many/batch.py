"""Questions answered one after the other on any executor; one that cannot be answered does not end the rest."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor
from dataclasses import dataclass

from planner.asked import Asked
from planner.errors import HeadlandError, WorkerError
from planner.planning import plan
from planner.pool import SerialExecutor, completed
from planner.tasks import LOST
from reports.results import Ranking


@dataclass(frozen=True, eq=False)
class Question:
    """A field and what is asked about it; with `every` plans that cannot win are simulated too."""

    asked: Asked
    every: bool = False

    @property
    def field(self) -> str:
        """The field, as it was named."""
        return self.asked.scenario.field


@dataclass(frozen=True, eq=False)
class Answer:
    """The ranking of a field's plans, or the refusal that came instead."""

    ranking: Ranking | None
    refusal: HeadlandError | None = None


def answered(question: Question) -> Answer:
    """One question, by itself, in the process that it is asked in."""
    asked = question.asked
    try:
        planned = plan(
            asked.scenario, tractor=asked.tractor, implement=asked.implement, chances=asked.chances,
            terms=asked.terms, supply=asked.supply, times=asked.times, yard=asked.yard, executor=SerialExecutor(),
            every=question.every,
        )  # fmt: skip
    except HeadlandError as refusal:
        return Answer(None, refusal)
    return Answer(planned.ranking)


def answers(executor: Executor, questions: Sequence[Question]) -> Iterator[tuple[int, Answer]]:
    """(index, answer) of every question as they are done. Raises WorkerError where processes are lost for good.

    A whole question is one task: on a cluster one field is planned by one worker, and another takes it over when
    that worker is gone.
    """
    try:
        yield from completed(executor, answered, [(question,) for question in questions])
    except BrokenExecutor:
        raise WorkerError(LOST) from None
