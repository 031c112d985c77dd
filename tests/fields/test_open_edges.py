"""How far machines may reach over open edges, as files say it, and the ground that this gives."""

import math
from pathlib import Path
from typing import Any

import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from fields import Field, FieldError, read_field, write_field
from fields.geometry.field_lines import EdgeOverhang, compute_overhang_region
from tests.drawn_fields import feature
from tests.fields.geojson import SQUARE_M, polygon
from tests.fields.test_obstacles import line, read, with_square

BOX = shapely.box(0, 0, 200, 100)
SOUTH = shapely.LineString([(0, 0), (200, 0)])
QUARTER_M2 = math.pi / 4


def test_region_reaches_as_far_over_every_edge() -> None:
    region = compute_overhang_region(BOX, (), (), 0.5)
    assert region.area == pytest.approx(200 * 100 + 600 * 0.5 + 4 * QUARTER_M2 * 0.25, abs=0.05)
    assert compute_overhang_region(BOX, (), (), 0.0).equals(BOX)


def test_nothing_reaches_over_a_fence() -> None:
    region = compute_overhang_region(BOX, (SOUTH,), (), 0.5)
    assert not region.intersects(shapely.Point(100, -0.02)) and region.covers(shapely.Point(100, 100.49))


def test_an_edge_may_allow_more_or_less() -> None:
    north = shapely.LineString([(0, 100), (200, 100)])
    region = compute_overhang_region(BOX, (), (EdgeOverhang(SOUTH, 0.0), EdgeOverhang(north, 2.0)), 0.5)
    assert not region.intersects(shapely.Point(100, -0.02))
    assert region.covers(shapely.Point(100, 101.9)) and not region.intersects(shapely.Point(100, 102.1))
    assert region.covers(shapely.Point(-0.49, 50)) and not region.intersects(shapely.Point(-0.52, 50))


def test_the_later_of_two_holds() -> None:
    overhangs = EdgeOverhang(shapely.LineString(BOX.exterior), 3.0), EdgeOverhang(SOUTH, 1.0)
    region = compute_overhang_region(BOX, (), overhangs, 0.5)
    assert region.covers(shapely.Point(100, -0.9)) and not region.intersects(shapely.Point(100, -1.1))
    assert region.covers(shapely.Point(100, 102.9))


def test_ground_behind_an_edge_is_limited_by_that_edge() -> None:
    """The field is 200 m by 100 m; 30 m over the east edge, half a metre over all others, nothing over the fence."""
    east, north = shapely.LineString([(200, 0), (200, 100)]), shapely.LineString([(0, 100), (200, 100)])
    region = compute_overhang_region(BOX, (north,), (EdgeOverhang(east, 30.0),), 0.5)
    strips_m2 = 30 * 100 + 0.5 * (200 + 100) + QUARTER_M2 * 0.25
    corners_m2 = 2 * QUARTER_M2 * 30**2  # beyond the ends of the east edge, up to what is square to its neighbours
    # Two quarters of a circle, each of four chords: 2 % less than round.
    assert region.area == pytest.approx(200 * 100 + strips_m2 + 0.9745 * corners_m2, abs=1.0)
    places = [(215, -15), (199, -0.4), (215, 115), (199, -1), (190, -20), (199, 100.3), (-1, 50)]
    assert [region.intersects(shapely.Point(place)) for place in places] == [True, True, True, *[False] * 4]


def test_edges_are_opened_once_but_for_their_own_overhang_and_fences() -> None:
    ditch = EdgeOverhang(SOUTH, 0.0)
    west = shapely.LineString([(0, 0), (0, 100)])
    field = Field("square", BOX, fences=(west,), edge_overhangs=(ditch,))
    opened = field.open_edges()
    assert opened.open_edges() == opened != field
    region = opened.compute_overhang_region(0.5)
    places = [(100, 199), (299, 50), (100, -0.1), (-0.1, 50)]
    assert [region.intersects(shapely.Point(place)) for place in places] == [True, True, False, False]


def test_the_far_side_of_a_narrow_field_is_not_behind_an_edge() -> None:
    """Over the north edge 3 m are allowed where 0 are over the south one, 2 m away."""
    strip = shapely.box(0, 0, 200, 2)
    region = compute_overhang_region(strip, (SOUTH,), (), 3.0)
    assert region.intersects(shapely.Point(100, 4.9)) and not region.intersects(shapely.Point(100, -0.1))


@given(less=st.floats(0, 3), more=st.floats(0, 3))
def test_more_overhang_never_takes_ground(less: float, more: float) -> None:
    less, more = sorted((less, more))
    small, large = (compute_overhang_region(BOX, (), (EdgeOverhang(SOUTH, 1.0),), metres) for metres in (less, more))
    assert small.difference(large).area < 0.02


def test_files_say_it_of_an_edge_and_of_the_boundary(tmp_path: Path) -> None:
    field = with_square(tmp_path, feature(line([0, 0], [200, 0]), edge="open", overhang_m=2))
    (one,) = field.edge_overhangs
    assert one.overhang_m == 2.0 and one.part.length == pytest.approx(200, abs=7), "the ends of its neighbours belong"
    field = read(tmp_path, feature(polygon(SQUARE_M), overhang_m=1.5))
    assert [(each.overhang_m, each.part.length) for each in field.edge_overhangs] == [(1.5, pytest.approx(600))]


def test_it_survives_writing(tmp_path: Path) -> None:
    lines = (feature(line([0, 0], [200, 0]), edge="open", overhang_m=2), feature(line([0, 0], [0, 99]), edge="fence"))
    field = with_square(tmp_path, *lines)
    write_field(field, tmp_path / "again.geojson")
    again = read_field(tmp_path / "again.geojson", local=True)
    regions: list[Any] = [each.compute_overhang_region(0.5) for each in (field, again)]
    assert regions[0].symmetric_difference(regions[1]).area < 0.1
    assert [each.overhang_m for each in again.edge_overhangs] == [2.0]


@pytest.mark.parametrize("value", [-1, "wide", True, 1e9])
def test_a_senseless_overhang_is_refused(tmp_path: Path, value: Any) -> None:
    with pytest.raises(FieldError, match=r"'overhang_m' of a line of .* must be 0 to 100 m"):
        with_square(tmp_path, feature(line([0, 0], [200, 0]), edge="open", overhang_m=value))


def test_a_fence_allows_none(tmp_path: Path) -> None:
    with pytest.raises(FieldError, match="belongs to a fence, over which nothing may reach"):
        with_square(tmp_path, feature(line([0, 0], [200, 0]), edge="fence", overhang_m=1))


def test_the_outline_before_the_margin_counts() -> None:
    field = Field("square", BOX, fences=(SOUTH,), entrance=(0.0, 50.0)).compute_ground_with_margin(1.0)
    assert field.compute_overhang_region(0.5).covers(shapely.Point(100, 0.1))
