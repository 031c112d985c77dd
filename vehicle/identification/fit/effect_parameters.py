"""Effects and discrepancy terms of one tractor as coordinates of a fit (see vehicle.model.effect_kinds)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from vehicle.identification.logs.schema import Array
from vehicle.model.discrepancy_model import DISCREPANCY_TERMS, MAX_AMOUNT, TERMS_BY_NAME
from vehicle.model.effect_kinds import CoordinateBox, EffectKind, Interval
from vehicle.model.effects import get_effect, get_neutral_values
from vehicle.model.tractor import Tractor

EffectPlaces = Mapping[str, Sequence[float]]
MANY_STARTS = 6  # chosen: only the long list of dead times has more


@dataclass(frozen=True)
class EffectParameters:
    """Coordinates of one effect or discrepancy term.

    `neutral`, `typical`, `low` and `high` have one value per coordinate; `starts` are vectors to try first, in order,
    because a dead band or a limit has no gradient where it does not act. `fixed` are values that were determined
    beforehand.
    """

    id: str
    neutral: tuple[float, ...]
    typical: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    starts: tuple[tuple[float, ...], ...]
    fixed_values: tuple[float, ...] = ()

    @property
    def count(self) -> int:
        """Number of coordinates."""
        return len(self.neutral)

    def compute_values(self, coordinates: Array) -> dict[str, float]:
        """Return the values of the effect, or the amount of a discrepancy term, at coordinates."""
        if self.id in TERMS_BY_NAME:
            return {self.id: float(coordinates[0])}
        return self._kind.compute_values(get_effect(self.id).params, coordinates, self.fixed_values)

    def compute_deviation(self, coordinates: Array) -> float:
        """Return the distance of coordinates from neutral, in the unit of the effect's size."""
        return self._kind.compute_deviation(self.neutral, coordinates)

    def compute_interval(self, coordinates: Array, covariance: Array, finest: float) -> dict[str, Interval]:
        """Return the 95 % interval of the values from the covariance (m, m) of the coordinates; see Kind.interval."""
        box = CoordinateBox(self.neutral, self.typical, self.low, self.high, self.starts)
        return self._kind.compute_interval(get_effect(self.id).params, box, coordinates, covariance, finest)

    @property
    def _kind(self) -> EffectKind:
        return get_effect(self.id).kind.get_kind_for_place(self.fixed_values)

    def reduce_starts(self) -> EffectParameters:
        """Keep every third start: positions alone do not resolve the fine structure that needs more."""
        return replace(self, starts=self.starts[::3]) if len(self.starts) > MANY_STARTS else self

    def clip(self, coordinates: Array) -> Array:
        """Return the nearest possible coordinates of a tractor."""
        return np.clip(coordinates, self.low, self.high)


def build_parameters(tractor: Tractor, name: str, places: EffectPlaces = MappingProxyType({})) -> EffectParameters:
    """Build the coordinates of an effect on a tractor.

    `places` holds values determined beforehand: for a patch its circle (east, north, radius in m), for a drift on a
    measured slope the values of vehicle.model.effect_kinds.OnSlope.
    """
    entry, place = get_effect(name), tuple(places.get(name, ()))
    size = entry.size.scale_to_wheelbase(tractor.wheelbase_m)
    neutral_size = get_neutral_values(name, tractor.steering)[size.name]
    box = entry.kind.get_kind_for_place(place).build_box(
        size, neutral_size, (*entry.starts, *[neutral_size * share for share in entry.start_shares])
    )
    return EffectParameters(name, *box, fixed_values=place)


def build_discrepancy_parameters() -> list[tuple[EffectParameters, ...]]:
    """Build the coordinates of all discrepancy terms; the two components of a direction belong together."""
    groups: dict[str, list[EffectParameters]] = {}
    for term in DISCREPANCY_TERMS:
        parameters = EffectParameters(term.id, (0.0,), (term.typical,), (-MAX_AMOUNT,), (MAX_AMOUNT,), ((0.0,),))
        groups.setdefault(term.id.split("_to_")[0], []).append(parameters)
    return [tuple(group) for group in groups.values()]


def find_finest_size(tractor: Tractor, name: str, row_s: float = 0.0) -> float:
    """Return the smallest size of an effect that may be claimed on this tractor; for a time at least half a row (s)."""
    size = get_effect(name).size.scale_to_wheelbase(tractor.wheelbase_m)
    return max(size.finest, 0.5 * row_s) if size.unit == "s" else size.finest


def collect_settings(parts: list[tuple[EffectParameters, Array]]) -> dict[str, dict[str, float]]:
    """Return the settings of several effects."""
    return {parameters.id: parameters.compute_values(coordinates) for parameters, coordinates in parts}


def get_chain_block(name: str) -> str:
    """Return the block of the chain that contains an effect."""
    return get_effect(name).block


def get_shown_blocks(name: str) -> frozenset[str]:
    """Return the blocks at whose sensors an effect shows."""
    return frozenset({get_chain_block(name), *get_effect(name).also_shows_in})
