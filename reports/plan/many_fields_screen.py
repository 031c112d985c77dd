"""The first screen of many fields for a terminal: what all come to, a row per field and width, and what has no plan."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import PurePath

from rich.console import Group, RenderableType
from rich.text import Text

from reports.common.language import translate, translate_count
from reports.common.text_tables import AnswerLines, FittedTable, TableColumn, format_sentence
from reports.common.units import (
    convert_hectares,
    convert_rate_per_hectare,
    format_hectares,
    format_width,
    get_area_unit,
    get_length_unit,
    is_us,
)
from reports.common.wording import LEAST_COST, NO_VALUE, format_duration, format_number, format_percent, format_price
from reports.plan.many_fields import (
    REQUESTED_KEY,
    FieldRecord,
    FieldsTotal,
    get_best_plan,
    get_stated_plan_cost,
    get_stated_plan_s,
    list_records_without_plan,
    list_shortfalls,
    sum_over_fields,
)

MOST_ROWS = 9


def build_many_fields_screen(records: Sequence[FieldRecord], *, with_next: bool = True) -> RenderableType:
    """What the fields come to at each width, the plan of every field, and what to type next."""
    faults = [
        *list_shortfalls(records),
        *(
            sentence.replace(record[REQUESTED_KEY], PurePath(record[REQUESTED_KEY]).name, 1)
            for record in records
            for sentence in list_records_without_plan([record])
        ),
    ]
    parts: list[RenderableType] = [AnswerLines(tuple(list_many_sentences(records)), (), tuple(faults)), Text("")]
    parts.append(_build_table(records[:MOST_ROWS]))
    parts.append(format_sentence(_write_legend(records), style="dim"))
    hidden = len(records) - MOST_ROWS
    if hidden > 0:
        text = translate_count("{count} more row: --explain.", "{count} more rows: --explain.", hidden)
        parts.append(format_sentence(text, style="dim"))
    if with_next:
        text = translate("Add --explain (and why), --html fields.html (maps), --csv (every plan).")
        parts.append(format_sentence(text, style="dim"))
    return Group(*parts)


def list_many_sentences(records: Sequence[FieldRecord]) -> list[str]:
    """What the fields that have a plan come to, a sentence for every width, and how many have none."""
    fields = len({record[REQUESTED_KEY] for record in records})
    is_assumed = any(record["ranking"] and record["ranking"].get("prices_assumed") for record in records)
    totals = sum_over_fields(records)
    sentences = [_describe_total(total, fields, _find_currency(records), is_assumed) for total in totals]
    lacking = sum(bool(record["ranking"] and record["ranking"].get("shortfalls")) for record in records)
    if lacking:
        text = translate_count("{count} plan is no recommendation.", "{count} plans are no recommendation.", lacking)
        sentences.insert(0, text)
    return sentences or [translate_count("No plan works on {count} field.", "No plan works on {count} fields.", fields)]


def _describe_total(total: FieldsTotal, fields: int, currency: str, is_assumed: bool) -> str:
    """``3 m: 4 of 5 fields, 12.30 ha, in 6:12:03 one after the other, 412 EUR (33 EUR/ha), 98.4 % worked.``"""
    cost = f"{format_price(total.paid_cost)} {currency}".strip()
    if is_assumed:
        cost = translate("{money} (assumed prices)", money=cost)
    if total.risked_cost >= LEAST_COST:
        risked = f"{format_price(total.risked_cost)} {currency}".strip()
        cost = translate("{paid} paid and {risked} at risk", paid=cost, risked=risked)
    return translate(
        "{width}: {count} of {fields} fields, {area}, {time} one after the other, {cost} ({rate}), {worked} % worked.",
        width=format_width(total.width_m),
        count=total.fields,
        fields=fields,
        area=format_hectares(total.area_ha),
        time=format_duration(total.time_s),
        cost=cost,
        rate=f"{format_price(convert_rate_per_hectare(total.cost_per_ha))} {currency}".strip() + f"/{get_area_unit()}",
        worked=format_number(total.worked_pct, 1),
    )


def _find_currency(records: Sequence[FieldRecord]) -> str:
    return next((one["ranking"]["currency"] for one in records if one["ranking"] and one["ranking"]["currency"]), "")


def _build_table(records: Sequence[FieldRecord]) -> FittedTable:
    """At most seven columns; the width only where there are several."""
    has_widths = len({record["width_m"] for record in records}) > 1
    has_probability = any((get_best_plan(record) or {}).get("finish_probability") is not None for record in records)
    last = TableColumn(translate("Worked %"), translate("Work\n%"), drop_order=2)
    if has_probability:
        last = TableColumn(translate("In time %"), translate("In\ntime %"), drop_order=2)
    columns = [
        TableColumn(translate("Field"), is_text=True, is_unbroken=True),
        TableColumn(_name_width()) if has_widths else TableColumn(get_area_unit(), drop_order=4),
        TableColumn(translate("Tractors"), translate("Trac-\ntors")),
        TableColumn(translate("Strategy"), is_text=True, is_unbroken=True, drop_order=3),
        TableColumn(translate("Time")),
        TableColumn(translate("Cost {currency}", currency=_find_currency(records)).strip(), drop_order=1),
        last,
    ]
    rows = tuple(_build_row(record, has_widths, has_probability) for record in records)
    return FittedTable(tuple(columns), rows, more_hint=translate("--explain shows more"))


def _name_width() -> str:
    """The heading of widths; metres are not said."""
    return translate("Width {unit}", unit=get_length_unit()) if is_us() else translate("Width")


def _build_row(record: FieldRecord, has_widths: bool, has_probability: bool) -> tuple[str, ...]:
    ranking, plan = record["ranking"], get_best_plan(record)
    name = ranking["field"]["name"] if ranking else PurePath(record[REQUESTED_KEY]).name
    area = format_number(convert_hectares(ranking["field"]["area_ha"]), 2) if ranking else NO_VALUE
    size = format_width(record["width_m"]).partition(" ")[0] if has_widths else area
    if plan is None:
        return name, size, NO_VALUE, translate("no plan"), NO_VALUE, NO_VALUE, NO_VALUE
    share = format_percent(plan.get("finish_probability")) if has_probability else format_number(plan["worked_pct"], 1)
    return (
        name,
        size,
        str(plan["tractors"]),
        plan["strategy"],
        format_duration(get_stated_plan_s(plan)),
        format_price(get_stated_plan_cost(plan)),
        share,
    )


def _write_legend(records: Sequence[FieldRecord]) -> str:
    if any((get_best_plan(record) or {}).get("p50_s") is not None for record in records):
        return translate("The recommended plan of each field; times are medians, costs means of the samples.")
    return translate("The recommended plan of each field; times and costs are as simulated.")
