"""The field value: areas, ground, positions on the earth, refusals."""

import dataclasses

import numpy as np
import pytest
import shapely
from pyproj import Geod

from fields import Field, FieldError, GroundZone, read_field
from fields.geometry.geodesy import find_utm_crs


def test_area_leaves_out_the_obstacles() -> None:
    field = Field("a", shapely.box(0, 0, 200, 100).difference(shapely.box(50, 40, 60, 60)))
    assert field.area_m2 == pytest.approx(20_000 - 200)
    assert field.area_ha == pytest.approx(1.98)


def test_boundary_is_turned_counter_clockwise_and_holes_clockwise() -> None:
    ring, hole = [(0, 0), (0, 50), (50, 50), (50, 0)], [(10, 10), (20, 10), (20, 20), (10, 20)]
    field = Field("a", shapely.Polygon(ring, [hole]))
    assert field.boundary.exterior.is_ccw
    assert not field.boundary.interiors[0].is_ccw


@pytest.mark.parametrize(
    "shape",
    [
        shapely.Polygon(),
        shapely.Polygon([(0, 0), (10, 10), (10, 0), (0, 10)]),
        shapely.MultiPolygon([shapely.box(0, 0, 1, 1)]),
        shapely.LineString([(0, 0), (1, 1)]),
    ],
)
def test_outline_that_is_not_one_valid_polygon_is_refused(shape: shapely.Geometry) -> None:
    with pytest.raises(FieldError, match="outline of field 'a'"):
        Field("a", shape)


def test_first_ground_zone_wins_and_edges_belong_to_it() -> None:
    zones = (GroundZone("asphalt", shapely.box(0, 0, 10, 10)), GroundZone("mud", shapely.box(5, 0, 20, 10)))
    field = Field("a", shapely.box(0, 0, 100, 100), ground_zones=zones, default_ground="grass")
    assert [field.find_ground_at(x, 5) for x in (5, 10, 10.001, 20, 20.001)] == [
        "asphalt",
        "asphalt",
        "mud",
        "mud",
        "grass",
    ]


def test_ground_zone_without_a_name_is_refused() -> None:
    with pytest.raises(FieldError, match="empty name"):
        GroundZone(" ", shapely.box(0, 0, 1, 1))


def test_field_is_frozen_and_can_be_compared() -> None:
    one, same = Field("a", shapely.box(0, 0, 50, 50)), Field("a", shapely.box(0, 0, 50, 50))
    assert one == same
    assert one != dataclasses.replace(one, default_ground="mud")
    with pytest.raises(dataclasses.FrozenInstanceError):
        one.name = "b"  # type: ignore[misc]


def test_local_metres_have_no_place_on_the_earth() -> None:
    with pytest.raises(FieldError, match="without a place on the earth"):
        read_field("iwamizawa").to_wgs84([[0.0, 0.0]])


def test_points_must_be_pairs() -> None:
    with pytest.raises(FieldError, match=r"shape \(3,\)"):
        read_field("denmark").to_wgs84([1.0, 2.0, 3.0])


def test_no_points_give_no_positions() -> None:
    assert read_field("denmark").to_wgs84(np.empty((0, 2))).shape == (0, 2)


@pytest.mark.parametrize("name", ["denmark", "netherlands", "sweden"])
def test_distances_agree_with_the_ellipsoid(name: str) -> None:
    """Grid lengths differ from those on the WGS84 ellipsoid by the UTM scale, 0.9996 to 1.001."""
    field = read_field(name)
    xy = np.array(field.boundary.minimum_rotated_rectangle.exterior.coords)[:2]
    (lon_a, lat_a), (lon_b, lat_b) = field.to_wgs84(xy)
    _, _, true_m = Geod(ellps="WGS84").inv(lon_a, lat_a, lon_b, lat_b)
    assert 0.9995 < np.hypot(*(xy[1] - xy[0])) / true_m < 1.001


@pytest.mark.parametrize(
    ("longitude", "latitude", "expected"),
    [
        (141.76, 43.2, "EPSG:32654"),
        (-180.0, 10.0, "EPSG:32601"),
        (180.0, 10.0, "EPSG:32601"),
        (179.999, -10.0, "EPSG:32760"),
        (0.0, 51.0, "EPSG:32631"),
        (-0.001, 51.0, "EPSG:32630"),
        (6.0, 0.0, "EPSG:32632"),
        (-58.4, -34.6, "EPSG:32721"),
        (186.0, 5.0, "EPSG:32602"),
    ],
)
def test_utm_zone(longitude: float, latitude: float, expected: str) -> None:
    assert find_utm_crs(longitude, latitude) == expected


@pytest.mark.parametrize("latitude", [84.5, -80.5])
def test_no_utm_at_the_poles(latitude: float) -> None:
    with pytest.raises(FieldError, match="outside the UTM range"):
        find_utm_crs(20.0, latitude)
