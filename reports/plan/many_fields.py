"""Many fields in one table: first screen, the best plan of each field, all plans as CSV and JSON, and the page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import zip_longest
from pathlib import PurePath
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from reports.common.language import translate, translate_count, translate_sentence
from reports.common.plan_results import PlanRanking, PlanResult
from reports.common.rendering import EXPORT_DECIMALS, format_csv, format_json, pick_values, render_template
from reports.common.text_tables import (
    AnswerLines,
    FittedTable,
    TableColumn,
    build_table,
    format_sentence,
    format_title,
)
from reports.common.wording import (
    FIELD_AREA,
    HEADLAND_ORDERS,
    LENGTH,
    NO_VALUE,
    capitalize_first,
    format_assumed_money,
    format_duration,
    format_money,
    format_money_per_area,
    format_number,
    format_price,
    format_risked_money,
    format_width,
    insert_non_breaking_spaces,
    is_us,
    join_list,
)
from reports.plan.answer import Answer, describe_limit, write_answer
from reports.plan.comparison import Comparison, ComparisonRow, ComparisonTotals
from reports.plan.figures import (
    FIGURES,
    Figure,
    build_ranking_entry,
    fit_to_ranking,
    list_csv_columns,
    list_csv_entries,
)
from reports.plan.other_plans import name_plan
from reports.plan.plan_wording import describe_defaults
from reports.plan.shortfall_wording import list_shortfall_sentences

MOST_ROWS = 9  # of the first screen
PLAN_CELLS = ("stated_end_s", "stated_cost", "worked_pct", "missed_m2", "over_finished_m2")
MAX_PLANS = 10  # of one field; the others are in CSV and JSON
PAGE_HEADINGS = ("Field", "Time", "Cost", "In time %", "Worked %", "Width", "Tractors", "Strategy", "ha")
"""Columns in the order of the page, on which those to the right may be hidden; the layout is in CSV and JSON."""
_PLAN_DROPS = {
    "strategy": 0, "tractors": 0, "stated_end_s": 0, "worked_pct": 2, "stated_cost": 1, "finish_probability": 5,
}  # fmt: skip
"""Figures of the best plans, each with the order in which it is dropped."""


def format_many_csv_head() -> str:
    """The heading of the CSV: the columns of plans, with the name of the field as given after its own."""
    return _format_csv([])


def format_many_csv_rows(record: ComparisonRow) -> str:
    """A row for each plan of a field, or one row with the reason where the field was refused."""
    ranking = record.ranking
    if ranking is None:
        entries = [{"feasible": False, "reason": record.refusal, "width_m": record.way.width_m}]
    else:
        entries = list_csv_entries(ranking, ranking.scenario.get("field"))
    table = _format_csv([{**entry, "requested_field": record.requested_field} for entry in entries])
    return table.partition("\n")[2]


def _format_csv(entries: Sequence[Mapping[str, Any]]) -> str:
    """Plans below their heading."""
    first, *others = list_csv_columns()
    return format_csv([first, "requested_field", *others], entries)


def format_many_fields_json(records: Sequence[ComparisonRow]) -> str:
    """``fields``: the records without maps, in the order of the request; ``totals``: one per width."""
    shown = [
        {"requested_field": record.requested_field, "width_m": record.way.width_m, "refusal": record.refusal,
         "ranking": None if record.ranking is None else build_ranking_entry(record.ranking)}
        for record in records
    ]  # fmt: skip
    totals = [
        {"width_m": one.way.width_m, "fields": len(one.driven), "area_ha": one.area_ha, "time_s": one.end_s,
         **pick_values(one, ("cost", "missed_m2", "over_finished_m2", "paid_cost")),
         "cost_per_ha": one.cost / one.area_ha, "risked_cost": one.risked_cost}
        for one in sum_over_fields(records)
    ]  # fmt: skip
    return format_json({"fields": shown, "totals": totals}, EXPORT_DECIMALS, is_ascii=False)


def sum_over_fields(records: Sequence[ComparisonRow]) -> list[ComparisonTotals]:
    """One total for every width with a plan, in the order of the request."""
    return [total for total in Comparison(tuple(records)).sum_over_fields() if total.driven]


def tabulate_records(records: Sequence[ComparisonRow]) -> FittedTable:
    """The best plan of every record, then in bold the totals of every width where there are several fields."""
    keys = [key for key in _PLAN_DROPS if key != "finish_probability" or has_probability(records)]
    figures = _fit_figures(records, keys)
    columns = (
        TableColumn("Field", is_text=True), TableColumn("ha"), TableColumn("Width"),
        TableColumn("Headland", "Head-\nland", drop_order=4), TableColumn("Bearing", "Bea-\nring", drop_order=3),
        *(figure.build_column(_PLAN_DROPS[figure.key]) for figure in figures),
    )  # fmt: skip
    rows = []
    for record in records:
        ranking, best = record.ranking, record.best
        scenario = {} if ranking is None else ranking.scenario
        cells = [NO_VALUE if best is None else figure.format(best) for figure in _fit_figures([record], keys)]
        cells[0] = translate("none") if best is None else cells[0]
        area = NO_VALUE if ranking is None else format_number(ranking.area_ha, 2)
        headland, bearing = format_number(scenario.get("headland_m"), 1), format_number(scenario.get("bearing_deg"), 0)
        rows.append((record.field_name, area, f"{record.way.width_m:g}", headland, bearing, *cells))
    total_rows = tuple(
        (translate("Total"), format_number(one.area_ha, 2), f"{one.way.width_m:g}", "", "", "", "",
         format_duration(one.end_s), format_number(one.worked_pct, 1), format_price(one.cost), "")[: len(columns)]
        for one in sum_over_fields(records)
        if len(one.driven) > 1
    )  # fmt: skip
    return FittedTable(columns, (*rows, *total_rows), ("",) * len(rows) + ("bold",) * len(total_rows))


def has_probability(records: Sequence[ComparisonRow]) -> bool:
    """Whether it is known of a best plan how sure it is to be done in time."""
    return any(record.best is not None and record.best.finish_probability is not None for record in records)


def build_many_fields_table(records: Sequence[ComparisonRow]) -> RenderableType:
    """The best plan of every field at every width with totals, and which fields have none and why."""
    notes = (*describe_records(records), *describe_plans(records))
    parts: list[RenderableType] = [replace(tabulate_records(records), notes=notes)]
    lacking, without = list_shortfalls(records), list_records_without_plan(records)
    if lacking:
        parts += [Text(""), format_title("Without a recommendation"), *map(format_sentence, lacking)]
    if remarks := list_remarks(records):
        parts += [Text(""), format_title("Remarks"), *map(format_sentence, remarks)]
    if without:
        title = translate(
            "Without a plan: {count} of {all}", count=sum(record.best is None for record in records), all=len(records)
        )
        parts += [Text(""), format_title(title), *map(format_sentence, without)]
    return Group(*parts)


def describe_records(records: Sequence[ComparisonRow]) -> list[str]:
    """What the table holds, and what its costs are where there are samples or a currency."""
    sentences = ["The best plan of each field. Times are h:mm:ss; headland in metres, bearing in degrees from north."]
    if any(len(one.driven) > 1 for one in sum_over_fields(records)):
        sentences.append(
            "Total: hectares, times one after the other, worked share and cost of the fields that have a plan."
        )
    currencies = sorted({record.ranking.currency or "" for record in records if record.ranking is not None} - {""})
    unit = ", ".join(currencies)
    if any(record.best is not None and record.best.expected_cost is not None for record in records):
        sentences.append(translate("Cost {unit}: mean of the samples, with losses on late ground.", unit=unit))
    elif unit:
        sentences.append(translate("Cost {unit}: as simulated.", unit=unit))
    return sentences


def list_records_without_plan(records: Sequence[ComparisonRow], *, names_file: bool = True) -> list[str]:
    """A sentence for every field that has no plan at one or more widths, named as requested, or without its folder."""
    widths: dict[tuple[str, str], list[str]] = {}
    for record in records:
        if record.best is None:
            reason = translate_sentence(record.reason or "")
            widths.setdefault((record.requested_field, reason), []).append(format_width(record.way.width_m))
    return [
        _describe_field(field if names_file else PurePath(field).name, join_list(each), reason)
        for (field, reason), each in widths.items()
    ]


def list_shortfalls(records: Sequence[ComparisonRow]) -> list[str]:
    """A sentence for every field at a width whose best plan is no recommendation."""
    return [
        _describe_field(record.field_name, format_width(record.way.width_m), sentence)
        for record in records
        if record.ranking is not None and record.best is not None
        for sentence in list_shortfall_sentences(record.ranking)
    ]


def list_remarks(records: Sequence[ComparisonRow]) -> list[str]:
    """What is said of single plans beside their figures, each once: with its field, unless it is said of several."""
    labels: dict[str, list[tuple[str, str]]] = {}
    for record in records:
        answer = Answer() if record.ranking is None else write_answer(record.ranking)
        for text in filter(None, (answer.day, answer.question, *answer.faults, answer.ground)):
            labels.setdefault(text, []).append((record.field_name, format_width(record.way.width_m)))
    return [text if len(some) > 1 else _describe_field(*some[0], text) for text, some in labels.items()]


def describe_plans(records: Sequence[ComparisonRow]) -> list[str]:
    """What is planned alike for all fields: start, limit, order of the headland, defaults."""
    rankings = [record.ranking for record in records if record.ranking is not None and record.best is not None]
    orders = {record.best.headland_order or "" for record in records if record.best is not None}
    starts, limits = {ranking.start or "" for ranking in rankings}, {describe_limit(ranking) for ranking in rankings}
    defaults = [set((ranking.scenario.get("defaults") or {}).items()) for ranking in rankings]
    texts = [translate("Each starts at {start}.", start=start) for start in sorted(starts) if start]
    texts += [translate("In time: {limits}.", limits=limit) for limit in sorted(limits) if limit]
    texts += [
        f"{capitalize_first(translate(HEADLAND_ORDERS[order]))}." for order in orders if order and len(orders) == 1
    ]
    return [*texts, *describe_defaults(dict(sorted(set.intersection(*defaults))) if defaults else {})]


def _describe_field(name: str, width: str, reason: str) -> str:
    return translate("{field} at {width}: {reason}", field=name, width=width, reason=reason)


def build_many_fields_screen(records: Sequence[ComparisonRow], *, with_next: bool = True) -> RenderableType:
    """What the fields come to at each width, the plan of every field, and what to type next."""
    faults = [*list_shortfalls(records), *list_records_without_plan(records, names_file=False), *list_remarks(records)]
    legend = translate("The recommended plan of each field; times and costs are as simulated.")
    if any(record.best is not None and record.best.p50_s is not None for record in records):
        legend = translate("The recommended plan of each field; times are medians, costs means of the samples.")
    notes, hidden = [" ".join((legend, *describe_plans(records)))], len(records) - MOST_ROWS
    is_whole = not with_next or (hidden <= 0 and not any(record.best for record in records))
    if hidden > 0:
        notes.append(translate_count("{count} more row: --explain.", "{count} more rows: --explain.", hidden))
    if with_next:
        notes.append(translate("Add --explain (and why), --html fields.html (maps), --csv (every plan)."))
    return Group(
        AnswerLines(tuple(list_many_sentences(records)), (), tuple(faults), is_whole=is_whole),
        Text(""),
        replace(_build_screen_table(records[:MOST_ROWS]), notes=tuple(notes)),
    )


def list_many_sentences(records: Sequence[ComparisonRow]) -> list[str]:
    """What the fields that have a plan come to, a sentence for every width, and how many have none."""
    fields = len({record.requested_field for record in records})
    is_assumed = any(record.ranking is not None and record.ranking.prices_assumed for record in records)
    currency = Comparison(tuple(records)).currency
    sentences = []
    for total in sum_over_fields(records):
        width = format_width(total.way.width_m)
        if fields == 1:
            decisions = [write_answer(row.ranking).decision for row in total.rows if row.ranking is not None]
            sentences += [translate("{width}: {plan}.", width=width, plan=decision) for decision in decisions]
            continue
        paid = format_assumed_money(format_money(total.paid_cost, currency), is_assumed)
        text = translate(
            "{width}: {count} of {fields} fields, {area}, {time} one after the other, {cost} ({rate}), {worked} % "
            "worked.",
            width=width,
            count=len(total.driven),
            fields=fields,
            area=FIELD_AREA.format(total.area_ha, 2),
            time=format_duration(total.end_s),
            cost=format_risked_money(paid, format_money(total.risked_cost, currency), total.risked_cost),
            rate=format_money_per_area(total.cost / total.area_ha, currency),
            worked=format_number(total.worked_pct, 1),
        )
        sentences.append(text)
    lacking = sum(record.ranking is not None and bool(record.ranking.shortfalls) for record in records)
    if lacking:
        text = translate_count("{count} plan is no recommendation.", "{count} plans are no recommendation.", lacking)
        sentences.insert(0, text)
    return sentences or [translate_count("No plan works on {count} field.", "No plan works on {count} fields.", fields)]


def _build_screen_table(records: Sequence[ComparisonRow]) -> FittedTable:
    """At most seven columns; the width, which is in metres if nothing is said, only where there are several."""
    has_widths = len({record.way.width_m for record in records}) > 1
    last = "finish_probability" if has_probability(records) else "worked_pct"
    drops = {"tractors": 0, "strategy": 3, "stated_end_s": 0, "stated_cost": 1, last: 2}
    figures = _fit_figures(records, list(drops))
    width = translate("Width {unit}", unit=LENGTH.unit) if is_us() else translate("Width")
    columns = (
        TableColumn(translate("Field"), is_text=True, is_unbroken=True),
        TableColumn(width) if has_widths else TableColumn(FIELD_AREA.unit, drop_order=4),
        *(figure.build_column(drops[figure.key]) for figure in figures),
    )
    rows = []
    for record in records:
        area_ha = None if record.ranking is None else record.ranking.area_ha
        size = format_number(FIELD_AREA.convert(area_ha), 2)
        size = format_width(record.way.width_m).partition(" ")[0] if has_widths else size
        cells = [NO_VALUE, translate("no plan"), *[NO_VALUE] * 3]
        if record.best is not None:
            cells = [figure.format(record.best) for figure in _fit_figures([record], list(drops))]
        rows.append((record.field_name, size, *cells))
    return FittedTable(columns, tuple(rows), more_hint=translate("--explain shows more"))


def _fit_figures(records: Sequence[ComparisonRow], keys: Sequence[str]) -> list[Figure]:
    """Figures as the first of some records with a plan has them: clock times where it has a start, its currency."""
    ranking = next((record.ranking for record in records if record.ranking is not None and record.best), None)
    return [FIGURES[key] if ranking is None else fit_to_ranking(FIGURES[key], ranking) for key in keys]


def render_many_fields_page(records: Sequence[ComparisonRow]) -> str:
    """The page as HTML text; records with a plan may have a small map."""
    table = tabulate_records(records)
    has_widths = len({record.way.width_m for record in records}) > 1
    anchors = [f"field-{number}" if record.best else "" for number, record in enumerate(records)]
    sections = [
        _build_section(record, record.ranking, record.best, anchor, has_widths)
        for record, anchor in zip(records, anchors, strict=True)
        if record.ranking is not None and record.best is not None
    ]
    headings = [column.heading for column in table.columns]
    places = [headings.index(heading) for heading in PAGE_HEADINGS if heading in headings]
    scenarios = [record.ranking.scenario for record in records if record.ranking is not None]
    machines = {f"{one['tractor']}, {one.get('implement') or 'implement'} {one['width_m']:g} m" for one in scenarios}
    return render_template(
        "many_fields.html.j2",
        {
            "title": f"{len({record.requested_field for record in records})} fields: plans",
            "machines": machines.pop() if len(machines) == 1 else None,
            "lead": insert_non_breaking_spaces(" ".join([*list_shortfalls(records), *list_many_sentences(records)])),
            "columns": [table.columns[place] for place in places],
            "rows": [
                {"cells": [row[place] for place in places], "is_total": bool(style), "anchor": anchor}
                for row, style, anchor in zip_longest(table.rows, table.styles, anchors, fillvalue="")
            ],
            "legend": [
                "The best plan of each field. Times are h:mm:ss.",
                *describe_records(records)[1:],
                *describe_plans(records),
            ],
            "without": list_records_without_plan(records),
            "sections": sections,
            "maps": [one["map"] for one in sections if one["map"]],
        },
    )


def _build_section(
    record: ComparisonRow, ranking: PlanRanking, best: PlanResult, anchor: str, names_width: bool
) -> dict[str, Any]:
    """One field at one width: map, what to do, and its feasible plans."""

    def name_headland(plan: PlanResult) -> str:
        return f"{plan.headland_passes} x {plan.headland_order or ''}".rstrip(" x") if plan.headland_passes else ""

    cost = format_money(best.stated_cost, ranking.currency)
    figures = (
        (TableColumn("Plan", is_text=True), name_plan),
        *((FIGURES[key].build_column(), FIGURES[key].format) for key in PLAN_CELLS),
        (TableColumn("Headland"), name_headland),
    )
    facts = f"{ranking.area_ha:.2f} ha, {FIGURES['stated_end_s'].format(best)}, {cost}"
    return {
        "name": ranking.field_name + (f", {record.way.width_m:g} m" if names_width else ""),
        "anchor": anchor,
        "map": record.map,
        "facts": insert_non_breaking_spaces(facts),
        "summary": write_answer(ranking).list_sentences(),
        "plans": build_table(ranking.eligible[:MAX_PLANS], figures, lambda plan: plan is best),
    }
