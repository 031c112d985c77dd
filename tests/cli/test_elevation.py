"""`headland field --elevation` says slopes; `headland field heights` makes such a file of logs."""

import json
from pathlib import Path

import numpy as np
import pytest
import shapely

from fields.documents.writer import write_field
from fields.geometry.field import Field
from tests.cli.conftest import Run
from tests.fields.terrain.heights import (
    CRS,
    ORIGIN_M,
    build_plane,
    lay_passes,
    write_ascii_grid,
    write_geotiff,
    write_points_csv,
)
from tests.works.test_heights import import_folder, write_log

pytest.importorskip("rasterio")
SURFACE = build_plane(0.03, 0.04)


@pytest.fixture
def field_file(tmp_path: Path) -> Path:
    path = tmp_path / "hill.geojson"
    write_field(Field("Hill", shapely.box(-90.0, -75.0, 90.0, 75.0), CRS, ORIGIN_M), path)
    return path


def test_slopes_and_aspect_of_a_plane(
    headland: Run, field_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_geotiff(tmp_path / "dtm.tif", SURFACE)
    monkeypatch.chdir(tmp_path)
    outcome = headland("field", field_file.name, "--elevation", "dtm.tif", "--no-headland", "--json")
    assert outcome.status == 0, outcome.err
    facts = json.loads(outcome.out)
    slopes = [facts[f"{name}_slope_pct"] for name in ("median", "p90", "steepest")]
    assert slopes == pytest.approx([5.0, 5.0, 5.0], abs=0.01)
    assert facts["aspect_deg"] == pytest.approx(180.0 + np.degrees(np.arctan2(0.03, 0.04)), abs=0.1)
    assert facts["aspect_share_pct"] == 100.0
    # Nodes are 5 m apart, so the extreme ones lie up to 5 m inside of the corners.
    assert facts["highest_m"] - facts["lowest_m"] == pytest.approx(0.03 * 180 + 0.04 * 150, abs=0.7)
    text = " ".join(headland("field", field_file.name, "--elevation", "dtm.tif", "--no-headland").out.split())
    assert "Median slope (%) 5" in text and "Aspect (degrees) 216.9" in text and "cells of 5 m" in text


def test_without_heights_nothing_is_said_of_slopes(headland: Run, field_file: Path) -> None:
    facts = json.loads(headland("field", field_file, "--no-headland", "--json").out)
    assert [key for key in facts if "slope" in key or "aspect" in key or "height" in key] == []


def test_a_field_file_names_its_heights(headland: Run, field_file: Path, tmp_path: Path) -> None:
    write_geotiff(tmp_path / "dtm.tif", SURFACE)
    content = json.loads(field_file.read_text(encoding="utf-8"))
    content["features"][0]["properties"]["elevation"] = "dtm.tif"
    field_file.write_text(json.dumps(content), encoding="utf-8")
    facts = json.loads(headland("field", field_file, "--no-headland", "--json").out)
    assert facts["median_slope_pct"] == pytest.approx(5.0, abs=0.01)


def test_what_was_filled_in_is_a_remark(headland: Run, field_file: Path, tmp_path: Path) -> None:
    points = lay_passes(8.0, 4.0)
    heights = SURFACE(*points.T)
    heights[100] += 50.0
    path = write_points_csv(tmp_path / "points.csv", points, heights)
    outcome = headland("field", field_file, "--elevation", path, "--no-headland", "--json")
    assert outcome.status == 0 and "m above those around at longitude" in " ".join(outcome.err.split())


def test_refusals_name_the_options(headland: Run, field_file: Path, tmp_path: Path) -> None:
    grid = write_ascii_grid(tmp_path / "dtm.asc", SURFACE)
    words = ("field", field_file, "--elevation", grid, "--no-headland")
    refused = headland(*words)
    assert refused.status == 2 and "name it with --elevation-crs" in refused.err and refused.out == ""
    assert headland(*words, "--elevation-crs", CRS).status == 0
    steep = headland("field", field_file, "--elevation", write_geotiff(tmp_path / "steep.tif", build_plane(0.7, 0.0)))
    assert steep.status == 2 and "gives a slope of 70 %" in steep.err


def test_heights_of_logs_become_a_raster_for_plans(headland: Run, field_file: Path, tmp_path: Path) -> None:
    points = lay_passes(8.0, 2.0)
    folder = import_folder(tmp_path / "runs", write_log(tmp_path / "a.csv", points, SURFACE(*points.T)))
    outcome = headland("field", "heights", folder, "-o", tmp_path / "heights.tif")
    assert outcome.status == 0, outcome.err
    text = " ".join(outcome.out.split())
    assert (
        outcome.sentences[-1].startswith("Wrote ")
        and outcome.sentences[-1].endswith("/heights.tif.")
        and "smoothed over" in text
        and "points scatter" in text
    )
    facts = json.loads(
        headland("field", field_file, "--elevation", tmp_path / "heights.tif", "--no-headland", "--json").out
    )
    assert facts["median_slope_pct"] == pytest.approx(5.0, abs=0.05)


def test_rasters_are_not_overwritten_unasked(headland: Run, tmp_path: Path) -> None:
    points = lay_passes(8.0, 2.0)
    folder = import_folder(tmp_path / "runs", write_log(tmp_path / "a.csv", points, SURFACE(*points.T)))
    words = ("field", "heights", folder, "-o", tmp_path / "heights.asc")
    assert headland(*words).status == 0
    assert {path.name for path in tmp_path.glob("heights.*")} == {"heights.asc", "heights.prj"}
    refused = headland(*words)
    assert refused.status == 2 and "--force" in refused.err
    assert headland(*words, "--force").status == 0
    refused = headland("field", "heights", folder, "-o", tmp_path / "heights.png")
    assert refused.status == 2 and "end it in .tif" in refused.err


def test_help_of_both_commands(headland: Run) -> None:
    shown = " ".join(headland("field", "heights", "--help").out.replace("│", " ").split())
    assert (
        "headland field heights [OPTIONS]" in shown and "Example: headland field heights runs -o heights.tif" in shown
    )
    shown = " ".join(headland("field", "--help").out.replace("│", " ").split())
    assert "--elevation-crs" in shown and "headland field heights" in shown
    refused = headland("field", "heights")
    assert refused.status == 2 and "headland field heights --help lists the options" in refused.err
