"""What the draws say: the probability of being done in time, when the job is done, what drives the spread."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from planner.chance.draws import Sample, draw
from planner.chance.graph import Graph, graph_of
from planner.chance.rain import Rain
from planner.chance.settings import INPUTS, Chances
from vehicle.run import Run

Z95 = 1.959963984540054
QUANTILES = (0.50, 0.80, 0.95)
DRIVER_DRAWS = 2000
SAME_VARIANCE_S2 = 1e-9
DRAWS = 10_000
DEFAULT = Chances()
Array = npt.NDArray[np.float64]


class Day(Protocol):
    """How much of the time after the start is for work, and how much of that goes before field work begins."""

    @property
    def before_s(self) -> float: ...

    def work_s(self, clock_s: Array) -> Array: ...


@dataclass(frozen=True)
class Question:
    """What is asked of every plan: the laws, rain and deadline (seconds after the start), number of draws and seed.

    On a farm's `day` not all time until then is time for field work.
    """

    chances: Chances = DEFAULT
    rain: Rain | None = None
    deadline_s: float | None = None
    draws: int = DRAWS
    seed: int = 1
    day: Day | None = None

    def field_limit_s(self) -> Array:
        """Seconds of field work that fit before work has to be done, (draws,)."""
        limit = self.limit_s()
        return limit if self.day is None else self.day.work_s(limit) - self.day.before_s

    def limit_s(self) -> Array:
        """When work has to be done, (draws,): at the deadline or the rain; infinite without either."""
        rain = np.full(self.draws, math.inf) if self.rain is None else self.rain.draw(self.draws, self.seed)
        return rain if self.deadline_s is None else np.minimum(rain, self.deadline_s)

    @property
    def has_limit(self) -> bool:
        """Whether there is anything to be in time for."""
        return self.rain is not None or self.deadline_s is not None


@dataclass(frozen=True, eq=False)
class Answer:
    """The figures of one plan.

    `finish_probability` and its Wilson interval (95 %) are None where there is no deadline and no rain. `mean_s` and
    the quantiles are of the time the last tractor is done; `undone` is the share of the work that is not done at the
    limit, in the mean. `drivers` are shares of the variance of the finishing time that goes when an input is switched
    off, by name. `sample` are the draws.
    """

    finish_probability: float | None
    finish_probability_interval: tuple[float, float] | None
    mean_s: float
    p50_s: float
    p80_s: float
    p95_s: float
    undone: float
    drivers: dict[str, float]
    sample: Sample


def answer(run: Run, question: Question, *, drivers: bool = True) -> Answer:
    """What the draws say of a run that was driven to its end."""
    return answer_of(graph_of(run), question, drivers=drivers)


def answer_of(graph: Graph, question: Question, *, drivers: bool = True) -> Answer:
    """The same of its graph."""
    limit = question.field_limit_s()
    sample = draw(graph, question.chances, draws=question.draws, seed=question.seed, limit_s=limit)
    in_time = int((sample.worked_s <= limit).sum())
    p50, p80, p95 = (float(value) for value in np.quantile(sample.finish_s, QUANTILES))
    return Answer(
        finish_probability=in_time / question.draws if question.has_limit else None,
        finish_probability_interval=wilson(in_time, question.draws) if question.has_limit else None,
        mean_s=float(sample.finish_s.mean()),
        p50_s=p50,
        p80_s=p80,
        p95_s=p95,
        undone=float(1.0 - sample.done.mean()),
        drivers=drivers_of(graph, question) if drivers else {},
        sample=sample,
    )


def wilson(hits: int, of: int, z: float = Z95) -> tuple[float, float]:
    """Interval of Wilson (1927) for a share; by default 95 %."""
    share, square = hits / of, z * z / of
    middle = (share + 0.5 * square) / (1.0 + square)
    half = z / (1.0 + square) * math.sqrt(share * (1.0 - share) / of + 0.25 * square / of)
    low = 0.0 if hits == 0 else max(0.0, middle - half)
    return low, 1.0 if hits == of else min(1.0, middle + half)


def drivers_of(graph: Graph, question: Question, draws: int = DRIVER_DRAWS) -> dict[str, float]:
    """Share of the variance of the finishing time that goes with each input, the others left on, the largest first.

    All on the same random numbers. The shares need not add up to 1: inputs act together.
    """
    draws = min(draws, question.draws)

    def variance(chances: Chances) -> float:
        return float(np.var(draw(graph, chances, draws=draws, seed=question.seed).finish_s))

    whole = variance(question.chances)
    if whole < SAME_VARIANCE_S2:
        return dict.fromkeys(INPUTS, 0.0)
    shares = {name: max(0.0, 1.0 - variance(question.chances.without(name)) / whole) for name in INPUTS}
    return dict(sorted(shares.items(), key=lambda pair: (-round(pair[1], 6), pair[0])))
