"""Effects and terms of the rest of one tractor as coordinates that a fit can move (see vehicle.kinds)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from vehicle.effects import effect, neutral
from vehicle.kinds import Box, Interval, Kind
from vehicle.measured.logs.record import Array
from vehicle.rest import BY_NAME, MOST, REST
from vehicle.tractor import Tractor

Places = Mapping[str, Sequence[float]]
MANY_STARTS = 6  # chosen: more than this only the long list of dead times has


@dataclass(frozen=True)
class Knobs:
    """Coordinates of one effect, or of one term of the rest.

    `neutral`, `typical`, `low` and `high` have one value per coordinate; `starts` are vectors to try first, in this
    order, because the effect of a dead band or a limit vanishes or breaks off where it does not act. `fixed` are the
    values that were searched for beforehand.
    """

    id: str
    neutral: tuple[float, ...]
    typical: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    starts: tuple[tuple[float, ...], ...]
    fixed: tuple[float, ...] = ()

    @property
    def count(self) -> int:
        """Number of coordinates."""
        return len(self.neutral)

    def values(self, at: Array) -> dict[str, float]:
        """Values of the effect, or the amount of a term of the rest, at coordinates."""
        if self.id in BY_NAME:
            return {self.id: float(at[0])}
        return self._kind.values(effect(self.id).params, at, self.fixed)

    def deviation(self, at: Array) -> float:
        """How far coordinates are from neutral, in the unit of the size of the effect."""
        return self._kind.deviation(self.neutral, at)

    def interval(self, at: Array, covariance: Array, finest: float) -> dict[str, Interval]:
        """95 % interval of the values from the covariance (m, m) of the coordinates; see Kind.interval."""
        box = Box(self.neutral, self.typical, self.low, self.high, self.starts)
        return self._kind.interval(effect(self.id).params, box, at, covariance, finest)

    @property
    def _kind(self) -> Kind:
        return effect(self.id).kind.on(self.fixed)

    def with_fewer_starts(self) -> Knobs:
        """The same with every third start: positions alone tell little of the fine structure that needs more."""
        return replace(self, starts=self.starts[::3]) if len(self.starts) > MANY_STARTS else self

    def inside(self, at: Array) -> Array:
        """The nearest coordinates a tractor can have."""
        return np.clip(at, self.low, self.high)


def knobs_for(tractor: Tractor, name: str, places: Places = MappingProxyType({})) -> Knobs:
    """Coordinates of an effect on a tractor.

    `places` has what is known beforehand of where effects are: of a patch its circle (east, north, radius in m), of a
    drift on a slope that was measured the values of vehicle.kinds.OnSlope.
    """
    entry, place = effect(name), tuple(places.get(name, ()))
    size = entry.size.for_wheelbase(tractor.wheelbase_m)
    zero = neutral(name, tractor.steering)[size.name]
    box = entry.kind.on(place).box(size, zero, (*entry.starts, *[zero * share for share in entry.start_shares]))
    return Knobs(name, *box, fixed=place)


def rest_knobs() -> list[tuple[Knobs, ...]]:
    """Coordinates of all terms of the rest, the two components of a direction together."""
    groups: dict[str, list[Knobs]] = {}
    for term in REST:
        knobs = Knobs(term.id, (0.0,), (term.typical,), (-MOST,), (MOST,), ((0.0,),))
        groups.setdefault(term.id.split("_to_")[0], []).append(knobs)
    return [tuple(group) for group in groups.values()]


def finest_of(tractor: Tractor, name: str, row_s: float = 0.0) -> float:
    """Smallest size of an effect that may be claimed on this tractor; of a time never less than half a row (s)."""
    size = effect(name).size.for_wheelbase(tractor.wheelbase_m)
    return max(size.finest, 0.5 * row_s) if size.unit == "s" else size.finest


def settings_of(parts: list[tuple[Knobs, Array]]) -> dict[str, dict[str, float]]:
    """Settings of several effects."""
    return {knobs.id: knobs.values(at) for knobs, at in parts}


def block_of(name: str) -> str:
    """Block of the chain an effect sits in."""
    return effect(name).block
