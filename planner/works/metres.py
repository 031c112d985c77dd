"""A run in metres: position, course over ground and speed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import shapely

from fields.projection import project, utm_crs
from planner.works.record import Array, Driven, Logged

WGS84 = "EPSG:4326"
STEP_M = 0.3  # a course is told from positions this far apart: receivers scatter by a tenth of that
FASTEST_MPS = 20.0
STANDING_MPS = 0.15  # half a km/h, as terminals log it, and slower is standing


def driven(run: Logged, crs: str | None = None) -> Driven:
    """The run in metres of `crs`, by default of the UTM zone that it begins in; raises FieldError."""
    place = run.outline[0][0] if run.outline else run.lonlat[0]
    crs = crs or utm_crs(float(place[0]), float(place[1]))
    xy = project(run.lonlat, WGS84, crs)
    by_place = speeds(run.time_s, xy)
    speed = by_place if run.speed_mps is None else _filled(run.speed_mps, by_place)
    notes = list(run.notes)
    if run.speed_mps is None:
        notes.append("no speed is logged; it is from the positions")
    works = np.zeros(len(xy), dtype=np.bool_) if run.works is None else run.works
    if run.works is None:
        notes.append("nothing says when the implement worked")
    return Driven(
        run.name, run.form, crs, run.time_s, xy, course_deg(xy), np.clip(speed, 0.0, FASTEST_MPS), works,
        run.works is not None, run.speed_mps is not None, run.width_m, run.start, run.field, run.counters,
        _outline(run, crs), run.outline_m2, tuple(notes),
    )  # fmt: skip


def speeds(time_s: Array, xy: Array) -> Array:
    """Speed in m/s from times (n,) and places (n, 2): of the steps before and after a row, by their time."""
    steps = np.hypot(*np.diff(xy, axis=0).T)
    lasts = np.diff(time_s)
    length = np.concatenate([steps[:1], steps[:-1] + steps[1:], steps[-1:]])
    return np.asarray(length / np.concatenate([lasts[:1], lasts[:-1] + lasts[1:], lasts[-1:]]))


def course_deg(xy: Array) -> Array:
    """Course over ground (n,), degrees clockwise from north of the grid; while standing that of before.

    Driven backwards a tractor's heading is the other way: positions cannot tell.
    """
    marks = [0]
    for row in range(1, len(xy)):
        if np.hypot(*(xy[row] - xy[marks[-1]])) >= STEP_M:
            marks.append(row)
    if len(marks) < 2:
        return np.zeros(len(xy))
    east, north = np.diff(xy[marks], axis=0).T
    each = np.degrees(np.arctan2(east, north)) % 360.0
    place = np.searchsorted(marks, np.arange(len(xy)), side="right") - 1
    return np.asarray(each[np.minimum(place, len(each) - 1)])


def _filled(values: Array, other: Array) -> Array:
    """Values, those of another array where there are none."""
    return np.where(np.isfinite(values), values, other)


def _outline(run: Logged, crs: str) -> shapely.Polygon | None:
    if not run.outline:
        return None
    rings = [project(ring, WGS84, crs) for ring in run.outline]
    shape = shapely.make_valid(shapely.Polygon(rings[0], rings[1:]))
    parts = [one for one in shapely.get_parts(shape) if one.geom_type == "Polygon"]
    return max(parts, key=lambda one: one.area) if parts else None


def stretched(run: Driven, factor: float) -> Driven:
    """The run with east-west about the middle of its field stretched, as positions moved for anonymity need."""
    if run.outline is None:
        return run
    middle = np.array(run.outline.centroid.coords[0])
    scale = np.array([factor, 1.0])

    def moved(points: Array) -> Array:
        return np.asarray(middle + (points - middle) * scale)

    return replace(run, xy=moved(run.xy), outline=shapely.transform(run.outline, moved))
