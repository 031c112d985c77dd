"""Finders of ways that several layouts of a field have in common."""

from __future__ import annotations

from dataclasses import dataclass, field

from shapely.geometry.base import BaseGeometry

from strategies.ways.connect import Connector, TurnCosts


@dataclass(eq=False)
class Finders:
    """Connectors by their region and manner, made once: what one has found out serves every layout it is used for.

    To another process they are sent empty.
    """

    known: dict[tuple[bytes, float, TurnCosts, tuple[str, ...]], Connector] = field(default_factory=dict)

    def of(self, region: BaseGeometry, radius_m: float, costs: TurnCosts, kinds: tuple[str, ...]) -> Connector:
        """The finder for these; raises TurnError as Connector does."""
        key = region.wkb, radius_m, costs, kinds
        if key not in self.known:
            self.known[key] = Connector(region, radius_m, costs, kinds)
        return self.known[key]

    def __getstate__(self) -> dict[str, object]:
        return {"known": {}}
