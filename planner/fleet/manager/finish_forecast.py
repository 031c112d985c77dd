"""Forecast of when every tractor will be done, leg by leg at the pace driven so far and with gates, and the
probability of meeting a deadline from the samples of the plan."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import Any

from planner.fleet.model.tractor_state import TractorState, is_passed

NORMAL = NormalDist()
NORMAL_SCORES = tuple(NORMAL.inv_cdf(share) for share in (0.80, 0.95))
RESULT_KEYS = ("time_s", "p50_s", "p80_s", "p95_s")
PRIOR_DRIVING_S = 120.0  # of driving at the planned pace that an estimate starts from
MAX_PACE, MIN_PACE = 4.0, 0.5
LegPlace = tuple[int, float]


@dataclass(frozen=True)
class FinishDistribution:
    """Seconds from the start to the end of the work: as simulated without variation (`planned_s`), and the times that
    50, 80 and 95 % of the samples keep."""

    planned_s: float
    p50_s: float
    p80_s: float
    p95_s: float

    def compute_probability(self, work_s: float, available_s: float) -> float | None:
        """The probability that work forecast to take `work_s` is done within `available_s` (same clock).

        The samples of the whole plan are scaled to the remaining work. The median is the forecast times p50_s /
        planned_s. The spread is that of the samples times the root of the remaining share of the plan, as for a sum of
        independent delays; below the median the one between p50_s and p80_s is used. The normal score is linear in time
        in between. None for a forecast without an end.
        """
        if not math.isfinite(work_s):
            return None
        remaining_share = max(work_s, 0.0) / self.planned_s
        beyond_s, spread = available_s - remaining_share * self.p50_s, math.sqrt(remaining_share)
        near_s, far_s = spread * (self.p80_s - self.p50_s), spread * (self.p95_s - self.p50_s)
        near_score, far_score = NORMAL_SCORES
        if near_s <= 0.0 or far_s <= near_s:
            score = math.copysign(math.inf, beyond_s)
        elif beyond_s <= near_s:
            score = near_score * beyond_s / near_s
        else:
            score = near_score + (far_score - near_score) * (beyond_s - near_s) / (far_s - near_s)
        return round(NORMAL.cdf(score), 4)


def read_finish_distribution(result: Mapping[str, Any], plan_file: str) -> FinishDistribution | None:
    """The finish times of a saved plan from the result of its job; None if it was planned without samples."""
    for plan in (result.get("best") or {}, *result.get("plans", ())):
        is_best = plan_file == "plan.json"
        if is_best or plan_file == f"plan-{plan.get('strategy')}-{plan.get('tractors')}.json":
            values = [plan.get(key) for key in RESULT_KEYS]
            figures_s = [float(value) for value in values if value]
            return FinishDistribution(*figures_s) if len(figures_s) == len(RESULT_KEYS) else None
    return None


def forecast_finish_s(
    states: Sequence[TractorState], halted: Sequence[bool], places: Sequence[LegPlace | None]
) -> list[float]:
    """Seconds from now until each tractor is done (n,); infinite if it never will be.

    `halted` tractors stay where they are, and so do those that wait for them. `places` are the present legs and metres
    by the twins; without one a tractor is where it reported last.
    """
    rows = [_TractorForecast(*each) for each in zip(states, halted, places, strict=True)]
    has_progress = True
    while has_progress:
        has_progress = sum(row.advance(rows, states) for row in rows) > 0
    return [row.finish_s for row in rows]


class _TractorForecast:
    """The timed legs of one tractor: when they end (`ends_s`), from its present leg on."""

    def __init__(self, state: TractorState, is_halted: bool, place: LegPlace | None) -> None:
        ratio = (PRIOR_DRIVING_S + state.driving_s) / (PRIOR_DRIVING_S + state.planned_driving_s)
        self.mission, self.state, self.pace = state.mission, state, min(max(ratio, MIN_PACE), MAX_PACE)
        self.leg, self.leg_m = (state.leg, state.leg_m) if place is None else place
        self.ends_s: list[float] = []
        self.free_s = math.inf if is_halted and not state.done else 0.0

    @property
    def next_leg(self) -> int:
        return self.leg + len(self.ends_s)

    @property
    def finish_s(self) -> float:
        if self.state.done:
            return 0.0
        if self.next_leg < len(self.mission.legs):
            return math.inf
        return self.ends_s[-1] if self.ends_s else self.free_s

    def advance(self, rows: Sequence[_TractorForecast], states: Sequence[TractorState]) -> bool:
        """Time as many legs as possible; whether there were any."""
        timed_count = len(self.ends_s)
        while not self.state.done and self.next_leg < len(self.mission.legs):
            start_s = self._find_start_s(rows, states)
            if start_s is None:
                break
            leg = self.next_leg
            share = 1.0
            if not self.ends_s:
                share = 1.0 - self._compute_share(leg, self.leg_m)
            self.ends_s.append(start_s + share * self.mission.leg_seconds[leg] * self.pace)
        return len(self.ends_s) > timed_count

    def _find_start_s(self, rows: Sequence[_TractorForecast], states: Sequence[TractorState]) -> float | None:
        start_s = self.ends_s[-1] if self.ends_s else self.free_s
        for gate in self.mission.legs[self.next_leg].gates:
            if is_passed(gate, states) or (self.ends_s and self.next_leg < self.state.base_end):
                continue  # on base legs only the present one may still wait
            opens_s = rows[gate.tractor].find_passing_s(gate.leg, gate.after_m)
            if opens_s is None:
                return None
            start_s = max(start_s, opens_s)
        return start_s

    def find_passing_s(self, leg: int, leg_m: float) -> float | None:
        """When this tractor reaches a place, as a gate waits for; None while its leg is not timed."""
        index = leg - self.leg
        if index < 0:
            return 0.0
        if index >= len(self.ends_s):
            return None
        return self.ends_s[index] - (1.0 - self._compute_share(leg, leg_m)) * self.mission.leg_seconds[leg] * self.pace

    def _compute_share(self, leg: int, leg_m: float) -> float:
        """The share of a leg that lies before a place on it."""
        return min(leg_m / max(self.mission.lengths_m[leg], 1e-6), 1.0)
