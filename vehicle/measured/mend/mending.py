"""Lowering what the catalogue's statistics leave unexplained: effects and unnamed terms that help runs they never saw.

Where the surprises of a set have no cause, the open-loop error itself is lowered, term by term: an effect, an effect
of the ground at two levels where the runs were made on two grounds, or a term of the rest. A term stays when runs that
had no part in its fit are simulated clearly better.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
import numpy.typing as npt

from vehicle.effects import CATALOGUE, Effect
from vehicle.measured.fit.knobs import Knobs, finest_of, knobs_for, rest_knobs
from vehicle.measured.fit.openloop import (
    Model,
    OpenLoop,
    Term,
    Terms,
    fitted,
    held_out_loss,
    moved,
    slope_of_new,
)
from vehicle.measured.fit.solver import solve
from vehicle.measured.logs.record import Array
from vehicle.measured.surprise.bench import Bench
from vehicle.measured.thresholds import (
    CLEARLY_AT,
    CLEARLY_LARGE,
    DRIVEN,
    FEWEST_RUNS,
    LEAST_LEFT,
    MARKED,
    MOST_TERMS,
    PAIRED,
    RIVALS_LEAVE,
    TRIED,
    TWO_LEVELS,
    WORTH,
)
from vehicle.rest import BY_NAME
from vehicle.tractor import Tractor

Step = Callable[[], None]


@dataclass(frozen=True, eq=False)
class Candidate:
    """New terms for a model: where they start, what is left there, how that changes with them, and what they promise.

    `loss` is what a straight line from there promises with every coordinate following.
    """

    new: Terms
    errors: Array
    columns: Array
    change: Array
    loss: float

    @property
    def smooth(self) -> bool:
        """Whether the terms start at neutral, where those of a limit do not."""
        return all(np.array_equal(term.at, term.knobs.neutral) for term in self.new)


@dataclass(frozen=True, eq=False)
class Mended:
    """The model that was found, and the open-loop error it lowers."""

    loop: OpenLoop
    model: Model


def mend(bench: Bench, tractor: Tractor, start: Terms, step: Step) -> Mended:
    """Terms that lower the open-loop error of runs held out, the most telling first; `start` stays in."""
    loop = OpenLoop(bench)
    model = fitted(loop, start)
    best = held_out_loss(loop, model)
    while len(model.terms) < MOST_TERMS:
        larger = _enlarged(loop, model, best, tractor, step)
        if larger is None:
            break
        model, best = larger
    return Mended(loop, _pruned(loop, model, best, frozenset(term.knobs.id for term in start)))


def _enlarged(loop: OpenLoop, model: Model, best: float, tractor: Tractor, step: Step) -> tuple[Model, float] | None:
    """The model with the most promising candidate or pair of candidates that helps runs it has not seen."""
    found = candidates(loop, model, tractor, step)
    singles = driven(loop, model, sorted(found, key=lambda one: one.loss)[:DRIVEN])
    pair = [terms for terms, loss in best_pair(loop, model, found) if loss < PAIRED * singles[0][1]]
    good = [_accepted(loop, model, best, terms) for terms in pair]
    for terms, loss in singles[:TRIED]:
        larger = _accepted(loop, model, best, terms) if loss < (1.0 - WORTH) * model.loss else None
        if larger:
            good.append(larger)
            break
    # Of two terms each must be worth its place, against the best alone as well.
    return min((one for one in good if one), key=lambda one: one[1] / _worth(one[0], model), default=None)


def driven(loop: OpenLoop, model: Model, found: Sequence[Candidate]) -> list[tuple[Terms, float]]:
    """Candidates simulated as terms of the model, the best first: at the promised coordinates or at their start."""
    out = []
    for one in found:
        better = moved((*model.terms, *one.new), one.change)
        after = loop.errors(better)
        loss, start = float(after @ after), float(one.errors @ one.errors)
        out.append((better, loss) if loss < start else ((*model.terms, *one.new), start))
    return sorted(out, key=lambda each: each[1])


def _worth(larger: Model, model: Model) -> float:
    """Share of the error that may be left for the terms a model has more than another one."""
    more = {entry_of(name) for name in larger.ids} - {entry_of(name) for name in model.ids}
    return float((1.0 - WORTH) ** len(more))


def _accepted(loop: OpenLoop, model: Model, best: float, terms: Terms) -> tuple[Model, float] | None:
    """A larger model and its error on runs held out, if that is worth its terms."""
    larger = fitted(loop, terms)
    loss = held_out_loss(loop, larger)
    new = larger.terms[len(model.terms) :]
    if not all(_beyond_tolerance(loop, term) for term in new if term.runs is None):
        return None
    return (larger, loss) if loss < _worth(larger, model) * best and not _at_a_limit(new) else None


def _beyond_tolerance(loop: OpenLoop, term: Term, times: float = 1.0) -> bool:
    """Whether an effect is more than the tolerance of the tractor file; a term of the rest has none."""
    name, bench = term.knobs.id, loop.bench
    if name in BY_NAME:
        return True
    tractor = bench.rig.tractor
    return term.knobs.deviation(term.at) > times * finest_of(tractor, name, bench.row_s)


def _at_a_limit(terms: Terms) -> bool:
    """Whether a coordinate ran as far as a tractor can have it: such a fit stands for something else."""
    return any(
        np.any((term.at <= np.array(term.knobs.low)) & (np.array(term.knobs.low) < np.array(term.knobs.neutral)))
        or np.any((term.at >= np.array(term.knobs.high)) & (np.array(term.knobs.high) > np.array(term.knobs.neutral)))
        for term in terms
    )


def _pruned(loop: OpenLoop, model: Model, best: float, kept: frozenset[str]) -> Model:
    """Leave out, one by one, what later terms have made superfluous."""
    for name in sorted({entry_of(name) for name in model.ids - kept}):
        smaller = fitted(loop, tuple(term for term in model.terms if entry_of(term.knobs.id) != name), 2)
        loss = held_out_loss(loop, smaller)
        if loss < best / (1.0 - WORTH):
            return _pruned(loop, smaller, loss, kept)
    return model


def entry_of(name: str) -> str:
    """What enters and leaves as one: an effect, or a term of the rest with both components of its direction."""
    return name.split("_to_")[0]


def candidates(
    loop: OpenLoop, model: Model, tractor: Tractor, step: Step, skip: frozenset[str] = frozenset()
) -> list[Candidate]:
    """Every effect and term of the rest that is not in the model, each at its best with the others following."""
    found = []
    for entry in CATALOGUE:
        if entry.id in model.ids | skip or entry.stands_in:
            continue
        step()
        found += _of_effect(loop, model, tractor, entry)
    for group in rest_knobs():
        if group[0].id not in model.ids:
            step()
            new = tuple(Term(knobs, np.zeros(1)) for knobs in group)
            found.append(_promising(loop, model, new, model.errors))
    return found


def _of_effect(loop: OpenLoop, model: Model, tractor: Tractor, entry: Effect) -> list[Candidate]:
    """An effect from its best start and, if it is one of the ground, at two levels."""
    knobs = knobs_for(tractor, entry.id).with_fewer_starts()
    neutral = np.array(knobs.neutral)
    starts = [np.array(at) for at in knobs.starts if at != knobs.neutral]
    errors = [model.errors, *[loop.errors((*model.terms, Term(knobs, at))) for at in starts]]
    starts = [neutral, *starts]
    losses = np.array([loop.by_run(one) for one in errors])
    first = int(np.argmin(losses.sum(axis=1)))
    found = [_promising(loop, model, (Term(knobs, starts[first]),), errors[first])]
    if entry.of_ground:
        levels = _two_levels(knobs, starts, losses)
        if levels:
            found.append(_promising(loop, model, levels, loop.errors((*model.terms, *levels))))
    return found


def _two_levels(knobs: Knobs, tried: Sequence[Array], losses: Array) -> Terms:
    """The effect at two levels, each run at the one that suits it; empty unless two suit clearly better than one."""
    best = TWO_LEVELS * float(losses.sum(axis=1).min())
    found: Terms = ()
    for one, two in combinations(range(len(tried)), 2):
        at_two = losses[two] < losses[one]
        loss = float(np.where(at_two, losses[two], losses[one]).sum())
        if loss < best and FEWEST_RUNS <= int(at_two.sum()) <= len(at_two) - FEWEST_RUNS:
            runs = frozenset(np.flatnonzero(at_two).tolist())
            rest = frozenset(range(len(at_two))) - runs
            best, found = loss, (Term(knobs, tried[one], rest), Term(knobs, tried[two], runs))
    return found


def _promising(loop: OpenLoop, model: Model, new: Terms, errors: Array) -> Candidate:
    """New terms whose errors, where they start, are known."""
    columns = slope_of_new(loop, (*model.terms, *new), errors, len(new))
    slope = np.concatenate([model.slope, columns], axis=1)
    change = solve(slope, errors)
    left = errors + slope @ change
    return Candidate(new, errors, columns, change, float(left @ left))


def best_pair(loop: OpenLoop, model: Model, found: Sequence[Candidate]) -> list[tuple[Terms, float]]:
    """The two candidates that promise most together, simulated: causes that mask each other show only so."""
    base = [one for one in found if one.smooth]
    columns = np.concatenate([model.slope, *[one.columns for one in base]], axis=1)
    square, side = columns.T @ columns, columns.T @ model.errors
    shared, last = model.slope.shape[1], np.cumsum([one.columns.shape[1] for one in base])
    places = [np.arange(end - one.columns.shape[1], end) + shared for one, end in zip(base, last, strict=True)]

    def chosen(pair: tuple[int, int]) -> npt.NDArray[np.int64]:
        return np.concatenate([np.arange(shared), places[pair[0]], places[pair[1]]])

    def gain(pair: tuple[int, int]) -> float:
        mine = chosen(pair)
        return float(side[mine] @ np.linalg.pinv(square[np.ix_(mine, mine)], hermitian=True) @ side[mine])

    options = list(combinations(range(len(base)), 2))
    if not options:
        return []
    best = max(options, key=gain)
    new = (*base[best[0]].new, *base[best[1]].new)
    terms = moved((*model.terms, *new), solve(columns[:, chosen(best)], model.errors))
    errors = loop.errors(terms)
    return [(terms, float(errors @ errors))]


def irreplaceable(mended: Mended, tractor: Tractor, noise: float, step: Step) -> list[str]:
    """Effects that may carry a name though parts of the error have none: nothing else lowers the error as they do.

    Losses count from what `noise` alone leaves, and from a twentieth of what can be taken away.

    Without such an effect the others, fitted again, leave clearly more, and so does the best other effect or term of
    the rest in its place (of those that may enter here).
    """
    loop, model = mended.loop, mended.model

    def left(loss: float) -> float:
        return max(loss - noise, LEAST_LEFT * (1.0 - noise))

    found = []
    for name in sorted(model.ids - frozenset(BY_NAME)):
        smaller = fitted(loop, tuple(term for term in model.terms if term.knobs.id != name), 2)
        step()
        if left(model.loss) > (1.0 - MARKED) * left(smaller.loss) or not _clearly_large(loop, model, name):
            continue
        others = candidates(loop, smaller, tractor, step, frozenset({name}))
        rivals = driven(loop, smaller, sorted(others, key=lambda one: one.loss)[:DRIVEN])[:TRIED]
        if all(left(fitted(loop, terms, 2).loss) > RIVALS_LEAVE * left(model.loss) for terms, _ in rivals):
            found.append(name)
    return found


def _clearly_large(loop: OpenLoop, model: Model, name: str) -> bool:
    return any(_beyond_tolerance(loop, term, CLEARLY_LARGE) for term in model.terms if term.knobs.id == name)


def clear_levels(mended: Mended) -> list[tuple[Term, tuple[int, ...]]]:
    """Terms of effects with two levels, each with the runs that are clearly worse off with the other one."""
    loop, terms = mended.loop, mended.model.terms
    losses = [loop.by_run(loop.errors(level_of(terms, level))) for level in (0, 1)]
    clear = np.abs(losses[0] - losses[1]) > CLEARLY_AT * np.maximum(losses[0], losses[1])
    found = []
    for term in terms:
        if term.runs is not None:
            found.append((term, tuple(run for run in sorted(term.runs) if clear[run])))
    return found


def level_of(terms: Terms, level: int) -> Terms:
    """Terms with the first (0) or second (1) level of every effect that has two, in all runs."""
    seen: dict[str, list[Term]] = {}
    for term in terms:
        seen.setdefault(term.knobs.id, []).append(term)
    return tuple(replace(levels[min(level, len(levels) - 1)], runs=None) for levels in seen.values())
