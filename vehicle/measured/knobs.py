"""Effects as coordinates a fit can move: unbounded directions become components, limits become inverses."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from vehicle.effects import Effect, effect, neutral
from vehicle.measured.record import Array
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
        if self.id == "cross_slope_drift":
            bearing = math.degrees(math.atan2(at[0], at[1])) % 360.0
            return {"ratio": float(np.hypot(at[0], at[1])), "bearing_deg": bearing}
        if self.id == "side_slip":
            return {"limit_g": math.inf if at[0] <= 0.0 else 1.0 / float(at[0])}
        return dict(zip(names, [*map(float, at), *self.fixed], strict=True))

    def with_fewer_starts(self) -> Knobs:
        """The same with every third start: positions alone tell little of the fine structure that needs more."""
        return replace(self, starts=self.starts[::3]) if len(self.starts) > MANY_STARTS else self

    def inside(self, at: Array) -> Array:
        """The nearest coordinates a tractor can have."""
        return np.clip(at, self.low, self.high)


_SEARCHED = {
    "steering_dead_time": (0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.5, 0.6, 0.7, 0.9),
    "steering_backlash": (0.5, 1.5, 3.0),
    "side_slip": (1.2, 2.0, 4.0, 8.0, 12.0, 18.0),
    "gnss_latency": (0.1, 0.25),
    "understeer": (1.0, -0.5),
}
_SHARES = {
    "steering_lag": (0.5, 1.6, 2.5, 4.0, 7.0),
    "steering_rate": (0.3, 0.55, 0.8, 1.3),
    "steering_deadband": (2.5, 5.0, 10.0, 20.0),
}


def knobs_for(tractor: Tractor, name: str, patch: tuple[float, float, float] | None = None) -> Knobs:
    """Coordinates of an effect on a tractor; a `patch` (east, north, radius) is searched for beforehand and fixed."""
    entry = effect(name)
    start = neutral(name, tractor.steering)
    if name == "cross_slope_drift":
        typical = entry.size.typical
        return Knobs(name, (0.0, 0.0), (typical, typical), (-0.5, -0.5), (0.5, 0.5), ((0.0, 0.0),))
    if name == "side_slip":
        return Knobs(name, (0.0,), (4.0,), (0.0,), (50.0,), _singles(_SEARCHED[name]))
    size = entry.size.for_wheelbase(tractor.wheelbase_m)
    zero = start[size.name]
    starts = _singles(_SEARCHED[name]) if name in _SEARCHED else ((zero,),)
    if name in _SHARES:
        starts = _singles(tuple(zero * share for share in _SHARES[name]))
    fixed = patch if name == "grip_patch" and patch else ()
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


def finest_of(tractor: Tractor, name: str) -> float:
    """Smallest size of an effect that may be claimed on this tractor."""
    return effect(name).size.for_wheelbase(tractor.wheelbase_m).finest


def settings_of(parts: list[tuple[Knobs, Array]]) -> dict[str, dict[str, float]]:
    """Settings of several effects."""
    return {knobs.id: knobs.values(at) for knobs, at in parts}


def block_of(name: str) -> str:
    """Block of the chain an effect sits in."""
    found: Effect = effect(name)
    return found.block
