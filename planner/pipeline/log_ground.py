"""The ground under measured logs, from a file of heights or from heights that the logs have themselves.

What a diagnosis uses of it is the fall under every row (vehicle.identification.logs.terrain).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import shapely

from fields.arrays import Flags, Floats, Integers
from fields.geometry.field import Field
from fields.geometry.geodesy import is_wgs84_longitude_latitude
from fields.geometry.overlays import unite
from fields.terrain.checks import check_height_range
from fields.terrain.elevation import read_elevation
from fields.terrain.elevation_grid import ElevationError, ElevationGrid
from fields.terrain.point_files import read_height_points
from fields.terrain.point_grids import choose_length_m, find_spikes, fit_surface, level_tracks
from fields.terrain.rasters import is_raster_file, open_raster
from fields.terrain.slopes import interpolate_gradients
from fields.text_files import lower_first, quote_path
from planner.errors import RequestError, attach_parameter, mark_parameter
from planner.evaluation.field_physics import compute_tyre_drift
from planner.task_logs.runs.worked_ground import MARGIN_M, REACH_M
from vehicle.identification.diagnosis.results import Diagnosis
from vehicle.identification.logs.schema import Log
from vehicle.identification.logs.terrain import get_ground_source
from vehicle.model.effect_kinds import PER_SLOPE
from vehicle.model.effects import BY_ROLL, SLOPE_DRIFT
from vehicle.model.terrain import Terrain

PASS_M = 3.0
"""Ground so near to a track counts as driven; and so near to it is where its own heights have to hold."""
SIMPLIFIED_M = 0.5
"""Of tracks, before they are widened to ground: coarser than their noise and far finer than any surface."""
MAX_FINELY_LEVELLED = 40
"""Logs that are levelled by their surface, which is fitted once for each; more are levelled where they cross only."""
HALF_BLOCK_S = 10.0
"""Heights of alternate pieces of this length make two surfaces, whose difference is their noise."""
MAX_NOISE_SHARE = 0.1  # of the variance of the slope: a fitted drift is then at most so much too small
MIN_MEASURED_SHARE = 0.9  # of the rows: on the others the slope across is not known from heights of single passes
OWN_SOURCE = "The heights of the logs (elevation_m)"


@dataclass(frozen=True)
class HeightFile:
    """A file of heights for logs.

    `elevation_crs` is its coordinate system where it does not name one; `crs` is that of `easting_m` and `northing_m`,
    which is the one of the file where it is left out.
    """

    path: str | Path
    elevation_crs: str | None = None
    crs: str | None = None


def add_known_ground(logs: Sequence[Log], heights: HeightFile | str | Path | None = None) -> list[Log]:
    """Logs with the fall of the ground under their rows; unchanged where no heights are known.

    Heights of a file take the place of roll and pitch. Those of the logs are used where a log lacks one of them.

    Raises:
        HeadlandError: the file cannot be read, lies elsewhere, or needs a coordinate system that is not given.
    """
    if heights is not None:
        return _add_surveyed_ground(logs, heights if isinstance(heights, HeightFile) else HeightFile(heights))
    has_sensors = all(log.roll_deg is not None and log.pitch_deg is not None for log in logs)
    with_heights = sum(log.elevation_m is not None for log in logs)
    if has_sensors or not with_heights:
        return list(logs)
    if with_heights < len(logs):
        return _add_remark(logs, f"{OWN_SOURCE} are not used: {with_heights} of {len(logs)} logs have them.")
    try:
        grid = _fit_own_heights(logs)
    except ElevationError as error:
        return _add_remark(logs, f"{OWN_SOURCE} are not used: {lower_first(str(error))}")
    return _add_remark(_add_falls(logs, grid, (0.0, 0.0), OWN_SOURCE), f"{OWN_SOURCE} are {grid.source}.")


def describe_known_ground(diagnosis: Diagnosis, logs: Sequence[Log]) -> Diagnosis:
    """The diagnosis in words of heights where they gave the slope across, with what tyres leave of the drift."""
    if not get_ground_source(logs, "roll_deg"):
        return diagnosis
    findings = tuple(
        replace(finding, description=finding.description.replace(BY_ROLL, "as the heights have the slope"))
        for finding in diagnosis.findings
    )
    notes = list(diagnosis.notes)
    drifts = [(each.value or {}).get(PER_SLOPE) for each in findings if each.id == SLOPE_DRIFT]
    if drifts and drifts[0] is not None:
        drift = drifts[0]
        of_tyres = min(compute_tyre_drift(diagnosis.ground), drift)
        notes.append(
            f"Of the drift of {10.0 * drift:.1f} cm per metre across a slope of 10 % the tyres of the simulation give "
            f"{10.0 * of_tyres:.1f} cm where a plan has heights; {10.0 * (drift - of_tyres):.1f} cm are left to the "
            "effect."
        )
    return replace(diagnosis, findings=findings, notes=tuple(notes))


def _add_surveyed_ground(logs: Sequence[Log], heights: HeightFile) -> list[Log]:
    crs, remark = _find_crs(logs, heights)
    field = _build_driven_field(logs, crs)
    grid = read_elevation(heights.path, field, heights.elevation_crs)
    remarks = [*([remark] if remark else []), *grid.remarks]
    sensors = [name for name in ("roll_deg", "pitch_deg") if any(getattr(log, name) is not None for log in logs)]
    source = f"The heights of {Path(heights.path).name}"
    if sensors:
        remarks.append(f"{source} are used instead of {' and '.join(sensors)}.")
    bare = [replace(log, roll_deg=None, pitch_deg=None) for log in logs]
    return _add_remark(_add_falls(bare, grid, field.origin_m, source), *remarks)


def _add_falls(logs: Sequence[Log], grid: ElevationGrid, origin_m: tuple[float, float], source: str) -> list[Log]:
    """The logs with the fall of a grid, whose metres begin at `origin_m` of theirs; 0 in rows that are not used."""
    out = []
    for log in logs:
        fall = np.zeros((len(log.used), 2))
        fall[log.used] = -interpolate_gradients(grid, _list_places(log, log.used) - np.asarray(origin_m))
        out.append(replace(log, ground_fall=fall, ground_source=source))
    return out


def _add_remark(logs: Sequence[Log], *remarks: str) -> list[Log]:
    first, *others = logs
    return [replace(first, set_remarks=(*first.set_remarks, *remarks)), *others]


def _list_places(log: Log, rows: Flags) -> Floats:
    return np.column_stack([log.easting_m[rows], log.northing_m[rows]])


def _find_crs(logs: Sequence[Log], heights: HeightFile) -> tuple[str | None, str]:
    """The coordinate system of the positions, None for metres that the heights share; and a remark where it is a guess.

    Raises:
        RequestError: the heights are in degrees, and nobody says where the metres of the logs begin.
    """
    origins = {log.origin_deg for log in logs}
    if origins != {None}:
        if heights.crs is not None:
            raise RequestError(
                f"The positions of the logs are in degrees, so they need no {mark_parameter('crs')}; leave it out.",
                parameter="crs",
            )
        if len(origins) > 1:
            raise RequestError("Logs with different origins cannot share a file of heights; read them together.")
        (origin,) = origins
        assert origin is not None
        metres = f"+proj=tmerc +lat_0={origin[1]!r} +lon_0={origin[0]!r} +k=1 +x_0=0 +y_0=0"
        return f"{metres} +ellps=WGS84 +units=m +type=crs", ""
    if heights.crs is not None:
        with attach_parameter("crs"):
            if is_wgs84_longitude_latitude(heights.crs):
                raise RequestError(
                    f"{mark_parameter('crs')} {heights.crs} is in degrees, and easting_m and northing_m are in metres; "
                    f"name their system, such as EPSG:32632, or give {mark_parameter('fixes')} position-degrees."
                )
        return heights.crs, ""
    path, stated = str(heights.path), heights.elevation_crs
    if not stated:
        with attach_parameter("elevation"):
            stated = open_raster(path).crs if is_raster_file(path) else read_height_points(path).crs
    if stated is None:
        return None, ""
    with attach_parameter("elevation_crs"):
        is_in_degrees = is_wgs84_longitude_latitude(stated)
    if is_in_degrees:
        raise RequestError(
            f"The heights of {quote_path(path)} are in degrees, and easting_m and northing_m of the logs "
            f"do not say their coordinate system; name it with {mark_parameter('crs')}, such as EPSG:32632."
        )
    return stated, (
        f"Easting_m and northing_m are taken to be in the coordinate system of {Path(heights.path).name}, "
        f"{stated if len(stated) < 20 else 'which has no EPSG code'}."
    )


def _build_driven_field(logs: Sequence[Log], crs: str | None) -> Field:
    """The ground round all tracks as a field; between drives far apart as well."""
    ground = _widen_tracks(logs, REACH_M)
    outline = shapely.Polygon(ground.exterior) if isinstance(ground, shapely.Polygon) else ground.convex_hull
    west, south, _, _ = (float(value) for value in outline.bounds)
    origin = (float(np.floor(west)), float(np.floor(south)))
    moved = shapely.transform(outline, lambda places: places - origin)
    return Field("logs", moved, crs=crs, origin_m=origin)


def _widen_tracks(logs: Sequence[Log], reach_m: float) -> shapely.Geometry:
    lines = shapely.simplify([shapely.LineString(_list_places(log, log.used)) for log in logs], SIMPLIFIED_M)
    return unite(shapely.buffer(lines, reach_m, quad_segs=4))


def _fit_own_heights(logs: Sequence[Log]) -> ElevationGrid:
    """The surface through the heights of all logs, levelled to each other.

    Raises:
        ElevationError: they are no heights of ground, too sparse, or noisier than the slopes.
    """
    tracks, halves = [], []
    for log in logs:
        assert log.elevation_m is not None
        rows = log.used & np.isfinite(log.elevation_m)
        tracks.append(np.column_stack([_list_places(log, rows), log.elevation_m[rows]]))
        halves.append(np.floor(log.time_s[rows] / HALF_BLOCK_S).astype(np.int64) % 2)
    table, owners = np.concatenate(tracks), np.repeat(np.arange(len(tracks)), [len(track) for track in tracks])
    half = np.concatenate(halves)
    check_height_range(table[:, 2], "the logs")
    region = _widen_tracks(logs, PASS_M)
    length_m = choose_length_m(table[:, :2], region, "the logs")
    table[:, 2] -= level_tracks(tracks)[owners]
    if 1 < len(tracks) <= MAX_FINELY_LEVELLED:
        table[:, 2] -= _estimate_offsets(table, owners, region, length_m)[owners]
    is_spike, _ = find_spikes(table[:, :2], table[:, 2], length_m)
    grids = [
        _fit_grid(table[rows], region, length_m)
        for rows in (~is_spike, ~is_spike & (half == 0), ~is_spike & (half == 1))
    ]
    _check_own_surface(grids, np.concatenate([_list_places(log, log.used) for log in logs]))
    return grids[0]


def _estimate_offsets(table: Floats, owners: Integers, region: shapely.Geometry, length_m: float) -> Floats:
    """How much the heights of each log lie above those of the others, mean 0: what lets a smooth surface fit them best.

    Heights and offsets are both taken off their smooth surfaces, and the former regressed on the latter (Speckman
    1988).
    """
    columns = [table[:, 2], *((owners == number).astype(np.float64) for number in range(int(owners.max()) + 1))]
    left = []
    for values in columns:
        grid = _fit_grid(np.column_stack([table[:, :2], values]), region, length_m)
        surface = Terrain(grid.west_m, grid.south_m, grid.spacing_m, grid.heights_m)
        left.append(values - surface.compute_heights(table[:, :2]))
    return np.asarray(np.linalg.lstsq(np.column_stack(left[1:]), left[0], rcond=1e-6)[0])


def _fit_grid(table: Floats, region: shapely.Geometry, length_m: float) -> ElevationGrid:
    grid, scatter_m = fit_surface(table[:, :2], table[:, 2], region, length_m, MARGIN_M)
    source = f"smoothed over {length_m:.3g} m; they scatter {100.0 * scatter_m:.2g} cm about that surface"
    return replace(grid, source=source)


def _check_own_surface(grids: Sequence[ElevationGrid], places: Floats) -> None:
    """Refuse a surface (the first) that single passes leave open across, or whose slope differs between its halves."""
    is_measured = np.stack([_find_measured(grid, places) for grid in grids])
    share = float(is_measured[0].mean())
    if share < MIN_MEASURED_SHARE:
        raise ElevationError(
            f"only {100.0 * share:.0f} % of the rows lie among several passes, and a single pass says no slope across."
        )
    shared = places[is_measured.all(axis=0)]
    whole, first, second = (interpolate_gradients(grid, shared) for grid in grids)
    if not len(shared) or float(np.mean((first - second) ** 2)) > 4.0 * MAX_NOISE_SHARE * float(np.mean(whole**2)):
        raise ElevationError("they show no slope above their noise.")


def _find_measured(grid: ElevationGrid, places: Floats) -> Flags:
    """Whether the node nearest to each place has a height of its own."""
    assert grid.is_measured is not None
    rows, columns = grid.heights_m.shape
    row = np.clip(np.round((places[:, 1] - grid.south_m) / grid.spacing_m), 0, rows - 1).astype(np.int64)
    column = np.clip(np.round((places[:, 0] - grid.west_m) / grid.spacing_m), 0, columns - 1).astype(np.int64)
    out: Flags = grid.is_measured[row, column]
    return out
