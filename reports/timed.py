"""A path thinned in place and time together, so that a few knots both draw and animate it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from heapq import heapify, heappop, heappush
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from reports.results import Drive, Points

FINEST_M = 0.1


@dataclass(frozen=True, eq=False)
class Lane:
    """The path of one tractor: samples kept (k,), positions there (k, 2) in metres, status of each stretch (k - 1,)."""

    sample: npt.NDArray[np.int64]
    xy: Points
    status: npt.NDArray[np.int64]

    def runs(self) -> list[tuple[int, int, int]]:
        """Stretches of one status after another: status, first knot, last knot."""
        if not len(self.status):
            return []
        cuts = [0, *(np.flatnonzero(np.diff(self.status)) + 1).tolist(), len(self.status)]
        return [(int(self.status[a]), a, b) for a, b in pairwise(cuts)]


def lanes(drive: Drive, most: int) -> Sequence[Lane]:
    """The paths of a drive by few knots, from which every place is `FINEST_M` off at most at its sample.

    The distance counts at the same time (synchronous Euclidean distance: Meratnia and de By 2004, Spatiotemporal
    compression techniques for moving point objects), so changes of speed keep a knot as bends do. The worst place gets
    the next knot, so that where `most` knots are not enough for all tractors together the paths become coarser evenly.
    The step between two samples has the status of the later one; every change of status is a knot, whatever `most` is.
    """
    kept = [set(_ends(status)) for status in drive.status]
    todo = [
        worst
        for number, status in enumerate(drive.status)
        for first, last in pairwise(_ends(status))
        if (worst := _worst(drive, number, first, last))
    ]
    heapify(todo)
    room = most - sum(map(len, kept))
    while todo and room > 0:
        _, number, first, middle, last = heappop(todo)
        kept[number].add(middle)
        room -= 1
        for start, end in ((first, middle), (middle, last)):
            if worst := _worst(drive, number, start, end):
                heappush(todo, worst)
    samples = [np.array(sorted(one), dtype=np.int64) for one in kept]
    return [
        Lane(sample, xy[sample], status[sample[1:]])
        for sample, xy, status in zip(samples, drive.xy, drive.status, strict=True)
    ]


def _ends(status: npt.NDArray[np.int64]) -> list[int]:
    """First sample, changes of status and last sample."""
    return sorted({0, *(np.flatnonzero(np.diff(status[1:])) + 1).tolist(), len(status) - 1})


def _worst(drive: Drive, number: int, first: int, last: int) -> tuple[float, int, int, int, int] | None:
    """The sample farthest off the line between two others, for a heap that gives the farthest first."""
    if last - first < 2:
        return None
    xy = drive.xy[number]
    share = (np.arange(first + 1, last) - first)[:, None] / (last - first)
    off = xy[first] + (xy[last] - xy[first]) * share - xy[first + 1 : last]
    square = off[:, 0] ** 2 + off[:, 1] ** 2
    at = int(np.argmax(square))
    return None if square[at] <= FINEST_M**2 else (-float(square[at]), number, first, first + 1 + at, last)
