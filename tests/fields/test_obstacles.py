"""Obstacles in field files, and the ground that is left when a margin is kept to them."""

import math
from pathlib import Path
from typing import Any

import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from fields import Field, FieldError, read_field, write_field
from fields.geometry.obstacles import DEFAULT_RADIUS_M, DEFAULT_WIDTH_M, Obstacle
from tests.drawn_fields import feature, line, point, write_features
from tests.fields.geojson import SQUARE_M, moved, polygon

BOX = shapely.box(0, 0, 200, 100)
POND = [[0, 0], [20, 0], [20, 10], [0, 10], [0, 0]]


def read(tmp_path: Path, *features: Any, key: str = "") -> Field:
    place = write_features(tmp_path / "plot.geojson", *features)
    return read_field(f"{place}{key}", local=True)


def with_square(tmp_path: Path, *features: Any) -> Field:
    return read(tmp_path, feature(polygon(SQUARE_M)), *features)


class TestReading:
    def test_points_lines_and_polygons(self, tmp_path: Path) -> None:
        field = with_square(
            tmp_path,
            feature(point(50, 50), role="obstacle", kind="pole", radius_m=2, name="P1"),
            feature(line([20, 0], [20, 60]), role="obstacle", width_m=3.0),
            feature(polygon(moved(POND, 100, 30)), role="obstacle", kind="Pond"),
        )
        pole, strip, pond = field.obstacles
        assert (pole.kind, pole.name, pole.half_width_m) == ("pole", "P1", 2.0)
        assert (strip.kind, strip.half_width_m, pond.kind, pond.name) == ("line", 1.5, "pond", "")
        assert pole.shape.area == pytest.approx(4 * math.pi, rel=0.01)
        assert strip.shape.area == pytest.approx(3.0 * (60 + 3.0)), "square ends, half the width beyond the line"
        assert pond.shape.area == pytest.approx(200)
        assert field.boundary.equals(BOX) and field.remarks == ()

    @pytest.mark.parametrize(("form", "key", "usual"), [
        (point(50, 50), "radius_m", DEFAULT_RADIUS_M), (line([50, 50], [60, 60]), "width_m", DEFAULT_WIDTH_M),
    ])  # fmt: skip
    def test_a_word_may_stand_for_the_size(self, tmp_path: Path, form: Any, key: str, usual: dict[str, float]) -> None:
        share = 1.0 if key == "radius_m" else 0.5
        for kind, size_m in usual.items():
            (one,) = with_square(tmp_path, feature(form, role="obstacle", kind=kind)).obstacles
            assert one.half_width_m == share * size_m
            own = feature(form, role="obstacle", kind=kind, **{key: 7.0})
            assert with_square(tmp_path, own).obstacles[0].half_width_m == share * 7.0

    def test_the_parts_of_a_geometry_stand_one_by_one(self, tmp_path: Path) -> None:
        several = [
            feature({"type": "MultiPoint", "coordinates": [[10, 10], [20, 20]]}, role="obstacle", radius_m=1),
            feature({"type": "MultiLineString", "coordinates": [[[1, 1], [2, 2]]]}, role="obstacle", width_m=1),
            feature({"type": "MultiPolygon", "coordinates": [[POND], [moved(POND, 50)]]}, role="obstacle"),
        ]
        obstacles = with_square(tmp_path, *several).obstacles
        assert [one.kind for one in obstacles] == ["point", "point", "line", "area", "area"]

    @pytest.mark.parametrize("label", [point(110, 35), {"type": "MultiPoint", "coordinates": [[110, 35], [111, 36]]}])
    def test_points_beside_an_area_in_a_collection_are_its_labels(self, tmp_path: Path, label: dict[str, Any]) -> None:
        pond = polygon(moved(POND, 100, 30))
        inner = {"type": "GeometryCollection", "geometries": [label]}
        for members in ([pond, label], [label, pond], [inner, pond]):
            form = {"type": "GeometryCollection", "geometries": members}
            for more in ({"kind": "pond"}, {"kind": "pond", "name": "North pond"}):
                (one,) = with_square(tmp_path, feature(form, role="obstacle", **more)).obstacles
                assert (one.kind, one.shape.area) == ("pond", pytest.approx(200))
        points = {"type": "GeometryCollection", "geometries": [point(10, 10), point(20, 20)]}
        assert len(with_square(tmp_path, feature(points, role="obstacle", kind="pole")).obstacles) == 2

    def test_a_polygon_inside_the_only_field_is_an_obstacle_and_told(self, tmp_path: Path) -> None:
        inner = feature(polygon(moved(POND, 100, 30)), name="rock")
        for features in ((feature(polygon(SQUARE_M)), inner), (inner, feature(polygon(SQUARE_M)))):
            field = read(tmp_path, *features)
            assert [(one.kind, one.name) for one in field.obstacles] == [("stone", "rock")]
            (remark,) = field.remarks
            assert remark.startswith("1 feature without a role lies in the field and is avoided as an obstacle: ")
            assert "(1) stone 'rock', 200 m2. To" in remark and remark.endswith("--ignore rock.")
            assert field.compute_ground_with_margin(0.0).area_m2 == pytest.approx(20_000 - 200)

    def test_polygons_side_by_side_are_fields(self, tmp_path: Path) -> None:
        blocks = [feature(polygon(moved(SQUARE_M, 300.0 * i)), name=f"plot {i}") for i in range(2)]
        with pytest.raises(FieldError, match="holds 2 fields"):
            read(tmp_path, *blocks, feature(point(50, 50), role="obstacle", radius_m=1))
        near = feature(point(350, 50), role="obstacle", radius_m=1, name="near")
        far = feature(point(50, 50), role="obstacle", radius_m=1, name="far")
        assert [one.name for one in read(tmp_path, *blocks, near, far, key="#1").obstacles] == ["near"]

    def test_a_copy_of_the_field_is_none(self, tmp_path: Path) -> None:
        twice = [feature(polygon(SQUARE_M), name=name) for name in "ab"]
        assert read(tmp_path, *twice, key="#a").obstacles == ()

    def test_a_point_with_an_edge_is_not_used_and_named(self, tmp_path: Path) -> None:
        field = with_square(tmp_path, feature(point(0, 0), edge="fence"))
        assert field.remarks[0].startswith("Features of the field file that are not used: 1 Point with edge 'fence'.")

    @pytest.mark.parametrize(("one", "words"), [
        (feature(point(50, 50), role="obstacle"), "of an obstacle of 'plot.geojson' has no 'radius_m'; give it, or"),
        (feature(point(50, 50), role="obstacle", kind="cow"), "obstacle 'cow' of 'plot.geojson' has no 'radius_m'"),
        (feature(line([0, 0], [9, 9]), role="obstacle", kind="pole"), "has no 'width_m'; .*: ditch, "),
        (feature(point(50, 50), role="obstacle", radius_m=-1), "'radius_m' of .* is -1; it must be a number above 0"),
        (feature(point(50, 50), role="obstacle", radius_m=True), "'radius_m' of .* is True"),
        (feature(point(50, 50), role="obstacle", radius_m="2"), "'radius_m' of .* is '2'"),
        (feature(point(50, 50), role="obstacle", radius_m=1e9), "at most 1000"),
        (feature(point(50, 50), role="obstacle", radius_m=math.nan), "must be a number above 0"),
        (feature(line([0, 0]), role="obstacle", width_m=1), "has 1 positions; a LineString needs 2 or more"),
        (feature(line([3, 3], [3, 3]), role="obstacle", width_m=1), "is not a valid LineString"),
        (feature({"type": "MultiPoint"}, role="obstacle", radius_m=1), "A MultiPoint with role obstacle"),
        (feature({"type": "Point"}, role="obstacle", radius_m=1), "is not a pair"),
        (feature(polygon([[0, 0], [9, 9], [9, 0], [0, 9]]), role="obstacle"), "crosses itself"),
    ])  # fmt: skip
    def test_refusals(self, tmp_path: Path, one: Any, words: str) -> None:
        with pytest.raises(FieldError, match=words) as caught:
            with_square(tmp_path, one)
        assert str(caught.value).endswith(".") and "\n" not in str(caught.value)

    @pytest.mark.parametrize("crs", [None, "EPSG:32632"])
    def test_what_is_written_is_read_again(self, tmp_path: Path, crs: str | None) -> None:
        obstacles = (
            Obstacle("pole", shapely.Point(50, 50), 0.4, "P1"),
            Obstacle("ditch", shapely.LineString([(20, 0), (30, 60), (31, 70)]), 0.75),
            Obstacle("pond", shapely.Polygon([(100, 30), (120, 30), (110, 50)])),
        )
        origin_m = (500_000.0, 5_800_000.0) if crs else (0.0, 0.0)
        field = Field("plot", BOX, crs=crs, origin_m=origin_m, obstacles=obstacles)
        write_field(field, tmp_path / "again.geojson")
        again = read_field(tmp_path / "again.geojson")
        assert [(one.kind, one.name) for one in again.obstacles] == [(one.kind, one.name) for one in obstacles]
        for one, other in zip(again.obstacles, obstacles, strict=True):
            assert one.half_width_m == pytest.approx(other.half_width_m, abs=1e-9)
            assert one.geometry.equals_exact(other.geometry, 1e-5)


class TestGroundLeft:
    def test_by_hand(self) -> None:
        """A square pond of 10 m grows to 10.6 m; a strip along the edge takes what lies inside; a pole of 1 m."""
        obstacles = (
            Obstacle("pond", shapely.box(100, 40, 110, 50)),
            Obstacle("ditch", shapely.LineString([(40, 0), (60, 0)]), 1.0),
            Obstacle("pole", shapely.Point(20, 50), 0.7),
        )
        left = Field("f", BOX, obstacles=obstacles).compute_ground_with_margin(0.3)
        expected = 20_000 - 10.6**2 - 1.3 * 22.6 - math.pi
        assert left.workable_region.area == pytest.approx(expected, abs=0.05)
        assert len(left.boundary.interiors) == 2 and left.obstacles == obstacles and left.remarks == ()

    def test_a_margin_is_kept_to_holes_of_the_boundary(self) -> None:
        donut = Field("f", shapely.Polygon(BOX.exterior, [shapely.box(50, 40, 60, 60).exterior.coords]))
        assert donut.compute_ground_with_margin(0.5).workable_region.area == pytest.approx(20_000 - 11 * 21)
        assert donut.compute_ground_with_margin(0.0) is donut

    def test_a_margin_that_takes_nearly_all_is_refused_and_what_it_takes_is_known(self) -> None:
        """A pole in the middle of 200 m by 100 m: 45 m leave it in one piece, 55 m a piece of either side."""
        pole = Field("f", BOX, obstacles=(Obstacle("pole", shapely.Point(100, 50), 0.25),))
        left = pole.compute_ground_with_margin(45.0)
        assert left.cut_off_parts == () and left.area_without_margin_m2 == pytest.approx(
            20_000 - math.pi / 16, abs=0.01
        )
        cut = pole.compute_ground_with_margin(55.0)
        (other,) = cut.cut_off_parts
        assert other.area == cut.cut_off_m2 == pytest.approx(cut.workable_region.area, rel=1e-6)
        with pytest.raises(FieldError, match=r"margin_m.* of 99 m is too wide for field 'f': it leaves"):
            pole.compute_ground_with_margin(99.0)

    def test_without_obstacles_a_field_stays_as_it_is(self) -> None:
        field = Field("f", BOX)
        assert field.compute_ground_with_margin(5.0) is field

    def test_what_is_small_stays_in_the_boundary_and_is_no_ground(self) -> None:
        """12 m across is small under 12.1 m, margin or not; on the edge, or joined to something large, it is not."""
        obstacles = (
            Obstacle("pond", shapely.Point(50, 50).buffer(6.0)),
            Obstacle("pole", shapely.Point(100, 0.5), 0.25),
            Obstacle("pole", shapely.Point(150.6, 50), 0.5),
            Obstacle("ditch", shapely.LineString([(152, 30), (152, 70)]), 0.5),
        )
        field = Field("f", BOX, obstacles=obstacles)
        left = field.compute_ground_with_margin(0.3, 12.1)
        assert (
            len(left.small_obstacles) == 1
            and left.small_obstacles[0].symmetric_difference(obstacles[0].buffer_by(0.3)).area < 1e-3
        )
        assert left.boundary.area - left.workable_region.area == pytest.approx(left.small_obstacles[0].area)
        assert (
            left.workable_region.equals(field.compute_ground_with_margin(0.3).boundary)
            and left.area_m2 > left.workable_region.area
        )
        assert field.compute_ground_with_margin(0.3, 11.9).small_obstacles == ()

    def test_a_small_hole_of_the_boundary_is_driven_round_as_well(self) -> None:
        donut = Field("f", shapely.Polygon(BOX.exterior, [shapely.box(50, 40, 52, 42).exterior.coords]))
        left = donut.compute_ground_with_margin(0.0, 12.0)
        assert (
            left.boundary.equals(BOX)
            and left.workable_region.equals(donut.boundary)
            and left.workable_region.area == 20_000 - 4
        )

    def test_obstacles_that_overlap_count_once(self) -> None:
        ponds = tuple(Obstacle("pond", shapely.box(100 + x, 40, 110 + x, 50)) for x in (0, 4))
        assert Field("f", BOX, obstacles=ponds).compute_ground_with_margin(0.0).area_m2 == pytest.approx(20_000 - 140)

    def test_a_field_cut_in_two_keeps_the_larger_piece_and_says_so(self) -> None:
        ditch = Obstacle("ditch", shapely.LineString([(50, -5), (50, 105)]), 1.0)
        left = Field("f", BOX, obstacles=(ditch,)).compute_ground_with_margin(0.0)
        assert left.workable_region.area == pytest.approx(149 * 100)
        assert left.remarks == ("Obstacles cut off 4900 m2 of the field: no machine gets there from the rest.",)

    @given(
        st.tuples(st.floats(0, 200), st.floats(0, 100)), st.floats(0.1, 10.0), st.floats(0.0, 3.0),
        st.tuples(st.floats(0, 200), st.floats(0, 100)),
    )  # fmt: skip
    def test_the_margin_is_kept(
        self, place: tuple[float, float], size_m: float, margin_m: float, end: tuple[float, float]
    ) -> None:
        obstacles = (Obstacle("pole", shapely.Point(place), size_m),)
        if math.dist(place, end) > 0.1:
            obstacles += (Obstacle("ditch", shapely.LineString([place, end]), size_m / 2.0),)
        left = Field("f", BOX, obstacles=obstacles).compute_ground_with_margin(margin_m)
        for one in obstacles:
            kept = left.boundary.distance(one.geometry) - one.half_width_m
            assert kept > margin_m - 0.006 * (size_m + margin_m), "but for the corners of a circle drawn as a polygon"

    @pytest.mark.parametrize("obstacle", [
        Obstacle("pond", shapely.box(-1, -1, 201, 101)),
        Obstacle("pond", shapely.box(3, 3, 197, 97)),
        Obstacle("mast", shapely.Point(100, 50), 500.0),
    ])  # fmt: skip
    def test_obstacles_that_cover_the_field_are_refused(self, obstacle: Obstacle) -> None:
        with pytest.raises(FieldError, match=r"Obstacles with a margin \(margin_m\) of 4 m leave .* m2 of field 'f'"):
            Field("f", BOX, obstacles=(obstacle,)).compute_ground_with_margin(4.0)

    def test_a_margin_wider_than_the_field_is_refused(self) -> None:
        pole = Obstacle("pole", shapely.Point(100, 50), 0.2)
        with pytest.raises(FieldError, match=r"\(margin_m\) of 120 m leave 0 m2 .* use a margin of [\d.]+ m") as caught:
            Field("f", BOX, obstacles=(pole,)).compute_ground_with_margin(120.0)
        assert caught.value.parameter == "margin_m"
        with pytest.raises(
            FieldError, match=r"\(margin_m\) is 100 m, but field 'f' is only 100 m across; use less than 50 m"
        ):
            Field("f", BOX).compute_ground_with_margin(100.0)

    @pytest.mark.parametrize("margin_m", [-0.1, math.nan, math.inf])
    def test_a_margin_that_is_none_is_refused(self, margin_m: float) -> None:
        with pytest.raises(FieldError, match="it must be 0 or more"):
            Field("f", BOX).compute_ground_with_margin(margin_m)

    @pytest.mark.parametrize(("geometry", "half_m", "words"), [
        (shapely.MultiPoint([(0, 0), (1, 1)]), 1.0, "is a MultiPoint; give a Point"),
        (shapely.Point(), 1.0, "not a valid Point"),
        (shapely.Point(0, 0), 0.0, "use 0.001 to 1000 m"),
        (shapely.Point(0, 0), math.nan, "use 0.001 to 1000 m"),
        (shapely.Polygon([(0, 0), (1, 1), (1, 0), (0, 1)]), 0.0, "not a valid Polygon"),
    ])  # fmt: skip
    def test_an_obstacle_that_is_none(self, geometry: Any, half_m: float, words: str) -> None:
        with pytest.raises(FieldError, match=words):
            Obstacle("thing", geometry, half_m)
