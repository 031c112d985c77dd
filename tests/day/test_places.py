"""Where fields are and how far apart."""

import math
from dataclasses import replace

import numpy as np
import pytest

from fields import read_field
from planner.day.input_file import DayRoad, parse_day
from planner.day.places import DayPlace, compute_road_km, locate_fields, locate_yard, project_places
from planner.day.planning import prepare_day
from planner.errors import RequestError
from planner.farm.settings import read_example_text

LENGTH_M = 2.0 * math.pi * 6_378_137.0 / 360.0  # of a degree along the equator


def test_straight_lines_times_a_factor_and_roads_that_are_given() -> None:
    day, _ = parse_day(read_example_text("day").replace('"polder"]', '"long"]'), "day.toml")
    places = (DayPlace("long", (0.0, 0.0)), DayPlace("polder", (1.0, 0.0)), DayPlace("yard", (0.0, 0.0)))
    km = compute_road_km(day, places, 1.3)
    assert km[0, 1] == km[1, 0] == pytest.approx(1.3 * LENGTH_M / 1000.0, rel=1e-6)
    assert km[0, 2] == km[2, 0] == 3.4, "as given, though they are one place"
    assert np.diag(km).tolist() == [0.0] * 3


def test_a_yard_that_nobody_drives_to_is_refused() -> None:
    """A slip of the degrees: two degrees along the equator are 223 km; a road that is given says better."""
    places = (DayPlace("long", (0.0, 0.0)), DayPlace("yard", (2.0, 0.0)))
    day = parse_day(read_example_text("day"), "day.toml")[0].model_copy(update={"roads": ()})
    with pytest.raises(
        RequestError, match=r"yard of the day is 223 km from field 'long' .* at most 200 km are allowed"
    ):
        compute_road_km(day, places, 1.3)
    given = day.model_copy(update={"roads": (DayRoad(between=("yard", "long"), km=230.0),)})
    assert compute_road_km(given, places, 1.3)[0, 1] == 230.0
    near = (DayPlace("long", (0.0, 0.0)), DayPlace("yard", (1.79, 0.0)))
    assert compute_road_km(day, near, 1.0)[0, 1] == pytest.approx(1.79 * LENGTH_M / 1000.0, rel=1e-6)


def test_fields_are_where_they_are_or_where_they_are_put() -> None:
    day, farm = parse_day(read_example_text("day"), "day.toml")
    found = locate_fields(day, [read_field(each.file, name=each.name) for each in day.fields])
    assert [spot.name for spot in found] == ["long", "polder", "slope"]
    assert found[0].lon_lat == (4.6, 52.13) and found[2].lon_lat == (4.53, 52.09)
    own = read_field("netherlands")
    assert found[1].lon_lat is not None
    inside = own.to_wgs84(np.asarray(own.boundary.exterior.coords))
    assert (inside.min(axis=0) < found[1].lon_lat).all() and (found[1].lon_lat < inside.max(axis=0)).all()
    yard = locate_yard(day, farm)
    assert yard is not None and yard.lon_lat == (4.55, 52.11), "that of the day before that of the farm"


def test_a_field_called_like_the_yard_is_refused_also_if_its_file_names_it() -> None:
    day, _ = parse_day(read_example_text("day"), "day.toml")
    fields = [read_field(each.file, name=each.name) for each in day.fields]
    with pytest.raises(RequestError, match="is called 'yard', which is the name of the yard"):
        locate_fields(day, [*fields[:2], replace(fields[2], name="yard")])


def test_the_map_is_in_metres_with_north_up() -> None:
    shown = project_places(
        (DayPlace("a", (9.0, 56.0)), DayPlace("b", None), DayPlace("c", (9.0, 56.01)), DayPlace("d", (9.01, 56.0)))
    )
    a, b, c, d = shown
    assert b is None and a is not None and c is not None and d is not None
    assert c[1] - a[1] == pytest.approx(1114.0, abs=3.0) and c[0] == pytest.approx(a[0], abs=1.0)
    assert d[0] - a[0] == pytest.approx(LENGTH_M * 0.01 * math.cos(math.radians(56.0)), rel=0.003)
    assert project_places((DayPlace("b", None),)) == [None]


def test_without_a_yard_the_day_begins_at_a_field() -> None:
    text = read_example_text("day").replace("[yard]\nlon = 4.55\nlat = 52.11\n", "").replace('farm = "example"', "")
    text = text[: text.index("[[fleets]]")] + '[[fleets]]\nname = "one"\n'
    ready = prepare_day(*parse_day(text, "day.toml"))
    assert locate_yard(ready.day, ready.farm) is None and len(ready.places) == 3
    assert ready.road_km[3].tolist() == [0.0] * 4 and ready.road_km[0, 1] > 1.0
