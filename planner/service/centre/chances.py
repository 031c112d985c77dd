"""How likely the rest of a fleet's work is done in time, from the draws that its plan was made with."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from statistics import NormalDist
from typing import Any

NORMAL = NormalDist()
SCORES = tuple(NORMAL.inv_cdf(share) for share in (0.80, 0.95))
KEYS = ("time_s", "p50_s", "p80_s", "p95_s")


@dataclass(frozen=True)
class Chances:
    """Seconds from the start to the end of the work: as simulated without chance (`planned_s`), and those that half,
    80 % and 95 % of the draws keep."""

    planned_s: float
    p50_s: float
    p80_s: float
    p95_s: float

    def in_time(self, rest_s: float, left_s: float) -> float | None:
        """The probability that what takes `rest_s` more by the forecast is done within `left_s` (s of the same clock).

        The draws of the whole plan are scaled to the rest. Its middle is the forecast times p50_s / planned_s: as much
        longer as the middle of the draws is than the plan without chance. Its spread is that of the draws times the
        root of the share of the plan that is left, as for a sum of delays that know nothing of each other; below the
        middle it is taken to be that between p50_s and p80_s. In between the normal score is linear in time. None for a
        forecast without an end.
        """
        if not math.isfinite(rest_s):
            return None
        left = max(rest_s, 0.0) / self.planned_s
        beyond_s = left_s - left * self.p50_s
        return round(NORMAL.cdf(self._score(beyond_s, math.sqrt(left))), 4)

    def _score(self, beyond_s: float, share: float) -> float:
        near_s, far_s = share * (self.p80_s - self.p50_s), share * (self.p95_s - self.p50_s)
        if near_s <= 0.0 or far_s <= near_s:
            return math.copysign(math.inf, beyond_s)
        if beyond_s <= near_s:
            return SCORES[0] * beyond_s / near_s
        return SCORES[0] + (SCORES[1] - SCORES[0]) * (beyond_s - near_s) / (far_s - near_s)


def chances_of(result: Mapping[str, Any], plan_file: str) -> Chances | None:
    """The chances of a saved plan by the result of its job; None where it was planned without draws."""
    for plan in (result.get("best") or {}, *result.get("plans", ())):
        best = plan_file == "plan.json"
        if best or plan_file == f"plan-{plan.get('strategy')}-{plan.get('tractors')}.json":
            values = [plan.get(key) for key in KEYS]
            found = [float(value) for value in values if value]
            return Chances(*found) if len(found) == len(KEYS) else None
    return None
