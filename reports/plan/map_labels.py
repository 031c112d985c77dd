"""Places of labels and arrows on a map: of tracks, headland passes and cells, and of worked legs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from string import ascii_lowercase

import numpy as np

from fields.arrays import Floats, measure_along
from reports.common.plan_records import HeadlandPassLine, PlanDrive
from reports.common.wording import format_area
from reports.plan.drive_geometry import (
    WORKING,
    MapExtent,
    build_arrow_head,
    compute_extent,
    place_swath_numbers,
    split_by_status,
)

WORKED_LEG_KINDS = ("track", "round")
LEAST_ON_MAP_M2 = 10.0  # a smaller piece would be hidden by the words
# In hundredths of the larger side of a map: the smallest text, as large as arrow heads and marks of starts, and what
# follows from it: a letter, a line, their margin, and the distance of two numbers. Names of cells are larger.
_TEXT_PCT, _LARGE_TEXT_SCALE = 1.2, 1.35
_LETTER_WIDTH_PCT, _LINE_HEIGHT_PCT, _TEXT_MARGIN_PCT = 0.8 * _TEXT_PCT, 1.25 * _TEXT_PCT, 0.25 * _TEXT_PCT
_NUMBER_DISTANCE_PCT = 2.0 * _TEXT_PCT
# Between two arrows, and between an arrow and the number of a track or pass, or the name of a cell.
_ARROW_DISTANCE_PCT, _LABEL_CLEARANCE_PCT, _CELL_CLEARANCE_PCT = 4.0, 2.8, 6.5
_ARROW_SHARES = (0.5, 0.42, 0.58, 0.34, 0.66, 0.26, 0.74, 0.18, 0.82)  # shares of a leg where its arrow may be
_PASS_SHARES = np.linspace(0.1, 0.9, 21)  # of the longest edges of a headland pass, where its number may be
_PASS_EDGES = 8  # that are tried


@dataclass(frozen=True, eq=False)
class MapLabel:
    """A text and the place (2,) it is centred on, metres."""

    text: str
    place: Floats


LegMark = tuple[Floats, MapLabel]
"""The head (3, 2) of an arrow on a worked leg, tip first, and behind it the number of the leg, "" without one."""


def name_swaths(drive: PlanDrive) -> tuple[str, ...]:
    """The names of the tracks, by default their places from 1."""
    return drive.swath_names or tuple(str(index + 1) for index in range(len(drive.swaths)))


def count_tracks(drive: PlanDrive) -> int:
    """The number of tracks, each of one piece or several (5a, 5b)."""
    return len({name.rstrip(ascii_lowercase) for name in name_swaths(drive)})


def place_swath_labels(drive: PlanDrive, size: float) -> list[MapLabel]:
    """Names of tracks beyond both ends, where they overlap neither each other nor names of cells and headland sides."""
    boxes = [_compute_label_box(label, size) for label in place_headland_pass_labels(drive, size)]
    boxes += _list_large_label_boxes(drive, size)
    return _choose_free_places([[label] for label in _list_swath_labels(drive, size)], boxes, size)


def _list_swath_labels(drive: PlanDrive, size: float) -> list[MapLabel]:
    names = name_swaths(drive)
    places = place_swath_numbers(drive.swaths, _TEXT_PCT * size / 100, _NUMBER_DISTANCE_PCT * size / 100)
    return [MapLabel(names[index], place) for index, place in places]


def place_headland_pass_labels(drive: PlanDrive, size: float) -> list[MapLabel]:
    """R1.1, R1.2, ... on the longest edges of every side of a headland pass, where they overlap no other label.

    Names of tracks only where there is no other place.
    """
    starts = [MapLabel(str(number), xy[0]) for number, xy in enumerate(drive.xy, start=1)]
    boxes = [
        *_list_large_label_boxes(drive, size),
        *(_compute_label_box(start, size, _LARGE_TEXT_SCALE) for start in starts),
    ]
    tracks = np.array([_compute_label_box(label, size) for label in _list_swath_labels(drive, size)]).reshape(-1, 2, 2)
    candidates = [
        sorted(_list_pass_label_places(one), key=lambda label: _is_taken(_compute_label_box(label, size), tracks))
        for one in drive.headland_sides
    ]
    return _choose_free_places(candidates, boxes, size)


def _list_large_label_boxes(drive: PlanDrive, size: float) -> list[Floats]:
    """Boxes of the names of cells and of unworked ground."""
    return [
        _compute_label_box(label, size, _LARGE_TEXT_SCALE)
        for label in (*place_cell_labels(drive), *place_ground_labels(drive, compute_extent(drive)))
    ]


def _list_pass_label_places(headland_pass: HeadlandPassLine) -> list[MapLabel]:
    """Possible places of the name of a side: its longest edges, at a share that differs between passes first."""
    edges = np.diff(headland_pass.points, axis=0)
    longest = np.argsort(-np.hypot(*edges.T), kind="stable")[:_PASS_EDGES]
    return [
        MapLabel(headland_pass.name, headland_pass.points[edge] + share * edges[edge])
        for edge in longest
        for share in np.roll(_PASS_SHARES, -2 * headland_pass.number)
    ]


def _choose_free_places(
    candidates: Sequence[Sequence[MapLabel]], boxes: Sequence[Floats], size: float
) -> list[MapLabel]:
    """For every label the first place that overlaps no box and no earlier label; labels without one are dropped."""
    occupied = np.array(boxes).reshape(-1, 2, 2)
    chosen = []
    for places in candidates:
        for label in places:
            label_box = _compute_label_box(label, size)
            if not _is_taken(label_box, occupied):
                occupied = np.concatenate([occupied, label_box[None]])
                chosen.append(label)
                break
    return chosen


def _is_taken(label_box: Floats, occupied: Floats) -> bool:
    """Whether a box (2, 2) overlaps one of others (n, 2, 2)."""
    return bool(((label_box[0] < occupied[:, 1]) & (occupied[:, 0] < label_box[1])).all(axis=1).any())


def _compute_label_box(label: MapLabel, size: float, scale: float = 1.0) -> Floats:
    """Lower left and upper right corner (2, 2) of a text, metres."""
    sides_pct = np.array([_LETTER_WIDTH_PCT * len(label.text), _LINE_HEIGHT_PCT]) + _TEXT_MARGIN_PCT
    half = 0.5 * scale * size / 100 * sides_pct
    return np.array([label.place - half, label.place + half])


def place_cell_labels(drive: PlanDrive) -> list[MapLabel]:
    """Number and bearing of every cell."""
    return [
        MapLabel(f"cell {cell.number}: {cell.bearing_deg:.0f}\N{DEGREE SIGN}", np.array([cell.x_m, cell.y_m]))
        for cell in drive.cells
    ]


def place_unworked_label(drive: PlanDrive, box: MapExtent) -> MapLabel | None:
    """The area of the largest unworked piece, and of all, placed on it and within the map; None if it is too small."""
    piece = drive.largest_missed
    if piece is None or piece.m2 < LEAST_ON_MAP_M2:
        return None
    area, whole = format_area(piece.m2), format_area(max(drive.missed_m2, piece.m2))
    text = f"{area} missed" if area == whole else f"{area} missed here, {whole} in all"
    _, (reach, _) = _compute_label_box(MapLabel(text, np.zeros(2)), box.size, _LARGE_TEXT_SCALE).tolist()
    half = min(reach, 0.5 * box.width)
    x = min(max(piece.x_m, box.west + half), box.east - half)
    shift_m = (_TEXT_PCT + 0.5 * _LARGE_TEXT_SCALE * (_LINE_HEIGHT_PCT + _TEXT_MARGIN_PCT)) * box.size / 100
    places = (np.array([x, piece.y_m + lines * shift_m]) for lines in (0, 1, -1))
    labels = [MapLabel(text, place) for place in places]
    return next((one for one in labels if _is_clear_of_marks(drive, one, box.size)), labels[0])


def _is_clear_of_marks(drive: PlanDrive, label: MapLabel, size: float) -> bool:
    """Whether a large text covers neither the mark of the entrance nor a start of a tractor."""
    marks = np.array([*([drive.entrance] if drive.entrance else []), *(xy[0] for xy in drive.xy)]).reshape(-1, 2)
    low, high = _compute_label_box(label, size, _LARGE_TEXT_SCALE) + np.array([[-1.0], [1.0]]) * _TEXT_PCT * size / 100
    return not ((low < marks) & (marks < high)).all(axis=1).any()


def place_cut_off_labels(drive: PlanDrive) -> list[MapLabel]:
    """The areas of the pieces of ground that obstacles cut off, without the smallest."""
    return [
        MapLabel(f"{format_area(one.m2)} cut off", np.array([one.x_m, one.y_m]))
        for one in drive.cut_off
        if one.m2 >= LEAST_ON_MAP_M2
    ]


def place_leg_marks(drive: PlanDrive, size: float) -> list[list[LegMark]]:
    """Per tractor arrows on its worked legs with their numbers, as many as have room.

    Where the middle of a leg has no room, other places along it are tried.
    """
    arrow_places, number_places = np.empty((0, 2)), np.empty((0, 2))
    label_places = [
        (np.array([label.place for label in labels]).reshape(-1, 2), apart)
        for labels, apart in (
            ([*place_swath_labels(drive, size), *place_headland_pass_labels(drive, size)], _LABEL_CLEARANCE_PCT),
            ([*place_cell_labels(drive), *place_ground_labels(drive, compute_extent(drive))], _CELL_CLEARANCE_PCT),
        )
    ]  # fmt: skip
    marks: list[list[LegMark]] = [[] for _ in drive.xy]
    for tractor, tractor_marks in enumerate(marks):
        for text, line in _iterate_worked_legs(drive, tractor):
            for head in _iterate_arrow_heads(line, _TEXT_PCT * size / 100):
                back = 0.5 * (head[1] + head[2])
                place = back + 1.1 * (back - head[0])
                clear = (
                    _is_apart(one, others, apart * size / 100)
                    for others, apart in label_places
                    for one in (head[0], place)
                )
                beside = (
                    _is_apart(one, others, _NUMBER_DISTANCE_PCT * size / 100)
                    for one, others in ((place, number_places), (place, arrow_places), (head[0], number_places))
                )
                if _is_apart(head[0], arrow_places, _ARROW_DISTANCE_PCT * size / 100) and all(clear) and all(beside):
                    arrow_places = np.concatenate([arrow_places, head[:1]])
                    number_places = np.concatenate([number_places, place[None]])
                    tractor_marks.append((head, MapLabel(text, place)))
                    break
    return marks


def place_ground_labels(drive: PlanDrive, box: MapExtent) -> list[MapLabel]:
    """The area of the largest unworked piece, and of pieces that are cut off."""
    missed = place_unworked_label(drive, box)
    return [*([missed] if missed else []), *place_cut_off_labels(drive)]


def _is_apart(place: Floats, other_places: Floats, apart_m: float) -> bool:
    return float(((other_places - place) ** 2).sum(axis=1).min(initial=np.inf)) >= apart_m**2


def _iterate_worked_legs(drive: PlanDrive, tractor: int) -> Iterator[tuple[str, Floats]]:
    """Number in the list of legs ("" without a list) and path (n, 2) of every worked leg."""
    xy, status = drive.xy[tractor], drive.status[tractor]
    if not drive.steps:
        yield from (("", points) for part_status, points in split_by_status(xy, status) if part_status == WORKING)
        return
    for number, step in enumerate(drive.steps[tractor], start=1):
        if step.kind in WORKED_LEG_KINDS:
            first, last = (round(at / drive.step_s) for at in (step.from_s, step.from_s + step.seconds))
            yield str(number), xy[first : last + 1]


def _iterate_arrow_heads(line: Floats, length_m: float) -> Iterator[Floats]:
    """Heads of arrows at several places along a path, the middle first; none on a path shorter than two heads."""
    along = measure_along(line)
    if along[-1] < 2.0 * length_m:
        return
    for share in _ARROW_SHARES:
        reach = min(share, 1.0 - share) * along[-1]
        inside = (along >= share * along[-1] - reach) & (along <= share * along[-1] + reach)
        head = build_arrow_head(line[inside], length_m) if inside.sum() > 1 else None
        if head is not None:
            yield head
