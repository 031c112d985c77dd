"""Bearings of one field side by side: time, fuel, slope and erosion of each, as a table and as JSON."""

from __future__ import annotations

from collections.abc import Callable

from rich.console import Group, RenderableType
from rich.text import Text

from reports.common.language import translate
from reports.common.rendering import EXPORT_DECIMALS, format_json
from reports.common.text_tables import TableColumn, build_table, format_sentence
from reports.common.wording import NO_VALUE, VOLUME, format_duration, format_number
from reports.plan.comparison import Comparison, ComparisonRow
from reports.plan.figures import FIGURES
from reports.plan.plan_wording import format_energy, name_energy_column

CONTOUR = "contour"


def _is_chosen(row: ComparisonRow) -> bool:
    """Whether a plan has the bearing of a row by itself."""
    return row.way.bearing_deg is None and row.way.swaths != CONTOUR


def name_row(row: ComparisonRow) -> str:
    """A bearing in words."""
    if row.way.swaths == CONTOUR:
        return translate("along contours")
    is_chosen = _is_chosen(row)
    bearing = row.get_planned("bearing_deg") if is_chosen else row.way.bearing_deg
    degrees = NO_VALUE if bearing is None else f"{format_number(bearing, 0)}°"
    return translate("{bearing} (chosen)", bearing=degrees) if is_chosen else degrees


def _get_slope_figure(row: ComparisonRow, key: str) -> float | None:
    return None if row.ranking is None else getattr(row.ranking, key)


def _get_rollover_deg(row: ComparisonRow) -> float | None:
    """The least margin to rolling over, degrees; None where the tractor file does not tell."""
    place = row.get_figure("rollover")
    return None if place is None else place.amount


def describe_bearings(comparison: Comparison) -> list[str]:
    """Which bearing is quickest, and which takes least fuel."""
    quickest = comparison.find_least("finished_s")
    if quickest is None:
        return [translate("No bearing works; the reasons are below.")]
    time = format_duration(quickest.get_figure("finished_s"))
    sentences = [translate("Quickest is {bearing}: {time}.", bearing=name_row(quickest), time=time)]
    thriftiest = comparison.find_least("fuel_l")
    if thriftiest is not None:
        fuel = VOLUME.format(thriftiest.get_figure("fuel_l"), 1)
        sentences.append(translate("Least fuel takes {bearing}: {fuel}.", bearing=name_row(thriftiest), fuel=fuel))
    thriftiest = comparison.find_least("energy_kwh")
    if thriftiest is not None and thriftiest.best is not None:
        energy = format_energy(thriftiest.best)
        sentences.append(
            translate("Least energy takes {bearing}: {energy}.", bearing=name_row(thriftiest), energy=energy)
        )
    return sentences


def build_bearing_table(comparison: Comparison) -> RenderableType:
    """The answer, one line per bearing, and why some have no plan."""
    first, *others = describe_bearings(comparison)
    quickest = comparison.find_least("finished_s")
    energy = FIGURES["fuel_l" if comparison.find_least("energy_kwh") is None else "energy_kwh"]
    figures: list[tuple[TableColumn, Callable[[ComparisonRow], str]]] = [
        (TableColumn(translate("Bearing"), is_text=True, is_unbroken=True), name_row),
        (TableColumn(translate("Time")), lambda row: format_duration(row.get_figure("finished_s"))),
        (TableColumn(name_energy_column(energy.key == "energy_kwh")),
         lambda row: NO_VALUE if row.best is None else energy.format(row.best)),
        (TableColumn(translate("Cross slope %")),
         lambda row: format_number(_get_slope_figure(row, "cross_slope_pct"), 1)),
        (TableColumn(translate("To roll-over °")), lambda row: format_number(_get_rollover_deg(row), 0)),
        (TableColumn(translate("Erosion %")),
         lambda row: NO_VALUE if (share := _get_slope_figure(row, "erosion_share")) is None
         else format_number(100.0 * share, 0)),
    ]  # fmt: skip
    erosion = translate(
        "Erosion: share of track metres within 10 degrees of the fall line on slopes over 5 %, a convention of "
        "Headland. Time: with missed ground finished."
    )
    missing = [f"{name_row(row)}: {row.reason}" for row in comparison.rows if row.reason]
    return Group(
        format_sentence(first, style="bold"),
        *map(format_sentence, others),
        Text(""),
        build_table(comparison.rows, figures, lambda row: row is quickest, notes=(erosion,)),
        *map(format_sentence, missing),
    )


def format_bearing_json(comparison: Comparison) -> str:
    """The comparison as JSON text with a trailing newline.

    Keys: ``field`` and ``bearings``, each with ``requested_deg``, ``form``, ``bearing_deg``, ``is_chosen``, ``time_s``,
    ``fuel_l``, ``energy_kwh``, ``cross_slope_pct``, ``rollover_deg``, ``erosion_share``, ``missed_m2``, ``strategy``
    and ``reason``.
    """
    rows = [
        {
            "requested_deg": row.way.bearing_deg,
            "form": row.way.swaths,
            "bearing_deg": row.get_planned("bearing_deg"),
            "is_chosen": _is_chosen(row),
            "time_s": row.get_figure("finished_s"),
            "fuel_l": row.get_figure("fuel_l"),
            "energy_kwh": row.get_figure("energy_kwh"),
            "cross_slope_pct": _get_slope_figure(row, "cross_slope_pct"),
            "rollover_deg": _get_rollover_deg(row),
            "erosion_share": _get_slope_figure(row, "erosion_share"),
            "reason": row.reason,
            "missed_m2": row.get_figure("missed_m2"),
            "strategy": row.get_figure("strategy"),
        }
        for row in comparison.rows
    ]
    return format_json({"field": comparison.rows[0].requested_field, "bearings": rows}, EXPORT_DECIMALS, is_ascii=False)
