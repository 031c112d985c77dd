"""Requests compared: what planning each came to, under the label that says in what it differs from the others."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import PurePath
from typing import Any, Generic, TypeVar

from reports.common.plan_results import PlanRanking, PlanResult
from reports.common.shortfalls import UnworkedPiece
from reports.plan.small_map import SmallMap

Label = TypeVar("Label")


@dataclass(frozen=True)
class LayoutFigures:
    """What a comparison shows of a layout.

    `cut_off` is all ground that obstacles cut off, at the place of its largest piece. `cross_slope_pct` is the largest
    slope across swaths, `erosion_share` the share of their metres near the fall line of steeper ground; both are None
    where no heights are known.
    """

    headland_m: float
    bearing_deg: float
    cut_off: UnworkedPiece | None = None
    cross_slope_pct: float | None = None
    erosion_share: float | None = None


@dataclass(frozen=True, eq=False)
class ComparisonRow(Generic[Label]):
    """What one request came to: the ranking of its plans, or the `refusal`, a sentence.

    `requested_field` is the field as named in the request; `layout` and `map`, a small map of the best plan, are there
    where they were asked for.
    """

    requested_field: str
    label: Label
    ranking: PlanRanking | None = None
    refusal: str | None = None
    layout: LayoutFigures | None = None
    map: SmallMap | None = field(default=None, repr=False)

    @cached_property
    def best(self) -> PlanResult | None:
        """The best plan; None where there is none."""
        return None if self.ranking is None else self.ranking.best

    @property
    def reason(self) -> str | None:
        """Why there is no plan; None where there is one."""
        if self.ranking is None or self.best is not None:
            return self.refusal
        return self.ranking.refusal

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
    def charged_cost(self) -> float:
        """The stated cost with missed ground finished at the plan's own rate; 0 without a plan."""
        return 0.0 if self.best is None else self.best.ranked_cost

    @property
    def overlap_m2(self) -> float:
        """Ground worked more than once."""
        return 100.0 * ((self.best and self.best.overlap_pct) or 0.0) * self.area_ha

    @property
    def cut_off_m2(self) -> float:
        """Ground that the plan does not reach."""
        parts = () if self.ranking is None else self.ranking.parts
        cut_off = None if self.layout is None else self.layout.cut_off
        return sum(part.ground.m2 for part in parts) or (0.0 if cut_off is None else cut_off.m2)

    def get_figure(self, key: str) -> Any:
        """A figure of the best plan; None without a plan."""
        return None if self.best is None else getattr(self.best, key)


@dataclass(frozen=True, eq=False)
class ComparisonTotals(Generic[Label]):
    """Sums over the requests of one label: of their best plans, where there are any."""

    label: Label
    rows: tuple[ComparisonRow[Label], ...]

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
    def cost(self) -> float:
        """The stated costs."""
        return math.fsum(plan.stated_cost or 0.0 for plan in self.driven)

    @property
    def paid_cost(self) -> float:
        """The costs that are paid, without losses on late ground."""
        return math.fsum(plan.stated_paid_cost or 0.0 for plan in self.driven)

    @property
    def missed_m2(self) -> float:
        """Ground that is not worked."""
        return math.fsum(plan.missed_m2 or 0.0 for plan in self.driven)

    @property
    def over_finished_m2(self) -> float:
        """Finished ground under wheels, headland included."""
        return math.fsum(plan.over_finished_m2 or 0.0 for plan in self.driven)


@dataclass(frozen=True, eq=False)
class Comparison(Generic[Label]):
    """Requests compared, in the order asked for."""

    rows: tuple[ComparisonRow[Label], ...]

    @cached_property
    def labels(self) -> tuple[Label, ...]:
        """What was compared, each once."""
        return tuple(dict.fromkeys(row.label for row in self.rows))

    @cached_property
    def fields(self) -> tuple[str, ...]:
        """The fields as requested, each once."""
        return tuple(dict.fromkeys(row.requested_field for row in self.rows))

    @property
    def currency(self) -> str:
        """The currency of the costs; "" where none is known."""
        return next((row.ranking.currency for row in self.rows if row.ranking and row.ranking.currency), "")

    def find_least(self, key: str) -> ComparisonRow[Label] | None:
        """The row whose best plan has the least of a figure; None where no row has it."""
        values = [row.get_figure(key) for row in self.rows]
        known = [(value, number) for number, value in enumerate(values) if value is not None]
        return self.rows[min(known)[1]] if known else None
