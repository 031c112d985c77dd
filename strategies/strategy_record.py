"""The record by which everyone else knows a strategy: its name, a description, and how it shares the work lines."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from strategies.formations.compose import FormationRule
from strategies.program.dealing import DealLines
from strategies.programmes.move_table import MoveTable
from strategies.programmes.programme import Programme
from strategies.programmes.waiting_places import StandsInWay
from vehicle.missions.plan import Plan

ComposePlan = Callable[[MoveTable, int, str, StandsInWay], tuple[Programme, Plan]]
"""Composes the plan of a number of tractors with the headland first or last ("" for any), with its programme."""


@dataclass(frozen=True)
class Strategy:
    """How a fleet shares a field: by `deal`, by `formation` or by `compose`.

    `description` says what the tractors do, for help texts and tables. `deal` says which work lines each tractor may
    have, and a search puts them in order for all at once. Tractors of a `formation` keep beside one another, and its
    rule says how they turn; one tractor alone has all lines. `compose` puts the lines in order itself. All raise
    StrategyError if the field cannot be worked this way with this fleet.
    """

    name: str
    description: str
    deal: DealLines | None = None
    compose: ComposePlan | None = None
    formation: FormationRule | None = None

    def __post_init__(self) -> None:
        """Check that there is one of `deal`, `compose` and `formation`."""
        if [self.deal, self.compose, self.formation].count(None) != 2:
            raise TypeError(f"strategy {self.name!r} needs one of deal, compose and formation")
