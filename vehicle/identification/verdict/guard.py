"""The guard of a verdict: nothing is named or saved that raises the error on runs held out.

Judged are all horizons and kinds of error, twice: on every run with values from the other runs, and on each half of the
runs with what was selected and fitted on the other half alone (see cross_fit). What neither half found is not judged by
them, and not saved where one of them found something else instead. Where something does harm, terms without
a name go first, then what is only likely, then the names, each time the one without which the harm is least.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import astuple, dataclass, replace

from vehicle.identification.cause_selection.selection import CauseSelection
from vehicle.identification.diagnosis.results import ErrorsByHorizon, HoldoutResult, HoldoutRun
from vehicle.identification.replay.data_subset import DataSubset
from vehicle.identification.replay.drive_segments import DriveDataset
from vehicle.identification.replay.horizon_errors import (
    HorizonError,
    HorizonSquares,
    compute_horizon_errors,
    sum_squared_errors_by_run,
)
from vehicle.identification.replay.rig import ReplayRig
from vehicle.identification.thresholds import HARM_FACTOR, LEAST_HARM_CM, LEAST_HARM_DEG
from vehicle.identification.verdict.cross_fit import Half, add_squares, cross_fit, sum_squares_without
from vehicle.identification.verdict.held_out_case import (
    ERROR_PIECE_S,
    DiagnosisCase,
    collect_whole_settings,
    compute_small_sample_spread,
)
from vehicle.identification.verdict.named_causes import (
    ExplainedCase,
    ReportStep,
    keep_terms,
    list_separate_blocks,
)
from vehicle.model.discrepancy_model import TERMS_BY_NAME
from vehicle.model.effects import get_effect
from vehicle.model.tractor import Settings

KINDS = ("cross_cm", "along_cm", "heading_deg")
FEWEST_JUDGING_RUNS = 5  # chosen: of fewer runs one is as good as most
SLOW_MPS = 1.0  # chosen: at this pace a heading moves the path by what it is worth
NOTHING_LEFT = "What fits these logs best raises an error on runs that had no part in it, so nothing is saved."
UNJUDGED = "The halves of these logs do not show by themselves what all of them show together, so nothing is saved."
RAISED_ELSEWHERE = (
    "These logs are of two groups of runs, and what one of them says raises the error of all runs together; diagnose "
    "the groups apart and save what each of them says."
)
HELPED = "Each half of the logs was driven with what was found on the other half alone, and errors fall."
HELPED_BY_RUNS = (
    "Each half of the logs was driven with what was found on the other half alone, and no error changes much; the "
    "table of errors shows every run driven with values from the other runs."
)
Table = list[HorizonSquares]


def measure_harm(
    before: ErrorsByHorizon,
    after: ErrorsByHorizon,
    with_along: bool = True,
    longest_s: float = math.inf,
    noise_floor: ErrorsByHorizon | None = None,
) -> float:
    """Return the largest rise of an error, as a factor, over all horizons and kinds; 1 where none rises noticeably.

    Without a measured speed the error along the path says nothing about the tractor (`with_along`). Horizons beyond
    `longest_s` are left out. Rises are counted from what noise alone leaves (`noise_floor`): below it is chance.
    """
    worst = 1.0
    for horizon, kind in ((horizon, kind) for horizon in before if horizon <= longest_s for kind in KINDS):
        old, new = getattr(before[horizon], kind), getattr(after[horizon], kind)
        if noise_floor is not None and horizon in noise_floor:
            old = max(old, getattr(noise_floor[horizon], kind))
        least = _find_least_harm(kind, horizon)
        if (with_along or kind != "along_cm") and new - old > least:
            worst = max(worst, new / max(old, least))
    return worst


def measure_harm_of_runs(
    before: Sequence[HorizonSquares],
    after: Sequence[HorizonSquares],
    with_along: bool,
    longest_s: float,
    noise_floor: ErrorsByHorizon,
) -> float:
    """Return the largest rise of an error over all horizons and kinds as the geometric mean of its factors in runs; 1
    where none rises.

    One run that goes wrong as no other does may have most of the error of all of them, and what helps it alone may harm
    the others. The arguments are those of measure_harm, per run; with few runs nothing is judged.
    """
    errors = [[compute_horizon_errors([squares]) for squares in table] for table in (before, after)]
    kinds = [kind for kind in KINDS if with_along or kind != "along_cm"]
    worst = 1.0
    for horizon in (horizon for horizon in noise_floor if horizon <= longest_s):
        runs = [(old, new) for old, new in zip(*errors, strict=True) if horizon in old]
        if len(runs) < FEWEST_JUDGING_RUNS:
            continue
        for kind in kinds:
            factors = [_find_log_factor(old, new, horizon, kind, noise_floor) for old, new in runs]
            worst = max(worst, math.exp(sum(factors) / len(factors)))
    return worst


def _find_log_factor(
    before: ErrorsByHorizon, after: ErrorsByHorizon, horizon: float, kind: str, noise_floor: ErrorsByHorizon
) -> float:
    """Return the logarithm of the factor of an error in a run; 0 where it hardly changes. Below noise all is chance."""
    least, noise = _find_least_harm(kind, horizon), getattr(noise_floor[horizon], kind)
    old, new = (max(getattr(errors[horizon], kind), noise, least) for errors in (before, after))
    return math.log(new / old) if abs(new - old) > least else 0.0


def grant_chance(noise_floor: ErrorsByHorizon, seconds: float) -> dict[float, HorizonError]:
    """Return the errors that noise alone may leave in this much driving: few pieces scatter about the noise floor."""
    granted = {}
    for horizon, error in noise_floor.items():
        factor = math.sqrt(1.0 + compute_small_sample_spread(seconds, horizon))
        granted[horizon] = HorizonError(*(factor * value for value in astuple(error)))
    return granted


def _find_least_harm(kind: str, horizon_s: float) -> float:
    """Return the smallest rise of an error that counts; a heading that moves the path by less than LEAST_HARM_CM over
    the horizon is none."""
    if kind != "heading_deg":
        return LEAST_HARM_CM
    return max(LEAST_HARM_DEG, math.degrees(0.01 * LEAST_HARM_CM / (0.5 * SLOW_MPS * horizon_s)))


def is_harmful(before: ErrorsByHorizon, after: ErrorsByHorizon, with_along: bool = True) -> bool:
    """Whether an error on runs held out rises by more than HARM_FACTOR allows."""
    return measure_harm(before, after, with_along) > HARM_FACTOR


def is_helpful(before: ErrorsByHorizon, after: ErrorsByHorizon, with_along: bool = True) -> bool:
    """Whether no error rises and at least one falls noticeably, both by HARM_FACTOR."""
    return not is_harmful(before, after, with_along) and is_harmful(after, before, with_along)


@dataclass(frozen=True, eq=False)
class GuardedCase:
    """What may be named, what of it may be saved, and the errors on runs with no part in anything.

    `explained` harms no run held out over the horizons of a verdict, `saved` over no horizon at all: small errors of
    shape, as of how tyres begin to slide, add up over longer ones. `unsaved_names` are what would have a name without
    that; they are likely. `shown_names` are not saved either, but keep their names: a sensor shows them apart from the
    path, whose error over 20 s may have any other cause. `is_reduced` is whether anything was taken out, and `reason`
    why nothing is saved if nothing is left.
    """

    explained: ExplainedCase
    saved: ExplainedCase
    is_reduced: bool = False
    holdout: HoldoutResult | None = None
    unsaved_names: tuple[str, ...] = ()
    shown_names: tuple[str, ...] = ()
    reason: str = NOTHING_LEFT

    @property
    def unsaved_reason(self) -> str:
        """Why nothing is left to save; empty where something is left, or nothing was found."""
        return self.reason if self.is_reduced and not self.saved.case.extension.term_ids else ""


@dataclass(frozen=True, eq=False)
class _Judge:
    """What judges: all of the data, the settings and the rig of the tractor file, and both halves of the data."""

    dataset: DriveDataset
    subset: DataSubset
    selection: CauseSelection
    file_rig: ReplayRig
    file_settings: Settings
    halves: list[Half]

    @property
    def with_along(self) -> bool:
        return self.selection.residual_model.has_measured_speed

    def list_tables(self, explained: ExplainedCase) -> Iterator[tuple[Table, Table]]:
        """Squared errors per run, before and after: with values from other runs, then found on the other half."""
        runs = len(self.dataset.names)
        before = sum_squared_errors_by_run(self.dataset, self.file_rig, dict.fromkeys(range(runs), self.file_settings))
        _, held_out = collect_whole_settings(self.dataset, self.subset, explained.case)
        yield before, sum_squared_errors_by_run(self.dataset, self.selection.residual_model.rig, held_out)
        if self.halves:
            yield self.list_half_tables(explained.case.extension.term_ids)

    def list_half_ids(self) -> list[frozenset[str]]:
        """Return the terms that each half found by itself."""
        return [half.explained.case.extension.term_ids for half in self.halves]

    def list_half_tables(self, names: Collection[str]) -> tuple[Table, Table]:
        """Squared errors of the unseen runs of both halves, before and after."""
        runs = len(self.halves[0].unseen.names)
        after = add_squares([half.sum_unseen_squares(names) for half in self.halves], runs)
        return sum_squares_without(self.halves, self.file_settings, self.file_rig), after

    def measure_harm(self, explained: ExplainedCase, longest_s: float) -> float:
        """Return the largest rise of an error in any table."""
        noise, seconds = compute_horizon_errors(explained.case.noise_floor), self.dataset.seconds
        noise_floor = grant_chance(noise, explained.case.residual_model.dataset.seconds)
        noise_of_run = grant_chance(noise, seconds / len(self.dataset.names))
        return max(
            max(
                measure_harm(
                    compute_horizon_errors(before),
                    compute_horizon_errors(after),
                    self.with_along,
                    longest_s,
                    noise_floor,
                ),
                measure_harm_of_runs(before, after, self.with_along, longest_s, noise_of_run),
            )
            for before, after in self.list_tables(explained)
        )


def guard_case(
    dataset: DriveDataset,
    subset: DataSubset,
    selection: CauseSelection,
    explained: ExplainedCase,
    file_model: tuple[ReplayRig, Settings],
    step: ReportStep,
) -> GuardedCase:
    """Return what of a case harms no run held out; `file_model` is the rig and the settings of the tractor file."""
    if not explained.case.extension.term_ids:
        return GuardedCase(explained, explained)
    judge = _Judge(dataset, subset, selection, *file_model, cross_fit(selection, explained, step))
    kept = drop_harm(judge, explained, ERROR_PIECE_S)
    saved = drop_harm(judge, kept, math.inf)
    unjudged_ids = list_unjudged(saved.case.extension.term_ids, judge.list_half_ids())
    unjudged_ids |= list_doubtful_circles(saved.case)
    if unjudged_ids:
        # What is left had its values beside what is taken out.
        saved = drop_harm(judge, _keep(judge, saved, saved.case.extension.term_ids - unjudged_ids), math.inf)
    dropped = explained.case.extension.term_ids - kept.case.extension.term_ids
    judged = [name for name in kept.names if name not in unjudged_ids]
    unsaved = [name for name in judged if name not in saved.case.extension.term_ids]
    separate_blocks = list_separate_blocks(selection.residual_model)
    shown = tuple(name for name in unsaved if get_effect(name).block in separate_blocks)
    unsaved_names = tuple(name for name in unsaved if name not in shown)
    names = [name for name in judged if name not in unsaved_names]
    kept = replace(kept, names=names, case=replace(kept.case, refused_effects=kept.case.refused_effects | dropped))
    is_reduced = saved.case.extension.term_ids != explained.case.extension.term_ids
    reason = UNJUDGED if unjudged_ids else NOTHING_LEFT
    return GuardedCase(kept, saved, is_reduced, _build_holdout(judge, saved), unsaved_names, shown, reason)


def list_unjudged(kept_ids: Collection[str], half_ids: Sequence[Collection[str]]) -> frozenset[str]:
    """Return the terms that no half found by itself, where a half found something else: the halves do not judge them.

    Where the halves found nothing at all, they were only too short.
    """
    found = frozenset[str]().union(*half_ids)
    return frozenset(kept_ids) - found if found - frozenset(kept_ids) else frozenset()


def list_doubtful_circles(case: DiagnosisCase) -> frozenset[str]:
    """Return effects in a circle, which is searched for all over the field, that may help no run held out."""
    circles = {
        name for name in case.extension.term_ids if name not in TERMS_BY_NAME and get_effect(name).kind.is_searched
    }
    return frozenset(name for name in circles if case.compute_held_out_gain(name)[1][0] <= 0.0)


def guard_groups(
    guarded: GuardedCase,
    dataset: DriveDataset,
    subset: DataSubset,
    selection: CauseSelection,
    file_model: tuple[ReplayRig, Settings],
) -> GuardedCase:
    """Return the case with nothing to save where it raises the error of all runs, with those that are unlike the ones
    it was found in."""
    file_rig, file_settings = file_model
    runs, rig = range(len(dataset.names)), selection.residual_model.rig
    before = sum_squared_errors_by_run(dataset, file_rig, dict.fromkeys(runs, file_settings))
    settings = collect_whole_settings(dataset, subset, guarded.saved.case)[1]
    after = sum_squared_errors_by_run(dataset, rig, settings)
    with_along = selection.residual_model.has_measured_speed
    if not is_harmful(compute_horizon_errors(before), compute_horizon_errors(after), with_along):
        return guarded
    saved = keep_terms(selection, guarded.saved, ())
    return replace(guarded, saved=saved, is_reduced=True, holdout=None, reason=RAISED_ELSEWHERE)


def drop_harm(judge: _Judge, explained: ExplainedCase, longest_s: float) -> ExplainedCase:
    """Return the first of ever smaller cases that does no harm over horizons up to one; the last one has no terms."""
    for keep in (lambda _: True, lambda name: name not in TERMS_BY_NAME, lambda name: name in explained.names):
        kept_ids = {name for name in explained.case.extension.term_ids if keep(name)}
        case = explained if kept_ids == explained.case.extension.term_ids else _keep(judge, explained, kept_ids)
        if judge.measure_harm(case, longest_s) <= HARM_FACTOR:
            return case
    while case.case.extension.term_ids:
        smaller = [_keep(judge, case, case.case.extension.term_ids - {name}) for name in case.case.extension.term_ids]
        case = min(smaller, key=lambda one: judge.measure_harm(one, longest_s))
        if judge.measure_harm(case, longest_s) <= HARM_FACTOR:
            break
    return case


def _keep(judge: _Judge, explained: ExplainedCase, names: Collection[str]) -> ExplainedCase:
    return keep_terms(judge.selection, explained, names)


def _build_holdout(judge: _Judge, explained: ExplainedCase) -> HoldoutResult | None:
    """Return the errors of each half driven with what was found on the other one; None where there are no halves."""
    if not judge.halves or not explained.case.extension.term_ids:
        return None
    (run_tables, half_tables) = (
        (before, after, compute_horizon_errors(before), compute_horizon_errors(after))
        for before, after in judge.list_tables(explained)
    )
    before, after, *errors = half_tables
    names, by_halves = judge.halves[0].unseen.names, is_helpful(errors[0], errors[1], judge.with_along)
    outcome = HELPED if by_halves else HELPED_BY_RUNS
    return HoldoutResult(
        names,
        errors[0],
        errors[1],
        by_halves or is_helpful(run_tables[2], run_tables[3], judge.with_along),
        tuple(
            HoldoutRun(name, compute_horizon_errors([old]), compute_horizon_errors([new]))
            for name, old, new in zip(names, before, after, strict=True)
        ),
        outcome,
    )
