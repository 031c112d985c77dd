"""Many fields in one table: the best plan of each on a terminal, all plans as CSV and JSON.

A record holds the answer for one field at one width: `requested_field` (its name as given), `width_m`, `refusal` (a
sentence, or None) and `ranking` (read back from `reports.plan.ranking_export.format_ranking_json`, or None).
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import PurePath
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from reports.common.rendering import make_json_safe
from reports.common.text_tables import FittedTable, TableColumn, format_sentence
from reports.common.wording import NO_VALUE, format_duration, format_number, format_percent, format_price
from reports.plan.ranking_export import CSV_KEYS, EXPORT_DECIMALS, PLAN_KEYS, flatten_entry, format_csv_cell

FieldRecord = Mapping[str, Any]
REQUESTED_KEY = "requested_field"
_FILE_KEYS = ("key", "sum")  # of the checkpoint file only


def format_many_csv_head() -> str:
    """The heading of the CSV: keys of a plan, of the request, and the name of the field as given."""
    return _format_csv([(*flatten_entry(dict.fromkeys(PLAN_KEYS)), *CSV_KEYS, REQUESTED_KEY)])


def format_many_csv_rows(record: FieldRecord) -> str:
    """A row for each plan of a field, or one row with the reason where the field was refused."""
    ranking = record["ranking"]
    empty_plan = dict.fromkeys(PLAN_KEYS) | {"feasible": False, "reason": record["refusal"]}
    plans = [{key: plan.get(key) for key in PLAN_KEYS} for plan in (ranking["plans"] if ranking else [empty_plan])]
    request_values = ranking["scenario"] if ranking else {"width_m": record["width_m"]}
    request_cells = [format_csv_cell(make_json_safe(request_values.get(key), EXPORT_DECIMALS)) for key in CSV_KEYS]
    return _format_csv(
        [*map(format_csv_cell, flatten_entry(plan).values()), *request_cells, record[REQUESTED_KEY]] for plan in plans
    )


def _format_csv(rows: Iterable[Sequence[Any]]) -> str:
    buffer = io.StringIO()
    csv.writer(buffer, lineterminator="\n").writerows(rows)
    return buffer.getvalue()


def format_many_fields_json(records: Sequence[FieldRecord]) -> str:
    """``fields``: records without their key and check sum, in the order of the request."""
    shown = [{key: value for key, value in record.items() if key not in _FILE_KEYS} for record in records]
    return json.dumps({"fields": shown}, indent=2, ensure_ascii=False) + "\n"


def build_many_fields_table(records: Sequence[FieldRecord]) -> RenderableType:
    """The best plan of every field at every width, and which fields have none and why."""
    has_probability = any((_get_best_plan(record) or {}).get("finish_probability") is not None for record in records)
    column_count = len(_MANY_COLUMNS) - (not has_probability)
    rows = tuple(_build_field_plan_row(record)[:column_count] for record in records)
    parts: list[RenderableType] = [FittedTable(_MANY_COLUMNS[:column_count], rows)]
    legend = "The best plan of each field. Times are h:mm:ss; headland in metres, bearing in degrees from north."
    parts += [format_sentence(text, style="dim") for text in (legend, *_describe_costs(records))]
    without = [record for record in records if not _get_best_plan(record)]
    if without:
        parts += [Text(""), Text(f"Without a plan: {len(without)} of {len(records)}", style="bold underline")]
        parts += [
            format_sentence(f"{record[REQUESTED_KEY]} at {record['width_m']:g} m: {_explain_missing_plan(record)}")
            for record in without
        ]
    return Group(*parts)


def _describe_costs(records: Sequence[FieldRecord]) -> list[str]:
    """What the costs are, where there are samples or a currency."""
    best = [plan for record in records if (plan := _get_best_plan(record))]
    units = sorted({record["ranking"].get("currency") or "" for record in records if record["ranking"]} - {""})
    has_samples = any(plan.get("expected_cost") is not None for plan in best)
    cost_kind = "expected (mean of the samples, with losses on late ground)" if has_samples else "as simulated"
    return [f"Cost: {cost_kind}{f', in {units[0]}' if len(units) == 1 else ''}."] if has_samples or units else []


_MANY_COLUMNS = (
    TableColumn("Field", is_text=True),
    TableColumn("ha"),
    TableColumn("Width"),
    TableColumn("Headland", "Head-\nland", drop_order=4),
    TableColumn("Bearing", "Bea-\nring", drop_order=3),
    TableColumn("Strategy", is_text=True, is_unbroken=True),
    TableColumn("Tractors", "Trac-\ntors"),
    TableColumn("Time"),
    TableColumn("Worked %", "Work\n%", drop_order=2),
    TableColumn("Cost", drop_order=1),
    TableColumn("In time %", "In\ntime %", drop_order=5),
)


def _get_best_plan(record: FieldRecord) -> Mapping[str, Any] | None:
    ranking = record["ranking"]
    best: Mapping[str, Any] | None = ranking["best"] if ranking else None
    return best


def _explain_missing_plan(record: FieldRecord) -> str:
    """Why a field has no plan, in a sentence."""
    if record["refusal"]:
        return str(record["refusal"])
    reasons = [plan["reason"] for plan in record["ranking"]["plans"] if plan["reason"]]
    return f"no plan is feasible; the first of {len(reasons)} reasons: {reasons[0]}."


def _build_field_plan_row(record: FieldRecord) -> tuple[str, ...]:
    best, ranking = _get_best_plan(record), record["ranking"]
    name = ranking["field"]["name"] if ranking else PurePath(record[REQUESTED_KEY]).name
    request_values = ranking["scenario"] if ranking else {}
    plan: Mapping[str, Any] = best or {}
    return (
        name,
        format_number(ranking["field"]["area_ha"], 2) if ranking else NO_VALUE,
        f"{record['width_m']:g}",
        format_number(request_values.get("headland_m"), 1),
        format_number(request_values.get("bearing_deg"), 0),
        plan.get("strategy", "none"),
        str(plan.get("tractors", NO_VALUE)),
        format_duration(plan.get("time_s")),
        format_number(plan.get("worked_pct"), 1),
        format_price(plan.get("cost") if plan.get("expected_cost") is None else plan["expected_cost"]),
        format_percent(plan.get("finish_probability")),
    )
