"""A day as one page that asks for nothing outside itself: advice, pictures, tables by machine and by field."""

from __future__ import annotations

from typing import Any

from reports.day_figures import gantt_figure, map_figure
from reports.day_results import DayResult
from reports.day_table import FIELD_COLUMNS, at, by_field, field_row, gap_words, legend, machine_rows, money_rows
from reports.figures import to_data
from reports.template import rendered
from reports.wording import number, percent, price


def day_page(result: DayResult) -> str:
    """The page as HTML text."""
    words = {fleet.name: fleet.words for fleet in result.fleets}
    drawn = map_figure(result, titled=False)
    content: dict[str, Any] = {
        "title": f"A day of {len(result.fields)} fields",
        "advice": result.advice,
        "gap": gap_words(result),
        "facts": _facts(result),
        "gantt": to_data(gantt_figure(result)),
        "map": None if drawn is None else to_data(drawn),
        "machine_header": ("Machine", "Field", "From", "To", "Road km", "In time %"),
        "machines": [(f"{name} ({words[name]})" if name else "", *others) for name, *others in machine_rows(result)],
        "field_header": [column.heading for column in FIELD_COLUMNS],
        "fields": [field_row(job) for job in by_field(result)],
        "left": [(one.field, number(one.area_ha, 2), price(one.cost), one.reason) for one in result.not_done],
        "legend": legend(result),
        "remarks": [*result.remarks, f"{result.draws} draws, seed {result.seed}."],
    }
    return rendered("day.html.j2", content)


def _facts(result: DayResult) -> list[tuple[str, str]]:
    """What the day comes to, label and value."""
    ends = [job.end_s for job in result.jobs]
    sure = result.all_probability
    return [
        ("Fields done", f"{len(result.jobs)} of {len(result.fields)}"),
        ("Hectares done", number(sum(job.area_ha for job in result.jobs), 1)),
        *([("Last one done", at(max(ends)))] if ends else []),
        *([("All in time", f"{percent(sure)} %")] if sure is not None else []),
        *((f"{label}, {result.currency}", money) for label, money in money_rows(result)),
    ]
