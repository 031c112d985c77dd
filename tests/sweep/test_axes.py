"""What a sweep varies: lists, ranges, tractors, choices and clock times."""

from datetime import time
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from planner.errors import RequestError
from planner.sweeps.axes import read_axes


@pytest.mark.parametrize(("name", "text", "written"), [
    ("width", "3,4.5,6", (3.0, 4.5, 6.0)),
    ("width", "3, 3,3.0", (3.0,)),
    ("speed_kmh", "6:12:2", (6.0, 8.0, 10.0, 12.0)),
    ("speed_kmh", "6:8,10", (6.0, 7.0, 8.0, 10.0)),
    ("width", "3:3.35:0.1", (3.0, 3.1, 3.2, 3.3)),
    ("headland_passes", "1:3,5:9:2", (1, 2, 3, 5, 7, 9)),
    ("tractors", "1-3,5", (1, 2, 3, 5)),
    ("headland_order", "first,last", ("first", "last")),
    ("start", "07:00,08:30", ("07:00", "08:30")),
])  # fmt: skip
def test_texts(name: str, text: str, written: tuple[object, ...]) -> None:
    (axis,) = read_axes({name: text})
    assert axis.written == written


def test_values_of_python_and_parameters() -> None:
    width, speed, tractors = read_axes({"width": np.array([3.0, 6.0]), "speed_kmh": range(9, 19, 9), "tractors": "1-2"})
    assert width.values == (3.0, 6.0) and speed.values == pytest.approx((2.5, 5.0)) and tractors.values == ((1,), (2,))


def test_the_name_says_the_unit_and_clocks_are_times_of_python_too() -> None:
    speed, start = read_axes({"speed_mps": [2.5, 5.0], "start": [time(7), "08:30"]})
    assert (speed.option.name, speed.values, speed.written) == ("speed_kmh", (2.5, 5.0), (9.0, 18.0))
    assert (start.values, start.written) == ((25200, 30600), ("07:00", "08:30"))
    start, deadline = read_axes({"start_s": [time(7), "08:30"], "deadline_s": np.array([61200, 63000])})
    assert (start.values, deadline.values) == ((25200, 30600), (61200, 63000))
    assert deadline.written == ("17:00", "17:30")


@given(st.integers(1, 50), st.integers(0, 40), st.integers(1, 7))
def test_a_range_has_both_ends(first: int, steps: int, step: int) -> None:
    (axis,) = read_axes({"width": f"{first}:{first + steps * step}:{step}"})
    assert axis.written == tuple(float(first + number * step) for number in range(steps + 1))


@pytest.mark.parametrize(("values", "sentence"), [
    ({"color": "1"}, "A sweep cannot vary 'color'"),
    ({"width": "3", "width_m": "4"}, "The width is given twice, with its unit and without"),
    ({"width": "3,x"}, "holds 'x', which is no number"),
    ({"headland_passes": "1.5:3"}, "holds '1.5:3', which is no number"),
    ({"sections": "1:3:0.5"}, "holds '1:3:0.5', which is no number"),
    ({"start": [25200]}, "'25200' is not a time of day; write hh:mm"),
    ({"start_s": [25201]}, "holds 25201; give seconds of the day, from 0 to 86340, in whole minutes of 60"),
    ({"start_s": 86400}, "holds 86400; give seconds of the day"),
    ({"start_s": float("nan")}, "holds nan; give seconds of the day"),
    ({"width": "6:3"}, "holds the range '6:3'"),
    ({"width": "3:6:0"}, "holds the range '3:6:0'"),
    ({"width": ""}, "has no value"),
    ({"width": "3,,4"}, "has an empty value between commas"),
    ({"soil": "loam,"}, "or at an end"),
    ({"width": "1:999:0.1"}, "holds the range"),
    ({"headland_order": "first,middle"}, "middle"),
])  # fmt: skip
def test_refusals(values: dict[str, Any], sentence: str) -> None:
    with pytest.raises(RequestError) as refusal:
        read_axes(values)
    assert sentence in str(refusal.value)
