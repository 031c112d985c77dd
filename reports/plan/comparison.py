"""Requests compared: what planning each came to, with the way in which it differs from the others.

Ways to work the headland of one field or several are compared by sums over fields, the best way first. The cost per
hectare is that of worked ground: ground that a plan misses is charged at the plan's own rate, and so is what wheels
spoil.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import PurePath
from typing import Any

from reports.common.language import translate, translate_count, translate_sentence
from reports.common.plan_records import UnworkedPiece
from reports.common.plan_results import FieldPartPlan, PlanRanking, PlanResult
from reports.common.wording import format_area, format_width
from reports.plan.answer import write_answer
from reports.plan.map_data import SmallMap
from reports.plan.plan_wording import describe_part, format_ground_place

HEADLAND_KEYS = ("corners", "headland_order", "headland_passes", "width_m")
YEAR_KEYS = ("hours_per_year", "fuel_l_per_year", "energy_kwh_per_year", "cost_per_year")


@dataclass(frozen=True)
class ComparedWay:
    """In what a request may differ from others: parameters as it has them; None where it leaves them open.

    They are the kind of corners, "first" or "last", passes and width, the bearing, and the form of swaths, straight or
    along contours.
    """

    corners: str
    headland_order: str | None
    headland_passes: int | None
    width_m: float
    bearing_deg: float | None = None
    swaths: str = "straight"


@dataclass(frozen=True, eq=False)
class ComparisonRow:
    """What one request came to: the ranking of its plans, or the `refusal`, a sentence.

    `requested_field` is the field as named in the request; `map`, a small map of the best plan, is there where it was
    asked for.
    """

    requested_field: str
    way: ComparedWay
    ranking: PlanRanking | None = None
    refusal: str | None = None
    map: SmallMap | None = field(default=None, repr=False)

    @cached_property
    def best(self) -> PlanResult | None:
        """The best plan; None where there is none that its tractor can pull."""
        return self.ranking.best if self.ranking is not None and self.ranking.eligible else None

    @property
    def reason(self) -> str | None:
        """Why there is no plan; None where there is one."""
        if self.ranking is None or self.best is not None:
            return self.refusal
        return write_answer(self.ranking).verdict

    @property
    def field_name(self) -> str:
        """The field as its file names it, else the last part of the requested name."""
        return PurePath(self.requested_field).name if self.ranking is None else self.ranking.field_name

    @property
    def area_ha(self) -> float:
        """Hectares of the field; 0 where it was refused."""
        return 0.0 if self.ranking is None else self.ranking.area_ha

    @property
    def meets_request(self) -> bool:
        """False where the plan is no recommendation: for deadline, rain, budget, share worked or pull."""
        return self.ranking is None or self.ranking.is_recommended

    @property
    def parts(self) -> tuple[FieldPartPlan, ...]:
        """Further parts of a divided field, each with a plan of its own."""
        return () if self.ranking is None else self.ranking.parts

    @property
    def cut_off(self) -> UnworkedPiece | None:
        """All ground that obstacles cut off; None without any."""
        return None if self.ranking is None else self.ranking.cut_off

    def get_planned(self, key: str) -> Any:
        """A value of the request as it was planned with, such as the bearing that was chosen; None without a layout."""
        return None if self.ranking is None else self.ranking.scenario.get(key)

    def get_figure(self, key: str) -> Any:
        """A figure of the best plan; None without a plan."""
        return None if self.best is None else getattr(self.best, key)


@dataclass(frozen=True, eq=False)
class ComparisonTotals:
    """Sums over the requests of one way: of their best plans, where there are any.

    `names_width` says that other ways have another working width. In a year every field is worked
    `operations_per_year` times.
    """

    way: ComparedWay
    rows: tuple[ComparisonRow, ...]
    names_width: bool = False
    operations_per_year: int = 1

    @cached_property
    def driven(self) -> tuple[PlanResult, ...]:
        """The plans of the fields that have one."""
        return tuple(row.best for row in self.rows if row.best is not None)

    @property
    def is_complete(self) -> bool:
        """Whether every field has a plan."""
        return len(self.driven) == len(self.rows)

    @property
    def area_ha(self) -> float:
        """Hectares of the fields that have a plan."""
        return math.fsum(row.area_ha for row in self.rows if row.best is not None)

    @property
    def end_s(self) -> float:
        """Seconds until all fields are done, one after the other."""
        return math.fsum(plan.stated_end_s for plan in self.driven)

    @property
    def time_s(self) -> float:
        """Seconds of field work, one field after the other; roads, preparation, breaks and nights do not count.

        On a farm, where a plan has a `ready_s`, its end by the clock would have them too.
        """
        return sum(plan.stated_end_s if plan.ready_s is None else plan.stated_s for plan in self.driven)

    @property
    def cost(self) -> float:
        """The stated costs."""
        return math.fsum(plan.stated_cost or 0.0 for plan in self.driven)

    @property
    def paid_cost(self) -> float:
        """The costs that are paid, without losses on late ground: all of the stated ones without samples."""
        costs = (plan.stated_cost if plan.paid_cost is None else plan.paid_cost for plan in self.driven)
        return math.fsum(cost or 0.0 for cost in costs)

    @property
    def risked_cost(self) -> float:
        """Expected loss on late ground, which nobody pays."""
        return self.cost - self.paid_cost

    @property
    def charged_cost(self) -> float:
        """The costs with missed ground finished at each plan's own rate, by which ways are compared."""
        return sum(plan.ranked_cost for plan in self.driven)

    @property
    def cost_per_ha(self) -> float | None:
        """The cost of a worked hectare."""
        return self.charged_cost / self.area_ha if self.driven else None

    @property
    def charged_cost_per_year(self) -> float:
        """The costs of a year with missed ground finished."""
        return self.operations_per_year * self.charged_cost

    @property
    def missed_m2(self) -> float:
        """Ground that is not worked."""
        return math.fsum(plan.missed_m2 or 0.0 for plan in self.driven)

    @property
    def worked_pct(self) -> float:
        """Share of the ground that is worked, percent."""
        return 100.0 - 0.01 * self.missed_m2 / self.area_ha

    @property
    def overlap_m2(self) -> float:
        """Ground worked more than once."""
        return sum(100.0 * (row.get_figure("overlap_pct") or 0.0) * row.area_ha for row in self.rows)

    @property
    def over_finished_m2(self) -> float:
        """Finished ground under wheels, headland included."""
        return math.fsum(plan.over_finished_m2 or 0.0 for plan in self.driven)

    @property
    def cut_off_m2(self) -> float:
        """Ground that the plans do not reach."""
        return sum(
            sum(part.ground.m2 for part in row.parts) or (row.cut_off.m2 if row.cut_off else 0.0) for row in self.rows
        )

    @property
    def fuel_l(self) -> float | None:
        """Litres of fuel; None where they are not known of every plan."""
        return _sum_known(plan.fuel_l for plan in self.driven)

    @property
    def energy_kwh(self) -> float | None:
        """Kilowatt-hours of electric tractors; None where they are not known of every plan."""
        return _sum_known(plan.energy_kwh for plan in self.driven)

    @cached_property
    def year(self) -> dict[str, float | None]:
        """Hours of field work, fuel, electricity and what is paid in a year; None where they are not known."""
        sums = (self.time_s / 3600.0, self.fuel_l, self.energy_kwh, self.paid_cost)
        values = [self.operations_per_year * one if self.driven and one is not None else None for one in sums]
        return dict(zip(YEAR_KEYS, values, strict=True))


@dataclass(frozen=True, eq=False)
class Comparison:
    """Requests compared, in the order asked for."""

    rows: tuple[ComparisonRow, ...]
    operations_per_year: int = 1

    @cached_property
    def ways(self) -> tuple[ComparedWay, ...]:
        """What was compared, each once."""
        return tuple(dict.fromkeys(row.way for row in self.rows))

    @cached_property
    def fields(self) -> tuple[str, ...]:
        """The fields as requested, each once."""
        return tuple(dict.fromkeys(row.requested_field for row in self.rows))

    @cached_property
    def field_names(self) -> Mapping[str, str]:
        """The fields as their files name them, by their names in the request."""
        names = {each.requested_field: each.field_name for each in self.rows}
        return names | {each.requested_field: each.field_name for each in self.rows if each.ranking is not None}

    @property
    def currency(self) -> str:
        """The currency of the costs; "" where none is known."""
        return next((row.ranking.currency for row in self.rows if row.ranking and row.ranking.currency), "")

    def find_least(self, key: str) -> ComparisonRow | None:
        """The row whose best plan has the least of a figure; None where no row has it."""
        values = [row.get_figure(key) for row in self.rows]
        known = [(value, number) for number, value in enumerate(values) if value is not None]
        return self.rows[min(known)[1]] if known else None

    def sum_over_fields(self, rows: Iterable[ComparisonRow] | None = None) -> list[ComparisonTotals]:
        """Totals of all or some rows by way, in the order asked for."""
        by_way: dict[ComparedWay, list[ComparisonRow]] = {}
        for each in self.rows if rows is None else rows:
            by_way.setdefault(each.way, []).append(each)
        has_widths = len({way.width_m for way in self.ways}) > 1
        return [
            ComparisonTotals(way, tuple(some), has_widths, self.operations_per_year) for way, some in by_way.items()
        ]

    @cached_property
    def totals(self) -> list[ComparisonTotals]:
        """One entry per way: those that work everywhere by cost, then those that work on most fields."""
        return sorted(self.sum_over_fields(), key=_get_merit)

    @cached_property
    def totals_by_field(self) -> Mapping[str, list[ComparisonTotals]]:
        """The ways on each field, the best first."""
        return {
            name: sorted(
                self.sum_over_fields(each for each in self.rows if each.requested_field == name), key=_get_merit
            )
            for name in self.fields
        }

    @cached_property
    def best(self) -> ComparisonTotals | None:
        """The cheapest way that works on every field that any way works on; None where no plan works."""
        workable = {each.requested_field for each in self.rows if each.best is not None}
        first = self.totals[0] if self.totals else None
        return first if first is not None and workable and len(first.driven) == len(workable) else None


def _get_merit(totals: ComparisonTotals) -> tuple[int, float, float]:
    """Sort key of ways: on how many fields they work, cost, time."""
    return -len(totals.driven), round(totals.charged_cost, 6), totals.time_s


def _sum_known(amounts: Iterable[float | None]) -> float | None:
    """The sum; None where there is nothing, or something is not known."""
    known = list(amounts)
    return sum(one for one in known if one is not None) if known and None not in known else None


def name_choice(totals: ComparisonTotals) -> str:
    """``square, first, 3 passes, 6 m``, with what planning chose where the request left it open."""
    parts = [totals.way.corners, _name_order(totals), _name_passes(totals), _name_width(totals)]
    return ", ".join(part for part in parts if part)


def describe_choice(totals: ComparisonTotals) -> str:
    """``square corners, headland first, 3 passes``."""
    corners = translate("{corners} corners", corners=totals.way.corners)
    order = _name_order(totals)
    headland = translate("headland {order}", order=order) if order else ""
    parts = [corners, headland, _name_passes(totals), _name_width(totals)]
    return ", ".join(part for part in parts if part)


def _name_order(totals: ComparisonTotals) -> str:
    orders = sorted({plan.headland_order for plan in totals.driven if plan.headland_order})
    return totals.way.headland_order or "/".join(orders)


def _name_width(totals: ComparisonTotals) -> str:
    return format_width(totals.way.width_m) if totals.names_width else ""


def _name_passes(totals: ComparisonTotals) -> str:
    planned = sorted({plan.headland_passes for plan in totals.driven if plan.headland_passes})
    passes = totals.way.headland_passes
    counts = planned if passes is None else [passes]
    if not counts:
        return ""
    if counts[0] == counts[-1]:
        return translate_count("{count} pass", "{count} passes", counts[0])
    return translate("{least}-{most} passes", least=counts[0], most=counts[-1])


def list_missing(comparison: Comparison) -> list[str]:
    """A sentence for every reason why a way has no plan on a field."""
    ways_by_reason: dict[tuple[str, str], list[str]] = {}
    for name, totals in comparison.totals_by_field.items():
        for one in totals:
            if not one.driven:
                reason = (one.rows[0].reason or translate("no plan is feasible")).rstrip(".")
                ways_by_reason.setdefault((name, reason), []).append(name_choice(one))
    names = comparison.field_names
    count = len(comparison.ways)
    return [
        f"{names[field]}: {translate('every way') if len(ways) == count > 1 else '; '.join(ways)}: {reason}."
        for (field, reason), ways in ways_by_reason.items()
    ]


def list_cut_off(comparison: Comparison) -> list[str]:
    """A sentence for every part of a field that is cut off, why and what would work it, and where nothing is.

    It is said at every width by its best way.
    """
    sentences = []
    for name, totals in comparison.totals_by_field.items():
        best_by_width = {one.way.width_m: one for one in reversed(totals) if one.driven}
        texts_by_way = {}
        for _, one in sorted(best_by_width.items()):
            label = ", ".join(filter(None, (comparison.field_names[name], _name_width(one))))
            parts, cut_off = one.rows[0].parts, one.rows[0].cut_off
            texts_by_way[label] = [translate_sentence(describe_part(part)) for part in parts]
            if cut_off is not None and not parts:
                text = translate(
                    "Obstacles cut off {area}, the most at {place}: too small or too narrow for a plan of its own. A "
                    "smaller --margin may open a way.",
                    area=format_area(cut_off.m2),
                    place=format_ground_place(cut_off),
                )
                texts_by_way[label].append(text)
        if any(texts_by_way.values()):
            whole = [translate("nothing is cut off.")]
            sentences += [f"{label}: {text}" for label, texts in texts_by_way.items() for text in texts or whole]
    return sentences
