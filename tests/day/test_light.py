"""Sunrise and sunset beside almanacs and what must hold everywhere."""

from datetime import date

import pytest
from hypothesis import given
from hypothesis import strategies as st

from planner.day.formulation import build_day_hours
from planner.day.input_file import parse_day
from planner.day.places import compute_sun_hours
from planner.errors import RequestError
from planner.farm.settings import read_example_text

MINUTE = 60


def clock(text: str) -> int:
    hours, minutes = text.split(":")
    return int(hours) * 3600 + int(minutes) * 60


@pytest.mark.parametrize(
    ("day", "lon", "lat", "offset", "rise", "sets"),
    [
        (date(2024, 6, 20), -0.1276, 51.5072, 1.0, "04:43", "21:21"),  # London
        (date(2026, 12, 21), 12.568, 55.676, 1.0, "08:37", "15:38"),  # Copenhagen
        (date(2025, 3, 20), 0.0, 0.0, 0.0, "12:04", "12:11"),  # below: equator, from noon
        (date(2025, 12, 21), 151.209, -33.868, 11.0, "05:41", "20:05"),  # Sydney
    ],
)
def test_almanacs(day: date, lon: float, lat: float, offset: float, rise: str, sets: str) -> None:
    found = compute_sun_hours(day, lon, lat, offset)
    assert found is not None
    if lat == 0.0:
        assert found[1] - found[0] == pytest.approx(12 * 3600 + 7 * MINUTE, abs=2 * MINUTE)
        assert clock(rise) - 6 * 3600 <= found[0] <= clock(sets) - 6 * 3600
    else:
        assert abs(found[0] - clock(rise)) <= 2 * MINUTE and abs(found[1] - clock(sets)) <= 2 * MINUTE


@given(st.dates(date(2020, 1, 1), date(2040, 12, 31)), st.floats(-50.0, 50.0), st.floats(-180.0, 180.0))
def test_light_north_and_south_adds_up_to_a_day(day: date, lat: float, lon: float) -> None:
    """Light north and south of the equator adds up to a day and what refraction and the sun's width add."""

    def light(where: float) -> int:
        found = compute_sun_hours(day, lon, where, lon / 15.0)
        assert found is not None
        return found[1] - found[0]

    assert 86_400 < light(lat) + light(-lat) < 86_400 + 40 * MINUTE


def test_where_the_sun_does_not_set_or_rise() -> None:
    assert compute_sun_hours(date(2026, 6, 21), 20.0, 70.0, 2.0) is None
    rise, sets = compute_sun_hours(date(2026, 12, 21), 20.0, 70.0, 1.0) or (0, 1)
    assert rise == sets


def test_the_light_of_a_day() -> None:
    text = read_example_text("day").replace(
        'light = "06:10-20:40"', 'light = "sun"\ndate = "2026-05-01"\nutc_offset_h = 2.0'
    )
    day, farm = parse_day(text, "day.toml")
    frame = build_day_hours(day, farm, (4.55, 52.11))
    assert frame.daylight_s == compute_sun_hours(date(2026, 5, 1), 4.55, 52.11, 2.0)
    late = day.model_copy(update={"start": "23:00"})
    assert build_day_hours(late, farm, (4.55, 52.11)).daylight_s == tuple(at + 86_400 for at in frame.daylight_s or ())
    with pytest.raises(RequestError, match="needs a place on the earth"):
        build_day_hours(day, farm)
    for lacks in ('date = "2026-05-01"\n', "utc_offset_h = 2.0"):
        with pytest.raises(RequestError, match="needs a date and utc_offset_h"):
            parse_day(text.replace(lacks, ""), "day.toml")
    with pytest.raises(RequestError, match="'1 May' is not a date"):
        parse_day(text.replace("2026-05-01", "1 May"), "day.toml")
