"""Records of one run of work: as its file has it, in degrees, and in metres with course and speed."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, replace

import numpy as np
import shapely

from fields.arrays import Flags, Floats, Integers
from fields.geometry.coordinates import MAX_NEAR_DEG
from fields.geometry.geodesy import DEGREES_CRS, find_utm_crs, project
from fields.geometry.outline_cleaning import find_largest_polygon
from vehicle.identification.logs.gating import FASTEST_MPS

ACTIVE_M, INACTIVE_M, ACTIVE_S, INACTIVE_S = "active_m", "inactive_m", "active_s", "inactive_s"
AREA_M2, FUEL_L = "area_m2", "fuel_l"
COUNTERS = (ACTIVE_M, INACTIVE_M, ACTIVE_S, INACTIVE_S, AREA_M2, FUEL_L)
"""Totals that machines count, by their keys in the files of runs."""
COURSE_STEP_M = 0.3  # distance of positions for a course: ten times the scatter of receivers
STANDING_MPS = 0.15  # about half a km/h; slower is standing


@dataclass(frozen=True, eq=False, kw_only=True)
class RunRecord:
    """What is known of one run wherever it lies.

    Attributes:
        name: of the log in its file, such as TLG00001.
        log_format: name of the format.
        time_s: (n,) from the first row, increasing.
        width_m: working width, None if unknown.
        start: time of the first row, such as "2020-01-02T17:30:20", "" if unknown.
        field: name of the field, "" if unknown.
        counters: totals counted by the machine over the run, by names of COUNTERS.
        outline_m2: area of the field as stated in the file.
        notes: parts of sentences on skipped or interpreted data.
        elevation_m: (n,) heights of the antenna, NaN where they are missing; None if not logged.
    """

    name: str
    log_format: str
    time_s: Floats
    width_m: float | None = None
    start: str = ""
    field: str = ""
    counters: dict[str, float] = dataclasses.field(default_factory=dict)
    outline_m2: float | None = None
    notes: tuple[str, ...] = ()
    elevation_m: Floats | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class LoggedRun(RunRecord):
    """One run as in its file, in longitude and latitude.

    Attributes:
        lonlat: (n, 2) degrees.
        speed_mps: (n,), None if not logged.
        is_working: (n,) whether the implement worked, None if not logged.
        outline: rings of the field in degrees, the outer one first; empty if unknown.
    """

    lonlat: Floats
    speed_mps: Floats | None = None
    is_working: Flags | None = None
    outline: tuple[Floats, ...] = ()

    def select_rows(self, rows: Integers) -> LoggedRun:
        """The run with these rows, in this order."""
        columns = {name: getattr(self, name) for name in ("lonlat", "time_s", "speed_mps", "is_working", "elevation_m")}
        return replace(self, **{name: column[rows] for name, column in columns.items() if column is not None})


@dataclass(frozen=True, eq=False, kw_only=True)
class ProjectedRun(RunRecord):
    """One run in metres of `crs`.

    Attributes:
        xy: (n, 2) metres.
        heading_deg: (n,) course over ground, clockwise from north.
        speed_mps, is_working: (n,).
        has_work_state: whether the work state was logged; if not, `is_working` is False throughout.
        has_logged_speed: whether the speed was logged; if not, it is from the positions.
        outline: the field, None if unknown.
    """

    crs: str
    xy: Floats
    heading_deg: Floats
    speed_mps: Floats
    is_working: Flags
    has_work_state: bool = True
    has_logged_speed: bool = True
    outline: shapely.Polygon | None = None


@dataclass(frozen=True)
class LogContents:
    """Runs of a file, and sentences on what could not be read."""

    runs: tuple[LoggedRun, ...]
    notes: tuple[str, ...] = ()


def project_run(run: LoggedRun) -> ProjectedRun:
    """The run in metres of the UTM zone of its field, without an outline that lies elsewhere; raises FieldError."""
    # An outline farther off has its axes swapped, or is lost.
    is_near = bool(run.outline) and bool((np.abs(run.outline[0] - run.lonlat[0]) < MAX_NEAR_DEG).all())
    place = run.outline[0][0] if is_near else run.lonlat[0]
    crs = find_utm_crs(float(place[0]), float(place[1]))
    xy = project(run.lonlat, DEGREES_CRS, crs)
    speed_by_place = compute_speeds(run.time_s, xy)
    speed = speed_by_place
    if run.speed_mps is not None:
        speed = np.where(np.isfinite(run.speed_mps), run.speed_mps, speed_by_place)
    notes = list(run.notes)
    if run.speed_mps is None:
        notes.append("no speed is logged; it is computed from the positions")
    if run.is_working is None:
        notes.append("no work state is logged")
    outline = shapely.Polygon()
    if run.outline and not is_near:
        notes.append("the outline of its field is not used, as it lies far from the run")
    if is_near:
        outer, *holes = (project(ring, DEGREES_CRS, crs) for ring in run.outline)
        outline = find_largest_polygon(shapely.make_valid(shapely.Polygon(outer, holes)))
    shared = {one.name: getattr(run, one.name) for one in dataclasses.fields(RunRecord)}
    return ProjectedRun(
        **shared | {"notes": tuple(notes)},
        crs=crs,
        xy=xy,
        heading_deg=compute_course_deg(xy),
        speed_mps=np.minimum(np.abs(speed), FASTEST_MPS),  # some devices log it below 0 in reverse
        is_working=np.zeros(len(xy), dtype=np.bool_) if run.is_working is None else run.is_working,
        has_work_state=run.is_working is not None,
        has_logged_speed=run.speed_mps is not None,
        outline=None if outline.is_empty else outline,
    )


def compute_speeds(time_s: Floats, xy: Floats) -> Floats:
    """Speed in m/s (n,) from times (n,) and positions (n, 2): mean over the steps before and after each row."""
    steps = np.hypot(*np.diff(xy, axis=0).T)
    durations_s = np.diff(time_s)
    length = np.concatenate([steps[:1], steps[:-1] + steps[1:], steps[-1:]])
    return np.asarray(length / np.concatenate([durations_s[:1], durations_s[:-1] + durations_s[1:], durations_s[-1:]]))


def compute_course_deg(xy: Floats) -> Floats:
    """Course over ground (n,), degrees clockwise from grid north; while standing the last course.

    In reverse the heading of a tractor is opposite, which positions do not show.
    """
    marks = [0]
    for row in range(1, len(xy)):
        if np.hypot(*(xy[row] - xy[marks[-1]])) >= COURSE_STEP_M:
            marks.append(row)
    if len(marks) < 2:
        return np.zeros(len(xy))
    east, north = np.diff(xy[marks], axis=0).T
    courses_deg = np.degrees(np.arctan2(east, north)) % 360.0
    place = np.searchsorted(marks, np.arange(len(xy)), side="right") - 1
    return np.asarray(courses_deg[np.minimum(place, len(courses_deg) - 1)])


def reproject_run(run: ProjectedRun, crs: str) -> ProjectedRun:
    """The run in metres of another system; raises FieldError."""
    if run.crs == crs:
        return run
    xy, outline = project(run.xy, run.crs, crs), run.outline
    if outline is not None:
        outline = shapely.transform(outline, lambda points: project(points, run.crs, crs))
    return replace(run, crs=crs, xy=xy, heading_deg=compute_course_deg(xy), outline=outline)
