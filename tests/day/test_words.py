"""The day in words, and why fields are left."""

from dataclasses import replace

from planner.day.optimization.problem import make_empty_routes
from planner.day.optimization.solver import solve_day
from planner.day.planning import explain_not_done
from reports.day.results import DayJob, DayResult, FleetDay, UnworkedField, list_day_sentences
from tests.day.days import by_hand
from tests.day.test_reports import HOUR, JOB

MOVE = [[0, 600, 900], [600, 0, 300], [900, 300, 0]]
NAMES = ["one", "two"]


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


def list_told(jobs: tuple[DayJob, ...], left: tuple[UnworkedField, ...], probability: float | None) -> list[str]:
    """The sentences of a day that costs 321 EUR."""
    fleets = (FleetDay("one", "2 x A", 8 * HOUR, 12 * HOUR, 9.0),)
    return list_day_sentences(
        DayResult(8 * HOUR, 20 * HOUR, jobs, left, fleets, 0.0, 321.0, probability, "EUR", 1000, 1, "",
                  p50_done_s=max((job.p50_end_s for job in jobs), default=None),
                  p95_done_s=max((job.p95_end_s for job in jobs), default=None))
    )  # fmt: skip


def test_a_day_says_its_median_end_and_what_is_least_sure() -> None:
    second = replace(JOB, field="other", end_s=9 * HOUR, p50_end_s=11 * HOUR, p95_end_s=12 * HOUR + 1.0,
                     finish_probability=0.6, lost_cost=4.5)  # fmt: skip
    assert list_told((JOB, second), (), 0.55) == [
        "All 2 fields are done by 11:00 (95 % by 12:01), 199 EUR paid and 122 EUR at risk.",
        "Done within the hours of each field: 55 % sure, least other (60 %).",
        "one (2): Home $1, then other.",
    ]
    alone = replace(JOB, finish_probability=0.6)
    assert list_told((alone,), (), 0.6)[1] == "Done within the hours of each field: 60 % sure.", "it is the only field"


def test_a_day_names_what_is_not_worked() -> None:
    left = tuple(UnworkedField(name, 1.0, 5.0, "it is far") for name in ("a", "b", "c", "d"))
    told = list_told((JOB,), left, 1.0)
    assert told[:2] == [
        "1 of 5 fields is done by 10:06 (95 % by 11:00), 100 EUR paid and 222 EUR at risk.",
        "Done within the hours of each field: 100 % sure.",
    ]
    assert told[-2:] == ["c is not worked: it is far.", "1 more is not worked."]
    assert list_told((JOB,), left[:3], 1.0)[-1] == "c is not worked: it is far.", "and no more"
    assert list_told((), left[:1], None) == ["No field can be done on this day.", "a is not worked: it is far."]


def test_a_day_says_first_what_is_no_recommendation_and_what_nobody_pays_is_no_price() -> None:
    """Work 99.50 and roads 12 are paid; a loss of 1.25 and a field left for 80 are risked."""
    jobs, fleet = (replace(JOB, cost=99.5, lost_cost=1.25),), FleetDay("one", "2 x A", 8 * HOUR, 12 * HOUR, 9.0, 12.0)
    left = (UnworkedField("a", 1.0, 80.0, "it is far"),)
    lacking = "north: No recommendation: only 53.9 % of the field is worked; 44 % is cut off by obstacles."
    day = DayResult(8 * HOUR, 20 * HOUR, jobs, left, (fleet,), 0.0, 192.75, 1.0, "EUR", 1000, 1, "",
                    shortfalls=(lacking,), p50_done_s=10.1 * HOUR, p95_done_s=11 * HOUR)  # fmt: skip
    assert (day.paid_cost, day.risked_cost) == (111.5, 81.25)
    told = list_day_sentences(day)
    assert told[0] == lacking and told[1].endswith(", 112 EUR paid and 81 EUR at risk.")
