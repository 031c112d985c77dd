"""Which effects carry a name, and what is left without one."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vehicle.effects import SPEED, STEERING, effect
from vehicle.measured.answer.case import (
    PIECE_S,
    Case,
    case_of,
    horizons_above_noise,
    is_calibration,
    noise_share,
    within_noise,
)
from vehicle.measured.answer.likely import (
    beside_its_like,
    by_itself,
    clear_of_neutral,
    clear_parts,
    is_likely,
    reaches_a_limit,
    surely_told,
    told_by_surprises,
)
from vehicle.measured.causes.evidence import nameable_parts
from vehicle.measured.causes.refit import without
from vehicle.measured.causes.selection import Selection
from vehicle.measured.causes.trial import Projector
from vehicle.measured.fit.fitting import Fit
from vehicle.measured.fit.knobs import finest_of
from vehicle.measured.fit.openloop import Term, fitted
from vehicle.measured.logs.record import Array
from vehicle.measured.mend.extension import of_fit, of_mended
from vehicle.measured.mend.irreplaceable import irreplaceable
from vehicle.measured.mend.mending import Mended, mend
from vehicle.measured.surprise.bench import Bench
from vehicle.measured.thresholds import (
    ABOVE_UNNAMED,
    HARM_PCT,
    WORTH_A_NAME_PCT,
    WORTH_OF_WHEEL_PCT,
    WORTH_SAYING,
)
from vehicle.rest import BY_NAME
from vehicle.tractor import Tractor

Step = Callable[[], None]


@dataclass(frozen=True, eq=False)
class Explained:
    """What is added to the tractor, and which of it has a name; `surely` is that of is_likely."""

    case: Case
    names: list[str]
    mended: Mended | None
    surely: frozenset[str] = frozenset()


def nameable(selection: Selection, tractor: Tractor) -> list[str]:
    """Effects that may carry a name: clearly beyond tolerance, alone as well, and in no shadow of an unnamed one."""
    bench, fit = selection.bench, selection.fit
    names = [name for name in nameable_parts(bench, fit, tractor) if by_itself(bench, fit, name)]
    if not selection.unnamed:
        return names
    shadow = unnamed_gain(fit) * ABOVE_UNNAMED
    apart = cut_off(bench)
    return [name for name in names if effect(name).block in apart or without(bench, fit, name).loss - fit.loss > shadow]


def cut_off(bench: Bench) -> tuple[str, ...]:
    """Blocks that a measured wheel cuts off from the path: what is wrong there is told by itself, whatever bends it."""
    return (STEERING, SPEED) if bench.has_wheel else ()


def unnamed_gain(fit: Fit) -> float:
    """Loss that the unnamed terms take away, the other coordinates following."""
    if fit.extra is None:
        return 0.0
    terms = fit.extra.terms
    first = fit.slope.shape[1] - fit.extra.columns.shape[1]
    project = Projector(fit.slope[:, : first + terms.start])
    removed = project(fit.extra.columns[:, terms] @ fit.extra.amounts[terms])
    return float(removed @ removed)


def explained(selection: Selection, names: list[str], tractor: Tractor, step: Step) -> Explained:
    """Effects of the fit alone where they explain what there is; else all that lowers the error of runs held out."""
    likely = clear_parts(selection, tractor)
    surely = surely_told(selection, names, likely)

    def case_with(kept: Collection[str]) -> Case:
        return case_of(selection, of_fit(selection.bench, selection.fit, kept))

    names, case = _holding(lambda kept: case_with({*kept, *likely}), names)
    likely, case = _likely_together(case_with, case, names, surely)
    if within_noise(case, case.final):
        return Explained(case, names, None, surely)
    beside = [name for name in likely if effect(name).block in cut_off(selection.bench)]
    names, mended, case = _mended_with(selection, case, names, beside, tractor, step)
    names += irreplaceable(
        mended, tractor, noise_share(case), step, lambda name: name not in names and holds(case, name)
    )
    return _without_doubtful(selection, Explained(case, names, mended, surely))


def _likely_together(
    case_with: Callable[[Collection[str]], Case], case: Case, names: Sequence[str], surely: frozenset[str]
) -> tuple[list[str], Case]:
    """What is likely beside the names and each other, with that case.

    What is worth least falls first and the others are asked again: it may have been their partner, or against them.
    """
    while True:
        likely = sorted(case.extension.ids - set(names))
        doubtful = [name for name in likely if not is_likely(case, name, surely)]
        if not doubtful:
            return likely, case
        least = min(doubtful, key=case.worth_of)
        case = case_with(case.extension.ids - {least})


def _mended_with(
    selection: Selection, case: Case, names: list[str], likely: Sequence[str], tractor: Tractor, step: Step
) -> tuple[list[str], Mended, Case]:
    """Names that hold beside all that mends, from a mending that began with these, and what is likely, as they are.

    Where the path is wrong everywhere, what is likely of it is left to what lowers the error: see cut_off.
    """
    while True:
        settled = tuple(Term(knobs, at) for knobs, at in selection.fit.parts if knobs.id in {*names, *likely})
        mended = mend(selection.bench, tractor, settled, step, case.tolerated)
        beside = _case_of_mended(selection, mended)
        alike = told_alike(mended, tractor)
        kept = [name for name in names if name in alike and holds(beside, name)]
        if kept == names:
            return names, mended, beside
        names = kept


def told_alike(mended: Mended, tractor: Tractor) -> set[str]:
    """Settled effects that the open-loop error tells as well, were it free to: beyond tolerance, to the same side."""
    loop, settled = mended.loop, mended.loop.settled
    if not settled:
        return set()
    free = fitted(replace(loop, settled=()), (*settled, *mended.model.terms))
    at = {term.knobs.id: term.at for term in free.terms[: len(settled)]}
    alike = set()
    for term in settled:
        name, neutral = term.knobs.id, np.array(term.knobs.neutral)
        same_side = float((at[name] - neutral) @ (term.at - neutral)) > 0.0
        if same_side and term.knobs.deviation(at[name]) > finest_of(tractor, name, loop.bench.row_s):
            alike.add(name)
    return alike


def _case_of_mended(selection: Selection, mended: Mended) -> Case:
    """The case of what was settled, as the surprises tell it, and of what lowers the error beside it."""
    settled = [term.knobs.id for term in mended.loop.settled]
    told = of_fit(selection.bench, selection.fit, settled)
    return case_of(selection, told.beside(of_mended(mended)))


def _without_doubtful(selection: Selection, told: Explained) -> Explained:
    """Without effects that lower the error but may as well be neutral, the other terms fitted again."""
    case, mended = told.case, told.mended
    assert mended is not None
    doubtful = {
        name for name in case.main_terms
        if name not in BY_NAME and name not in told.names
        and (beside_its_like(selection, told.names, name) or not is_likely(case, name, told.surely)
             or (name in mended.model.ids and not _mends_rightly(selection, case, name)))
    }  # fmt: skip
    if not doubtful:
        return told
    settled, kept = (
        tuple(term for term in terms if term.knobs.id not in doubtful)
        for terms in (mended.loop.settled, mended.model.terms)
    )
    loop = replace(mended.loop, settled=settled)
    smaller = Mended(loop, fitted(loop, kept))
    case = _case_of_mended(selection, smaller)
    names = [name for name in told.names if holds(case, name)]
    return _without_doubtful(selection, Explained(case, names, smaller, told.surely))


def _mends_rightly(selection: Selection, case: Case, name: str) -> bool:
    """Whether an effect of the open-loop error lowers it in runs held out, and the surprises tell it as well."""
    return case.gain_of(name)[0] > 0.0 and told_by_surprises(selection, case.main_terms[name])


def _holding(case_with: Callable[[list[str]], Case], names: list[str]) -> tuple[list[str], Case]:
    """Names that hold together, with their case: one that does not may have been the partner of another."""
    while True:
        case = case_with(names)
        kept = [name for name in names if holds(case, name)]
        if kept == names:
            return names, case
        names = kept


def holds(case: Case, name: str) -> bool:
    """Whether an effect takes error away where it shows, without harm to the path, and is clearly not neutral.

    One that ran as far as a tractor can have it stands for something else.
    """
    worth, least = case.worth_of(name), _least_worth(case.bench, name)
    clear = clear_of_neutral(case.extension, case.tractor, name)
    beyond = clear and not is_calibration(case.bench, case.main_terms[name]) and not reaches_a_limit(case, name)
    return beyond and worth >= least and case.gain_of(name)[0] > -HARM_PCT


def _least_worth(bench: Bench, name: str) -> float:
    """Percent of the held-out error that an effect must take away: less is the trace of a simplification."""
    of_wheel = effect(name).block == STEERING and bench.has_wheel
    return WORTH_OF_WHEEL_PCT if of_wheel else WORTH_A_NAME_PCT


@dataclass(frozen=True)
class Unexplained:
    """What no effect explains: share of the error over 5 s above the noise floor, horizons (s) that are above it."""

    share: float
    above_s: tuple[float, ...]


def unexplained(told: Explained, before: Array) -> Unexplained:
    """What no effect takes away; a share of 0 while what they leave is noise, and then horizons other than 5 s alone.

    Terms of the rest are no effects: what they take away is told, not explained.
    """
    case = told.case
    squares = case.squares(case.extension.only(case.extension.ids - frozenset(BY_NAME)))
    above = horizons_above_noise(case, squares)
    if PIECE_S not in above:
        return Unexplained(0.0, above)
    floor, left = float(case.number(case.floor).sum()), float(case.number(squares).sum())
    share = (left - floor) / max(float(before.sum()) - floor, left - floor)
    return Unexplained(float(share) if share > WORTH_SAYING else 0.0, above)
