"""Tables on consoles of several widths."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Group

from fields.documents.reader import FieldSummary
from reports.common.plan_results import PlanRanking
from reports.common.text_tables import break_text_at_marks
from reports.plan.field_report import build_field_table, build_parcels_table, format_parcels_json
from reports.plan.ranking_table import build_first_screen, build_ranking_table
from reports.trials.report import FleetStudy, build_study_tables
from tests.printing import print_text

FIGURES = {
    "Cost": ["6.89", "7.10", "5.65", "8.19", "4.92", "5.51"],
    "Turning": ["0:05:05", "0:05:05", "0:03:03", "0:02:02", "0:01:01", "0:01:01"],
    "Waiting": ["0:00:50", "0:00:50", "0:00:25", "0:00:13", "0:00:00", "0:00:00"],
    "Worked %": ["98.7"] * 6,
    "Overlap %": ["1.3"] * 6,
    "Clearance m": ["2.35", "2.35", "2.35", "2.35", "-", "-"],
    "In time": ["yes", "yes", "yes", "no", "no", "no"],
}


@pytest.mark.parametrize("width", [40, 60, 80, 120, 200])
def test_what_is_left_has_a_column_where_there_is_room_and_a_word(leaving: PlanRanking, width: int) -> None:
    text = print_text(build_ranking_table(leaving), width)
    flat = " ".join(text.split())
    assert max(map(len, text.splitlines())) <= width
    assert "Unworked: ground that no implement worked; ranks include the time to finish it" in flat
    missing = re.search(r"No room for: (.*?); a wider", flat)
    dropped = missing is not None and "Unworked" in missing.group(1).split(", ")
    rows = [line for line in text.splitlines() if re.match(r"[ >]*[1-6][* ] ", line)]
    told = [re.findall(r" (0\.\d\d) ha(?= )", row + " ") for row in rows]
    assert told == [[] if dropped else [ha] for ha in ("0.38", "0.38", "0.19", "0.19", "0.19", "0.19")]
    assert not dropped or width < 80


def test_little_that_is_left_is_told_in_square_metres_and_nothing_has_no_column(
    leaving: PlanRanking, ranking: PlanRanking
) -> None:
    plans = tuple(replace(plan, missed_m2=40.0) if plan.rank == 1 else plan for plan in leaving.plans)
    text = print_text(build_ranking_table(replace(leaving, plans=plans)))
    rows = [line for line in text.splitlines() if line.startswith(" 1")]
    assert len(rows) == 1 and " 40 m2 " in rows[0] and "0.00" not in rows[0]
    assert "Unworked" not in print_text(build_ranking_table(ranking), 200)


@pytest.mark.parametrize("width", [60, 80, 120])
def test_columns_are_explained_and_the_curve_against_count_is_a_table(ranking: PlanRanking, width: int) -> None:
    plans = tuple(
        replace(plan, finish_probability=0.2 * plan.tractors - 0.001, p50_s=3000.0, p95_s=4000.0,
                expected_cost=100.0 + plan.tractors, paid_cost=90.0)
        if plan.feasible else plan
        for plan in ranking.plans
    )  # fmt: skip
    machines = {"tractor": "Carrier", "width_m": 4.0, "implement": None}
    told = replace(ranking, plans=plans, currency="EUR", samples=100, chosen=("split-field", 3))
    text = print_text(build_ranking_table(replace(told, scenario=machines)), width)
    flat = " ".join(text.split())
    assert max(map(len, text.splitlines())) <= width
    screen = print_text(build_first_screen(replace(told, scenario=machines)), width)
    if width != 80:  # there the alternatives take the line of the title
        assert screen.startswith("Iwamizawa, 1.89 ha, Carrier, implement 4 m\n")
    assert "Clearance: smallest distance between two tractors" in flat and "In time %: of the samples" in flat
    rows = [
        row for row in text[text.index("By number of tractors, money in EUR") :].splitlines() if row.endswith(" 90")
    ]
    assert [row.split()[0].lstrip(">") for row in rows] == ["1", "2", "3", "5"]
    assert any(row.split()[0] == ">3" and " 103 " in row and " 60 " in row for row in rows)


@pytest.mark.parametrize("width", [40, 60, 80, 120, 200])
def test_no_line_is_wider_than_the_console(ranking: PlanRanking, study: FleetStudy, width: int) -> None:
    long = replace(
        ranking,
        plans=tuple(
            replace(p, strategy="row-by-row-optimised", turn="switch-back", time_s=98765.0, cost=123456.7,
                    turning_s=45678.0, waiting_s=45678.0, tractors=11, rank=p.rank and p.rank + 90)
            for p in ranking.plans
        ),
    )  # fmt: skip
    for what in (build_ranking_table(ranking), build_ranking_table(long), build_study_tables(study)):
        assert max(len(line) for line in print_text(what, width).splitlines()) <= width
    assert print_text(build_ranking_table(long), width).count("27:26:05") >= 6, "figures are never cut"


def test_eighty_columns_show_every_figure_on_one_line_and_mark_the_best(ranking: PlanRanking) -> None:
    text = print_text(build_ranking_table(ranking))
    (best,) = [line.split() for line in text.splitlines() if line.startswith(">")]
    assert best == [">3*", "3", "split-field", "0:28:32", "5.65", "0:03:03", "0:00:25", "98.7", "1.3", "2.35", "yes"]
    assert "> best plan." in " ".join(text.split())
    alone = next(line for line in text.splitlines() if line.lstrip().startswith("5*"))
    assert alone.split()[-2:] == ["-", "no"], "one tractor has no clearance"


@pytest.mark.parametrize("width", [40, 60, 80, 120, 200])
def test_a_column_is_whole_or_named_as_missing(ranking: PlanRanking, width: int) -> None:
    text = print_text(build_ranking_table(ranking), width)
    flat = " ".join(text.split())
    named = re.search(r"No room for: (.*?); a wider window or --json shows all\.", flat)
    missing = named.group(1).split(", ") if named else []
    lines = [line for line in text.splitlines() if re.match(r"[ >]*[1-6][* ] ", line)]
    assert len(lines) == 6
    figures = [re.findall(r"(?<= )(?:[\d.:]+|-|yes|no)(?= |$)", line.strip()) for line in lines]
    times = ["0:20:53", "0:21:30", "0:28:32", "1:02:05", "1:14:35", "1:23:32"]
    shown = [values for heading, values in FIGURES.items() if heading not in missing]
    for number, row in enumerate(figures):
        assert row[-1 - len(shown) :] == [times[number], *(values[number] for values in shown)]
    assert set(missing) <= {*FIGURES, "Turn"} and (not missing or width <= 80)
    assert width > 40 or set(missing) >= {"Clearance m", "Overlap %", "Waiting"}
    assert width < 120 or "Trac-" not in text, "headings are whole where they have room"
    free = replace(ranking, plans=tuple(replace(plan, meets_deadline=None) for plan in ranking.plans), deadline=None)
    assert "In time" not in print_text(build_ranking_table(free), width)


def test_too_narrow_for_a_table_is_a_list(ranking: PlanRanking) -> None:
    lines = print_text(build_ranking_table(ranking), 20).splitlines()
    assert max(map(len, lines)) <= 20
    assert "  Time: 0:20:53" in lines and "  Clearance m: 2.35" in lines and lines.count("  Worked %: 98.7") == 6


def test_cost_and_its_value_stay_on_one_line(ranking: PlanRanking) -> None:
    for width in range(30, 130, 3):
        text = print_text(Group(build_first_screen(ranking), build_ranking_table(ranking)), width)
        for said in ("done 08:29", "in 0:28:32", "98.7 %"):
            assert said in text, width


def test_headline_comes_first_and_refusals_last(ranking: PlanRanking) -> None:
    text = " ".join(print_text(Group(build_first_screen(ranking), build_ranking_table(ranking))).split())
    order = ["3 tractors, split-field: done 08:29", "can be met with 3 or 5", "Fastest:", "Cheapest:",
             "(Pareto front)", "Refused: 4 plans", "2 x Turning radius", "7 and 9", "1 x Tractors 2"]  # fmt: skip
    places = [text.index(part) for part in order]
    assert places == sorted(places)
    refused = replace(ranking, plans=ranking.plans[6:])
    nothing = print_text(Group(build_first_screen(refused), build_ranking_table(refused)))
    assert nothing.count("No plan works: all 4 were refused") == 1 and "(Pareto front)" not in nothing


def test_only_the_best_are_shown_when_asked_with_their_remarks(ranking: PlanRanking) -> None:
    plans = tuple(replace(p, remarks=("it waits",) if p.rank == 6 else ()) for p in ranking.plans)
    noted = replace(ranking, plans=plans)
    for most, ranks, told in (
        (2, ["1", "2", "3", "4", "5"], "1 slower plan is not shown; --all shows every plan."),  # with the front
        (0, ["1", "3", "4", "5"], "2 slower plans are not shown; --all shows every plan."),
        (None, ["1", "2", "3", "4", "5", "6"], "split-field with 1: it waits."),
    ):
        text = print_text(build_ranking_table(noted, most))
        assert re.findall(r"^[ >]*(\d+)[* ] ", text, flags=re.M) == ranks
        assert told in " ".join(text.split())
        assert ("it waits" in text) == ("not shown" not in text) == (most is None)


def test_the_front_and_the_best_plan_are_shown_however_slow(ranking: PlanRanking) -> None:
    quick, slow = ranking.plans[1], ranking.plans[4]
    plans = [replace(quick, rank=rank, time_s=1000.0 + rank) for rank in range(1, 26)]
    plans += [replace(slow, rank=26), replace(quick, tractors=4, rank=27, time_s=3500.0, cost=0.01)]
    plans += [replace(slow, rank=28, on_pareto_front=False)]
    crowded = replace(ranking, plans=tuple(plans))
    assert crowded.best is plans[26]
    text = print_text(build_ranking_table(crowded))
    assert re.findall(r"^[ >]*(\d+)[* ] ", text, flags=re.M) == [*map(str, range(1, 21)), "26", "27"]
    assert "6 slower plans are not shown; --all shows every plan." in " ".join(text.split())


@pytest.mark.parametrize("width", [60, 80, 100])
def test_names_of_strategies_and_turns_are_whole_with_draws_too(ranking: PlanRanking, width: int) -> None:
    plans = tuple(
        replace(plan, strategy=name, turn="switch-back+omega", tractors=1 + place, finish_probability=0.5,
                paid_cost=1234.5, expected_cost=2345.6, p50_s=9000.0, p95_s=9900.0, missed_m2=40.0)
        for place, (plan, name) in enumerate(zip(ranking.plans, ("row-by-row-optimised", "split-field"), strict=False))
    )  # fmt: skip
    told = replace(ranking, plans=plans, currency="EUR", chosen=("split-field", 2))
    text = print_text(build_ranking_table(told), width)
    assert text.count("row-by-row-optimised ") >= 2 and text.count("split-field ") >= 2
    assert "switch-back+" in text and "switch-\n" not in text
    assert max(map(len, text.splitlines())) <= width


@pytest.mark.parametrize("width", [76, 80, 100, 120])
def test_plans_with_long_names_have_one_line_each(ranking: PlanRanking, width: int) -> None:
    plans = tuple(
        replace(plan, strategy="row-by-row-optimised", turn="omega+switch-back", time_s=9876.0, cost=123.45,
                turning_s=4567.0, waiting_s=4567.0)
        for plan in ranking.plans[:6]
    )  # fmt: skip
    text = print_text(build_ranking_table(replace(ranking, plans=plans)), width)
    rows = [line for line in text.splitlines() if re.match(r"[ >]*[1-6][* ] ", line)]
    assert len(rows) == 6 and all("row-by-row-optimised" in row and "2:44:36" in row for row in rows), "one line each"
    assert all("omega+switch-back" in row for row in rows) or "No room for: Turn" in text


@given(st.text(alphabet="ab +-", max_size=30), st.integers(1, 30))
def test_broken_lines_hold_the_same_words(text: str, width: int) -> None:
    lines = break_text_at_marks(text, width)
    assert re.sub(" +", "", "".join(lines)) == re.sub(" +", "", text)
    assert all(len(line) <= width or re.fullmatch("[ab]+[+-]?", line) for line in lines)


def test_breaks_come_at_spaces_first_then_plus_then_hyphen() -> None:
    assert break_text_at_marks("row-by-row omega+route", 22) == ["row-by-row omega+route"]
    assert break_text_at_marks("row-by-row omega+route", 15) == ["row-by-row", "omega+route"]
    assert break_text_at_marks("row-by-row omega+route", 10) == ["row-by-row", "omega+", "route"]
    assert break_text_at_marks("row-by-row omega+route", 8) == ["row-by-", "row", "omega+", "route"]


def test_plain_text_in_a_pipe_and_markup_of_names_is_text(ranking: PlanRanking, study: FleetStudy) -> None:
    for what in (build_ranking_table(ranking), build_study_tables(study), build_field_table({"name": "a"})):
        text = print_text(what)
        assert text.isascii() and "\x1b" not in text
    assert "[red]x[/red]" in print_text(build_first_screen(replace(ranking, field_name="[red]x[/red]")))
    assert "[bold]" in print_text(build_field_table({"[bold]": 1}))


def test_study_rows_and_verdicts(study: FleetStudy) -> None:
    lines = print_text(build_study_tables(study)).splitlines()
    assert next(line for line in lines if line.startswith("one tractor")).split()[2:] == ["1", "74:35", "76:53", "+3.1"]
    assert next(line for line in lines if line.startswith("formation")).split()[1:] == ["3", "25:30", "24:59", "-2.0"]
    text = " ".join(" ".join(lines).split())
    places = [text.index(part) for part in ("Table 6.1", "Table 6.2", "Table 6.3", "Claims", "holds", "Assumptions")]
    assert places == sorted(places)
    assert text.count("does not hold") == 1


def test_field_values_read_well_and_labels_carry_their_units() -> None:
    info = {"Name": "Iwamizawa", "Area": 1.234567891, "Holes": 0, "Entrance": None, "Corner": np.array([1.5, 2.0]),
            "Sides": {"north": 270.0, "open": True}, "Empty": []}  # fmt: skip
    rows = [line.strip().split(maxsplit=1) for line in print_text(build_field_table(info)).splitlines()]
    assert dict(rows[:5]) == {"Name": "Iwamizawa", "Area": "1.23457", "Holes": "0", "Entrance": "-", "Corner": "1.5, 2"}
    assert " ".join(rows[5] + rows[6]).split() == ["Sides", "North:", "270", "Open:", "yes"]
    assert rows[7] == ["Empty", "-"]
    facts = {"area_ha": 1.9, "m": 2, "turns": {"omega_fits": True, "over_s": {"1": 9.5, "2": 8}}}
    lines = [" ".join(line.split()) for line in print_text(build_field_table(facts)).splitlines()]
    assert lines == ["Area (ha) 1.9", "M 2", "Turns Omega fits: yes", "Over (s): 1: 9.5, 2: 8"]


def test_a_list_of_fields_has_a_column_where_one_lies_in_another_or_cannot_be_used() -> None:
    north, pond = FieldSummary(0, "north", 1.23456, 2), FieldSummary(1, "pond", 0.5, 0, inside="north")
    lines = [line.split() for line in print_text(build_parcels_table([north])).splitlines()]
    assert lines == [["#", "ID", "Area", "(ha)", "Holes"], ["0", "north", "1.23", "2"]]
    several = [north, pond, FieldSummary(2, "bow", fault="crosses itself")]
    head, *rows = [" ".join(line.split()) for line in print_text(build_parcels_table(several)).splitlines()]
    assert head == "# ID Area (ha) Holes Inside Not usable"
    assert rows == ["0 north 1.23 2", "1 pond 0.50 0 north", "2 bow - - crosses itself"]
    assert [list(one.values()) for one in json.loads(format_parcels_json(several))] == [
        [0, "north", 1.2346, 2, None, None],
        [1, "pond", 0.5, 0, None, "north"],
        [2, "bow", None, None, "crosses itself", None],
    ]


@pytest.mark.parametrize("width", [16, 40, 60, 80, 120, 200])
def test_field_and_study_figures_are_whole(study: FleetStudy, width: int) -> None:
    info = {"area_ha": 1.89234, "corner": [123456.0, -98765.4], "turns_s": {"omega": 12345.6, "u": 8.0}}
    for what, figures in (
        (build_field_table(info), ("1.89234", "123456", "-98765.4", "12345.6")),
        (build_study_tables(study), ("74:35", "76:53", "+3.1", "25:30", "24:59", "-2.0", "20:53", "20:40", "-1.0")),
    ):
        text = print_text(what, width)
        assert max(len(line) for line in text.splitlines()) <= width
        for figure in figures:
            assert re.search(rf"(?<![\d.:+-]){re.escape(figure)}(?![\d.:])", text), figure
