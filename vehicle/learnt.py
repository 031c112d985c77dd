"""What logs taught about a tractor: its effects and its rest, as settings and as fields of MODEL; and it without them.

The one place that knows how a tractor file carries them. Whoever asks for "the tractor of the makers' sheet" (the
steering tables, a replay that sets effects of its own) takes `without_logs`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from vehicle.effects import REST_KEY, effect_fields
from vehicle.rest import range_fields
from vehicle.tractor import Tractor

Settings = Mapping[str, Mapping[str, float]]


@dataclass(frozen=True)
class Learnt:
    """Settings (values per effect; amounts of the rest under REST_KEY) and the fields that keep a rest to where it
    was seen."""

    settings: Settings = field(default_factory=dict)
    ranges: Mapping[str, float] = field(default_factory=dict)

    @property
    def fields(self) -> dict[str, float]:
        """Fields of MODEL."""
        return effect_fields(self.settings) | dict(self.ranges)


def learnt(tractor: Tractor) -> Learnt:
    """What the file of a tractor has from logs: its effects, and its rest unless that is switched off."""
    settings: dict[str, Mapping[str, float]] = {name: one.value for name, one in tractor.effects.items()}
    rest = tractor.rest
    if rest is None or not rest.on:
        return Learnt(settings)
    return Learnt(settings | {REST_KEY: rest.amounts}, range_fields(rest.speed_mps, rest.angle_deg))


def without_logs(tractor: Tractor) -> Tractor:
    """The tractor without what logs taught: neither effects nor a rest."""
    return tractor.model_copy(update={"effects": {}, "rest": None})
