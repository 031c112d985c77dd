"""Which effects carry a name, and what is left without one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from vehicle.effects import SPEED, STEERING, effect, neutral
from vehicle.measured.answer.case import (
    PIECE_S,
    Case,
    case_of,
    horizons_above_noise,
    is_calibration,
    noise_share,
    within_noise,
)
from vehicle.measured.causes.challenge import make_up, shows_within_runs, stands_alone
from vehicle.measured.causes.evidence import helps, nameable_parts
from vehicle.measured.causes.refit import without
from vehicle.measured.causes.selection import Selection
from vehicle.measured.causes.trial import Projector
from vehicle.measured.fit.fitting import Fit
from vehicle.measured.fit.knobs import finest_of
from vehicle.measured.fit.openloop import Term, fitted
from vehicle.measured.logs.record import Array
from vehicle.measured.mend.extension import Extension, of_fit, of_mended
from vehicle.measured.mend.irreplaceable import irreplaceable
from vehicle.measured.mend.mending import Mended, at_a_limit, mend
from vehicle.measured.surprise.bench import Bench
from vehicle.measured.thresholds import (
    ABOVE_UNNAMED,
    CLEARLY_BEYOND,
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
    """What is added to the tractor, and which of it has a name."""

    case: Case
    names: list[str]
    mended: Mended | None


def nameable(selection: Selection, tractor: Tractor) -> list[str]:
    """Effects that may carry a name: clearly beyond tolerance, alone as well, and in no shadow of an unnamed one."""
    bench, fit = selection.bench, selection.fit
    names = [name for name in nameable_parts(bench, fit, tractor) if _by_itself(bench, fit, name)]
    if not selection.unnamed:
        return names
    shadow = unnamed_gain(fit) * ABOVE_UNNAMED
    apart = (STEERING, SPEED) if bench.has_wheel else ()
    return [name for name in names if effect(name).block in apart or without(bench, fit, name).loss - fit.loss > shadow]


def _by_itself(bench: Bench, fit: Fit, name: str) -> bool:
    """Whether an effect needs no other of its make-up, and no difference between runs, to be what it is."""
    return stands_alone(bench, fit, name) and shows_within_runs(bench, fit, name)


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
    bench, fit = selection.bench, selection.fit
    likely = clear_parts(selection, tractor)
    names, case = _holding(lambda kept: case_of(selection, of_fit(bench, fit, {*kept, *likely})), names)
    kept = {name for name in case.extension.ids if name in names or is_likely(case, name)}
    case = case if kept == case.extension.ids else case_of(selection, of_fit(bench, fit, kept))
    if within_noise(case, case.final):
        return Explained(case, names, None)
    names, mended, case = _mended_with(selection, case, names, tractor, step)
    names += irreplaceable(
        mended, tractor, noise_share(case), step, lambda name: name not in names and holds(case, name)
    )
    return _without_doubtful(selection, Explained(case, names, mended))


def _mended_with(
    selection: Selection, case: Case, names: list[str], tractor: Tractor, step: Step
) -> tuple[list[str], Mended, Case]:
    """Names that hold beside all that mends, from a mending that began with these as they are."""
    while True:
        settled = tuple(Term(knobs, at) for knobs, at in selection.fit.parts if knobs.id in names)
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


def clear_parts(selection: Selection, tractor: Tractor) -> list[str]:
    """Effects of the fit whose 95 % interval leaves neutral out, and which help runs that had no part in it.

    What stands in for whatever differs between runs is not among them: without a name it says nothing.
    """
    bench, fit = selection.bench, selection.fit
    whole = of_fit(bench, fit, fit.settings)
    return [
        name for name in fit.settings
        if not effect(name).stands_in and clear_of_neutral(whole, tractor, name) and _by_itself(bench, fit, name)
        and helps(bench, without(bench, fit, name), fit, selection.threshold)
    ]  # fmt: skip


def is_likely(case: Case, name: str) -> bool:
    """Whether an effect is clearly not neutral and lowers the error of runs held out.

    One of the steering takes as much off the wheel as a name must, and costs the path no more.
    One that ran as far as a tractor can have it stands for something else, and so does one that lowers the error where
    the surprises of runs held out speak against it.
    """
    if name in case.refused:
        return False
    term = case.main_terms[name]
    clear = clear_of_neutral(case.extension, case.tractor, name)
    far = term.knobs.deviation(term.at) > CLEARLY_BEYOND * finest_of(case.tractor, name, case.bench.row_s)
    of_wheel = effect(name).block == STEERING and case.bench.has_wheel
    if not clear or not far or reaches_a_limit(case, name):
        return False
    gain = case.gain_of(name)[0]
    return case.worth_of(name) >= WORTH_OF_WHEEL_PCT and gain > -HARM_PCT if of_wheel else gain > 0.0


def clear_of_neutral(extension: Extension, tractor: Tractor, name: str) -> bool:
    """Whether the 95 % interval of an effect, as wide as its tolerance at least, leaves neutral out."""
    size = effect(name).size.name
    low, high = extension.tolerant.get(name, extension.intervals[name])[size]
    return not low <= neutral(name, tractor.steering)[size] <= high


def _without_doubtful(selection: Selection, told: Explained) -> Explained:
    """Without effects that lower the error but may as well be neutral, the other terms fitted again."""
    case, mended = told.case, told.mended
    assert mended is not None
    doubtful = {
        name for name in case.main_terms
        if name not in BY_NAME and name not in told.names
        and (_beside_its_like(selection, told, name) or not is_likely(case, name) or case.gain_of(name)[0] <= 0.0)
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
    return _without_doubtful(selection, Explained(case, [name for name in told.names if holds(case, name)], smaller))


def reaches_a_limit(case: Case, name: str) -> bool:
    """Whether an effect may be as far as a tractor can have it: its value is, or its interval holds that limit.

    A small end that comes from the file, as of a lag that is nearly none, is no limit: only the value itself is asked.
    """
    if at_a_limit((case.main_terms[name],)):
        return True
    size = effect(name).size.for_wheelbase(case.tractor.wheelbase_m)
    zero = neutral(name, case.tractor.steering)[size.name]
    low, high = case.extension.intervals[name][size.name]
    return high >= size.high > zero or (size.neutral is not None and low <= size.low < zero)


def _beside_its_like(selection: Selection, told: Explained, name: str) -> bool:
    """Whether an effect is beside a named one of the same make-up and does not stand alone: see stands_alone."""
    mine = make_up(name)
    if mine is None or not any(make_up(other) == mine for other in told.names):
        return False
    return name not in selection.ids or not stands_alone(selection.bench, selection.fit, name)


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
