"""Bearings of one field side by side: time, fuel, slope and erosion of each, as a table and as JSON."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from reports.common.language import translate
from reports.common.plan_results import PlanResult
from reports.common.rendering import EXPORT_DECIMALS, format_json
from reports.common.text_tables import FittedTable, TableColumn, format_sentence
from reports.common.units import VOLUME
from reports.common.wording import NO_VALUE, format_duration, format_number
from reports.plan.energy_wording import format_energy, format_energy_cell, name_energy_column

CONTOUR = "contour"


@dataclass(frozen=True)
class BearingRow:
    """One bearing, or swaths along contours, with its best plan or the reason why there is none.

    `requested_deg` is None where planning chose, `bearing_deg` is that of the layout. `cross_slope_pct` is the largest
    slope across swaths; headland passes run in all directions. `erosion_share` is the share of swath metres near the
    fall line of steeper ground. `is_chosen` marks the bearing that a plan has by itself.
    """

    requested_deg: float | None
    form: str
    bearing_deg: float | None = None
    cross_slope_pct: float | None = None
    erosion_share: float | None = None
    plan: PlanResult | None = None
    reason: str | None = None
    is_chosen: bool = False

    @property
    def time_s(self) -> float | None:
        """Seconds until the field is worked, missed ground included."""
        return None if self.plan is None else self.plan.finished_s

    def get_figure(self, key: str) -> Any:
        """A figure of the plan; None without a plan."""
        return None if self.plan is None else getattr(self.plan, key)

    @property
    def rollover_deg(self) -> float | None:
        """The least margin to rolling over, degrees; None where the tractor file does not tell."""
        place = self.get_figure("rollover")
        return None if place is None else place.amount


@dataclass(frozen=True)
class BearingComparison:
    """Bearings of one field in the order asked for."""

    field: str
    rows: tuple[BearingRow, ...]

    def find_least(self, key: str) -> BearingRow | None:
        """The row whose plan has the least of a figure; None where no row has it."""
        values = [row.get_figure(key) for row in self.rows]
        known = [(value, number) for number, value in enumerate(values) if value is not None]
        return self.rows[min(known)[1]] if known else None


def name_row(row: BearingRow) -> str:
    """A bearing in words."""
    if row.form == CONTOUR:
        return translate("along contours")
    bearing = row.bearing_deg if row.requested_deg is None else row.requested_deg
    degrees = NO_VALUE if bearing is None else f"{format_number(bearing, 0)}°"
    return translate("{bearing} (chosen)", bearing=degrees) if row.is_chosen else degrees


def describe_bearings(comparison: BearingComparison) -> list[str]:
    """Which bearing is quickest, and which takes least fuel."""
    quickest = comparison.find_least("finished_s")
    if quickest is None:
        return [translate("No bearing works; the reasons are below.")]
    time = format_duration(quickest.time_s)
    sentences = [translate("Quickest is {bearing}: {time}.", bearing=name_row(quickest), time=time)]
    thriftiest = comparison.find_least("fuel_l")
    if thriftiest is not None:
        fuel = VOLUME.format(thriftiest.get_figure("fuel_l"), 1)
        sentences.append(translate("Least fuel takes {bearing}: {fuel}.", bearing=name_row(thriftiest), fuel=fuel))
    thriftiest = comparison.find_least("energy_kwh")
    if thriftiest is not None and thriftiest.plan is not None:
        energy = format_energy(thriftiest.plan)
        sentences.append(
            translate("Least energy takes {bearing}: {energy}.", bearing=name_row(thriftiest), energy=energy)
        )
    return sentences


def build_bearing_table(comparison: BearingComparison) -> RenderableType:
    """The answer, one line per bearing, and why some have no plan."""
    first, *others = describe_bearings(comparison)
    quickest = comparison.find_least("finished_s")
    columns = (
        TableColumn(translate("Bearing"), is_text=True, is_unbroken=True),
        TableColumn(translate("Time")),
        TableColumn(name_energy_column([row.plan for row in comparison.rows if row.plan is not None])),
        TableColumn(translate("Cross slope %")),
        TableColumn(translate("To roll-over °")),
        TableColumn(translate("Erosion %")),
    )
    rows = tuple(
        (
            name_row(row),
            format_duration(row.time_s),
            NO_VALUE if row.plan is None else format_energy_cell(row.plan),
            format_number(row.cross_slope_pct, 1),
            format_number(row.rollover_deg, 0),
            format_number(None if row.erosion_share is None else 100.0 * row.erosion_share, 0),
        )
        for row in comparison.rows
    )
    styles = tuple("bold" if row is quickest else "" for row in comparison.rows)
    erosion = translate(
        "Erosion: share of track metres within 10 degrees of the fall line on slopes over 5 %, a convention of "
        "Headland. Time: with missed ground finished."
    )
    missing = [f"{name_row(row)}: {row.reason}" for row in comparison.rows if row.reason]
    return Group(
        format_sentence(first, style="bold"),
        *map(format_sentence, others),
        Text(""),
        FittedTable(columns, rows, styles),
        format_sentence(erosion, style="dim"),
        *map(format_sentence, missing),
    )


def format_bearing_json(comparison: BearingComparison) -> str:
    """The comparison as JSON text with a trailing newline.

    Keys: ``field`` and ``bearings``, each with ``requested_deg``, ``form``, ``bearing_deg``, ``is_chosen``, ``time_s``,
    ``fuel_l``, ``energy_kwh``, ``cross_slope_pct``, ``rollover_deg``, ``erosion_share``, ``missed_m2``, ``strategy``
    and ``reason``.
    """
    first_keys = ("requested_deg", "form", "bearing_deg", "is_chosen", "time_s")
    last_keys = ("cross_slope_pct", "rollover_deg", "erosion_share", "reason")
    rows = [
        {key: getattr(row, key) for key in first_keys}
        | {key: row.get_figure(key) for key in ("fuel_l", "energy_kwh")}
        | {key: getattr(row, key) for key in last_keys}
        | {key: row.get_figure(key) for key in ("missed_m2", "strategy")}
        for row in comparison.rows
    ]
    return format_json({"field": comparison.field, "bearings": rows}, EXPORT_DECIMALS, is_ascii=False)
