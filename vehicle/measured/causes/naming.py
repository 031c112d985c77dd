"""Which effects the logs speak for: forward, exchange and backward selection with every other effect refitted.

An effect enters when it takes more away than chance does: the threshold is the largest gain of any candidate over
what is left of these very data after the signs of its blocks of ten seconds were drawn at random. It must also help in
runs that had no part in the fit, and in most of the runs that it concerns. The base tractor is the file as given,
within the tolerance `finest` of each effect: an effect within its tolerance is a calibration without a name.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from vehicle.effects import CATALOGUE, effect
from vehicle.measured.causes.dependence import Dependence, Score, columns, scores
from vehicle.measured.causes.patches import best_patch
from vehicle.measured.fit.fitting import (
    FIRST_STEP,
    LATER_STEP,
    Extra,
    Fit,
    block_sums,
    linear_extra,
    refined,
    slopes,
    solve,
)
from vehicle.measured.fit.knobs import Knobs, block_of, finest_of, knobs_for, settings_of
from vehicle.measured.logs.record import Array
from vehicle.measured.surprise.bench import Bench, first_noise, prepare
from vehicle.measured.surprise.noise import tuned
from vehicle.tractor import Tractor

LEAST_GAIN = 25.0
LEAST_STRENGTH = 12.0
HOPELESS = 9.0
LEAST_PART = 1e-10  # of the squared size of the largest direction of a fit: smaller ones are rounding
MOST_PARTS = 8
NULL_DRAWS, NULL_QUANTILE = 400, 0.99
CLEARLY = 1.03
CLEAR_SIGMAS = 3.3
MOST_UNNAMED = 3
MOST_EASINGS, EASING, WRONG_EVERYWHERE = 12, 1.6, 2.0
FEW_RUNS = 3
HARM, HELPED = 0.1, 10.0
PATCH_HANDICAP = 1.3
MATERIAL = 0.003  # of the number of surprises: less is within what simulators differ
Progress = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class Tried:
    """A candidate at its best: coordinates, loss taken away beyond the fit, columns with the fit taken out."""

    knobs: Knobs
    at: Array
    gain: float
    columns: Array


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


class Projector:
    """Takes the columns of a fit out of vectors."""

    def __init__(self, slope: Array) -> None:
        """Directions of the columns, orthonormal as far as their products tell."""
        self.basis: Array | None = None
        if slope.size:
            scaled = slope / np.maximum(np.linalg.norm(slope, axis=0), 1e-12)
            size, turn = np.linalg.eigh(scaled.T @ scaled)
            known = size > LEAST_PART * size[-1]
            self.basis = scaled @ (turn[:, known] / np.sqrt(size[known]))

    def __call__(self, vector: Array) -> Array:
        """The part of a vector (n,) that no column explains."""
        if self.basis is None:
            return vector
        out: Array = vector - self.basis @ (self.basis.T @ vector)
        return out


def tried(bench: Bench, fit: Fit, knobs: Knobs, project: Projector, iterations: int = 3) -> Tried:
    """Fit one more effect while the coordinates of the others follow linearly."""
    bare = fit.surprise if fit.extra is None else fit.surprise - fit.extra.columns @ fit.extra.amounts
    blocks = frozenset({block_of(knobs.id)})

    def left(at: Array) -> Array:
        changed = bench.change(settings_of([*fit.parts, (knobs, at)]), bare, blocks)
        return project(linear_extra(changed, fit.extra))

    zero = np.array(knobs.neutral)
    now = project(fit.surprise)
    loss = base = float(now @ now)
    at = zero
    for start in knobs.starts:
        if start != knobs.neutral:
            vector = left(np.array(start))
            if float(vector @ vector) < loss:
                at, now, loss = np.array(start), vector, float(vector @ vector)
    slope = np.zeros((len(now), knobs.count))
    for number in range(iterations):
        slope = _slope(left, knobs, at, now, FIRST_STEP if number == 0 else LATER_STEP)
        change = solve(slope, now)
        if base - loss + _promise(slope, now) < HOPELESS:
            break
        for share in (1.0, 0.4, 0.15):
            other = knobs.inside(at + share * change)
            vector = left(other)
            if float(vector @ vector) < loss:
                settled = bool(np.all(np.abs(other - at) < 0.01 * np.array(knobs.typical)))
                at, now, loss = other, vector, float(vector @ vector)
                break
        else:
            break
        if settled:
            break
    return Tried(knobs, at, base - loss, slope)


def _slope(left: Callable[[Array], Array], knobs: Knobs, at: Array, now: Array, share: float) -> Array:
    found = []
    for axis in range(knobs.count):
        moved = at.copy()
        moved[axis] += share * knobs.typical[axis]
        if knobs.inside(moved)[axis] != moved[axis]:
            moved[axis] = at[axis] - share * knobs.typical[axis]
        found.append((left(moved) - now) / (moved[axis] - at[axis]))
    return np.stack(found, axis=1)


def _promise(slope: Array, now: Array) -> float:
    side = slope.T @ now
    square = slope.T @ slope
    scale = np.maximum(np.diag(square), 1e-12)
    return float(side @ np.linalg.solve(square + 1e-9 * np.diag(scale), side))


def strengths(bench: Bench, found: list[Tried], left: Array) -> tuple[list[float], float]:
    """Strength of every candidate, and the strength that the best of all reaches by chance in 1 of 100 draws.

    Strength is the squared slope of the loss over its scatter between blocks of ten seconds (never less than the noise
    alone gives). Chance is what is left after the best candidate, with the sign of every block drawn at random.
    """
    rng = np.random.default_rng(20)
    count = len(bench.block_runs)
    signs = rng.choice([-1.0, 1.0], size=(NULL_DRAWS, count))
    largest, strength = np.zeros(NULL_DRAWS), []
    for one in found:
        square = one.columns.T @ one.columns
        if not np.all(np.diag(square) > 1e-9):
            strength.append(0.0)
            continue
        moved = left - one.columns @ np.linalg.solve(square, one.columns.T @ left)
        sides = np.stack([np.bincount(bench.blocks, column * moved, count) for column in one.columns.T], axis=1)
        spread = sides.T @ sides
        scatter = square * max(1.0, float(np.trace(np.linalg.solve(square, spread))) / len(square))
        inverse = np.linalg.inv(scatter)
        strength.append(one.gain * float(np.trace(square @ inverse)) / len(square))
        drawn = signs @ sides
        largest = np.maximum(largest, np.einsum("di,ij,dj->d", drawn, inverse, drawn))
    return strength, float(np.quantile(largest, NULL_QUANTILE))


def held_out_losses(bench: Bench, fit: Fit) -> Array:
    """Loss of every run under the coordinates that the other runs give, by one step from the common fit."""
    runs = len(bench.course.names)
    by_block = block_sums(bench, fit.slope, fit.surprise)
    losses = np.bincount(bench.block_runs, by_block.losses, runs).astype(np.float64)
    size = fit.slope.shape[1]
    if size == 0:
        return losses
    squares, sides = np.zeros((runs, size, size)), np.zeros((runs, size))
    np.add.at(squares, bench.block_runs, by_block.squares)
    np.add.at(sides, bench.block_runs, by_block.sides)
    square, side = squares.sum(axis=0), sides.sum(axis=0)
    guard = 1e-6 * np.diag(np.maximum(np.diag(square), 1e-9))
    for run in range(runs):
        step = -np.linalg.solve(square - squares[run] + guard, side - sides[run])
        losses[run] += 2.0 * step @ sides[run] + step @ squares[run] @ step
    return losses


def robust_covariance(bench: Bench, fit: Fit) -> Array:
    """Covariance of the coordinates of the fit from the scatter of its blocks (sandwich), never below the noise's."""
    sums = block_sums(bench, fit.slope, fit.surprise)
    inverse = np.linalg.pinv(sums.squares.sum(axis=0), rcond=1e-14, hermitian=True)
    middle = sums.sides.T @ sums.sides
    sandwich = inverse @ middle @ inverse
    factor = np.sqrt(np.maximum(np.diag(inverse) / np.maximum(np.diag(sandwich), 1e-300), 1.0))
    out: Array = sandwich * np.outer(factor, factor)
    return out


def helps(bench: Bench, without: Fit, fit: Fit, threshold: float) -> bool:
    """Whether the larger fit helps runs it has not seen: most of those it concerns, or some without harm to others."""
    gain = held_out_losses(bench, without) - held_out_losses(bench, fit)
    concerned = np.abs(gain) > 4.0
    if float(gain.sum()) < 0.3 * threshold:
        return _helps_within(bench, without, fit)
    harmless = -gain[gain < 0.0].sum() < HARM * gain[gain > 0.0].sum() and np.count_nonzero(gain > HELPED) >= 2
    return bool(harmless or np.count_nonzero(gain[concerned] > 0.0) >= 0.6 * np.count_nonzero(concerned))


def _helps_within(bench: Bench, without: Fit, fit: Fit) -> bool:
    """An effect that lives in a few runs: its blocks must agree instead of the runs."""
    count = len(bench.block_runs)
    gain = np.bincount(bench.blocks, without.surprise**2 - fit.surprise**2, count)
    by_run = np.bincount(bench.block_runs, gain, len(bench.course.names))
    few = np.argsort(-by_run)[:FEW_RUNS]
    if by_run[few].sum() < 0.8 * gain.sum():
        return False
    inside = gain[np.isin(bench.block_runs, few)]
    concerned = np.abs(inside) > 4.0
    return bool(concerned.sum() >= 2 and np.count_nonzero(inside[concerned] > 0.0) >= 0.6 * concerned.sum())


def scan(bench: Bench, fit: Fit, tractor: Tractor, skip: set[str], progress: Progress | None = None) -> list[Tried]:
    """Every effect of the catalogue that is not in the fit, the best first."""
    project = Projector(fit.slope)
    found = []
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
        found.append(tried(bench, fit, knobs, project))
        if progress:
            progress(entry.id)
    return sorted(found, key=_rank)


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
    found: list[Tried] | None = None
    rival: Score | None = None
    while len(fit.parts) < MOST_PARTS:
        if found is None:
            found, rival = scan(bench, fit, tractor, refused, progress), _rival(bench, fit, unnamed)
        strength, chance = strengths(bench, found, _left(fit, found))
        threshold = max(LEAST_STRENGTH, 1.5 * chance)
        told = (one for one, s in zip(found, strength, strict=True) if one.gain > LEAST_GAIN and s > threshold)
        best = next(told, None)
        if rival and len(unnamed) < MOST_UNNAMED and _is_unnamed(bench, rival, best, threshold):
            unnamed, found = (*unnamed, rival.terms), None
            fit = with_unnamed(bench, fit, unnamed)
            continue
        if best is None:
            break
        larger = refined(bench, joined(bench, fit, best), 2)
        if not helps(bench, fit, larger, threshold):
            refused.add(best.knobs.id)
            found = [one for one in found if one.knobs.id != best.knobs.id]
            continue
        bench, found = retuned(bench, larger), None
        fit = restarted(bench, larger.parts, unnamed)
    if not unnamed:
        fit = exchanged(bench, fit, tractor, threshold)
    return Selection(bench, pruned(bench, fit, threshold), unnamed, threshold)


def _left(fit: Fit, found: list[Tried]) -> Array:
    """What is left of the fit, without what its own columns could still take."""
    return Projector(fit.slope)(fit.surprise) if found else fit.surprise


def _rival(bench: Bench, fit: Fit, unnamed: tuple[Dependence, ...]) -> Score | None:
    """The strongest unnamed term that is not in the fit; one period is as good as its neighbours."""
    taken = {(one.on if not one.per_run else "time", one.changes) for one in unnamed}
    for score in scores(bench, fit):
        if (score.terms.on if not score.terms.per_run else "time", score.terms.changes) not in taken:
            return score
    return None


def _is_unnamed(bench: Bench, rival: Score, best: Tried | None, threshold: float) -> bool:
    chance = rival.freedoms + 4.0 * np.sqrt(2.0 * rival.freedoms)
    gain = rival.gain - chance
    material = MATERIAL * 3.0 * bench.course.rows
    if gain < max(threshold, material):
        return False
    return best is None or gain > CLEARLY * best.gain + LEAST_GAIN


def joined(bench: Bench, fit: Fit, best: Tried) -> Fit:
    """The fit with a tried effect added as it is."""
    parts = (*fit.parts, (best.knobs, best.at))
    bare = bench.surprise(settings_of(list(parts)))
    return Fit(parts, linear_extra(bare, fit.extra), fit.slope, fit.extra)


def with_unnamed(bench: Bench, fit: Fit, unnamed: tuple[Dependence, ...]) -> Fit:
    """The fit with unnamed terms at their best amounts."""
    bare = Fit(fit.parts, bench.surprise(fit.settings), np.zeros((len(fit.surprise), 0)))
    bare = replace(bare, slope=slopes(bench, bare, LATER_STEP))
    if not unnamed:
        return refined(bench, bare)
    made = np.concatenate([columns(bench, bare, one) for one in unnamed], axis=1)
    extra = Extra(made, np.zeros(made.shape[1]))
    return refined(bench, Fit(fit.parts, bare.surprise, bare.slope, extra))


def restarted(bench: Bench, parts: tuple[tuple[Knobs, Array], ...], unnamed: tuple[Dependence, ...] | None) -> Fit:
    """The same parts on a bench with other weights, fitted again."""
    surprise = bench.surprise(settings_of(list(parts)))
    fit = Fit(parts, surprise, np.zeros((len(surprise), 0)))
    return with_unnamed(bench, fit, unnamed or ())


def retuned(bench: Bench, fit: Fit) -> Bench:
    """The bench with noise and weights as the fit leaves them."""
    noise = tuned(replace(bench, noise=first_noise(bench.course)), fit.settings)
    found = prepare(bench.course, bench.rig, fit.settings, noise)
    for _ in range(MOST_EASINGS):
        # A model that is wrong everywhere, as of a vehicle of another kind, must not be judged by the millimetre: with
        # less trust in each measurement longer ways count.
        path = found.path_surprise(found.path(fit.settings), fit.settings)
        if float(np.mean(path * path)) < WRONG_EVERYWHERE:
            break
        wider = {name: EASING * getattr(found.noise, name) for name in ("position", "heading")}
        found = prepare(bench.course, bench.rig, fit.settings, replace(found.noise, **wider))
    return found


def exchanged(bench: Bench, fit: Fit, tractor: Tractor, threshold: float) -> Fit:
    """Replace a part where another effect in its place explains clearly more: one cause that stood in for two."""
    if len(fit.parts) < 2:
        return fit
    for knobs, _ in fit.parts:
        if not is_nameable(bench, fit, tractor, knobs.id):
            continue
        rest = without(bench, fit, knobs.id)
        found = scan(bench, rest, tractor, {knobs.id, *(entry.id for entry in CATALOGUE if entry.kind.searched)})
        if found and found[0].gain > rest.loss - fit.loss + LEAST_GAIN:
            return refined(bench, joined(bench, rest, found[0]))
    return fit


def without(bench: Bench, fit: Fit, name: str) -> Fit:
    """The fit refitted without one of its parts."""
    parts = tuple(part for part in fit.parts if part[0].id != name)
    surprise = linear_extra(bench.surprise(settings_of(list(parts))), fit.extra)
    smaller = Fit(parts, surprise, np.zeros((len(surprise), 0)), fit.extra)
    return refined(bench, replace(smaller, slope=slopes(bench, smaller, LATER_STEP)))


def pruned(bench: Bench, fit: Fit, threshold: float) -> Fit:
    """Backward: leave out, one by one, what the others have made superfluous."""
    while fit.parts:
        costs = [(without(bench, fit, knobs.id), knobs.id) for knobs, _ in fit.parts]
        smaller, _ = min(costs, key=lambda one: one[0].loss)
        if smaller.loss - fit.loss > LEAST_GAIN:
            return fit
        fit = smaller
    return fit


def is_nameable(bench: Bench, fit: Fit, tractor: Tractor, name: str) -> bool:
    """Whether a part is larger than the tolerance of the base tractor, and clearly so."""
    knobs, at = next(part for part in fit.parts if part[0].id == name)
    mine = fit.columns(name)
    away = at - np.array(knobs.neutral)
    # Of a direction that the logs never tell, as of a slope driven one way only, nothing is asked.
    inverse = np.linalg.pinv(robust_covariance(bench, fit)[mine, mine], rcond=1e-12, hermitian=True)
    sigmas = float(np.sqrt(away @ inverse @ away))
    return knobs.deviation(at) > finest_of(tractor, name, bench.row_s) and sigmas > CLEAR_SIGMAS
