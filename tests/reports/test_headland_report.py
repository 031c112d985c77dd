"""A comparison of headlands in words and tables, from figures made by hand; pages of it and of many fields."""

import csv
import io
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from reports.common.plan_records import PlanDrive, UnworkedPiece
from reports.common.plan_results import FieldPartPlan, PlanRanking, PlanResult
from reports.plan.comparison import (
    ComparedWay,
    Comparison,
    ComparisonRow,
    list_cut_off,
    list_missing,
    name_choice,
)
from reports.plan.headland_report import (
    build_headland_table,
    describe_comparison,
    format_headland_csv,
    format_headland_json,
    render_headland_page,
)
from reports.plan.many_fields import (
    build_many_fields_screen,
    build_many_fields_table,
    format_many_fields_json,
    render_many_fields_page,
    sum_over_fields,
)
from reports.plan.map_data import build_small_map
from tests.printing import print_text

SQUARE, ROUND = ComparedWay("square", "first", 3, 3.0), ComparedWay("round", "last", 2, 3.0)


def make_plan(time_s: float, missed_m2: float, field_m2: float, **figures: Any) -> PlanResult:
    """A plan at 36 an hour, 0.01 a second; missed ground is charged at its rate."""
    cost = 0.01 * time_s
    charged = field_m2 / (field_m2 - missed_m2)
    return PlanResult(
        "split-field", 2, "omega", True, time_s=time_s, cost=cost, finished_s=time_s * charged,
        finished_cost=cost * charged, missed_m2=missed_m2, worked_pct=100.0 * (1.0 - missed_m2 / field_m2),
        **{"overlap_pct": 1.0, "over_finished_m2": 50.0, **figures},
    )  # fmt: skip


def compare(name: str, choice: ComparedWay, plan: PlanResult | None, area_ha: float, **more: Any) -> ComparisonRow:
    ranking = PlanRanking(name, area_ha, 1, () if plan is None else (plan,), currency="EUR", **more)
    return ComparisonRow(f"farm.geojson#{name}", choice, ranking)


def replace_plan(row: ComparisonRow, plan: PlanResult) -> ComparisonRow:
    """The row with another plan."""
    assert row.ranking is not None
    return replace(row, ranking=replace(row.ranking, plans=(plan,)))


@pytest.fixture
def comparison() -> Comparison:
    """One hectare and two hectares: square misses nothing, round a tenth of a hectare of the small field."""
    return Comparison(
        (
            compare("east", SQUARE, make_plan(3600.0, 0.0, 10_000.0), 1.0),
            compare("east", ROUND, make_plan(3240.0, 1000.0, 10_000.0, over_finished_m2=10.0), 1.0),
            compare("west", SQUARE, make_plan(7200.0, 0.0, 20_000.0), 2.0),
            compare("west", ROUND, make_plan(6000.0, 0.0, 20_000.0, over_finished_m2=10.0), 2.0),
        )
    )


def test_roads_and_breaks_of_a_farm_are_no_field_work(comparison: Comparison) -> None:
    """East begins after 10 minutes of road and has a break of 45 minutes."""
    first = comparison.rows[0]
    assert first.best is not None
    on_farm = replace_plan(first, replace(first.best, ready_s=600.0, done_s=3600.0 + 600.0 + 2700.0))
    before, after = (Comparison(plans).sum_over_fields(plans)[0] for plans in ((first,), (on_farm,)))
    assert before.time_s == after.time_s == 3600.0


def print_table(renderable: Any, width: int) -> list[str]:
    return print_text(renderable, width).splitlines()


def test_missed_ground_is_charged(comparison: Comparison) -> None:
    """3240 s for nine tenths of a hectare cost 36 a hectare, as 3600 s for all of it do."""
    square, round_ = comparison.totals[1], comparison.totals[0]
    assert (round_.way, square.way) == (ROUND, SQUARE)
    assert round_.cost == pytest.approx(92.4) and round_.charged_cost == pytest.approx(36.0 + 60.0)
    assert square.cost_per_ha == pytest.approx(108.0 / 3.0) and round_.cost_per_ha == pytest.approx(96.0 / 3.0)
    assert round_.missed_m2 == 1000.0 and round_.overlap_m2 == pytest.approx(300.0) and round_.time_s == 9240.0
    east, west = comparison.totals_by_field.values()
    assert east[0].charged_cost == pytest.approx(east[1].charged_cost) and west[0].way == ROUND


def test_first_screen_at_80_columns(comparison: Comparison) -> None:
    assert print_table(build_headland_table(comparison), 80) == [
        "Worth it on 2 fields (3.00 ha): round corners, headland last, 2 passes: 12 EUR",
        "(11.1 %) less than square, first, 3 passes.",
        "With 1 operation a year it takes 2.57 h, 92 EUR.",
        "It saves most on west: 12 EUR against the dearest way there.",
        "It misses 1000 m2 and drives over 20 m2 of finished ground; square, first, 3",
        "passes misses least (0 m2).",
        "",
        "                                                                   Driven",
        "                                                    Missed Overlap   over",
        "Headland                EUR/ha More h/year EUR/year     m2      m2     m2",
        "round, last, 2 passes     32.0 best   2.57       92   1000     300     20",
        "square, first, 3 passes   36.0  +12   3.00      108      0     300    100",
        "",
        "Field Best headland         Saves EUR/ha h/year Missed m2   ha",
        "east  round, last, 2 passes  0.00   36.0   0.90      1000 1.00",
        "west  round, last, 2 passes    12   30.0   1.67         0 2.00",
        "Sums of the best plan of every field. Missed: not worked; overlap: worked more",
        "than once; driven over: finished ground under wheels, headland included; cost",
        "per hectare that is worked. Per year: all fields, as driven and paid. More: with",
        "missed ground finished, above the best.",
        "",
    ]


@pytest.mark.parametrize("width", [60, 80, 120])
def test_no_line_is_too_long_with_fuel(comparison: Comparison, width: int) -> None:
    plans = tuple(replace_plan(each, replace(each.best, fuel_l=12.4)) for each in comparison.rows if each.best)
    lines = print_table(build_headland_table(Comparison(plans)), width)
    assert max(map(len, lines)) <= width
    assert width < 80 or any("l/" in line for line in lines)
    part = (replace_plan(plans[0], replace(comparison.rows[0].best, fuel_l=None)), *plans[1:])  # type: ignore[type-var]
    assert " l/" not in " ".join(print_table(build_headland_table(Comparison(part)), 120))


def test_a_year_is_every_operation_on_all_fields(comparison: Comparison) -> None:
    """Three times 9240 s are 7.7 h and 277.20 EUR; square costs 36 EUR more in a year. Risked money is not paid."""
    plans = tuple(
        replace_plan(
            each, replace(each.best, fuel_l=10.0, paid_cost=each.best.cost, expected_cost=1.1 * each.best.cost)
        )
        for each in comparison.rows
        if each.best and each.best.cost
    )
    yearly = Comparison(plans, operations_per_year=3)
    round_, square = yearly.totals
    assert list(round_.year.values()) == pytest.approx([7.7, 60.0, None, 277.2]) and round_.time_s == 9240.0
    answer = describe_comparison(Comparison(comparison.rows, operations_per_year=3))
    assert answer[0].startswith("Worth it on 2 fields (3.00 ha, 3 operations a year): round corners")
    assert "36 EUR (11.1 %) less than square" in answer[0]
    assert describe_comparison(yearly)[1] == "With 3 operations a year it takes 7.70 h, 60 l, 277 EUR."
    data = json.loads(format_headland_json(yearly))
    assert data["operations_per_year"] == 3 and data["totals"][1]["hours_per_year"] == pytest.approx(9.0)
    assert data["totals"][1]["cost_per_year"] == pytest.approx(square.year["cost_per_year"]) == pytest.approx(324.0)
    rows = list(csv.DictReader(io.StringIO(format_headland_csv(yearly))))
    assert [float(row["cost_per_year"]) for row in rows] == pytest.approx([108.0, 97.2, 216.0, 180.0])
    nothing = ComparisonRow("farm.geojson#west", ROUND, refusal="No path leads from track 1.")
    assert set(Comparison((nothing,)).totals[0].year.values()) == {None}


def test_widths_are_named_where_there_are_several(comparison: Comparison) -> None:
    ways = [replace(SQUARE, width_m=width_m) for width_m in (3.0, 4.5)]
    plans = tuple(compare("east", way, make_plan(3600.0, 0.0, 10_000.0), 1.0) for way in ways)
    names = [name_choice(one) for one in Comparison(plans).totals]
    assert names == ["square, first, 3 passes, 3 m", "square, first, 3 passes, 4.5 m"]
    assert [name_choice(one) for one in Comparison(plans[:1]).totals] == ["square, first, 3 passes"]
    ways_told = [one["width_m"] for one in json.loads(format_headland_json(Comparison(plans)))["totals"]]
    assert ways_told == [3.0, 4.5]


def test_ground_that_is_cut_off_is_explained_once_for_every_width(comparison: Comparison) -> None:
    """A neck of 4 m lets 3 m through and not 6 m; a piece too small for a plan of its own has a place as well."""
    plan = make_plan(3600.0, 0.0, 10_000.0)
    part = FieldPartPlan(2, UnworkedPiece(3600.0, 200.0, 30.0), UnworkedPiece(0.0, 145.0, 30.0), 4.0, plan)
    narrow, wide = (replace(SQUARE, width_m=width_m) for width_m in (3.0, 6.0))
    plans = (
        compare("east", narrow, plan, 1.0),
        compare("east", wide, plan, 1.0, parts=(part,)),
        compare("east", replace(wide, corners="round"), plan, 1.0, parts=(part,)),
        compare("west", narrow, plan, 1.0),
        compare("west", wide, plan, 1.0),
    )
    assert list_cut_off(Comparison(plans)) == [
        "east, 3 m: nothing is cut off.",
        "east, 6 m: 0.36 ha at x 200 m, y 30 m are cut off: the way there is 4.0 m wide at x 145 m, y 30 m; narrower "
        "machines would pass. Planned on its own (part 2) it takes 1:00:00, 100.0 % worked; tractors go round by road.",
    ]
    only_wide = Comparison(plans[1:3])
    assert "3600 m2 are cut off for it (see below)" in describe_comparison(only_wide)[-1]
    assert "Cut off" in print_table(build_headland_table(only_wide), 80)
    assert json.loads(format_headland_json(only_wide))["fields"][0]["parts"][0]["neck_width_m"] == 4.0
    assert [row["cut_off_m2"] for row in csv.DictReader(io.StringIO(format_headland_csv(only_wide)))] == ["3600.0"] * 2
    small = Comparison((compare("east", SQUARE, plan, 1.0, cut_off=UnworkedPiece(120.0, 7.0, 8.0)),))
    (told,) = list_cut_off(small)
    assert told.startswith("east: Obstacles cut off 120 m2, the most at x 7 m, y 8 m: too small")
    assert list_cut_off(comparison) == []


def test_a_field_with_another_best_way_is_named_and_many_are_counted(comparison: Comparison) -> None:
    """East: square 36 EUR, round 40 EUR; west: 72 and 60. Then three fields like east, and round saves 24 on west."""
    dear = replace_plan(comparison.rows[1], make_plan(4000.0, 0.0, 10_000.0))
    changed = Comparison((comparison.rows[0], dear, *comparison.rows[2:]))
    told = "On east square corners, headland first, 3 passes is better by 4.00 EUR (10.0 %)."
    assert changed.best.way == ROUND and told in describe_comparison(changed)
    times = [(name, 3600.0, 4000.0, 1.0) for name in "abc"] + [("west", 7200.0, 4800.0, 2.0)]
    plans = [
        compare(name, way, make_plan(time_s, 0.0, 10_000.0 * area_ha), area_ha)
        for name, square_s, round_s, area_ha in times
        for way, time_s in ((SQUARE, square_s), (ROUND, round_s))
    ]
    sentences = describe_comparison(Comparison(tuple(plans)))
    assert sentences[2] == "On 3 of 4 fields another way is better, by 12 EUR together; the second table names them."


def test_ways_that_cost_the_same_or_nearly_so_are_said_to(comparison: Comparison) -> None:
    """Nothing at all; 36.00 and 36.10; 36.00, 36.10 and 40 EUR: a tenth is no reason to change."""
    free = (
        replace_plan(each, replace(each.best, cost=0.0, finished_cost=0.0)) for each in comparison.rows if each.best
    )
    told = describe_comparison(Comparison(tuple(free)))[0]
    assert told.startswith("All ways cost the same within 0.00 EUR on 2 fields")
    ways = {SQUARE: 3600.0, ROUND: 3610.0, ComparedWay("square", "last", 2, 3.0): 4000.0}
    plans = [compare("east", way, make_plan(time_s, 0.0, 10_000.0), 1.0) for way, time_s in ways.items()]
    assert describe_comparison(Comparison(tuple(plans[:2])))[0] == (
        "All ways cost the same within 0.10 EUR on east (1.00 ha); the least: square corners, headland first, 3 passes."
    )
    assert describe_comparison(Comparison(tuple(plans)))[0] == (
        "Worth it on east (1.00 ha): square corners, headland first, 3 passes: 4.00 EUR (10.0 %) less than square, "
        "last, 2 passes, the dearest; round, last, 2 passes costs the same within 0.10 EUR."
    )


def test_ways_that_fail_come_last_and_are_not_compared(comparison: Comparison) -> None:
    failed = ComparisonRow("farm.geojson#west", ROUND, refusal="No path leads from track 1.")
    partial = Comparison((*comparison.rows[:3], failed))
    assert [one.way for one in partial.totals] == [SQUARE, ROUND] and partial.best is partial.totals[0]
    assert list_missing(partial) == ["west: round, last, 2 passes: No path leads from track 1."]
    assert describe_comparison(partial)[0].startswith("Only this way works: square corners")
    data = json.loads(format_headland_json(partial))
    assert data["best"] == {"corners": "square", "headland_order": "first", "headland_passes": 3, "width_m": 3.0}
    assert [(one["corners"], one["fields"]) for one in data["totals"]] == [("square", 2), ("round", 1)]
    nothing = Comparison((failed,))
    assert nothing.best is None and describe_comparison(nothing) == [
        "No way to work the headland works; the reasons are below."
    ]
    assert list_missing(nothing)[0].startswith("farm.geojson#west: round, last, 2 passes: ")
    split = Comparison(
        (
            comparison.rows[0],
            replace(failed, requested_field="farm.geojson#east", way=ROUND),
            comparison.rows[3],
            replace(failed, way=SQUARE),
        )
    )
    assert split.best is None and describe_comparison(split)[0].startswith("No way to work the headland works on every")


def test_a_small_map_is_small_and_in_its_frame(listed_drive: PlanDrive) -> None:
    ring = np.array([[100.0, 30.0], [110.0, 30.0], [110.0, 31.0], [100.0, 31.0]])
    drawn = build_small_map(listed_drive, [ring])
    assert json.loads(json.dumps(drawn)) == drawn and len(json.dumps(drawn)) < 60_000
    assert len(drawn["lanes"]) == len(listed_drive.xy) and all(lane["work"] for lane in drawn["lanes"])
    assert drawn["driven_over"].startswith("M") and drawn["driven_over"].count("z") == 1
    x, y = map(int, drawn["driven_over"][1:].split("l")[0].split())
    assert 0 < x < drawn["width"] and 0 < y < drawn["height"]


def make_record(name: str, area_ha: float, plan: PlanResult, drawing: dict[str, Any] | None) -> ComparisonRow:
    scenario = {"tractor": "Yanmar EG105", "width_m": 3.0, "headland_m": 9.0, "bearing_deg": 90.0}
    plans = (replace(plan, rank=1, headland_passes=3, headland_order="last"),)
    ranking = PlanRanking(name, area_ha, 1, plans, currency="EUR", scenario=scenario)
    return ComparisonRow(f"farm.geojson#{name}", SQUARE, ranking, map=drawing)


@pytest.fixture
def records(drive: PlanDrive) -> list[ComparisonRow]:
    return [
        make_record("east", 1.0, make_plan(3600.0, 0.0, 10_000.0), build_small_map(drive)),
        make_record("west", 2.0, make_plan(5400.0, 600.0, 20_000.0), build_small_map(drive)),
        ComparisonRow("farm.geojson#tiny", SQUARE, refusal="It is too small."),
    ]


def test_totals_of_fields_leave_out_what_has_no_plan(records: list[ComparisonRow]) -> None:
    """Three hectares in 9000 s for 90 EUR; 600 m2 of 30,000 are missed."""
    (total,) = sum_over_fields(records)
    assert (len(total.driven), total.area_ha, total.end_s, total.missed_m2) == (2, 3.0, 9000.0, 600.0)
    assert total.cost == pytest.approx(90.0) and total.cost / total.area_ha == pytest.approx(30.0)
    assert total.worked_pct == pytest.approx(98.0)
    (row,) = [line.split() for line in print_table(build_many_fields_table(records), 120) if line.startswith("Total ")]
    assert row == ["Total", "3.00", "3", "2:30:00", "98.0", "90"]
    told = json.loads(format_many_fields_json(records))
    assert [one["requested_field"].partition("#")[2] for one in told["fields"]] == ["east", "west", "tiny"]
    assert [one["refusal"] for one in told["fields"]] == [None, None, "It is too small."]
    assert [one["ranking"] is None for one in told["fields"]] == [False, False, True]
    sums = {"area_ha": 3.0, "time_s": 9000.0, "cost": 90.0, "missed_m2": 600.0, "over_finished_m2": 100.0}
    (totals,) = told["totals"]
    assert totals == {"width_m": 3.0, "fields": 2, "cost_per_ha": 30.0, "paid_cost": 90.0, "risked_cost": 0.0, **sums}


def test_a_reason_stands_once_for_all_widths_of_a_field_and_fields_of_one_name_stay_apart() -> None:
    wide = replace(SQUARE, width_m=4.0)
    records = [
        ComparisonRow(f"{folder}/north.geojson", way, refusal="It is too small.")
        for folder in ("a", "b")
        for way in (SQUARE, wide)
    ]
    told = print_table(build_many_fields_table(records), 120)
    assert "Without a plan: 4 of 4" in told
    assert told[-2:] == [f"{folder}/north.geojson at 3 m and 4 m: It is too small." for folder in ("a", "b")]
    on_screen = " ".join(print_table(build_many_fields_screen(records), 120))
    assert on_screen.count("north.geojson at 3 m and 4 m: It is too small.") == 2


class TestPages:
    @pytest.mark.slow
    def test_compared_headlands(
        self, browser: Any, comparison: Comparison, listed_drive: PlanDrive, tmp_path: Path
    ) -> None:
        drawing = build_small_map(listed_drive, [np.array([[100.0, 30.0], [110.0, 30.0], [110.0, 31.0]])])
        page = render_headland_page(Comparison(tuple(replace(each, map=drawing) for each in comparison.rows)))
        shown = open_page(browser, page, tmp_path)
        assert shown.locator("h1").inner_text() == "Headlands compared: 2 fields"
        assert shown.locator(".lead").inner_text().startswith("Worth it on\N{NO-BREAK SPACE}2 fields")
        assert shown.locator("figure svg").count() == 4 and shown.locator("figure.best").count() == 2
        assert "driven over when finished" in shown.locator(".legend").inner_text()
        assert shown.locator("tr.best td").first.inner_text() == "round, last, 2 passes"
        check_faults(shown)

    @pytest.mark.slow
    def test_many_fields(self, browser: Any, records: list[ComparisonRow], tmp_path: Path) -> None:
        shown = open_page(browser, render_many_fields_page(records), tmp_path)
        lead = shown.locator(".lead").inner_text().replace("\N{NO-BREAK SPACE}", " ")
        assert "2 of 3 fields, 3.00 ha, 2:30:00 one after the other" in lead
        assert shown.locator("figure svg").count() == 2
        shown.locator("td a", has_text="west").click()
        assert shown.evaluate("document.querySelector(':target h2').textContent").startswith("west")
        assert "farm.geojson#tiny at 3 m: It is too small." in shown.locator("ul.plain").inner_text()
        check_faults(shown)


def open_page(browser: Any, text: str, folder: Path) -> Any:
    """The page in a browser that reaches nothing else."""
    path = folder / "page.html"
    path.write_text(text, encoding="utf-8")
    shown = browser.new_page()
    shown.route("http*://**", lambda route: pytest.fail(f"{route.request.url} was asked for"))
    shown.goto(path.as_uri())
    return shown


def check_faults(shown: Any) -> None:
    from tests.service.accessibility import find_faults_at_widths

    assert find_faults_at_widths(shown) == []
    shown.close()
