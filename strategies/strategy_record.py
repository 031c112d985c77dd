"""The record by which everyone else knows a strategy: its name, a description, and how it shares the work lines."""

from __future__ import annotations

from dataclasses import dataclass

from strategies.formations.compose import FormationRule
from strategies.rules.dealing import DealLines


@dataclass(frozen=True)
class Strategy:
    """How a fleet shares a field: by `deal` or by `formation`.

    `description` says what the tractors do, for forms and the guide. `deal` says which work lines each tractor may
    have, and a search puts them in order for all at once. Tractors of a `formation` keep beside one another, and its
    rule says how they turn; one tractor alone has all lines. `beside`: they work neighbouring swaths at a time.
    `differs_alone`: the deal gives one tractor alone places of its own or not all lines; else its plan is that of
    any other strategy and is made once for all. Both raise StrategyError if the field cannot be worked this way with
    this fleet.
    """

    name: str
    description: str
    deal: DealLines | None = None
    formation: FormationRule | None = None
    beside: bool = False
    differs_alone: bool = False

    def __post_init__(self) -> None:
        """Check that there is either `deal` or `formation`; a formation works beside one another."""
        if (self.deal is None) == (self.formation is None):
            raise TypeError(f"strategy {self.name!r} needs either deal or formation")
        object.__setattr__(self, "beside", self.beside or self.formation is not None)
