"""Random stops and breakdowns of tractors, and random numbers by name: the same for every plan with one seed."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from fields.arrays import Floats, Integers
from fields.units import HOUR_S
from planner.farm.random_inputs import UncertaintySettings, compute_log_deviation


def create_generator(seed: int, *names: str | int) -> np.random.Generator:
    """A generator that depends on the seed and the names alone (Philox: counter-based, the same on all machines)."""
    text = "/".join(str(part) for part in (seed, *names))
    key = int.from_bytes(hashlib.sha256(text.encode()).digest()[:16], "little")
    return np.random.Generator(np.random.Philox(key=key))


@dataclass(frozen=True, eq=False)
class StopEvents:
    """Stops of one tractor, arrays (events,) sorted by `at_s`, its driving second in the simulation.

    `sample` is the sample of each event, `duration_s` its duration.
    """

    at_s: Floats
    sample: Integers
    duration_s: Floats

    def find_between(self, start_s: float, end_s: float) -> slice:
        """Events from `start_s` to before `end_s`."""
        first, last = np.searchsorted(self.at_s, (start_s, end_s))
        return slice(int(first), int(last))


def draw_stop_events(
    uncertainty: UncertaintySettings, seed: int, tractor: int, driven_s: float, job_factor: Floats
) -> StopEvents:
    """Stops and breakdowns of a tractor that drives `driven_s` in the simulation, times `job_factor` (samples,).

    They come at a constant rate of driving time; a tractor's first breakdown comes after the same hours in every plan.
    """
    every_h = uncertainty.breakdown_hours
    laws = (
        ("stop", uncertainty.stops_per_hour, uncertainty.stop_s, uncertainty.stop_cv, uncertainty.stop_durations_s),
        ("breakdown", 1.0 / every_h if every_h > 0.0 else 0.0, uncertainty.repair_s, uncertainty.repair_cv, ()),
    )
    arrivals = [
        event
        for name, rate, mean, cv, seen in laws
        for event in _draw_event_times(
            create_generator(seed, name, tractor), rate, (mean, cv, seen), driven_s, job_factor
        )
    ]
    at_s, sample, duration_s = (
        (np.concatenate(column) for column in zip(*arrivals, strict=True)) if arrivals else (np.zeros(0),) * 3
    )
    order = np.lexsort((sample, at_s))
    return StopEvents(at_s[order], sample[order].astype(np.int64), duration_s[order])


def draw_lognormal(mean: float, cv: float, normals: Floats) -> Floats:
    """Lognormal values with this mean and coefficient of variation, from standard normal numbers."""
    spread = compute_log_deviation(cv)
    return np.asarray(mean * np.exp(spread * normals - 0.5 * spread * spread))


def _draw_event_times(
    generator: np.random.Generator,
    per_hour: float,
    duration_law: tuple[float, float, tuple[float, ...]],
    driven_s: float,
    job_factor: Floats,
) -> Iterator[tuple[Floats, Integers, Floats]]:
    """The first, second, ... events of all samples, until none comes before the tractor is done."""
    if per_hour <= 0.0:
        return
    mean, cv, observed_s = duration_law
    clock_s = np.zeros(len(job_factor))
    while True:
        clock_s = clock_s + generator.exponential(HOUR_S / per_hour, len(job_factor))
        normals = generator.standard_normal(len(job_factor))
        observed_index = generator.integers(max(1, len(observed_s)), size=len(job_factor))
        at_s = clock_s / job_factor
        (hit_samples,) = np.nonzero(at_s < driven_s)
        if not len(hit_samples):
            return
        duration_s = (
            np.array(observed_s)[observed_index[hit_samples]]
            if observed_s
            else draw_lognormal(mean, cv, normals[hit_samples])
        )
        yield at_s[hit_samples], hit_samples, duration_s
