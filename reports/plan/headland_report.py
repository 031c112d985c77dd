"""A comparison of headlands for people and programs: sentences, table, JSON and CSV."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from reports.common.language import translate, translate_count
from reports.common.rendering import format_json, make_json_safe
from reports.common.text_tables import FittedTable, TableColumn, format_sentence, format_title
from reports.common.units import FIELD_AREA, SMALL_AREA, VOLUME
from reports.common.wording import NO_VALUE, format_money, format_number, format_price
from reports.plan.figures import HEADLAND_CSV_KEYS
from reports.plan.headland_comparison import (
    YEAR_KEYS,
    ComparedPlan,
    HeadlandChoice,
    HeadlandComparison,
    HeadlandTotals,
    describe_choice,
    list_cut_off,
    list_missing,
    name_choice,
)
from reports.plan.ranking_export import EXPORT_DECIMALS, build_part_entry, build_plan_entry, format_csv, format_csv_cell

ALIKE_SHARE = 0.005  # of the cost: ways that differ by less cost the same
LEAST_ROUNDED_HOURS = 10.0  # fewer have two decimals, as half a minute counts
MOST_NAMED_FIELDS = 2  # on which another way is better: more are counted
TOTAL_KEYS = (
    "area_ha", "time_s", "cost", "cost_per_ha", "fuel_l", "energy_kwh", "missed_m2", "overlap_m2", "over_finished_m2",
)  # fmt: skip


def compute_extra_cost(totals: HeadlandTotals, best: HeadlandTotals) -> float:
    """How much more one way costs than the best on the same ground in a year."""
    return totals.charged_cost_per_year - best.charged_cost_per_year


def format_hours(value: float | None) -> str:
    """Hours with one decimal, or two where there are few."""
    return format_number(value, 1 if value is None or value >= LEAST_ROUNDED_HOURS else 2)


def describe_comparison(comparison: HeadlandComparison) -> list[str]:
    """Which way is worth it, by how much, and where: the first sentence is the answer."""
    best = comparison.best
    if best is None:
        has_any = any(each.plan is not None for each in comparison.plans)
        return [
            translate("No way to work the headland works on every field; the best of each field is below.")
            if has_any
            else translate("No way to work the headland works; the reasons are below.")
        ]
    return [
        _describe_worth(comparison, best),
        _describe_year(comparison, best),
        *_describe_unmet(comparison, best),
        *_describe_places(comparison, best),
        *_describe_ground_left(comparison, best),
    ]


def _describe_worth(comparison: HeadlandComparison, best: HeadlandTotals) -> str:
    """The first sentence: the best way and what it saves against the next and the dearest."""
    others = [one for one in comparison.totals[1:] if len(one.driven) == len(best.driven)]
    where = _describe_ground(comparison, best)
    way = describe_choice(best)
    if not others:
        rate = format_cost_per_ha(best, comparison)
        if len(comparison.totals) > 1:
            return translate("Only this way works: {way}: {rate} on {fields}.", way=way, rate=rate, fields=where)
        return translate("One way was compared: {way}: {rate} on {fields}.", way=way, rate=rate, fields=where)
    dearest = others[-1]
    if compute_extra_cost(dearest, best) <= ALIKE_SHARE * best.charged_cost_per_year:
        extra = format_money(compute_extra_cost(dearest, best), comparison.currency)
        return translate(
            "All ways cost the same within {extra} on {fields}; the least: {way}.", extra=extra, fields=where, way=way
        )
    alike = [one for one in others if compute_extra_cost(one, best) <= ALIKE_SHARE * best.charged_cost_per_year]
    if alike:
        return translate(
            "Worth it on {fields}: {way}: {saving} less than {dearest}, the dearest; {alike}.",
            fields=where,
            way=way,
            saving=_describe_saving(dearest, best, comparison),
            dearest=name_choice(dearest),
            alike=_describe_alike(alike, best, comparison),
        )
    values = {
        "fields": where,
        "way": way,
        "saving": _describe_saving(others[0], best, comparison),
        "next": name_choice(others[0]),
    }
    if len(others) == 1:
        return translate("Worth it on {fields}: {way}: {saving} less than {next}.", **values)
    return translate(
        "Worth it on {fields}: {way}: {saving} less than {next} and {more} less than {dearest}, the dearest.",
        **values,
        more=_describe_saving(dearest, best, comparison),
        dearest=name_choice(dearest),
    )


def _describe_alike(alike: list[HeadlandTotals], best: HeadlandTotals, comparison: HeadlandComparison) -> str:
    """That other ways cost nearly the same as the best."""
    extra = format_money(compute_extra_cost(alike[-1], best), comparison.currency)
    if len(alike) == 1:
        return translate("{way} costs the same within {extra}", way=name_choice(alike[0]), extra=extra)
    return translate("{count} other ways cost the same within {extra}", count=len(alike), extra=extra)


def _describe_year(comparison: HeadlandComparison, best: HeadlandTotals) -> str:
    """Hours, fuel and cost of the best way in a year."""
    energy = _get_energy_per_year(best)
    figures = [
        f"{format_hours(best.year['hours_per_year'])} h",
        *([] if energy is None else [f"{format_number(energy, 0)} {_get_energy_unit(comparison)}"]),
        format_money(best.year["cost_per_year"], comparison.currency),
    ]
    return translate_count(
        "With {count} operation a year it takes {figures}.",
        "With {count} operations a year it takes {figures}.",
        best.operations_per_year,
        figures=", ".join(figures),
    )


def _get_energy_per_year(totals: HeadlandTotals) -> float | None:
    """Electricity in kWh, or fuel in the unit of the reader; None where it is not known."""
    kwh, litres = totals.year["energy_kwh_per_year"], totals.year["fuel_l_per_year"]
    return kwh if kwh is not None or litres is None else VOLUME.convert(litres)


def _get_energy_unit(comparison: HeadlandComparison) -> str:
    return VOLUME.unit if all(one.energy_kwh is None for one in comparison.totals) else "kWh"


def _describe_ground(comparison: HeadlandComparison, totals: HeadlandTotals) -> str:
    names = [comparison.field_names[each.requested_field] for each in totals.plans if each.plan is not None]
    subject = names[0] if len(names) == 1 else _count_fields(len(names))
    times = totals.operations_per_year
    yearly = [] if times == 1 else [translate("{count} operations a year", count=times)]
    return f"{subject} ({', '.join([FIELD_AREA.format(totals.area_ha, 2), *yearly])})"


def _describe_saving(other: HeadlandTotals, best: HeadlandTotals, comparison: HeadlandComparison) -> str:
    extra = compute_extra_cost(other, best)
    return f"{format_money(extra, comparison.currency)} ({100.0 * extra / other.charged_cost_per_year:.1f} %)"


def format_cost_per_ha(totals: HeadlandTotals, comparison: HeadlandComparison) -> str:
    """The cost of a worked hectare with its currency."""
    rate = format_number(FIELD_AREA.convert_rate(totals.cost_per_ha), 1)
    return f"{rate} {comparison.currency or ''}/{FIELD_AREA.unit}"


def _describe_unmet(comparison: HeadlandComparison, best: HeadlandTotals) -> Iterator[str]:
    """Where the best way is no recommendation."""
    missing = [comparison.field_names[each.requested_field] for each in best.plans if not each.meets_request]
    if missing:
        names = ", ".join(missing) if len(missing) <= MOST_NAMED_FIELDS else _count_fields(len(missing))
        yield translate(
            "It is no recommendation on {fields} (deadline, rain, budget, share worked or pull).", fields=names
        )


def _count_fields(count: int) -> str:
    return translate_count("{count} field", "{count} fields", count)


def _describe_places(comparison: HeadlandComparison, best: HeadlandTotals) -> Iterator[str]:
    """Where the best way matters most, and on which fields another one is better."""
    if len(comparison.fields) < 2:
        return
    gains: dict[str, float] = {}
    losses: dict[str, tuple[HeadlandTotals, HeadlandTotals]] = {}
    for field, totals in comparison.totals_by_field.items():
        driven = [one for one in totals if one.driven]
        same = next((one for one in driven if one.choice == best.choice), None)
        if same is None:
            continue
        name = comparison.field_names[field]
        is_dearer = compute_extra_cost(same, driven[0]) > ALIKE_SHARE * same.charged_cost_per_year
        if driven[0].choice != best.choice and is_dearer:
            losses[name] = same, driven[0]
        elif len(driven) > 1:
            gains[name] = compute_extra_cost(driven[-1], same)
    if len(losses) > MOST_NAMED_FIELDS:
        loss = format_money(sum(compute_extra_cost(*pair) for pair in losses.values()), comparison.currency)
        yield translate(
            "On {count} of {fields} fields another way is better, by {saving} together; the second table names them.",
            count=len(losses),
            fields=len(comparison.fields),
            saving=loss,
        )
    else:
        for name, (same, better) in losses.items():
            saving = _describe_saving(same, better, comparison)
            yield translate(
                "On {field} {way} is better by {saving}.", field=name, way=describe_choice(better), saving=saving
            )
    if len(gains) > 1:
        name = max(gains, key=lambda each: gains[each])
        gain = format_money(gains[name], comparison.currency)
        yield translate("It saves most on {field}: {saving} against the dearest way there.", field=name, saving=gain)


def _describe_ground_left(comparison: HeadlandComparison, best: HeadlandTotals) -> Iterator[str]:
    """What the best way misses and drives over, beside the ways that miss and drive over least."""
    alike = [one for one in comparison.totals if len(one.driven) == len(best.driven)]
    least_missed = min(alike, key=lambda one: round(one.missed_m2))
    least_driven = min(alike, key=lambda one: round(one.over_finished_m2))
    texts = [
        translate(
            "It misses {missed} and drives over {driven} of finished ground",
            missed=SMALL_AREA.format(best.missed_m2),
            driven=SMALL_AREA.format(best.over_finished_m2),
        )
    ]
    cut_off_m2 = sum(each.cut_off_m2 for each in best.plans)
    if cut_off_m2:
        texts.append(translate("{area} are cut off for it (see below)", area=SMALL_AREA.format(cut_off_m2)))
    if round(least_missed.missed_m2) < round(best.missed_m2):
        area = SMALL_AREA.format(least_missed.missed_m2)
        texts.append(translate("{way} misses least ({area})", way=name_choice(least_missed), area=area))
    if round(least_driven.over_finished_m2) < round(best.over_finished_m2):
        area = SMALL_AREA.format(least_driven.over_finished_m2)
        texts.append(translate("{way} drives over least ({area})", way=name_choice(least_driven), area=area))
    yield f"{'; '.join(texts)}."


def list_columns(comparison: HeadlandComparison) -> tuple[TableColumn, ...]:
    """The columns of the table; fuel only where it is known."""
    unit = comparison.currency or translate("Cost")
    energy = (_build_year_column(_get_energy_unit(comparison)),) if has_fuel(comparison) else ()
    return (
        TableColumn(translate("Headland"), is_text=True, is_unbroken=True),
        TableColumn(f"{unit}/{FIELD_AREA.unit}"),
        TableColumn(translate("More")),
        _build_year_column("h"),
        *energy,
        _build_year_column(unit),
        _build_figure_column(translate("Missed {unit}", unit=SMALL_AREA.unit)),
        _build_figure_column(translate("Overlap {unit}", unit=SMALL_AREA.unit), drop_order=2),
        _build_figure_column(translate("Driven over {unit}", unit=SMALL_AREA.unit)),
    )


def _build_figure_column(heading: str, drop_order: int = 0) -> TableColumn:
    """A column of figures whose heading stands in two lines where there is little room, the second from its last words.

    ``Driven over m2`` becomes ``Driven`` above ``over m2``.
    """
    first, _, rest = heading.partition(" ")
    return TableColumn(heading, f"{first}\n{rest}", drop_order=drop_order)


def _build_year_column(unit: str) -> TableColumn:
    heading = translate("{unit}/year", unit=unit)
    return TableColumn(heading, heading.replace("/", "/\n"))


def has_fuel(comparison: HeadlandComparison) -> bool:
    """Whether the fuel, or the electricity, of every way that works is known."""
    driven = [one for one in comparison.totals if one.driven]
    return bool(driven) and any(
        all(amount is not None for amount in amounts)
        for amounts in ([one.fuel_l for one in driven], [one.energy_kwh for one in driven])
    )


def build_cells(totals: HeadlandTotals, best: HeadlandTotals | None, with_fuel: bool) -> tuple[str, ...]:
    """The row of one way: what it costs more than the best only where both work on as many fields."""
    if not totals.driven:
        return (name_choice(totals), *[NO_VALUE] * (7 + with_fuel))
    is_comparable = best is not None and len(totals.driven) == len(best.driven)
    extra = compute_extra_cost(totals, best) if best is not None and is_comparable else None
    return (
        name_choice(totals),
        format_number(FIELD_AREA.convert_rate(totals.cost_per_ha), 1),
        NO_VALUE if extra is None else f"+{format_price(max(extra, 0.0))}" if totals is not best else translate("best"),
        format_hours(totals.year["hours_per_year"]),
        *([format_number(_get_energy_per_year(totals), 0)] if with_fuel else []),
        format_price(totals.year["cost_per_year"]),
        format_number(SMALL_AREA.convert(totals.missed_m2), 0),
        format_number(SMALL_AREA.convert(totals.overlap_m2), 0),
        format_number(SMALL_AREA.convert(totals.over_finished_m2), 0),
    )


def build_headland_table(comparison: HeadlandComparison) -> RenderableType:
    """The answer, one line per way, one per field where there are several, and what has no plan."""
    first, *others = describe_comparison(comparison)
    with_fuel = has_fuel(comparison)
    rows = tuple(build_cells(one, comparison.best, with_fuel) for one in comparison.totals)
    styles = tuple("bold" if one is comparison.best else "" for one in comparison.totals)
    parts: list[RenderableType] = [format_sentence(first, style="bold"), *map(format_sentence, others), Text("")]
    if any(one.driven for one in comparison.totals):
        parts.append(FittedTable(list_columns(comparison), rows, styles))
        if len(comparison.fields) > 1:
            parts += [Text(""), _build_field_table(comparison)]
        parts += [format_sentence(describe_figures(comparison), style="dim"), Text("")]
    cut_off = list_cut_off(comparison)
    parts += [format_title(translate("Cut off")), *map(format_sentence, cut_off), Text("")] if cut_off else []
    missing = list_missing(comparison)
    parts += [format_title(translate("Without a plan")), *map(format_sentence, missing)] if missing else []
    return Group(*parts)


def describe_figures(comparison: HeadlandComparison) -> str:
    """What the columns are."""
    figures = translate(
        "Sums of the best plan of every field. Missed: not worked; overlap: worked more than once; driven over: "
        "finished ground under wheels, headland included; cost per hectare that is worked."
    )
    year = translate("Per year: all fields, as driven and paid. More: with missed ground finished, above the best.")
    return f"{figures} {year}"


def list_field_columns(comparison: HeadlandComparison) -> tuple[TableColumn, ...]:
    """The columns of the table with the best way on each field."""
    unit = comparison.currency or translate("Cost")
    return (
        TableColumn(translate("Field"), is_text=True),
        TableColumn(translate("Best headland"), is_text=True, is_unbroken=True),
        TableColumn(translate("Saves")),
        TableColumn(f"{unit}/{FIELD_AREA.unit}"),
        _build_year_column("h"),
        _build_figure_column(translate("Missed {unit}", unit=SMALL_AREA.unit), drop_order=1),
        TableColumn(FIELD_AREA.unit),
    )


def build_field_cells(comparison: HeadlandComparison, name: str) -> tuple[str, ...]:
    """The best way on one field, and what it saves against the dearest there."""
    driven = [one for one in comparison.totals_by_field[name] if one.driven]
    label = comparison.field_names[name]
    if not driven:
        return label, translate("none works"), *[NO_VALUE] * 5
    best, dearest = driven[0], driven[-1]
    return (
        label,
        name_choice(best),
        format_price(compute_extra_cost(dearest, best)) if len(driven) > 1 else NO_VALUE,
        format_number(FIELD_AREA.convert_rate(best.cost_per_ha), 1),
        format_hours(best.year["hours_per_year"]),
        format_number(SMALL_AREA.convert(best.missed_m2), 0),
        format_number(FIELD_AREA.convert(best.area_ha), 2),
    )


def _build_field_table(comparison: HeadlandComparison) -> FittedTable:
    rows = tuple(build_field_cells(comparison, name) for name in comparison.fields)
    return FittedTable(list_field_columns(comparison), rows)


def format_headland_json(comparison: HeadlandComparison) -> str:
    """The comparison as JSON text with a trailing newline.

    Keys: ``answer`` (sentences), ``cut_off`` (sentences), ``currency``, ``operations_per_year``, ``best`` (a way:
    ``corners``, ``headland_order``, ``headland_passes``, ``width_m``; null where none works everywhere), ``totals``
    (one per way, the best first: the way, ``fields``, `TOTAL_KEYS`, `YEAR_KEYS`) and ``fields`` (one per field and way:
    the way, ``headland_m``, ``plan`` and ``parts`` as in the JSON of a plan, ``refusal``).
    """
    best = comparison.best
    content = {
        "answer": describe_comparison(comparison),
        "cut_off": list_cut_off(comparison),
        "currency": comparison.currency,
        "operations_per_year": comparison.operations_per_year,
        "best": None if best is None else _build_choice_entry(best.choice),
        "totals": [_build_totals_entry(one) for one in comparison.totals],
        "fields": [_build_field_entry(each) for each in comparison.plans],
    }
    return format_json(content, EXPORT_DECIMALS, is_ascii=False)


def _build_choice_entry(choice: HeadlandChoice) -> dict[str, Any]:
    return {
        "corners": choice.corners,
        "headland_order": choice.order,
        "headland_passes": choice.passes,
        "width_m": choice.width_m,
    }


def _build_totals_entry(totals: HeadlandTotals) -> dict[str, Any]:
    figures = {key: getattr(totals, key) if totals.driven else None for key in TOTAL_KEYS}
    return {**_build_choice_entry(totals.choice), "fields": len(totals.driven), **figures, **totals.year}


def _build_field_entry(each: ComparedPlan) -> dict[str, Any]:
    return {
        "requested_field": each.requested_field,
        "field": each.field_name or None,
        "area_ha": each.area_ha or None,
        **_build_choice_entry(each.choice),
        "headland_m": each.headland_m,
        "plan": None if each.plan is None else build_plan_entry(each.plan),
        "meets_request": None if each.plan is None else each.meets_request,
        "parts": [build_part_entry(part) for part in each.parts],
        "refusal": each.refusal,
    }


def format_headland_csv(comparison: HeadlandComparison) -> str:
    """A row per field and way: the way, the figures of its best plan, or the reason why there is none."""
    head = (
        "requested_field", "field", "area_ha", "corners", "headland_order", "headland_passes", "headland_m",
        *HEADLAND_CSV_KEYS, "overlap_m2", "cost_per_ha", "currency", "reason", "width_m", "operations_per_year",
        *YEAR_KEYS, "cut_off_m2",
    )  # fmt: skip
    rows = []
    for each in comparison.plans:
        (totals,) = comparison.sum_over_fields([each])
        year = (each.choice.width_m, comparison.operations_per_year, *totals.year.values())
        values = [*_iter_csv_cells(each, comparison.currency), *year, None if each.plan is None else each.cut_off_m2]
        rows.append([format_csv_cell(cell) for cell in make_json_safe(values, EXPORT_DECIMALS)])
    return format_csv([head, *rows])


def _iter_csv_cells(each: ComparedPlan, currency: str | None) -> Iterator[Any]:
    plan = each.plan
    yield from (each.requested_field, each.field_name or None, each.area_ha or None, each.choice.corners)
    yield (None if plan is None else plan.headland_order) or each.choice.order
    yield (None if plan is None else plan.headland_passes) or each.choice.passes
    yield each.headland_m
    yield from (None if plan is None else getattr(plan, key) for key in HEADLAND_CSV_KEYS)
    yield None if plan is None else each.overlap_m2
    yield None if plan is None else each.charged_cost / each.area_ha
    yield from (currency, each.refusal)
