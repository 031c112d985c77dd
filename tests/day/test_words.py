"""The day in words, and why fields are left."""

from __future__ import annotations

from dataclasses import replace

from planner.day.optimization.problem import make_empty_routes
from planner.day.optimization.solver import solve_day
from planner.day.planning import explain_not_done, format_time_of_day, write_advice
from reports.day.schedule_results import UnworkedField
from tests.day.days import by_hand
from tests.day.test_reports import JOB

MOVE = [[0, 600, 900], [600, 0, 300], [900, 300, 0]]
NAMES = ["one", "two"]


def test_times_of_day() -> None:
    assert format_time_of_day(3599.0) == "01:00" and format_time_of_day(86_400.0 + 1800) == "00:30 of the next day"
    assert format_time_of_day(2 * 86_400.0) == "00:00 2 days later"


def test_the_reasons_a_field_can_have() -> None:
    """Going there first the work ends after 300 + 1000 s, and everybody is home 300 s later."""
    dear = by_hand([[2000, 1000]], MOVE, put_off=[9.0, 5.0], per_move_s=0.01)
    assert explain_not_done(dear, make_empty_routes(dear), 1, [], NAMES).reason.startswith(
        "doing it costs 1.00 more than skipping it"
    )
    late = replace(dear, windows=(((0, 9000),), ((0, 1240),)))
    assert (
        explain_not_done(late, make_empty_routes(late), 1, [], NAMES).reason
        == "even if one goes there first, it is 1 min too late"
    )
    home = replace(dear, home_by_s=1000)
    assert explain_not_done(home, make_empty_routes(home), 1, [], NAMES).nearness == (1, 600.0)
    nobody = replace(dear, work_s=((2000, None),))
    refusals = ["", "The field is too narrow."]
    assert explain_not_done(nobody, make_empty_routes(nobody), 1, refusals, NAMES).reason.endswith(
        "no fleet can work it: The field is too narrow"
    )
    never = replace(dear, windows=(((0, 9000),), ()))
    assert "its windows are outside" in explain_not_done(never, make_empty_routes(never), 1, [], NAMES).reason


def test_no_time_beside_the_others() -> None:
    """Both fit alone, both together take 300 + 1000 + 600 + 2000 + 900 s or more."""
    problem = by_hand([[2000, 1000]], MOVE, put_off=[200.0, 100.0], per_move_s=0.01, home_by_s=4799)
    day = solve_day(problem)
    assert day.routes == ((0,),)
    assert (
        explain_not_done(problem, day.routes, 1, [], NAMES).reason
        == "no fleet has time for it besides the other fields"
    )
    assert solve_day(replace(problem, home_by_s=4800)).routes == ((1, 0),)


def test_the_advice() -> None:
    second = replace(JOB, field="other", end_s=11 * 3600.0, finish_probability=0.6)
    text = write_advice([JOB, second], [], 0.55, 321.0, "EUR")
    assert text == (
        "All 2 fields are done by 11:00 (55 % in time): one: Home $1, then other. Expected cost 321.00 EUR. "
        "Least certain: other, 60 % in time."
    )
    left = [UnworkedField(name, 1.0, 5.0, "it is far") for name in ("a", "b", "c", "d")]
    told = write_advice([JOB], left, 1.0, 321.0, "EUR")
    assert told.startswith("1 of 5 fields is done by 10:00 (100 % in time): one: Home $1.")
    assert told.endswith("c is skipped: it is far. 1 more is skipped.")
    assert write_advice([], left, None, 20.0, "EUR") == "No field can be done on this day."
