"""Other orders for tractors with tracks of their own, tried where the one found first cannot be driven.

Whether two tractors can keep out of each other's way, and every turn within the field, only driving tells. The other
way round, turns are driven in the other direction and tractors are elsewhere at any time. What a fleet does on the
headland is nearly the same: where all are on the rounds first and no timetable brings them on to their tracks, none has
been seen to do so with tracks driven the other way round. Beside a rival that is not looked for.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace

from strategies.headland.rounds import FIRST
from strategies.job import Job
from strategies.record import Refined, Strategy
from vehicle.missions import Plan

TOLD = "not in the order found first, which cannot be driven"


def other_orders(strategy: Strategy, job: Job) -> Iterator[Job]:
    """The job with all tractors the other way round, with every second one, and with tracks one after another."""
    if job.supply is None:  # loads are cut from the beginning of an order
        yield replace(job, turned=tuple(range(job.tractors)), used={})
        if job.tractors > 1:
            yield replace(job, turned=tuple(range(1, job.tractors, 2)), used={})
    if strategy.takes_jump and job.jump is None:
        yield replace(job, jump=1, used={})


@dataclass
class Untimed:
    """Passages from the rounds to the tracks for which one order of a candidate has no timetable.

    What other orders leave out for that takes `least_s` at the least, by what `least` says of plans; infinite where
    nothing is left out, as where there is no such function.
    """

    least: Callable[[Plan], float] | None = None
    least_s: float = math.inf
    _passages: set[int] = field(default_factory=set)

    def note(self, passage: int, plans: Iterable[Plan]) -> None:
        """No timetable was found for these plans by a passage, and they cannot be driven."""
        if any(_rounds_first(plan) for plan in plans):
            self._passages.add(passage)

    def left_out(self, job: Job, passage: int, choices: Sequence[Refined]) -> list[Refined]:
        """The choices of a job that are left out.

        Only orders that are turned leave any out: tracks one after another are other ways altogether.
        """
        if self.least is None or passage not in self._passages or not job.turned:
            return []
        alike = [choice for choice in choices if _rounds_first(choice.plan)]
        self.least_s = min([self.least_s, *(self.least(choice.plan) for choice in alike)])
        return alike

    @property
    def told(self) -> str | None:
        """What was left out, in words; None where nothing was."""
        if self.least_s == math.inf:
            return None
        found = f"rounds first (at least {self.least_s:.0f} s) found no timetable in one order of tracks"
        return f"{found} and were not driven in others"


def _rounds_first(plan: Plan) -> bool:
    return plan.notes.get("headland") == FIRST
