"""Many fields in one table: the best plan of each on a terminal, all plans as CSV and JSON.

A record holds the answer for one field at one width: `requested_field` (its name as given), `width_m`, `refusal` (a
sentence, or None) and `ranking` (read back from `reports.plan.ranking_export.format_ranking_json`, or None).
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import PurePath
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from reports.common.language import translate, translate_sentence
from reports.common.rendering import make_json_safe
from reports.common.text_tables import FittedTable, TableColumn, format_sentence, format_title
from reports.common.units import format_width
from reports.common.wording import NO_VALUE, format_duration, format_number, format_percent, format_price
from reports.plan.ranking_export import EXPORT_DECIMALS, build_csv_row, format_csv, list_csv_columns

FieldRecord = Mapping[str, Any]
REQUESTED_KEY = "requested_field"
MAP_KEY = "map"  # a small map of the best plan, for the page
_FILE_KEYS = ("key", "sum", MAP_KEY)  # of the checkpoint file and the page only


def format_many_csv_head() -> str:
    """The heading of the CSV: the columns of plans, with the name of the field as given after its own."""
    return format_csv([_insert_requested(list_csv_columns(), REQUESTED_KEY)])


def format_many_csv_rows(record: FieldRecord) -> str:
    """A row for each plan of a field, or one row with the reason where the field was refused."""
    ranking, columns = record["ranking"], list_csv_columns()
    plans = ranking["plans"] if ranking else [{"feasible": False, "reason": record["refusal"]}]
    request_values = (
        {**ranking["scenario"], "area_ha": ranking["field"]["area_ha"]} if ranking else {"width_m": record["width_m"]}
    )
    rows = (build_csv_row(plan, request_values, columns) for plan in plans)
    return format_csv(_insert_requested(row, record[REQUESTED_KEY]) for row in rows)


def _insert_requested(row: list[Any], value: str) -> list[Any]:
    """A row with the name of the field as given in the second place."""
    return [row[0], value, *row[1:]]


def format_many_fields_json(records: Sequence[FieldRecord]) -> str:
    """``fields``: records without key, check sum and map, in the order of the request; ``totals``: one per width."""
    shown = [{key: value for key, value in record.items() if key not in _FILE_KEYS} for record in records]
    totals = [
        {**asdict(one), "cost_per_ha": one.cost_per_ha, "risked_cost": one.risked_cost}
        for one in sum_over_fields(records)
    ]
    content = {"fields": shown, "totals": make_json_safe(totals, EXPORT_DECIMALS)}
    return json.dumps(content, indent=2, ensure_ascii=False) + "\n"


def build_many_fields_table(records: Sequence[FieldRecord]) -> RenderableType:
    """The best plan of every field at every width with totals, and which fields have none and why."""
    table = tabulate_records(records)
    styles = tuple("bold" if row in table.total_rows else "" for row in table.rows)
    parts: list[RenderableType] = [FittedTable(table.columns, table.rows, styles)]
    parts += [format_sentence(text, style="dim") for text in describe_records(records)]
    lacking = list_shortfalls(records)
    if lacking:
        parts += [Text(""), format_title("Without a recommendation"), *map(format_sentence, lacking)]
    without = list_records_without_plan(records)
    if without:
        parts += [
            Text(""),
            format_title(translate("Without a plan: {count} of {all}", count=len(without), all=len(records))),
        ]
        parts += [format_sentence(sentence) for sentence in without]
    return Group(*parts)


@dataclass(frozen=True)
class RecordsTable:
    """Columns and rows of the best plans: one for every record, then one of totals for every width (`total_rows`)."""

    columns: tuple[TableColumn, ...]
    rows: tuple[tuple[str, ...], ...]
    total_rows: tuple[tuple[str, ...], ...]


def tabulate_records(records: Sequence[FieldRecord]) -> RecordsTable:
    """The best plan of every record, with totals where there are several fields."""
    has_probability = any((get_best_plan(record) or {}).get("finish_probability") is not None for record in records)
    column_count = len(_MANY_COLUMNS) - (not has_probability)
    totals = sum_over_fields(records)
    total_rows = tuple(_build_totals_row(one)[:column_count] for one in totals if one.fields > 1)
    rows = tuple(_build_field_plan_row(record)[:column_count] for record in records)
    return RecordsTable(_MANY_COLUMNS[:column_count], rows + total_rows, total_rows)


def describe_records(records: Sequence[FieldRecord]) -> list[str]:
    """What the table holds."""
    legend = "The best plan of each field. Times are h:mm:ss; headland in metres, bearing in degrees from north."
    has_totals = any(one.fields > 1 for one in sum_over_fields(records))
    totals = ["Total: hectares, times one after the other, worked share and cost of the fields that have a plan."]
    return [legend, *(totals if has_totals else []), *_describe_costs(records)]


def list_records_without_plan(records: Sequence[FieldRecord]) -> list[str]:
    """A sentence for every field at a width that has no plan."""
    return [
        translate(
            "{field} at {width}: {reason}",
            field=record[REQUESTED_KEY],
            width=format_width(record["width_m"]),
            reason=_explain_missing_plan(record),
        )
        for record in records
        if not get_best_plan(record)
    ]


def list_shortfalls(records: Sequence[FieldRecord]) -> list[str]:
    """A sentence for every field at a width whose best plan is no recommendation."""
    return [
        translate(
            "{field} at {width}: {reason}",
            field=record["ranking"]["field"]["name"],
            width=format_width(record["width_m"]),
            reason=translate_sentence(one["sentence"]),
        )
        for record in records
        for one in (record["ranking"] or {}).get("shortfalls", ())
    ]


@dataclass(frozen=True)
class FieldsTotal:
    """Sums over the fields that have a plan at one width: hectares, seconds, cost as stated, square metres.

    `paid_cost` is what is paid of the cost; the rest is expected loss on late ground.
    """

    width_m: float
    fields: int
    area_ha: float
    time_s: float
    cost: float
    missed_m2: float
    over_finished_m2: float
    paid_cost: float

    @property
    def risked_cost(self) -> float:
        """Expected loss on late ground, which nobody pays."""
        return self.cost - self.paid_cost

    @property
    def worked_pct(self) -> float:
        """Share of the ground that is worked, percent."""
        return 100.0 - 0.01 * self.missed_m2 / self.area_ha

    @property
    def cost_per_ha(self) -> float:
        """Cost of a hectare of field."""
        return self.cost / self.area_ha


def sum_over_fields(records: Sequence[FieldRecord]) -> list[FieldsTotal]:
    """One total for every width with a plan, in the order of the request."""
    totals = []
    for width_m in dict.fromkeys(record["width_m"] for record in records):
        some = [record for record in records if record["width_m"] == width_m and get_best_plan(record)]
        if some:
            totals.append(_sum_records(width_m, some))
    return totals


def _sum_records(width_m: float, records: Sequence[FieldRecord]) -> FieldsTotal:
    plans = [plan for record in records if (plan := get_best_plan(record))]

    def sum_key(key: str) -> float:
        return math.fsum(plan.get(key) or 0.0 for plan in plans)

    return FieldsTotal(
        width_m=width_m,
        fields=len(records),
        area_ha=math.fsum(record["ranking"]["field"]["area_ha"] for record in records),
        time_s=math.fsum(get_stated_plan_s(plan) or 0.0 for plan in plans),
        cost=math.fsum(get_stated_plan_cost(plan) or 0.0 for plan in plans),
        missed_m2=sum_key("missed_m2"),
        over_finished_m2=sum_key("over_finished_m2"),
        paid_cost=math.fsum(_get_paid_cost(plan) for plan in plans),
    )


def _describe_costs(records: Sequence[FieldRecord]) -> list[str]:
    """What the costs are, where there are samples or a currency."""
    best = [plan for record in records if (plan := get_best_plan(record))]
    units = sorted({record["ranking"].get("currency") or "" for record in records if record["ranking"]} - {""})
    has_samples = any(plan.get("expected_cost") is not None for plan in best)
    unit = ", ".join(units)
    if has_samples:
        return [translate("Cost {unit}: mean of the samples, with losses on late ground.", unit=unit)]
    return [translate("Cost {unit}: as simulated.", unit=unit)] if units else []


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


def get_best_plan(record: FieldRecord) -> Mapping[str, Any] | None:
    """The best plan of a record; None where there is none."""
    ranking = record["ranking"]
    best: Mapping[str, Any] | None = ranking["best"] if ranking else None
    return best


def get_stated_plan_s(plan: Mapping[str, Any]) -> float | None:
    """The end of field work that every report states, seconds after the start; all the time of an older answer."""
    seconds: float | None = plan.get("stated_end_s", plan.get("p50_s") or plan.get("time_s"))
    return seconds


def get_stated_plan_cost(plan: Mapping[str, Any]) -> float | None:
    """The cost that every report states: the expected one, and where there are no samples as simulated."""
    cost: float | None = plan.get("cost") if plan.get("expected_cost") is None else plan["expected_cost"]
    return cost


def _get_paid_cost(plan: Mapping[str, Any]) -> float:
    """What is paid of the stated cost: all of it without samples."""
    paid: float | None = plan.get("paid_cost")
    return (get_stated_plan_cost(plan) or 0.0) if paid is None else paid


def _build_totals_row(total: FieldsTotal) -> tuple[str, ...]:
    return (
        translate("Total"),
        format_number(total.area_ha, 2),
        f"{total.width_m:g}",
        "",
        "",
        "",
        "",
        format_duration(total.time_s),
        format_number(total.worked_pct, 1),
        format_price(total.cost),
        "",
    )


def _explain_missing_plan(record: FieldRecord) -> str:
    """Why a field has no plan, in a sentence."""
    if record["refusal"]:
        return translate_sentence(str(record["refusal"]))
    reasons = [plan["reason"] for plan in record["ranking"]["plans"] if plan["reason"]]
    return translate(
        "no plan is feasible; the first of {count} reasons: {reason}.",
        count=len(reasons),
        reason=translate_sentence(reasons[0]),
    )


def _build_field_plan_row(record: FieldRecord) -> tuple[str, ...]:
    best, ranking = get_best_plan(record), record["ranking"]
    name = ranking["field"]["name"] if ranking else PurePath(record[REQUESTED_KEY]).name
    request_values = ranking["scenario"] if ranking else {}
    plan: Mapping[str, Any] = best or {}
    return (
        name,
        format_number(ranking["field"]["area_ha"], 2) if ranking else NO_VALUE,
        f"{record['width_m']:g}",
        format_number(request_values.get("headland_m"), 1),
        format_number(request_values.get("bearing_deg"), 0),
        plan.get("strategy") or translate("none"),
        str(plan.get("tractors", NO_VALUE)),
        format_duration(get_stated_plan_s(plan)),
        format_number(plan.get("worked_pct"), 1),
        format_price(get_stated_plan_cost(plan)),
        format_percent(plan.get("finish_probability")),
    )
