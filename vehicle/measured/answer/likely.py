"""Which effects are likely: fitted, clearly not neutral, and of help to runs held out, though no name is earned."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from vehicle.effects import STEERING, effect, neutral
from vehicle.measured.answer.case import Case, is_calibration
from vehicle.measured.causes.challenge import make_up, shows_within_runs, stands_alone
from vehicle.measured.causes.evidence import helps
from vehicle.measured.causes.refit import with_unnamed, without
from vehicle.measured.causes.selection import Selection
from vehicle.measured.causes.trial import Projector, tried
from vehicle.measured.fit.fitting import Fit
from vehicle.measured.fit.knobs import finest_of
from vehicle.measured.fit.openloop import Term
from vehicle.measured.mend.extension import Extension, of_fit
from vehicle.measured.mend.mending import at_a_limit
from vehicle.measured.surprise.bench import Bench
from vehicle.measured.thresholds import CLEARLY_BEYOND, HARM_PCT, LEAST_GAIN, WORTH_OF_WHEEL_PCT
from vehicle.tractor import Tractor


def clear_parts(selection: Selection, tractor: Tractor) -> list[str]:
    """Effects of the fit whose 95 % interval leaves neutral out, and which help runs that had no part in it.

    What stands in for whatever differs between runs is not among them: without a name it says nothing.
    """
    bench, fit = selection.bench, selection.fit
    whole = of_fit(bench, fit, fit.settings)
    return [
        name for name in fit.settings
        if not effect(name).stands_in and clear_of_neutral(whole, tractor, name) and by_itself(bench, fit, name)
        and helps(bench, without(bench, fit, name), fit, selection.threshold)
    ]  # fmt: skip


def surely_told(selection: Selection, names: Collection[str], clear: Collection[str]) -> frozenset[str]:
    """Those of the clear parts that may carry a name, as the surprises tell them, and are no calibrations."""
    terms = (Term(knobs, at) for knobs, at in selection.fit.parts if knobs.id in names and knobs.id in clear)
    return frozenset(term.knobs.id for term in terms if not is_calibration(selection.bench, term))


def by_itself(bench: Bench, fit: Fit, name: str) -> bool:
    """Whether an effect needs no other of its make-up, and no difference between runs, to be what it is."""
    return stands_alone(bench, fit, name) and shows_within_runs(bench, fit, name)


def is_likely(case: Case, name: str, surely: Collection[str] = ()) -> bool:
    """Whether an effect is clearly not neutral and lowers the error of runs held out.

    One of the steering takes as much off the wheel as a name must, and costs the path no more.
    One that ran as far as a tractor can have it stands for something else, and so does one that lowers the error where
    the surprises of runs held out speak against it.

    What the surprises show as `surely` as a name must be, in runs held out too, need be no larger than a name and may
    cost the path as much, for in the error over 5 s a small effect drowns; one of the steering that the wheel shows may
    cost more as long as runs differ in that.
    """
    if name in case.refused or not clear_of_neutral(case.extension, case.tractor, name) or reaches_a_limit(case, name):
        return False
    term, sure = case.main_terms[name], name in surely
    finest = finest_of(case.tractor, name, case.bench.row_s)
    if term.knobs.deviation(term.at) <= (1.0 if sure else CLEARLY_BEYOND) * finest:
        return False
    of_wheel = effect(name).block == STEERING and case.bench.has_wheel
    if of_wheel and case.worth_of(name) < WORTH_OF_WHEEL_PCT:
        return False
    gain, (_, at_best) = case.gain_of(name)
    return gain > (-HARM_PCT if of_wheel or sure else 0.0) or (of_wheel and sure and at_best > 0.0)


def clear_of_neutral(extension: Extension, tractor: Tractor, name: str) -> bool:
    """Whether the 95 % interval of an effect, as wide as its tolerance at least, leaves neutral out."""
    size = effect(name).size.name
    low, high = extension.tolerant.get(name, extension.intervals[name])[size]
    return not low <= neutral(name, tractor.steering)[size] <= high


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


def beside_its_like(selection: Selection, names: Collection[str], name: str) -> bool:
    """Whether an effect is beside a named one of the same make-up and does not stand alone: see stands_alone."""
    mine = make_up(name)
    if mine is None or not any(make_up(other) == mine for other in names):
        return False
    return name not in selection.ids or not stands_alone(selection.bench, selection.fit, name)


def told_by_surprises(selection: Selection, term: Term) -> bool:
    """Whether the surprises, too, tell an effect of the open-loop error: to the same side and beyond its tolerance.

    They tell it beside all that they tell already, named or not: what only stands in the place of that leaves them as
    they are. Unnamed terms may take up what an effect explains, so it is asked what it takes without them.
    """
    bench, fit = selection.bench, with_unnamed(selection.bench, selection.fit, ())
    knobs, neutral_at = term.knobs, np.array(term.knobs.neutral)
    at = next((at for one, at in fit.parts if one.id == knobs.id), None)
    if at is None:
        one = tried(bench.changes, fit, knobs, Projector(fit.slope))
        at = one.at if one.gain > LEAST_GAIN else neutral_at
    same_side = float((at - neutral_at) @ (term.at - neutral_at)) > 0.0
    return same_side and knobs.deviation(at) > finest_of(bench.rig.tractor, knobs.id, bench.row_s)
