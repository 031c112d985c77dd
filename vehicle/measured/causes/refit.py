"""A fit with a part more or less, with unnamed terms, and on a bench whose weights suit it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from vehicle.learnt import Settings
from vehicle.measured.causes.dependence import Dependence, columns
from vehicle.measured.causes.trial import Tried
from vehicle.measured.causes.unknowns import unknowns
from vehicle.measured.fit.fitting import Extra, Fit, Part, linear_extra, refined
from vehicle.measured.fit.knobs import settings_of
from vehicle.measured.fit.products import side_by_side
from vehicle.measured.replay.course import Course
from vehicle.measured.replay.replaying import Rig
from vehicle.measured.surprise.bench import Bench, prepare
from vehicle.measured.surprise.noise import first_noise, tuned
from vehicle.measured.surprise.weights import filters
from vehicle.measured.thresholds import EASING, MOST_EASINGS, WRONG_EVERYWHERE

KEPT_BYTES = 300_000_000  # chosen: eight parts and four dozen columns of a quarter of an hour, a sixth of 2 GB


def enlarged(bench: Bench, fit: Fit, best: Tried) -> Fit:
    """The fit with a tried effect added as it is."""
    return with_part(bench, fit, (best.knobs, best.at))


def with_part(bench: Bench, fit: Fit, part: Part) -> Fit:
    """The fit with a part added as it is."""
    parts = (*fit.parts, part)
    bare = bench.surprise(settings_of(list(parts)))
    return Fit(parts, linear_extra(bare, fit.extra), np.zeros((len(bare), 0)), fit.extra)


def with_unnamed(bench: Bench, fit: Fit, unnamed: tuple[Dependence, ...]) -> Fit:
    """The fit with unnamed terms at their best amounts, beside what is unknown of any tractor.

    That without any is found once: see without.
    """
    if unnamed:
        return restarted(bench, fit.parts, unnamed)
    return _kept(bench, fit, "", lambda: restarted(bench, fit.parts, ()))


def restarted(bench: Bench, parts: tuple[Part, ...], unnamed: tuple[Dependence, ...] | None) -> Fit:
    """The same for parts of a fit on a bench with other weights."""
    surprise = bench.surprise(settings_of(list(parts)))
    bare = Fit(parts, surprise, np.zeros((len(surprise), 0)))
    free = unknowns(bench, bare)
    each = [free, *[columns(bench, bare, one) for one in unnamed or ()]]
    made = side_by_side([column for one in each for column in one.T], len(surprise))
    extra = Extra(made, np.zeros(made.shape[1]), free.shape[1])
    return refined(bench, Fit(parts, surprise, bare.slope, extra))


def retuned(bench: Bench, fit: Fit) -> Bench:
    """The bench with noise and weights as the fit leaves them."""
    return weighed(bench.course, bench.rig, fit.settings)


def weighed(course: Course, rig: Rig, settings: Settings) -> Bench:
    """A bench with noise and weights as these effects leave them."""
    noise = tuned(course, rig, first_noise(course), settings)
    eased = prepare(course, rig, settings, noise)
    for _ in range(MOST_EASINGS):
        # A model that is wrong everywhere, as of a vehicle of another kind, must not be judged by the millimetre: with
        # less trust in each measurement longer ways count.
        path = eased.path_surprise(eased.path(settings), settings)
        if float(np.mean(path * path)) < WRONG_EVERYWHERE:
            break
        wider = {name: EASING * getattr(eased.noise, name) for name in ("position", "heading")}
        wide = replace(eased.noise, **wider)
        eased = replace(eased, noise=wide, filters=filters(course, rig, wide, settings))
    return eased


def without(bench: Bench, fit: Fit, name: str) -> Fit:
    """The fit refitted without one of its parts, found once where all such fits take no more than KEPT_BYTES."""
    parts = tuple(part for part in fit.parts if part[0].id != name)

    def refitted() -> Fit:
        surprise = linear_extra(bench.surprise(settings_of(list(parts))), fit.extra)
        return refined(bench, Fit(parts, surprise, np.zeros((len(surprise), 0)), fit.extra))

    return _kept(bench, fit, name, refitted)


def _kept(bench: Bench, fit: Fit, name: str, make: Callable[[], Fit]) -> Fit:
    """A fit without a part, or without the unnamed terms, where there is room made once."""
    if (bench, name) in fit.smaller:
        return fit.smaller[bench, name]
    smaller = make()
    if len(fit.parts) * fit.slope.nbytes <= KEPT_BYTES:
        fit.smaller[bench, name] = smaller
    return smaller
