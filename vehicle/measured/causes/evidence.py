"""Whether a fit has a cause: what runs it never saw say, and how sure its coordinates are."""

from __future__ import annotations

import numpy as np

from vehicle.measured.fit.fitting import Fit, block_sums
from vehicle.measured.fit.knobs import finest_of
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


def robust_covariance(bench: Bench, fit: Fit) -> Array:
    """Covariance of the coordinates of the fit from the scatter of its blocks (sandwich), never below the noise's."""
    sums = block_sums(bench, fit.slope, fit.surprise)
    inverse = np.linalg.pinv(sums.squares.sum(axis=0), rcond=1e-14, hermitian=True)
    middle = sums.sides.T @ sums.sides
    sandwich = inverse @ middle @ inverse
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


def helps(bench: Bench, without: Fit, fit: Fit, threshold: float) -> bool:
    """Whether the larger fit helps runs it has not seen: most of those it concerns, or some without harm to others."""
    gain = held_out_losses(bench, without) - held_out_losses(bench, fit)
    concerned = np.abs(gain) > CONCERNED
    if float(gain.sum()) < HELD_OUT_SHARE * threshold:
        return _helps_within(bench, without, fit)
    harmless = (
        -gain[gain < 0.0].sum() < HARM * gain[gain > 0.0].sum() and np.count_nonzero(gain > HELPED) >= FEWEST_HELPED
    )
    return bool(harmless or np.count_nonzero(gain[concerned] > 0.0) >= MOST_OF_CONCERNED * np.count_nonzero(concerned))


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


def is_nameable(bench: Bench, fit: Fit, tractor: Tractor, name: str) -> bool:
    """Whether a part is larger than the tolerance of the base tractor, and clearly so."""
    knobs, at = next(part for part in fit.parts if part[0].id == name)
    mine = fit.columns(name)
    away = at - np.array(knobs.neutral)
    # Of a direction that the logs never tell, as of a slope driven one way only, nothing is asked.
    inverse = np.linalg.pinv(robust_covariance(bench, fit)[mine, mine], rcond=1e-12, hermitian=True)
    sigmas = float(np.sqrt(away @ inverse @ away))
    return knobs.deviation(at) > finest_of(tractor, name, bench.row_s) and sigmas > CLEAR_SIGMAS
