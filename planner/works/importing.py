"""From files of machines to runs, their figures, and the files that are written of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from planner.works.files import about_text, csv_text, stems
from planner.works.metres import driven
from planner.works.reading import read_runs
from planner.works.record import Driven
from planner.works.summary import remarks, summary
from reports.work_results import RunTold


@dataclass(frozen=True)
class Imported:
    """Runs with their figures, the text of every file by its name, and sentences on what could not be read."""

    runs: tuple[RunTold, ...]
    files: dict[str, str]
    notes: tuple[str, ...]


def imported(
    paths: Sequence[str], mapping: str | None = None, progress: Callable[[int, int], None] | None = None
) -> Imported:
    """All runs of files, folders and archives; raises FieldError, LogError where one has none that can be read."""
    runs: list[Driven] = []
    sources: list[str] = []
    notes: list[str] = []
    for number, path in enumerate(paths):
        found = read_runs(path, mapping)
        notes += found.notes
        runs += [driven(run) for run in found.runs]
        sources += [Path(path).name] * len(found.runs)
        if progress is not None:
            progress(number + 1, len(paths))
    told, files = [], {}
    for run, stem, source in zip(runs, stems(runs), sources, strict=True):
        figures = summary(run)
        odd = tuple(remarks(run, figures))
        files[f"{stem}.csv"] = csv_text(run)
        files[f"{stem}.json"] = about_text(run, source, figures, odd)
        told.append(RunTold(run.name, run.form, run.start, run.field, f"{stem}.csv", figures, odd))
    return Imported(tuple(told), files, tuple(notes))
