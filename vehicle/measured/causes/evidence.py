"""Whether a fit has a cause: what runs it never saw say, and how sure its coordinates are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import stdtrit

from vehicle.kinds import HELD, SURE
from vehicle.measured.fit.fitting import Fit, block_sums
from vehicle.measured.fit.knobs import Knobs, finest_of
from vehicle.measured.fit.products import crossed
from vehicle.measured.logs.record import Array
from vehicle.measured.surprise.bench import Bench
from vehicle.measured.thresholds import (
    CLEAR_SIGMAS,
    CONCERNED,
    FEW_RUNS,
    FEWEST_HELPED,
    GAIN_IN_FEW,
    HARM,
    HELD_OUT_SHARE,
    HELPED,
    MOST_OF_CONCERNED,
)
from vehicle.tractor import Tractor


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


def robust_covariance(bench: Bench, fit: Fit, few: bool = False) -> Array:
    """Covariance of the coordinates of the fit from the scatter of its blocks (sandwich), never below the noise's.

    With `few` the scatter is wider where few blocks tell of a coordinate: see of_few.
    """
    sums = block_sums(bench, fit.slope, fit.surprise)
    inverse = np.linalg.pinv(sums.squares.sum(axis=0), rcond=1e-14, hermitian=True)
    middle = sums.sides.T @ sums.sides
    sandwich = inverse @ middle @ inverse
    if few:
        wider = of_few(sums.squares, inverse)
        sandwich = sandwich * np.outer(wider, wider)
    factor = np.sqrt(np.maximum(np.diag(inverse) / np.maximum(np.diag(sandwich), 1e-300), 1.0))
    out: Array = sandwich * np.outer(factor, factor)
    return out


def promised_costs(fit: Fit) -> dict[str, float]:
    """Loss that comes back without each part, the other coordinates following, as far as straight lines hold."""
    inverse = np.linalg.pinv(crossed(fit.slope, fit.slope), rcond=1e-14, hermitian=True)
    costs = {}
    for knobs, at in fit.parts:
        mine, away = fit.columns(knobs.id), at - np.array(knobs.neutral)
        costs[knobs.id] = float(away @ np.linalg.pinv(inverse[mine, mine], rcond=1e-12, hermitian=True) @ away)
    return costs


def of_few(squares: Array, inverse: Array) -> Array:
    """How much wider a scatter between pieces must be taken to hold 95 %, per coordinate (m,).

    `squares` (p, m, m) are those of the pieces, `inverse` (m, m) that of their sum. A scatter between n pieces that
    tell the same is Student's with n - 1 freedoms, and its square too small by n / (n - 1); where they tell unlike
    amounts n is the inverse of the sum of their squared shares.
    """
    told = np.maximum(np.einsum("pij,ji->pi", inverse @ squares, inverse), 0.0)
    shares = told / np.maximum(told.sum(axis=0), 1e-300)
    count = 1.0 / np.maximum((shares * shares).sum(axis=0), 1e-12)
    free = np.maximum(count - 1.0, 1.0)
    return np.asarray(stdtrit(free, 0.5 + 0.5 * HELD) / SURE * np.sqrt(np.maximum(count, 2.0) / free))


def helps(bench: Bench, without: Fit, fit: Fit, threshold: float) -> bool:
    """Whether the larger fit helps runs it has not seen: most of those it concerns, or some without harm to others.

    Asked of the channels that its additional effects reach: elsewhere the two fits differ by no more than where the
    slopes of bent effects, as of a dead band, were taken.
    """
    without, fit = _reached(bench, without, fit)
    gain = held_out_losses(bench, without) - held_out_losses(bench, fit)
    concerned = np.abs(gain) > CONCERNED
    if float(gain.sum()) < HELD_OUT_SHARE * threshold:
        return _helps_within(bench, without, fit)
    harmless = (
        -gain[gain < 0.0].sum() < HARM * gain[gain > 0.0].sum() and np.count_nonzero(gain > HELPED) >= FEWEST_HELPED
    )
    return bool(harmless or np.count_nonzero(gain[concerned] > 0.0) >= MOST_OF_CONCERNED * np.count_nonzero(concerned))


def _reached(bench: Bench, without: Fit, fit: Fit) -> tuple[Fit, Fit]:
    """Both fits in the channels (path, wheel, speed) that the effects of the larger one alone reach."""
    added = [fit.columns(name) for name in fit.settings if name not in without.settings]
    rows = bench.course.rows
    channels = slice(0, 3 * rows), slice(3 * rows, 4 * rows), slice(4 * rows, 5 * rows)
    others = [channel for channel in channels if not any(fit.slope[channel, one].any() for one in added)]
    return _blind_to(without, others), _blind_to(fit, others)


def _blind_to(fit: Fit, channels: Sequence[slice]) -> Fit:
    """A fit without what it says of some channels; itself where it says nothing."""
    told = [channel for channel in channels if fit.surprise[channel].any() or fit.slope[channel].any()]
    if not told:
        return fit
    surprise, slope = fit.surprise.copy(), fit.slope.copy(order="K")
    for channel in told:
        surprise[channel] = slope[channel] = 0.0
    return replace(fit, surprise=surprise, slope=slope)


def _helps_within(bench: Bench, without: Fit, fit: Fit) -> bool:
    """An effect that lives in a few runs: its blocks must agree instead of the runs."""
    count = len(bench.block_runs)
    gain = np.bincount(bench.blocks, without.surprise**2 - fit.surprise**2, count)
    by_run = np.bincount(bench.block_runs, gain, len(bench.course.names))
    few = np.argsort(-by_run)[:FEW_RUNS]
    if by_run[few].sum() < GAIN_IN_FEW * gain.sum():
        return False
    inside = gain[np.isin(bench.block_runs, few)]
    concerned = np.abs(inside) > CONCERNED
    return bool(
        concerned.sum() >= 2 and np.count_nonzero(inside[concerned] > 0.0) >= MOST_OF_CONCERNED * concerned.sum()
    )


def nameable_parts(bench: Bench, fit: Fit, tractor: Tractor) -> list[str]:
    """Parts that are larger than the tolerance of the base tractor, and clearly so."""
    if not fit.parts:
        return []
    covariance = robust_covariance(bench, fit)
    return [
        knobs.id for knobs, at in fit.parts
        if knobs.deviation(at) > finest_of(tractor, knobs.id, bench.row_s)
        and _sigmas(knobs, at, covariance, fit.columns(knobs.id)) > CLEAR_SIGMAS
    ]  # fmt: skip


def _sigmas(knobs: Knobs, at: Array, covariance: Array, mine: slice) -> float:
    """How many standard deviations a part is from neutral."""
    away = at - np.array(knobs.neutral)
    # Of a direction that the logs never tell, as of a slope driven one way only, nothing is asked.
    inverse = np.linalg.pinv(covariance[mine, mine], rcond=1e-12, hermitian=True)
    return float(np.sqrt(away @ inverse @ away))
