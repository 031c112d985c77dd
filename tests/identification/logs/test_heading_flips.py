"""Headings that turn round between two rows are left out where path and gear say which side of the flips is wrong."""

import numpy as np
import pandas as pd
import pytest

from tests.identification.analytic_drives import backwards, circle, joined
from vehicle.identification.errors import LogError
from vehicle.identification.logs.directions import HEADING_FLIPPED, find_flipped_headings, find_wrong_gear
from vehicle.identification.logs.reader import build_log
from vehicle.identification.logs.schema import Columns

ROUND = joined(circle(0.03, 30.0), circle(-0.03, 30.0, bearing_deg=np.degrees(1.35)))
SPAN = slice(120, 170)


def turn_round(frame: pd.DataFrame, rows: slice) -> pd.DataFrame:
    heading = frame["heading_deg"].to_numpy(copy=True)
    heading[rows] = np.mod(heading[rows] + 180.0, 360.0)
    return frame.assign(heading_deg=heading)


def get_columns(frame: pd.DataFrame) -> Columns:
    return {str(name): values.to_numpy(float) for name, values in frame.items()}


def test_rows_between_two_flips_are_left_out_and_told() -> None:
    log = build_log(turn_round(ROUND, SPAN), "run")
    (gated,) = log.gated
    assert gated.rule == HEADING_FLIPPED and gated.rows == 50 and gated.first_line == 122
    assert find_wrong_gear(log) is None and build_log(ROUND, "run").gated == ()


@pytest.mark.parametrize("rows", [slice(0, 60), slice(len(ROUND) - 60, None), slice(120, 121)])
def test_a_flip_at_an_end_or_of_one_row_needs_no_second_one(rows: slice) -> None:
    flipped = find_flipped_headings(get_columns(turn_round(ROUND, rows)))
    assert flipped.tolist() == list(range(len(ROUND)))[rows]


def test_a_row_between_both_sides_is_left_out_too() -> None:
    frame = turn_round(ROUND, SPAN)
    frame.loc[119, "heading_deg"] = (frame.loc[118, "heading_deg"] + 90.0) % 360.0
    assert find_flipped_headings(get_columns(frame)).tolist() == list(range(119, 170))


def test_a_value_held_before_a_flip_is_left_out_too() -> None:
    """Between it and the next measured one the heading would be interpolated through the half circle."""
    frame = turn_round(ROUND, SPAN)
    frame.loc[116:119, "heading_deg"] = frame.loc[116, "heading_deg"]
    assert find_flipped_headings(get_columns(frame)).tolist() == list(range(117, 170))


def drive_there_and_back() -> pd.DataFrame:
    """A bend forward, and back in reverse, with headings where the tractor points."""
    there = circle(0.03, 30.0).assign(shuttle=1)
    back = backwards(there).assign(time_s=there["time_s"] + 30.0)
    return pd.concat([there, back], ignore_index=True)


def test_a_course_over_ground_that_turns_round_in_reverse_is_left_to_its_own_check() -> None:
    """The headings that point backwards are those in reverse, all of them; a flip in some of them is another matter."""
    frame = drive_there_and_back()
    assert not len(find_flipped_headings(get_columns(turn_round(frame, slice(300, 600)))))
    assert len(find_flipped_headings(get_columns(turn_round(frame, slice(400, 500))))) == 100


def test_where_the_gear_is_not_logged_nothing_is_left_out_and_the_refusal_names_both_readings() -> None:
    """Half of the drive contradicts the gear without any flip, so path and gear do not decide about the flips."""
    frame = turn_round(drive_there_and_back(), slice(100, 200)).assign(shuttle=1)
    assert not len(find_flipped_headings(get_columns(frame)))
    with pytest.raises(
        LogError, match=r"write -1 in those rows, or leave heading_deg out .* 2 times, first in line 102"
    ):
        build_log(frame, "run")
