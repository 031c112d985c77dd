"""Effects of the ground at two levels, because runs were made on two grounds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from vehicle.measured.fit.knobs import Knobs
from vehicle.measured.fit.openloop import Model, OpenLoop, Term, Terms
from vehicle.measured.logs.record import Array
from vehicle.measured.replay.course import Course
from vehicle.measured.thresholds import CLEARLY_AT, FEWEST_RUNS, TWO_LEVELS


def two_levels(knobs: Knobs, starts: Sequence[Array], losses: Array) -> Terms:
    """The effect at two of its starts, each run at the better one; empty unless two suit clearly better than one.

    `losses` (starts, runs) are the squared errors of every run from every start.
    """
    best = TWO_LEVELS * float(losses.sum(axis=1).min())
    levels: Terms = ()
    for one, two in combinations(range(len(starts)), 2):
        at_two = losses[two] < losses[one]
        loss = float(np.where(at_two, losses[two], losses[one]).sum())
        if loss < best and FEWEST_RUNS <= int(at_two.sum()) <= len(at_two) - FEWEST_RUNS:
            runs = frozenset(np.flatnonzero(at_two).tolist())
            rest = frozenset(range(len(at_two))) - runs
            best, levels = loss, (Term(knobs, starts[one], rest), Term(knobs, starts[two], runs))
    return levels


def level_of(terms: Terms, level: int) -> Terms:
    """Terms with the first (0) or second (1) level of every effect that has two, in all runs."""
    seen: dict[str, list[Term]] = {}
    for term in terms:
        seen.setdefault(term.knobs.id, []).append(term)
    return tuple(replace(levels[min(level, len(levels) - 1)], runs=None) for levels in seen.values())


def clear_levels(loop: OpenLoop, model: Model) -> list[tuple[Term, tuple[int, ...]]]:
    """Terms of effects with two levels, each with the runs that are clearly worse off with the other one."""
    terms = model.terms
    losses = [loop.by_run(loop.errors(level_of(terms, level))) for level in (0, 1)]
    clear = np.abs(losses[0] - losses[1]) > CLEARLY_AT * np.maximum(losses[0], losses[1])
    return [(term, tuple(run for run in sorted(term.runs) if clear[run])) for term in terms if term.runs is not None]


def driven_seconds(course: Course) -> Array:
    """Driving time in use, per run (runs,)."""
    seconds = np.zeros(len(course.names))
    for stretch in course.stretches:
        seconds[stretch.run] += stretch.time[-1]
    return seconds


def main_terms(terms: Sequence[Term], seconds: Array) -> Terms:
    """The terms, with the level of the longer driving where an effect has two, or the one that is not neutral."""

    def weight(term: Term) -> tuple[bool, float]:
        if term.runs is None:
            return True, float(seconds.sum())
        return term.knobs.deviation(term.at) > 0.0, float(seconds[sorted(term.runs)].sum())

    best = {term.knobs.id: term for term in sorted(terms, key=weight)}
    return tuple(term for term in terms if best[term.knobs.id] is term)
