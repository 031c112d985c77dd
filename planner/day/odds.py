"""How sure every field of a day is: the draws of its plans chained along the day of each fleet.

A field that takes longer shifts all that the fleet does after it. The rain is the same for all fields in a draw; what
varies on a field is its own. Every fleet begins late as a fleet does that begins a job.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from planner.chance.answer import wilson
from planner.chance.draws import draw
from planner.chance.events import lognormal
from planner.chance.graph import Graph
from planner.chance.settings import Chances
from planner.chance.streams import stream
from planner.price.cost import Terms, paid_per_draw
from planner.workday import Workday

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Stop:
    """A field on a fleet's way: `move_s` from the place before, worked from `opens_s` on and until `closes_s`.

    Working seconds; `stake` is lost of it where nothing is done in time, `seed` is that of its draws.
    """

    graph: Graph
    move_s: float
    opens_s: float
    closes_s: float
    terms: Terms
    stake: float
    seed: int


@dataclass(frozen=True, eq=False)
class Chain:
    """What came out for the fields of one fleet: (fields, draws) `end_s`, the working second when it is gone, and
    whether the work is done `in_time`.

    `paid` (fields,) is what the work costs in the mean, `lost` (fields,) what is not done in time takes.
    """

    end_s: Array
    in_time: npt.NDArray[np.bool_]
    paid: Array
    lost: Array

    def probability(self, place: int) -> tuple[float, tuple[float, float]]:
        """Of a field being done in time, with its interval."""
        hits, draws = int(self.in_time[place].sum()), self.in_time.shape[1]
        return hits / draws, wilson(hits, draws)


def chained(
    stops: Sequence[Stop], chances: Chances, begin_s: float, rain_s: Array, *, seed: int, fleet: str
) -> Chain:
    """The day of one fleet in all draws. `rain_s` (draws,) is when it rains, in working seconds."""
    draws = len(rain_s)
    normal = stream(seed, "late fleet", fleet).standard_normal(draws)
    now = begin_s + lognormal(chances.start_delay_s, chances.start_delay_cv, normal)
    on_field = chances.without("late start")
    ends, in_time, paid, lost = [], [], [], []
    for stop in stops:
        start = np.maximum(now + stop.move_s, stop.opens_s)
        limit = np.minimum(rain_s, stop.closes_s)
        sample = draw(stop.graph, on_field, draws=draws, seed=stop.seed, limit_s=limit - start)
        now = start + sample.finish_s
        ends.append(now)
        in_time.append(start + sample.worked_s <= limit)
        paid.append(float(paid_per_draw(sample, stop.terms).mean()))
        lost.append(float((1.0 - sample.done).mean()) * stop.stake)
    shape = (len(stops), draws)
    return Chain(
        np.reshape(ends, shape), np.reshape(in_time, shape).astype(np.bool_), np.asarray(paid), np.asarray(lost)
    )


def rain_draws(onset_s: Array, start_s: float, clock: Workday) -> Array:
    """Onsets after the start as working seconds of the day."""
    return start_s + clock.work_s(onset_s)
