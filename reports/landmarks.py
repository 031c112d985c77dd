"""Where names stand on a map, and where arrows: of tracks, rounds and cells, and of the legs that work them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from reports.paths import WORKING, Extent, arrow, numbered, pieces, spread
from reports.results import Drive, Points
from reports.wording import LEAST_ON_MAP_M2, area

WORK_KINDS = ("track", "round")
# In hundredths of the larger side of a map: distances between two, how far beyond a track its number stands.
_LABELS, _ARROWS, _BESIDE, _HEAD = 2.3, 4.0, 1.2, 1.1
_HALF_TOLD = 5.0  # what is told of missed ground reaches so far to either side
_FROM_LABELS, _FROM_CELLS = 2.8, 6.5  # between an arrow and the number of a track or round, or the name of a cell
_ALONG = (0.5, 0.42, 0.58, 0.34, 0.66, 0.26, 0.74, 0.18, 0.82)  # shares of a stretch where its arrow may stand
_ROUND_AT, _ROUND_STEP, _ROUND_PLACES = 0.25, 0.07, 4  # likewise of the longest edge of a round: its number


@dataclass(frozen=True, eq=False)
class Label:
    """A text and the place (2,) it is centred on, metres."""

    text: str
    place: Points


@dataclass(frozen=True, eq=False)
class WorkMark:
    """The head (3, 2) of an arrow on a worked stretch, tip first, and its number in the list of legs behind it."""

    head: Points
    label: Label | None


def track_labels(drive: Drive, size: float) -> list[Label]:
    """Names of tracks beyond both their ends, as many as have room."""
    names = drive.track_names or tuple(str(index + 1) for index in range(len(drive.tracks)))
    return [
        Label(names[index], place)
        for index, place in numbered(drive.tracks, _BESIDE * size / 100, _LABELS * size / 100)
    ]


def round_labels(drive: Drive, size: float) -> list[Label]:
    """R1, R2, ... on the longest edge of every round, beside each other, as many as have room."""
    labels = []
    for one in drive.rounds:
        edges = np.diff(one.points, axis=0)
        longest = int(np.argmax(np.hypot(*edges.T)))
        share = _ROUND_AT + _ROUND_STEP * ((one.number - 1) % _ROUND_PLACES)
        labels.append(Label(f"R{one.number}", one.points[longest] + share * edges[longest]))
    places = np.array([label.place for label in labels]).reshape(-1, 2)
    return [labels[index] for index in spread(places, _LABELS * size / 100)]


def cell_labels(drive: Drive) -> list[Label]:
    """Number and bearing of every cell."""
    return [
        Label(f"cell {cell.number}: {cell.bearing_deg:.0f}\N{DEGREE SIGN}", np.array([cell.x_m, cell.y_m]))
        for cell in drive.cells
    ]


def missed_label(drive: Drive, box: Extent) -> Label | None:
    """What the largest piece of missed ground measures, on it and within the map; None where it is too small."""
    piece = drive.largest_missed
    if piece is None or piece.m2 < LEAST_ON_MAP_M2:
        return None
    half = min(_HALF_TOLD * box.size / 100, 0.5 * box.width)
    x = min(max(piece.x_m, box.west + half), box.east - half)
    return Label(f"{area(piece.m2)} left", np.array([x, piece.y_m]))


def work_marks(drive: Drive, size: float) -> list[list[WorkMark]]:
    """Per tractor arrows on its worked stretches with their numbers in its list of legs, as many as have room.

    Where the middle of a stretch has none, another place along it is tried.
    """
    taken = np.empty((0, 2))
    named = [
        (np.array([label.place for label in labels]).reshape(-1, 2), apart)
        for labels, apart in (
            ([*track_labels(drive, size), *round_labels(drive, size)], _FROM_LABELS), (cell_labels(drive), _FROM_CELLS)
        )
    ]  # fmt: skip
    marks: list[list[WorkMark]] = [[] for _ in drive.xy]
    for tractor, own in enumerate(marks):
        for text, line in _worked(drive, tractor):
            for head in _heads(line, _HEAD * size / 100):
                back = 0.5 * (head[1] + head[2])
                place = back + 1.1 * (back - head[0])
                clear = (_apart(one, others, apart * size / 100) for others, apart in named for one in (head[0], place))
                if _apart(head[0], taken, _ARROWS * size / 100) and all(clear):
                    taken = np.concatenate([taken, head[:1]])
                    own.append(WorkMark(head, Label(text, place) if text else None))
                    break
    return marks


def _apart(place: Points, others: Points, apart_m: float) -> bool:
    return float(((others - place) ** 2).sum(axis=1).min(initial=np.inf)) >= apart_m**2


def _worked(drive: Drive, tractor: int) -> Iterator[tuple[str, Points]]:
    """Number in the list of legs ("" without a list) and path (n, 2) of every worked stretch."""
    xy, status = drive.xy[tractor], drive.status[tractor]
    if not drive.steps:
        yield from (("", part.points) for part in pieces(xy, status) if part.status == WORKING)
        return
    for number, step in enumerate(drive.steps[tractor], start=1):
        if step.kind in WORK_KINDS:
            first, last = (round(at / drive.step_s) for at in (step.from_s, step.from_s + step.seconds))
            yield str(number), xy[first : last + 1]


def _heads(line: Points, length_m: float) -> Iterator[Points]:
    """Heads of arrows at several places along a path, the middle first; none on one shorter than they are."""
    along: npt.NDArray[np.float64] = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))))
    if along[-1] < 2.0 * length_m:
        return
    for share in _ALONG:
        reach = min(share, 1.0 - share) * along[-1]
        inside = (along >= share * along[-1] - reach) & (along <= share * along[-1] + reach)
        head = arrow(line[inside], length_m) if inside.sum() > 1 else None
        if head is not None:
            yield head


def leg_numbers(marks: Sequence[WorkMark]) -> list[Label]:
    """The numbers of those that have one."""
    return [mark.label for mark in marks if mark.label is not None]
