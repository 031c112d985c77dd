"""Parts of a field between which machines cannot drive: their number, their ground, and the necks, by hand."""

import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from fields import Field, FieldError
from fields.geometry.field_parts import cut_field_part, list_field_parts
from fields.geometry.obstacles import Obstacle
from tests.examples import count_examples

DITCH = Obstacle("ditch", shapely.LineString([(-5, 90), (205, 90)]), 0.75)
DIVIDED = Field("divided", shapely.box(0, 0, 200, 200), obstacles=(DITCH,))


def join_by_lane(width_m: float) -> Field:
    """Two squares of one hectare, joined by a lane of a width."""
    lane = shapely.box(100, 50 - 0.5 * width_m, 140, 50 + 0.5 * width_m)
    return Field("lane", shapely.union_all([shapely.box(0, 0, 100, 100), lane, shapely.box(140, 0, 240, 100)]))


def test_a_ditch_leaves_two_parts_and_no_way() -> None:
    """The ditch and a margin of 0.3 m take 2.1 m: 88.95 and 108.95 m of the 200 remain, the larger first."""
    large, small = list_field_parts(DIVIDED, 0.3, 6.0)
    assert large.region.area == pytest.approx(200.0 * 108.95) and large.neck is None
    assert small.region.area == pytest.approx(200.0 * 88.95)
    assert small.neck is not None and small.neck.width_m == 0.0 and small.neck.y_m == pytest.approx(90.0)


@settings(max_examples=count_examples(20))
@given(st.floats(2.5, 12.0))
def test_a_lane_is_as_wide_as_it_is(width_m: float) -> None:
    field = join_by_lane(width_m)
    assert len(list_field_parts(field, 0.0, 0.9 * width_m)) == 1
    _, beyond = list_field_parts(field, 0.0, 1.1 * width_m)
    assert beyond.neck is not None and beyond.neck.width_m == pytest.approx(width_m, abs=0.06)
    assert 100.0 <= beyond.neck.x_m <= 140.0 and beyond.neck.y_m == pytest.approx(50.0, abs=width_m)


def test_a_part_is_a_field_of_its_own() -> None:
    part = cut_field_part(DIVIDED, 0.3, 6.0, 2)
    assert part.boundary.area == pytest.approx(200.0 * 88.95) and part.name == "divided, part 2"
    whole = join_by_lane(8.0)
    assert cut_field_part(whole, 0.0, 6.0, 1) is whole
    with pytest.raises(FieldError, match=r"has 2 parts for machines 6 m wide, so there is no part .* 3; use 1 to 2"):
        cut_field_part(DIVIDED, 0.3, 6.0, 3)


def test_an_entrance_stays_with_its_part() -> None:
    field = Field("divided", shapely.box(0, 0, 200, 200), obstacles=(DITCH,), entrance=(0.0, 150.0))
    assert cut_field_part(field, 0.3, 6.0, 1).entrance == (0.0, 150.0)
    assert cut_field_part(field, 0.3, 6.0, 2).entrance is None
