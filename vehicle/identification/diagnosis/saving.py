"""What a diagnosis saves: effect by effect, whatever lowers the error of runs that had no part in its value.

Every run is replayed from its commands with amounts fitted to the other runs, each half of a single run with those of
the other. An effect that raises an error by more than the scatter of its pieces is not saved, and only likely. Pieces
are compared in pairs, before and after, as a few held-out runs hold only a few of the longer ones.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from fields.arrays import Flags, Floats, Integers
from vehicle.identification.diagnosis.corrections import correct_logs
from vehicle.identification.diagnosis.drive_data import PATH_STEP_S
from vehicle.identification.diagnosis.grammar import Hypothesis, collect_widths, split_amounts
from vehicle.identification.diagnosis.model_fit import FIT_STEP, Fit, Problem, collect_bounds
from vehicle.identification.diagnosis.results import EQUIVALENT, LIKELY, NAMED, Finding, HoldoutResult, HoldoutRun
from vehicle.identification.diagnosis.verdicts import Verdict, build_settings, centre_laws
from vehicle.identification.logs.schema import Log
from vehicle.identification.logs.thresholds import DOUBT_SIGMAS, SEED
from vehicle.identification.replay.drive_segments import build_dataset, build_rig_and_corrections, compute_half_numbers
from vehicle.identification.replay.horizon_errors import (
    Pieces,
    compute_horizon_errors,
    join_pieces,
    measure_dataset,
    measure_pieces,
    sum_by_run,
)
from vehicle.identification.replay.simulation import simulate_instruments
from vehicle.model.effect_kinds import INTERVAL_SIGMAS, Interval
from vehicle.model.effects import DISCREPANCY_KEY
from vehicle.model.tractor import DiscrepancyModel, EffectSetting, Tractor

LEAST_INFORMATION_SHARE = 0.02  # of what all runs know of an amount: with less the other runs say nothing of it
DRAWS, GAIN_QUANTILES = 200, (0.05, 0.95)
LEFT_OUT_WORDS = "Every run was left out once, and driven with what the other runs show."
HALVES_WORDS = "Each half of the run was driven with what its other half shows."
FILE_DIGITS = 6  # significant digits of a value in a file: far finer than any interval
TRUSTED_SHARE = 0.005  # of the driving at either end of speeds and angles in which a discrepancy model is not trusted
HARM_FACTOR = 1.05  # an error that changes by less than a twentieth is the same
LEAST_HARM = np.array([5e-4, math.radians(0.03)])  # m and rad: smaller errors differ by the last digits of instruments


@dataclass(frozen=True, eq=False)
class Saved:
    """Verdicts to save, without those that left-out runs refuse, as they harm them or, only likely, do not help them;
    the gain (%) of each with its 90 % interval, and the errors of left-out runs."""

    verdicts: tuple[Verdict, ...]
    gains: dict[str, tuple[float, tuple[float, float]]] = field(default_factory=dict)
    holdout: HoldoutResult | None = None


def choose_saved(problem: Problem, fit: Fit, verdicts: Sequence[Verdict], step: Callable[[], None]) -> Saved:
    """Try the verdicts that a tractor file can hold, the clearest first."""
    names, has_speed = problem.data.dataset.names, problem.data.dataset.has_speed
    replay = partial(_replay_left_out, problem, fit, compute_left_out_amounts(problem, fit))
    kept = list[Verdict]()
    base = now = replay([])
    for verdict in (one for one in verdicts if one.hypothesis.is_storable):
        pieces = replay([*(one.hypothesis for one in kept), verdict.hypothesis])
        step()
        is_saved = (
            is_extension_helpful(now, pieces, has_speed)
            if verdict.status == LIKELY
            else not is_extension_harmful(now, pieces, has_speed)
        )
        if is_saved:
            kept.append(verdict)
            now = pieces
    gains = {}
    for verdict in kept:
        others = replay([one.hypothesis for one in kept if one is not verdict])
        gains[verdict.hypothesis.id] = _compute_gain(*(sum_by_run(one, len(names)) for one in (others, now)))
    words = LEFT_OUT_WORDS if len(names) > 1 else HALVES_WORDS
    holdout = compare_pieces(names, base, now, has_speed, words) if kept else None
    return Saved(tuple(kept), gains, holdout)


def _replay_left_out(
    problem: Problem,
    fit: Fit,
    amounts_by_run: Mapping[int, Sequence[Floats]],
    hypotheses: Sequence[Hypothesis],
) -> Pieces:
    """Errors of all pieces with these hypotheses alone, every run with amounts that it had no part in."""
    parts: list[Pieces] = []
    for segment in problem.data.dataset.segments:
        every = amounts_by_run[segment.run]
        for half, amounts in enumerate(every):
            own = [part for part in split_amounts(fit.model, amounts) if part[0] in hypotheses]
            shown = simulate_instruments(problem.rig, segment, build_settings(problem, own))
            parts.append({
                horizon: rows[(compute_half_numbers(rows[:, 1]) == half) | (len(every) == 1)]
                for horizon, rows in measure_pieces(segment, *shown[:2]).items()
            })  # fmt: skip
    return join_pieces(parts)


def compute_left_out_amounts(problem: Problem, fit: Fit) -> dict[int, list[Floats]]:
    """By run the amounts (k,) that the other runs give, by one Gauss-Newton step; of a single run those of each half of
    its windows of 20 s, by the other. What only one run shows stays its own."""
    data, runs = problem.data, problem.data.window_runs
    if len(np.unique(runs)) > 1:
        groups = {run: [runs == run] for run in range(data.runs)}
    else:
        begins = data.path_starts[:-1][data.window_segments]
        seconds: Floats = np.asarray((data.window_starts - begins) * PATH_STEP_S, dtype=np.float64)
        halves = compute_half_numbers(seconds)
        groups = {run: [halves == half for half in (0, 1)] for run in range(data.runs)}
    widths, bounds = collect_widths(fit.model), collect_bounds(fit.model)
    linear = problem.linearise(fit.model, fit.amounts, fit.residuals, 2.0 * FIT_STEP)

    def leave_out(inside: Flags) -> Floats:
        if inside.all() or not inside.any():
            return fit.amounts
        step, curvature = linear.step_without(inside)
        is_known = np.diag(curvature) >= LEAST_INFORMATION_SHARE * np.diag(linear.curvature)
        return np.asarray(np.where(is_known, np.clip(fit.amounts + widths * step, *bounds), fit.amounts))

    centre = centre_laws(problem, fit)
    return {run: [centre @ leave_out(inside) for inside in own] for run, own in groups.items()}


def _compute_gain(before: Floats, after: Floats) -> tuple[float, tuple[float, float]]:
    """Reduction (%) of the error over 5 s on left-out runs (runs, 4), and its 90 % interval by drawing runs again."""
    draws = np.random.default_rng(SEED).integers(0, len(before), (DRAWS, len(before)))

    def measure(chosen: Integers) -> float:
        first, last = (float(one[chosen, :2].sum()) for one in (before, after))
        return 100.0 * (1.0 - math.sqrt(last / max(first, 1e-12)))

    low, high = np.quantile([measure(chosen) for chosen in draws], GAIN_QUANTILES)
    return measure(np.arange(len(before))), (float(low), float(high))


def build_extended_tractor(
    problem: Problem, tractor: Tractor, ground: str, saved: Sequence[Verdict], findings: Sequence[Finding]
) -> Tractor:
    """The tractor with what is saved. Effects of the file that these logs cannot show stay as they are."""
    by_id = {finding.id: finding for finding in findings}
    unseen = {finding.id for finding in findings if finding.value is None and finding.smallest_visible is None}
    effects = {name: setting for name, setting in tractor.effects.items() if name in unseen}
    settings = build_settings(problem, [(one.hypothesis, one.amounts) for one in saved])
    for name, values in settings.items():
        if name == DISCREPANCY_KEY or name not in by_id:
            continue
        finding = by_id[name]
        effects[name] = EffectSetting(
            value={key: round_value(number) for key, number in values.items()},
            interval={key: (round_value(low), round_value(high)) for key, (low, high) in
                      (finding.interval or {}).items() if math.isfinite(low) and math.isfinite(high)},
            named=finding.status == NAMED,
            equivalent_to=finding.equivalent_to if finding.status == EQUIVALENT else (),
            ground=ground,
            logs=problem.data.dataset.names,
        )  # fmt: skip
    amounts = settings.get(DISCREPANCY_KEY, {})
    discrepancy = _build_discrepancy(problem, saved, amounts) if amounts else None
    kept = tractor.discrepancy_model if discrepancy is None and not saved else discrepancy
    return tractor.model_copy(update={"effects": effects, "discrepancy_model": kept})


def round_value(value: float) -> float:
    """Round a value to the digits that a file needs."""
    return float(f"{value:.{FILE_DIGITS}g}")


def _build_discrepancy(problem: Problem, saved: Sequence[Verdict], amounts: Mapping[str, float]) -> DiscrepancyModel:
    """The discrepancy model with 95 % intervals, trusted where nearly all of the driving was."""
    dataset, intervals = problem.data.dataset, dict[str, Interval]()
    for verdict in (one for one in saved if one.hypothesis.terms):
        spread = INTERVAL_SIGMAS * np.sqrt(np.maximum(np.diag(verdict.covariance), 0.0))
        low, high = (
            build_settings(problem, [(verdict.hypothesis, verdict.amounts + sign * spread)])[DISCREPANCY_KEY]
            for sign in (-1.0, 1.0)
        )
        intervals |= {name: (min(low[name], high[name]), max(low[name], high[name])) for name in low}
    speeds = np.concatenate([segment.speed_in_gear for segment in dataset.segments])
    angles = [segment.wheel if segment.wheel is not None else segment.command for segment in dataset.segments]
    degrees = np.degrees(np.concatenate([one for one in angles if one is not None]))
    slow, fast = (float(np.quantile(speeds, share)) for share in (TRUSTED_SHARE, 1.0 - TRUSTED_SHARE))
    left, right = (float(np.quantile(degrees, share)) for share in (TRUSTED_SHARE, 1.0 - TRUSTED_SHARE))
    slow = min(slow, 0.9 * fast)
    if right - left < 1.0:
        left, right = left - 0.5, right + 0.5
    return DiscrepancyModel(
        amounts={name: round_value(amount) for name, amount in amounts.items()},
        speed_mps=(round_value(max(slow, 0.0)), round_value(max(fast, 0.01))),
        angle_deg=(round_value(left), round_value(right)),
        interval={name: (round_value(first), round_value(last)) for name, (first, last) in intervals.items()},
        logs=dataset.names,
    )


def measure_holdout(logs: Sequence[Log], tractor: Tractor, extended: Tractor, ground: str) -> HoldoutResult:
    """Replay logs that had no part in anything by both tractors; raises LogError where none can be replayed."""
    dataset = build_dataset(correct_logs(logs, tractor), (tractor.antenna_forward_m, tractor.antenna_right_m))
    old, new = (
        measure_dataset(dataset, *build_rig_and_corrections(machine, ground, dataset.origin))
        for machine in (tractor, extended)
    )
    return compare_pieces(dataset.names, old, new, dataset.has_speed)


def compare_pieces(names: tuple[str, ...], old: Pieces, new: Pieces, has_speed: bool, words: str = "") -> HoldoutResult:
    """Compare the errors of runs of these names by two tractors."""
    by_run = tuple(
        HoldoutRun(name, *(compute_horizon_errors(pieces, run) for pieces in (old, new)))
        for run, name in enumerate(names)
    )
    before, after = (compute_horizon_errors(pieces) for pieces in (old, new))
    return HoldoutResult(names, before, after, is_extension_helpful(old, new, has_speed), by_run, words)


def is_extension_helpful(old: Pieces, new: Pieces, with_along: bool) -> bool:
    """Whether errors fall together, at least one noticeably, and none rises by more than the scatter of its pieces.

    All horizons weigh the same, and distance and heading too; without `with_along` only the distance across counts.
    """
    if is_extension_harmful(old, new, with_along):
        return False
    changes = [np.where(noticeable, change, 0.0) for _, change, noticeable in _list_changes(old, new, with_along)]
    together = np.concatenate(changes) if changes else np.zeros(1)
    return bool(together.mean() < 0.0 and together.min() < -math.log(HARM_FACTOR))


def is_extension_harmful(old: Pieces, new: Pieces, with_along: bool) -> bool:
    """Whether the distance rises over some horizon, noticeably and by more than the scatter of its pieces; or the
    heading does while the distances do not fall together."""
    risen, fallen = np.zeros(2, dtype=np.bool_), 0.0
    for horizon, change, is_noticeable in _list_changes(old, new, with_along):
        rise = compute_rise_sigmas(_join_kinds(old[horizon], with_along), _join_kinds(new[horizon], with_along))
        risen |= (change > math.log(HARM_FACTOR)) & is_noticeable & (rise > DOUBT_SIGMAS)
        fallen += float(change[0]) * float(is_noticeable[0])
    return bool(risen[0] or (risen[1] and fallen >= 0.0))


def _join_kinds(pieces: Floats, with_along: bool) -> Floats:
    """Squared errors per piece (p, 2): distance, across alone without `with_along`, and heading, 0 without one."""
    distance = pieces[:, 2] + (pieces[:, 3] if with_along else 0.0)
    return np.stack([distance, np.nan_to_num(pieces[:, 4])], axis=1)


def _list_changes(old: Pieces, new: Pieces, with_along: bool) -> Iterator[tuple[float, Floats, Flags]]:
    """By horizon the logarithm of the change of the two errors (2,), and whether each is noticeable."""
    for horizon in (horizon for horizon in old if len(old[horizon])):
        rows = float(old[horizon][:, 5].sum())
        first, last = (
            np.maximum(np.sqrt(_join_kinds(pieces[horizon], with_along).sum(axis=0) / rows), 1e-9)
            for pieces in (old, new)
        )
        yield horizon, np.log(last / first), np.abs(last - first) > LEAST_HARM


def compute_rise_sigmas(old: Floats, new: Floats) -> Floats:
    """Return the rise of squared errors (k,) from paired pieces (p, k), in its standard errors; inf for one."""
    rises = new - old
    if len(rises) < 2:
        return np.full(rises.shape[1], np.inf)
    spread = rises.std(axis=0, ddof=1) * math.sqrt(len(rises))
    return np.asarray(rises.sum(axis=0) / np.maximum(spread, 1e-12))
