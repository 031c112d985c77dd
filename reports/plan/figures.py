"""The figures of plans: each is named, explained, read and printed here; lists say which of them is shown where, and
rankings and fields are written with them as JSON and CSV: fixed keys in a fixed order, six decimals.

To add one, give it an entry in `_CATALOGUE`, in the order of JSON, and its key in the lists of what is to show it. A
figure that the run of a plan tells has `measure`; one that follows from other values of the plan has `read`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, is_dataclass, replace
from functools import partial
from typing import Any

from reports.common.language import mark_text, translate
from reports.common.plan_records import SlopePlace
from reports.common.plan_results import FieldPartPlan, PlanRanking, PlanResult
from reports.common.rendering import (
    EXPORT_DECIMALS,
    format_csv,
    format_json,
    make_json_safe,
    pick_values,
)
from reports.common.text_tables import FittedTable, TableColumn, build_table
from reports.common.wording import (
    NO_VALUE,
    VOLUME,
    format_area,
    format_duration,
    format_number,
    format_price,
    format_yes_no,
    has_start_time,
)
from reports.plan.answer import write_answer
from reports.plan.other_plans import format_stated_end
from reports.plan.plan_wording import (
    format_in_time_probability,
    get_clearance_m,
    get_spoilt_m2,
    has_late_ground_loss,
    name_energy_column,
)
from reports.plan.shortfall_wording import describe_shortfall, question_pull
from vehicle.missions.run import SimulationRun

PIECE_KEYS = ("m2", "lon", "lat", "x_m", "y_m")
SLOPE_KEYS = ("amount", "tractor", "lon", "lat", "x_m", "y_m")
_WHOLE, _TENTHS, _HUNDREDTHS = (partial(format_number, decimals=count) for count in (0, 1, 2))
FIRST_CSV_KEYS = (
    "field", "strategy", "tractors", "turn", "width_m", "stated_end_s", "stated_late_end_s", "stated_cost",
    "worked_pct", "finish_probability", "meets_deadline", "fuel_l", "energy_kwh", "waiting_s", "rank", "feasible",
    "reason",
)  # fmt: skip
"""What a plan is of, the figures of the printed table, and why there are none."""
HEADLAND_CSV_KEYS = (
    "strategy", "tractors", "time_s", "cost", "finished_s", "finished_cost", "fuel_l", "energy_kwh", "worked_pct",
    "missed_m2", "over_finished_m2", "wheel_traffic_m2",
)  # fmt: skip
SCREEN_DROPS = {
    "tractors": 0, "strategy": 0, "stated_end_s": 0, "stated_late_end_s": 3, "waiting_s": 4, "stated_cost": 1,
    "fuel_l": 3, "energy_kwh": 3, "worked_pct": 2, "finish_probability": 1, "meets_deadline": 1,
}  # fmt: skip
"""Of the first screen and notebooks, which show seven at most, each with the order in which it is dropped, the highest
first."""
TABLE_DROPS = {
    "rank": 0, "tractors": 1, "strategy": 0, "turn": 9, "stated_end_s": 0, "stated_cost": 2, "paid_cost": 6,
    "fuel_l": 6, "energy_kwh": 6, "refills": 3, "folding_s": 3, "charges": 3, "turning_s": 5, "waiting_s": 6,
    "worked_pct": 4, "missed_m2": 4, "left_out_m2": 4, "spoilt_m2": 5, "overlap_pct": 8, "min_clearance_m": 7,
    "finish_probability": 3, "meets_deadline": 3,
}  # fmt: skip
"""Of the table of all plans (`--explain`)."""
COUNT_DROPS = {
    "tractors": 0, "strategy": 0, "finish_probability": 0, "p50_done_s": 0, "p95_done_s": 0, "stated_cost": 2,
    "paid_cost": 6,
}  # fmt: skip
"""Of the table of the best plan of every number of tractors."""
UNLOADING_HEADINGS = {"refills": mark_text("Unloads"), "refilling_s": mark_text("Unloading")}
"""Of stops where implements collect."""
PAGE_KEYS = (
    "rank", "tractors", "strategy", "stated_end_s", "stated_late_end_s", "stated_cost", "worked_pct",
    "finish_probability", "meets_deadline",
)  # fmt: skip
PAGE_EXTRA_KEYS = (
    "turn", "time_s", "tractor_time_s", "turning_s", "waiting_s", "reversals", "overlap_pct", "missed_m2",
    "left_out_m2", "finished_s", "outside_m", "outside_along_m", "min_clearance_m", "collisions",
    "on_pareto_front", "paid_cost", "fuel_l", "fuel_l_per_ha", "energy_kwh", "energy_kwh_per_ha", "co2_kg",
    "steepest_along", "steepest_across", "rollover", "refills", "refilling_s", "folding_s", "charges", "charging_s",
)  # fmt: skip
"""Of the page, shown on request."""
CSV_KEYS = (
    "field", "width_m", "headland_m", "bearing_deg", "price_per_hour", "price_per_tractor", "area_ha", "corners",
)  # fmt: skip


@dataclass(frozen=True)
class Figure:
    """A figure of plans.

    Attributes:
        key: in JSON and CSV, and the attribute of a plan that was measured elsewhere, without `measure` and `read`.
        heading, short_heading: of its column, the latter for narrow consoles; "" for a figure of files only.
        text: prints a value; `write` prints it from the plan, where the value alone does not say it.
        help: what it holds, for the page; `note` the same in brief, below a table; "" where the heading says it.
        unit: follows it where it stands without a heading.
        measure: takes the value from the simulated run of a plan that can be driven and the hectares of the field; it
            is then in `measured`.
        read: takes the value from the plan.
        parts: keys of what it consists of, each of which has a column in CSV.
        is_optional: whether its column is left out where no plan has it, as plans of older files have none of new ones.
    """

    key: str
    heading: str = ""
    short_heading: str = ""
    text: Callable[[Any], str] = str
    help: str = ""
    note: str = ""
    unit: str = ""
    read: Callable[[PlanResult], Any] | None = None
    write: Callable[[PlanResult], str] | None = None
    parts: tuple[str, ...] = ()
    measure: Callable[[SimulationRun, float], float | None] | None = None
    is_text: bool = False
    is_optional: bool = False

    def get_value(self, plan: PlanResult) -> Any:
        """The value of a plan; None where it is not known."""
        if self.read is not None:
            return self.read(plan)
        return getattr(plan, self.key) if self.measure is None else plan.measured.get(self.key)

    def format(self, plan: PlanResult) -> str:
        """The value of a plan as a cell shows it, without its unit."""
        return self.text(self.get_value(plan)) if self.write is None else self.write(plan)

    def format_with_unit(self, plan: PlanResult) -> str:
        """The value of a plan with its unit; a dash where it is not known."""
        text = self.format(plan)
        return text if text == NO_VALUE else f"{text} {self.unit}"

    def build_column(self, drop_order: int = 0) -> TableColumn:
        """Its column on a terminal."""
        return TableColumn(self.heading, self.short_heading, self.is_text, drop_order, is_unbroken=self.is_text)


def _format_slope(place: SlopePlace | None) -> str:
    return _WHOLE(None if place is None else abs(place.amount))


_CATALOGUE = (
    Figure("rank", "Rank", "#", _WHOLE),
    Figure("strategy", "Strategy", is_text=True),
    Figure("tractors", "Tractors", "Trac-\ntors"),
    Figure("turn", "Turn", is_text=True),
    Figure("time_s", "As simulated", "", format_duration, "time without late starts, stops and breakdowns"),
    Figure("tractor_time_s", "Tractor time", "", format_duration,
           "time of all tractors together, from the start to the end of each"),
    Figure("cost"),
    Figure("meets_deadline", "In time", "In\ntime", format_yes_no, "done by the deadline in the simulation",
           is_optional=True),
    Figure("feasible"),
    Figure("worked_pct", "Worked %", "Work\n%", _TENTHS, "share of the field that is worked", "of the field", "%"),
    Figure("overlap_pct", "Overlap %", "Over-\nlap %", _TENTHS, "", "of the field, worked more than once", "%"),
    Figure("missed_m2", "Unworked", "Un-\nworked", format_area, "ground that no implement worked",
           is_optional=True),
    Figure("largest_missed", parts=PIECE_KEYS),
    Figure("finished_s", "To finish", "", format_duration,
           "time with the unworked ground finished too, at the plan's own rate"),
    Figure("finished_cost"),
    Figure("wheel_traffic_m2", text=_WHOLE, unit="m2"),
    Figure("outside_m", "Outside m", "", _HUNDREDTHS, "the farthest that tractor or implement reach beyond the outline",
           unit="m"),
    Figure("outside_along_m", "Outside along m", "", _WHOLE,
           "driven with tractor or implement farther beyond the outline than allowed"),
    Figure("turning_s", "Turning", "Turn-\ning", format_duration, "time in turns, all tractors together",
           "of all tractors together"),
    Figure("waiting_s", "Waiting", "Wait-\ning", format_duration,
           "time spent waiting for others, all tractors together", "of all tractors together"),
    Figure("reversals", "Reversals", "", _WHOLE, "how often a tractor changes between forwards and backwards"),
    Figure("min_clearance_m", "Clearance m", "Clear\nm", _HUNDREDTHS, "",
           "smallest distance between two tractors, implements included", "m", get_clearance_m),
    Figure("collisions", "Collisions", "", _WHOLE, "how often tractors touch each other"),
    Figure("formation_pct", measure=lambda run, area_ha: run.plan.notes.formation_pct),
    Figure("reason"),
    Figure("on_pareto_front", "Pareto front", "", format_yes_no, "no plan with as few tractors is faster"),
    Figure("remark"),
    Figure("headland_passes"),
    Figure("headland_s"),
    Figure("transport_s"),
    Figure("ready_s"),
    Figure("done_s"),
    Figure("home_s"),
    Figure("finish_probability", "In time %", "In\ntime %", help="share of the samples in which it is done in time",
           note="of the samples; a range (95 %) where they are few", unit="%", write=format_in_time_probability,
           is_optional=True),
    Figure("finish_probability_interval", parts=("low", "high")),
    Figure("p50_s"),
    Figure("p80_s"),
    Figure("p95_s"),
    Figure("expected_cost"),
    Figure("paid_cost", "Paid", "", format_price,
           note="of the cost, what is paid; the rest is expected loss on late ground", is_optional=True),
    Figure("bound_s"),
    Figure("refills", "Refills", "Re-\nfills", _WHOLE, is_optional=True),
    Figure("refilling_s", "Refilling", "", format_duration, is_optional=True),
    Figure("folding_s", "Folding", "", format_duration, "of the turns, standing to fold and unfold implements",
           measure=lambda run, area_ha: float(run.folding_s.sum()) or None, is_optional=True),
    Figure("over_finished_m"),
    Figure("over_finished_m2", "Driven over m2", "", _WHOLE, unit="m2"),
    Figure("spoilt_m2", "Spoilt", "Spoilt", format_area,
           note="by wheels: finished ground where it is kept, a crop before it is cut; counted like unworked ground",
           read=get_spoilt_m2, is_optional=True),
    Figure("p50_done_s", "Median time", "Median\ntime", format_duration),
    Figure("p95_done_s", "95 %", "", format_duration),
    Figure("fuel_l", "Fuel l", "", lambda litres: _TENTHS(VOLUME.convert(litres)),
           "litres of all tractors in the field, by the load of the simulated drive", is_optional=True),
    Figure("stated_end_s", "Time", "", format_duration,
           "time to the end of field work, the median of the samples; without samples as simulated",
           read=lambda plan: plan.stated_end_s if plan.feasible else None),
    Figure("stated_late_end_s", "95 %", "", format_duration, "it is done sooner in 95 % of the samples",
           is_optional=True),
    Figure("stated_cost", "Cost", "", format_price,
           "expected cost: what is paid, and the loss on late ground; without samples as simulated"),
    Figure("headland_order"),
    Figure("fuel_l_per_ha", "Fuel l/ha", "", _TENTHS, "litres by hectare of the field", is_optional=True),
    Figure("energy_kwh", "Energy kWh", "", _TENTHS, "from the batteries of all tractors", is_optional=True),
    Figure("co2_kg", "CO2 kg", "", _WHOLE, "of the fuel burnt, or of making the electricity", is_optional=True),
    Figure("fuel_l_by_tractor"),
    Figure("energy_kwh_by_tractor"),
    Figure("steepest_along", "Along %", "", _format_slope, "the steepest slope that a tractor drives up or down",
           parts=SLOPE_KEYS, is_optional=True),
    Figure("steepest_across", "Across %", "", _format_slope, "the steepest slope across the drive of a tractor",
           parts=SLOPE_KEYS, is_optional=True),
    Figure("rollover", "To rolling over", "", _format_slope,
           "degrees that the tractor nearest to rolling over has left", parts=SLOPE_KEYS, is_optional=True),
    Figure("energy_kwh_per_ha", "Energy kWh/ha", "", _TENTHS, "kilowatt-hours by hectare of the field",
           is_optional=True),
    Figure("charges", "Charges", "", _WHOLE, "stops to charge or change batteries", is_optional=True),
    Figure("charging_s", "Charging", "", format_duration, "time of all tractors at these stops", is_optional=True),
    Figure("spared_m2"),
    Figure("left_out_m2", "Left out", "Left\nout", format_area, "ground that was to be left out",
           is_optional=True),
    Figure("keeps_clearance"),
    Figure("is_simulated"),
)  # fmt: skip
FIGURES = {figure.key: figure for figure in _CATALOGUE}
MEASURES = {figure.key: figure.measure for figure in _CATALOGUE if figure.measure is not None}
PLAN_KEYS = tuple(FIGURES)
"""Of a plan in JSON and CSV, in this order."""


def choose_figures(
    ranking: PlanRanking, plans: Sequence[PlanResult], keys: Iterable[str], *, is_brief: bool = False
) -> list[Figure]:
    """The figures of some keys for a table of plans, as the reader of a ranking wants them.

    Optional ones that no plan has are left out, that of the deadline where there are probabilities, and what is paid
    where it is the cost. Unless it `is_brief`, costs have their currency, and ends of work are clock times where the
    ranking has a start.
    """
    skipped = set() if has_late_ground_loss(ranking) else {"paid_cost"}
    if any(plan.finish_probability is not None for plan in plans):
        skipped.add("meets_deadline")
    shown = [
        figure
        for figure in (FIGURES[key] for key in keys if key not in skipped)
        if not figure.is_optional or any(figure.get_value(plan) is not None for plan in plans)
    ]
    return [fit_to_ranking(figure, ranking, is_brief=is_brief) for figure in shown]


def fit_to_ranking(figure: Figure, ranking: PlanRanking, *, is_brief: bool = False) -> Figure:
    """A figure with the currency, the clock times and the stops of a ranking; see `choose_figures`."""
    if figure.key in ("fuel_l", "energy_kwh"):
        heading = name_energy_column(figure.key == "energy_kwh")
        return replace(figure, heading=heading, short_heading=heading.replace(" ", "\n"))
    if figure.key in UNLOADING_HEADINGS and ranking.unloads:
        return replace(figure, heading=UNLOADING_HEADINGS[figure.key], short_heading="")
    if is_brief or figure.key not in ("stated_cost", "stated_end_s", "stated_late_end_s"):
        return figure
    if figure.key == "stated_cost":
        heading = translate("Cost {currency}", currency=ranking.currency) if ranking.currency else figure.heading
        return replace(figure, heading=heading)
    figure = replace(figure, text=partial(format_stated_end, ranking))
    if figure.key == "stated_late_end_s" or not has_start_time(ranking):
        return figure
    help_text = "end of field work, the median of the samples; without samples as simulated"
    return replace(figure, heading=translate("Done"), help=help_text)


def build_figure_table(
    ranking: PlanRanking,
    plans: Sequence[PlanResult],
    figures: Sequence[Figure],
    drops: Mapping[str, int],
    more_hint: str,
    notes: Sequence[str],
    *,
    stars: bool = False,
) -> FittedTable:
    """A line per plan, the best in bold and marked; with `stars` those of the Pareto front have one.

    `drops` are by key of the figures.
    """

    def write_first(plan: PlanResult) -> str:
        star = ("*" if plan.on_pareto_front else " ") if stars else ""
        return f"{'>' if plan is ranking.best else ''}{figures[0].format(plan)}{star}"

    writers = [write_first, *(figure.format for figure in figures[1:])]
    columns = [figure.build_column(drops[figure.key]) for figure in figures]
    cells = list(zip(columns, writers, strict=True))
    return build_table(plans, cells, lambda plan: plan is ranking.best, more_hint=more_hint, notes=tuple(notes))


def format_ranking_json(ranking: PlanRanking) -> str:
    """The ranking as JSON text with a trailing newline; the reference of the guide lists the keys.

    Figures that are missing or not finite are null.
    """
    return format_json(build_ranking_entry(ranking), EXPORT_DECIMALS, is_ascii=False)


def build_ranking_entry(ranking: PlanRanking) -> dict[str, Any]:
    """The ranking as plain values, as `format_ranking_json` writes it."""

    def build_entry(plan: PlanResult) -> dict[str, Any]:
        return {**build_plan_entry(plan), "cells": ranking.scenario.get("cells")}

    best, pull = ranking.best, ranking.pull
    shortfalls = [{"kind": one.kind, "sentence": describe_shortfall(ranking, one)} for one in ranking.shortfalls]
    unmet = " ".join(one["sentence"] for one in shortfalls if one["kind"] != "late")
    summary = write_answer(ranking).list_sentences()
    return {
        "field": {"name": ranking.field_name, "area_ha": ranking.area_ha},
        "seed": ranking.seed,
        "plans": [build_entry(plan) for plan in ranking.plans],
        "best": None if best is None else build_entry(best),
        **pick_values(ranking, ("tractor_effects", "scenario")),
        "advice": None
        if best is None or best.expected_cost is None
        else " ".join(f"{each.rstrip('.')}." for each in summary),
        **pick_values(ranking, ("currency", "samples", "prices_assumed")),
        "unmet": unmet or None,
        "shortfalls": shortfalls,
        "parts": [build_part_entry(part) for part in ranking.parts],
        "pull": None
        if pull is None
        else {
            **make_json_safe(pull, 2),
            "questioned": pull.is_questioned,
            "feasible": not pull.is_infeasible,
            "question": question_pull(pull) or None,
        },
        "remarks": list(ranking.field_remarks),
        "ground": list(ranking.ground_sentences),
        "summary": summary,
    }


def build_part_entry(part: FieldPartPlan) -> dict[str, Any]:
    """A part of the field that is cut off, with its own plan."""
    return {
        "number": part.number,
        "ground": make_json_safe(pick_values(part.ground, PIECE_KEYS), EXPORT_DECIMALS),
        "neck": make_json_safe(pick_values(part.neck, PIECE_KEYS), EXPORT_DECIMALS),
        "neck_width_m": round(part.neck_width_m, 2),
        "plan": None if part.plan is None else build_plan_entry(part.plan),
        "reason": part.reason,
    }


def build_plan_entry(plan: PlanResult) -> dict[str, Any]:
    """One plan with the keys of `PLAN_KEYS`; ``min_clearance_m`` is None for one tractor.

    ``largest_missed`` has `PIECE_KEYS`: area, degrees (null for a field in local metres) and metres of the field; it is
    null where nothing is missed. ``steepest_along``, ``steepest_across`` (percent) and ``rollover`` (degrees left) have
    `SLOPE_KEYS`; they are null on level ground.
    """
    entry = {}
    for key in PLAN_KEYS:
        value = FIGURES[key].get_value(plan)
        value = pick_values(value, FIGURES[key].parts) if is_dataclass(value) else value
        entry[key] = make_json_safe(value, EXPORT_DECIMALS)
    return entry


def format_ranking_csv(ranking: PlanRanking) -> str:
    """The plans as CSV text: a header of `list_csv_columns`, then one row per plan in the order of the ranking.

    `CSV_KEYS` are of the request, the same on every row, so that tables of several fields can be joined. The largest
    missed piece has a column for each of its keys (``largest_missed_m2``), an interval one for each end
    (``finish_probability_interval_low``).
    """
    return format_csv(list_csv_columns(), list_csv_entries(ranking, ranking.field_name))


def list_csv_columns() -> list[str]:
    """The columns of plans as CSV: `FIRST_CSV_KEYS`, then the other keys of plan and request."""
    names = [*flatten_entry(dict.fromkeys(PLAN_KEYS)), *CSV_KEYS]
    return [*FIRST_CSV_KEYS, *(name for name in names if name not in FIRST_CSV_KEYS)]


def list_csv_entries(ranking: PlanRanking, field_name: Any) -> list[dict[str, Any]]:
    """Every plan with what CSV has of its request, which calls the field so."""
    values = {**ranking.scenario, "field": field_name, "area_ha": ranking.area_ha}
    of_request = {key: values.get(key) for key in CSV_KEYS}
    return [{**of_request, **flatten_entry(build_plan_entry(plan))} for plan in ranking.plans]


def flatten_entry(entry: dict[str, Any]) -> dict[str, Any]:
    """The entry of a plan with a key for each value of its places and each end of its interval.

    Values by tractor are one text, separated by spaces.
    """
    flattened: dict[str, Any] = {}
    for key, value in entry.items():
        parts = FIGURES[key].parts if key in FIGURES else ()
        if parts:
            values = value.values() if isinstance(value, dict) else value or [None] * len(parts)
            flattened |= {f"{key}_{part}": one for part, one in zip(parts, values, strict=True)}
        else:
            flattened[key] = (" ".join(map(str, value)) or None) if isinstance(value, list) else value
    return flattened
