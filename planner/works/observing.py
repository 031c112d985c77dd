"""Events of runs that a farm can learn from: speeds of passes, turns, stops, and when the headland was worked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import shapely

from planner.works.estimates import Estimate, estimate, mean, median, rate, share, variation
from planner.works.phases import Phases, phases, stretches
from planner.works.record import Array, Driven
from planner.works.summary import MOVING_MPS
from reports.work_results import KINDS, STANDING

PASS_S = 20.0
"""Shorter stretches of work are no passes."""
FEWEST, MOST_OVER = 5, 10
EDGE, INNER, LEAST = 1.0, 3.0, 0.05
"""Work nearer to the outline than so many widths is headland, farther than so many inside; both at least that share."""


class Observed:
    """What runs show, a name to every kind of event; `width_m` says how many tracks a turn leads over."""

    def __init__(self, runs: Sequence[Driven], width_m: float) -> None:
        """Take runs whose work state is known."""
        self.width_m = width_m
        self.runs = [run for run in runs if run.works_known]
        self.done: dict[str, Phases] = {run.name: phases(run) for run in self.runs}

    def speed_mps(self) -> Estimate | None:
        """The working speed: the median of the mean speeds of passes."""
        return estimate({run.name: _passes(run) for run in self.runs}, median, FEWEST)

    def pass_cv(self) -> Estimate | None:
        """How the mean speed varies from pass to pass, over the mean of its run."""
        passes = {run.name: _passes(run) for run in self.runs}
        ratios = {name: each / each.mean() for name, each in passes.items() if len(each) >= FEWEST}
        return estimate(ratios, variation, FEWEST)

    def turns_s(self, least: int, most: int | None = None) -> Mapping[str, Array]:
        """Seconds of turns back without a stop that lead over `least` tracks to `most`, by run."""
        return {
            name: np.array(
                [one.seconds for one in done.turns if one.is_u and _over(one.apart_m, self.width_m, least, most)]
            )
            for name, done in self.done.items()
        }

    def turn_s(self) -> tuple[int, Estimate] | None:
        """Seconds of the turn that is driven most: over how many tracks, and the median."""
        counts = {over: sum(map(len, self.turns_s(over, over).values())) for over in (1, 2, 3, 4)}
        over = max(counts, key=lambda each: counts[each])
        found = estimate(self.turns_s(over, over), median, FEWEST)
        return None if found is None else (over, found)

    def turn_cv(self) -> Estimate | None:
        """How the time of turns over one track varies."""
        return estimate(self.turns_s(1, 1), variation, 2 * FEWEST)

    def turn_more_cv(self) -> Estimate | None:
        """How the time of turns over more tracks varies, over the mean of all turns over as many."""
        ratios: dict[str, list[float]] = {run.name: [] for run in self.runs}
        for over in range(2, MOST_OVER + 1):
            found = self.turns_s(over, over)
            whole = np.concatenate(list(found.values()))
            if len(whole) >= FEWEST:
                for name, each in found.items():
                    ratios[name] += (each / whole.mean()).tolist()
        return estimate({name: np.array(each) for name, each in ratios.items()}, variation, 2 * FEWEST)

    def stops_per_hour(self) -> Estimate | None:
        """Stops per hour in which the machine did not stand."""
        return rate({run.name: (len(self.done[run.name].stops_s), self._driven_h(run)) for run in self.runs})

    def _driven_h(self, run: Driven) -> float:
        lasts = np.diff(run.time_s)
        return float(lasts[self.done[run.name].kinds != KINDS.index(STANDING)].sum()) / 3600.0

    def stop_s(self) -> Estimate | None:
        """How long a stop is in the mean."""
        return estimate({name: done.stops_s for name, done in self.done.items()}, mean, FEWEST)

    def stop_cv(self) -> Estimate | None:
        """How the length of stops varies."""
        return estimate({name: done.stops_s for name, done in self.done.items()}, variation, 2 * FEWEST)

    def headland_first(self) -> Estimate | None:
        """The share of runs that worked the edge of the field before its inside; None where no run shows either."""
        told = {run.name: first for run in self.runs if (first := _edge_first(run, self.width_m)) is not None}
        return share(sum(told.values()), tuple(told)) if told else None


def _over(apart_m: float, width_m: float, least: int, most: int | None) -> bool:
    over = apart_m / width_m
    return over > least - 0.5 and (most is None or over <= most + 0.5)


def _passes(run: Driven) -> Array:
    """Mean speeds (n,) of stretches of work."""
    found = []
    for first, last in stretches(run.works):
        speed = run.speed_mps[first:last]
        speed = speed[speed > MOVING_MPS]
        if run.time_s[last - 1] - run.time_s[first] >= PASS_S and len(speed):
            found.append(float(speed.mean()))
    return np.array(found)


def _edge_first(run: Driven, width_m: float) -> bool | None:
    """Whether the edge was worked before the inside, by the mean time of either; None where one is hardly worked."""
    if run.outline is None:
        return None
    off = shapely.distance(run.outline.boundary, shapely.points(run.xy))
    edge, inner = run.works & (off < EDGE * width_m), run.works & (off > INNER * width_m)
    if min(int(edge.sum()), int(inner.sum())) < LEAST * max(int(run.works.sum()), 1):
        return None
    return bool(run.time_s[edge].mean() < run.time_s[inner].mean())
