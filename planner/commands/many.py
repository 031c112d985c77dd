"""`headland plan` of many fields or widths: one table."""

from __future__ import annotations

import json as jsons
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

if TYPE_CHECKING:
    from planner.asked import Asked
    from planner.many import Answer, Question
    from planner.many.kept import Record
    from planner.scenario import Scenario


@dataclass(frozen=True)
class Wanted:
    """Fields and widths to plan; `many` where they are or stand for more than one."""

    fields: tuple[str, ...]
    widths_m: tuple[float, ...]
    many: bool


@dataclass(frozen=True)
class Hands:
    """Who does the work: so many processes of this machine, or a cluster; raises ScenarioError for neither."""

    processes: int | None
    cluster: str | None

    def __post_init__(self) -> None:
        from planner.errors import ScenarioError

        if self.processes is not None and self.processes < 1:
            raise ScenarioError(f"--processes is {self.processes}; use 1 or more.")
        if self.processes is not None and self.cluster is not None:
            raise ScenarioError("--processes is for this machine and --cluster for others; leave out one of them.")

    def executor(self, tasks: int) -> AbstractContextManager[Executor]:
        """The executor for so many tasks."""
        from planner.pool import local_pool

        if self.cluster is None:
            return local_pool(tasks, self.processes)
        from planner.many.cluster import cluster

        return cluster(self.cluster)


def asking(names: Sequence[str], width: str, local: bool) -> Wanted:
    """What names with stars and widths with commas stand for; raises HeadlandError."""
    from planner.many.wanted import fields_of
    from planner.scenario import parse_widths

    fields, widths_m = fields_of(names, local=local), parse_widths(width)
    return Wanted(fields, widths_m, len(widths_m) > 1 or fields != (names[0],))


def plan_many(
    wanted: Wanted, scenario: Scenario, ask: Callable[[Scenario], Asked], hands: Hands, keep: Path | None, json: bool,
    csv: bool, every: bool,
) -> bool:  # fmt: skip
    """Print one table of every field at every width; whether each has a plan that meets what was asked."""
    from planner.commands.outputs import check_outputs
    from planner.commands.show import progress_bar, warm_up
    from planner.many import Question
    from planner.many.digest import question_digest

    questions = [
        Question(ask(replace(scenario, field=field, width_m=width_m)), every)
        for field in wanted.fields
        for width_m in wanted.widths_m
    ]
    keys = [question_digest(question.asked, every) for question in questions]
    check_outputs((keep, ".jsonl"), reads={name.rpartition("#")[0] or name: "a field" for name in wanted.fields})
    warm_up()
    with progress_bar("Planning fields") as progress, _printer(json, csv) as show:
        records = _records(questions, keys, hands, keep, progress, show)
    return all(_met(record) for record in records)


def _records(
    questions: Sequence[Question], keys: Sequence[str], hands: Hands, keep: Path | None,
    progress: Callable[[int, int], None], show: Callable[[Record], None],
) -> list[Record]:  # fmt: skip
    """Answers as records in the order of the questions, each shown as soon as all before it are."""
    from planner.many import answers
    from planner.many.kept import Keeper, read_kept

    kept = {} if keep is None else read_kept(keep)
    done = {index: kept[key] for index, key in enumerate(keys) if key in kept}
    left = [index for index in range(len(questions)) if index not in done]
    keeper, shown = Keeper(keep), 0
    keeper.begin(kept.values())
    try:
        with hands.executor(len(left)) as executor:
            found = answers(executor, [questions[index] for index in left])
            while True:
                progress(len(done), len(questions))
                while shown in done:
                    show(done[shown])
                    shown += 1
                place, answer = next(found, (None, None))
                if place is None or answer is None:
                    break
                index = left[place]
                done[index] = _record(keys[index], questions[index], answer)
                keeper.keep(done[index])
    except BaseException as error:
        if keep is not None:
            error.add_note(f"{len(done)} of {len(questions)} answers are in {keep}, nothing else was written")
        raise
    mine = set(keys)
    keeper.end([*(one for key, one in kept.items() if key not in mine), *(done[index] for index in sorted(done))])
    return [done[index] for index in range(len(questions))]


def _record(key: str, question: Question, answer: Answer) -> Record:
    """An answer as it is kept: plain values alone."""
    from planner.commands.options import option_of
    from planner.many.kept import KEY
    from reports.export import ranking_json

    refusal, ranking = answer.refusal, answer.ranking
    record: dict[str, Any] = {
        KEY: key,
        "asked": question.field,
        "width_m": question.asked.scenario.width_m,
        "refused": None if refusal is None else refusal.spoken(option_of),
        "ranking": None if ranking is None else jsons.loads(ranking_json(ranking)),
    }
    return record


def _met(record: Record) -> bool:
    """Whether there is a plan, in time where that was asked."""
    best = record["ranking"] and record["ranking"]["best"]
    return bool(best) and best["meets_deadline"] is not False and record["ranking"]["unmet"] is None


@contextmanager
def _printer(json: bool, csv: bool) -> Iterator[Callable[[Record], None]]:
    """A function that prints a record: CSV at once, all else when the last is known."""
    from planner.commands.show import out
    from reports.many import csv_head, csv_rows, many_json, many_table

    records: list[Record] = []

    def row(record: Record) -> None:
        typer.echo(csv_rows(record), nl=False)
        sys.stdout.flush()

    if csv:
        typer.echo(csv_head(), nl=False)
    yield row if csv else records.append
    if json:
        typer.echo(many_json(records), nl=False)
    elif not csv:
        out(many_table(records))
