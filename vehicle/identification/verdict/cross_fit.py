"""Judging on runs that had no part in anything: causes are selected and fitted on one half of the runs, and the other
half is driven with what was found.

Both halves take turns. With one run its pieces are halved instead. The halves are chosen so that each of them shows
what all runs together show: a circle to one side only would make another diagnosis of its half.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from vehicle.identification.cause_selection.refit import build_weighted_residual_model
from vehicle.identification.cause_selection.selection import CauseSelection, select_causes
from vehicle.identification.faults.unlike_runs import RunDifference
from vehicle.identification.fit.residual_fit import EffectFit, sum_normal_equations_by_block
from vehicle.identification.logs.schema import Array
from vehicle.identification.model_extension.term_proposals import sum_driving_time
from vehicle.identification.replay.data_subset import (
    DataSubset,
    cut_segment,
    leave_out_runs,
    select_balanced_subset,
)
from vehicle.identification.replay.drive_segments import DriveDataset, DriveSegment
from vehicle.identification.replay.horizon_errors import (
    HorizonSquares,
    make_zero_squared_errors,
    sum_squared_errors_by_run,
)
from vehicle.identification.replay.rig import ReplayRig
from vehicle.identification.residuals.residual_model import ResidualModel
from vehicle.identification.thresholds import MOST_PIECES, SHORTEST_HALF_S, SHORTEST_PIECE_S
from vehicle.identification.verdict.held_out_case import list_level_settings
from vehicle.identification.verdict.named_causes import (
    ExplainedCase,
    ReportStep,
    drop_open_names,
    drop_outweighed_names,
    explain_error,
    list_nameable,
)
from vehicle.model.tractor import Settings, Tractor

MOST_RUNS_TRIED = 12  # 2^11 splits; of more runs, every second one is as good


@dataclass(frozen=True, eq=False)
class Half:
    """Half of the logs: what was found on it (`selection`, `explained`), and the other half (`unseen`) to judge it on.

    Runs of `unseen` have the numbers of all runs together.
    """

    selection: CauseSelection
    explained: ExplainedCase
    unseen: DriveDataset

    def sum_unseen_squares(self, names: Collection[str]) -> list[HorizonSquares]:
        """Return the squared errors of the unseen runs, driven with the terms of these names.

        Of an effect with two levels, a run takes the one that suits it better.
        """
        rig, runs = self.selection.residual_model.rig, range(len(self.unseen.names))
        terms = tuple(term for term in self.explained.case.extension.terms if term.parameters.id in names)
        tables = [
            sum_squared_errors_by_run(self.unseen, rig, dict.fromkeys(runs, settings))
            for settings in list_level_settings(terms)
        ]
        return [min((table[run] for table in tables), key=_sum_distances) for run in runs]


def _sum_distances(squares: HorizonSquares) -> float:
    """Return the squared errors across and along: a level of the speed shows along the path alone."""
    return float(sum(part[0] + part[1] for part in squares.values()))


def explain_dataset(
    dataset: DriveDataset, rig: ReplayRig, step: ReportStep, with_search: bool = True
) -> tuple[CauseSelection, ExplainedCase]:
    """Select the causes of a dataset, and explain its error by them; `with_search` is that of explain_error."""
    selection = select_causes(build_weighted_residual_model(dataset, rig, {}), rig.tractor, lambda _: step())
    return selection, explain_selection(selection, rig.tractor, step, with_search)


@dataclass(frozen=True, eq=False)
class SearchedRuns:
    """The runs in which causes are searched, the subset that is searched, what was found, and the runs left out."""

    agreeing: DriveDataset
    subset: DataSubset
    selection: CauseSelection
    explained: ExplainedCase
    left_out: Sequence[RunDifference]


def explain_agreeing_runs(
    dataset: DriveDataset, rig: ReplayRig, unlike_runs: Sequence[RunDifference], step: ReportStep
) -> SearchedRuns:
    """Explain the error of the runs that agree with each other.

    Runs that another ground would make as unlike belong to them where an effect at two levels explains both grounds.
    """
    of_tractor = [difference for difference in unlike_runs if not difference.is_of_ground]
    for left_out in (of_tractor, unlike_runs):
        numbers = {difference.run for difference in left_out}
        agreeing, subset = leave_out_runs(dataset, numbers), select_balanced_subset(dataset, left_out=numbers)
        searched = SearchedRuns(agreeing, subset, *explain_dataset(subset.dataset, rig, step), left_out)
        if len(left_out) == len(unlike_runs) or _has_two_levels(searched.explained):
            break
    return searched


def _has_two_levels(explained: ExplainedCase) -> bool:
    return any(term.runs is not None for term in explained.case.extension.terms)


def explain_selection(
    selection: CauseSelection, tractor: Tractor, step: ReportStep, with_search: bool = True
) -> ExplainedCase:
    """Explain the error by the causes of a selection, without names that something unknown may look like."""
    explained = explain_error(selection, list_nameable(selection, tractor), tractor, step, with_search)
    return drop_open_names(selection, drop_outweighed_names(selection, explained))


def cross_fit(selection: CauseSelection, explained: ExplainedCase, step: ReportStep) -> list[Half]:
    """Return both halves of the data of a selection; none where one of them is too short to be diagnosed.

    On two grounds there are none either: half of the runs may show too little of one of them. Terms that lower the
    open-loop error are only searched for where all of the data have some.
    """
    residual_model, with_search = (
        selection.residual_model,
        bool(explained.open_loop_fit and explained.open_loop_fit.model.terms),
    )
    if _has_two_levels(explained):
        return []
    halves = []
    for seen, unseen in split_in_halves(residual_model, selection.fit):
        if min(seen.seconds, unseen.seconds) < SHORTEST_HALF_S:
            return []
        halves.append(Half(*explain_dataset(seen, residual_model.rig, step, with_search), unseen))
    return halves


def split_in_halves(residual_model: ResidualModel, fit: EffectFit) -> Iterator[tuple[DriveDataset, DriveDataset]]:
    """Return the data seen and unseen by each half; runs that are seen are numbered anew."""
    dataset = residual_model.dataset
    if len(dataset.names) == 1:
        pieces = _cut_evenly(dataset)
        halves = [tuple(pieces[first::2]) for first in (0, 1)]
        datasets = [replace(dataset, segments=half) for half in halves]
        yield from ((datasets[0], datasets[1]), (datasets[1], datasets[0])) if all(halves) else ()
        return
    first_runs = choose_balanced_half(residual_model, fit)
    for seen_runs in (first_runs, frozenset(range(len(dataset.names))) - first_runs):
        unseen = tuple(segment for segment in dataset.segments if segment.run not in seen_runs)
        yield select_runs(dataset, seen_runs), replace(dataset, segments=unseen)


def _cut_evenly(dataset: DriveDataset) -> list[DriveSegment]:
    """Cut the segments of one run into at most MOST_PIECES pieces, each longer than the longest horizon."""
    piece_s = max(SHORTEST_PIECE_S, dataset.seconds / MOST_PIECES)
    return [piece for segment in dataset.segments for piece in cut_segment(segment, piece_s)]


def select_runs(dataset: DriveDataset, runs: Collection[int]) -> DriveDataset:
    """Return the dataset of some of the runs alone, numbered anew in their order."""
    order = {run: number for number, run in enumerate(sorted(runs))}
    segments = tuple(replace(segment, run=order[segment.run]) for segment in dataset.segments if segment.run in order)
    return replace(dataset, names=tuple(dataset.names[run] for run in order), segments=segments)


def choose_balanced_half(residual_model: ResidualModel, fit: EffectFit) -> frozenset[int]:
    """Return half of the runs, so that both halves hold as much as possible of the information on every coordinate."""
    count = len(residual_model.dataset.names)
    if count > MOST_RUNS_TRIED:
        return frozenset(range(0, count, 2))
    information = _measure_information_by_run(residual_model, fit)

    def rate_half(half: frozenset[int]) -> tuple[float, float]:
        share = information[sorted(half)].sum(axis=0)
        least = np.minimum(share, 1.0 - share)
        return float(least.min()), float(least.sum())

    halves = [frozenset((0, *others)) for others in combinations(range(1, count), (count + 1) // 2 - 1)]
    return max(halves, key=rate_half)


def _measure_information_by_run(residual_model: ResidualModel, fit: EffectFit) -> Array:
    """Return the share of every run in the information on every coordinate, and in the driving (runs, m + 1)."""
    runs, effects = len(residual_model.dataset.names), sum(parameters.count for parameters, _ in fit.parts)
    information = np.zeros((runs, effects))
    if effects:
        squares = sum_normal_equations_by_block(residual_model, fit.jacobian, fit.residuals).squares
        np.add.at(information, residual_model.block_runs, np.diagonal(squares, axis1=1, axis2=2)[:, :effects])
    information = np.column_stack([information, sum_driving_time(residual_model.dataset)])
    return np.asarray(information / np.maximum(information.sum(axis=0), 1e-12))


def add_squares(tables: Collection[list[HorizonSquares]], runs: int) -> list[HorizonSquares]:
    """Return the sums per run of several tables of squared errors."""
    totals = make_zero_squared_errors(runs)
    for table in tables:
        for total, part in zip(totals, table, strict=True):
            for horizon, squares in part.items():
                total[horizon] += squares
    return totals


def sum_squares_without(halves: Collection[Half], settings: Settings, rig: ReplayRig) -> list[HorizonSquares]:
    """Return the squared errors of all unseen runs as the tractor file has them."""
    runs = len(next(iter(halves)).unseen.names)
    tables = [sum_squared_errors_by_run(half.unseen, rig, dict.fromkeys(range(runs), settings)) for half in halves]
    return add_squares(tables, runs)
