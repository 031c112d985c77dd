"""A grid of heights from the positions of imported runs.

Receivers of different days differ by a constant (their reference, the height of the antenna), so runs are levelled to
each other where they cross before all points are gridded together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import shapely

from fields.terrain.elevation_grid import ElevationGrid
from fields.terrain.point_grids import TRACK_CELL_M, build_point_grid, level_tracks
from fields.text_files import count_noun
from planner.task_logs.runs.run_records import Array, ProjectedRun, reproject_run
from vehicle.identification.errors import LogError

MIN_REPORTED_OFFSET_M = 0.05
REACH_M = 12.0
"""Ground so near to the points of runs counts as driven, where the outline of the field is unknown."""
MARGIN_M = 5.0


def build_run_heights(runs: Sequence[ProjectedRun]) -> tuple[ElevationGrid, str]:
    """Heights of the ground of runs in metres of a coordinate system, and that system (that of the first run).

    Antennas are taken as if they were on the ground: only differences of height matter to slopes.

    Raises:
        LogError: no run has heights.
        ElevationError: the heights are not of any farmland, too sparse or full of spikes.
    """
    with_heights = [run for run in runs if run.elevation_m is not None and np.isfinite(run.elevation_m).any()]
    if not with_heights:
        raise LogError(
            f"None of {count_noun(len(runs), 'run')} has heights (elevation_m); import logs that have them: headland "
            "logs import."
        )
    crs = with_heights[0].crs
    tracks = [_list_points(reproject_run(run, crs)) for run in with_heights]
    offsets = level_tracks(tracks)
    remarks = _describe_offsets(with_heights, offsets, len(runs))
    table = np.concatenate([track - (0.0, 0.0, offset) for track, offset in zip(tracks, offsets, strict=True)])
    places, heights_m = table[:, :2], table[:, 2]
    label = count_noun(len(with_heights), "run")
    region = _find_region(with_heights, crs, places)

    def name_place(x_m: float, y_m: float) -> str:
        return f"easting {x_m:.0f} m, northing {y_m:.0f} m"

    grid = build_point_grid(places, heights_m, region, MARGIN_M, label, name_place)
    return replace(grid, remarks=(*remarks, *grid.remarks)), crs


def _list_points(run: ProjectedRun) -> Array:
    """Places and heights (n, 3) of a run, of working rows where the work state is known."""
    heights_m = np.empty(0) if run.elevation_m is None else run.elevation_m
    rows = np.isfinite(heights_m)
    if run.has_work_state and (rows & run.is_working).any():
        rows &= run.is_working
    return np.column_stack([run.xy[rows], heights_m[rows]])


def _describe_offsets(runs: Sequence[ProjectedRun], offsets: Array, total: int) -> list[str]:
    remarks = []
    if total > len(runs):
        remarks.append(f"{count_noun(total - len(runs), 'run')} of {total} without heights not used.")
    span_m = float(np.ptp(offsets))
    if span_m > MIN_REPORTED_OFFSET_M:
        highest = runs[int(np.argmax(offsets))].name
        remarks.append(
            f"Heights of runs differ by up to {span_m:.2f} m where they cross ('{highest}' is the highest), as "
            "receivers and antennas do; they were levelled to each other."
        )
    return remarks


def _find_region(runs: Sequence[ProjectedRun], crs: str, places: Array) -> shapely.Geometry:
    """The fields of the runs, or the ground near their points."""
    outlines = [reproject_run(run, crs).outline for run in runs]
    known = [outline for outline in outlines if outline is not None]
    if len(known) == len(runs):
        return shapely.union_all(known)
    cells = np.unique(np.floor(places / TRACK_CELL_M), axis=0)
    return shapely.union_all(shapely.buffer(shapely.points((cells + 0.5) * TRACK_CELL_M), REACH_M))
