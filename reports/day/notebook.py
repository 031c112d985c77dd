"""A day of several fields in a notebook: in short, as a fragment, as a table and drawn."""

from __future__ import annotations

from typing import TYPE_CHECKING

from reports.common.drawing_sizes import PAGE_INCHES
from reports.common.notebook import ResultView, ShownTable, build_view, encode_figure, render_fragment
from reports.common.rendering import EXPORT_DECIMALS, make_json_safe
from reports.day.answer import list_day_sentences
from reports.day.page import draw_gantt, draw_machine_day, render_day_page
from reports.day.schedule_results import DayResult
from reports.day.tables import (
    build_job_entry,
    build_job_table,
    describe_optimality_gap,
    format_day_csv,
    format_day_json,
    sort_by_field,
)
from reports.plan.map_figure import render_png
from reports.plan.ranking_export import flatten_entry

if TYPE_CHECKING:
    from pandas import DataFrame

MOST_JOBS = 30  # in a fragment; to_pandas has all
DAY_INCHES = (PAGE_INCHES, 4.0)


@build_view.register
def build_day_view(day: DayResult) -> ResultView:
    """A day: its answer, work over time, and the jobs."""
    return ResultView(
        summary=lambda: " ".join(list_day_sentences(day)),
        html=lambda: render_day_fragment(day),
        table=lambda: build_jobs_frame(day),
        draw=lambda axes: draw_machine_day(axes, day),
        figure_inches=DAY_INCHES,
        files={
            ".json": lambda: format_day_json(day),
            ".csv": lambda: format_day_csv(day),
            ".html": lambda: render_day_page(day),
            ".png": lambda: render_png(draw_gantt(day)),
        },
    )


def render_day_fragment(day: DayResult) -> str:
    """The answer, work over time, the jobs in the order of the fields, and what is not done."""
    jobs = sort_by_field(day)
    left_out = f"{len(jobs) - MOST_JOBS} more fields; to_pandas() has all." if len(jobs) > MOST_JOBS else ""
    tables = [build_job_table(jobs[:MOST_JOBS]).convert_for_notebook(note=left_out)]
    if day.unworked_fields:
        rows = [(one.field, one.reason) for one in day.unworked_fields]
        tables.append(ShownTable(("Not done", "Why"), rows, frozenset({0, 1})))
    first, *others = list_day_sentences(day)
    sentences = [*others, describe_optimality_gap(day), *day.remarks]
    return render_fragment(first, sentences, tables, encode_figure(draw_gantt(day)), "Work of the day over time")


def build_jobs_frame(day: DayResult) -> DataFrame:
    """A row per job with the values of the JSON; an interval has a column for each end."""
    import pandas as pd

    entries = [flatten_entry(make_json_safe(build_job_entry(job), EXPORT_DECIMALS)) for job in day.jobs]
    return pd.DataFrame(entries)
