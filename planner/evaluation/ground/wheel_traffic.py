"""Wheel traffic: finished ground that wheels went over, off the headland and in all, and crops before they were cut."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely

from fields.arrays import Floats, Integers, build_directions, find_true_spans, measure_along
from fields.geometry.arithmetic import GRID_M
from fields.geometry.overlays import Areas, clip_area, intersect, subtract, subtract_area, unite_areas
from planner.evaluation.context import PlanningContext
from planner.evaluation.ground.swept_area import SweptArea, compute_swept_between_rows
from vehicle.missions.run import SimulationRun
from vehicle.model.tractor import Tractor
from vehicle.records import REC_POSE

# Assumed for every wheel: tyres of 75 kW tractors are about 0.34 m wide in front and 0.42 m behind.
TYRE_WIDTH_M = 0.4
WHEEL_ROW_STEP = 5  # rows of the 10 Hz record between points of a wheel's path
SIMPLIFY_M = 0.0005  # tolerance of a wheel's path
LONG_SPAN_ROWS = 200  # twenty seconds of driving are evaluated together
SHORT_SPAN_ROWS = 20  # two seconds, where the ground is worked meanwhile


@dataclass(frozen=True)
class FinishedGroundTraffic:
    """Driving with the implement up over ground that is finished: the metres driven, and the ground under wheels once.

    Ground is finished once it is worked for the last time, on swaths and headland passes alike. Wheels in front of a
    lowered implement do not count, as it works their tracks. `off_headland_m2` is what lies off headland passes, which
    are meant for turning, whether or not it is worked again.
    """

    length_m: float
    area_m2: float
    off_headland_m2: float


def measure_finished_ground_traffic(
    run: SimulationRun, context: PlanningContext, swept: SweptArea
) -> FinishedGroundTraffic:
    """Driving over finished ground."""
    strips = np.arange(len(swept.ground))
    driven = _remove_worked_again(swept, *_find_marks(run, context, swept, strips, wide=False))
    tyres, strip = _find_marks(run, context, swept, strips, wide=True)
    ground = _unite_in_field(_remove_worked_again(swept, tyres, strip), context)
    pressed = _unite_in_field(tyres[~swept.on_headland_pass[strip]], context)
    headland_strips = swept.ground[swept.on_headland_pass]
    nearby = np.sort(shapely.STRtree(headland_strips).query(pressed, predicate="intersects"))
    off_headland = subtract_area(pressed, unite_areas(headland_strips[nearby]))
    return FinishedGroundTraffic(float(shapely.length(driven).sum()), float(ground.area), float(off_headland.area))


def measure_crop_traffic_m2(run: SimulationRun, context: PlanningContext, swept: SweptArea) -> float:
    """Ground (m2) that was worked, and that wheels went over with the implement up while nothing had worked it yet.

    Wheels in front of an implement that is lowered behind them do not count, as those in front of a lowered one.
    """
    spans = _find_raised_driving_spans(run, SHORT_SPAN_ROWS)
    marks, number, strip = _compute_strip_marks(run, context, swept, spans, np.arange(len(swept.ground)), wide=True)
    row, ahead_m = spans[number, 1], _measure_ways_on(run, swept, spans[number], strip)
    machine_m = context.tractor.front_axle_m + context.tractor.rear_axle_m + context.implement.hitch_m
    standing = (swept.last[strip] > row) & ((ahead_m < 0.0) | (ahead_m > machine_m))
    marks, row, strip = marks[standing], row[standing], strip[standing]
    crossed = np.asarray(intersect(marks, swept.ground[strip]), dtype=np.object_)
    mark, other = shapely.STRtree(swept.ground).query(crossed, predicate="intersects")
    is_before = swept.first[other] < row[mark]
    mark, other = mark[is_before], other[is_before]
    worked = _compute_swept_before(run, context, swept, other, row[mark])
    left = unite_areas(_subtract_pairs(crossed, mark, worked))
    return float(clip_area(left, context.layout.field.due_region).area)


def _measure_ways_on(run: SimulationRun, swept: SweptArea, spans: Integers, strip: Integers) -> Floats:
    """Metres (n,) that the tractors of spans (n, 3) drive from their ends until they work strips; -1 on other ways."""
    driven_m = np.stack([measure_along(run.get_poses(number)[:, :2]) for number in range(run.plan.tractors)])
    tractor, _, last = spans.T
    ways_m = driven_m[tractor, swept.first[strip]] - driven_m[tractor, last]
    return np.where(swept.tractor[strip] == tractor, ways_m, -1.0)


def find_driven_over_ground(
    run: SimulationRun, context: PlanningContext, swept: SweptArea
) -> tuple[shapely.Polygon, ...]:
    """Finished ground under wheels, headland passes included, as pieces that do not overlap."""
    tyres, strip = _find_marks(run, context, swept, np.arange(len(swept.ground)), wide=True)
    return tuple(shapely.get_parts(_unite_in_field(_remove_worked_again(swept, tyres, strip), context)))


def _unite_in_field(areas: Areas, context: PlanningContext) -> shapely.Geometry:
    """The union of areas, as far as they lie on ground that may be worked."""
    return clip_area(unite_areas(areas), context.layout.field.workable_region)


def _remove_worked_again(swept: SweptArea, marks: Areas, strip: Integers) -> Areas:
    """The marks on strips without what is worked again after these, by any strip."""
    mark, other = shapely.STRtree(swept.ground).query(marks, predicate="intersects")
    is_later = swept.first[other] > swept.first[strip[mark]]
    mark, other = mark[is_later], other[is_later]
    order = np.lexsort((other, mark))
    return _subtract_pairs(marks, mark[order], swept.ground[other[order]])


def _subtract_pairs(marks: Areas, mark: Integers, parts: Areas) -> Areas:
    """The marks without parts (n,), each of which is taken from the mark of a number; the numbers ascend."""
    place = np.arange(len(mark)) - np.searchsorted(mark, mark)
    remaining = marks.copy()
    for number in range(int(place.max(initial=-1)) + 1):
        pairs = place == number
        remaining[mark[pairs]] = subtract(remaining[mark[pairs]], parts[pairs])
    return remaining


def _find_marks(
    run: SimulationRun, context: PlanningContext, swept: SweptArea, strips: Integers, *, wide: bool
) -> tuple[Areas, Integers]:
    """What wheels left on every strip after it was swept, and the numbers of the strips.

    Marks are as `wide` as tyres, or lines of the middle of the rear axle. Driving is evaluated in long spans, and in
    short ones where a strip is being worked at that time.
    """
    spans = _find_raised_driving_spans(run, LONG_SPAN_ROWS)
    marks, number, strip = _compute_strip_marks(run, context, swept, spans, strips, wide=wide)
    is_changing = (swept.first[strip] < spans[number, 2]) & (swept.last[strip] > spans[number, 1])
    changing_spans = np.unique(number[is_changing])
    is_unchanging = ~np.isin(number, changing_spans)
    short_spans = _cut_spans(spans[changing_spans], SHORT_SPAN_ROWS)
    groups = [(marks[is_unchanging], spans[number[is_unchanging], 1], strip[is_unchanging])]
    if len(short_spans):
        marks, number, strip = _compute_strip_marks(run, context, swept, short_spans, strips, wide=wide)
        groups.append((marks, short_spans[number, 1], strip))
    clipped = [_clip_marks_to_finished(run, context, swept, *some) for some in groups]
    return np.concatenate([some for some, _ in clipped]), np.concatenate([some for _, some in clipped])


def _clip_marks_to_finished(
    run: SimulationRun, context: PlanningContext, swept: SweptArea, marks: Areas, row: Integers, strip: Integers
) -> tuple[Areas, Integers]:
    """Marks clipped to the parts of strips swept before a row of the record, and the numbers of the strips."""
    before = swept.first[strip] < row
    marks, row, strip = marks[before], row[before], strip[before]
    clipped = intersect(marks, _compute_swept_before(run, context, swept, strip, row))
    return np.asarray(clipped, dtype=np.object_), strip


def _compute_strip_marks(
    run: SimulationRun, context: PlanningContext, swept: SweptArea, spans: Integers, strips: Integers, *, wide: bool
) -> tuple[Areas, Integers, Integers]:
    """Marks on some strips, with the number of the span and of the strip of each."""
    lines, number = _build_wheel_lines(run, context.tractor, spans, wide=wide)
    crossing = np.unique(_match_marks_to_strips(swept.ground[strips], lines)[0])
    marks = lines[crossing]
    if wide:
        marks = shapely.buffer(marks, 0.5 * TYRE_WIDTH_M, cap_style="flat", join_style="round", quad_segs=2)
    wheel, strip = _match_marks_to_strips(swept.ground[strips], marks)
    return marks[wheel], number[crossing[wheel]], strips[strip]


def _match_marks_to_strips(strips: Areas, marks: Areas) -> tuple[Integers, Integers]:
    """Pairs of intersecting marks and strips: (mark numbers, strip numbers), in the order of the marks.

    The index holds the short marks: bounding boxes of long slanted strips would cover most of the field.
    """
    strip, number = shapely.STRtree(marks).query(strips, predicate="intersects")
    order = np.lexsort((strip, number))
    return number[order], strip[order]


def _compute_swept_before(
    run: SimulationRun, context: PlanningContext, swept: SweptArea, strip: Integers, row: Integers
) -> Areas:
    """The part of every strip swept before a row of the record."""
    parts = swept.ground[strip]
    under_way = np.flatnonzero(swept.last[strip] > row)
    swept_index = strip[under_way]
    pieces = zip(
        swept.tractor[swept_index].tolist(), swept.first[swept_index].tolist(), row[under_way].tolist(), strict=True
    )
    parts[under_way] = compute_swept_between_rows(run, context, list(pieces), swept.share[swept_index])
    return parts


def _find_raised_driving_spans(run: SimulationRun, max_rows: int) -> Integers:
    """Spans of driving with the implement raised, at most `max_rows` long: (n, 3) of tractor, first, last row."""
    spans = []
    for number in range(run.plan.tractors):
        up = ~np.array([leg.implement for leg in run.plan.missions[number].legs])[run.get_leg_numbers(number)]
        edges = find_true_spans(up)
        spans.append(np.column_stack([np.full(len(edges), number), edges[:, 0], edges[:, 1] - 1]))
    return _cut_spans(np.concatenate(spans), max_rows)


def _cut_spans(spans: Integers, max_rows: int) -> Integers:
    """Spans (n, 3) split into spans of at most `max_rows`; spans of a single row are dropped."""
    counts = -(-(spans[:, 2] - spans[:, 1]) // max_rows)
    tractor, first, last = np.repeat(spans, counts, axis=0).T
    first = first + max_rows * (np.arange(len(first)) - np.repeat(np.cumsum(counts) - counts, counts))
    return np.column_stack([tractor, first, np.minimum(first + max_rows, last)])


def _build_wheel_lines(run: SimulationRun, tractor: Tractor, spans: Integers, *, wide: bool) -> tuple[Areas, Integers]:
    """Paths of all wheels, or unless `wide` of the rear axle, that moved in a span, and the number of the span."""
    rows, owner = _list_span_rows(spans)
    # Places (4, t, 2) of the wheels at poses (t, 3) of the centre of mass.
    x, y, angle = run.record[rows, spans[owner, 0], REC_POSE].T
    cosine, sine = build_directions(angle).T
    wheels = np.stack(
        [
            np.column_stack([x + ahead * cosine - left * sine, y + ahead * sine + left * cosine])
            for ahead in (tractor.front_axle_m, -tractor.rear_axle_m)
            for left in (-0.5 * tractor.track_m, 0.5 * tractor.track_m)
        ]
    )
    wheels = wheels if wide else wheels[2:].mean(axis=0, keepdims=True)
    steps = np.hypot(*np.diff(wheels, axis=1).transpose(2, 0, 1)) * (owner[1:] == owner[:-1])
    has_moved = np.stack([np.bincount(owner[1:], each, len(spans)) for each in steps], axis=1) > GRID_M
    lines = np.empty((len(spans), len(wheels)), dtype=np.object_)
    for k, wheel in enumerate(wheels if len(spans) else ()):
        lines[:, k] = shapely.linestrings(wheel, indices=owner)
    plain = shapely.simplify(lines[has_moved], SIMPLIFY_M, preserve_topology=False)
    return np.asarray(plain, dtype=np.object_), np.nonzero(has_moved)[0]


def _list_span_rows(spans: Integers) -> tuple[Integers, Integers]:
    """Rows of spans (n, 3), every WHEEL_ROW_STEP-th and the last of each, and the number of the span of each."""
    counts = 1 - (spans[:, 1] - spans[:, 2]) // WHEEL_ROW_STEP
    owner = np.repeat(np.arange(len(spans)), counts)
    place = np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)
    return np.minimum(spans[owner, 1] + WHEEL_ROW_STEP * place, spans[owner, 2]), owner
