"""Result types handed to the reports: plain frozen data, no behaviour."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

Points = npt.NDArray[np.float64]


@dataclass(frozen=True)
class PlanResult:
    """One simulated plan. What could not be simulated is None and `reason` says why; so does it when infeasible.

    `remark` says what its strategy could not do for it, though it can be driven.

    `rank` counts feasible plans from 1 by time, then tractors; infeasible ones have none. `worked_pct` and
    `overlap_pct` are shares of the field, `outside_m` the path length outside its boundary, `excursion_m` how far.
    """

    strategy: str
    tractors: int
    turn: str
    feasible: bool
    reason: str | None = None
    rank: int | None = None
    time_s: float | None = None
    tractor_time_s: float | None = None
    cost: float | None = None
    meets_deadline: bool | None = None
    worked_pct: float | None = None
    overlap_pct: float | None = None
    outside_m: float | None = None
    excursion_m: float | None = None
    turning_s: float | None = None
    waiting_s: float | None = None
    reversals: int | None = None
    min_clearance_m: float | None = None
    collisions: int | None = None
    on_pareto_front: bool = False
    remark: str | None = None


@dataclass(frozen=True)
class Ranking:
    """All plans of a scenario, best first, infeasible and refused ones last.

    `tractor_effects` are the values of the effects of the tractor file by id, and under "rest" the amounts of a rest
    that is switched on: what logs have shown of the tractor that was simulated.
    """

    field_name: str
    area_ha: float
    seed: int
    plans: tuple[PlanResult, ...]
    start: str | None = None
    before: str | None = None
    allowed_s: float | None = None
    assumptions: tuple[str, ...] = ()
    tractor_effects: dict[str, dict[str, float]] = field(default_factory=dict)

    @property
    def best(self) -> PlanResult | None:
        """The feasible plan of rank 1; with a deadline, the cheapest plan that meets it, if any does."""
        feasible = [plan for plan in self.plans if plan.feasible]
        in_time = [plan for plan in feasible if plan.meets_deadline]
        if in_time:
            return min(in_time, key=lambda plan: (plan.cost or 0.0, plan.rank or 0))
        return feasible[0] if feasible else None


@dataclass(frozen=True, eq=False)
class Drive:
    """What the tractors of one plan did, for pictures.

    `boundary` and `holes` are rings (n, 2) in metres; `tracks` (k, 2, 2) the swath centre lines. Per tractor `xy`
    (t, 2) of the guided point, `status` (t,) (0 finished, 1 working, 2 turning, 3 waiting, 4 reversing) every
    `step_s`; `seconds` maps working / turning / waiting / reversing to one value per tractor.
    """

    title: str
    boundary: Points
    holes: tuple[Points, ...]
    tracks: Points
    width_m: float
    step_s: float
    xy: tuple[Points, ...]
    status: tuple[npt.NDArray[np.int64], ...]
    finish_s: tuple[float, ...]
    seconds: dict[str, tuple[float, ...]]
    entrance: tuple[float, float] | None = None


@dataclass(frozen=True)
class StudyRow:
    """One line of a table of the thesis beside ours."""

    label: str
    tractors: int
    thesis_s: float
    time_s: float | None
    difference_pct: float | None
    note: str = ""


@dataclass(frozen=True)
class Claim:
    """A claim of the thesis and what the simulation says of it."""

    claim: str
    holds: bool
    why: str


@dataclass(frozen=True)
class Study:
    """Tables 6.1 to 6.3 beside the thesis, its claims, and the one set of assumptions behind every row."""

    tables: dict[str, tuple[StudyRow, ...]]
    claims: tuple[Claim, ...]
    assumptions: tuple[str, ...]
    details: dict[str, Any] = field(default_factory=dict)
