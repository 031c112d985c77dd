"""Which rows of a log are driven in one gear without a gap, row by row."""

import numpy as np
import pytest

from fields.arrays import Integers
from tests.identification.analytic_drives import circle, log
from vehicle.identification.logs.schema import COLUMNS, SHORTEST_SEGMENT_S, Log, split_drive_segments


def rows_of(one: Log) -> tuple[list[list[int]], list[list[int]]]:
    long, short = split_drive_segments(one)
    return list_ends(long), list_ends(short)


def list_ends(parts: list[Integers]) -> list[list[int]]:
    """First and last row and number of rows of each part."""
    return [[int(part[0]), int(part[-1]), len(part)] for part in parts]


def test_a_drive_without_a_gap_is_one_stretch() -> None:
    assert rows_of(log(circle(0.1))) == ([[0, 199, 200]], [])


@pytest.mark.parametrize(("rows", "long"), [(51, True), (50, False)])
def test_the_shortest_segment_lasts_five_seconds(rows: int, long: bool) -> None:
    assert SHORTEST_SEGMENT_S == 5.0
    result = rows_of(log(circle(0.1).iloc[:rows]))
    assert result == (([[0, rows - 1, rows]], []) if long else ([], [[0, rows - 1, rows]]))


def test_few_rows_left_out_are_no_gap_and_many_are() -> None:
    east = circle(0.0).easting_m.to_numpy(copy=True)
    east[60:63] = np.nan
    assert rows_of(log(circle(0.0), easting_m=east)) == ([[0, 199, 197]], [])
    east[60:80] = np.nan
    assert rows_of(log(circle(0.0), easting_m=east)) == ([[0, 59, 60], [80, 199, 120]], [])


def test_a_change_of_gear_ends_a_stretch() -> None:
    gear = np.ones(200)
    gear[60:130], gear[160] = -1.0, 0.0
    long, short = [[0, 59, 60], [60, 129, 70]], [[130, 159, 30], [161, 199, 39]]
    assert rows_of(log(circle(0.0), shuttle=gear)) == (long, short)


def test_a_gear_changed_in_rows_left_out_ends_a_segment_and_one_not_told_does_not() -> None:
    gear, east = np.full(200, -1.0), circle(0.0).easting_m.to_numpy(copy=True)
    gear[100:103] = np.nan
    assert rows_of(log(circle(0.0), shuttle=gear)) == ([[0, 199, 197]], [])
    gear[101], east[101] = 1.0, np.nan
    assert rows_of(log(circle(0.0), shuttle=gear, easting_m=east)) == ([[0, 99, 100], [103, 199, 97]], [])


def test_a_log_has_every_column_of_the_contract_or_none() -> None:
    one = log(circle(0.0))
    absent = {name for name in COLUMNS if getattr(one, name) is None}
    assert absent == {"speed_command_mps", "steering_command_deg", "roll_deg", "pitch_deg", "elevation_m"}
    assert (one.shuttle == 1.0).all() and (one.implement == 0.0).all()
    assert one.step_s == pytest.approx(0.1) and one.segment_count == 1 and one.rows_gated == 0
