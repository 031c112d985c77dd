"""Lowering what the catalogue's statistics leave unexplained: effects and unnamed terms that help runs they never saw.

Where the surprises of a set have no cause, the open-loop error itself is lowered, term by term: an effect, an effect
of the ground at two levels where the runs were made on two grounds, or a term of the rest. A term stays when runs that
had no part in its fit are simulated clearly better.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from vehicle.learnt import Settings
from vehicle.measured.causes.refit import KEPT_BYTES
from vehicle.measured.fit.knobs import finest_of
from vehicle.measured.fit.openloop import Model, OpenLoop, Term, Terms, fitted, held_out_loss
from vehicle.measured.mend.proposals import Step, best_pair, entry_of, proposals, simulated
from vehicle.measured.surprise.bench import Bench
from vehicle.measured.thresholds import DRIVEN, MOST_TERMS, PAIRED, TRIED, WORTH
from vehicle.rest import BY_NAME
from vehicle.tractor import Tractor


@dataclass(frozen=True, eq=False)
class Mended:
    """The model that was found, and the open-loop error it lowers.

    `smaller` are the fits without what enters and leaves as one, by its name, where they were kept.
    """

    loop: OpenLoop
    model: Model
    smaller: Mapping[str, Model] = field(default_factory=dict)

    def without(self, name: str) -> Model:
        """The other terms, fitted again."""
        return self.smaller[name] if name in self.smaller else _without(self.loop, self.model, name)


def mend(bench: Bench, tractor: Tractor, settled: Terms, step: Step, tolerated: Settings | None = None) -> Mended:
    """Terms that lower the open-loop error of runs held out beside those `settled`, the most telling first.

    `tolerated` and `settled` are those of OpenLoop: what the surprises told stays as they told it, for the open-loop
    error knows neither instruments nor what differs between tractors.
    """
    loop = OpenLoop(bench, tolerated or {}, settled)
    model = fitted(loop, ())
    best = held_out_loss(loop, model)
    while len(model.terms) < MOST_TERMS:
        larger = _enlarged(loop, model, best, tractor, step)
        if larger is None:
            break
        model, best = larger
    return _pruned(loop, model, best)


def _enlarged(loop: OpenLoop, model: Model, best: float, tractor: Tractor, step: Step) -> tuple[Model, float] | None:
    """The model with the most promising proposal or pair of proposals that helps runs it has not seen."""
    proposed = proposals(loop, model, tractor, step)
    singles = simulated(loop, model, sorted(proposed, key=lambda one: one.loss)[:DRIVEN])
    pair = [terms for terms, loss in best_pair(loop, model, proposed) if loss < PAIRED * singles[0][1]]
    good = [_accepted(loop, model, best, terms) for terms in pair]
    for terms, loss in singles[:TRIED]:
        larger = _accepted(loop, model, best, terms) if loss < (1.0 - WORTH) * model.loss else None
        if larger:
            good.append(larger)
            break
    # Of two terms each must be worth its place, against the best alone as well.
    return min((one for one in good if one), key=lambda one: one[1] / _worth(one[0], model), default=None)


def _worth(larger: Model, model: Model) -> float:
    """Share of the error that may be left for the terms a model has more than another one."""
    more = {entry_of(name) for name in larger.ids} - {entry_of(name) for name in model.ids}
    return float((1.0 - WORTH) ** len(more))


def _accepted(loop: OpenLoop, model: Model, best: float, terms: Terms) -> tuple[Model, float] | None:
    """A larger model and its error on runs held out, if that is worth its terms."""
    larger = fitted(loop, terms)
    loss = held_out_loss(loop, larger)
    new = larger.terms[len(model.terms) :]
    if not all(beyond_tolerance(loop, term) for term in new if term.runs is None):
        return None
    return (larger, loss) if loss < _worth(larger, model) * best and not at_a_limit(new) else None


def beyond_tolerance(loop: OpenLoop, term: Term, times: float = 1.0) -> bool:
    """Whether an effect is more than the tolerance of the tractor file; a term of the rest has none."""
    name, bench = term.knobs.id, loop.bench
    if name in BY_NAME:
        return True
    tractor = bench.rig.tractor
    return term.knobs.deviation(term.at) > times * finest_of(tractor, name, bench.row_s)


def at_a_limit(terms: Terms) -> bool:
    """Whether a coordinate ran as far as a tractor can have it: such a fit stands for something else."""
    return any(
        np.any((term.at <= np.array(term.knobs.low)) & (np.array(term.knobs.low) < np.array(term.knobs.neutral)))
        or np.any((term.at >= np.array(term.knobs.high)) & (np.array(term.knobs.high) > np.array(term.knobs.neutral)))
        for term in terms
    )


def _pruned(loop: OpenLoop, model: Model, best: float) -> Mended:
    """Leave out, one by one, what later terms have made superfluous."""
    kept: dict[str, Model] = {}
    for name in sorted({entry_of(name) for name in model.ids}):
        smaller = _without(loop, model, name)
        loss = held_out_loss(loop, smaller)
        if loss < best / (1.0 - WORTH):
            return _pruned(loop, smaller, loss)
        if len(model.terms) * model.slope.nbytes <= KEPT_BYTES:
            kept[name] = smaller
    return Mended(loop, model, kept)


def _without(loop: OpenLoop, model: Model, name: str) -> Model:
    return fitted(loop, tuple(term for term in model.terms if entry_of(term.knobs.id) != name), 2)
