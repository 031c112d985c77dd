"""Reading and writing of field files."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from pyproj import Transformer

from fields import Field, FieldError, GroundZone, list_sample_names, read_field, write_field
from fields.geometry.geodesy import find_utm_crs
from tests.drawn_fields import feature
from tests.fields.geojson import SQUARE_DEG, SQUARE_M, collection, moved, polygon, refusal


class TestForms:
    @pytest.mark.parametrize(
        "content",
        [
            polygon(SQUARE_M),
            {"type": "MultiPolygon", "coordinates": [[SQUARE_M]]},
            feature(polygon(SQUARE_M)),
            collection(feature(polygon(SQUARE_M))),
            collection(feature({"type": "MultiPolygon", "coordinates": [[SQUARE_M]]}), feature(None)),
            feature({"type": "GeometryCollection", "geometries": [polygon(SQUARE_M)]}),
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
        content = collection(feature(polygon(SQUARE_M), name="Long acre", default_ground="mud"), source="survey")
        field = read_field(saved(content), local=True)
        assert (field.name, field.source, field.default_ground) == ("Long acre", "survey", "mud")
        assert read_field(saved(content), local=True, name="mine").name == "mine"

    def test_entrance_and_ground_zones(self, saved: Any) -> None:
        zone = feature(polygon([[-10, -10], [20, -10], [20, 0], [-10, 0], [-10, -10]]), ground="asphalt")
        gate = feature({"type": "Point", "coordinates": [0, 0, 3.0]}, role="entrance")
        tree = feature({"type": "Point", "coordinates": [50, 50]}, role="tree")
        field = read_field(saved(collection(zone, gate, tree, feature(polygon(SQUARE_M)))), local=True)
        assert field.entrance == (0.0, 0.0)
        assert [zone.name for zone in field.ground_zones] == ["asphalt"]
        assert (field.find_ground_at(0, -5), field.find_ground_at(50, 50)) == ("asphalt", "soil")

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
        assert read_field(saved({**polygon(SQUARE_DEG), "crs": crs})) == read_field(saved(polygon(SQUARE_DEG)))

    @given(lon=st.floats(-179.9, 179.9), lat=st.floats(-79.0, 79.0))
    def test_there_and_back_within_a_millimetre(self, lon: float, lat: float) -> None:
        crs = find_utm_crs(lon, lat)
        x, y = Transformer.from_crs("EPSG:4326", crs, always_xy=True).transform(lon, lat)
        field = Field("a", shapely.box(-50, -50, 50, 50), crs=crs, origin_m=(float(round(x)), float(round(y))))
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
        assert "7 (2.00 ha), x-2-1 (2.00 ha), x-2-2 (2.00 ha)" in text

    @pytest.mark.parametrize(
        ("key", "west"), [("7", 0), ("north", 0), ("0", 0), ("1", 1000), ("2", 1300), ("x-2-2", 1300)]
    )
    def test_key_chooses(self, two: Path, key: str, west: float) -> None:
        assert read_field(f"{two}#{key}", local=True).boundary.bounds[0] == west

    def test_entrance_of_the_chosen_field(self, two: Path) -> None:
        assert read_field(f"{two}#0", local=True).entrance == (0.0, 0.0)
        assert read_field(f"{two}#1", local=True).entrance == (1000.0, 0.0)
        assert read_field(f"{two}#2", local=True).entrance is None

    def test_key_of_two_polygons(self, two: Path) -> None:
        assert "choose one of x-2-1, x-2-2." in refusal(f"{two}#x-2", local=True)

    def test_unknown_key(self, two: Path) -> None:
        assert "has no field '9'" in refusal(f"{two}#9", local=True)

    def test_broken_neighbour_does_not_matter(self, saved: Any) -> None:
        path = saved(collection(feature(polygon([[0, 0], [1, None]])), feature(polygon(SQUARE_M))))
        assert read_field(f"{path}#1", local=True).area_m2 == 20_000
        assert "0 (not usable)" in refusal(path, local=True)

    def test_file_name_with_a_hash(self, saved: Any) -> None:
        assert read_field(saved(polygon(SQUARE_M), "a#1.geojson"), local=True).area_m2 == 20_000


METRES: list[tuple[Any, str]] = [
    (polygon([[0, 0], [200, 200], [200, 0], [0, 200]]), "crosses itself at (100, 100)"),
    (polygon([]), "at least 3"),
    (polygon([[0, 0]]), "at least 3"),
    (polygon([[0, 0], [200, 0], [0, 0], [200, 0], [0, 0]]), "at least 3"),
    (collection(feature(polygon(SQUARE_M), ground="mud")), "ground zones"),
    (polygon(SQUARE_DEG), "look like degrees; leave out local"),
    (polygon([[0, 0], [9.9, 0], [9.9, 9.9], [0, 9.9]]), "at least 100 m2"),
    (polygon([[0, 0], [10_001.0, 0], [10_001.0, 10_001.0], [0, 10_001.0]]), "at most 100 km2"),
    ({**polygon(SQUARE_M), "crs": {"type": "name", "properties": {"name": "EPSG:28992"}}}, "leave out local"),
    (
        collection(
            feature(polygon(SQUARE_M)),
            *(feature({"type": "Point", "coordinates": [x, 0]}, role="entrance") for x in (0, 10)),
        ),
        "2 entrances",
    ),
]
DEGREES: list[tuple[Any, str]] = [
    ("[" * 200_000, "is not JSON"),
    (collection(), "empty collection"),
    *(({"type": kind, "coordinates": [0, 0]}, f"1 {kind}") for kind in ("Point", "LineString", "GeometryCollection")),
    *((polygon(moved(SQUARE_M, shift)), "add local") for shift in (0, 500, 500_000)),
    (polygon([[0, 0], [60, 0], [60, 60], [0, 60]]), "add local"),
    (polygon([[43.2, 141.7], [43.201, 141.7], [43.201, 141.702]]), "latitude before longitude"),
]
"""Documents that are refused, as they are given (local or not), and why."""


class TestRefusals:
    @pytest.mark.parametrize(
        ("content", "words", "local"), [*((*one, True) for one in METRES), *((*one, False) for one in DEGREES)]
    )
    def test_documents(self, saved: Any, content: Any, words: str, local: bool) -> None:
        assert words in refusal(saved(content), local=local)

    def test_not_text(self, tmp_path: Path) -> None:
        (tmp_path / "x.geojson").write_bytes(b"\xff\xfe\x00\x81")
        assert "UTF-8" in refusal(tmp_path / "x.geojson")

    def test_an_unknown_ending_is_json_or_foreign(self, tmp_path: Path) -> None:
        (tmp_path / "x.abl").write_text("field Home\n56 10\n")
        assert "is in an unknown format, but fields are read from GeoJSON, " in refusal(tmp_path / "x.abl")
        (tmp_path / "y.abl").write_text("\ufeff \n{")
        assert "'y.abl' is not JSON" in refusal(tmp_path / "y.abl")

    def test_no_such_file_names_the_nearest_sample(self) -> None:
        assert "did you mean 'iwamizawa'?" in refusal("iwamisawa")

    def test_folder(self, tmp_path: Path) -> None:
        assert "is a folder" in refusal(tmp_path)

    @pytest.mark.parametrize(
        ("bad", "word"),
        [
            ("NaN", "not finite"),
            ("Infinity", "not finite"),
            ("1e999", "not finite"),
            ("1" + "0" * 400, "not finite"),
            ('"12"', "not a number"),
            ("null", "is missing"),
            ("true", "not a number"),
        ],
    )
    def test_bad_numbers(self, saved: Any, bad: str, word: str) -> None:
        text = f'{{"type": "Polygon", "coordinates": [[[0, 0], [200, {bad}], [200, 100]]]}}'
        assert word in refusal(saved(text), local=True)

    @pytest.mark.parametrize("coordinates", [None, 3, [], [5], [[5]], [[[5]]], [{"a": 1}]])
    def test_bad_nesting(self, saved: Any, coordinates: Any) -> None:
        refusal(saved({"type": "Polygon", "coordinates": coordinates}), local=True)

    @pytest.mark.parametrize("content", [[], 3, {}, {"type": "Topology"}, {"type": "FeatureCollection"}])
    def test_other_json(self, saved: Any, content: Any) -> None:
        refusal(saved(content))

    @pytest.mark.parametrize("crs", [{"type": "name", "properties": {"name": "EPSG:1"}}, {"type": "link"}, "x"])
    def test_unusable_crs(self, saved: Any, crs: Any) -> None:
        refusal(saved({**polygon(SQUARE_DEG), "crs": crs}))

    @pytest.mark.parametrize(
        "header",
        [{"frame": "feet"}, {"frame": "local_metres", "origin_m": [1]}, {"crs": "EPSG:28992"}, {"origin_m": "x"}],
    )
    def test_damaged_header(self, saved: Any, header: Any) -> None:
        ring = SQUARE_M if header.get("frame") == "local_metres" else SQUARE_DEG
        refusal(saved(collection(feature(polygon(ring)), headland=header)))


class TestRoundTrip:
    @pytest.mark.parametrize("name", list_sample_names())
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
        zones = (GroundZone("asphalt", shapely.box(-5.5, 0, 5, 5)), GroundZone("mud", shapely.box(0, 0, 9, 9)))
        field = Field("ä ö", ring, entrance=(0.1, 0.2), ground_zones=zones, default_ground="mud", source="here")
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
            ground_zones=(GroundZone("asphalt", shapely.box(x, y, x + 20, y + 10)),),
        )
        path = tmp_path_factory.getbasetemp() / "round.geojson"
        write_field(field, path)
        again = read_field(path)
        assert (again.crs, again.origin_m) == (field.crs, field.origin_m)
        assert again.entrance == pytest.approx((x, y), abs=1e-6)
        assert again.ground_zones[0].polygon.hausdorff_distance(field.ground_zones[0].polygon) < 1e-6

    def test_half_an_emoji_in_a_name(self, tmp_path: Path) -> None:
        write_field(Field("North \ud83d", shapely.box(0, 0, 90, 90)), tmp_path / "f.geojson")
        assert read_field(tmp_path / "f.geojson").name == "North ?"

    def test_unwritable_place(self, tmp_path: Path) -> None:
        with pytest.raises(FieldError, match="cannot be written"):
            write_field(read_field("iwamizawa"), tmp_path / "missing" / "f.geojson")


class TestSamples:
    def test_names(self) -> None:
        assert list_sample_names() == ("denmark", "iwamizawa", "netherlands", "sweden")

    def test_iwamizawa_is_the_rectangle_of_the_thesis(self) -> None:
        field = read_field("iwamizawa")
        assert field.boundary.equals(shapely.box(0, 0, 270, 70))
        assert field.crs is None and field.entrance == (0.0, 0.0)
        assert (field.find_ground_at(-5, -3), field.find_ground_at(135, 35)) == ("asphalt", "soil")

    @pytest.mark.parametrize(
        ("name", "hectares", "holes"), [("denmark", 3.916, 1), ("netherlands", 2.242, 0), ("sweden", 2.193, 0)]
    )
    def test_parcels_have_their_stated_area(self, name: str, hectares: float, holes: int) -> None:
        field = read_field(name)
        assert field.area_ha == pytest.approx(hectares, rel=1e-3)
        assert len(field.boundary.interiors) == holes
        assert field.source


def test_heights_go_with_a_written_field(tmp_path: Path) -> None:
    here, there = tmp_path / "here", tmp_path / "there"
    here.mkdir()
    there.mkdir()
    for name in ("dtm.asc", "dtm.prj"):
        (here / name).write_text(name, encoding="utf-8")
    field = Field("hill", shapely.box(0, 0, 200, 100), elevation=str(here / "dtm.asc"))
    write_field(field, there / "hill.geojson")
    copied = read_field(there / "hill.geojson").elevation
    assert copied is not None and Path(copied) == there / "dtm.asc"
    assert Path(copied).read_text(encoding="utf-8") == "dtm.asc" and (there / "dtm.prj").exists()
    write_field(field, there / "hill.geojson")  # the same heights again
    write_field(field, here / "hill.geojson")  # beside themselves
    (there / "dtm.asc").write_text("others", encoding="utf-8")
    with pytest.raises(FieldError, match="exists and holds other heights than those of field 'hill'"):
        write_field(field, there / "hill.geojson")
