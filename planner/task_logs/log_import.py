"""Import of task logs in any format: runs, their figures, and the files written of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from fields.formats.archive import list_names
from fields.text_files import quote_path
from planner.task_logs.formats import agopengps_paths, csv_logs, isoxml_logs, point_shapefiles
from planner.task_logs.formats.log_format import LogFormat
from planner.task_logs.runs.phases import find_run_inconsistencies, summarise_run
from planner.task_logs.runs.run_files import choose_file_stems, format_log_csv, format_metadata
from planner.task_logs.runs.run_records import LogContents, ProjectedRun, project_run
from reports.task_logs.run_results import ImportedRun
from vehicle.identification.errors import LogError

TASK_LOG_FORMATS: tuple[LogFormat, ...] = (
    isoxml_logs.LOG_FORMAT,
    point_shapefiles.LOG_FORMAT,
    agopengps_paths.LOG_FORMAT,
    csv_logs.LOG_FORMAT,
)


def detect_log_format(path: str) -> LogFormat:
    """The format of a file, folder or archive, by its content or else its extension; raises FieldError, LogError."""
    location = Path(path)
    names = list_names(path)
    if names:
        detected = next((form for form in TASK_LOG_FORMATS if form.holds(names)), None)
    else:
        ending = location.suffix.lower()
        detected = next((form for form in TASK_LOG_FORMATS if ending in form.extensions), None)
        if not location.exists():
            raise LogError(f"There is no file or folder {quote_path(path)}; check its name.")
    if detected is None:
        raise LogError(
            f"{quote_path(path)} contains no task log; give an ISOXML folder (TASKDATA), a Shapefile of points, an "
            "AgOpenGPS folder or a CSV file."
        )
    return detected


def read_task_logs(path: str, mapping: str | None = None) -> LogContents:
    """The runs of a file, folder or archive in its order; `mapping` is a file that describes the columns of a CSV file.

    Raises FieldError or LogError if nothing can be read or the mapping is not usable.
    """
    form = detect_log_format(path)
    if mapping is not None and form is not csv_logs.LOG_FORMAT:
        raise LogError(f"A mapping is for CSV files, but {quote_path(path)} is {form.name}; leave it out.")
    contents = form.read(path, quote_path(path)) if mapping is None else csv_logs.read_csv_log(path, mapping)
    if not contents.runs:
        reason = f" ({contents.notes[0].rstrip('.')})" if contents.notes else ""
        raise LogError(f"{quote_path(path)} has no readable run{reason}; copy the folder again.")
    return contents


@dataclass(frozen=True)
class ImportedRuns:
    """Runs with their figures, texts of files by name, and sentences on what could not be read."""

    runs: tuple[ImportedRun, ...]
    files: dict[str, str]
    notes: tuple[str, ...]


def import_runs(
    paths: Sequence[str], mapping: str | None = None, progress: Callable[[int, int], None] | None = None
) -> ImportedRuns:
    """All runs of files, folders and archives; raises FieldError or LogError if one of them has no readable run."""
    runs: list[ProjectedRun] = []
    sources: list[str] = []
    notes: list[str] = []
    for number, path in enumerate(paths):
        contents = read_task_logs(path, mapping)
        notes += contents.notes
        runs += [project_run(run) for run in contents.runs]
        sources += [Path(path).name] * len(contents.runs)
        if progress is not None:
            progress(number + 1, len(paths))
    summaries, files = [], {}
    for run, stem, source in zip(runs, choose_file_stems(runs), sources, strict=True):
        figures = summarise_run(run)
        run_remarks = tuple(find_run_inconsistencies(run, figures))
        files[f"{stem}.csv"] = format_log_csv(run)
        files[f"{stem}.json"] = format_metadata(run, source, figures, run_remarks)
        summaries.append(
            ImportedRun(run.name, run.log_format, run.start, run.field, f"{stem}.csv", figures, run_remarks)
        )
    return ImportedRuns(tuple(summaries), files, tuple(notes))
