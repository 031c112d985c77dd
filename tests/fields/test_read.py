"""Reading and writing of field files."""

from __future__ import annotations

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
from hypothesis import given
from hypothesis import strategies as st
from pyproj import Transformer

from fields import Field, FieldError, GroundZone, list_fields, read_field, sample_names, write_field
from fields.projection import utm_crs

SQUARE_M = [[0, 0], [200, 0], [200, 100], [0, 100], [0, 0]]
SQUARE_DEG = [[5.0, 52.0], [5.002, 52.0], [5.002, 52.001], [5.0, 52.001], [5.0, 52.0]]


def polygon(*rings: Any) -> dict[str, Any]:
    return {"type": "Polygon", "coordinates": list(rings)}


def feature(geometry: Any, **properties: Any) -> dict[str, Any]:
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def collection(*features: Any, **members: Any) -> dict[str, Any]:
    return {"type": "FeatureCollection", "features": list(features), **members}


def moved(ring: list[list[float]], dx: float, dy: float = 0.0) -> list[list[float]]:
    return [[x + dx, y + dy] for x, y in ring]


@pytest.fixture
def saved(tmp_path: Path):  # type: ignore[no-untyped-def]
    def save(content: Any, name: str = "plot.geojson") -> Path:
        path = tmp_path / name
        path.write_text(content if isinstance(content, str) else json.dumps(content), encoding="utf-8")
        return path

    return save


def refusal(where: str | Path, **options: Any) -> str:
    """The message of a refusal, checked to be one sentence."""
    with pytest.raises(FieldError) as caught:
        read_field(where, **options)
    text = str(caught.value)
    assert text.endswith(".") and "\n" not in text
    return text


class TestForms:
    @pytest.mark.parametrize(
        "content",
        [
            polygon(SQUARE_M),
            {"type": "MultiPolygon", "coordinates": [[SQUARE_M]]},
            feature(polygon(SQUARE_M)),
            collection(feature(polygon(SQUARE_M))),
            collection(feature({"type": "MultiPolygon", "coordinates": [[SQUARE_M]]}), feature(None)),
        ],
    )
    def test_every_form_gives_the_same_field(self, saved: Any, content: Any) -> None:
        field = read_field(saved(content), local=True)
        assert field.boundary.equals(shapely.box(0, 0, 200, 100))
        assert (field.crs, field.origin_m, field.name) == (None, (0.0, 0.0), "plot")

    def test_open_clockwise_3d_rings_with_repeated_points(self, saved: Any) -> None:
        ring = [[x, y, 12.5] for x, y in SQUARE_M[:-1][::-1]]
        field = read_field(saved(polygon(ring[:2] + ring[1:])), local=True)
        assert field.boundary.exterior.is_ccw
        assert len(field.boundary.exterior.coords) == 5
        assert field.area_m2 == pytest.approx(20_000)

    def test_byte_order_mark_is_no_obstacle(self, saved: Any) -> None:
        assert read_field(saved("\ufeff" + json.dumps(polygon(SQUARE_M))), local=True).area_m2 == 20_000

    def test_name_source_and_ground_come_from_the_file(self, saved: Any) -> None:
        content = collection(
            feature(polygon(SQUARE_M), name="Long acre", default_ground="mud"), source="survey"
        )
        field = read_field(saved(content), local=True)
        assert (field.name, field.source, field.default_ground) == ("Long acre", "survey", "mud")
        assert read_field(saved(content), local=True, name="mine").name == "mine"

    def test_entrance_and_ground_zones(self, saved: Any) -> None:
        zone = feature(polygon([[-10, -10], [20, -10], [20, 0], [-10, 0], [-10, -10]]), ground="asphalt")
        gate = feature({"type": "Point", "coordinates": [0, 0, 3.0]}, role="entrance")
        tree = feature({"type": "Point", "coordinates": [50, 50]}, role="tree")
        field = read_field(saved(collection(zone, gate, tree, feature(polygon(SQUARE_M)))), local=True)
        assert field.entrance == (0.0, 0.0)
        assert [zone.name for zone in field.grounds] == ["asphalt"]
        assert (field.ground_at(0, -5), field.ground_at(50, 50)) == ("asphalt", "soil")

    def test_far_local_metres_get_an_origin(self, saved: Any) -> None:
        field = read_field(saved(polygon(moved(SQUARE_M, 500_000.25, 4_780_000.0))), local=True)
        assert field.origin_m == (500_100.0, 4_780_050.0)
        assert field.boundary.bounds == pytest.approx((-99.75, -50.0, 100.25, 50.0))


class TestEarth:
    def test_degrees_become_utm_metres(self, saved: Any) -> None:
        field = read_field(saved(polygon(SQUARE_DEG)))
        east, north = Transformer.from_crs("EPSG:4326", "EPSG:32631", always_xy=True).transform(5.0, 52.0)
        assert field.crs == "EPSG:32631"
        corner = np.array(field.boundary.exterior.coords) + field.origin_m
        assert np.hypot(*(corner - (east, north)).T).min() < 1e-6
        assert all(value == round(value) for value in field.origin_m)
        assert max(map(abs, field.boundary.centroid.coords[0])) <= 0.75

    def test_southern_hemisphere(self, saved: Any) -> None:
        field = read_field(saved(polygon(moved(SQUARE_DEG, -63.4, -86.6))))
        assert field.crs == "EPSG:32721"
        assert field.origin_m[1] > 5_000_000

    @pytest.mark.parametrize("dx", [0.0009, 0.0011])
    def test_across_the_date_line(self, saved: Any, dx: float) -> None:
        ring = [[(x - 5.0 - dx + 360.0) % 360.0, y - 68.0] for x, y in SQUARE_DEG]
        ring = [[x - 360.0 if x >= 180.0 else x, y] for x, y in moved_half(ring)]
        field = read_field(saved(polygon(ring)))
        plain = read_field(saved(polygon(moved(SQUARE_DEG, 174.99, -68.0))))
        assert field.crs == ("EPSG:32701" if dx < 0.001 else "EPSG:32760")
        assert field.area_m2 == pytest.approx(plain.area_m2, rel=1e-4)
        lon = field.to_wgs84(np.array(field.boundary.exterior.coords))[:, 0]
        assert (np.abs(lon) > 179.99).all()

    @pytest.mark.parametrize("name", ["EPSG:28992", "urn:ogc:def:crs:EPSG::28992"])
    def test_projected_crs_member_is_converted(self, saved: Any, name: str) -> None:
        to_rd = Transformer.from_crs("EPSG:4326", "EPSG:28992", always_xy=True)
        ring = [list(to_rd.transform(*point)) for point in SQUARE_DEG]
        crs = {"type": "name", "properties": {"name": name}}
        field = read_field(saved({**polygon(ring), "crs": crs}))
        direct = read_field(saved(polygon(SQUARE_DEG)))
        assert field.crs == direct.crs
        assert field.boundary.hausdorff_distance(direct.boundary) < 0.5

    @pytest.mark.parametrize("name", ["urn:ogc:def:crs:OGC:1.3:CRS84", "EPSG:4326"])
    def test_crs_member_for_degrees_changes_nothing(self, saved: Any, name: str) -> None:
        crs = {"type": "name", "properties": {"name": name}}
        assert read_field(saved({**polygon(SQUARE_DEG), "crs": crs})) == read_field(
            saved(polygon(SQUARE_DEG))
        )

    @given(lon=st.floats(-179.9, 179.9), lat=st.floats(-79.0, 79.0))
    def test_there_and_back_within_a_millimetre(self, lon: float, lat: float) -> None:
        crs = utm_crs(lon, lat)
        x, y = Transformer.from_crs("EPSG:4326", crs, always_xy=True).transform(lon, lat)
        field = Field(
            "a", shapely.box(-50, -50, 50, 50), crs=crs, origin_m=(float(round(x)), float(round(y)))
        )
        back = field.to_wgs84([[x - field.origin_m[0], y - field.origin_m[1]]])[0]
        assert back == pytest.approx([lon, lat], abs=1e-8)


def moved_half(ring: list[list[float]]) -> list[list[float]]:
    """Half a turn further east, longitudes in [0, 360)."""
    return [[(x + 180.0) % 360.0, y] for x, y in ring]


class TestChoice:
    @pytest.fixture
    def two(self, saved: Any) -> Path:
        one = {**feature(polygon(SQUARE_M), name="north"), "id": 7}
        far = moved(SQUARE_M, 1000)
        other = feature({"type": "MultiPolygon", "coordinates": [[far], [moved(far, 300)]]}, id="x-2")
        gates = [feature({"type": "Point", "coordinates": [x, 0]}, role="entrance") for x in (0, 1000)]
        path: Path = saved(collection(one, other, *gates))
        return path

    def test_several_fields_are_listed_with_areas(self, two: Path) -> None:
        text = refusal(two, local=True)
        assert "holds 3 fields" in text and "#ID" in text
        assert "7 (2.00 ha), x-2 (2.00 ha), x-2 (2.00 ha)" in text

    @pytest.mark.parametrize(("key", "west"), [("7", 0), ("north", 0), ("0", 0), ("1", 1000), ("2", 1300)])
    def test_key_chooses(self, two: Path, key: str, west: float) -> None:
        assert read_field(f"{two}#{key}", local=True).boundary.bounds[0] == west

    def test_entrance_of_the_chosen_field(self, two: Path) -> None:
        assert read_field(f"{two}#0", local=True).entrance == (0.0, 0.0)
        assert read_field(f"{two}#1", local=True).entrance == (1000.0, 0.0)
        assert read_field(f"{two}#2", local=True).entrance is None

    def test_key_of_two_polygons(self, two: Path) -> None:
        assert "#1, #2" in refusal(f"{two}#x-2", local=True)

    def test_unknown_key(self, two: Path) -> None:
        assert "has no field '9'" in refusal(f"{two}#9", local=True)

    def test_broken_neighbour_does_not_matter(self, saved: Any) -> None:
        path = saved(collection(feature(polygon([[0, 0], [1, None]])), feature(polygon(SQUARE_M))))
        assert read_field(f"{path}#1", local=True).area_m2 == 20_000
        assert "0 (not usable)" in refusal(path, local=True)

    def test_file_name_with_a_hash(self, saved: Any) -> None:
        assert read_field(saved(polygon(SQUARE_M), "a#1.geojson"), local=True).area_m2 == 20_000


class TestRefusals:
    def test_not_json(self, saved: Any) -> None:
        assert "is not JSON" in refusal(saved("POLYGON ((0 0, 1 1))"))

    def test_not_text(self, tmp_path: Path) -> None:
        (tmp_path / "x").write_bytes(b"\xff\xfe\x00\x81")
        assert "UTF-8" in refusal(tmp_path / "x")

    def test_endlessly_nested(self, saved: Any) -> None:
        assert "is not JSON" in refusal(saved("[" * 200_000))

    def test_no_such_file_names_the_nearest_sample(self) -> None:
        assert "is 'iwamizawa'" in refusal("iwamisawa")

    def test_folder(self, tmp_path: Path) -> None:
        assert "is a folder" in refusal(tmp_path)

    def test_self_crossing_says_where(self, saved: Any) -> None:
        text = refusal(saved(polygon([[0, 0], [200, 200], [200, 0], [0, 200]])), local=True)
        assert "crosses itself at (100, 100)" in text

    def test_hole_outside(self, saved: Any) -> None:
        text = refusal(saved(polygon(SQUARE_M, moved([[0, 0], [10, 0], [10, 10]], 500))), local=True)
        assert "a hole lies outside" in text

    @pytest.mark.parametrize("ring", [[], [[0, 0]], [[0, 0], [200, 0], [0, 0], [200, 0], [0, 0]]])
    def test_too_few_points(self, saved: Any, ring: Any) -> None:
        assert "at least 3" in refusal(saved(polygon(ring)), local=True)

    @pytest.mark.parametrize(
        ("bad", "word"),
        [
            ("NaN", "not finite"),
            ("Infinity", "not finite"),
            ("1e999", "not finite"),
            ("1" + "0" * 400, "not finite"),
            ('"12"', "not a number"),
            ("null", "not a number"),
            ("true", "not a number"),
        ],
    )
    def test_bad_numbers(self, saved: Any, bad: str, word: str) -> None:
        text = f'{{"type": "Polygon", "coordinates": [[[0, 0], [200, {bad}], [200, 100]]]}}'
        assert word in refusal(saved(text), local=True)

    @pytest.mark.parametrize("coordinates", [None, 3, [], [5], [[5]], [[[5]]], [{"a": 1}]])
    def test_bad_nesting(self, saved: Any, coordinates: Any) -> None:
        refusal(saved({"type": "Polygon", "coordinates": coordinates}), local=True)

    def test_empty_collection(self, saved: Any) -> None:
        assert "empty collection" in refusal(saved(collection()))

    def test_only_ground_zones(self, saved: Any) -> None:
        assert "ground zones" in refusal(
            saved(collection(feature(polygon(SQUARE_M), ground="mud"))), local=True
        )

    @pytest.mark.parametrize("kind", ["Point", "LineString", "GeometryCollection"])
    def test_wrong_geometry(self, saved: Any, kind: str) -> None:
        assert f"1 {kind}" in refusal(saved({"type": kind, "coordinates": [0, 0]}))

    @pytest.mark.parametrize("content", [[], 3, {}, {"type": "Topology"}, {"type": "FeatureCollection"}])
    def test_other_json(self, saved: Any, content: Any) -> None:
        refusal(saved(content))

    def test_degrees_as_metres(self, saved: Any) -> None:
        assert "look like degrees; leave out local" in refusal(saved(polygon(SQUARE_DEG)), local=True)

    @pytest.mark.parametrize("shift", [0, 500, 500_000])
    def test_metres_as_degrees(self, saved: Any, shift: float) -> None:
        assert "add local" in refusal(saved(polygon(moved(SQUARE_M, shift))))

    def test_small_metres_as_degrees(self, saved: Any) -> None:
        assert "add local" in refusal(saved(polygon([[0, 0], [60, 0], [60, 60], [0, 60]])))

    def test_latitude_first(self, saved: Any) -> None:
        ring = [[43.2, 141.7], [43.201, 141.7], [43.201, 141.702]]
        assert "latitude before longitude" in refusal(saved(polygon(ring)))

    @pytest.mark.parametrize(("side", "word"), [(9.9, "at least 100 m2"), (10_001.0, "at most 100 km2")])
    def test_area(self, saved: Any, side: float, word: str) -> None:
        assert word in refusal(saved(polygon([[0, 0], [side, 0], [side, side], [0, side]])), local=True)

    def test_local_against_a_crs(self, saved: Any) -> None:
        crs = {"type": "name", "properties": {"name": "EPSG:28992"}}
        assert "leave out local" in refusal(saved({**polygon(SQUARE_M), "crs": crs}), local=True)

    @pytest.mark.parametrize(
        "crs", [{"type": "name", "properties": {"name": "EPSG:1"}}, {"type": "link"}, "x"]
    )
    def test_unusable_crs(self, saved: Any, crs: Any) -> None:
        refusal(saved({**polygon(SQUARE_DEG), "crs": crs}))

    def test_two_entrances(self, saved: Any) -> None:
        gates = [feature({"type": "Point", "coordinates": [x, 0]}, role="entrance") for x in (0, 10)]
        assert "2 entrances" in refusal(saved(collection(feature(polygon(SQUARE_M)), *gates)), local=True)

    @pytest.mark.parametrize(
        "header",
        [
            {"frame": "feet"},
            {"frame": "local_metres", "origin_m": [1]},
            {"crs": "EPSG:28992"},
            {"origin_m": "x"},
        ],
    )
    def test_damaged_header(self, saved: Any, header: Any) -> None:
        ring = SQUARE_M if header.get("frame") == "local_metres" else SQUARE_DEG
        refusal(saved(collection(feature(polygon(ring)), headland=header)))


class TestRoundTrip:
    @pytest.mark.parametrize("name", sample_names())
    def test_samples(self, tmp_path: Path, name: str) -> None:
        field = read_field(name)
        write_field(field, tmp_path / "f.geojson")
        again = read_field(tmp_path / "f.geojson")
        assert shapely.equals_exact(again.boundary, field.boundary, 1e-6)
        assert (again.name, again.crs, again.origin_m) == (field.name, field.crs, field.origin_m)
        assert (again.entrance, again.source, again.default_ground) == (
            field.entrance,
            field.source,
            field.default_ground,
        )

    def test_local_metres_come_back_bit_for_bit(self, tmp_path: Path) -> None:
        ring = shapely.Polygon([(0.1, 0.2), (123.456, 1 / 3), (99.9, 77.7)])
        zones = (
            GroundZone("asphalt", shapely.box(-5.5, 0, 5, 5)),
            GroundZone("mud", shapely.box(0, 0, 9, 9)),
        )
        field = Field("ä ö", ring, entrance=(0.1, 0.2), grounds=zones, default_ground="mud", source="here")
        write_field(field, tmp_path / "f.geojson")
        assert read_field(tmp_path / "f.geojson") == field

    @given(x=st.floats(-300, 300), y=st.floats(-300, 300), zone=st.integers(1, 60), south=st.booleans())
    def test_entrance_and_zones_on_the_earth(
        self, tmp_path_factory: pytest.TempPathFactory, x: float, y: float, zone: int, south: bool
    ) -> None:
        field = Field(
            "a",
            shapely.box(-100, -50, 100, 50),
            crs=f"EPSG:{(32700 if south else 32600) + zone}",
            origin_m=(500_012.0, 4_600_000.0),
            entrance=(x, y),
            grounds=(GroundZone("asphalt", shapely.box(x, y, x + 20, y + 10)),),
        )
        path = tmp_path_factory.getbasetemp() / "round.geojson"
        write_field(field, path)
        again = read_field(path)
        assert (again.crs, again.origin_m) == (field.crs, field.origin_m)
        assert again.entrance == pytest.approx((x, y), abs=1e-6)
        assert again.grounds[0].polygon.hausdorff_distance(field.grounds[0].polygon) < 1e-6

    def test_unwritable_place(self, tmp_path: Path) -> None:
        with pytest.raises(FieldError, match="cannot be written"):
            write_field(read_field("iwamizawa"), tmp_path / "missing" / "f.geojson")


class TestSamples:
    def test_names(self) -> None:
        assert sample_names() == ("denmark", "iwamizawa", "netherlands", "sweden")

    def test_iwamizawa_is_the_rectangle_of_the_thesis(self) -> None:
        field = read_field("iwamizawa")
        assert field.boundary.equals(shapely.box(0, 0, 270, 70))
        assert field.crs is None and field.entrance == (0.0, 0.0)
        assert (field.ground_at(-5, -3), field.ground_at(135, 35)) == ("asphalt", "soil")

    @pytest.mark.parametrize(
        ("name", "hectares", "holes"),
        [("denmark", 3.916, 1), ("netherlands", 2.242, 0), ("sweden", 2.193, 0)],
    )
    def test_parcels_have_their_stated_area(self, name: str, hectares: float, holes: int) -> None:
        field = read_field(name)
        assert field.area_ha == pytest.approx(hectares, rel=1e-3)
        assert len(field.boundary.interiors) == holes
        assert field.source


class TestManyPoints:
    """Outlines of more points than a field has corners: a hundred thousand must be no work and no memory."""

    def circle(self, count: int, noise_m: float = 0.0) -> list[list[float]]:
        angle = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
        radius = 150.0 + noise_m * np.random.default_rng(4).standard_normal(count)
        return np.column_stack([radius * np.cos(angle), radius * np.sin(angle)]).tolist()

    def test_points_on_the_sides_of_a_rectangle_are_dropped(self, saved: Any) -> None:
        share = np.linspace(0.0, 1.0, 25_000, endpoint=False)[:, None]
        corners = np.array(SQUARE_M, dtype=float)
        ring = np.concatenate([a + share * (b - a) for a, b in itertools.pairwise(corners)]).tolist()
        field = read_field(saved(polygon(ring)), local=True)
        assert field.boundary.equals(shapely.box(0, 0, 200, 100))
        assert "simplified to 1 cm: 5 of its 100001 points are left" in field.remarks[0]

    @pytest.mark.parametrize(("noise_m", "within_m"), [(0.0, 0.0101), (0.03, 0.1601)])
    def test_a_curve_stays_within_what_is_told(self, saved: Any, noise_m: float, within_m: float) -> None:
        ring = self.circle(12_000, noise_m)
        field = read_field(saved(polygon(ring)), local=True)
        told = int(re.search(r"simplified to (\d+) cm", field.remarks[0])[1])  # type: ignore[index]
        assert told / 100.0 <= within_m
        off = shapely.distance(field.boundary.exterior, shapely.points(ring))
        assert 0.0 < off.max() <= 1.5 * told / 100.0, "where a ring begins GEOS may go somewhat further"
        assert len(field.boundary.exterior.coords) <= 5_001

    def test_an_ordinary_outline_keeps_every_point(self, saved: Any) -> None:
        ring = self.circle(1_900)
        field = read_field(saved(polygon(ring)), local=True)
        assert len(field.boundary.exterior.coords) == 1_901 and field.remarks == ()

    def test_spikes_are_refused(self, saved: Any) -> None:
        ring = [[1.0 * x, y * (1 + i % 2)] for i, (x, y) in enumerate(self.circle(8_000))]
        assert "points even when it is simplified to 16 cm" in refusal(saved(polygon(ring)), local=True)


class TestNotUsed:
    """What a file holds beyond boundary, ground zones and entrance is told, not dropped."""

    def test_kinds_are_counted(self, saved: Any) -> None:
        point = {"type": "Point", "coordinates": [50, 50]}
        line = {"type": "LineString", "coordinates": [[0, 0], [1, 1]]}
        pond = polygon(moved([[0, 0], [5, 0], [5, 5]], 50, 50))
        several = [feature(point, role="tree")] * 2 + [feature(line), feature(pond, role="entrance"), feature(None)]
        field = read_field(saved(collection(feature(polygon(SQUARE_M)), *several)), local=True)
        (remark,) = field.remarks
        assert remark.startswith(
            "Not used of the field file: 2 Point with role 'tree', 1 LineString, 1 Polygon with role 'entrance', "
            "1 feature without a known geometry; an obstacle has the role 'obstacle' or is a hole of the boundary"
        )

    def test_a_polygon_with_the_role_of_an_obstacle_is_no_second_field(self, saved: Any) -> None:
        pond = feature(polygon(moved([[0, 0], [5, 0], [5, 5]], 50, 50)), role="obstacle")
        assert read_field(saved(collection(pond, feature(polygon(SQUARE_M)))), local=True).area_m2 == 20_000

    def test_of_a_file_that_is_used_whole_nothing_is_said(self, saved: Any) -> None:
        zone = feature(polygon([[-10, -10], [20, -10], [20, 0]]), ground="asphalt")
        gate = feature({"type": "Point", "coordinates": [0, 0]}, role="entrance")
        assert read_field(saved(collection(zone, gate, feature(polygon(SQUARE_M)))), local=True).remarks == ()
        assert all(read_field(name).remarks == () for name in sample_names())

    def test_kinds_without_end_are_summed_up(self, saved: Any) -> None:
        points = [feature({"type": "Point", "coordinates": [0, 0]}, role=f"r{i}" * 40) for i in range(50)]
        (remark,) = read_field(saved(collection(feature(polygon(SQUARE_M)), *points)), local=True).remarks
        assert "44 of other kinds" in remark and len(remark) < 600


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
        assert parcels[5].area_ha is None and "not a number" in parcels[5].fault
        assert read_field(f"{path}#{parcels[7].key}", local=True).boundary.bounds[0] == 2100.0
        assert "and 8 more (list_fields lists all)" in refusal(path, local=True)


class TestNames:
    def test_a_file_that_is_not_there_is_no_sample_misspelt(self, tmp_path: Path) -> None:
        for name in ("nofile.geojson", str(tmp_path / "iwamisawa")):
            text = refusal(name)
            assert "There is no field file" in text and "sample" not in text

    @pytest.mark.parametrize("ending", [".kml", ".shp", ".gpkg", ".ZIP", ".gml"])
    def test_other_forms_say_how_to_convert(self, tmp_path: Path, ending: str) -> None:
        (tmp_path / f"farm{ending}").write_bytes(b"PK\x03\x04 whatever")
        text = refusal(tmp_path / f"farm{ending}")
        assert "are read from GeoJSON for now" in text and f"ogr2ogr -t_srs EPSG:4326 farm.geojson farm{ending}" in text

    def test_names_no_file_can_have(self, tmp_path: Path) -> None:
        assert "There is no field file" in refusal(tmp_path / ("x" * 300))
        assert refusal("a\0b").startswith("There is no field file")
        assert "An empty name is no file" in refusal("")

    @pytest.mark.skipif(not hasattr(os, "symlink") or os.name == "nt", reason="needs symbolic links")
    def test_links_that_lead_nowhere(self, tmp_path: Path) -> None:
        (tmp_path / "loop").symlink_to(tmp_path / "loop")
        (tmp_path / "dangling").symlink_to(tmp_path / "nothing")
        for name in ("loop", "dangling"):
            assert "is a symbolic link that leads to no file" in refusal(tmp_path / name)

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

    def test_deep_coordinates(self, saved: Any) -> None:
        deep = '{"type": "Polygon", "coordinates": %s%s}'
        for depth in (200, 900, 5_000, 200_000):
            refusal(saved(deep % ("[" * depth, "]" * depth)), local=True)

    @pytest.mark.parametrize("size", ["1e-308", "1e308", "-1e308"])
    def test_numbers_at_the_ends_of_floats(self, saved: Any, size: str) -> None:
        refusal(saved(f'{{"type": "Polygon", "coordinates": [[[0, 0], [{size}, 0], [{size}, {size}]]]}}'), local=True)
