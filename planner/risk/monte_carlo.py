"""Monte Carlo simulation of a run's leg graph (longest path, all samples at once)."""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import dataclass, field

import numpy as np

from fields.arrays import Floats
from fields.geometry.arithmetic import ROUNDING
from fields.units import PCT
from planner.farm.random_inputs import (
    MAX_SLIP_PCT,
    RANDOM_INPUTS,
    UncertaintySettings,
    build_certain_settings,
    compute_log_deviation,
)
from planner.risk.leg_graph import WORK_PASS, LegGraph
from planner.risk.random_events import StopEvents, create_generator, draw_lognormal, draw_stop_events
from vehicle.model.effect_kinds import INTERVAL_SIGMAS

MAX_SLIP_SHARE = MAX_SLIP_PCT / PCT

VARIANCE_SAMPLES = 2000
DEFAULT_SAMPLES = 10_000


@dataclass(frozen=True, eq=False)
class SampledOutcomes:
    """Outcomes per sample; seconds count from the planned start, arrays are (samples,).

    `finish_s` is when the last tractor is done, or out of the field if it leaves by an entrance (`exit_start_s`: when
    the last one sets out for that, None without an entrance); `tractor_finish_s` (tractors, samples), without those
    that rest. `work_s` and `turn_s` are tractor seconds of driving on passes and off them, `worked_share` the share of
    worked metres done at the limit, `start_delay_s` the delay of the start. `leg_factors` (legs, samples) are None
    unless kept. `energy` are the litres or kWh of the fleet: those of every leg grow with its time, and waiting
    tractors idle; None where not known.
    """

    finish_s: Floats
    tractor_finish_s: Floats
    work_s: Floats
    turn_s: Floats
    worked_share: Floats
    start_delay_s: Floats
    leg_factors: Floats | None = None
    exit_start_s: Floats | None = None
    energy: Floats | None = None

    @property
    def work_finish_s(self) -> Floats:
        """When the last tractor has done its work, (samples,)."""
        return self.finish_s if self.exit_start_s is None else self.exit_start_s


def sample_outcomes(
    graph: LegGraph,
    uncertainty: UncertaintySettings,
    *,
    samples: int,
    seed: int,
    limit_s: Floats | None = None,
    keep_factors: bool = False,
) -> SampledOutcomes:
    """Sample the graph with random inputs; `limit_s` (samples,) is when work must be done.

    The same seed gives the same common factors, breakdown times and late starts for every graph. `keep_factors` keeps
    the factors of all legs.
    """
    limits_s = np.full(samples, math.inf) if limit_s is None else limit_s
    return _walk_longest_path(_start_walk(graph, uncertainty, samples, seed), limits_s, keep_factors)


def apply_factors(graph: LegGraph, leg_factors: Floats) -> SampledOutcomes:
    """Outcomes of the graph with these factors (legs, samples) on its driving times and no other variation."""
    samples = leg_factors.shape[1]
    walk = _start_walk(graph, build_certain_settings(), samples, seed=0)
    walk.fixed_factors = leg_factors
    return _walk_longest_path(walk, np.full(samples, math.inf), keep_factors=False)


def compute_slip_factor(uncertainty: UncertaintySettings, normals: Floats) -> Floats:
    """Driving time at a sampled wheel slip relative to the median; ground speed is wheel speed x (1 - slip)."""
    median = 0.01 * uncertainty.slip_pct
    slip = np.minimum(median * np.exp(compute_log_deviation(uncertainty.slip_cv) * normals), MAX_SLIP_SHARE)
    return np.asarray((1.0 - median) / (1.0 - slip))


@dataclass(eq=False)
class _GraphWalk:
    """The state of the walk along all legs: per tractor its time, its driving clock and its current factor.

    `job_factor`, `pass_factor` and `start_delay_s` (samples,) are of the whole job. Each tractor has a generator for
    the factors of its legs, whose spread is `deviation` by kind.
    """

    graph: LegGraph
    job_factor: Floats
    pass_factor: Floats
    start_delay_s: Floats
    generators: list[np.random.Generator]
    deviation: tuple[float, float, float]
    events: list[StopEvents]
    now_s: Floats
    driven_clock_s: Floats
    current_group: list[int]
    factors: list[Floats]
    fixed_factors: Floats | None = None
    opened_s: dict[int, Floats] = field(default_factory=dict)

    def get_factor(self, node: int) -> Floats:
        """The factor of a leg; every new pass or turn draws its numbers, whether they have an effect or not."""
        if self.fixed_factors is not None:
            return np.asarray(self.fixed_factors[node])
        tractor, kind = int(self.graph.tractor[node]), int(self.graph.kind[node])
        if self.current_group[tractor] != self.graph.group[node]:
            self.current_group[tractor] = int(self.graph.group[node])
            normals = self.generators[tractor].standard_normal(len(self.job_factor))
            common_factor, spread = self.pass_factor if kind == WORK_PASS else self.job_factor, self.deviation[kind]
            self.factors[tractor] = common_factor * np.exp(spread * normals) if spread > 0.0 else common_factor
        return self.factors[tractor]

    def apply_waits(self, links: list[int], time_s: Floats, at_end: bool) -> Floats:
        """The time, delayed to the opening of links of this kind."""
        for index in links:
            link = self.graph.links[index]
            if link.at_end == at_end:
                time_s = np.maximum(time_s, self.opened_s.pop(index) + link.delay_s)
        return time_s

    def apply_stops(self, tractor: int, seconds: float, time_s: Floats) -> Floats:
        """The time, delayed by stops and breakdowns in the tractor's next `seconds` of driving."""
        events, start = self.events[tractor], float(self.driven_clock_s[tractor])
        hit = events.find_between(start, start + seconds)
        if hit.start < hit.stop:
            np.add.at(time_s, events.sample[hit], events.duration_s[hit])
        return time_s

    def set_link_openings(
        self, links: list[int], tractor: int, begin_s: Floats, factor: Floats, seconds: float
    ) -> None:
        """Set the opening times of links from a leg of a tractor."""
        for index in links:
            offset = self.graph.links[index].offset_s
            self.opened_s[index] = self.apply_stops(tractor, min(offset, seconds), begin_s + offset * factor)


def _walk_longest_path(walk: _GraphWalk, limit_s: Floats, keep_factors: bool) -> SampledOutcomes:
    """The longest path; values of a leg are kept only as long as later legs need them."""
    graph, samples = walk.graph, len(limit_s)
    links_to, links_from = defaultdict[int, list[int]](list), defaultdict[int, list[int]](list)
    for index, link in enumerate(graph.links):
        links_to[link.after].append(index)
        links_from[link.source].append(index)
    spent_s, worked_m = {True: np.zeros(samples), False: np.zeros(samples)}, np.zeros(samples)
    energy = None if graph.fuel is None else np.zeros(samples)
    total_m = float(graph.worked_m.sum())
    leg_factors = np.ones((graph.node_count, samples)) if keep_factors else None
    exit_start_s = None if graph.leaving is None else np.zeros(samples)
    begun_legs: dict[int, tuple[Floats, Floats]] = {}
    for node in graph.order:
        tractor, incoming = int(graph.tractor[node]), links_to[node]
        if node not in begun_legs:
            seconds, factor = float(graph.driven_s[node]), walk.get_factor(node)
            begin_s = walk.apply_waits(incoming, walk.now_s[tractor], at_end=False) + graph.stand_s[node]
            driven_s = seconds * factor
            begun_legs[node] = begin_s, walk.apply_stops(tractor, seconds, begin_s + driven_s)
            walk.set_link_openings(links_from[node], tractor, begin_s, factor, seconds)
            spent_s[int(graph.kind[node]) == WORK_PASS] += driven_s
            if energy is not None and graph.fuel is not None:
                energy += graph.fuel.driving[node] * factor
            walk.driven_clock_s[tractor] += seconds
            if leg_factors is not None:
                leg_factors[node] = factor
            if any(graph.links[index].at_end for index in incoming):
                continue  # it comes again in the order, once it is known what its end waits for
        begin_s, unhindered_end_s = begun_legs.pop(node)
        walk.now_s[tractor] = end_s = walk.apply_waits(incoming, unhindered_end_s, at_end=True)
        worked_m += graph.worked_m[node] * _compute_done_share(begin_s, end_s, limit_s)
        if exit_start_s is not None and graph.leaving is not None and not graph.leaving[node]:
            exit_start_s = np.maximum(exit_start_s, end_s)
    worked_share = worked_m / total_m if total_m > 0.0 else np.ones(samples)
    if energy is not None and graph.fuel is not None:  # tractors that wait or stand after the start idle
        used_s = (walk.now_s - walk.start_delay_s).sum(axis=0)
        energy = energy + np.maximum(used_s - (spent_s[True] + spent_s[False]), 0.0) * graph.fuel.idle_per_s
    return SampledOutcomes(
        walk.now_s.max(axis=0),
        np.delete(walk.now_s, list(graph.resting), axis=0),
        spent_s[True],
        spent_s[False],
        worked_share,
        walk.start_delay_s,
        leg_factors,
        exit_start_s,
        energy,
    )


def _start_walk(graph: LegGraph, uncertainty: UncertaintySettings, samples: int, seed: int) -> _GraphWalk:
    """The state with all tractors at their first leg, after the start delay."""
    job, slip, late = (create_generator(seed, name).standard_normal(samples) for name in ("job", "slip", "late start"))
    job_factor = np.exp(compute_log_deviation(uncertainty.job_cv) * job)
    start_delay_s = draw_lognormal(uncertainty.start_delay_s, uncertainty.start_delay_cv, late)
    driven_s = [float(graph.driven_s[graph.get_nodes(tractor)].sum()) for tractor in range(graph.tractors)]
    return _GraphWalk(
        graph=graph,
        job_factor=job_factor,
        pass_factor=job_factor * compute_slip_factor(uncertainty, slip),
        start_delay_s=start_delay_s,
        generators=[create_generator(seed, "legs", tractor) for tractor in range(graph.tractors)],
        deviation=(
            compute_log_deviation(uncertainty.speed_cv),
            compute_log_deviation(uncertainty.turn_cv),
            compute_log_deviation(uncertainty.turn_more_cv),
        ),
        events=[
            draw_stop_events(uncertainty, seed, tractor, seconds, job_factor)
            for tractor, seconds in enumerate(driven_s)
        ],
        now_s=np.repeat(start_delay_s[None], graph.tractors, axis=0),
        driven_clock_s=np.zeros(graph.tractors),
        current_group=[-1] * graph.tractors,
        factors=[job_factor] * graph.tractors,
    )


def _compute_done_share(begin_s: Floats, end_s: Floats, limit_s: Floats) -> Floats | float:
    """Share of a leg driven at the limit."""
    if bool((end_s <= limit_s).all()):
        return 1.0
    return np.clip((limit_s - begin_s) / np.maximum(end_s - begin_s, 1e-9), 0.0, 1.0)


def compute_wilson_interval(hits: int, trials: int) -> tuple[float, float]:
    """Wilson score interval of a share (Wilson 1927) at 95 %."""
    share, square = hits / trials, INTERVAL_SIGMAS**2 / trials
    middle = (share + 0.5 * square) / (1.0 + square)
    half = INTERVAL_SIGMAS / (1.0 + square) * math.sqrt(share * (1.0 - share) / trials + 0.25 * square / trials)
    low = 0.0 if hits == 0 else max(0.0, middle - half)
    return low, 1.0 if hits == trials else min(1.0, middle + half)


def compute_variance_shares(
    graph: LegGraph, uncertainty: UncertaintySettings, *, samples: int, seed: int
) -> dict[str, float]:
    """Share of the variance of the finishing time that goes with each input, the others left on, the largest first.

    All on the same random numbers. The shares need not add up to 1: inputs act together.
    """

    def compute_variance(varying: UncertaintySettings) -> float:
        count = min(VARIANCE_SAMPLES, samples)
        return float(np.var(sample_outcomes(graph, varying, samples=count, seed=seed).finish_s))

    total_variance = compute_variance(uncertainty)
    if total_variance < ROUNDING:
        return dict.fromkeys(RANDOM_INPUTS, 0.0)
    shares = {
        name: max(0.0, 1.0 - compute_variance(uncertainty.disable_input(name)) / total_variance)
        for name in RANDOM_INPUTS
    }
    return dict(sorted(shares.items(), key=lambda pair: (-round(pair[1], 6), pair[0])))
