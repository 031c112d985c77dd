"""Runs that are unlike the others: another tractor, a half that was repaired, a run with other values.

Every run is compared with what all the other runs say of its conditions: curvature by wheel angle, side, speed and
implement; pace by command; wheel angle by command. What the others do not show of a run's conditions widens its error
(Bayesian linear regression), so that a run with the only left bends is not unlike because it turns left.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from vehicle.identification.faults.run_delays import average_over_turn, build_delay_regression
from vehicle.identification.faults.run_groups import RunSplit, estimate_own_values, find_split, is_later, rank_runs
from vehicle.identification.faults.run_regression import (
    FEWEST_ROWS,
    RunRegression,
    estimate_noise,
    estimate_own,
    is_shown_in_halves,
    thin_rows,
)
from vehicle.identification.faults.steering_evidence import (
    STEP_S,
    SteeringEvidence,
    build_evidence_segments,
    find_largest_angles,
)
from vehicle.identification.logs.schema import Array, Log, Mask
from vehicle.identification.logs.vehicle_size import compute_file_curvature
from vehicle.identification.thresholds import (
    UNLIKE_FEWEST_OTHERS,
    UNLIKE_GAIN_SHARE,
    UNLIKE_LATE_S,
    UNLIKE_MOST_SHARE,
    UNLIKE_OFFSET_DEG,
    UNLIKE_PACE_SHARE,
    UNLIKE_SIGMAS,
)
from vehicle.model.tractor import Tractor

_STEADY_DEG, _STEADY_S = 1.0, 2.0  # a command that moved less than this within this time
_LARGEST_DEG = 60.0  # of a wheel
_ALIKE_SHARE = 0.7  # chosen, of the strength of what is found: another quantity that may be meant
_MOST_CANDIDATES = 4  # runs that are tried as the unlike one: limits the time with many runs


@dataclass(frozen=True)
class RunDifference:
    """How a run differs: index of the run, what differs, by how much (ratio, deg or s), and a clause.

    `group` are the runs that differ alike, with this one: half of the runs, or a part of at least two. `is_of_ground`
    marks a group that another ground would make as well: it differs in nothing but its pace.
    """

    run: int
    quantity: str
    amount: float
    words: str
    group: tuple[int, ...] = ()
    is_of_ground: bool = False


@dataclass(frozen=True)
class _Quantity:
    """What one column of a run's own difference is: its name, the least difference that matters, and its clause."""

    name: str
    least: float
    column: int
    describe: Callable[[float], str]
    condition: str


def find_unlike_runs(logs: Sequence[Log], tractor: Tractor, ground: str) -> list[RunDifference]:
    """Return the runs that are unlike the others, a difference each; empty where many runs differ from each other.

    Of two groups of runs the smaller one is unlike the other; of two equal ones the one driven first. The tractor file
    gives the shape of the curve of curvature over wheel angle, not its scale.
    """
    if len(logs) < UNLIKE_FEWEST_OTHERS + 1:
        return []
    locks = find_largest_angles(logs)
    segments = [build_evidence_segments(log, locks) for log in logs]
    regressions = [
        (regression, quantities)
        for regression, quantities in (
            (_build_bend_regression(logs, segments, tractor, ground), _BEND_QUANTITIES),
            (_build_pace_regression(logs, segments), _PACE_QUANTITIES),
            (build_delay_regression(logs, tractor, ground), _DELAY_QUANTITIES),
        )
        if regression is not None
    ]
    in_groups = _find_groups(regressions, logs)
    if in_groups:
        return in_groups
    strongest: dict[int, RunDifference] = {}
    for regression, quantities in regressions:
        for difference in _find_differences(regression, quantities, len(logs)):
            strongest.setdefault(difference.run, difference)
    return sorted(strongest.values(), key=lambda one: one.run)


def describe_groups(
    differences: Sequence[RunDifference], logs: Sequence[Log], is_left_out: bool = True
) -> tuple[str, ...]:
    """Return a sentence where the unlike runs are a group of their own, with what to do about it; else none.

    A group that was not left out of the diagnosis (`is_left_out`) is explained by another ground.
    """
    if not differences or not differences[0].group:
        return ()
    group = differences[0].group
    others = [run for run in range(len(logs)) if run not in group]
    names, other_names = (_join_names([logs[run].name for run in runs]) for runs in (group, others))
    ranks = rank_runs(logs)
    since = next(
        (
            f" All runs from {logs[min(later, key=ranks.__getitem__)].name} on are of one of them."
            for earlier, later in ((others, group), (group, others))
            if is_later(ranks, earlier, later)
        ),
        "",
    )
    if not is_left_out:
        return (
            f"The runs are on two grounds, or of two tractors: each of {names} {differences[0].words}.{since} The "
            "diagnosis has a value for each ground; if the runs are of two tractors, diagnose the two groups apart.",
        )
    return (
        f"The runs are of two tractors, or of one that was changed: each of {names} {differences[0].words}.{since} "
        f"Diagnose the two groups apart; this diagnosis is of {other_names}.",
    )


# --- what is compared --------------------------------------------------------------------------------------------


def _describe_gain(own: float) -> str:
    wider = 1.0 / (1.0 + own) - 1.0
    return f"turns {100.0 * abs(wider):.0f} % {'wider' if wider > 0.0 else 'tighter'}"


def _describe_offset(own: float) -> str:
    return f"pulls {abs(own):.1f} deg to the {'right' if own > 0.0 else 'left'}"


def _describe_pace(own: float) -> str:
    return f"drives {100.0 * abs(math.expm1(own)):.0f} % {'faster' if own > 0.0 else 'slower'}"


def _describe_late(own: float) -> str:
    return f"turns its wheels {abs(own):.2f} s {'later' if own > 0.0 else 'earlier'}"


_BEND_QUANTITIES = (
    _Quantity("gain", UNLIKE_GAIN_SHARE, 0, _describe_gain, "at the same wheel angles"),
    _Quantity("offset", UNLIKE_OFFSET_DEG, 1, _describe_offset, "at the same wheel angles"),
)
_PACE_QUANTITIES = (_Quantity("pace", UNLIKE_PACE_SHARE, 0, _describe_pace, "at the same commanded speed"),)
_DELAY_QUANTITIES = (_Quantity("late", UNLIKE_LATE_S, 0, _describe_late, "after a command"),)


def _build_bend_regression(
    logs: Sequence[Log], segments: Sequence[Sequence[SteeringEvidence]], tractor: Tractor, ground: str
) -> RunRegression | None:
    """Build the angle at which the file's tractor would bend as the path does, by wheel angle, speed and implement."""
    rows = []
    for run, parts in enumerate(segments):
        for part in parts:
            angle = part.usual if part.wheel is None else part.wheel
            is_sure = np.isfinite(part.curvature)
            if part.wheel is None or part.hold_s > 0.0:
                is_sure &= _find_steady_rows(angle, part.hold_s)
            chosen = thin_rows(is_sure)
            working = np.interp(part.time_s[chosen], logs[run].time_s, logs[run].implement)
            values = (part.curvature, average_over_turn(angle), part.pace)
            rows.append(np.stack([*[column[chosen] for column in values], working, np.full(len(chosen), float(run))]))
    if not rows:
        return None
    curvature, angle, pace, working, number = np.concatenate(rows, axis=1)
    if len(angle) < FEWEST_ROWS or float(np.std(angle)) < 1.0:
        return None
    grid = np.linspace(-_LARGEST_DEG, _LARGEST_DEG, 481)
    needed = np.interp(curvature, compute_file_curvature(grid, tractor, ground), grid)
    one = np.ones(len(angle))
    nuisance = np.stack([angle, one, np.abs(angle), angle * np.abs(angle) / 20.0, angle * pace**2 / 4.0, working], 1)
    prior_sd = np.array([10.0, 10.0, 0.1, 0.1, 0.1, 2.0])
    return RunRegression(needed, number, nuisance, prior_sd, np.stack([angle, one], 1))


def _build_pace_regression(logs: Sequence[Log], segments: Sequence[Sequence[SteeringEvidence]]) -> RunRegression | None:
    """Build the logarithm of pace over command by implement, bend, speed and direction, where the command is steady."""
    rows = []
    for run, (log, parts) in enumerate(zip(logs, segments, strict=True)):
        if log.speed_command_mps is None:
            return None
        for part in parts:
            target = np.interp(part.time_s, log.time_s, log.speed_command_mps)
            reach = round(5.0 / STEP_S)
            steady = np.zeros(len(target), dtype=np.bool_)
            steady[reach:] = [
                float(np.ptp(target[row - reach : row + 1])) < 0.05 for row in range(reach, len(target))
            ]  # fmt: skip
            chosen = thin_rows(steady & (part.pace > 0.3) & (target > 0.3) & np.isfinite(part.curvature))
            working = np.interp(part.time_s[chosen], log.time_s, log.implement)
            course = _measure_course(log, part.time_s[chosen])
            values = (part.pace[chosen], target[chosen], part.curvature[chosen])
            rows.append(np.stack([*values, working, *course, np.full(len(chosen), float(run))]))
    if not rows:
        return None
    pace, target, curvature, working, east, north, number = np.concatenate(rows, axis=1)
    if len(pace) < FEWEST_ROWS:
        return None
    one = np.ones(len(pace))
    nuisance = np.stack([one, working, curvature**2 / 0.05, np.abs(curvature) / 0.2, target - 1.5, east, north], 1)
    prior_sd = np.array([10.0, 0.2, 0.1, 0.1, 0.05, 0.05, 0.05])
    return RunRegression(np.log(pace / target), number, nuisance, prior_sd, one[:, None])


def _measure_course(log: Log, time: Array) -> tuple[Array, Array]:
    """Return the direction of travel (east, north) of rows."""
    step = [
        np.interp(time + 1.0, log.time_s, axis) - np.interp(time - 1.0, log.time_s, axis)
        for axis in (log.easting_m, log.northing_m)
    ]
    length = np.maximum(np.hypot(*step), 1e-6)
    return step[0] / length, step[1] / length


def _find_steady_rows(values: Array, hold_s: float) -> Mask:
    reach = round((_STEADY_S + hold_s) / STEP_S)
    steady = np.zeros(len(values), dtype=np.bool_)
    if len(values) > reach:
        windows = np.lib.stride_tricks.sliding_window_view(values, reach + 1)
        steady[reach:] = np.ptp(windows, axis=1) < _STEADY_DEG
    return steady


def _join_names(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


# --- two groups of runs --------------------------------------------------------------------------------------------


def _find_groups(
    regressions: Sequence[tuple[RunRegression, Sequence[_Quantity]]], logs: Sequence[Log]
) -> list[RunDifference]:
    """Return the runs of the smaller of two groups, with all quantities in which the groups differ."""
    own = {
        quantity: estimate_own_values(regression, quantity.column, quantity.least)
        for regression, quantities in regressions
        for quantity in quantities
    }
    splits = {quantity: find_split(values, quantity.least) for quantity, values in own.items()}
    found = {quantity: split for quantity, split in splits.items() if split is not None}
    if not found:
        return []
    clearest = max(found, key=lambda quantity: found[quantity].clarity)
    others, group = _complete_groups(found[clearest], logs)
    sign = 1.0 if set(found[clearest].second) <= set(group) else -1.0
    clauses = [f"{clearest.describe(sign * found[clearest].amount)} {clearest.condition}"]
    for quantity in (quantity for quantity in own if quantity is not clearest):
        amount, error = own[quantity].measure_difference(others, group, quantity.least)
        if abs(amount) > max(quantity.least, UNLIKE_SIGMAS * error):
            clauses.append(f"{quantity.describe(amount)} {quantity.condition}")
    words = f"{' and '.join(clauses)}, compared with {_join_names([logs[run].name for run in others])}"
    is_of_ground = clearest in _PACE_QUANTITIES and len(clauses) == 1
    return [
        RunDifference(run, clearest.name, sign * found[clearest].amount, words, group, is_of_ground) for run in group
    ]


def _complete_groups(split: RunSplit, logs: Sequence[Log]) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return the group that counts and the one that is told: the smaller one, or the earlier one of two equal ones.

    Where the groups follow each other in time, they have the runs that show nothing and were driven inside them.
    """
    groups, ranks = [split.first, split.second], rank_runs(logs)
    if is_later(ranks, *groups):
        groups = [_add_runs(groups[0], ranks, -1), _add_runs(groups[1], ranks, 1)]
    elif is_later(ranks, groups[1], groups[0]):
        groups = [_add_runs(groups[0], ranks, 1), _add_runs(groups[1], ranks, -1)]
    # As it was driven last is how the tractor is.
    groups.sort(key=lambda group: (len(group), max(ranks[run] for run in group)))
    return groups[1], groups[0]


def _add_runs(group: tuple[int, ...], ranks: Sequence[int], side: int) -> tuple[int, ...]:
    """Return the group with all runs that were driven before its last one (side -1), or after its first one (1)."""
    edge = min(side * ranks[run] for run in group)
    return tuple(run for run in range(len(ranks)) if side * ranks[run] >= edge)


# --- each run against the others ---------------------------------------------------------------------------------


def _find_differences(regression: RunRegression, quantities: Sequence[_Quantity], runs: int) -> list[RunDifference]:
    """Return the runs whose own difference is far beyond its error and beyond what runs usually differ by.

    They are found one by one, the clearest first, because each of them bends what the others seem to show.
    """
    sigma, weights = estimate_noise(regression)
    found: dict[int, tuple[_Quantity, float]] = {}
    while len(found) <= UNLIKE_MOST_SHARE * runs:
        weights = np.where(np.isin(regression.runs, list(found)), 0.0, weights)
        clearest = _find_clearest(
            regression, quantities, [run for run in range(runs) if run not in found], sigma, weights
        )
        if clearest is None:
            count = runs - len(found)
            return [
                RunDifference(
                    run, quantity.name, own, _describe(regression, quantities, run, quantity, own, sigma, count)
                )
                for run, (quantity, own) in found.items()
            ]
        run, quantity, own = clearest
        found[run] = quantity, own
    return []


def _describe(
    regression: RunRegression, quantities: Sequence[_Quantity], run: int, found: _Quantity, own: float, sigma: float,
    count: int,
) -> str:  # fmt: skip
    """Return the clause on a difference, with the other quantity that would explain the run about as well."""
    clauses, strengths = [], {}
    for quantity in (found, *[quantity for quantity in quantities if quantity is not found]):
        estimate = estimate_own(
            regression, regression.runs == run, quantity.column, sigma, np.ones(len(regression.runs))
        )
        if estimate is None:
            continue
        strengths[quantity.name] = abs(estimate[0] / estimate[1])
        amount = own if quantity is found else estimate[0]
        if strengths[quantity.name] >= _ALIKE_SHARE * strengths[found.name] and abs(amount) > quantity.least:
            clauses.append(quantity.describe(amount))
    return f"{' or '.join(clauses)} {found.condition}, compared with the {count} other runs"


def _find_clearest(
    regression: RunRegression, quantities: Sequence[_Quantity], runs: Sequence[int], sigma: float, weights: Array
) -> tuple[int, _Quantity, float] | None:
    """Return the run, the quantity and the difference that is clearest; None where none is clear."""
    clearest, best = None, UNLIKE_SIGMAS
    for quantity in quantities:
        known = _estimate_runs(regression, quantity, runs, sigma, weights)
        if len(known) < UNLIKE_FEWEST_OTHERS + 1:
            continue
        candidates = sorted(known, key=lambda run: -abs(known[run][0] / known[run][1]))[:_MOST_CANDIDATES]
        for run in candidates:
            own, error = known[run]
            if abs(own) < quantity.least or abs(own) < UNLIKE_SIGMAS * error:
                continue
            without = np.where(regression.runs == run, 0.0, weights)
            others = _estimate_runs(regression, quantity, [other for other in runs if other != run], sigma, without)
            scores = [abs(one / its_error) for one, its_error in others.values() if its_error < quantity.least]
            if len(scores) < UNLIKE_FEWEST_OTHERS:
                continue
            # What conditions do that no column describes makes all runs differ a little.
            score = abs(own) / error / max(1.4826 * float(np.median(scores)), 1.0)
            if score > best and is_shown_in_halves(regression, run, quantity.column, own, sigma, weights):
                clearest, best = (run, quantity, own), score
    return clearest


def _estimate_runs(
    regression: RunRegression, quantity: _Quantity, runs: Sequence[int], sigma: float, weights: Array
) -> dict[int, tuple[float, float]]:
    """Return the difference of each run from the others and its standard error, where the rows suffice."""
    estimates = {run: estimate_own(regression, regression.runs == run, quantity.column, sigma, weights) for run in runs}
    return {run: estimate for run, estimate in estimates.items() if estimate is not None}
