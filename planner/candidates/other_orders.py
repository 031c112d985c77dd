"""Other orders for tractors with tracks of their own, tried where the one found first cannot be driven.

Whether two tractors can keep out of each other's way, and every turn within the field, only driving tells. The other
way round, turns are driven in the other direction and tractors are elsewhere at any time.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from strategies.job import Job
from strategies.record import Strategy

TOLD = "not in the order found first, which cannot be driven"


def other_orders(strategy: Strategy, job: Job) -> Iterator[Job]:
    """The job with all tractors the other way round, with every second one, and with tracks one after another."""
    if job.supply is None:  # loads are cut from the beginning of an order
        yield replace(job, turned=tuple(range(job.tractors)), used={})
        if job.tractors > 1:
            yield replace(job, turned=tuple(range(1, job.tractors, 2)), used={})
    if strategy.takes_jump and job.jump is None:
        yield replace(job, jump=1, used={})
