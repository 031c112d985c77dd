"""What could lower the open-loop error further: every effect and term of the rest, and the best pair of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import numpy.typing as npt

from vehicle.effects import CATALOGUE, Effect
from vehicle.measured.fit.knobs import knobs_for, rest_knobs
from vehicle.measured.fit.openloop import Model, OpenLoop, Term, Terms, moved, slope_of_new
from vehicle.measured.fit.products import crossed, squared, without
from vehicle.measured.fit.solver import solve
from vehicle.measured.logs.record import Array
from vehicle.measured.mend.levels import two_levels
from vehicle.tractor import Tractor

Step = Callable[[], None]


@dataclass(frozen=True, eq=False)
class Proposal:
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


def proposals(
    loop: OpenLoop, model: Model, tractor: Tractor, step: Step, skip: frozenset[str] = frozenset()
) -> list[Proposal]:
    """Every effect and term of the rest that is not in the model, each at its best with the others following."""
    proposed = []
    taken = model.ids | skip | {term.knobs.id for term in loop.settled}
    for entry in CATALOGUE:
        if entry.id in taken or entry.stands_in:
            continue
        step()
        proposed += _of_effect(loop, model, tractor, entry)
    for group in rest_knobs():
        if group[0].id not in model.ids:
            step()
            new = tuple(Term(knobs, np.zeros(1)) for knobs in group)
            proposed.append(_promising(loop, model, new, model.errors))
    return proposed


def _of_effect(loop: OpenLoop, model: Model, tractor: Tractor, entry: Effect) -> list[Proposal]:
    """An effect from its best start and, if it is one of the ground, at two levels."""
    knobs = knobs_for(tractor, entry.id, loop.bench.course.places).with_fewer_starts()
    neutral = np.array(knobs.neutral)
    starts = [np.array(at) for at in knobs.starts if at != knobs.neutral]
    errors = [model.errors, *loop.errors_of_each([(*model.terms, Term(knobs, at)) for at in starts])]
    starts = [neutral, *starts]
    losses = np.array([loop.by_run(one) for one in errors])
    first = int(np.argmin(losses.sum(axis=1)))
    proposed = [_promising(loop, model, (Term(knobs, starts[first]),), errors[first])]
    if entry.of_ground:
        levels = two_levels(knobs, starts, losses)
        if levels:
            proposed.append(_promising(loop, model, levels, loop.errors((*model.terms, *levels))))
    return proposed


def _promising(loop: OpenLoop, model: Model, new: Terms, errors: Array) -> Proposal:
    """New terms whose errors, where they start, are known."""
    columns = slope_of_new(loop, (*model.terms, *new), errors, len(new))
    slope = np.concatenate([model.slope, columns], axis=1)
    change = solve(slope, errors)
    left = without(errors, slope, -change)
    return Proposal(new, errors, columns, change, squared(left))


def best_pair(loop: OpenLoop, model: Model, proposed: Sequence[Proposal]) -> list[tuple[Terms, float]]:
    """The two proposals that promise most together, simulated: causes that mask each other show only so."""
    base = [one for one in proposed if one.smooth]
    columns = np.concatenate([model.slope, *[one.columns for one in base]], axis=1)
    square, side = crossed(columns, columns), crossed(columns, model.errors)
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
    return [(terms, squared(errors))]


def simulated(loop: OpenLoop, model: Model, proposed: Sequence[Proposal]) -> list[tuple[Terms, float]]:
    """Proposals simulated as terms of the model, the best first: at the promised coordinates or at their start."""
    out = []
    places = [moved((*model.terms, *one.new), one.change) for one in proposed]
    for one, better, after in zip(proposed, places, loop.errors_of_each(places), strict=True):
        loss, start = squared(after), squared(one.errors)
        out.append((better, loss) if loss < start else ((*model.terms, *one.new), start))
    return sorted(out, key=lambda each: each[1])


def entry_of(name: str) -> str:
    """What enters and leaves as one: an effect, or a term of the rest with both components of its direction."""
    return name.split("_to_")[0]
