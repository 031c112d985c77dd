"""What keeps plans from being recommended, what is remarked on them and where: the records that results are made of."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import IntEnum
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


@dataclass(frozen=True)
class UnworkedPiece:
    """A piece of unworked ground: its area, and a place in it in metres of the field and in degrees.

    `lon` and `lat` are None for a field in local metres.
    """

    m2: float
    x_m: float
    y_m: float
    lon: float | None = None
    lat: float | None = None


OBSTACLE, FENCE, OUTLINE, STUCK = "obstacle", "fence", "outline", "stuck"


@dataclass(frozen=True)
class PlanFault:
    """Why and where a plan cannot be driven: a kind above, and the place in metres of the field.

    `number` is that of the obstacle (Field.solid_obstacles, then fences) that is touched.
    """

    kind: str
    number: int | None
    x_m: float
    y_m: float


@dataclass(frozen=True)
class SlopePlace:
    """A slope (percent) or a margin (degrees) at a place of a tractor, counted from 1: metres of the field and degrees.

    `lon` and `lat` are None for a field in local metres.
    """

    amount: float
    tractor: int
    x_m: float
    y_m: float
    lon: float | None = None
    lat: float | None = None


class Stake(IntEnum):
    """What a remark puts at stake, the worst first."""

    LIFE = 0
    GROUND_OF_OTHERS = 1
    MACHINES = 2
    WORK = 3
    TIME = 4
    NOTHING = 5


@dataclass(frozen=True)
class Remark:
    """A sentence without its full stop, and what it puts at stake."""

    stake: Stake
    text: str


def sort_remarks(remarks: Iterable[Remark]) -> tuple[str, ...]:
    """The sentences, those on the worst first, else as they came."""
    return tuple(remark.text for remark in sorted(remarks, key=lambda remark: remark.stake))
