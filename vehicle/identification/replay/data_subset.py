"""A balanced subset of long logs: pieces that together represent all of the driving.

Hours of driving show a cause many times over. Pieces of two minutes are chosen one by one, each time the one whose run,
time, pace, bends, direction, gear and implement are covered least, relative to their share of the logs; so rare driving
is represented as well as usual driving. The same logs always give the same subset.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from vehicle.identification.logs.schema import Array
from vehicle.identification.replay.drive_segments import WINDOW_S, DriveDataset, DriveSegment, resample_on_grid
from vehicle.records import DT_S, HISTORY_STEPS

MOST_SUBSET_S = 3600.0  # chosen: four times the driving that shows every effect of usual size; time grows in proportion
# Chosen: longer than the period of any covariate; whole pairs of windows, so that halves stay the same.
SUBSET_PIECE_S = 6.0 * WINDOW_S
TIME_CLASSES, VALUE_CLASSES = 10, 4  # classes of time and of continuous values
PieceClasses = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class DataSubset:
    """A dataset of pieces of another one, and the runs of that one to which its own runs belong."""

    dataset: DriveDataset
    runs: tuple[int, ...]


def select_balanced_subset(
    dataset: DriveDataset, most_s: float = MOST_SUBSET_S, left_out: Collection[int] = ()
) -> DataSubset:
    """Return pieces of a dataset with the given total duration, without the runs `left_out`.

    The dataset itself if it is no longer and no run is left out.
    """
    segments = [segment for segment in dataset.segments if segment.run not in left_out]
    if sum(segment.time[-1] for segment in segments) <= most_s:
        if not left_out:
            return DataSubset(dataset, tuple(range(len(dataset.names))))
        chosen = segments
    else:
        pieces = [piece for segment in segments for piece in cut_segment(segment)]
        seconds = np.array([piece.time[-1] for piece in pieces])
        chosen = [pieces[index] for index in sorted(_choose_least_covered(_classify_pieces(pieces), seconds, most_s))]
    runs = sorted({piece.run for piece in chosen})
    renumbered = tuple(replace(piece, run=runs.index(piece.run)) for piece in chosen)
    names = tuple(dataset.names[run] for run in runs)
    return DataSubset(replace(dataset, names=names, segments=renumbered), tuple(runs))


def cut_segment(segment: DriveSegment, piece_s: float = SUBSET_PIECE_S) -> Iterator[DriveSegment]:
    """Cut a segment into pieces of a duration, the last one with the remainder; returns it whole if it is too short for
    two."""
    count = max(int(segment.time[-1] / piece_s), 1)
    if count == 1:
        yield segment
        return
    edges = [*np.searchsorted(segment.time, piece_s * np.arange(count)).tolist(), segment.rows]
    for begin, end in pairwise(edges):
        if end - begin > 1:
            yield _extract_piece(segment, slice(begin, end))


def _extract_piece(segment: DriveSegment, rows: slice) -> DriveSegment:
    """Return some rows of a segment as a segment of their own."""
    first = float(segment.time[rows.start])

    def select_rows(column: Array | None) -> Array | None:
        return None if column is None else column[rows]

    time = segment.time[rows] - first
    names = ("east", "north", "heading", "speed", "working", "wheel", "command", "target")
    columns: dict[str, Any] = {name: select_rows(getattr(segment, name)) for name in names}
    slope = segment.grids.get("across")
    if slope is not None:
        columns["across"] = np.interp(segment.time[rows], np.arange(len(slope)) * DT_S, slope)
    return replace(
        segment,
        start_s=segment.start_s + first,
        time=time,
        grids=resample_on_grid(time, columns),
        measured_rows={name: mask[rows] for name, mask in segment.measured_rows.items()},
        earlier_commands=_cut_earlier_commands(segment, first),
        **{name: columns[name] for name in names},
    )


def _cut_earlier_commands(segment: DriveSegment, first_s: float) -> Array:
    """Return the commands (m,) on the grid before a time of a segment, as far back as a delay reaches."""
    within = segment.grids.get("command", np.empty(0))[: round(first_s / DT_S)]
    return np.concatenate([segment.earlier_commands, within])[-HISTORY_STEPS:]


def _classify_pieces(pieces: list[DriveSegment]) -> PieceClasses:
    """Return the classes of each piece (p, c): a number per column, equal for similar pieces."""
    ends = np.cumsum([piece.time[-1] for piece in pieces])
    turned = np.array([piece.heading[-1] - piece.heading[0] for piece in pieces])
    bend_total = np.array([np.abs(np.diff(piece.heading)).sum() for piece in pieces])
    pace = np.array([piece.speed_in_gear.mean() for piece in pieces])
    directions = np.array([[np.cos(piece.heading).mean(), np.sin(piece.heading).mean()] for piece in pieces])
    columns = [
        np.array([piece.run for piece in pieces]),
        np.minimum(TIME_CLASSES * ends / ends[-1], TIME_CLASSES - 1),
        *[_compute_quartile_numbers(values) for values in (pace, bend_total, turned)],
        np.round(2.0 * np.arctan2(directions[:, 1], directions[:, 0]) / np.pi) % VALUE_CLASSES,
        np.array([piece.gear < 0.0 for piece in pieces]),
        np.array([round(2.0 * float(piece.working.mean())) for piece in pieces]),
    ]
    return np.stack(columns, axis=1).astype(np.int64)


def _compute_quartile_numbers(values: Array) -> PieceClasses:
    """Return the quarter of all values in which each value is."""
    edges = np.quantile(values, np.arange(1, VALUE_CLASSES) / VALUE_CLASSES)
    return np.searchsorted(edges, values, side="right").astype(np.int64)


def _choose_least_covered(classes: PieceClasses, seconds: Array, most_s: float) -> list[int]:
    """Choose pieces one by one, each the first of those whose classes are covered least so far."""
    numbers = [np.unique(column, return_inverse=True)[1] for column in classes.T]
    class_totals = [np.bincount(number, seconds) for number in numbers]
    covered = [np.zeros(len(class_seconds)) for class_seconds in class_totals]
    is_remaining, chosen, total = np.ones(len(seconds), dtype=np.bool_), list[int](), 0.0
    while is_remaining.any() and total < most_s:
        share = sum(
            (covered_s / total_s)[number]
            for covered_s, total_s, number in zip(covered, class_totals, numbers, strict=True)
        )
        best = int(np.argmin(np.where(is_remaining, share, np.inf)))
        is_remaining[best] = False
        chosen.append(best)
        total += float(seconds[best])
        for covered_s, number in zip(covered, numbers, strict=True):
            covered_s[number[best]] += seconds[best]
    return chosen


def leave_out_runs(dataset: DriveDataset, runs: Collection[int]) -> DriveDataset:
    """Return a dataset without the segments of some runs; all runs keep their numbers. Itself without such runs."""
    if not runs:
        return dataset
    return replace(dataset, segments=tuple(segment for segment in dataset.segments if segment.run not in runs))
