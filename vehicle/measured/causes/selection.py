"""Which effects the logs speak for: forward, exchange and backward selection with every other effect refitted.

An effect enters when it takes more away than chance does: the threshold is the largest gain of any candidate over
what is left of these very data after the signs of its blocks of ten seconds were drawn at random. It must also help in
runs that had no part in the fit, and in most of the runs that it concerns. The base tractor is the file as given,
within the tolerance `finest` of each effect: an effect within its tolerance is a calibration without a name.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass

import numpy as np

from vehicle.effects import CATALOGUE, effect
from vehicle.measured.causes.dependence import Dependence, Score, scores
from vehicle.measured.causes.evidence import helps, is_nameable
from vehicle.measured.causes.patches import best_patch
from vehicle.measured.causes.refit import enlarged, restarted, retuned, with_unnamed, without
from vehicle.measured.causes.trial import Projector, Tried, strengths, tried
from vehicle.measured.fit.fitting import Fit, refined
from vehicle.measured.fit.knobs import knobs_for
from vehicle.measured.surprise.bench import Bench
from vehicle.measured.thresholds import (
    ABOVE_CHANCE,
    CHANCE_SIGMAS,
    CLEARLY,
    LEAST_GAIN,
    LEAST_STRENGTH,
    MATERIAL,
    MOST_PARTS,
    MOST_UNNAMED,
    PATCH_HANDICAP,
)
from vehicle.tractor import Tractor

Progress = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class Selection:
    """What entered: the fit of all effects and unnamed terms together, and the unnamed terms."""

    bench: Bench
    fit: Fit
    unnamed: tuple[Dependence, ...]
    threshold: float

    @property
    def ids(self) -> frozenset[str]:
        """Effects in the fit."""
        return frozenset(self.fit.settings)


def scan(
    bench: Bench, fit: Fit, tractor: Tractor, skip: Collection[str], progress: Progress | None = None
) -> list[Tried]:
    """Every effect of the catalogue that is not in the fit, the best first."""
    project = Projector(fit.slope)
    candidates = []
    for entry in CATALOGUE:
        if entry.id in skip or entry.id in fit.settings:
            continue
        knobs = knobs_for(tractor, entry.id)
        if not bench.has_wheel:
            knobs = knobs.with_fewer_starts()
        if entry.kind.searched:
            patch = best_patch(bench, fit)
            if patch is None:
                continue
            knobs = knobs_for(tractor, entry.id, patch)
        candidates.append(tried(bench.change, fit, knobs, project))
        if progress:
            progress(entry.id)
    return sorted(candidates, key=_rank)


def _rank(one: Tried) -> float:
    """Order of the candidates: a circle that chose its own place must explain clearly more than a plain effect."""
    if effect(one.knobs.id).kind.searched:
        return -(one.gain / PATCH_HANDICAP - LEAST_GAIN)
    return -one.gain


def select(bench: Bench, tractor: Tractor, progress: Progress | None = None) -> Selection:
    """Forward selection, then exchanges, then backward."""
    fit = restarted(bench, (), None)
    unnamed: tuple[Dependence, ...] = ()
    refused: set[str] = set()
    threshold = LEAST_STRENGTH
    candidates: list[Tried] | None = None
    rival: Score | None = None
    while len(fit.parts) < MOST_PARTS:
        if candidates is None:
            candidates, rival = scan(bench, fit, tractor, refused, progress), _rival(bench, fit, unnamed)
        best, threshold = _clear(bench, fit, candidates)
        if rival and len(unnamed) < MOST_UNNAMED and _is_unnamed(bench, rival, best, threshold):
            unnamed, candidates = (*unnamed, rival.terms), None
            fit = with_unnamed(bench, fit, unnamed)
            continue
        if best is None:
            break
        larger = refined(bench, enlarged(bench, fit, best), 2)
        if not helps(bench, fit, larger, threshold):
            refused.add(best.knobs.id)
            candidates = [one for one in candidates if one.knobs.id != best.knobs.id]
            continue
        bench, candidates = retuned(bench, larger), None
        fit = restarted(bench, larger.parts, unnamed)
    if not unnamed:
        fit = exchanged(bench, fit, tractor)
    return Selection(bench, pruned(bench, fit), unnamed, threshold)


def _clear(bench: Bench, fit: Fit, candidates: list[Tried]) -> tuple[Tried | None, float]:
    """The best candidate that is clearly above chance, if any, and the strength that took."""
    # Without what the columns of the fit could still take.
    left = Projector(fit.slope)(fit.surprise) if candidates else fit.surprise
    strength, chance = strengths(bench, candidates, left)
    threshold = max(LEAST_STRENGTH, ABOVE_CHANCE * chance)
    told = (one for one, s in zip(candidates, strength, strict=True) if one.gain > LEAST_GAIN and s > threshold)
    return next(told, None), threshold


def _rival(bench: Bench, fit: Fit, unnamed: tuple[Dependence, ...]) -> Score | None:
    """The strongest unnamed term that is not in the fit; one period is as good as its neighbours."""
    taken = {(one.on if not one.per_run else "time", one.changes) for one in unnamed}
    for score in scores(bench, fit):
        if (score.terms.on if not score.terms.per_run else "time", score.terms.changes) not in taken:
            return score
    return None


def _is_unnamed(bench: Bench, rival: Score, best: Tried | None, threshold: float) -> bool:
    """Whether an unnamed term explains clearly more than chance and than the best effect."""
    chance = rival.freedoms + CHANCE_SIGMAS * np.sqrt(2.0 * rival.freedoms)
    gain = rival.gain - chance
    material = MATERIAL * 3.0 * bench.course.rows
    if gain < max(threshold, material):
        return False
    return best is None or gain > CLEARLY * best.gain + LEAST_GAIN


def exchanged(bench: Bench, fit: Fit, tractor: Tractor) -> Fit:
    """Replace a part where another effect in its place explains clearly more: one cause that stood in for two."""
    if len(fit.parts) < 2:
        return fit
    searched = {entry.id for entry in CATALOGUE if entry.kind.searched}
    for knobs, _ in fit.parts:
        if not is_nameable(bench, fit, tractor, knobs.id):
            continue
        rest = without(bench, fit, knobs.id)
        candidates = scan(bench, rest, tractor, {knobs.id, *searched})
        if candidates and candidates[0].gain > rest.loss - fit.loss + LEAST_GAIN:
            return refined(bench, enlarged(bench, rest, candidates[0]))
    return fit


def pruned(bench: Bench, fit: Fit) -> Fit:
    """Backward: leave out, one by one, what the others have made superfluous."""
    while fit.parts:
        costs = [(without(bench, fit, knobs.id), knobs.id) for knobs, _ in fit.parts]
        smaller, _ = min(costs, key=lambda one: one[0].loss)
        if smaller.loss - fit.loss > LEAST_GAIN:
            return fit
        fit = smaller
    return fit
