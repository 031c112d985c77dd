"""Rain: every way to say when it begins, what is refused, and how often it is drawn."""

import math
from pathlib import Path

import numpy as np
import pytest

from planner.errors import RequestError
from planner.risk.rain import RainForecast, parse_ensemble, parse_rain

NOON = 12 * 3600


def test_a_time_counts_from_the_start() -> None:
    assert parse_rain("17:00", NOON) == RainForecast((5 * 3600.0,), (1.0,))


@pytest.mark.parametrize(("text", "hours"), [("11:00", 23.0), ("12:00", 24.0), ("00:30", 12.5)])
def test_a_time_that_is_not_after_the_start_is_tomorrow(text: str, hours: float) -> None:
    assert parse_rain(text, NOON).onsets_s == (hours * 3600.0,)


def test_percentages_are_drawn_as_often_as_they_say_and_the_rest_is_dry() -> None:
    rain = parse_rain("16:30=20, 17:00=50%,18:00=10", NOON)
    drawn = rain.draw_onsets(20_000, seed=2)
    for hours, share in ((4.5, 0.2), (5.0, 0.5), (6.0, 0.1), (math.inf, 0.2)):
        error = math.sqrt(share * (1 - share) / 20_000)
        assert abs(float((drawn == hours * 3600.0).mean()) - share) < 3 * error


def test_percentages_that_are_all_of_it_leave_nothing_dry() -> None:
    assert np.isfinite(parse_rain("16:00=33.3,17:00=33.3,18:00=33.4", NOON).draw_onsets(10_000, 1)).all()


def test_a_rate_is_per_hour() -> None:
    assert parse_rain("0.5/h", None).rate_per_s == pytest.approx(0.5 / 3600)


def test_members_of_a_file_are_equally_likely(tmp_path: Path) -> None:
    path = tmp_path / "ensemble.csv"
    path.write_text("member,Time\n1,16:00\n2,2026-05-01T17:30\n3,\n4,18:00\n", encoding="utf-8")
    rain = parse_rain(str(path), NOON)
    assert rain.onsets_s == (4 * 3600.0, 5.5 * 3600.0, 6 * 3600.0)
    assert rain.probabilities == (0.25, 0.25, 0.25)


def test_an_empty_line_has_to_say_what_it_is() -> None:
    """csv skips it, and three members of four that bring rain would be all of them."""
    with pytest.raises(RequestError, match="empty in line 3; write dry there"):
        parse_ensemble("hours\n1.5\n\n3\n4\n", "x.csv", None)
    assert parse_ensemble("hours\n1.5\ndry\n3\n4\n", "x.csv", None).probabilities == (0.25, 0.25, 0.25)


def test_hours_need_no_start() -> None:
    assert parse_ensemble("hours\n1.5\n3\n", "x.csv", None).onsets_s == (5400.0, 10800.0)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("soon", "is none of: a time"),
        ("25:00", "is not a time of day"),
        ("16:00=60,17:00=50", "add up to 110"),
        ("16:00=0", "add up to 0"),
        ("16:00=-5,17:00=50", "percentage '-5'"),
        ("16:00=x", "percentage 'x'"),
        ("-1/h", "rate '-1'"),
    ],
)
def test_what_says_no_time_is_refused_in_a_sentence(text: str, words: str) -> None:
    with pytest.raises(RequestError, match=words):
        parse_rain(text, NOON)


def test_a_time_needs_a_start() -> None:
    with pytest.raises(RequestError, match="needs a start") as refusal:
        parse_rain("17:00", None)
    assert refusal.value.parameter == "start_s"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("time" + "," * 1_000_000 + "\n", "more than 200 columns"),
        (f'time\n"{"a" * 200_000}"\n', "is not a CSV"),
        ("onset\n17:00\n", "no column of times"),
        ("", "no column of times"),
        ("time\n", "0 members"),
        ("time,x\n,1\n,2\n", "2 members, 0 of them with rain"),
        ("time\nsoon\n", "write hh:mm"),
        ("hours\n-2\n", "x.csv has the hours '-2' in line 2"),
        ("member,time\n1,17:00\n2,25:10\n", "x.csv has the time '25:10' in line 3"),
        ("time\n17:00\ndry\n2026-13-01T10:00\n", "x.csv has the time '2026-13-01T10:00' in line 4"),
    ],
)
def test_a_file_without_times_or_too_wide_is_refused(text: str, words: str) -> None:
    with pytest.raises(RequestError, match=words):
        parse_ensemble(text, "x.csv", NOON)
