"""Field files of very many points, with more than fields in them, with names and numbers of any kind."""

import errno
import itertools
import json
import os
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from fields import list_fields, list_sample_names, read_field
from tests.drawn_fields import feature
from tests.fields.geojson import SQUARE_M, collection, moved, polygon, refusal


class TestManyPoints:
    """Outlines of more points than a field has corners: a hundred thousand must be no work and no memory."""

    def circle(self, count: int, noise_m: float = 0.0) -> list[list[float]]:
        angle = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
        radius = 150.0 + noise_m * np.random.default_rng(4).standard_normal(count)
        return np.column_stack([radius * np.cos(angle), radius * np.sin(angle)]).tolist()

    @pytest.mark.slow
    def test_points_on_the_sides_of_a_rectangle_are_dropped(self, saved: Any) -> None:
        share = np.linspace(0.0, 1.0, 25_000, endpoint=False)[:, None]
        corners = np.array(SQUARE_M, dtype=float)
        ring = np.concatenate([a + share * (b - a) for a, b in itertools.pairwise(corners)]).tolist()
        field = read_field(saved(polygon(ring)), local=True)
        assert field.boundary.equals(shapely.box(0, 0, 200, 100))
        assert "cleaned to 5 cm: 4 of its 100000 points remain" in field.remarks[0]

    @pytest.mark.parametrize(("noise_m", "within_m"), [(0.0, 0.05), (0.03, 0.5)])
    def test_a_curve_stays_within_what_is_told(self, saved: Any, noise_m: float, within_m: float) -> None:
        ring = self.circle(12_000, noise_m)
        field = read_field(saved(polygon(ring)), local=True)
        told_m = float(re.search(r"others is ([0-9.]+) m from", field.remarks[0])[1])  # type: ignore[index]
        off = shapely.distance(field.boundary.exterior, shapely.points(ring))
        assert off.max() == pytest.approx(told_m, abs=0.006) and told_m <= within_m
        assert shapely.covers(shapely.Polygon(ring).buffer(1e-6), field.boundary)
        assert len(field.boundary.exterior.coords) <= 2.0 * np.pi * 150.0 / 3.0 + 1

    def test_spikes_are_refused(self, saved: Any) -> None:
        ring = [[1.0 * x, y * (1 + i % 2)] for i, (x, y) in enumerate(self.circle(8_000))]
        assert "has 8000 points, and without its spikes it would change" in refusal(saved(polygon(ring)), local=True)


class TestNotUsed:
    """What a file holds beyond boundary, ground zones and entrance is told, not dropped."""

    def test_kinds_are_counted(self, saved: Any) -> None:
        point = {"type": "Point", "coordinates": [50, 50]}
        pond = polygon(moved([[0, 0], [5, 0], [5, 5]], 50, 50))
        several = [feature(point, role="crop")] * 2 + [feature(pond, role="entrance"), feature(None)]
        field = read_field(saved(collection(feature(polygon(SQUARE_M)), *several)), local=True)
        (remark,) = field.remarks
        assert remark.startswith(
            "Features of the field file that are not used: 2 Point with role 'crop', 1 Polygon with role 'entrance', "
            "1 feature without a known geometry. An obstacle has the role 'obstacle' or is a hole of the boundary"
        )

    def test_of_a_file_that_is_used_whole_nothing_is_said(self, saved: Any) -> None:
        zone = feature(polygon([[-10, -10], [20, -10], [20, 0]]), ground="asphalt")
        gate = feature({"type": "Point", "coordinates": [0, 0]}, role="entrance")
        assert read_field(saved(collection(zone, gate, feature(polygon(SQUARE_M)))), local=True).remarks == ()
        assert all(read_field(name).remarks == () for name in list_sample_names())

    def test_kinds_without_end_are_summed_up(self, saved: Any) -> None:
        points = [feature({"type": "Point", "coordinates": [0, 0]}, role=f"r{i}" * 40) for i in range(50)]
        (remark,) = read_field(saved(collection(feature(polygon(SQUARE_M)), *points)), local=True).remarks
        assert "45 of other kinds" in remark and len(remark) < 650


class TestList:
    def test_every_field_with_area_and_holes(self, saved: Any) -> None:
        blocks = [feature(polygon(moved(SQUARE_M, 300.0 * i)), name=f"plot {i}") for i in range(20)]
        blocks[3] = feature(polygon(moved(SQUARE_M, 900), moved([[10, 10], [60, 10], [60, 50], [10, 50]], 900)))
        blocks[5] = feature(polygon([[0, 0], [1, None]]))
        path = saved(collection(*blocks))
        parcels = list_fields(path, local=True)
        assert [one.position for one in parcels] == list(range(20))
        assert (parcels[0].key, parcels[0].area_ha, parcels[0].holes) == ("plot 0", 2.0, 0)
        assert (parcels[3].key, parcels[3].area_ha, parcels[3].holes) == ("3", 1.8, 1)
        assert parcels[5].area_ha is None and "is missing" in parcels[5].fault
        assert read_field(f"{path}#{parcels[7].key}", local=True).boundary.bounds[0] == 2100.0
        assert "and 8 more (list_fields lists all)" in refusal(path, local=True)


class TestNames:
    def test_a_file_that_is_not_there_is_no_sample_misspelt(self, tmp_path: Path) -> None:
        for name in ("nofile.geojson", str(tmp_path / "iwamisawa")):
            text = refusal(name)
            assert "There is no field file" in text and "sample" not in text

    @pytest.mark.parametrize("ending", [".parquet", ".dwg", ".DXF", ".gml"])
    def test_other_forms_say_how_to_convert(self, tmp_path: Path, ending: str) -> None:
        (tmp_path / f"farm{ending}").write_bytes(b"whatever")
        text = refusal(tmp_path / f"farm{ending}")
        assert (
            "are read from GeoJSON, Shapefile, KML" in text
            and f"ogr2ogr -t_srs EPSG:4326 farm.geojson farm{ending}" in text
        )

    def test_names_no_file_can_have(self, tmp_path: Path) -> None:
        assert "There is no field file" in refusal(tmp_path / ("x" * 300))
        assert refusal("a\0b").startswith("There is no field file")
        assert "The file name is empty" in refusal("")

    @pytest.mark.skipif(not hasattr(os, "symlink") or os.name == "nt", reason="needs symbolic links")
    def test_links_that_lead_nowhere(self, tmp_path: Path) -> None:
        (tmp_path / "loop").symlink_to(tmp_path / "loop")
        (tmp_path / "dangling").symlink_to(tmp_path / "nothing")
        for name in ("loop", "dangling"):
            assert "is a symbolic link to a missing file" in refusal(tmp_path / name)

    def test_a_file_without_permission(self, saved: Any, monkeypatch: pytest.MonkeyPatch) -> None:
        path = saved(polygon(SQUARE_M))

        def refuse(*_: Any, **__: Any) -> None:
            raise PermissionError(errno.EACCES, "Permission denied")

        monkeypatch.setattr("builtins.open", refuse)
        assert "cannot be read (no permission)" in refusal(path, local=True)

    def test_whole_numbers_of_thousands_of_digits(self, saved: Any) -> None:
        text = '{"type": "Polygon", "coordinates": [[[0, 0], [%s, 0], [1, 1]]]}'
        assert "thousands of digits" in refusal(saved(text % ("1" * 5000)), local=True)
        assert "not finite" in refusal(saved(text % ("1" * 4000)), local=True)

    @pytest.mark.parametrize("size", ["1e-308", "1e308", "-1e308"])
    def test_numbers_at_the_ends_of_floats(self, saved: Any, size: str) -> None:
        refusal(saved(f'{{"type": "Polygon", "coordinates": [[[0, 0], [{size}, 0], [{size}, {size}]]]}}'), local=True)


def test_a_name_cannot_command_a_terminal(tmp_path: Path) -> None:
    place = tmp_path / "odd.geojson"
    ring = [[0, 0], [90, 0], [90, 90], [0, 90], [0, 0]]
    feature = {"type": "Feature", "geometry": {"type": "Polygon", "coordinates": [ring]}, "id": "a\u0007",
               "properties": {"name": "\u001b[31mred"}}  # fmt: skip
    place.write_text(json.dumps(feature))
    assert read_field(place, local=True).name == "?[31mred"
    assert [one.key for one in list_fields(place, local=True)] == ["a?"]
