"""The result of a sweep: the plans of many combinations of options, which of them nothing beats, and what matters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import product
from math import comb
from typing import Any

import numpy as np
import numpy.typing as npt

from reports.common.notebook import ShownResult
from reports.common.plan_results import PlanResult, choose_plan

MOST_ROWS = 20  # of a table
Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class SweptOption:
    """An option that a sweep varies: its name in files (`width_m`, `speed_kmh`), as an option, and its values.

    `label` and `unit` are what people call it.
    """

    key: str
    flag: str
    values: tuple[Any, ...]
    label: str
    unit: str = ""


@dataclass(frozen=True, eq=False)
class SweptPlan:
    """One combination: the number of the value of every option, and the plan as estimated, or why there is none."""

    numbers: tuple[int, ...]
    plan: PlanResult


@dataclass(frozen=True)
class OptionInfluence:
    """Shares of the variance of time and of cost between plans that an option explains by itself, 0 to 1."""

    option: SweptOption
    time_share: float
    cost_share: float


@dataclass(frozen=True, eq=False, repr=False)
class SweepResult(ShownResult):
    """The plans of a sweep in the order of their combinations, all estimated and none driven.

    Attributes:
        field_name, area_ha: of the field, or of all fields together.
        options: what is varied; every plan has a value of each.
        plans: of the combinations that there was time for, of `total` in all.
        by_field: with several fields, the plans of each, by its name; then `plans` are those of all together, one after
            another.
        command: the command that plans one combination in full, without the varied options.
        link: the address of a form that does so, without the varied options; "" without a service.
    """

    field_name: str
    area_ha: float
    options: tuple[SweptOption, ...]
    plans: tuple[SweptPlan, ...]
    total: int
    currency: str | None = None
    start: str | None = None
    allowed_s: float | None = None
    is_priced: bool = False
    by_field: dict[str, tuple[SweptPlan, ...]] = field(default_factory=dict)
    command: tuple[str, ...] = ()
    link: str = ""

    def get_values(self, plan: SweptPlan) -> tuple[Any, ...]:
        """The values of a plan's options, as options are written."""
        return tuple(option.values[number] for option, number in zip(self.options, plan.numbers, strict=True))

    @cached_property
    def usable(self) -> tuple[SweptPlan, ...]:
        """The plans that can be taken: they work enough of the field, and are in time where there is a deadline."""
        return tuple(
            one
            for one in self.plans
            if one.plan.feasible and one.plan.works_enough and one.plan.meets_deadline is not False
        )

    @cached_property
    def front(self) -> tuple[SweptPlan, ...]:
        """The usable plans that nothing beats in time, cost, tractors, ground worked and fuel together, quickest first.

        Of plans alike in all of these the first is taken.
        """
        return tuple(
            self.usable[number] for number in find_front(np.array([_list_aims(one.plan) for one in self.usable]))
        )

    @cached_property
    def best(self) -> SweptPlan | None:
        """The plan to take, by the rule of `headland plan`; None where none is usable."""
        feasible = [one for one in self.plans if one.plan.feasible]
        if not feasible:
            return None
        chosen = choose_plan([one.plan for one in feasible], self.allowed_s, self.is_priced)
        return next(one for one in feasible if one.plan is chosen)

    @cached_property
    def rows(self) -> tuple[SweptPlan, ...]:
        """The rows of a table, quickest first: the front, spread evenly where it is too long, and the plan to take."""
        front, best = self.front, self.best
        if len(front) > MOST_ROWS:
            places = np.unique(np.linspace(0, len(front) - 1, MOST_ROWS - 1).round().astype(int))
            front = tuple(front[place] for place in places)
        if best is not None and all(one.numbers != best.numbers for one in front):
            front = tuple(sorted((*front, best), key=lambda one: one.plan.ranked_s))
        return front

    @cached_property
    def influences(self) -> tuple[OptionInfluence, ...]:
        """What every option explains of the differences of time and cost, the one that explains most first."""
        feasible = [one for one in self.plans if one.plan.feasible]
        times_s = np.array([one.plan.ranked_s for one in feasible])
        costs = np.array([one.plan.ranked_cost for one in feasible])
        numbers = np.array([one.numbers for one in feasible], np.int64).reshape(len(feasible), len(self.options))
        shares = [measure_influences(values, numbers).tolist() for values in (times_s, costs)]
        found = [OptionInfluence(option, *both) for option, *both in zip(self.options, *shares, strict=True)]
        return tuple(sorted(found, key=lambda one: -max(one.time_share, one.cost_share)))

    @property
    def refusal(self) -> str | None:
        """Why the first combination without a plan has none; None where all have one."""
        return next((one.plan.reason for one in self.plans if not one.plan.feasible), None)


def find_front(aims: Floats) -> list[int]:
    """Numbers of the rows (n, k) that no other beats: none is as small in all and smaller in one; sorted by the row."""
    kept = list[int]()
    for number in np.lexsort(aims.T[::-1]).tolist() if len(aims) else []:
        front = aims[kept]
        if not (front <= aims[number]).all(axis=1).any():
            kept.append(number)
    return kept


def measure_influences(values: Floats, numbers: npt.NDArray[np.int64]) -> Floats:
    """Shares (k,) of the variance of values (n,) that options with these numbers of their values (n, k) explain.

    Sums of one effect for each value are fitted for any of the options together; an option has what it adds to those
    before it, on average over all orders (Lindeman, Merenda and Gold 1980). So shares add up to 1 at most also where
    combinations without a plan leave gaps; where all are there, it is the first-order index of Sobol. Zeros where
    values do not differ.
    """
    count, options = numbers.shape
    shares = np.zeros(options)
    total = float(np.square(values - values.mean()).sum()) if count else 0.0
    if total <= 1e-12 * float(np.square(values).sum()):
        return shares
    products, sums, levels = _multiply_effects(values, numbers)
    explained = {0: 0.0}
    for chosen in range(1, 2**options):
        rows = np.isin(levels, [option for option in range(options) if chosen >> option & 1])
        effects, *_ = np.linalg.lstsq(products[np.ix_(rows, rows)], sums[rows], rcond=1e-9)
        explained[chosen] = float(effects @ sums[rows]) / total
    for option, chosen in product(range(options), explained):
        if not chosen >> option & 1:
            others = chosen.bit_count()
            weight = 1.0 / (options * comb(options - 1, others))
            shares[option] += weight * (explained[chosen | 1 << option] - explained[chosen])
    return np.clip(shares, 0.0, 1.0)


def _multiply_effects(values: Floats, numbers: npt.NDArray[np.int64]) -> tuple[Floats, Floats, npt.NDArray[np.int64]]:
    """Normal equations of one effect for each value of options: products (m, m), sums (m,), whose effect it is (m,)."""
    count, options = numbers.shape
    sizes = numbers.max(axis=0) + 1
    begins = np.concatenate([[0], np.cumsum(sizes)])
    columns = numbers + begins[:-1]
    products = np.zeros((begins[-1], begins[-1]))
    for a, b in product(range(options), repeat=2):
        np.add.at(products, (columns[:, a], columns[:, b]), 1.0)
    counts = np.bincount(columns.ravel(), minlength=begins[-1])
    sums = np.zeros(begins[-1])
    for option in range(options):
        sums += np.bincount(columns[:, option], values - values.mean(), minlength=begins[-1])
    return products - np.outer(counts, counts) / count, sums, np.repeat(np.arange(options), sizes)


def _list_aims(plan: PlanResult) -> Sequence[float]:
    """What a plan should have little of, as it is printed: seconds, cost, tractors, per mille left, litres or kWh."""
    used = plan.fuel_l if plan.energy_kwh is None else plan.energy_kwh
    left = -round(plan.worked_pct or 0.0, 1)
    return round(plan.ranked_s), round(plan.ranked_cost, 2), plan.tractors, left, round(used or 0.0, 1)
