"""Time without breaks."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from planner.day.formulation import DayHours
from planner.day.input_file import place_hours_in_day
from planner.errors import RequestError
from planner.farm.workday import Workday

HOUR = 3600


def frame(*breaks: tuple[int, int], start: int = 0) -> DayHours:
    return DayHours(start, start + 24 * HOUR, Workday(start, breaks_s=breaks), None, None)


NOON = frame((12 * HOUR, 13 * HOUR), start=6 * HOUR)


def test_work_goes_on_after_a_break() -> None:
    assert NOON.convert_to_working_s(11 * HOUR) == 11 * HOUR
    assert NOON.convert_to_working_s(12.5 * HOUR) == 12 * HOUR == NOON.convert_to_working_s(13 * HOUR)
    assert NOON.convert_to_working_s(15 * HOUR) == 14 * HOUR
    assert (NOON.get_end_clock_s(12 * HOUR), NOON.get_begin_clock_s(12 * HOUR)) == (12 * HOUR, 13 * HOUR)
    assert NOON.get_begin_clock_s(14 * HOUR) == NOON.get_end_clock_s(14 * HOUR) == 15 * HOUR


def test_breaks_that_are_over_are_of_the_next_day_and_ones_that_touch_are_no_longer() -> None:
    assert frame((1 * HOUR, 2 * HOUR), start=18 * HOUR).list_breaks() == ((25 * HOUR, 26 * HOUR),)
    touching = frame((12 * HOUR, 13 * HOUR), (13 * HOUR, 14 * HOUR), start=HOUR)
    assert (touching.get_begin_clock_s(12 * HOUR), touching.convert_to_working_s(15 * HOUR)) == (14 * HOUR, 13 * HOUR)


@given(
    st.lists(st.tuples(st.integers(0, 40_000), st.integers(1, 9_000)), max_size=4), st.integers(0, 60_000),
    st.integers(0, 20_000),
)  # fmt: skip
def test_a_piece_of_work_takes_its_time_outside_breaks(pairs: list[tuple[int, int]], at: int, work: int) -> None:
    clock = frame(*((start, start + length) for start, length in pairs))
    begin, end = (
        clock.get_begin_clock_s(clock.convert_to_working_s(at)),
        clock.get_end_clock_s(clock.convert_to_working_s(at) + work),
    )
    paused = sum(max(0.0, min(end, b) - max(begin, a)) for a, b in clock.list_breaks())
    assert end - begin - paused == pytest.approx(work if work else min(end - begin - paused, 0.0))


@pytest.mark.parametrize(
    ("text", "start", "seen"),
    [
        ("06:00-09:00", 7, (6, 9)),
        ("22:00-02:00", 7, (22, 26)),
        ("01:00-05:00", 18, (25, 29)),
        ("08:00-12:00", 8, (8, 12)),
        ("20:00-08:00", 8, (20, 32)),
    ],
)
def test_times_past_midnight_are_of_the_next_day(text: str, start: int, seen: tuple[int, int]) -> None:
    assert place_hours_in_day(text, start * HOUR) == (seen[0] * HOUR, seen[1] * HOUR)


@pytest.mark.parametrize("text", ["12:00-09:00", "10:00-10:00", "20:00-19:00"])
def test_a_window_that_closes_before_it_opens_is_refused(text: str) -> None:
    with pytest.raises(RequestError, match="closes before it opens"):
        place_hours_in_day(text, 8 * HOUR)
