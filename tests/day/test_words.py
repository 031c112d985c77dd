"""The day in words, and why fields are left."""

from __future__ import annotations

from dataclasses import replace

from planner.day.problem import empty
from planner.day.solve import solved
from planner.day.words import advice_of, time_of_day, why_left
from reports.day_results import NotDone
from tests.day.days import by_hand
from tests.day.test_reports import JOB

MOVE = [[0, 600, 900], [600, 0, 300], [900, 300, 0]]
NAMES = ["one", "two"]


def test_times_of_day() -> None:
    assert time_of_day(3599.0) == "01:00" and time_of_day(86_400.0 + 1800) == "00:30 of the next day"
    assert time_of_day(2 * 86_400.0) == "00:00 2 days later"


def test_the_reasons_a_field_can_have() -> None:
    """Going there first the work ends after 300 + 1000 s, and everybody is home 300 s later."""
    dear = by_hand([[2000, 1000]], MOVE, put_off=[9.0, 5.0], per_move_s=0.01)
    assert why_left(dear, empty(dear), 1, [], NAMES).reason.startswith("doing it costs 1.00 more than leaving it")
    late = replace(dear, windows=(((0, 9000),), ((0, 1240),)))
    assert why_left(late, empty(late), 1, [], NAMES).reason == "even one, going there first, would be 1 min too late"
    home = replace(dear, home_by_s=1000)
    assert why_left(home, empty(home), 1, [], NAMES).near == (1, 600.0)
    nobody = replace(dear, work_s=((2000, None),))
    refusals = ["", "The field is too narrow."]
    assert why_left(nobody, empty(nobody), 1, refusals, NAMES).reason.endswith("driven there: The field is too narrow")
    never = replace(dear, windows=(((0, 9000),), ()))
    assert "none of the hours" in why_left(never, empty(never), 1, [], NAMES).reason


def test_no_time_beside_the_others() -> None:
    """Both fit alone, both together take 300 + 1000 + 600 + 2000 + 900 s or more."""
    problem = by_hand([[2000, 1000]], MOVE, put_off=[200.0, 100.0], per_move_s=0.01, home_by_s=4799)
    day = solved(problem)
    assert day.routes == ((0,),)
    assert why_left(problem, day.routes, 1, [], NAMES).reason == "no fleet has the time for it beside the others"
    assert solved(replace(problem, home_by_s=4800)).routes == ((1, 0),)


def test_the_advice() -> None:
    second = replace(JOB, field="other", end_s=11 * 3600.0, finish_probability=0.6)
    text = advice_of([JOB, second], [], 0.55, 321.0, "EUR")
    assert text == (
        "All 2 fields are done by 11:00 (55 % sure): one: Home $1, then other. Expected cost 321.00 EUR. "
        "Least sure is other, 60 %."
    )
    left = [NotDone(name, 1.0, 5.0, "it is far") for name in ("a", "b", "c", "d")]
    told = advice_of([JOB], left, 1.0, 321.0, "EUR")
    assert told.startswith("1 of 5 fields is done by 10:00 (100 % sure): one: Home $1.")
    assert told.endswith("c is left: it is far. 1 more is left.")
    assert advice_of([], left, None, 20.0, "EUR") == "No field can be done on this day."
