"""Headings, gears and steering against the course of circles and lines whose course is known."""

import math

import numpy as np
import pandas as pd
import pytest

from tests.identification.analytic_drives import circle, joined, log
from vehicle.identification.logs.directions import (
    compute_heading_agreements,
    drop_course_heading,
    find_direction_errors,
    find_wrong_gear,
)
from vehicle.identification.logs.motion import compute_path_chords
from vehicle.identification.logs.readings import LogConvention
from vehicle.identification.logs.schema import Mask

ROUND = joined(circle(0.1), circle(-0.1), circle(0.05))


@pytest.mark.parametrize("off_deg", [0.0, 25.0, 60.0])
def test_agreement_is_the_cosine_of_what_the_heading_is_off(off_deg: float) -> None:
    one = log(ROUND)
    chords = compute_path_chords(one)
    assert chords is not None and one.heading_deg is not None
    fits = compute_heading_agreements(one, chords, one.heading_deg + off_deg)
    assert fits[None] == pytest.approx(math.cos(math.radians(off_deg)), abs=0.01)


@pytest.mark.parametrize(
    ("heading", "fix"),
    [
        (lambda h: np.mod(90.0 - h, 360.0), LogConvention.HEADING_CCW_EAST),
        (lambda h: np.mod(-h, 360.0), LogConvention.HEADING_CCW_NORTH),
        (lambda h: np.mod(h + 180.0, 360.0), LogConvention.HEADING_REVERSED),
    ],
)
def test_each_wrong_heading_gets_the_fix_that_undoes_it(heading: object, fix: LogConvention) -> None:
    (one,) = find_direction_errors(log(ROUND, heading_deg=heading(ROUND.heading_deg)))  # type: ignore[operator]
    assert one.fix is fix


def test_what_is_right_is_left_alone() -> None:
    assert find_direction_errors(log(ROUND)) == [] and find_wrong_gear(log(ROUND)) is None
    assert find_direction_errors(log(ROUND, heading_deg=np.mod(ROUND.heading_deg + 15.0, 360.0))) == [], (
        "an effect may do that"
    )


def test_steering_to_the_other_side_is_positive_to_the_left() -> None:
    (one,) = find_direction_errors(log(ROUND, steering_deg=-ROUND.steering_deg))
    assert one.fix is LogConvention.STEERING_LEFT and one.why.startswith("in 100 % of the clear bends")


def test_a_turned_heading_is_told_in_degrees() -> None:
    (one,) = find_direction_errors(log(ROUND, heading_deg=np.mod(ROUND.heading_deg + 50.0, 360.0)))
    assert one.fix is None and "points 50 degrees clockwise of the course" in one.what


def test_reverse_where_the_tractor_drives_forward() -> None:
    """The first circle says -1: heading and course agree there, so the gear is wrong, and the log is mended."""
    gear = np.where(np.arange(len(ROUND)) < 200, -1.0, 1.0)
    wrong = find_wrong_gear(log(ROUND, shuttle=gear))
    assert wrong is not None and wrong[1] is not None
    assert "first in line" in wrong[0].why and "write 1 in those rows" in wrong[0].advice
    assert (wrong[1].shuttle == 1.0).all()


def test_forward_where_the_tractor_drives_in_reverse() -> None:
    back = np.arange(len(ROUND)) < 200
    frame = ROUND.assign(
        heading_deg=np.where(back, np.mod(ROUND.heading_deg + 180.0, 360.0), ROUND.heading_deg),
        steering_deg=np.where(back, -ROUND.steering_deg, ROUND.steering_deg),
    )
    wrong = find_wrong_gear(log(frame))
    assert wrong is not None and wrong[1] is None and "write -1" in wrong[0].advice
    assert find_wrong_gear(log(frame, shuttle=np.where(back, -1.0, 1.0))) is None


def drive_back_and_forth() -> tuple[pd.DataFrame, Mask]:
    """The circles with the first two driven in reverse, headings where the tractor points; and the rows in reverse."""
    back = np.arange(len(ROUND)) < 400
    frame = ROUND.assign(
        heading_deg=np.where(back, np.mod(ROUND.heading_deg + 180.0, 360.0), ROUND.heading_deg),
        steering_deg=np.where(back, -ROUND.steering_deg, ROUND.steering_deg),
    )
    return frame, back


def test_a_heading_that_is_the_course_in_both_gears_is_left_out_and_told() -> None:
    frame, back = drive_back_and_forth()
    gear = np.where(back, -1.0, 1.0)
    right = log(frame, shuttle=gear)
    assert drop_course_heading(right) is right
    left_out = drop_course_heading(log(frame, shuttle=gear, heading_deg=ROUND.heading_deg))
    assert left_out.heading_deg is None and "course over ground" in left_out.corrections[0]


def test_a_wrong_gear_is_no_course() -> None:
    """The tractor drives forward with headings and steering as they are; only the column says reverse."""
    wrong = log(ROUND, shuttle=np.where(np.arange(len(ROUND)) < 400, -1.0, 1.0))
    assert drop_course_heading(wrong) is wrong and find_wrong_gear(wrong) is not None
