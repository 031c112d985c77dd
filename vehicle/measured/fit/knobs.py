"""Effects as coordinates a fit can move: unbounded directions become components, limits become inverses."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from vehicle.effects import CIRCLE, LIMIT, SLOPE, Effect, effect, neutral
from vehicle.measured.logs.record import Array
from vehicle.rest import BY_NAME, REST
from vehicle.tractor import Tractor

MANY_STARTS = 6


@dataclass(frozen=True)
class Knobs:
    """Coordinates of one effect.

    `neutral`, `typical`, `low` and `high` have one value per coordinate; `starts` are vectors to try first, in this
    order, because the effect of a dead band or a limit vanishes or breaks off where it does not act.
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
        names = [param.name for param in effect(self.id).params]
        if effect(self.id).kind == SLOPE:
            bearing = math.degrees(math.atan2(at[0], at[1])) % 360.0
            return {"ratio": min(float(np.hypot(at[0], at[1])), effect(self.id).size.high), "bearing_deg": bearing}
        if effect(self.id).kind == LIMIT:
            return {"limit_g": math.inf if at[0] <= 0.0 else 1.0 / float(at[0])}
        return dict(zip(names, [*map(float, at), *self.fixed], strict=True))

    def with_fewer_starts(self) -> Knobs:
        """The same with every third start: positions alone tell little of the fine structure that needs more."""
        return replace(self, starts=self.starts[::3]) if len(self.starts) > MANY_STARTS else self

    def inside(self, at: Array) -> Array:
        """The nearest coordinates a tractor can have."""
        return np.clip(at, self.low, self.high)


def knobs_for(tractor: Tractor, name: str, patch: tuple[float, float, float] | None = None) -> Knobs:
    """Coordinates of an effect on a tractor; a `patch` (east, north, radius) is searched for beforehand and fixed."""
    entry = effect(name)
    start = neutral(name, tractor.steering)
    if entry.kind == SLOPE:
        typical = entry.size.typical
        return Knobs(name, (0.0, 0.0), (typical, typical), (-0.5, -0.5), (0.5, 0.5), ((0.0, 0.0),))
    if entry.kind == LIMIT:
        return Knobs(name, (0.0,), (4.0,), (0.0,), (50.0,), _singles(entry.starts))
    size = entry.size.for_wheelbase(tractor.wheelbase_m)
    zero = start[size.name]
    starts = _singles((*entry.starts, *[zero * share for share in entry.start_shares]) or (zero,))
    fixed = patch if entry.kind == CIRCLE and patch else ()
    return Knobs(name, (zero,), (size.typical,), (size.low,), (size.high,), starts, fixed)


def _singles(values: tuple[float, ...]) -> tuple[tuple[float, ...], ...]:
    return tuple((value,) for value in values)


def rest_knobs() -> list[tuple[Knobs, ...]]:
    """Coordinates of all terms of the rest, the two components of a direction together."""
    groups: dict[str, list[Knobs]] = {}
    for term in REST:
        knobs = Knobs(term.id, (0.0,), (term.typical,), (-math.inf,), (math.inf,), ((0.0,),))
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
    found: Effect = effect(name)
    return found.block
