"""Imported runs and the values learned from them: tables for the terminal, and JSON."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict

from rich.console import Group, RenderableType

from fields.units import KMH_PER_MPS
from reports.common.rendering import format_json
from reports.common.text_tables import FittedTable, TableColumn, format_sentence
from reports.common.wording import NO_VALUE, format_duration, format_number, format_percent, group_alike
from reports.task_logs.run_results import ImportedRun, LearnedOutcome

_RUN_COLUMNS = (
    TableColumn("Run", is_text=True), TableColumn("Date", is_unbroken=True),
    TableColumn("Field", is_text=True, drop_order=1), TableColumn("Time", is_unbroken=True), TableColumn("ha"),
    TableColumn("km"), TableColumn("Working (%)", "Work%"), TableColumn("Turns", drop_order=2),
    TableColumn("Stops", drop_order=3), TableColumn("Lifts", drop_order=4),
    TableColumn("Speed (km/h)", "km/h", drop_order=5), TableColumn("Fuel (l)", "l", drop_order=6),
)  # fmt: skip


def build_runs_table(runs: Sequence[ImportedRun]) -> RenderableType:
    """One row per run, a row of totals where there are several, and remarks."""
    rows = [_build_run_row(run) for run in runs]
    if len(runs) > 1:
        rows.append(_build_total_row(runs))
    return Group(FittedTable(_RUN_COLUMNS, tuple(rows)), *map(format_sentence, group_run_notes(runs)))


def _build_run_row(run: ImportedRun) -> tuple[str, ...]:
    figures = run.figures
    speed = None if figures.working_mps is None else figures.working_mps * KMH_PER_MPS
    length = None if figures.active_m is None or figures.inactive_m is None else figures.active_m + figures.inactive_m
    return (
        run.name, run.start[:10] or NO_VALUE, run.field or NO_VALUE, format_duration(figures.seconds),
        NO_VALUE if figures.area_m2 is None else format_number(figures.area_m2 / 1e4, 2),
        format_number((figures.placed_m if length is None else length) / 1e3, 2),
        format_percent(figures.share_working),
        *(format_number(count, 0) for count in (figures.turns, figures.stops, figures.lifts)),
        format_number(speed, 1), format_number(figures.fuel_l, 0),
    )  # fmt: skip


def _build_total_row(runs: Sequence[ImportedRun]) -> tuple[str, ...]:
    """The totals of all runs; speeds have none."""
    figures = [run.figures for run in runs]
    with_share = [one for one in figures if one.share_working is not None]
    fuel = [one.fuel_l for one in figures if one.fuel_l is not None]
    share = sum(one.by_kind_s["working"] for one in with_share) / max(sum(one.seconds for one in with_share), 1e-9)
    length = sum(one.placed_m if one.counted_m is None else one.counted_m for one in figures)
    return (
        f"all {len(runs)}", "", "", format_duration(sum(one.seconds for one in figures)),
        format_number(sum(one.area_m2 or 0.0 for one in figures) / 1e4, 2), format_number(length / 1e3, 2),
        format_percent(share) if with_share else NO_VALUE, str(sum(one.turns or 0 for one in figures)),
        str(sum(one.stops for one in figures)), str(sum(one.lifts or 0 for one in figures)), "",
        format_number(sum(fuel), 0) if fuel else NO_VALUE,
    )  # fmt: skip


def group_run_notes(runs: Sequence[ImportedRun]) -> Iterator[str]:
    """Remarks on the runs; a remark on several runs, figures apart, is one line with a count."""
    for members in group_alike((run, note) for run in runs for note in run.notes):
        run, note = members[0]
        if len(members) == 1:
            yield f"{run.name}: {note}."
        elif all(member_note == note for _, member_note in members):
            yield f"{len(members)} runs: {note}."
        else:
            yield f"{len(members)} runs, such as {run.name}: {note}."


def format_runs_json(runs: Sequence[ImportedRun], notes: Sequence[str]) -> str:
    """``runs`` with their figures in SI units, and ``notes`` on what could not be read, as JSON."""
    entries = []
    for run in runs:
        about = {key: value for key, value in asdict(run).items() if key not in ("figures", "notes")}
        figures = {**asdict(run.figures), "share_working": run.figures.share_working}
        entries.append({**about, **figures, "notes": list(run.notes)})
    return format_json({"runs": entries, "notes": list(notes)})


_LEARNED_COLUMNS = (
    TableColumn("Value of the farm file", "Value", is_text=True),
    TableColumn("Learned", is_unbroken=True),
    TableColumn("95 %", is_unbroken=True),
    TableColumn("In the file", is_text=True, is_unbroken=True),
)


def build_learned_table(learned: Sequence[LearnedOutcome], notes: Sequence[str]) -> RenderableType:
    """One row per value, then the origin of each, then the remarks."""
    rows = []
    for one in learned:
        value = one.value if isinstance(one.value, str) else f"{one.value:g}"
        interval = NO_VALUE if one.low is None or one.high is None else f"{one.low:g} to {one.high:g}"
        rows.append((one.key, value, interval, one.done))
    origins = (f"{one.key.rpartition('.')[2]}: {one.measured}." for one in learned)
    return Group(FittedTable(_LEARNED_COLUMNS, tuple(rows)), *map(format_sentence, (*origins, *notes)))


def format_learned_json(learned: Sequence[LearnedOutcome], notes: Sequence[str]) -> str:
    """``learned``, values with interval, origin and what was done, and ``notes``, as JSON."""
    content = {"learned": [asdict(one) for one in learned], "notes": list(notes)}
    return format_json(content)
