"""The record by which everyone else knows a strategy: its name, a description, and how to build and refine a plan."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from strategies.program.dealing import DealLines
from strategies.program.field_job import FieldJob
from strategies.programmes.move_table import MoveTable
from strategies.programmes.programme import Programme
from strategies.programmes.waiting_places import StandsInWay
from vehicle.missions.plan import Plan
from vehicle.missions.run import SimulationRun
from vehicle.model.tractor import Implement, Tractor

MAX_REPAIRS = 40

Simulate = Callable[[Plan], SimulationRun]
"""Simulates a plan until it is done, two tractors come too close, or nothing moves any more."""


@dataclass(frozen=True)
class RefinedPlan:
    """A refined plan, its run if it was simulated, and a remark on what a reader would not expect of it.

    `plan_after_headland` is the plan for headland passes that come first, where that is another.
    """

    plan: Plan
    run: SimulationRun | None = None
    remark: str | None = None
    plan_after_headland: Plan | None = None


ComposePlan = Callable[[MoveTable, int, str, StandsInWay], tuple[Programme, Plan]]
"""Composes the plan of a number of tractors with the headland first or last ("" for any), with its programme."""
Refine = Callable[[FieldJob, Simulate, Tractor, Implement], RefinedPlan]


@dataclass(frozen=True)
class Strategy:
    """How a fleet shares a field.

    `description` says what the tractors do, for help texts and tables. `build` writes the plan of a job; where the best
    plan is only known after simulation, `refine` writes it instead and is given a function that simulates. Both raise
    StrategyError if the field cannot be worked this way with this fleet. `side_by_side` is True if tractors work
    neighbouring swaths side by side in rounds, which depends on the corner they begin at, and False if each has swaths
    of its own. `takes_jump` tells whether `build` uses `FieldJob.jump`. Where tractors meet, the plan is repaired at
    most `max_repairs` times. `build_bound` writes the plan that `refine` starts from, with only the waiting it never
    removes: a lower bound. `deal` says which work lines each tractor may have; a search then puts them in order, and
    `build` is only for service stops. `compose` puts them in order itself; it raises StrategyError like `build`.
    """

    name: str
    description: str
    build: Callable[[FieldJob], Plan]
    side_by_side: bool = False
    refine: Refine | None = None
    takes_jump: bool = False
    max_repairs: int = MAX_REPAIRS
    build_bound: Callable[[FieldJob], Plan] | None = None
    deal: DealLines | None = None
    compose: ComposePlan | None = None
