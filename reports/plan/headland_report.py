"""A comparison of headlands for people and programs: sentences, table, JSON, CSV and a page that loads nothing."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from reports.common.language import translate, translate_count
from reports.common.plan_results import MODEL_ERROR_SHARE
from reports.common.rendering import (
    EXPORT_DECIMALS,
    format_csv,
    format_json,
    pick_values,
    render_template,
)
from reports.common.text_tables import FittedTable, TableColumn, format_sentence, format_title
from reports.common.wording import (
    FIELD_AREA,
    NO_VALUE,
    SMALL_AREA,
    VOLUME,
    format_duration,
    format_money,
    format_number,
    format_price,
    insert_non_breaking_spaces,
)
from reports.plan.comparison import (
    HEADLAND_KEYS,
    YEAR_KEYS,
    Comparison,
    ComparisonRow,
    ComparisonTotals,
    describe_choice,
    list_cut_off,
    list_missing,
    name_choice,
)
from reports.plan.figures import HEADLAND_CSV_KEYS, build_part_entry, build_plan_entry
from reports.plan.plan_wording import describe_machines

LEAST_ROUNDED_HOURS = 10.0  # fewer have two decimals, as half a minute counts
MOST_NAMED_FIELDS = 2  # on which another way is better: more are counted
TOTAL_KEYS = (
    "area_ha", "time_s", "cost", "cost_per_ha", "fuel_l", "energy_kwh", "missed_m2", "overlap_m2", "over_finished_m2",
)  # fmt: skip


def compute_extra_cost(totals: ComparisonTotals, best: ComparisonTotals) -> float:
    """How much more one way costs than the best on the same ground in a year."""
    return totals.charged_cost_per_year - best.charged_cost_per_year


def format_hours(value: float | None) -> str:
    """Hours with one decimal, or two where there are few."""
    return format_number(value, 1 if value is None or value >= LEAST_ROUNDED_HOURS else 2)


def describe_comparison(comparison: Comparison) -> list[str]:
    """Which way is worth it, by how much, and where: the first sentence is the answer."""
    best = comparison.best
    if best is None:
        has_any = any(each.best is not None for each in comparison.rows)
        return [
            translate("No way to work the headland works on every field; the best of each field is below.")
            if has_any
            else translate("No way to work the headland works; the reasons are below.")
        ]
    energy = _get_energy_per_year(best)
    figures = [
        f"{format_hours(best.year['hours_per_year'])} h",
        *([] if energy is None else [f"{format_number(energy, 0)} {_get_energy_unit(comparison)}"]),
        format_money(best.year["cost_per_year"], comparison.currency),
    ]
    missing, unmet = [comparison.field_names[one.requested_field] for one in best.rows if not one.meets_request], []
    if missing:
        names = ", ".join(missing) if len(missing) <= MOST_NAMED_FIELDS else _count_fields(len(missing))
        text = translate(
            "It is no recommendation on {fields} (deadline, rain, budget, share worked or pull).", fields=names
        )
        unmet.append(text)
    return [
        _describe_worth(comparison, best),
        translate_count(
            "With {count} operation a year it takes {figures}.",
            "With {count} operations a year it takes {figures}.",
            best.operations_per_year,
            figures=", ".join(figures),
        ),
        *unmet,
        *_describe_places(comparison, best),
        *_describe_ground_left(comparison, best),
    ]


def _describe_worth(comparison: Comparison, best: ComparisonTotals) -> str:
    """The first sentence: the best way and what it saves against the next and the dearest."""
    others = [one for one in comparison.totals[1:] if len(one.driven) == len(best.driven)]
    names = [comparison.field_names[each.requested_field] for each in best.rows if each.best is not None]
    times = best.operations_per_year
    yearly = [] if times == 1 else [translate("{count} operations a year", count=times)]
    ground = ", ".join([FIELD_AREA.format(best.area_ha, 2), *yearly])
    where = f"{names[0] if len(names) == 1 else _count_fields(len(names))} ({ground})"
    way = describe_choice(best)
    if not others:
        rate = format_cost_per_ha(best, comparison)
        if len(comparison.totals) > 1:
            return translate("Only this way works: {way}: {rate} on {fields}.", way=way, rate=rate, fields=where)
        return translate("One way was compared: {way}: {rate} on {fields}.", way=way, rate=rate, fields=where)
    dearest = others[-1]
    if compute_extra_cost(dearest, best) <= MODEL_ERROR_SHARE * best.charged_cost_per_year:
        extra = format_money(compute_extra_cost(dearest, best), comparison.currency)
        return translate(
            "All ways cost the same within {extra} on {fields}; the least: {way}.", extra=extra, fields=where, way=way
        )
    alike = [one for one in others if compute_extra_cost(one, best) <= MODEL_ERROR_SHARE * best.charged_cost_per_year]
    if alike:
        least = format_money(compute_extra_cost(alike[-1], best), comparison.currency)
        others_alike = (
            translate("{way} costs the same within {extra}", way=name_choice(alike[0]), extra=least)
            if len(alike) == 1
            else translate("{count} other ways cost the same within {extra}", count=len(alike), extra=least)
        )
        return translate(
            "Worth it on {fields}: {way}: {saving} less than {dearest}, the dearest; {alike}.",
            fields=where,
            way=way,
            saving=_describe_saving(dearest, best, comparison),
            dearest=name_choice(dearest),
            alike=others_alike,
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


def _get_energy_per_year(totals: ComparisonTotals) -> float | None:
    """Electricity in kWh, or fuel in the unit of the reader; None where it is not known."""
    kwh, litres = totals.year["energy_kwh_per_year"], totals.year["fuel_l_per_year"]
    return kwh if kwh is not None or litres is None else VOLUME.convert(litres)


def _get_energy_unit(comparison: Comparison) -> str:
    return VOLUME.unit if all(one.energy_kwh is None for one in comparison.totals) else "kWh"


def _describe_saving(other: ComparisonTotals, best: ComparisonTotals, comparison: Comparison) -> str:
    extra = compute_extra_cost(other, best)
    return f"{format_money(extra, comparison.currency)} ({100.0 * extra / other.charged_cost_per_year:.1f} %)"


def format_cost_per_ha(totals: ComparisonTotals, comparison: Comparison) -> str:
    """The cost of a worked hectare with its currency."""
    return f"{_format_rate(totals)} {comparison.currency or ''}/{FIELD_AREA.unit}"


def _count_fields(count: int) -> str:
    return translate_count("{count} field", "{count} fields", count)


def _describe_places(comparison: Comparison, best: ComparisonTotals) -> Iterator[str]:
    """Where the best way matters most, and on which fields another one is better."""
    if len(comparison.fields) < 2:
        return
    gains: dict[str, float] = {}
    losses: dict[str, tuple[ComparisonTotals, ComparisonTotals]] = {}
    for field, totals in comparison.totals_by_field.items():
        driven = [one for one in totals if one.driven]
        same = next((one for one in driven if one.way == best.way), None)
        if same is None:
            continue
        name = comparison.field_names[field]
        is_dearer = compute_extra_cost(same, driven[0]) > MODEL_ERROR_SHARE * same.charged_cost_per_year
        if driven[0].way != best.way and is_dearer:
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


def _describe_ground_left(comparison: Comparison, best: ComparisonTotals) -> Iterator[str]:
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
    if best.cut_off_m2:
        texts.append(translate("{area} are cut off for it (see below)", area=SMALL_AREA.format(best.cut_off_m2)))
    if round(least_missed.missed_m2) < round(best.missed_m2):
        area = SMALL_AREA.format(least_missed.missed_m2)
        texts.append(translate("{way} misses least ({area})", way=name_choice(least_missed), area=area))
    if round(least_driven.over_finished_m2) < round(best.over_finished_m2):
        area = SMALL_AREA.format(least_driven.over_finished_m2)
        texts.append(translate("{way} drives over least ({area})", way=name_choice(least_driven), area=area))
    yield f"{'; '.join(texts)}."


def tabulate_ways(
    comparison: Comparison, totals: Sequence[ComparisonTotals], best: ComparisonTotals | None
) -> FittedTable:
    """A row per way, the best in bold; fuel only where it is known of all ways."""

    def format_extra(one: ComparisonTotals) -> str:  # only where both work on as many fields
        if best is None or len(one.driven) != len(best.driven):
            return NO_VALUE
        return translate("best") if one is best else f"+{format_price(max(compute_extra_cost(one, best), 0.0))}"

    unit, small_unit = comparison.currency or translate("Cost"), SMALL_AREA.unit
    energy = (_build_year_column(_get_energy_unit(comparison)), lambda one: format_number(_get_energy_per_year(one), 0))
    driven = [one for one in comparison.totals if one.driven]
    has_energy = bool(driven) and any(
        all(getattr(one, key) is not None for one in driven) for key in ("fuel_l", "energy_kwh")
    )
    figures: list[tuple[TableColumn, Callable[[ComparisonTotals], str]]] = [
        (TableColumn(translate("Headland"), is_text=True, is_unbroken=True), name_choice),
        (TableColumn(f"{unit}/{FIELD_AREA.unit}"), _format_rate),
        (TableColumn(translate("More")), format_extra),
        (_build_year_column("h"), lambda one: format_hours(one.year["hours_per_year"])),
        *([energy] if has_energy else []),
        (_build_year_column(unit), lambda one: format_price(one.year["cost_per_year"])),
        (_build_figure_column(translate("Missed {unit}", unit=small_unit)), lambda one: _format_ground(one.missed_m2)),
        (_build_figure_column(translate("Overlap {unit}", unit=small_unit), drop_order=2),
         lambda one: _format_ground(one.overlap_m2)),
        (_build_figure_column(translate("Driven over {unit}", unit=small_unit)),
         lambda one: _format_ground(one.over_finished_m2)),
    ]  # fmt: skip
    rows = tuple(
        tuple(write(one) if one.driven or write is name_choice else NO_VALUE for _, write in figures) for one in totals
    )
    styles = tuple("bold" if one is best else "" for one in totals)
    return FittedTable(tuple(column for column, _ in figures), rows, styles)


def _format_rate(totals: ComparisonTotals) -> str:
    return format_number(FIELD_AREA.convert_rate(totals.cost_per_ha), 1)


def _format_ground(m2: float) -> str:
    return format_number(SMALL_AREA.convert(m2), 0)


def _build_figure_column(heading: str, drop_order: int = 0) -> TableColumn:
    """A column of figures whose heading stands in two lines where there is little room, the second from its last words.

    ``Driven over m2`` becomes ``Driven`` above ``over m2``.
    """
    return TableColumn(heading, heading.replace(" ", "\n", 1), drop_order=drop_order)


def _build_year_column(unit: str) -> TableColumn:
    heading = translate("{unit}/year", unit=unit)
    return TableColumn(heading, heading.replace("/", "/\n"))


def build_headland_table(comparison: Comparison) -> RenderableType:
    """The answer, one line per way, one per field where there are several, and what has no plan."""
    first, *others = describe_comparison(comparison)
    parts: list[RenderableType] = [format_sentence(first, style="bold"), *map(format_sentence, others), Text("")]
    if any(one.driven for one in comparison.totals):
        parts.append(tabulate_ways(comparison, comparison.totals, comparison.best))
        if len(comparison.fields) > 1:
            parts += [Text(""), tabulate_fields(comparison)]
        parts += [format_sentence(describe_figures(), style="dim"), Text("")]
    cut_off = list_cut_off(comparison)
    parts += [format_title(translate("Cut off")), *map(format_sentence, cut_off), Text("")] if cut_off else []
    missing = list_missing(comparison)
    parts += [format_title(translate("Without a plan")), *map(format_sentence, missing)] if missing else []
    return Group(*parts)


def describe_figures() -> str:
    """What the columns are."""
    figures = translate(
        "Sums of the best plan of every field. Missed: not worked; overlap: worked more than once; driven over: "
        "finished ground under wheels, headland included; cost per hectare that is worked."
    )
    year = translate("Per year: all fields, as driven and paid. More: with missed ground finished, above the best.")
    return f"{figures} {year}"


def tabulate_fields(comparison: Comparison) -> FittedTable:
    """The best way on each field, and what it saves against the dearest there."""
    unit = comparison.currency or translate("Cost")
    columns = (
        TableColumn(translate("Field"), is_text=True),
        TableColumn(translate("Best headland"), is_text=True, is_unbroken=True),
        TableColumn(translate("Saves")),
        TableColumn(f"{unit}/{FIELD_AREA.unit}"),
        _build_year_column("h"),
        _build_figure_column(translate("Missed {unit}", unit=SMALL_AREA.unit), drop_order=1),
        TableColumn(FIELD_AREA.unit),
    )
    rows = []
    for name, totals in comparison.totals_by_field.items():
        driven, cells = [one for one in totals if one.driven], [translate("none works"), *[NO_VALUE] * 5]
        if driven:
            best, saved = driven[0], compute_extra_cost(driven[-1], driven[0])
            cells = [
                name_choice(best), format_price(saved) if len(driven) > 1 else NO_VALUE, _format_rate(best),
                format_hours(best.year["hours_per_year"]), _format_ground(best.missed_m2),
                format_number(FIELD_AREA.convert(best.area_ha), 2),
            ]  # fmt: skip
        rows.append((comparison.field_names[name], *cells))
    return FittedTable(columns, tuple(rows))


def format_headland_json(comparison: Comparison) -> str:
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
        "currency": comparison.currency or None,
        "operations_per_year": comparison.operations_per_year,
        "best": None if best is None else pick_values(best.way, HEADLAND_KEYS),
        "totals": [
            {
                **pick_values(one.way, HEADLAND_KEYS),
                "fields": len(one.driven),
                **{key: getattr(one, key) if one.driven else None for key in TOTAL_KEYS},
                **one.year,
            }
            for one in comparison.totals
        ],
        "fields": [
            {
                **_describe_row(each),
                "plan": None if each.best is None else build_plan_entry(each.best),
                "meets_request": None if each.best is None else each.meets_request,
                "parts": [build_part_entry(part) for part in each.parts],
                "refusal": each.reason,
            }
            for each in comparison.rows
        ],
    }
    return format_json(content, EXPORT_DECIMALS, is_ascii=False)


def _describe_row(each: ComparisonRow) -> dict[str, Any]:
    """The field and the way, as JSON and CSV have them."""
    return {
        "requested_field": each.requested_field,
        "field": None if each.ranking is None else each.field_name,
        "area_ha": each.area_ha or None,
        **pick_values(each.way, HEADLAND_KEYS),
        "headland_m": each.get_planned("headland_m"),
    }


def format_headland_csv(comparison: Comparison) -> str:
    """A row per field and way: the way, the figures of its best plan, or the reason why there is none."""
    head = (
        "requested_field", "field", "area_ha", "corners", "headland_order", "headland_passes", "headland_m",
        *HEADLAND_CSV_KEYS, "overlap_m2", "cost_per_ha", "currency", "reason", "width_m", "operations_per_year",
        *YEAR_KEYS, "cut_off_m2",
    )  # fmt: skip
    rows = []
    for each in comparison.rows:
        (totals,) = comparison.sum_over_fields([each])
        values = {
            **_describe_row(each),
            "currency": comparison.currency,
            "reason": each.reason,
            "operations_per_year": comparison.operations_per_year,
            **totals.year,
        }
        if each.best is not None:
            values |= pick_values(each.best, HEADLAND_CSV_KEYS)
            values |= {key: getattr(each.best, key) or values[key] for key in ("headland_order", "headland_passes")}
            values |= pick_values(totals, ("overlap_m2", "cost_per_ha", "cut_off_m2"))
        rows.append(values)
    return format_csv(head, rows)


def render_headland_page(comparison: Comparison) -> str:
    """The page as HTML text."""
    names = list(comparison.field_names.values())
    rankings = [each.ranking for each in comparison.rows if each.ranking is not None]
    return render_template(
        "headland_comparison.html.j2",
        {
            "title": f"Headlands compared: {names[0] if len(names) == 1 else f'{len(names)} fields'}",
            "machines": "; ".join(dict.fromkeys(filter(None, map(describe_machines, rankings)))),
            "answer": [insert_non_breaking_spaces(text) for text in describe_comparison(comparison)],
            "ways": tabulate_ways(comparison, comparison.totals, comparison.best),
            "help": f"{describe_figures()} Times are h:mm:ss.",
            "best_ways": tabulate_fields(comparison),
            "cut_off": list_cut_off(comparison),
            "missing": list_missing(comparison),
            "fields": [_build_section(comparison, field) for field in comparison.fields],
            "maps": [each.map for each in comparison.rows if each.map is not None],
            "remarks": list(dict.fromkeys(remark for one in rankings for remark in one.field_remarks)),
        },
    )


def _build_section(comparison: Comparison, field: str) -> dict[str, Any]:
    """One field: its table and its maps, the best way first."""
    totals = comparison.totals_by_field[field]
    driven = [one for one in totals if one.driven]
    best = driven[0] if driven else None
    return {
        "name": comparison.field_names[field],
        "area": format_number(best.area_ha, 2) if best else "",
        "ways": tabulate_ways(comparison, totals, best),
        "cards": [
            {
                "name": name_choice(one),
                "best": one is best,
                "map": one.rows[0].map,
                "text": insert_non_breaking_spaces(
                    ", ".join(
                        [
                            format_duration(one.time_s),
                            format_cost_per_ha(one, comparison),
                            *([] if one.fuel_l is None else [f"{one.fuel_l:.0f} l"]),
                            *([] if one.energy_kwh is None else [f"{one.energy_kwh:.0f} kWh"]),
                            f"missed {one.missed_m2:.0f} m2",
                            f"overlap {one.overlap_m2:.0f} m2",
                            f"driven over {one.over_finished_m2:.0f} m2",
                        ]
                    )
                ),
            }
            for one in driven
            if one.rows[0].map is not None
        ],
    }
