"""Columns in steps: which are told apart from what merely stands still."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.identification.analytic_drives import circle, log
from tests.identification.log_tables import refusal
from vehicle.identification.logs.column_quality import drop_columns_coarse_elsewhere, find_rounding_step


@given(
    steps=st.lists(st.integers(-9, 9), min_size=60, max_size=90), step=st.floats(0.01, 5.0), shift=st.floats(-1e3, 1e3)
)
def test_the_step_is_one_that_all_values_are_multiples_of(steps: list[int], step: float, shift: float) -> None:
    found = find_rounding_step(np.array(steps) * step + shift)
    whole = found / step
    assert found == 0.0 or (abs(whole - round(whole)) < 0.01 and round(whole) >= 1)
    changes = np.count_nonzero(np.diff(steps, 2))
    if {0, 1} <= set(steps):
        assert found == (pytest.approx(step, rel=1e-4) if changes >= 20 else 0.0)


def test_values_of_any_size_and_few_values_have_none() -> None:
    assert find_rounding_step(np.array([0.0, 1.0, 2.0])) == 0.0 and find_rounding_step(np.full(90, 2.0)) == 0.0
    assert find_rounding_step(np.random.default_rng(3).normal(size=500)) == 0.0


def test_an_even_motion_is_no_step() -> None:
    time = np.arange(400) / 10.0
    way = np.interp(time, [0.0, 10.0, 15.0, 40.0], [0.0, 7.5, 7.5, 26.25])
    assert find_rounding_step(way) == 0.0 and find_rounding_step(90.0 + 4.0 * time) == 0.0
    assert find_rounding_step(np.round(way / 0.3) * 0.3) == pytest.approx(0.3)


def test_a_heading_in_compass_points_counts_as_not_logged() -> None:
    frame = circle(0.1)
    told = log(frame.assign(heading_deg=(frame.heading_deg / 5.0).round() * 5.0))
    assert told.heading_deg is None and told.coarse_columns == {"heading_deg": pytest.approx(5.0)}
    said = "heading_deg comes in steps of 5 degrees, too coarse to be of use; the column is ignored"
    assert told.corrections == (said,)
    assert log(frame.assign(heading_deg=frame.heading_deg.round())).heading_deg is not None


def test_a_speed_in_whole_kilometres_per_hour_counts_as_not_logged() -> None:
    frame = circle(0.05)
    said = (1.5 + 0.5 * np.sin(0.3 * frame.time_s) + np.random.default_rng(3).normal(0.0, 0.1, 200)) * 3.6
    assert log(frame.assign(speed_mps=said.round() / 3.6)).speed_mps is None
    fine = log(frame.assign(speed_mps=said.round(1) / 3.6))
    assert fine.speed_mps is not None and not fine.corrections


def test_starting_and_stopping_at_once_is_no_coarse_speed() -> None:
    frame = circle(0.05, seconds=120.0)
    driven = np.where(frame.time_s % 10.0 < 8.0, 1.5, 0.0)
    told = log(frame.assign(speed_mps=driven))
    assert told.speed_mps is not None and not told.coarse_columns


def test_positions_in_half_metres_are_refused() -> None:
    frame = circle(0.05)
    places = {name: (2.0 * frame[name]).round() / 2.0 for name in ("easting_m", "northing_m")}
    assert refusal(lambda: log(frame.assign(**places))) == (
        "run: easting_m comes in steps of 0.5 m, too coarse to show how a tractor steers; log positions with more "
        "digits, to 0.01 m or better."
    )
    assert not log(frame.round({"easting_m": 1, "northing_m": 1})).corrections


def test_the_same_compass_is_left_out_where_it_stood_on_one_point() -> None:
    frame, straight = circle(0.1), circle(0.0, bearing_deg=90.0)
    coarse = log(frame.assign(heading_deg=(frame.heading_deg / 5.0).round() * 5.0), "bend")
    still, fine = log(straight, "still"), log(circle(0.03), "fine")
    one, two, three = drop_columns_coarse_elsewhere([coarse, still, fine])
    assert one is coarse and three is fine
    assert two.heading_deg is None and "heading_deg comes in steps of 5 degrees, as in bend," in two.corrections[0]
    assert drop_columns_coarse_elsewhere([still, fine]) == [still, fine]


def test_directions_of_a_square_field_are_no_coarse_compass() -> None:
    turned = np.repeat([0.0, 90.0, 180.0, 270.0], 50)
    assert log(circle(0.05), heading_deg=turned).heading_deg is not None
