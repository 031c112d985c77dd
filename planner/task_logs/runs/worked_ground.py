"""The ground of runs: worked once, worked again and unworked in a field, and a grid of its heights.

The middle of the tool follows the logged path, `tool_offset_m` behind it, and sweeps the working width. Paths are cut
into pieces of about 40 m, so that ground on which a path crosses itself counts as worked again.

Receivers of different days differ by a constant (their reference, the height of the antenna), so runs are levelled to
each other where they cross before all points are gridded together.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import shapely

from fields.arrays import Floats, measure_along
from fields.geometry.outline_cleaning import list_polygons
from fields.geometry.overlays import clip_area, extract_polygons, intersect, subtract_area, unite, unite_areas
from fields.terrain.elevation_grid import ElevationGrid
from fields.terrain.point_grids import TRACK_CELL_M, build_point_grid, level_tracks
from fields.text_files import count_noun
from planner.task_logs.runs.run_records import STANDING_MPS, ProjectedRun, reproject_run
from reports.task_logs.run_results import GroundCoverage
from vehicle.identification.errors import LogError
from vehicle.identification.logs.series import find_spans

PIECE_LENGTH_M, SIMPLIFY_M = 40.0, 0.1
MIN_DRAWN_WIDTH_M = 0.4  # narrower pieces are within the error of logged positions
MAX_PIECES = 200
MIN_REPORTED_OFFSET_M = 0.05
REACH_M = 12.0
"""Ground so near to the points of runs counts as driven, where the outline of the field is unknown."""
MARGIN_M = 5.0


def measure_coverage(
    runs: Sequence[ProjectedRun], field: shapely.Polygon, width_m: float, tool_offset_m: float
) -> GroundCoverage:
    """The ground of a field that the runs worked with a tool of `width_m`, in metres of their system."""
    strips = [clip_area(field, strip) for run in runs for strip in iter_worked_strips(run, width_m, tool_offset_m)]
    worked = unite_areas(np.array(strips, dtype=np.object_)) if strips else shapely.MultiPolygon()
    unworked = subtract_area(field, worked)
    total = float(sum(strip.area for strip in strips))
    return GroundCoverage(
        float(worked.area),
        max(0.0, total - float(worked.area)),
        float(unworked.area),
        _extract_rings(_drop_slivers(unworked)),
        _extract_rings(_drop_slivers(_find_overlap(strips))),
    )


def iter_worked_strips(run: ProjectedRun, width_m: float, tool_offset_m: float) -> Iterator[shapely.Geometry]:
    """The ground that a run worked with a tool of `width_m`, piece by piece, in metres of its system."""
    for line in trace_tool_lines(run, tool_offset_m):
        length = measure_along(line)
        cuts = np.searchsorted(length, np.arange(PIECE_LENGTH_M, length[-1] - 0.5 * PIECE_LENGTH_M, PIECE_LENGTH_M))
        for first, last in zip([0, *cuts.tolist()], [*cuts.tolist(), len(line) - 1], strict=True):
            if last > first:
                piece = shapely.LineString(line[first : last + 1]).simplify(SIMPLIFY_M)
                if piece.length > 0.0:
                    yield piece.buffer(0.5 * width_m, cap_style="flat", join_style="mitre", mitre_limit=2.0)


def trace_tool_lines(run: ProjectedRun, tool_offset_m: float) -> Iterator[Floats]:
    """Paths (n, 2) of the tool's middle for every segment of work, without standing, which has no course."""
    angle = np.radians(run.heading_deg)
    tool = run.xy - tool_offset_m * np.column_stack([np.sin(angle), np.cos(angle)])
    for first, last in find_spans(run.is_working):
        rows = np.arange(first, min(last + 2, len(tool)))
        line = tool[rows[run.speed_mps[rows] >= STANDING_MPS]]
        if len(line) > 1 and float(np.hypot(*np.diff(line, axis=0).T).sum()) > SIMPLIFY_M:
            yield line


def _find_overlap(strips: Sequence[shapely.Geometry]) -> shapely.Geometry:
    """Ground in two or more strips; narrow overlaps of consecutive pieces of one path are dropped later."""
    shapes = np.array(strips, dtype=np.object_)
    first, second = shapely.STRtree(shapes).query(shapes, predicate="intersects")
    pairs = first < second
    shared = [extract_polygons(overlap) for overlap in intersect(shapes[first[pairs]], shapes[second[pairs]])]
    return unite_areas(np.array(shared, dtype=np.object_)) if shared else shapely.MultiPolygon()


def _drop_slivers(shape: shapely.Geometry) -> list[shapely.Polygon]:
    """Pieces without parts narrower than MIN_DRAWN_WIDTH_M, the largest first."""
    core = (
        extract_polygons(shape)
        .buffer(-0.5 * MIN_DRAWN_WIDTH_M, join_style="mitre")
        .buffer(0.5 * MIN_DRAWN_WIDTH_M, join_style="mitre")
    )
    parts = [part for part in list_polygons(core) if part.area > MIN_DRAWN_WIDTH_M**2]
    return sorted(parts, key=lambda part: (-part.area, part.bounds))[:MAX_PIECES]


def _extract_rings(pieces: Sequence[shapely.Polygon]) -> tuple[Floats, ...]:
    """The outer ring of every piece, followed by its inner rings in the opposite direction."""
    rings = []
    for piece in map(shapely.orient_polygons, pieces):
        rings += [np.array(ring.coords)[:, :2] for ring in (piece.exterior, *piece.interiors)]
    return tuple(rings)


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
    total = len(runs)
    remarks = []
    if total > len(with_heights):
        remarks.append(f"{count_noun(total - len(with_heights), 'run')} of {total} without heights not used.")
    span_m = float(np.ptp(offsets))
    if span_m > MIN_REPORTED_OFFSET_M:
        highest = with_heights[int(np.argmax(offsets))].name
        remarks.append(
            f"Heights of runs differ by up to {span_m:.2f} m where they cross ('{highest}' is the highest), as "
            "receivers and antennas do; they were levelled to each other."
        )
    table = np.concatenate([track - (0.0, 0.0, offset) for track, offset in zip(tracks, offsets, strict=True)])
    places, heights_m = table[:, :2], table[:, 2]
    label = count_noun(len(with_heights), "run")
    region = _find_region(with_heights, crs, places)

    def name_place(x_m: float, y_m: float) -> str:
        return f"easting {x_m:.0f} m, northing {y_m:.0f} m"

    grid = build_point_grid(places, heights_m, region, MARGIN_M, label, name_place)
    return replace(grid, remarks=(*remarks, *grid.remarks)), crs


def _list_points(run: ProjectedRun) -> Floats:
    """Places and heights (n, 3) of a run, of working rows where the work state is known."""
    heights_m = np.empty(0) if run.elevation_m is None else run.elevation_m
    rows = np.isfinite(heights_m)
    if run.has_work_state and (rows & run.is_working).any():
        rows &= run.is_working
    return np.column_stack([run.xy[rows], heights_m[rows]])


def _find_region(runs: Sequence[ProjectedRun], crs: str, places: Floats) -> shapely.Geometry:
    """The fields of the runs, or the ground near their points."""
    outlines = [reproject_run(run, crs).outline for run in runs]
    known = [outline for outline in outlines if outline is not None]
    if len(known) == len(runs):
        return unite(known)
    cells = np.unique(np.floor(places / TRACK_CELL_M), axis=0)
    return unite(shapely.buffer(shapely.points((cells + 0.5) * TRACK_CELL_M), REACH_M))
