"""Headings, gears and steering against the course of circles and lines whose course is known."""

import math
from collections.abc import Callable

import numpy as np
import pandas as pd
import pytest

from fields.arrays import Flags
from tests.identification.analytic_drives import backwards, circle, joined, log
from tests.identification.fault_logs import clean_frames
from tests.identification.log_tables import held, refusal
from tests.truth.cases import TruthCase
from tests.truth.second import second_logs
from tests.truth.third import make_third_logs
from tests.truth.third_drives import PROGRAMMES
from vehicle.identification.errors import LogError
from vehicle.identification.logs.conventions import find_swapped_steering
from vehicle.identification.logs.directions import (
    HEADING_FLIPPED,
    compute_heading_agreements,
    drop_course_heading,
    find_direction_errors,
    find_flipped_headings,
    find_wrong_gear,
)
from vehicle.identification.logs.motion import compute_path_chords
from vehicle.identification.logs.reader import build_log, read_logs
from vehicle.identification.logs.readings import LogConvention
from vehicle.identification.logs.schema import Columns

ROUND = joined(circle(0.1), circle(-0.1), circle(0.05))
LAP = joined(circle(0.03, 30.0), circle(-0.03, 30.0, bearing_deg=np.degrees(1.35)))
SPAN = slice(120, 170)
NAMES = {"steering_deg": "steering_command_deg", "steering_command_deg": "steering_deg"}
FIX = LogConvention.STEERING_SWAPPED
SETS = (*((name, rate_hz) for name in ("three_speeds", "mixed", "closed") for rate_hz in (5.0, 10.0)),
        ("one_sided", 10.0), ("ordered_angles", 10.0))  # fmt: skip
COMMAND, WHEEL = "steering_command_deg", "steering_deg"


@pytest.mark.parametrize("off_deg", [0.0, 25.0, 60.0])
def test_agreement_is_the_cosine_of_what_the_heading_is_off(off_deg: float) -> None:
    one = log(ROUND)
    chords = compute_path_chords(one)
    assert chords is not None and one.heading_deg is not None
    fits = compute_heading_agreements(one, chords, one.heading_deg + off_deg)
    assert fits[None] == pytest.approx(math.cos(math.radians(off_deg)), abs=0.01)


def test_what_is_right_is_left_alone() -> None:
    assert find_direction_errors(log(ROUND)) == [] and find_wrong_gear(log(ROUND)) is None
    assert find_direction_errors(log(ROUND, heading_deg=np.mod(ROUND.heading_deg + 15.0, 360.0))) == [], (
        "an effect may do that"
    )


def test_reverse_where_the_tractor_drives_forward() -> None:
    """The first circle says -1: heading and course agree there, so the gear is wrong, and the log is mended."""
    gear = np.where(np.arange(len(ROUND)) < 200, -1.0, 1.0)
    wrong = find_wrong_gear(log(ROUND, shuttle=gear))
    assert wrong is not None and wrong[1] is not None
    assert "first in line" in wrong[0].why and "write 1 in those rows" in wrong[0].advice
    assert (wrong[1].shuttle == 1.0).all()


def drive_back_and_forth(rows: int) -> tuple[pd.DataFrame, Flags]:
    """The circles with the first rows driven in reverse, headings where the tractor points; and the rows in reverse."""
    back = np.arange(len(ROUND)) < rows
    frame = ROUND.assign(
        heading_deg=np.where(back, np.mod(ROUND.heading_deg + 180.0, 360.0), ROUND.heading_deg),
        steering_deg=np.where(back, -ROUND.steering_deg, ROUND.steering_deg),
    )
    return frame, back


def test_forward_where_the_tractor_drives_in_reverse() -> None:
    frame, back = drive_back_and_forth(200)
    wrong = find_wrong_gear(log(frame))
    assert wrong is not None and wrong[1] is None and "write -1" in wrong[0].advice
    assert find_wrong_gear(log(frame, shuttle=np.where(back, -1.0, 1.0))) is None


def test_a_heading_that_is_the_course_in_both_gears_is_left_out_and_told() -> None:
    frame, back = drive_back_and_forth(400)
    gear = np.where(back, -1.0, 1.0)
    right = log(frame, shuttle=gear)
    assert drop_course_heading(right) is right
    left_out = drop_course_heading(log(frame, shuttle=gear, heading_deg=ROUND.heading_deg))
    assert left_out.heading_deg is None and "course over ground" in left_out.corrections[0]


def test_a_wrong_gear_is_no_course() -> None:
    """The tractor drives forward with headings and steering as they are; only the column says reverse."""
    wrong = log(ROUND, shuttle=np.where(np.arange(len(ROUND)) < 400, -1.0, 1.0))
    assert drop_course_heading(wrong) is wrong and find_wrong_gear(wrong) is not None


# --- Headings that turn round between two rows are left out where path and gear say which side is wrong ---


def turn_round(frame: pd.DataFrame, rows: slice) -> pd.DataFrame:
    heading = frame["heading_deg"].to_numpy(copy=True)
    heading[rows] = np.mod(heading[rows] + 180.0, 360.0)
    return frame.assign(heading_deg=heading)


def get_columns(frame: pd.DataFrame) -> Columns:
    return {str(name): values.to_numpy(float) for name, values in frame.items()}


def test_rows_between_two_flips_are_left_out_and_told() -> None:
    log = build_log(turn_round(LAP, SPAN), "run")
    (gated,) = log.gated
    assert gated.rule == HEADING_FLIPPED and gated.rows == 50 and gated.first_line == 122
    assert find_wrong_gear(log) is None and build_log(LAP, "run").gated == ()


@pytest.mark.parametrize("rows", [slice(0, 60), slice(len(LAP) - 60, None), slice(120, 121)])
def test_a_flip_at_an_end_or_of_one_row_needs_no_second_one(rows: slice) -> None:
    flipped = find_flipped_headings(get_columns(turn_round(LAP, rows)))
    assert flipped.tolist() == list(range(len(LAP)))[rows]


def test_a_row_between_both_sides_is_left_out_too() -> None:
    frame = turn_round(LAP, SPAN)
    frame.loc[119, "heading_deg"] = (frame.loc[118, "heading_deg"] + 90.0) % 360.0
    assert find_flipped_headings(get_columns(frame)).tolist() == list(range(119, 170))


def test_a_value_held_before_a_flip_is_left_out_too() -> None:
    """Between it and the next measured one the heading would be interpolated through the half circle."""
    frame = turn_round(LAP, SPAN)
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


# --- Steering columns under each other's names are refused with the fix; right names are never doubted ---


def is_doubted(frame: pd.DataFrame) -> bool:
    return find_swapped_steering(build_log(frame, frame.attrs["name"], check=False)) is not None


@pytest.mark.parametrize("name", ["steps", "lines", "right"])
def test_swapped_columns_are_refused_with_the_fix(name: str) -> None:
    frame = clean_frames()[name]
    text = refusal(lambda: build_log(frame.rename(columns=NAMES), name))
    assert "steering_command_deg and steering_deg are swapped" in text and f"fixes {FIX}" in text
    assert "steering_deg jumps" in text
    mended, right = build_log(frame.rename(columns=NAMES), name, [FIX]), build_log(frame, name)
    for column in NAMES:
        np.testing.assert_array_equal(getattr(mended, column), getattr(right, column))
    assert "remove that fix" in refusal(lambda: build_log(frame, name, [FIX]))


def test_one_log_that_shows_it_is_enough_for_a_set(tmp_path) -> None:  # type: ignore[no-untyped-def]
    paths = []
    for name in ("there", "steps"):
        paths.append(tmp_path / f"{name}.csv")
        clean_frames()[name].rename(columns=NAMES).to_csv(paths[-1], index=False)
    assert "steps: it seems that steering_command_deg and steering_deg are swapped" in refusal(lambda: read_logs(paths))
    assert [log.name for log in read_logs(paths, [FIX])] == ["there", "steps"]


def test_right_columns_are_not_doubted() -> None:
    assert not [name for name, frame in clean_frames().items() if is_doubted(frame)]


def test_logs_that_do_not_show_it_are_not_doubted() -> None:
    straight = clean_frames()["there"].rename(columns=NAMES)
    assert not is_doubted(straight)
    assert not is_doubted(clean_frames()["steps"].drop(columns="steering_deg"))


@pytest.mark.parametrize(("programme", "rate_hz"), [("closed", 5.0), ("one_sided", 10.0)])
def test_swapped_logs_of_few_steps_are_told(programme: str, rate_hz: float) -> None:
    frames = second_logs({}, 51, PROGRAMMES[programme](), rate_hz=rate_hz)
    assert any(is_doubted(frame.rename(columns=NAMES)) for frame in frames)
    assert not any(is_doubted(frame) for frame in frames)


@pytest.mark.matrix
@pytest.mark.parametrize(("programme", "rate_hz"), SETS)
def test_any_set_of_swapped_logs_is_told(programme: str, rate_hz: float) -> None:
    """Small steps of the angle, as these last two have them, do not show at 5 Hz which column jumps."""
    for seed in (51, 52):
        frames = make_third_logs(TruthCase("clean", seed, programme=programme, rate_hz=rate_hz))
        assert any(is_doubted(frame.rename(columns=NAMES)) for frame in frames)
        assert not any(is_doubted(frame) for frame in frames)


def move(frame: pd.DataFrame, column: str, rows: int) -> pd.DataFrame:
    """The frame with a column that comes so many rows later."""
    return frame.assign(**{column: frame[column].shift(rows).bfill().ffill()})


@pytest.mark.parametrize(
    "change",
    [
        lambda frame: move(frame, COMMAND, 5), lambda frame: held(move(frame, COMMAND, 5), 10, WHEEL),
        lambda frame: move(frame, WHEEL, -5), lambda frame: held(frame, 20, WHEEL),
        lambda frame: held(frame, 20, COMMAND),
    ],
)  # fmt: skip
def test_late_and_sparse_columns_are_no_swap(change: Callable[[pd.DataFrame], pd.DataFrame]) -> None:
    assert not [name for name, frame in clean_frames().items() if is_doubted(change(frame))]
