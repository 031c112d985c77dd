"""A balanced part of long logs: pieces that together look like the whole of them.

Hours of driving tell a cause many times over. Pieces of two minutes are taken one by one, each time the one whose run,
time, pace, bends, direction, gear and implement have been covered least, as a share of what the logs have of them: so
what is rare is there as well as what is usual. The same logs always give the same part.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from vehicle.layout import DT_S
from vehicle.measured.logs.record import Array
from vehicle.measured.replay.course import Course, Stretch, on_grid
from vehicle.measured.replay.windows import WINDOW_S

SEARCHED_S = 3600.0  # chosen: four times the drives that tell every effect of usual size; more costs its time in full
PIECE_S = 6.0 * WINDOW_S  # chosen: longer than any unnamed wave; whole pairs of windows, so that halves stay the same
TENTHS, CLASSES = 10, 4  # parts of the time, and of what varies evenly
Classes = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Part:
    """A course of pieces of another one, and the runs of that one that its own runs are pieces of."""

    course: Course
    runs: tuple[int, ...]


def balanced_part(course: Course, most_s: float = SEARCHED_S) -> Part:
    """Pieces of a course that last about so long together; the course itself where it is no longer."""
    if course.seconds <= most_s:
        return Part(course, tuple(range(len(course.names))))
    pieces = [piece for stretch in course.stretches for piece in cut(stretch)]
    seconds = np.array([piece.time[-1] for piece in pieces])
    chosen = [pieces[index] for index in sorted(_least_covered(_classes(pieces), seconds, most_s))]
    runs = sorted({piece.run for piece in chosen})
    stretches = tuple(replace(piece, run=runs.index(piece.run)) for piece in chosen)
    return Part(replace(course, names=tuple(course.names[run] for run in runs), stretches=stretches), tuple(runs))


def cut(stretch: Stretch) -> Iterator[Stretch]:
    """A stretch in pieces of PIECE_S, the last of which takes what is over; itself where it is too short for two."""
    count = max(int(stretch.time[-1] / PIECE_S), 1)
    if count == 1:
        yield stretch
        return
    edges = [*np.searchsorted(stretch.time, PIECE_S * np.arange(count)).tolist(), stretch.rows]
    for begin, end in pairwise(edges):
        if end - begin > 1:
            yield _piece(stretch, slice(begin, end))


def _piece(stretch: Stretch, rows: slice) -> Stretch:
    """Some rows of a stretch as one of their own."""
    first = float(stretch.time[rows.start])

    def part(column: Array | None) -> Array | None:
        return None if column is None else column[rows]

    time = stretch.time[rows] - first
    names = ("east", "north", "heading", "speed", "working", "wheel", "command", "target")
    columns: dict[str, Any] = {name: part(getattr(stretch, name)) for name in names}
    slope = stretch.grids.get("across")
    if slope is not None:
        columns["across"] = np.interp(stretch.time[rows], np.arange(len(slope)) * DT_S, slope)
    return replace(
        stretch, start_s=stretch.start_s + first, time=time, grids=on_grid(time, columns),
        **{name: columns[name] for name in names},
    )  # fmt: skip


def _classes(pieces: list[Stretch]) -> Classes:
    """What each piece is an instance of (p, c): a number per column, alike for pieces that are alike."""
    ends = np.cumsum([piece.time[-1] for piece in pieces])
    turned = np.array([piece.heading[-1] - piece.heading[0] for piece in pieces])
    bent = np.array([np.abs(np.diff(piece.heading)).sum() for piece in pieces])
    pace = np.array([piece.pace.mean() for piece in pieces])
    ways = np.array([[np.cos(piece.heading).mean(), np.sin(piece.heading).mean()] for piece in pieces])
    columns = [
        np.array([piece.run for piece in pieces]),
        np.minimum(TENTHS * ends / ends[-1], TENTHS - 1),
        *[_quarter(values) for values in (pace, bent, turned)],
        np.round(2.0 * np.arctan2(ways[:, 1], ways[:, 0]) / np.pi) % CLASSES,
        np.array([piece.gear < 0.0 for piece in pieces]),
        np.array([round(2.0 * float(piece.working.mean())) for piece in pieces]),
    ]
    return np.stack(columns, axis=1).astype(np.int64)


def _quarter(values: Array) -> Classes:
    """Which quarter of all values each one is in."""
    edges = np.quantile(values, np.arange(1, CLASSES) / CLASSES)
    return np.searchsorted(edges, values, side="right").astype(np.int64)


def _least_covered(classes: Classes, seconds: Array, most_s: float) -> list[int]:
    """Pieces one by one, each the first of those whose classes have least of their time chosen already."""
    numbers = [np.unique(column, return_inverse=True)[1] for column in classes.T]
    whole = [np.bincount(number, seconds) for number in numbers]
    covered = [np.zeros(len(one)) for one in whole]
    left, chosen, total = np.ones(len(seconds), dtype=np.bool_), list[int](), 0.0
    while left.any() and total < most_s:
        share = sum((have / of)[number] for have, of, number in zip(covered, whole, numbers, strict=True))
        best = int(np.argmin(np.where(left, share, np.inf)))
        left[best] = False
        chosen.append(best)
        total += float(seconds[best])
        for have, number in zip(covered, numbers, strict=True):
            have[number[best]] += seconds[best]
    return chosen
