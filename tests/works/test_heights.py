"""Heights in logs: imported, levelled between runs, written as a raster and read again for a field."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fields.errors import HeadlandError
from fields.geometry.field import Field
from fields.terrain.elevation import read_elevation
from fields.terrain.point_grids import level_tracks
from fields.terrain.rasters import list_raster_files, render_raster
from planner.task_logs.log_import import import_runs
from planner.task_logs.runs.run_files import load_imported_runs
from planner.task_logs.runs.worked_ground import build_run_heights
from tests.fields.terrain.heights import CRS, FIELD, ORIGIN_M, build_plane, hills, lay_passes, project

SURFACE = build_plane(0.05, -0.02)
Array = np.ndarray[Any, np.dtype[np.float64]]


def write_log(path: Path, points: Array, heights: Array, header: str = "elevation_m") -> Path:
    """A CSV log that a receiver would write along the points at 1 m/s, passes one after the other."""
    degrees = project(points + ORIGIN_M, CRS, "EPSG:4326")
    times = np.concatenate([[0.0], np.cumsum(np.maximum(np.hypot(*np.diff(points, axis=0).T), 1.0) / 2.0)])
    rows = [
        f"{time:.2f},{lon:.9f},{lat:.9f},{'' if np.isnan(z) else f'{z:.3f}'}"
        for time, (lon, lat), z in zip(times, degrees, heights, strict=True)
    ]
    path.write_text(f"time_s,longitude,latitude,{header}\n" + "\n".join(rows) + "\n", encoding="utf-8")
    return path


def import_folder(folder: Path, *logs: Path) -> Path:
    """The runs of logs in a folder, as `headland logs import` writes them."""
    folder.mkdir()
    for name, text in import_runs([str(log) for log in logs]).files.items():
        (folder / name).write_text(text, encoding="utf-8")
    return folder


def drive_across() -> Array:
    """Points of a run from west to east over all passes."""
    y = np.repeat(np.arange(-70.0, 71.0, 20.0), 100)
    return np.column_stack([np.tile(np.linspace(-95.0, 95.0, 100), 8), y])


def test_runs_keep_their_heights_and_empty_cells(tmp_path: Path) -> None:
    points = lay_passes(10.0, 2.0)
    heights = SURFACE(*points.T)
    heights[5:9] = np.nan
    (run,) = load_imported_runs([import_folder(tmp_path / "runs", write_log(tmp_path / "a.csv", points, heights))])
    assert run.elevation_m is not None
    assert run.elevation_m == pytest.approx(heights, abs=2e-3, nan_ok=True)
    in_feet = write_log(tmp_path / "feet.csv", points, heights / 0.3048, "altitude_ft")
    (run,) = load_imported_runs([import_folder(tmp_path / "feet", in_feet)])
    assert run.elevation_m == pytest.approx(heights, abs=2e-3, nan_ok=True)


def test_runs_that_cross_are_levelled(tmp_path: Path) -> None:
    along, across = lay_passes(10.0, 2.0), drive_across()
    logs = (
        write_log(tmp_path / "along.csv", along, hills(*along.T)),
        write_log(tmp_path / "across.csv", across, hills(*across.T) + 38.0),
    )
    grid, crs = build_run_heights(load_imported_runs([import_folder(tmp_path / "runs", *logs)]))
    assert crs == CRS
    assert any("differ by up to 38.0" in one and "'across' is the highest" in one for one in grid.remarks)
    x, y = np.meshgrid(grid.xs_m - ORIGIN_M[0], grid.ys_m - ORIGIN_M[1])
    inside = (np.abs(x) < 90.0) & (np.abs(y) < 75.0)
    errors = (grid.heights_m - hills(x, y))[inside]
    assert errors.mean() == pytest.approx(19.0, abs=0.02) and errors.std() < 0.02  # halfway between the two


@pytest.mark.parametrize("name", ["heights.tif", "heights.asc"])
def test_a_written_raster_gives_the_field_its_heights(tmp_path: Path, name: str) -> None:
    points = lay_passes(6.0, 2.0)
    log = write_log(tmp_path / "a.csv", points, SURFACE(*points.T))
    grid, crs = build_run_heights(load_imported_runs([import_folder(tmp_path / "runs", log)]))
    for path, content in zip(
        list_raster_files(tmp_path / name), render_raster(grid, crs, tmp_path / name), strict=True
    ):
        path.write_bytes(content)
    field = Field("Hill", FIELD.boundary.buffer(-6.0), CRS, ORIGIN_M)
    read = read_elevation(tmp_path / name, field)
    inside = read.is_measured
    assert inside is not None
    x, y = np.meshgrid(read.xs_m, read.ys_m)
    assert np.abs(read.heights_m - SURFACE(x, y))[inside].max() < 5e-3
    assert [remark for remark in read.remarks if "no heights" in remark] == []


def test_tracks_that_do_not_meet_are_left_as_they_are() -> None:
    far = np.column_stack([np.linspace(0, 100, 50), np.zeros(50), np.full(50, 9.0)])
    assert level_tracks([far, far + np.array([0.0, 900.0, 5.0])]) == pytest.approx([0.0, 0.0])
    assert level_tracks([far, far + np.array([0.0, 0.0, 5.0])]) == pytest.approx([-2.5, 2.5], abs=1e-4)


def test_runs_of_distant_fields_are_refused(tmp_path: Path) -> None:
    points = lay_passes(10.0, 2.0)
    logs = [
        write_log(tmp_path / f"{east}.csv", points + np.array([east, east]), SURFACE(*points.T)) for east in (0, 9_000)
    ]
    with pytest.raises(HeadlandError, match=r"reach over 9\.\d+ by 9\.\d+ km, .* those of one field"):
        build_run_heights(load_imported_runs([import_folder(tmp_path / "runs", *logs)]))


def test_runs_without_heights_are_refused(tmp_path: Path) -> None:
    points = lay_passes(10.0, 2.0)
    folder = import_folder(tmp_path / "runs", write_log(tmp_path / "a.csv", points, points[:, 0], "speed"))
    with pytest.raises(HeadlandError, match=r"None of 1 run has heights \(elevation_m\); import logs that have them"):
        build_run_heights(load_imported_runs([folder]))
    with pytest.raises(HeadlandError, match=r"is no name of a raster; end it in \.tif"):
        list_raster_files(tmp_path / "heights.png")
