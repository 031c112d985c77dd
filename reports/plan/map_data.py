"""Map data: for a page's template and script (centimetres, y down), for small maps, and of a ranking as JSON.

Paths of pages are thinned in place and time together, so that a few knots both draw and animate them.
"""

from __future__ import annotations

import base64
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from heapq import heapify, heappop, heappush
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
import shapely

from fields.arrays import Floats, Integers
from reports.common import palette
from reports.common.drawing_sizes import EDGE_SHARE, HATCH_SHARE
from reports.common.plan_records import PlanDrive, Relief
from reports.common.plan_results import PlanRanking
from reports.common.rendering import METRE_DECIMALS
from reports.common.wording import format_duration
from reports.plan.drive_geometry import (
    FOLDING_STATUS,
    REVERSING,
    SERVICE_STATUS,
    STATUS_BY_STATE,
    WORKING,
    MapExtent,
    Viewport,
    bound_points,
    build_hatching,
    build_swath_outline,
    choose_round_length_m,
    compute_extent,
    find_stops,
    list_states,
    list_status_runs,
    split_by_status,
)
from reports.plan.leg_list import describe_leg, format_leg_heading, format_leg_metres
from reports.plan.map_labels import (
    LegMark,
    MapLabel,
    name_swaths,
    place_cell_labels,
    place_cut_off_labels,
    place_headland_pass_labels,
    place_leg_marks,
    place_swath_labels,
    place_unworked_label,
)

PATH_TOLERANCE_M = 0.1
# Knots of all paths of a page, at some 14 bytes each: with the best plan drawn twice, below two megabytes.
MOST_FIRST_KNOTS = 30_000  # of the plan shown first
MOST_OTHER_KNOTS = 60_000  # of all other plans together
MOST_LISTED_LEGS = 15_000  # of all plans together, at some 45 bytes each; further plans have no leg lists

MOST_MAP_KNOTS = 6000  # of all tractors of one plan together
CONTOUR_TOLERANCE_M = 0.2  # of contours on small maps
SIDE, FOOT = 1000.0, 70.0  # of small maps: the larger side of the field, and the room below for the scale bar
MARGIN = EDGE_SHARE * SIDE
PATH_TOLERANCE_SHARE = 0.002  # of the larger side
SmallMap = dict[str, Any]
"""Plain values that can be kept as JSON; `reports/small_map.html.j2` draws them."""


@dataclass(frozen=True, eq=False)
class TimedPath:
    """The thinned path of a tractor: samples of knots (k,), positions (k, 2) in metres, statuses between (k - 1,)."""

    samples: Integers
    xy: Floats
    status: Integers


def thin_paths(drive: PlanDrive, most_knots: int) -> Sequence[TimedPath]:
    """The paths of a drive with few knots, at every sample within `PATH_TOLERANCE_M` of the true place.

    Distances are between places at the same time (synchronous Euclidean distance: Meratnia and de By 2004,
    Spatiotemporal compression techniques for moving point objects), so changes of speed keep a knot as bends do. The
    worst sample gets the next knot, so that paths become coarser evenly where `most_knots` for all tractors together
    are not enough. The step between two samples has the status of the later one; every change of status is a knot,
    even beyond `most_knots`.
    """
    knots = [set(_find_status_changes(status)) for status in drive.status]
    heap = [
        worst
        for number, status in enumerate(drive.status)
        for first, last in pairwise(_find_status_changes(status))
        if (worst := _find_worst_sample(drive, number, first, last))
    ]
    heapify(heap)
    room = most_knots - sum(map(len, knots))
    while heap and room > 0:
        _, number, first, middle, last = heappop(heap)
        knots[number].add(middle)
        room -= 1
        for start, end in ((first, middle), (middle, last)):
            if worst := _find_worst_sample(drive, number, start, end):
                heappush(heap, worst)
    samples = [np.array(sorted(one), dtype=np.int64) for one in knots]
    return [
        TimedPath(sample, xy[sample], status[sample[1:]])
        for sample, xy, status in zip(samples, drive.xy, drive.status, strict=True)
    ]


def _find_status_changes(status: Integers) -> list[int]:
    """First sample, changes of status and last sample."""
    return sorted({0, *(np.flatnonzero(np.diff(status[1:])) + 1).tolist(), len(status) - 1})


def _find_worst_sample(drive: PlanDrive, number: int, first: int, last: int) -> tuple[float, int, int, int, int] | None:
    """The sample farthest off the line between two others, as an entry of a heap that gives the farthest first."""
    if last - first < 2:
        return None
    xy = drive.xy[number]
    share = (np.arange(first + 1, last) - first)[:, None] / (last - first)
    off = xy[first] + (xy[last] - xy[first]) * share - xy[first + 1 : last]
    square = off[:, 0] ** 2 + off[:, 1] ** 2
    worst_index = int(np.argmax(square))
    if square[worst_index] <= PATH_TOLERANCE_M**2:
        return None
    return -float(square[worst_index]), number, first, first + 1 + worst_index, last


def build_page_map(drives: Mapping[str, PlanDrive]) -> dict[str, Any]:
    """Field, labels and scale bar, and for each drive, by its name, the data of the script; the first drive is drawn.

    All drives are of one field. Sizes are in centimetres on the ground.
    """
    first = next(iter(drives.values()))
    box = bound_points([compute_extent(drive).corners for drive in drives.values()])
    size = box.size or 1.0
    margin = EDGE_SHARE * size
    frame = Viewport(box.west - margin, box.north + margin)
    bar = choose_round_length_m(max(box.width, 0.5 * size) / 4)
    height = box.height + 2 * margin
    share = MOST_OTHER_KNOTS // max(len(drives) - 1, 1)
    thinned = [thin_paths(drive, share if place else MOST_FIRST_KNOTS) for place, drive in enumerate(drives.values())]
    legs = np.cumsum([sum(map(len, drive.steps)) for drive in drives.values()])
    listed_count = max(1, int(np.searchsorted(legs, MOST_LISTED_LEGS, side="right")))  # plans with room for their legs
    states = list_states(drives.values())
    plans = [
        {"name": name} | _build_plan_drawing(drive, paths, frame, box, number < listed_count, states)
        for number, ((name, drive), paths) in enumerate(zip(drives.items(), thinned, strict=True))
    ]
    driven = {int(value) for drive in drives.values() for status in drive.status for value in np.unique(status)}
    return {
        "width": round((box.width + 2 * margin) * 100),
        "height": round((height + 0.06 * size) * 100),
        "unit": max(round(size), 1),
        **_draw_ground(first, frame),
        "cells": frame.format_rings(ring for cell in first.cells for ring in cell.rings),
        "done": frame.format_rings(first.done),
        "fences": "".join(frame.format_path(line) for line in first.fences),
        "labels": _place_labels(place_swath_labels(first, size), frame),
        "headland_pass_labels": _place_labels(place_headland_pass_labels(first, size), frame),
        "cell_labels": _place_labels(place_cell_labels(first), frame),
        "cut_off_labels": _place_labels(place_cut_off_labels(first), frame),
        "lanes": [_draw_lane(number, path, frame) for number, path in enumerate(thinned[0])],
        "entrance": None if first.entrance is None else frame.convert_points(np.array([first.entrance]))[0],
        "bar": {"x": round(margin * 100), "y": round((height + 0.02 * size) * 100), "length": round(bar * 100)},
        "bar_text": f"{bar:g} m",
        "plans": plans,
        "reversing": REVERSING in driven,
        "waiting": STATUS_BY_STATE["waiting"] in driven,
        "refilling": SERVICE_STATUS in driven,
        "folding": FOLDING_STATUS in driven,
        "missed": any(drive.unworked for drive in drives.values()),
        "relief": None if first.relief is None else _draw_relief(first.relief, frame),
    }


def _draw_ground(drive: PlanDrive, view: Viewport) -> dict[str, Any]:
    """What every map shows of a field: its outline, obstacles, the strips of its tracks, and its headland passes."""
    return {
        "field": view.format_rings((drive.boundary, *drive.holes)),
        "obstacles": view.format_rings(drive.obstacles),
        "swaths": view.format_rings(build_swath_outline(track, drive.width_m) for track in drive.swaths),
        "headland_passes": [
            {"line": view.format_path(one.points), "tint": one.number % 2} for one in drive.headland_passes
        ],
        "pass_width": round(drive.width_m * view.scale),
    }


def _draw_lane(number: int, path: TimedPath, frame: Viewport) -> dict[str, Any]:
    """What the tractor of a number, from 0, drives: its lines at work, in turns and backwards, and where it starts."""
    lines = {"work": "", "turn": "", "back": ""}
    for status, begin, end in list_status_runs(path.status):
        lines[{WORKING: "work", REVERSING: "back"}.get(status, "turn")] += frame.format_path(path.xy[begin : end + 1])
    start = frame.convert_points(path.xy[:1])[0]
    return {"number": number + 1, "colour": number % len(palette.TRACTOR_COLOURS), "start": start, **lines}


def _draw_relief(relief: Relief, viewport: Viewport) -> dict[str, Any]:
    """The shading as a grey PNG, north up, with its place on the map, and contours."""
    from PIL import Image

    grey = np.rint(255.0 * np.clip(relief.shade[::-1], 0.0, 1.0)).astype(np.uint8)
    buffer = io.BytesIO()
    Image.fromarray(grey).save(buffer, format="PNG", optimize=True)
    west, south, east, north = relief.bounds_m
    (left, top), (right, bottom) = viewport.convert_points(np.array([(west, north), (east, south)]))
    return {
        "picture": f"data:image/png;base64,{base64.b64encode(buffer.getvalue()).decode('ascii')}",
        "opacity": palette.SHADE_OPACITY,
        "x": left, "y": top, "width": right - left, "height": bottom - top,
        "contours": "".join(viewport.format_path(points) for _, points in relief.contours),
        "words": relief.label,
    }  # fmt: skip


def _place_labels(labels: Sequence[MapLabel], viewport: Viewport) -> list[dict[str, Any]]:
    """Labels with their places on the map."""
    places = viewport.convert_points(np.array([label.place for label in labels]).reshape(-1, 2))
    return [{"x": x, "y": y, "text": label.text} for (x, y), label in zip(places, labels, strict=True)]


def _build_plan_drawing(
    drive: PlanDrive,
    paths: Sequence[TimedPath],
    viewport: Viewport,
    box: MapExtent,
    lists_legs: bool,
    states: Sequence[str],
) -> dict[str, Any]:
    """The data of one plan for the script: arrows, stops and legs per tractor, seconds by state, unworked ground."""
    longest = max(len(xy) for xy in drive.xy) - 1
    size = box.size or 1.0
    marks, label = place_leg_marks(drive, size), place_unworked_label(drive, box)
    lines = build_hatching(drive.unworked, HATCH_SHARE * size)
    return {
        "title": drive.title,
        "step": drive.step_s,
        "end": round(longest * drive.step_s, 3),
        "lanes": [
            _build_lane(drive, number, path, marks[number], viewport, lists_legs) for number, path in enumerate(paths)
        ],
        "seconds": [[round(value, 1) for value in seconds] for seconds in _tabulate_seconds(drive, states)],
        "missed": {
            "ground": viewport.format_rings(drive.unworked),
            "hatch": "".join(map(viewport.format_path, lines)),
            "largest": label and [*viewport.convert_points(label.place[None, :])[0], label.text],
        },
    }  # fmt: skip


def _build_lane(
    drive: PlanDrive,
    number: int,
    path: TimedPath,
    marks: Sequence[LegMark],
    viewport: Viewport,
    lists_legs: bool,
) -> dict[str, Any]:
    """The drive of a tractor: arrows with numbers, stops with their time, knots, and its legs with their heading.

    A knot is sample, x and y since the knot before, the first since 0. A leg is its start and duration (s), length (m,
    "" of a wait), description and start by the clock (s).
    """
    steps = drive.steps[number] if drive.steps and lists_legs else None
    flat = np.column_stack([path.samples, np.asarray(viewport.convert_points(path.xy))])
    knots = np.diff(flat, axis=0, prepend=np.zeros((1, 3), dtype=int))
    waits, refills, folds = (
        [
            [*viewport.convert_points(np.array([(x, y)]))[0], format_duration(seconds)]
            for x, y, seconds in find_stops(drive.xy[number], drive.status[number], drive.step_s, status)
        ]
        for status in (STATUS_BY_STATE["waiting"], SERVICE_STATUS, FOLDING_STATUS)
    )
    return {
        "knots": [int(value) for value in knots.ravel()],
        "status": "".join(map(str, path.status.tolist())),
        "arrows": viewport.format_rings(head for head, _ in marks),
        "numbers": [[*one.values()] for one in _place_labels([label for _, label in marks if label.text], viewport)],
        "waits": waits,
        "refills": refills,
        "folds": folds,
        "legs": [
            [round(one.from_s, 1), round(one.seconds, 1), format_leg_metres(one), describe_leg(one),
             round(one.clock_s, 1)]
            for one in steps or ()
        ],
        "heading": "" if steps is None else format_leg_heading(number + 1, steps),
    }  # fmt: skip


def _tabulate_seconds(drive: PlanDrive, states: Sequence[str]) -> list[list[float]]:
    """Seconds of every tractor in some states; 0 where the drive does not have a state."""
    nothing = (0.0,) * len(drive.xy)
    return [list(values) for values in zip(*(drive.seconds.get(state, nothing) for state in states), strict=True)]


def build_time_bars(drive: PlanDrive, states: Sequence[str] = tuple(STATUS_BY_STATE)) -> list[dict[str, Any]]:
    """Per tractor its total time and, per state, the time and the share of the longest bar in percent."""
    rows = _tabulate_seconds(drive, states)
    longest = max(map(sum, rows)) or 1.0
    return [
        {
            "number": number,
            "total": format_duration(sum(row)),
            "parts": [
                {"state": state, "text": format_duration(value), "share": round(value / longest * 100, 3)}
                for state, value in zip(states, row, strict=True)
            ],
        }
        for number, row in enumerate(rows, start=1)
    ]


def format_maps_json(
    ranking: PlanRanking, drive: PlanDrive | None, drives: Mapping[tuple[str, int], PlanDrive] | None = None
) -> str:
    """The maps of the plans of a ranking as JSON text with a trailing newline.

    `drive` is that of the best plan; `drives` are others by strategy and number of tractors. Keys: ``field``
    (name), ``begin`` (time of day of the field work, or null) and ``plans``, each with ``strategy``, ``tractors``,
    ``title``, ``end_s``, ``width_m``, its ground in metres of the field (``boundary_m``, ``holes_m``, ``obstacles_m``,
    ``fences_m``, ``entrance_m``, ``missed_m``), the ``crs`` and ``origin_m`` of these metres, ``swaths`` and
    sides of ``headland_passes`` (each a name and its ``points_m``), and ``lanes``: per tractor ``time_s`` and
    ``points_m`` of its knots, the ``status`` between two of them (1 working, 2 turning, 3 waiting, 4 reversing,
    5 refilling, 6 folding), and ``steps`` in words. Where heights are known, ``relief`` holds lines of equal height
    (``contours_m``) and the height between two of them (``interval_m``).
    """
    best = ranking.best
    shown = {(best.strategy, best.tractors): drive} if best and drive else {}
    shown = {**shown, **{key: plan_drive for key, plan_drive in (drives or {}).items() if key not in shown}}
    start = ranking.field_start or ranking.start
    plans = [_build_map_plan(strategy, count, plan_drive) for (strategy, count), plan_drive in shown.items()]
    relief = next((plan_drive.relief for plan_drive in shown.values() if plan_drive.relief is not None), None)
    ground = {}
    if relief is not None:
        lines = [shapely.LineString(points).simplify(CONTOUR_TOLERANCE_M) for _, points in relief.contours]
        contours = [_round_coordinates(shapely.get_coordinates(line)) for line in lines]
        ground = {"relief": {"interval_m": relief.interval_m, "contours_m": contours}}
    return json.dumps({"field": ranking.field_name, "begin": start, "plans": plans, **ground}, allow_nan=False) + "\n"


def _build_map_plan(strategy: str, tractors: int, drive: PlanDrive) -> dict[str, Any]:
    steps = drive.steps or ((),) * len(drive.xy)
    return {
        "strategy": strategy,
        "tractors": tractors,
        "title": drive.title,
        "end_s": max(drive.finish_s, default=0.0),
        "width_m": drive.width_m,
        "crs": drive.crs,
        "origin_m": list(drive.origin_m),
        "boundary_m": _round_coordinates(drive.boundary),
        "holes_m": [_round_coordinates(ring) for ring in drive.holes],
        "obstacles_m": [_round_coordinates(ring) for ring in drive.obstacles],
        "fences_m": [_round_coordinates(line) for line in drive.fences],
        "entrance_m": None if drive.entrance is None else list(drive.entrance),
        "missed_m": [_round_coordinates(ring) for ring in drive.unworked],
        "swaths": [
            {"name": name, "points_m": _round_coordinates(track)}
            for name, track in zip(name_swaths(drive), drive.swaths, strict=True)
        ],
        "headland_passes": [
            {"name": each.name, "points_m": _round_coordinates(each.points)} for each in drive.headland_sides
        ],
        "lanes": [
            {
                "time_s": _round_coordinates(lane.samples * drive.step_s),
                "points_m": _round_coordinates(lane.xy),
                "status": lane.status.tolist(),
                "steps": [
                    {"from_s": step.from_s, "seconds": step.seconds, "words": describe_leg(step)} for step in legs
                ],
            }
            for lane, legs in zip(thin_paths(drive, MOST_MAP_KNOTS), steps, strict=True)
        ],
    }


def _round_coordinates(values: npt.NDArray[Any]) -> Any:
    return np.round(values, METRE_DECIMALS).tolist()


def build_small_map(drive: PlanDrive, driven_over: Sequence[Floats] = ()) -> SmallMap:
    """The field with headland passes, the path of every tractor, missed ground, and rings of ground `driven_over`."""
    box = compute_extent(drive)
    size_m = box.size or 1.0
    scale = SIDE / size_m
    view = Viewport(box.west, box.north, scale, MARGIN)
    bar_m = choose_round_length_m(max(box.width, 0.5 * size_m) / 3)
    lanes = []
    for number, (xy, status) in enumerate(zip(drive.xy, drive.status, strict=True)):
        lines = {"work": "", "turn": ""}
        for part_status, points in split_by_status(xy, status, PATH_TOLERANCE_SHARE * size_m):
            lines["work" if part_status == WORKING else "turn"] += view.format_path(points)
        lanes.append({"colour": number % len(palette.TRACTOR_COLOURS), **lines})
    return {
        "width": round(box.width * scale + 2 * MARGIN),
        "height": round(box.height * scale + 2 * MARGIN + FOOT),
        "margin": round(MARGIN),
        **_draw_ground(drive, view),
        "missed": view.format_rings(drive.unworked),
        "driven_over": view.format_rings(driven_over),
        "lanes": lanes,
        "bar": round(bar_m * scale),
        "bar_text": f"{bar_m:g} m",
    }
