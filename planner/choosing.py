"""Which of several ways to drive the same work is simulated: what promises clearly more than another saves its run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol, TypeVar

from planner.bounds import least_s
from strategies.record import Refined
from vehicle.run import Run

EVEN = 0.99  # least times tell which of two plans is quicker where they differ by more than this


class Tried(Protocol):
    """A plan that was driven: its last run, and why it is not feasible (None when it is)."""

    @property
    def run(self) -> Run: ...

    @property
    def reason(self) -> str | None: ...


T = TypeVar("T", bound=Tried)


def promising(choices: Sequence[Refined], drive: Callable[[Refined], T]) -> list[T]:
    """The choices driven in the order of their least times, without those that one driven before clearly beats.

    What a run takes longer than the least time of its plan, another plan of the same work takes longer in proportion.
    """
    timed = sorted((round(least_s(choice.plan), 3), number) for number, choice in enumerate(choices))
    driven: list[T] = []
    for least, number in timed:
        done = [one.run for one in driven if one.reason is None]
        if any(EVEN * least * run.duration_s / least_s(run.plan) >= run.duration_s for run in done):
            continue
        driven.append(drive(choices[number]))
    return driven
