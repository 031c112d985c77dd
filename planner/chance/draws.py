"""Draws through the graph of a run: the longest path, one leg after another and all draws of it at once."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from planner.chance.events import Events, events_of, lognormal
from planner.chance.graph import PASS, Graph
from planner.chance.settings import Chances, certain, sigma
from planner.chance.streams import stream

MOST_SLIPPING = 0.9
Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Sample:
    """What came out, per draw. Seconds count from the planned start.

    `finish_s` (draws,) when the last tractor is done, and gone where it leaves by an entrance (`left_s`: when the last
    one sets out for that, None where nobody does), `tractor_s` (tractors, draws) each of them; `work_s` and `turn_s`
    (draws,) tractor seconds of driving on passes and off them; `done` (draws,) the share of all worked metres that is
    done at the limit; `late_s` (draws,) by how much the fleet began late; `factor` (legs, draws) on the seconds of
    every leg where that was to be kept.
    """

    finish_s: Array
    tractor_s: Array
    work_s: Array
    turn_s: Array
    done: Array
    late_s: Array
    factor: Array | None = None
    left_s: Array | None = None

    @property
    def worked_s(self) -> Array:
        """When the last tractor is through with its work, (draws,)."""
        return self.finish_s if self.left_s is None else self.left_s


@dataclass(frozen=True, eq=False)
class _Luck:
    """Factors that hold for the whole job, (draws,), and the normal numbers of each tractor for the rest."""

    job: Array
    on_passes: Array
    late_s: Array
    random: tuple[np.random.Generator, ...]


def draw(
    graph: Graph, chances: Chances, *, draws: int, seed: int, limit_s: Array | None = None, keep: bool = False
) -> Sample:
    """Drive the graph so many times with random inputs; `limit_s` (draws,) is when work has to be done.

    The same seed gives the same common factors, clocks of breakdowns and late starts for every graph. `keep` keeps the
    factors of all legs.
    """
    luck = _luck(graph, chances, draws, seed)
    limit = np.full(draws, math.inf) if limit_s is None else limit_s
    return _driven(_walk(graph, chances, seed, luck), limit, keep)


def drive(graph: Graph, factor: Array) -> Sample:
    """Drive the graph with these factors (legs, draws) on the seconds of its legs, and nothing else that varies."""
    calm, draws = certain(), factor.shape[1]
    walk = _walk(graph, calm, 0, _luck(graph, calm, draws, 0))
    walk.given = factor
    return _driven(walk, np.full(draws, math.inf), keep=False)


def slip_factor(chances: Chances, normal: Array) -> Array:
    """Seconds at a drawn wheel slip over those at the median: speed over ground is that of the wheels less slip."""
    median = 0.01 * chances.slip_pct
    slip = np.minimum(median * np.exp(sigma(chances.slip_cv) * normal), MOST_SLIPPING)
    return np.asarray((1.0 - median) / (1.0 - slip))


def _luck(graph: Graph, chances: Chances, draws: int, seed: int) -> _Luck:
    job = np.exp(sigma(chances.job_cv) * stream(seed, "job").standard_normal(draws))
    slip = slip_factor(chances, stream(seed, "slip").standard_normal(draws))
    normal = stream(seed, "late start").standard_normal(draws)
    late = lognormal(chances.start_delay_s, chances.start_delay_cv, normal)
    random = tuple(stream(seed, "legs", tractor) for tractor in range(graph.tractors))
    return _Luck(job, job * slip, late, random)


@dataclass(eq=False)
class _Walk:
    """The walk along all legs: where every tractor is, in time and on its driven clock, and what its next leg asks."""

    graph: Graph
    luck: _Luck
    deviation: tuple[float, float, float]
    events: list[Events]
    now: Array
    clock: Array
    group: list[int]
    factors: list[Array]
    given: Array | None = None
    opened: dict[int, Array] = field(default_factory=dict)

    def factor(self, node: int) -> Array:
        """The factor of a leg; a pass or turn that begins takes its numbers whether they count or not."""
        if self.given is not None:
            return np.asarray(self.given[node])
        own, kind = int(self.graph.tractor[node]), int(self.graph.kind[node])
        if self.group[own] != self.graph.group[node]:
            self.group[own] = int(self.graph.group[node])
            normal = self.luck.random[own].standard_normal(len(self.luck.job))
            common, spread = self.luck.on_passes if kind == PASS else self.luck.job, self.deviation[kind]
            self.factors[own] = common * np.exp(spread * normal) if spread > 0.0 else common
        return self.factors[own]

    def waits(self, links: list[int], time: Array, at_end: bool) -> Array:
        """The time, or later where a link of that kind is not open by then."""
        for index in links:
            link = self.graph.links[index]
            if link.at_end == at_end:
                time = np.maximum(time, self.opened.pop(index) + link.delay_s)
        return time

    def held(self, own: int, seconds: float, time: Array) -> Array:
        """The time with what holds a tractor up in its next seconds of driving."""
        events, start = self.events[own], float(self.clock[own])
        hit = events.between(start, start + seconds)
        if hit.start < hit.stop:
            np.add.at(time, events.draw[hit], events.lasts_s[hit])
        return time

    def opens(self, links: list[int], own: int, begin: Array, factor: Array, seconds: float) -> None:
        """When others may go that wait for a tractor on this leg."""
        for index in links:
            offset = self.graph.links[index].offset_s
            self.opened[index] = self.held(own, min(offset, seconds), begin + offset * factor)


def _driven(walk: _Walk, limit: Array, keep: bool) -> Sample:
    """The longest path. What is held per leg is only what a leg after it still asks for."""
    graph, draws = walk.graph, len(limit)
    links_to, links_from = _by_node(graph)
    spent, done = {True: np.zeros(draws), False: np.zeros(draws)}, np.zeros(draws)
    whole = float(graph.worked_m.sum())
    kept = np.ones((graph.nodes, draws)) if keep else None
    left = None if graph.leaving is None else np.zeros(draws)
    begun: dict[int, tuple[Array, Array]] = {}
    for node in graph.order:
        own, to = int(graph.tractor[node]), links_to.get(node, [])
        if node not in begun:
            seconds, factor = float(graph.driven_s[node]), walk.factor(node)
            begin = walk.waits(to, walk.now[own], at_end=False) + graph.stand_s[node]
            driven = seconds * factor
            begun[node] = begin, walk.held(own, seconds, begin + driven)
            walk.opens(links_from.get(node, []), own, begin, factor, seconds)
            spent[int(graph.kind[node]) == PASS] += driven
            walk.clock[own] += seconds
            if kept is not None:
                kept[node] = factor
            if any(graph.links[index].at_end for index in to):
                continue  # it stands in the order once more, when it is known what its end waits for
        begin, alone = begun.pop(node)
        walk.now[own] = end = walk.waits(to, alone, at_end=True)
        done += graph.worked_m[node] * _share(begin, end, limit)
        if left is not None and graph.leaving is not None and not graph.leaving[node]:
            left = np.maximum(left, end)
    share = done / whole if whole > 0.0 else np.ones(draws)
    return Sample(walk.now.max(axis=0), walk.now, spent[True], spent[False], share, walk.luck.late_s, kept, left)


def _walk(graph: Graph, chances: Chances, seed: int, luck: _Luck) -> _Walk:
    """All tractors at their first leg, late as they are."""
    driven = [float(graph.driven_s[graph.of(tractor)].sum()) for tractor in range(graph.tractors)]
    return _Walk(
        graph=graph,
        luck=luck,
        deviation=(sigma(chances.speed_cv), sigma(chances.turn_cv), sigma(chances.turn_more_cv)),
        events=[events_of(chances, seed, tractor, seconds, luck.job) for tractor, seconds in enumerate(driven)],
        now=np.repeat(luck.late_s[None], graph.tractors, axis=0),
        clock=np.zeros(graph.tractors),
        group=[-1] * graph.tractors,
        factors=[luck.job] * graph.tractors,
    )


def _share(begin: Array, end: Array, limit: Array) -> Array | float:
    """Share of a leg that is driven at the limit."""
    if bool((end <= limit).all()):
        return 1.0
    return np.clip((limit - begin) / np.maximum(end - begin, 1e-9), 0.0, 1.0)


def _by_node(graph: Graph) -> tuple[dict[int, list[int]], dict[int, list[int]]]:
    """Numbers of the links to a node and from it."""
    links_to: dict[int, list[int]] = {}
    links_from: dict[int, list[int]] = {}
    for index, link in enumerate(graph.links):
        links_to.setdefault(link.after, []).append(index)
        links_from.setdefault(link.source, []).append(index)
    return links_to, links_from
