"""Damaged files of heights: a grid or one sentence, never another error."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from fields.errors import HeadlandError
from fields.terrain.elevation import read_elevation
from tests.examples import count_examples
from tests.fields.terrain.heights import CRS, FIELD, bowl, write_ascii_grid, write_geotiff
from tests.fields.terrain.test_points import (
    write_agopengps,
    write_csv,
    write_geojson_points,
    write_gpx,
    write_kml,
    write_shapefile_with_heights,
)


def write_asc(folder: Path) -> Path:
    return write_ascii_grid(folder / "dtm.asc", bowl)


def write_tif(folder: Path) -> Path:
    pytest.importorskip("rasterio")
    return write_geotiff(folder / "dtm.tif", bowl)


WRITERS = (
    write_asc, write_tif, write_csv, write_geojson_points, write_gpx, write_kml, write_shapefile_with_heights,
    write_agopengps,
)  # fmt: skip


def read_or_refuse(path: Path) -> None:
    try:
        grid = read_elevation(path, FIELD, None if path.suffix != ".asc" else CRS)
    except HeadlandError as refusal:
        assert len(str(refusal)) > 20 and "\n" not in str(refusal)
    else:
        assert np.isfinite(grid.heights_m).all()


@pytest.mark.parametrize("write", WRITERS)
@given(data=st.data())
@settings(max_examples=8, suppress_health_check=list(HealthCheck))
def test_damaged_files(tmp_path: Path, write: Callable[[Path], Path], data: st.DataObject) -> None:
    for old in tmp_path.iterdir():
        old.unlink()
    path = write(tmp_path)
    file = path / "Elevation.txt" if path.is_dir() else path
    content = bytearray(file.read_bytes())
    for _ in range(data.draw(st.integers(1, 6))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.sampled_from(b"\x00\xff-9e,;\n nNaA<{[\"'"))
    file.write_bytes(bytes(content[: data.draw(st.integers(0, len(content)))] if data.draw(st.booleans()) else content))
    read_or_refuse(path)


@pytest.mark.parametrize("suffix", [".asc", ".csv", ".txt", ".geojson", ".kml", ".gpx"])
@given(
    text=st.text('0123456789.,;- \n\teE+ncolsrwxyzlatitudeelevation{}[]":<>/', max_size=300)
    | st.sampled_from(
        [
            '{"type": "FeatureCollection", "features": [1, null, {"geometry": {"coordinates": [[1, "a"], [], 3]}}]}',
            "ncols 1\nnrows 1\nxllcorner 0\nyllcorner 0\ncellsize 1\n5\n",
            "ncols 1e300\nnrows nan\nxllcorner 0\nyllcorner 0\ncellsize 1\n5\n",
            "ncols 2.5\nnrows 2\nxllcorner inf\nyllcorner 0\ncellsize 1\n1 2 3 4 5\n",
            "lon,lat,elevation_m\n" + "1e308,95,1e308\n" * 20,
            "lon,lat,elevation_m\n" + "9.9,56.9,5\n" * 20,
        ]
    )
)
@settings(max_examples=count_examples(25), suppress_health_check=list(HealthCheck))
def test_any_text(tmp_path: Path, suffix: str, text: str) -> None:
    path = tmp_path / f"any{suffix}"
    path.write_text(text, encoding="utf-8")
    read_or_refuse(path)
