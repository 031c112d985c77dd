"""First screens beside stored ones, and what holds for all: few lines, one line per row, figures that agree.

A stored screen (tests/reports/screens) is what a terminal of so many columns shows. To renew them all, run

    HEADLAND_GOLDEN=write python -m pytest -n 0 tests/reports/test_first_screens.py

and look at what git shows as changed before it is committed.
"""

import json
import math
import re
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rich.console import RenderableType

from reports.common.language import Reader, use_reader
from reports.common.plan_records import Shortfall, UnworkedPiece
from reports.common.plan_results import PlanRanking
from reports.common.wording import format_price
from reports.day.page import render_day_page
from reports.day.tables import build_day_screen, format_day_json
from reports.plan.answer import write_answer
from reports.plan.figures import format_ranking_json
from reports.plan.many_fields import build_many_fields_screen, list_remarks, render_many_fields_page
from reports.plan.other_plans import format_stated_end
from reports.plan.ranking_page import render_plan_page
from reports.plan.ranking_table import (
    build_answer_table,
    build_first_screen,
    build_ranking_table,
    choose_first_plans,
    count_other_plans,
    write_legend,
)
from tests.examples import count_examples
from tests.printing import assert_as_stored, print_text
from tests.reports.screen_cases import (
    DEADLINE,
    FUEL,
    PLANS,
    RANKINGS,
    REFUSED,
    REMARK,
    REMARKED,
    STRATEGIES,
    add_samples,
    build_day,
    build_plan,
    build_records,
)

WIDTHS = (60, 80, 120)
SCREENS: dict[str, RenderableType] = {
    **{name: build_first_screen(ranking) for name, ranking in RANKINGS.items()},
    "many": build_many_fields_screen(build_records()),
    "day": build_day_screen(build_day()),
}


def split_screen(text: str) -> tuple[list[str], list[str]]:
    """The lines before the table, and those from its heading on; a screen without a table has none of these."""
    before, _, after = text.partition("\n\n")
    return before.splitlines(), after.splitlines()


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("name", SCREENS)
def test_screens_are_as_stored(name: str, width: int) -> None:
    assert_as_stored(name, SCREENS[name], width)


@pytest.mark.parametrize(
    "what",
    [*SCREENS.values(), build_day_screen(build_day(30)), build_many_fields_screen(build_records(40))],
    ids=[*SCREENS, "long-day", "forty-fields"],
)
def test_eighty_columns_have_a_title_and_eight_lines_before_the_table_and_few_in_all(what: RenderableType) -> None:
    before, after = split_screen(print_text(what))
    assert len(before) <= 9 and len(before) + 1 + len(after) <= 24


def test_the_recommended_plan_comes_first_then_the_front() -> None:
    shown = choose_first_plans(DEADLINE)
    assert shown[0] is DEADLINE.best
    assert [plan.tractors for plan in shown[1:6]] == [1, 3, 4, 5, 6] and all(plan.on_pareto_front for plan in shown)
    assert len(build_answer_table(DEADLINE, shown).columns) == 7


def test_headline_and_table_have_the_same_plan_of_every_number_of_tractors() -> None:
    """Of two tractors the quicker plan comes too near, or is as quick and works less: the other one is to take."""
    best = build_plan(1, "split-field", 3, 0.7, 42.0, on_pareto_front=True)
    taken = build_plan(3, "split-field", 2, 1.0, 40.0)
    for other in ({"keeps_clearance": False}, {"worked_pct": 98.0, "missed_m2": 780.0}):
        front = build_plan(2, "interleaved", 2, 0.99, 40.0, on_pareto_front=True, **other)
        plans = (best, front, taken, *(build_plan(4 + n, f"s{n}", 3, 1.5, 90.0) for n in range(5)))
        ranking = replace(RANKINGS["default"], plans=plans, chosen=("split-field", 3))
        assert write_answer(ranking).alternatives.startswith("Or 2 tractors: 1:00:00")
        shown = choose_first_plans(ranking)
        assert shown[:2] == [best, taken] and len(choose_first_plans(ranking, math.inf)) == len(plans)


def test_remarks_are_counted_where_they_have_no_room_and_told_once_under_explain() -> None:
    before, _ = split_screen(print_text(build_first_screen(REMARKED)))
    assert before[-3].startswith("Obstacles cut off 0.34 ha, which no plan works.") and before[-1].endswith(
        "1 more: --explain."
    )
    explained = " ".join(print_text(build_ranking_table(REMARKED)).split())
    assert explained.count(REMARK) == 1, "not once per plan"


def test_what_is_not_simulated_is_counted_by_its_reason() -> None:
    worse, near = (plan for plan in REFUSED if not plan.is_simulated)
    near_told = "tractors may come nearer than 0.5 m (--all)"
    for plans, told in (
        ((worse,), "1 not simulated as others are better (--all)"),
        ((near, near), f"2 other plans, whose {near_told}"),
        ((near, worse, near), f"1 not simulated as others are better, 2 as {near_told}"),
    ):
        ranking = replace(RANKINGS["default"], plans=(*PLANS, *plans))
        assert count_other_plans(ranking, PLANS) == [f"Not shown: {told}."]


@pytest.mark.parametrize(
    ("other", "told"),
    [
        ({"keeps_clearance": False}, "> recommended, as what is quicker comes nearer than 0.5 m;"),
        ({"works_enough": False}, "> recommended, as what is quicker leaves too much ground;"),
        ({"finished_s": 9000.0}, "> recommended, as ground left counts;"),
        ({"worked_pct": 97.0}, "> recommended, as it is about as quick and works more;"),
        ({"min_clearance_m": 1.0}, "> recommended, as it is about as quick and keeps more distance;"),
        ({"reversals": 2}, "> recommended, as it is about as quick and reverses less;"),
        ({"waiting_s": 90.0}, "> recommended, as it is about as quick and waits less;"),
    ],
)
def test_a_quicker_plan_is_not_recommended_for_the_reason_that_decided(other: dict[str, Any], told: str) -> None:
    best = build_plan(2, "split-field", 2, 1.0, 40.0)
    quicker = build_plan(1, "interleaved", 2, 0.995, 40.0, **other)
    ranking = replace(RANKINGS["default"], plans=(quicker, best))
    assert ranking.best is best
    assert write_legend(ranking, [best, quicker]).startswith(told)


def test_what_is_no_recommendation_says_first_what_is_lacking() -> None:
    """Too little worked, and an implement that cannot be pulled: first line, summary, key, page."""
    for name, kind, words in (
        ("cut off", "worked", "No recommendation: only 19.7 % of the field is worked; 78 % is cut off by obstacles."),
        ("too weak", "pull", "Not feasible at this speed. The 6 m cultivator needs about 90 kW"),
    ):
        ranking = RANKINGS[name]
        told = json.loads(format_ranking_json(ranking))
        assert [one["kind"] for one in told["shortfalls"]] == [kind] and told["unmet"].startswith(words)
        assert told["summary"][0].startswith(words)
        assert print_text(build_first_screen(ranking), 160).splitlines()[1].startswith(words[:90])
        assert words.partition(".")[0] in render_plan_page(ranking, None).replace("\N{NO-BREAK SPACE}", " ")
    assert "Feasible: 4.9 km/h (--speed-kmh 4.9) or 3.7 m (--width 3.7)." in told["summary"][0]
    assert not RANKINGS["cut off"].is_recommended and RANKINGS["weak"].is_recommended


@pytest.mark.parametrize("language", ["en", "de", "es", "fr"])
def test_the_first_sentence_fits_a_line_and_has_litres(language: str) -> None:
    """With the longest name of a strategy and with assumed prices."""
    plans = tuple(replace(plan, strategy="row-by-row-optimised", on_pareto_front=True) for plan in FUEL.plans)
    ranking = replace(FUEL, plans=plans[3:], chosen=None, prices_assumed=True)
    with use_reader(Reader(language)):
        decision = write_answer(ranking).decision
    assert " l" in decision and len(decision) <= 80, decision


plans_drawn = st.lists(
    st.tuples(st.sampled_from(STRATEGIES), st.integers(1, 12), st.floats(0.05, 60.0), st.floats(0.5, 9000.0),
              st.floats(0.0, 1.0), st.floats(0.0, 500.0)),
    min_size=1, max_size=9, unique_by=lambda row: row[:2],
)  # fmt: skip


@st.composite
def draw_ranking(draw: st.DrawFn) -> PlanRanking:
    """A ranking of any kind: with and without start, deadline, samples, rain and remarks."""
    limit_s = draw(st.none() | st.floats(600.0, 200_000.0))
    has_samples, has_start = draw(st.booleans()), draw(st.booleans())
    plans = []
    for place, (strategy, tractors, hours, cost, share, late) in enumerate(draw(plans_drawn), start=1):
        plan = build_plan(place, strategy, tractors, hours, cost, remarks=draw(st.sampled_from(((), (REMARK,)))))
        has_share = limit_s is not None
        plan = add_samples(plan, share if has_share else None, late, limit_s) if has_samples else plan
        plans.append(plan if has_samples or limit_s is None else replace(plan, meets_deadline=hours * 3600 <= limit_s))
    ranking = replace(
        DEADLINE, plans=tuple(plans), allowed_s=limit_s, start="13:00" if has_start else None, chosen=None,
        deadline=None, samples=10_000 if has_samples else None,
        cut_off=draw(st.sampled_from((None, UnworkedPiece(812.0, 0.0, 0.0)))),
        field_name=draw(st.sampled_from(("f", "n" * 90))), prices_assumed=draw(st.booleans()),
    )  # fmt: skip
    return replace(ranking, shortfalls=() if ranking.missed_by_s is None else (Shortfall("late"),))


@settings(max_examples=count_examples(25))
@given(draw_ranking())
def test_headline_table_json_and_page_agree_on_time_and_cost(ranking: PlanRanking) -> None:
    best = ranking.best
    time, cost = format_stated_end(ranking, best.stated_end_s), format_price(best.stated_cost)
    answer = write_answer(ranking)
    assert re.search(rf"done (in )?{re.escape(time)}\b", answer.decision) and f" {cost} EUR" in answer.decision
    first = build_answer_table(ranking, choose_first_plans(ranking)).rows[0]
    assert first[0].startswith(f">{best.tractors}") and (first[1], first[2], first[4]) == (best.strategy, time, cost)
    told = json.loads(format_ranking_json(ranking))
    assert told["best"]["stated_end_s"] == pytest.approx(best.stated_end_s, abs=1e-6)
    assert told["best"]["stated_cost"] == pytest.approx(best.stated_cost, abs=1e-6)
    assert told["summary"] == answer.list_sentences()
    page = render_plan_page(ranking, None).replace("\N{NO-BREAK SPACE}", " ")
    row = re.findall(r"<tr class=\"best\">(.*?)</tr>", page)[0]
    cells = re.findall(r"<td[^>]*>(.*?)</td>", row)
    heads = [
        re.sub("\N{SOFT HYPHEN}", "", head) for head in re.findall(r'<button type="button">([^<]*)</button></th>', page)
    ]
    assert cells[3] == time and cells[heads.index("Cost EUR")] == cost
    assert (
        answer.decision in page
        and page.index('class="best"') == page.index("<tr", page.index("<tbody>", page.index('id="plans"'))) + 4
    )


@settings(max_examples=count_examples(100))
@given(draw_ranking())
def test_any_ranking_keeps_to_its_lines(ranking: PlanRanking) -> None:
    for width in WIDTHS:
        text = print_text(build_first_screen(ranking), width)
        assert max(map(len, text.splitlines())) <= width
    before, after = split_screen(print_text(build_first_screen(ranking)))
    assert len(before) <= 9 and len(before) + 1 + len(after) <= 24
    rows = [line for line in after if re.match(r" *>?\d+[* ]", line)]
    assert len(rows) == len(choose_first_plans(ranking)), "every row is one line"


def test_the_day_of_every_report_ends_when_its_last_field_does() -> None:
    day = build_day()
    told = json.loads(format_day_json(day))
    assert told["p50_done_s"] >= max(job["p50_end_s"] for job in told["jobs"])
    text, page = print_text(build_day_screen(day)), render_day_page(day)
    assert "done by 11:31 (95 % by 11:58), 322 EUR paid and 84 EUR at" in text and "<dd>11:31</dd>" in page.replace(
        "\n", ""
    )
    assert told["summary"][0] in " ".join(text.split()) and told["summary"][0] in page


def test_what_is_ranked_first_is_what_takes_least_as_printed() -> None:
    """With equal ground left, the order of the ranks is that of the stated times."""
    from reports.common.plan_results import build_time_sort_key

    plans = [add_samples(plan, None) for plan in PLANS]
    slow_on_paper = replace(plans[0], p50_s=9e4, p50_done_s=9e4)
    ordered = sorted([slow_on_paper, *plans[1:]], key=build_time_sort_key)
    assert [plan.stated_end_s for plan in ordered] == sorted(plan.stated_end_s for plan in ordered)
    assert ordered[-1] is slow_on_paper


def test_many_fields_say_first_how_many_plans_are_no_recommendation_and_why() -> None:
    (good, _) = build_records(2)
    bad = replace(good, requested_field="farm.geojson#north", ranking=replace(RANKINGS["cut off"], field_name="north"))
    records = [good, bad]
    text = " ".join(print_text(build_many_fields_screen(records)).split())
    assert (
        text.startswith("1 plan is no recommendation. 3 m: 2 of 2 fields") and "EUR (assumed prices) paid and" in text
    )
    reason = "north at 3 m: No recommendation: only 19.7 % of the field is worked; 78 % is cut off by obstacles."
    assert reason in text
    assert reason in render_many_fields_page(records).replace("\N{NO-BREAK SPACE}", " ")


def test_many_fields_say_what_is_planned_alike_and_each_remark_once() -> None:
    """Remarks of one field have its name; defaults are those of all: that of a width not where there are several."""
    defaults = {"width": 3.0, "speed_kmh": 5.0}
    plans = tuple(replace(plan, headland_order="last", remarks=(REMARK,)) for plan in DEADLINE.plans)
    alike = replace(DEADLINE, plans=plans, scenario={**DEADLINE.scenario, "defaults": defaults})
    first, *others = (replace(one, ranking=one.ranking and alike) for one in build_records(3))
    legend = "Each starts at 13:00. In time: before 17:00. Headland last. Planned with the defaults --speed-kmh 5"
    assert f"{legend} --width 3." in " ".join(print_text(build_many_fields_screen([first, *others])).split())
    assert list_remarks([first, *others]) == [f"{REMARK[0].upper()}{REMARK[1:]}."]
    wider = replace(alike, scenario={**alike.scenario, "defaults": {"speed_kmh": 5.0}}, plans=DEADLINE.plans)
    widths = [first, replace(first, way=replace(first.way, width_m=6.0), ranking=wider)]
    text = " ".join(print_text(build_many_fields_screen(widths)).split())
    assert text.startswith("3 m: 2 tractors, split-field: done 14:50, 143 EUR. 6 m: 2 tractors, split-field: done")
    assert "--speed-kmh 5." in text and "--width" not in text and f"denmark at 3 m: {REMARK[0].upper()}" in text


def test_a_width_that_the_tractor_cannot_pull_has_no_plan_in_a_table() -> None:
    first = build_records(2)[0]
    text = " ".join(print_text(build_many_fields_screen([first, replace(first, ranking=RANKINGS["too weak"])])).split())
    assert "denmark 3.92 - no plan - - -" in text and text.count("Not feasible at this speed.") == 1
