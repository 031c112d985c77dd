"""What keeps the best plan of a request from being a recommendation, and whether a tractor can pull its implement."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Shortfall:
    """What the best plan lacks of what was asked for; kinds are listed in the order in which they are said.

    `sentence` says so in English; it is "" for pull and late, which reports word from the figures of the ranking.
    """

    kind: Literal["pull", "worked", "rain", "budget", "late"]
    sentence: str = ""


@dataclass(frozen=True)
class PullFigures:
    """What an implement needs at the drawbar, and what the tractor has there, by ASAE D497.

    Attributes:
        implement: what the table of drafts calls it, such as "cultivator" or "drill".
        depth_cm: working depth; None where the draft does not depend on it.
        draft_kn, needed_kw: of the implement at `speed_kmh`, in the soil of the plan, else in medium soil.
        engine_kw, available_kw: of the tractor, at the drawbar the latter.
        possible_width_m, possible_speed_kmh: the greatest that it can pull, the other being as asked for; None where
            nothing sensible is left.
        range_pct: how far drafts of such implements lie from the mean, either way.
        is_assumed: whether the implement is only the usual one of the operation.
    """

    implement: str
    width_m: float
    speed_kmh: float
    depth_cm: float | None
    draft_kn: float
    needed_kw: float
    engine_kw: float
    available_kw: float
    possible_width_m: float | None
    possible_speed_kmh: float | None
    range_pct: float
    is_assumed: bool = True

    @property
    def is_questioned(self) -> bool:
        """Whether the implement needs more than the tractor has."""
        return self.needed_kw > self.available_kw

    @property
    def is_infeasible(self) -> bool:
        """Whether even the lightest of such implements (`range_pct` below the mean) needs more than the tractor has."""
        return (1.0 - 0.01 * self.range_pct) * self.needed_kw > self.available_kw
