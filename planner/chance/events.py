"""Stops and breakdowns: they come at a constant rate on the driven clock of a tractor and last a random time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from planner.chance.settings import Chances, sigma
from planner.chance.streams import stream

HOUR_S = 3600.0
Array = npt.NDArray[np.float64]
Whole = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Events:
    """What holds up one tractor, sorted by `at_s`, the driven second of the simulation at which it comes.

    `draw` says in which draw, `lasts_s` for how long; all (events,).
    """

    at_s: Array
    draw: Whole
    lasts_s: Array

    def between(self, start_s: float, end_s: float) -> slice:
        """Those from `start_s` up to but not at `end_s`."""
        first, last = np.searchsorted(self.at_s, (start_s, end_s))
        return slice(int(first), int(last))


def events_of(chances: Chances, seed: int, tractor: int, driven_s: float, pace: Array) -> Events:
    """Stops and breakdowns of a tractor that drives `driven_s` in the simulation, `pace` (draws,) times that in a draw.

    The clocks of a tractor are the same in every plan: the first breakdown comes after the same hours of driving.
    """
    every_h = chances.breakdown_hours
    laws = (
        ("stop", chances.stops_per_hour, chances.stop_s, chances.stop_cv, chances.stop_durations_s),
        ("breakdown", 1.0 / every_h if every_h > 0.0 else 0.0, chances.repair_s, chances.repair_cv, ()),
    )
    found = [
        event
        for name, rate, mean, cv, seen in laws
        for event in _arrivals(stream(seed, name, tractor), rate, (mean, cv, seen), driven_s, pace)
    ]
    at, draw, lasts = (np.concatenate(column) for column in zip(*found, strict=True)) if found else _nothing()
    order = np.lexsort((draw, at))
    return Events(at[order], draw[order].astype(np.int64), lasts[order])


def lognormal(mean: float, cv: float, normal: Array) -> Array:
    """Values of a lognormal law with this mean and coefficient of variation, from normal numbers."""
    spread = sigma(cv)
    return np.asarray(mean * np.exp(spread * normal - 0.5 * spread * spread))


def _nothing() -> tuple[Array, Array, Array]:
    return np.zeros(0), np.zeros(0), np.zeros(0)


def _arrivals(
    random: np.random.Generator, per_hour: float, law: tuple[float, float, tuple[float, ...]], driven_s: float,
    pace: Array,
) -> Iterator[tuple[Array, Whole, Array]]:  # fmt: skip
    """First, second, ... event of every draw, as long as one of them comes before the tractor is done."""
    if per_hour <= 0.0:
        return
    mean, cv, seen = law
    clock = np.zeros(len(pace))
    while True:
        clock = clock + random.exponential(HOUR_S / per_hour, len(pace))
        luck = random.standard_normal(len(pace))
        which = random.integers(max(1, len(seen)), size=len(pace))
        at = clock / pace
        (hit,) = np.nonzero(at < driven_s)
        if not len(hit):
            return
        lasts = np.array(seen)[which[hit]] if seen else lognormal(mean, cv, luck[hit])
        yield at[hit], hit, lasts
