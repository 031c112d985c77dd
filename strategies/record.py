"""What a strategy is to everybody else: a record with its name, words, and ways to build and refine a plan."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from strategies.job import Job
from vehicle.missions import Plan
from vehicle.run import Run
from vehicle.tractor import Implement, Tractor

MOST_REPAIRS = 40

Simulate = Callable[[Plan], Run]
"""Drives a plan until it is done, two tractors come too close, or nothing moves any more."""


@dataclass(frozen=True)
class Refined:
    """A plan as it was refined, its run where it is already simulated, and what a reader would not expect of it."""

    plan: Plan
    run: Run | None = None
    remark: str | None = None


Refine = Callable[[Job, Simulate, Tractor, Implement], Refined]


@dataclass(frozen=True)
class Strategy:
    """How a fleet shares a field.

    `words` say what the tractors do, for help texts and tables. `build` writes the plan of a job; where only driving
    tells what is best, `refine` writes it instead, with a `simulate` handed over. Both raise StrategyError when the
    field cannot be worked this way with this fleet. `abreast` tells whether tractors work neighbouring tracks side by
    side in rounds, which depends on the corner they begin at, or each has tracks of its own. `takes_jump` tells
    whether `build` heeds `Job.jump`. Where tractors meet, the plan is mended at most `most_repairs` times.
    `least` writes the plan that `refine` begins from, with the waiting that it never takes back: for a bound.
    """

    name: str
    words: str
    build: Callable[[Job], Plan]
    abreast: bool = False
    refine: Refine | None = None
    takes_jump: bool = False
    most_repairs: int = MOST_REPAIRS
    least: Callable[[Job], Plan] | None = None
