"""Conversions of units and axes: numbers worked out by hand, and places on the ellipsoid."""

import math

import numpy as np
import pytest

from tests.identification.analytic_drives import circle, log
from tests.identification.log_tables import refusal
from vehicle.identification.logs.readings import LogConvention, convert_columns, convert_log, find_first_place

BY_HAND = {
    LogConvention.TIME_MS: ("time_s", 1500.0, 1.5),
    LogConvention.TIME_US: ("time_s", 2.5e6, 2.5),
    LogConvention.TIME_NS: ("time_s", 3.5e9, 3.5),
    LogConvention.POSITION_KM: ("easting_m", 0.25, 250.0),
    LogConvention.POSITION_FEET: ("easting_m", 100.0, 30.48),
    LogConvention.SPEED_KMH: ("speed_mps", 18.0, 5.0),
    LogConvention.SPEED_MEASURED_KMH: ("speed_mps", 18.0, 5.0),
    LogConvention.SPEED_COMMAND_KMH: ("speed_command_mps", 18.0, 5.0),
    LogConvention.SPEED_MPH: ("speed_mps", 10.0, 4.4704),
    LogConvention.SPEED_MEASURED_MPH: ("speed_mps", 10.0, 4.4704),
    LogConvention.SPEED_COMMAND_MPH: ("speed_command_mps", 10.0, 4.4704),
    LogConvention.SPEED_KNOTS: ("speed_mps", 9.0, 4.63),
    LogConvention.SPEED_MEASURED_KNOTS: ("speed_mps", 9.0, 4.63),
    LogConvention.SPEED_COMMAND_KNOTS: ("speed_command_mps", 9.0, 4.63),
    LogConvention.HEADING_RADIANS: ("heading_deg", math.pi / 2, 90.0),
    LogConvention.HEADING_CCW_EAST: ("heading_deg", 30.0, 60.0),
    LogConvention.HEADING_CCW_NORTH: ("heading_deg", 30.0, 330.0),
    LogConvention.HEADING_REVERSED: ("heading_deg", 270.0, 90.0),
    LogConvention.STEERING_RADIANS: ("steering_deg", 0.1, math.degrees(0.1)),
    LogConvention.STEERING_LEFT: ("steering_command_deg", 7.0, -7.0),
    LogConvention.IMPLEMENT_REVERSED: ("implement", 1.0, 0.0),
    LogConvention.ROLL_LEFT: ("roll_deg", 3.0, -3.0),
}


@pytest.mark.parametrize("fix", BY_HAND)
def test_one_number_by_hand(fix: LogConvention) -> None:
    column, given, meant = BY_HAND[fix]
    columns = {"roll_deg": np.array([3.0]), "pitch_deg": np.array([2.0]), column: np.array([given])}
    if column == "easting_m":
        columns["northing_m"] = np.array([1.0])
    result = convert_columns(columns, frozenset({fix}))
    assert result[column] == pytest.approx([meant]) and result["pitch_deg"] == [2.0]
    assert columns[column] == [given], "what is given stays as it is"


def test_every_fix_is_tried() -> None:
    swaps = {LogConvention.EAST_NORTH_SWAPPED, LogConvention.STEERING_SWAPPED}
    assert set(LogConvention) == {*BY_HAND, *swaps, LogConvention.POSITION_DEGREES}


def test_swapped_steering_columns_are_exchanged_before_their_unit_is_converted() -> None:
    columns = {"steering_command_deg": np.array([0.1]), "steering_deg": np.array([0.2])}
    fixes = frozenset({LogConvention.STEERING_SWAPPED, LogConvention.STEERING_RADIANS})
    result = convert_columns(columns, fixes)
    assert result["steering_command_deg"] == pytest.approx([math.degrees(0.2)])
    assert result["steering_deg"] == pytest.approx([math.degrees(0.1)])
    del columns["steering_deg"]
    assert "steering_deg is not logged" in refusal(lambda: convert_columns(columns, fixes))


def test_swapped_axes_are_exchanged_before_degrees_become_metres() -> None:
    """One degree on the WGS 84 ellipsoid at the equator: 111319.49 m to the east, 110574.28 m to the north."""
    columns = {"easting_m": np.array([0.0, 1.0]), "northing_m": np.array([10.0, 11.0])}
    result = convert_columns(
        columns, frozenset({LogConvention.EAST_NORTH_SWAPPED, LogConvention.POSITION_DEGREES}), (10.0, 0.0)
    )
    assert result["easting_m"] == pytest.approx([0.0, 111319.49], abs=0.01)
    assert result["northing_m"] == pytest.approx([0.0, 110574.28], abs=0.01)


def test_the_first_position_is_the_first_that_is_known() -> None:
    columns = {"easting_m": np.array([np.nan, 3.0, 5.0]), "northing_m": np.array([1.0, 4.0, 6.0])}
    assert find_first_place(columns) == (3.0, 4.0)


def test_places_off_the_globe_are_refused() -> None:
    columns = {"easting_m": np.array([500.0, 501.0]), "northing_m": np.array([700.0, 701.0])}
    assert "not a longitude and latitude" in refusal(
        lambda: convert_columns(columns, frozenset({LogConvention.POSITION_DEGREES}))
    )


def test_a_log_is_fixed_in_all_its_columns_and_back() -> None:
    one = log(circle(0.1), steering_command_deg=4.0)
    other = convert_log(one, LogConvention.STEERING_LEFT)
    assert other.steering_deg is not None and other.steering_command_deg is not None
    assert (other.steering_deg == -10.0).all() and (other.steering_command_deg == -4.0).all()
    again = convert_log(other, LogConvention.STEERING_LEFT)
    assert np.array_equal(again.steering_deg, one.steering_deg) and np.array_equal(other.easting_m, one.easting_m)
