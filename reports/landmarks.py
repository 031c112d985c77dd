"""Where names stand on a map, and where arrows: of tracks, rounds and cells, and of the legs that work them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from reports.paths import WORKING, Extent, arrow, extent, numbered, pieces
from reports.results import Drive, Points, RoundLine
from reports.wording import LEAST_ON_MAP_M2, area

WORK_KINDS = ("track", "round")
# In hundredths of the larger side of a map: distances between two, how far beyond a track its number stands.
_LABELS, _ARROWS, _BESIDE, _HEAD = 2.3, 4.0, 1.2, 1.1
_HALF_TOLD = 5.0  # what is told of missed ground reaches so far to either side
_NUMBERS = 2.4  # between the number of a leg and another, or its arrow
_FROM_LABELS, _FROM_CELLS = 2.8, 6.5  # between an arrow and the number of a track or round, or the name of a cell
_ALONG = (0.5, 0.42, 0.58, 0.34, 0.66, 0.26, 0.74, 0.18, 0.82)  # shares of a stretch where its arrow may stand
_ROUND_AT, _ROUND_STEP, _ROUND_PLACES = 0.25, 0.07, 4  # likewise of the longest edge of a round: its number
_ROUND_EDGES = 8  # of a round, that are tried
# A letter and a line of the smallest text, and what stays free round it, in hundredths of the larger side of a map.
_LETTER, _TALL, _ROUND_IT, _LARGE = 0.95, 1.5, 0.3, 1.35  # names of cells are larger
_LINE, _MARK = 2.5, 1.3  # by what a text gives way to the mark of a start or an entrance, and how far these reach


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
    """Names of tracks beyond both their ends, as many as have room beside each other and the names of cells."""
    names = drive.track_names or tuple(str(index + 1) for index in range(len(drive.tracks)))
    places = numbered(drive.tracks, _BESIDE * size / 100, _LABELS * size / 100)
    return _clear([[Label(names[index], place)] for index, place in places], _larger_boxes(drive, size), size)


def round_labels(drive: Drive, size: float) -> list[Label]:
    """R1, R2, ... on the longest edges of every round, as many as have room beside each other and other names."""
    starts = [Label(str(number), xy[0]) for number, xy in enumerate(drive.xy, start=1)]
    boxes = [*_larger_boxes(drive, size), *(_box(start, size, _LARGE) for start in starts)]
    boxes += [_box(label, size) for label in track_labels(drive, size)]
    return _clear([_round_places(one) for one in drive.rounds], boxes, size)


def _larger_boxes(drive: Drive, size: float) -> list[Points]:
    """Where names of cells and of ground that is left stand."""
    return [_box(label, size, _LARGE) for label in (*cell_labels(drive), *_ground_labels(drive))]


def _round_places(one: RoundLine) -> list[Label]:
    """Where the number of a round may stand: on its longest edge beside those of other rounds, else farther along."""
    edges = np.diff(one.points, axis=0)
    longest = np.argsort(-np.hypot(*edges.T), kind="stable")[:_ROUND_EDGES]
    first = _ROUND_AT + _ROUND_STEP * ((one.number - 1) % _ROUND_PLACES)
    shares = (first, *(share for share in _ALONG if share != first))
    return [Label(f"R{one.number}", one.points[edge] + share * edges[edge]) for edge in longest for share in shares]


def _clear(wanted: Sequence[Sequence[Label]], boxes: Sequence[Points], size: float) -> list[Label]:
    """Of every label the first place where its text overprints none before it; those without one are left out."""
    taken = np.array(boxes).reshape(-1, 2, 2)
    told = []
    for places in wanted:
        for label in places:
            own = _box(label, size)
            if not ((own[0] < taken[:, 1]) & (taken[:, 0] < own[1])).all(axis=1).any():
                taken = np.concatenate([taken, own[None]])
                told.append(label)
                break
    return told


def _box(label: Label, size: float, scale: float = 1.0) -> Points:
    """The ground that a text covers, its lower left and upper right corner (2, 2)."""
    half = 0.5 * scale * size / 100 * np.array([_LETTER * len(label.text) + _ROUND_IT, _TALL + _ROUND_IT])
    return np.array([label.place - half, label.place + half])


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
    places = (np.array([x, piece.y_m + lines * _LINE * box.size / 100]) for lines in (0, 1, -1))
    labels = [Label(f"{area(piece.m2)} left", place) for place in places]
    return next((one for one in labels if _off_marks(drive, one, box.size)), labels[0])


def _off_marks(drive: Drive, label: Label, size: float) -> bool:
    """Whether a large text keeps clear of the marks of the entrance and of where tractors start."""
    marks = np.array([*([drive.entrance] if drive.entrance else []), *(xy[0] for xy in drive.xy)]).reshape(-1, 2)
    low, high = _box(label, size, _LARGE) + np.array([[-1.0], [1.0]]) * _MARK * size / 100
    return not ((low < marks) & (marks < high)).all(axis=1).any()


def cut_off_labels(drive: Drive) -> list[Label]:
    """What the pieces of ground measure that obstacles cut off, but for the smallest."""
    return [
        Label(f"{area(one.m2)} cut off", np.array([one.x_m, one.y_m]))
        for one in drive.cut_off
        if one.m2 >= LEAST_ON_MAP_M2
    ]


def work_marks(drive: Drive, size: float) -> list[list[WorkMark]]:
    """Per tractor arrows on its worked stretches with their numbers in its list of legs, as many as have room.

    Where the middle of a stretch has none, another place along it is tried.
    """
    taken, told = np.empty((0, 2)), np.empty((0, 2))
    named = [
        (np.array([label.place for label in labels]).reshape(-1, 2), apart)
        for labels, apart in (
            ([*track_labels(drive, size), *round_labels(drive, size)], _FROM_LABELS),
            ([*cell_labels(drive), *_ground_labels(drive)], _FROM_CELLS),
        )
    ]  # fmt: skip
    marks: list[list[WorkMark]] = [[] for _ in drive.xy]
    for tractor, own in enumerate(marks):
        for text, line in _worked(drive, tractor):
            for head in _heads(line, _HEAD * size / 100):
                back = 0.5 * (head[1] + head[2])
                place = back + 1.1 * (back - head[0])
                clear = (_apart(one, others, apart * size / 100) for others, apart in named for one in (head[0], place))
                beside = (
                    _apart(one, others, _NUMBERS * size / 100)
                    for one, others in ((place, told), (place, taken), (head[0], told))
                )
                if _apart(head[0], taken, _ARROWS * size / 100) and all(clear) and all(beside):
                    taken, told = np.concatenate([taken, head[:1]]), np.concatenate([told, place[None]])
                    own.append(WorkMark(head, Label(text, place) if text else None))
                    break
    return marks


def _ground_labels(drive: Drive) -> list[Label]:
    missed = missed_label(drive, extent(drive))
    return [*([missed] if missed else []), *cut_off_labels(drive)]


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
