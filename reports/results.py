"""Result types handed to the reports: plain frozen data, no behaviour."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

Points = npt.NDArray[np.float64]


@dataclass(frozen=True)
class MissedPiece:
    """A piece of ground that a plan leaves open: area, and a place in it, in metres of the field and on the earth.

    `lon` and `lat` in degrees are None for a field in local metres.
    """

    m2: float
    x_m: float
    y_m: float
    lon: float | None = None
    lat: float | None = None


@dataclass(frozen=True)
class PlanResult:
    """One simulated plan. What could not be simulated is None and `reason` says why; so does it when infeasible.

    `remark` says what its strategy could not do for it, though it can be driven.

    `rank` counts feasible plans from 1 by the time to finish the field, then tractors; infeasible ones have none.
    `time_s` and `cost` are what was driven; `finished_s` and `finished_cost` those of the finished job, with the ground
    it leaves open (`missed_m2`, `largest_missed`) worked at its own rate. `worked_pct` and `overlap_pct` are shares of
    the field, `trampled_m2` is finished ground off the headland that wheels went over. `outside_m` is the length of
    the guided path outside the boundary, `excursion_m` how far, `outside_outline_m` the length driven with some part of
    tractor or implement outside.
    `order_gap_pct` is by how much less any other order of tracks could take between them, at most; None where the order
    is not searched but given by the strategy.
    `formation_pct` is the share of the length of all tracks that tractors drive abreast; None where the strategy forms
    none.
    `rounds` of the headland are worked, from the first tractor on one to the last off it in `headland_s`.
    `done_s` is when field work is done, in seconds after the start by the clock: the ways from the entrance belong to
    it, the way back does not. On a farm, breaks, the road and making ready count in it, field work can begin at
    `ready_s`, all are back in the yard at `home_s`, and `transport_s` are tractor seconds of road and handling;
    `finished_done_s` is `done_s` of the finished job.
    Draws of what varies from day to day give `finish_probability` (of being done by the deadline and before the rain)
    with its 95 % interval, quantiles of the time (`p50_s`, `p80_s`, `p95_s`) and money in the mean: `paid_cost`, and
    `expected_cost` with ground that is late on top, with its standard error.
    `refills` counts the stops of all tractors at which a tank was filled or emptied, `refilling_s` their time; None
    where nothing is carried.
    `bound_s` is the time that a plan takes at least which was not simulated, as another one is quicker than that.
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
    missed_m2: float | None = None
    largest_missed: MissedPiece | None = None
    finished_s: float | None = None
    finished_cost: float | None = None
    trampled_m2: float | None = None
    outside_m: float | None = None
    excursion_m: float | None = None
    outside_outline_m: float | None = None
    turning_s: float | None = None
    waiting_s: float | None = None
    reversals: int | None = None
    min_clearance_m: float | None = None
    collisions: int | None = None
    order_gap_pct: float | None = None
    formation_pct: float | None = None
    on_pareto_front: bool = False
    remark: str | None = None
    rounds: int | None = None
    headland_s: float | None = None
    transport_s: float | None = None
    ready_s: float | None = None
    done_s: float | None = None
    home_s: float | None = None
    finished_done_s: float | None = None
    finish_probability: float | None = None
    finish_probability_interval: tuple[float, float] | None = None
    p50_s: float | None = None
    p80_s: float | None = None
    p95_s: float | None = None
    expected_cost: float | None = None
    expected_cost_error: float | None = None
    paid_cost: float | None = None
    bound_s: float | None = None
    refills: int | None = None
    refilling_s: float | None = None


def finish_s(plan: PlanResult) -> float:
    """Seconds until the field is finished: as driven where it is not known what the plan leaves open."""
    return float((plan.time_s or 0.0) if plan.finished_s is None else plan.finished_s)


def finish_cost(plan: PlanResult) -> float:
    """What the finished field costs, likewise."""
    return float((plan.cost or 0.0) if plan.finished_cost is None else plan.finished_cost)


def done_s(plan: PlanResult) -> float:
    """When field work is done, by the clock after the start."""
    return float((plan.time_s or 0.0) if plan.done_s is None else plan.done_s)


def finished_done_s(plan: PlanResult) -> float:
    """The same of the finished field."""
    return finish_s(plan) if plan.finished_done_s is None else plan.finished_done_s


def quickness(plan: PlanResult) -> tuple[float, int, str]:
    """What feasible plans are ranked by, smallest first: time to finish to the millisecond, then tractors, then name.

    Equal work is compared: ground that a plan leaves open counts with the time it would take at the plan's own rate.
    """
    return round(finish_s(plan), 3), plan.tractors, plan.strategy


def merit(plan: PlanResult, allowed_s: float | None = None) -> tuple[int, float, float, int, str]:
    """What the best of feasible plans is chosen by, smallest first: in time by cost, else by quickness.

    A plan that could finish the field within `allowed_s` comes before one that only drives what it drives in time.
    """
    late = 2 if not plan.meets_deadline else int(allowed_s is not None and finished_done_s(plan) > allowed_s)
    return late, 0.0 if late == 2 else finish_cost(plan), *quickness(plan)


@dataclass(frozen=True)
class Ranking:
    """All plans of a scenario, best first, infeasible and refused ones last.

    `tractor_effects` are the values of the effects of the tractor file by id, and under "rest" the amounts of a rest
    that is switched on: what logs have shown of the tractor that was simulated. `scenario` is what was asked for and,
    where that was left open, what was planned with: plain values with their units in the keys, clock times as hh:mm.
    `advice` is a sentence on the plan to take and its neighbours, from `draws` draws, money in `currency`; `chosen` is
    that plan (strategy, tractors) where there is something to be in time for. `checked` are sentences on how far the
    draws can be trusted, `day` on the clock of the best plan and the day that times are taken to be of. `unmet` is a
    sentence where no plan meets the rain or the budget: then the best is the closest. `cut_off_m2` is ground that
    obstacles cut off from the field that is worked. On a farm field work can begin at `field_start`, and
    `field_allowed_s` of it fit before the deadline. `money` are sentences on what its figures of money are.
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
    scenario: dict[str, Any] = field(default_factory=dict)
    advice: str | None = None
    currency: str | None = None
    draws: int | None = None
    chosen: tuple[str, int] | None = None
    checked: tuple[str, ...] = ()
    unmet: str | None = None
    cut_off_m2: float = 0.0
    day: tuple[str, ...] = ()
    field_start: str | None = None
    money: tuple[str, ...] = ()
    field_allowed_s: float | None = None

    @property
    def best(self) -> PlanResult | None:
        """The feasible plan that is `chosen`, else the one that finishes first; with a deadline the cheapest in time.

        Of those the ones that could finish by then what they leave open come first.
        """
        plans = [plan for plan in self.plans if plan.feasible]
        if self.chosen is not None:
            return next((plan for plan in plans if (plan.strategy, plan.tractors) == self.chosen), None)
        return min(plans, key=lambda plan: merit(plan, self.allowed_s), default=None)

    @property
    def missed_by_s(self) -> float | None:
        """Seconds by which the best plan misses the deadline; None when a plan meets it or none can be judged."""
        best = self.best
        if best is None or best.time_s is None or self.allowed_s is None or best.meets_deadline:
            return None
        return done_s(best) - self.allowed_s


@dataclass(frozen=True)
class Step:
    """One thing after another that a tractor does: a row of the list that its driver takes along.

    `kind` is "track", "round" (one side of it), "corner" (between two sides of a round), "turn" or "way" (to the next
    track or round), "enter" (from the entrance to the first of them), "leave" (back to it), "wait", "drive",
    "refill-way" (to where a tank is filled or emptied) or "refill" (of `amount`, below 0 where it is taken out).
    `number` counts the track or round from 1, `part` names the piece of a track ("a", "b", ...) or the side of a round
    ("1", "2", ...), "" where there is only one; for turns and ways both are those led to, and `to_round` says which
    they are. `again` marks what goes on after a wait. It begins at `from_s` and takes `seconds`, over `length_m`;
    `bearing_deg` is the direction worked in, clockwise from north. A turn leads over `over` tracks in the `shape` of a
    "u", "omega" or "switch-back" ("" for none of these); `for_tractors` are those, from 1, that are waited for. `x_m`
    and `y_m` are half way along it.
    """

    kind: str
    number: int | None
    part: str
    from_s: float
    seconds: float
    length_m: float
    x_m: float
    y_m: float
    to_round: bool = False
    again: bool = False
    bearing_deg: float | None = None
    over: int | None = None
    shape: str = ""
    for_tractors: tuple[int, ...] = ()
    amount: float | None = None


@dataclass(frozen=True, eq=False)
class RoundLine:
    """A round of the headland: its number from 1 and its centre line (n, 2) in metres, first point last if closed."""

    number: int
    points: Points


@dataclass(frozen=True, eq=False)
class CellOutline:
    """A part of the field with tracks of its own: number from 1, their direction, rings (n, 2), a place inside."""

    number: int
    bearing_deg: float
    rings: tuple[Points, ...]
    x_m: float
    y_m: float


@dataclass(frozen=True, eq=False)
class Drive:
    """What the tractors of one plan did, for pictures.

    `boundary` and `holes` are rings (n, 2) in metres; `tracks` (k, 2, 2) the swath centre lines. Per tractor `xy`
    (t, 2) of the guided point, `status` (t,) (0 finished, 1 working, 2 turning, 3 waiting, 4 reversing) every
    `step_s`; `seconds` maps working / turning / waiting / reversing, and refilling (status 5) where that is
    done, to one value per tractor. `missed` are rings (n, 2)
    around ground that is left open, counter-clockwise, and clockwise round what is worked inside it; `largest_missed`
    is the largest piece of it. `track_names` are what tracks are called, by default their places from 1; `rounds` are
    those of the headland that are worked, `cells` the parts of a field that has several, `obstacles` rings (n, 2)
    around what stands in it, `fences` lines (n, 2) along its outline, and `steps` what each tractor does, in order.
    `cut_off` are the pieces of ground that obstacles cut off, `worked_pct` is the share of the field worked.
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
    missed: tuple[Points, ...] = ()
    largest_missed: MissedPiece | None = None
    track_names: tuple[str, ...] = ()
    rounds: tuple[RoundLine, ...] = ()
    cells: tuple[CellOutline, ...] = ()
    obstacles: tuple[Points, ...] = ()
    fences: tuple[Points, ...] = ()
    steps: tuple[tuple[Step, ...], ...] = ()
    cut_off: tuple[MissedPiece, ...] = ()
    worked_pct: float | None = None


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
