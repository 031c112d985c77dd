"""Wheel traffic: finished ground off the headland that wheels went over."""

from __future__ import annotations

import numpy as np
import shapely

from planner.evaluation.context import PlanningContext
from planner.evaluation.ground.overlays import Areas, clip_area, subtract_area, unite_areas
from planner.evaluation.ground.swept_area import Points, Rows, SweptArea, compute_swept_between_rows
from vehicle.missions.run import SimulationRun
from vehicle.model.tractor import Tractor
from vehicle.records import REC_POSE

# Assumed for every wheel: tyres of 75 kW tractors are about 0.34 m wide in front and 0.42 m behind.
TYRE_WIDTH_M = 0.4
WHEEL_ROW_STEP = 5  # rows of the 10 Hz record between points of a wheel's path
SIMPLIFY_M = 0.0005  # tolerance of a wheel's path
STILL_M = 1e-6
LONG_SPAN_ROWS = 200  # twenty seconds of driving are evaluated together
SHORT_SPAN_ROWS = 20  # two seconds, where the ground is worked meanwhile


def measure_wheel_traffic_m2(run: SimulationRun, context: PlanningContext, swept: SweptArea) -> float:
    """Ground (m2) off the headland that wheels went over after it was finished, each place once.

    Wheels in front of a lowered implement do not count, as it works their tracks. Ground of headland passes does not
    count either: it is meant for turning.
    """
    pressed = clip_area(unite_areas(_find_wheel_marks(run, context, swept)), context.layout.field.workable_region)
    headland_strips = swept.ground[swept.on_headland_pass]
    nearby = np.sort(shapely.STRtree(headland_strips).query(pressed, predicate="intersects"))
    return float(subtract_area(pressed, unite_areas(headland_strips[nearby])).area)


def _find_wheel_marks(run: SimulationRun, context: PlanningContext, swept: SweptArea) -> Areas:
    """Wheel marks on every strip off the headland after it was finished.

    Driving is evaluated in long spans, and in short ones where a strip is being worked at that time.
    """
    spans = _find_raised_driving_spans(run, LONG_SPAN_ROWS)
    tyres, number, strip = _compute_strip_marks(run, context, swept, spans)
    is_changing = (swept.first[strip] < spans[number, 2]) & (swept.last[strip] > spans[number, 1])
    changing_spans = np.unique(number[is_changing])
    is_unchanging = ~np.isin(number, changing_spans)
    short_spans = _cut_spans(spans[changing_spans], SHORT_SPAN_ROWS)
    groups = [(tyres[is_unchanging], spans[number[is_unchanging], 1], strip[is_unchanging])]
    if len(short_spans):
        tyres, number, strip = _compute_strip_marks(run, context, swept, short_spans)
        groups.append((tyres, short_spans[number, 1], strip))
    return np.concatenate([_clip_marks_to_finished(run, context, swept, *some) for some in groups])


def _clip_marks_to_finished(
    run: SimulationRun, context: PlanningContext, swept: SweptArea, tyres: Areas, row: Rows, strip: Rows
) -> Areas:
    """Tyre marks clipped to the parts of strips swept before a row of the record."""
    before = swept.first[strip] < row
    tyres, row, strip = tyres[before], row[before], strip[before]
    return np.asarray(
        shapely.intersection(tyres, _compute_swept_before(run, context, swept, strip, row)), dtype=np.object_
    )


def _compute_strip_marks(
    run: SimulationRun, context: PlanningContext, swept: SweptArea, spans: Rows
) -> tuple[Areas, Rows, Rows]:
    """Tyre marks on strips off the headland, with the number of the span and of the strip of each."""
    lines, number = _build_wheel_lines(run, context.tractor, spans)
    finished = np.flatnonzero(~swept.on_headland_pass)
    crossing = np.unique(_match_marks_to_strips(swept.ground[finished], lines)[0])
    tyres = shapely.buffer(lines[crossing], 0.5 * TYRE_WIDTH_M, cap_style="flat", join_style="round", quad_segs=2)
    wheel, strip = _match_marks_to_strips(swept.ground[finished], tyres)
    return tyres[wheel], number[crossing[wheel]], finished[strip]


def _match_marks_to_strips(strips: Areas, marks: Areas) -> tuple[Rows, Rows]:
    """Pairs of intersecting marks and strips: (mark numbers, strip numbers), in the order of the marks.

    The index holds the short marks: bounding boxes of long slanted strips would cover most of the field.
    """
    strip, number = shapely.STRtree(marks).query(strips, predicate="intersects")
    order = np.lexsort((strip, number))
    return number[order], strip[order]


def _compute_swept_before(
    run: SimulationRun, context: PlanningContext, swept: SweptArea, strip: Rows, row: Rows
) -> Areas:
    """The part of every strip swept before a row of the record."""
    parts = swept.ground[strip]
    under_way = np.flatnonzero(swept.last[strip] > row)
    swept_index = strip[under_way]
    pieces = zip(
        swept.tractor[swept_index].tolist(), swept.first[swept_index].tolist(), row[under_way].tolist(), strict=True
    )
    parts[under_way] = compute_swept_between_rows(run, context, list(pieces))
    return parts


def _find_raised_driving_spans(run: SimulationRun, max_rows: int) -> Rows:
    """Spans of driving with the implement raised, at most `max_rows` long: (n, 3) of tractor, first, last row."""
    spans = []
    for number in range(run.plan.tractors):
        up = ~np.array([leg.implement for leg in run.plan.missions[number].legs])[run.get_leg_numbers(number)]
        edges = np.flatnonzero(np.diff(np.concatenate(([0], up.astype(np.int8), [0])))).reshape(-1, 2)
        spans.append(np.column_stack([np.full(len(edges), number), edges[:, 0], edges[:, 1] - 1]))
    return _cut_spans(np.concatenate(spans), max_rows)


def _cut_spans(spans: Rows, max_rows: int) -> Rows:
    """Spans (n, 3) split into spans of at most `max_rows`; spans of a single row are dropped."""
    counts = -(-(spans[:, 2] - spans[:, 1]) // max_rows)
    tractor, first, last = np.repeat(spans, counts, axis=0).T
    first = first + max_rows * (np.arange(len(first)) - np.repeat(np.cumsum(counts) - counts, counts))
    return np.column_stack([tractor, first, np.minimum(first + max_rows, last)])


def _build_wheel_lines(run: SimulationRun, tractor: Tractor, spans: Rows) -> tuple[Areas, Rows]:
    """Paths of all wheels that moved in a span, and the number of the span."""
    rows, owner = _list_span_rows(spans)
    wheels = _locate_wheels(run.record[rows, spans[owner, 0], REC_POSE], tractor)
    steps = np.hypot(*np.diff(wheels, axis=1).transpose(2, 0, 1)) * (owner[1:] == owner[:-1])
    has_moved = np.stack([np.bincount(owner[1:], each, len(spans)) for each in steps], axis=1) > STILL_M
    lines = np.empty((len(spans), len(wheels)), dtype=np.object_)
    for k, wheel in enumerate(wheels if len(spans) else ()):
        lines[:, k] = shapely.linestrings(wheel, indices=owner)
    plain = shapely.simplify(lines[has_moved], SIMPLIFY_M, preserve_topology=False)
    return np.asarray(plain, dtype=np.object_), np.nonzero(has_moved)[0]


def _list_span_rows(spans: Rows) -> tuple[Rows, Rows]:
    """Rows of spans (n, 3), every WHEEL_ROW_STEP-th and the last of each, and the number of the span of each."""
    counts = 1 - (spans[:, 1] - spans[:, 2]) // WHEEL_ROW_STEP
    owner = np.repeat(np.arange(len(spans)), counts)
    place = np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)
    return np.minimum(spans[owner, 1] + WHEEL_ROW_STEP * place, spans[owner, 2]), owner


def _locate_wheels(poses: Points, tractor: Tractor) -> Points:
    """Places (4, t, 2) of the wheels at poses (t, 3) of the centre of mass."""
    x, y, angle = poses.T
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.stack(
        [
            np.column_stack([x + ahead * cosine - left * sine, y + ahead * sine + left * cosine])
            for ahead in (tractor.front_axle_m, -tractor.rear_axle_m)
            for left in (-0.5 * tractor.track_m, 0.5 * tractor.track_m)
        ]
    )
