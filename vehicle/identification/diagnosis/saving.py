"""What a diagnosis saves: effect by effect, whatever lowers the error of runs that had no part in its value.

Every run is replayed from its commands with amounts fitted to the other runs, each half of a single run with those of
the other. An effect that raises an error by more than the scatter of its pieces is not saved, and only likely.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from vehicle.identification.diagnosis.drive_data import PATH_STEP_S, Places
from vehicle.identification.diagnosis.grammar import Hypothesis, collect_widths, split_amounts
from vehicle.identification.diagnosis.holdout import (
    PiecesByHorizon,
    compute_errors,
    is_extension_harmful,
    is_extension_helpful,
    measure_pieces,
)
from vehicle.identification.diagnosis.model_fit import FIT_STEP, Fit, Problem, collect_bounds
from vehicle.identification.diagnosis.results import LIKELY, HoldoutResult, HoldoutRun
from vehicle.identification.diagnosis.unexplained import ERROR_PIECE_S
from vehicle.identification.diagnosis.values import ValueConverter
from vehicle.identification.diagnosis.verdicts import Verdict, centre_laws
from vehicle.identification.logs.schema import Array, Mask
from vehicle.identification.replay.drive_segments import compute_half_numbers
from vehicle.identification.replay.horizon_errors import HalfSettings
from vehicle.model.tractor import Settings

LEAST_INFORMATION_SHARE = 0.02  # of what all runs know of an amount: with less the other runs say nothing of it
DRAWS, GAIN_QUANTILES, SEED = 200, (0.05, 0.95), 7
LEFT_OUT_WORDS = "Every run was left out once, and driven with what the other runs show."
HALVES_WORDS = "Each half of the run was driven with what its other half shows."


@dataclass(frozen=True, eq=False)
class Saved:
    """Verdicts to save and those that left-out runs refuse, as they harm them or, only likely, do not help them; the
    gain (%) of each with its 90 % interval, and the errors of left-out runs."""

    verdicts: tuple[Verdict, ...]
    refused: tuple[Verdict, ...]
    gains: dict[str, tuple[float, tuple[float, float]]] = field(default_factory=dict)
    holdout: HoldoutResult | None = None


def choose_saved(converter: ValueConverter, fit: Fit, verdicts: Sequence[Verdict], step: Callable[[], None]) -> Saved:
    """Try the verdicts that a tractor file can hold, the clearest first."""
    problem = converter.problem
    trial = _LeftOutTrial(converter, fit)
    kept: list[Verdict] = []
    refused: list[Verdict] = []
    base = now = trial.replay([])
    for verdict in verdicts:
        if not verdict.hypothesis.is_storable:
            continue
        pieces = trial.replay([*(one.hypothesis for one in kept), verdict.hypothesis])
        step()
        is_refused = (
            not is_extension_helpful(now, pieces, trial.has_speed)
            if verdict.status == LIKELY
            else is_extension_harmful(now, pieces, trial.has_speed)
        )
        if is_refused:
            refused.append(verdict)
        else:
            kept.append(verdict)
            now = pieces
    gains = {}
    for verdict in kept:
        others = [one.hypothesis for one in kept if one is not verdict]
        gains[verdict.hypothesis.id] = _compute_gain(trial.replay(others), now)
    return Saved(tuple(kept), tuple(refused), gains, _build_holdout(problem, base, now) if kept else None)


@dataclass(eq=False)
class _LeftOutTrial:
    """Replays of every run with amounts that the run had no part in."""

    converter: ValueConverter
    fit: Fit

    def __post_init__(self) -> None:
        self.problem = self.converter.problem
        dataset = self.problem.data.dataset
        self.has_speed = all(segment.speed_measured for segment in dataset.segments)
        self.amounts = compute_left_out_amounts(self.problem, self.fit)

    def replay(self, hypotheses: Sequence[Hypothesis]) -> PiecesByHorizon:
        """Errors of all pieces with these hypotheses alone."""

        def build(amounts: Array) -> Settings:
            parts = [(one, own) for one, own in split_amounts(self.fit.model, amounts) if one in hypotheses]
            return self.converter.build_settings(parts)

        settings: dict[int, Settings | HalfSettings] = {
            run: build(own[0]) if len(own) == 1 else (build(own[0]), build(own[1])) for run, own in self.amounts.items()
        }
        return measure_pieces(self.problem.data.dataset, self.problem.rig, settings)


def compute_left_out_amounts(problem: Problem, fit: Fit) -> dict[int, list[Array]]:
    """By run the amounts (k,) that the other runs give, by one Gauss-Newton step; of a single run those of each half of
    its windows of 20 s, by the other. What only one run shows stays its own."""
    data, runs = problem.data, problem.data.window_runs
    if len(np.unique(runs)) > 1:
        groups = {run: [runs == run] for run in range(data.runs)}
    else:
        begins = data.path_starts[:-1][data.window_segments]
        seconds: Array = np.asarray((data.window_starts - begins) * PATH_STEP_S, dtype=np.float64)
        halves = compute_half_numbers(seconds)
        groups = {run: [halves == half for half in (0, 1)] for run in range(data.runs)}
    widths, bounds = collect_widths(fit.model), collect_bounds(fit.model)
    linear = problem.linearise(fit.model, fit.amounts, fit.residuals, 2.0 * FIT_STEP)

    def leave_out(inside: Mask) -> Array:
        if inside.all() or not inside.any():
            return fit.amounts
        step, curvature = linear.step_without(inside)
        is_known = np.diag(curvature) >= LEAST_INFORMATION_SHARE * np.diag(linear.curvature)
        return np.asarray(np.where(is_known, np.clip(fit.amounts + widths * step, *bounds), fit.amounts))

    centre = centre_laws(problem, fit)
    return {run: [centre @ leave_out(inside) for inside in own] for run, own in groups.items()}


def _sum_by_run(pieces: PiecesByHorizon) -> Array:
    """Squared errors over 5 s, cross and along together, and rows: (runs, 2)."""
    rows = pieces.get(ERROR_PIECE_S)
    if rows is None:
        return np.zeros((0, 2))
    runs = rows[:, 0].astype(np.int64)
    return np.stack([np.bincount(runs, rows[:, 1] + rows[:, 2]), np.bincount(runs, rows[:, 4])], axis=1)


def _compute_gain(without: PiecesByHorizon, with_it: PiecesByHorizon) -> tuple[float, tuple[float, float]]:
    """Reduction (%) of the error over 5 s on left-out runs, and its 90 % interval by drawing runs again."""
    before, after = _sum_by_run(without), _sum_by_run(with_it)
    if not before.size:
        return 0.0, (0.0, 0.0)
    draws = np.random.default_rng(SEED).integers(0, len(before), (DRAWS, len(before)))

    def measure(chosen: Places) -> float:
        first, last = before[chosen].sum(axis=0)[0], after[chosen].sum(axis=0)[0]
        return 100.0 * (1.0 - math.sqrt(last / max(first, 1e-12)))

    low, high = np.quantile([measure(chosen) for chosen in draws], GAIN_QUANTILES)
    return measure(np.arange(len(before))), (float(low), float(high))


def _build_holdout(problem: Problem, before: PiecesByHorizon, after: PiecesByHorizon) -> HoldoutResult:
    names = problem.data.dataset.names
    has_speed = all(segment.speed_measured for segment in problem.data.dataset.segments)
    by_run = tuple(
        HoldoutRun(name, compute_errors(before, run), compute_errors(after, run)) for run, name in enumerate(names)
    )
    return HoldoutResult(names, compute_errors(before), compute_errors(after),
                         is_extension_helpful(before, after, has_speed), by_run,
                         LEFT_OUT_WORDS if len(names) > 1 else HALVES_WORDS)  # fmt: skip
