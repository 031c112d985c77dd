"""Names for effects where parts of the error have none: nothing else lowers the error as they do."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from vehicle.measured.fit.openloop import Model, OpenLoop, Terms, fitted
from vehicle.measured.mend.mending import Mended, beyond_tolerance
from vehicle.measured.mend.proposals import Proposal, Step, proposals, simulated
from vehicle.measured.thresholds import CLEARLY_LARGE, DRIVEN, LEAST_LEFT, MARKED, RIVALS_LEAVE, TRIED
from vehicle.rest import BY_NAME
from vehicle.tractor import Tractor


def irreplaceable(
    mended: Mended, tractor: Tractor, noise: float, step: Step, holds: Callable[[str], bool] = lambda _: True
) -> list[str]:
    """Effects that may carry a name though parts of the error have none.

    Without such an effect the others, fitted again, leave clearly more, and so does the best other effect or term of
    the rest in its place (of those that may enter here). Losses count from what `noise` alone leaves, a share of the
    loss without terms, and are never less than LEAST_LEFT of what can be taken away. Nothing is asked of what does not
    hold (`holds`).
    """
    loop, model = mended.loop, mended.model

    def left(loss: float) -> float:
        return max(loss - noise, LEAST_LEFT * (1.0 - noise))

    def near(loss: float) -> bool:
        return left(loss) <= RIVALS_LEAVE * left(model.loss)

    names = []
    for name in sorted(model.ids - frozenset(BY_NAME)):
        step()
        if not _clearly_large(loop, model, name):
            continue
        smaller = mended.without(name)
        if left(model.loss) > (1.0 - MARKED) * left(smaller.loss) or near(smaller.loss) or not holds(name):
            continue  # beside what is near without it, any rival is
        others = proposals(loop, smaller, tractor, step, frozenset({name}))
        if not _rivalled(loop, smaller, others, near):
            names.append(name)
    return names


def _rivalled(loop: OpenLoop, smaller: Model, others: Sequence[Proposal], near: Callable[[float], bool]) -> bool:
    """Whether the best of other proposals come near with what they leave, one of them at least.

    A fit leaves no more than what it starts from: where that is near already none is made.
    """
    driven: list[tuple[Terms, float]] = []
    for one in sorted(others, key=lambda one: one.loss)[:DRIVEN]:
        driven += simulated(loop, smaller, [one])
        if near(driven[-1][1]):
            return True
    best = sorted(driven, key=lambda each: each[1])[:TRIED]
    return any(near(fitted(loop, terms, 2).loss) for terms, _ in best)


def _clearly_large(loop: OpenLoop, model: Model, name: str) -> bool:
    return any(beyond_tolerance(loop, term, CLEARLY_LARGE) for term in model.terms if term.knobs.id == name)
