"""The sentence on one more tractor, the other plans, and the ground that a plan leaves."""

from dataclasses import replace
from typing import Any

import pytest

from reports.common.language import Reader, use_reader
from reports.common.plan_records import Shortfall
from reports.common.plan_results import PlanRanking, PlanResult
from reports.common.text_tables import AnswerLines
from reports.common.wording import format_price_change
from reports.plan.answer import write_answer
from tests.printing import print_text

NO_PRICE = " No price is given, so it would have to save 15 min."
A, B = (1, 60.0, 50.0), (2, 50.0, 55.0)


def build_plan(tractors: int, minutes: float, cost: float, worked_pct: float = 98.4) -> PlanResult:
    """A plan that leaves nothing to be charged, unless it is replaced."""
    return PlanResult(
        "split-field", tractors, "u", True, time_s=60.0 * minutes, cost=cost, finished_s=60.0 * minutes,
        finished_cost=cost, worked_pct=worked_pct,
    )  # fmt: skip


def write_alternatives(*plans: PlanResult, **more: object) -> str:
    values: dict[str, object] = {"currency": "EUR", "prices_assumed": True, **more}
    answer = write_answer(PlanRanking("f", 1.0, 1, plans, **values))  # type: ignore[arg-type]
    return " ".join(filter(None, (answer.rule, answer.alternatives)))


@pytest.mark.parametrize(("plans", "sentence"), [
    (((2, 90.0, 120.0), (3, 60.0, 120.0), (4, 56.0, 129.0)),
     "3 tractors; a fourth saves 4 min for 9 EUR." + NO_PRICE
     + " At the assumed price it would be 2 tractors (--price-per-hour). Or 2 tractors: 1:30:00, same cost."),
    ((A, (2, 59.7, 61.0)), "1 tractor; a second saves 18 s for 11 EUR." + NO_PRICE),
    (((1, 600.0, 50.0), (2, 520.0, 61.0)), "1 tractor; a second saves 1 h 20 min for 11 EUR."
     + NO_PRICE.replace("15 min", "2 h 30 min")),
    (((9, 60.0, 50.0), (10, 59.0, 50.0)), "9 tractors; a tenth saves 1 min at the same cost." + NO_PRICE),
    (((10, 60.0, 50.0), (11, 59.0, 45.0)), "10 tractors; a fleet of 11 saves 1 min and 5 EUR." + NO_PRICE
     + " At the assumed price it would be 11 tractors (--price-per-hour)."),
    (((2, 60.0, 50.0), (4, 50.0, 55.0)), "2 tractors; a fleet of 4 saves 10 min for 5 EUR."
     + NO_PRICE.replace("15", "30")),
    (((7, 60.0, 50.0), (8, 61.0, 55.0)), "7 tractors; an eighth saves no time." + NO_PRICE),
    (((*A, 98.1), B), "1 tractor; a second saves 10 min for 5 EUR, 98.4 % worked." + NO_PRICE),
    (((*A, 98.2), B), "1 tractor; a second saves 10 min for 5 EUR." + NO_PRICE),
])  # fmt: skip
def test_what_more_tractors_save(plans: tuple[tuple[Any, ...], ...], sentence: str) -> None:
    assert write_alternatives(*(build_plan(*one) for one in plans)) == sentence


def test_a_number_that_a_larger_one_beats_in_time_and_cost_is_not_offered() -> None:
    plans = [build_plan(1, 60.0, 50.0), build_plan(2, 50.0, 60.0), build_plan(3, 45.0, 55.0)]
    assert write_alternatives(*plans) == "1 tractor; a fleet of 3 saves 15 min for 5 EUR." + NO_PRICE.replace(
        "15", "30"
    )


def test_what_is_saved_counts_breaks_as_the_end_does() -> None:
    """A lunch of 45 minutes ends the first plan later, and the second is done before it."""
    one = replace(build_plan(1, 60.0, 50.0), done_s=6300.0, finished_done_s=6300.0)
    assert write_alternatives(one, build_plan(2, 50.0, 55.0)) == "1 tractor; a second saves 55 min for 5 EUR."


def test_what_is_saved_and_paid_counts_the_ground_that_is_left() -> None:
    """Driven 10 minutes quicker for 5 less, but its rest takes 8 minutes and 12: 2 minutes for 7."""
    left = replace(build_plan(2, 50.0, 45.0, 86.2), finished_s=3480.0, finished_cost=57.0, missed_m2=1400.0)
    whole = build_plan(1, 60.0, 50.0, 99.8)
    assert write_alternatives(whole, left) == "1 tractor; a second saves 2 min for 7 EUR, 86.2 % worked." + NO_PRICE
    shown = replace(PlanRanking("f", 1.0, 1, (left,)), currency="EUR")
    assert write_answer(shown).work == "86.2 % worked (0.14 ha left: 8 min and 12 EUR of work, without ways there)."
    little = replace(left, finished_s=3059.0)  # 59 s of 50 min are less than 2 %
    assert write_answer(replace(shown, plans=(little,))).work == "86.2 % worked."


def test_with_a_deadline_both_neighbours_tell_their_time_and_their_share() -> None:
    plans = [replace(build_plan(count, 120.0 / count, 40.0 + 5.0 * count), meets_deadline=True) for count in (1, 2, 3)]
    plans[2] = replace(plans[2], worked_pct=99.8)
    said = write_alternatives(*plans, allowed_s=9000.0, chosen=("split-field", 2))
    assert said == "Or 1 tractor: 2:00:00, 5 EUR cheaper; 3 tractors: 0:40:00, +5 EUR, 99.8 % worked."


def test_a_plan_that_works_too_little_is_no_alternative() -> None:
    little = replace(build_plan(2, 30.0, 40.0, 60.0), works_enough=False)
    whole = build_plan(1, 60.0, 50.0)
    assert write_alternatives(whole, little) == ""
    none = [replace(plan, works_enough=False) for plan in (whole, little)]
    assert "a second" in write_alternatives(
        replace(none[0], finished_s=1.0), none[1], shortfalls=(Shortfall("worked", "Too little."),)
    )


@pytest.mark.parametrize(("price", "reference", "added", "change"), [
    (139.4, 143.4, -0.1, "-4"), (139.4, 143.4, 9.0, "+5"), (143.0, 143.0, 0.4, None), (143.0, 143.0, 0.6, "+1"),
    (5.0, 5.0, 0.5, "+0.50"), (None, 5.0, 1.0, None),
])  # fmt: skip
def test_cost_changes_are_those_printed_with_that_of_the_ground(
    price: float | None, reference: float, added: float, change: str | None
) -> None:
    assert format_price_change(price, reference, added) == change


def test_it_is_said_in_every_language() -> None:
    for language, sentence in (
        ("de", "3 Traktoren; ein vierter spart 4 min für 9 EUR."),
        ("fr", "3 tracteurs ; un quatrième fait gagner 4 min pour 9 EUR."),
    ):
        with use_reader(Reader(language)):
            assert write_alternatives(build_plan(3, 60.0, 120.0), build_plan(4, 56.0, 129.0)).startswith(sentence)


@pytest.mark.parametrize(("scenario", "figures", "said"), [
    ({"operation": "till"}, {"headland_order": "last"}, ", headland last."),
    ({"operation": "till", "headland_order": "first"}, {"headland_order": "first"}, ", headland first."),
    ({"operation": "sow"}, {"headland_order": "last"}, ", headland last (as sowing asks), filling not counted."),
    ({"operation": "mow", "headland_order": None}, {"headland_order": "first"}, ", headland first (as mowing asks)."),
    ({"operation": "sow", "headland_order": "first"}, {"headland_order": "first"},
     ", headland first, filling not counted."),
    ({"operation": "harvest"}, {}, ", unloading not counted."),
    ({"operation": "mow"}, {}, "."),
    ({"operation": "till"}, {"overlap_pct": 18.2}, "."),
    ({"operation": "sow"}, {"overlap_pct": 4.9}, ", filling not counted."),
    ({"operation": "spray"}, {"overlap_pct": 18.2}, ", 18 % twice (less with --sections), filling not counted."),
    ({"operation": "spray", "sections": 2}, {"overlap_pct": 5.4}, ", 5 % twice, filling not counted."),
])  # fmt: skip
def test_when_the_headland_is_worked_and_what_gets_twice_as_much(
    scenario: dict[str, Any], figures: dict[str, Any], said: str
) -> None:
    plan = replace(build_plan(*A), **figures)
    assert write_answer(PlanRanking("f", 1.0, 1, (plan,), scenario=scenario)).work == f"98.4 % worked{said}"


def test_tractors_counted_by_time_say_how_much_one_more_has_to_save_and_how_many_the_assumed_price_would_take() -> None:
    plans = build_plan(1, 90.0, 50.0), build_plan(2, 50.0, 60.0), build_plan(3, 30.0, 75.0)
    ranking = PlanRanking("f", 1.0, 1, plans, currency="EUR", prices_assumed=True)
    said = write_answer(ranking).rule
    assert said == "No price is given, so time decides. At the assumed price it would be 1 tractor (--price-per-hour)."
    assert said in write_answer(ranking).list_sentences()
    assert write_answer(replace(ranking, prices_assumed=False)).rule == "1 tractor; a second saves 40 min for 10 EUR."
    fourth = replace(ranking, plans=(*plans, build_plan(4, 26.0, 84.0)))
    assert write_answer(fourth).rule == (
        f"3 tractors; a fourth saves 4 min for 9 EUR.{NO_PRICE} At the assumed price it "
        "would be 1 tractor (--price-per-hour)."
    )
    same = replace(plans[2], cost=49.0, finished_cost=49.0)
    assert write_answer(replace(ranking, plans=(*plans[:2], same))).rule == ""
    judged = replace(ranking, chosen=("split-field", 2))
    assert write_answer(judged).rule == "", "a deadline or an objective has decided"


def test_where_lines_are_lacking_the_last_alternative_goes_first() -> None:
    shown = print_text(AnswerLines(("one", "two", "three"), ("Or 1 tractor.", "a " * 60)))
    assert shown.split("\n")[:4] == ["one", "two", "three", "Or 1 tractor."]
