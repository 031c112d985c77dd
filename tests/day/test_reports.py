"""A day for people and programs: keys, tables, pictures."""

import csv
import io
import json
from dataclasses import fields, replace

import numpy as np
import pytest

import reports.day.page  # noqa: F401
from reports.day.page import draw_gantt, draw_road_map, render_day_page
from reports.day.results import DayJob, DayResult, FleetDay, MapPlace, UnworkedField, format_time_of_day
from reports.day.tables import DAY_CSV_KEYS, build_day_table, format_day_csv, format_day_json
from reports.plan.map_figure import render_png, render_svg
from tests.printing import print_text
from tests.reports.test_notebook import EVIL, check_shown

HOUR = 3600.0
JOB = DayJob(
    field="Home $1",
    machine="one",
    strategy="split-field",
    tractors=2,
    area_ha=2.5,
    leaves_s=8 * HOUR,
    km=3.0,
    start_s=8.5 * HOUR,
    end_s=10 * HOUR,
    time_s=5300.0,
    finish_probability=0.975,
    finish_probability_interval=(0.97, 0.98),
    p50_end_s=10.1 * HOUR,
    p95_end_s=11 * HOUR,
    cost=99.5,
    lost_cost=0.0,
    worked_pct=99.0,
    refills=None,
    p50_start_s=8.5 * HOUR,
    p50_leaves_s=8 * HOUR,
)
RING = np.array([[0.0, 0.0], [200.0, 0.0], [200.0, 100.0], [0.0, 100.0], [0.0, 0.0]])


@pytest.fixture
def result() -> DayResult:
    return DayResult(
        start_s=8 * HOUR,
        end_s=26 * HOUR,
        jobs=(
            JOB,
            replace(JOB, field="night", start_s=23 * HOUR, end_s=24.9 * HOUR, p50_end_s=25 * HOUR, p95_end_s=26 * HOUR,
                    p50_start_s=23 * HOUR),
        ),
        unworked_fields=(UnworkedField("far", 1.0, 80.0, "doing it costs 3.10 more than leaving it"),),
        fleets=(
            FleetDay("one", "2 x A, harrow", 8 * HOUR, 25.5 * HOUR, 9.0, p50_home_s=25.6 * HOUR),
            FleetDay("two", "B", None, None, 0.0),
        ),
        gap_pct=2.5,
        cost=321.0,
        finish_probability=0.9,
        currency="EUR",
        samples=1000,
        seed=1,
        advice="Go.",
        remarks=("A remark.",),
        fields=("night", "Home $1", "far"),
        windows=(((22 * HOUR, 26 * HOUR),), ((8 * HOUR, 12 * HOUR), (13 * HOUR, 18 * HOUR)), ()),
        breaks=((12 * HOUR, 13 * HOUR),),
        rain=((15 * HOUR, 0.5),),
        places=(
            MapPlace("Home $1", 0.0, 0.0, RING),
            MapPlace("far", 900.0, 50.0, RING + 900.0),
            MapPlace("yard", -500.0, 0.0),
        ),
        p50_done_s=25 * HOUR,
        p95_done_s=26 * HOUR,
    )  # fmt: skip


def test_keys_and_values(result: DayResult) -> None:
    data = json.loads(format_day_json(result))
    assert list(data) == [
        "jobs", "not_done", "gap_pct", "advice", "machines", "cost", "paid_cost", "risked_cost", "finish_probability",
        "currency", "samples", "seed", "start_s", "end_s", "remarks", "questions", "shortfalls", "certainty_pct",
        "p50_done_s", "p95_done_s", "summary",
    ]  # fmt: skip
    keys = [field.name for field in fields(DayJob)]
    assert all(list(job) == keys for job in data["jobs"])
    for key in keys:
        value = getattr(JOB, key)
        assert data["jobs"][0][key] == (list(value) if isinstance(value, tuple) else value)
    assert data["not_done"] == [
        {"field": "far", "area_ha": 1.0, "cost": 80.0, "reason": "doing it costs 3.10 more than leaving it"}
    ]
    assert data["machines"][1] == {
        "name": "two", "words": "B", "leaves_s": None, "home_s": None, "km": 0.0, "road_cost": 0.0, "p50_home_s": None,
    }  # fmt: skip


def test_csv_has_a_row_per_field(result: DayResult) -> None:
    rows = list(csv.DictReader(io.StringIO(format_day_csv(result))))
    assert [*rows[0]] == [*DAY_CSV_KEYS] and [row["field"] for row in rows] == ["Home $1", "night", "far"]
    assert rows[0]["start_s"] == "30600.0" and rows[2]["start_s"] == "" and rows[2]["reason"].startswith("doing it")


@pytest.mark.parametrize("width", [60, 80, 160])
def test_tables_hold_every_field(result: DayResult, width: int) -> None:
    text = print_text(build_day_table(result), width)
    for words in ("2.5 %", "Home $1", "night", "23:00", "01:00+1", "01:36+1", "stays", "far", "A remark."):
        assert words in text
    assert max(map(len, text.splitlines())) <= width


def test_in_a_notebook_a_day_has_its_jobs_as_in_the_json(result: DayResult) -> None:
    frame, jobs = result.to_pandas(), json.loads(format_day_json(result))["jobs"]
    assert frame["field"].tolist() == [job["field"] for job in jobs]
    for key in ("start_s", "end_s", "p95_end_s", "cost", "worked_pct", "tractors"):
        assert frame[key].tolist() == [job[key] for job in jobs]
    ends = zip(frame["finish_probability_interval_low"], frame["finish_probability_interval_high"], strict=True)
    assert [list(pair) for pair in ends] == [job["finish_probability_interval"] for job in jobs]
    assert "<td" in check_shown(result) and result.plot().get_title("left") == "By machine"
    named = replace(result, jobs=(replace(JOB, field=EVIL),), fields=(EVIL, "far"), advice=EVIL)
    assert EVIL not in check_shown(named)
    assert (
        check_shown(replace(result, jobs=(), fleets=result.fleets[1:])) and replace(result, jobs=()).to_pandas().empty
    )


def test_clock_times() -> None:
    assert [format_time_of_day(seconds) for seconds in (0.0, 59.9, 86_399.0, 90_000.0, None)] == [
        "00:00", "00:01", "00:00+1", "01:00+1", "-",
    ]  # fmt: skip


def test_pictures_and_page_repeat(result: DayResult) -> None:
    gantt = render_svg(draw_gantt(result))
    assert gantt == render_svg(draw_gantt(result))
    for words in ("By machine", "By field", "night", "not done", "rain 50 %", "22:00"):
        assert words in gantt
    drawn = draw_road_map(result)
    assert drawn is not None and "yard" in render_svg(drawn) and "far (not done)" in render_svg(drawn)
    assert render_png(draw_gantt(result))[:4] == b"\x89PNG"
    page = render_day_page(result)
    assert page == render_day_page(result) and "http" not in page.replace("http-equiv", "") and "A remark." in page


def test_a_day_without_anything_has_a_picture_and_no_map(result: DayResult) -> None:
    nothing = replace(
        result, jobs=(), fleets=(FleetDay("one", "", None, None, 0.0),), places=(), finish_probability=None
    )
    assert draw_road_map(nothing) is None and "not done" in render_svg(draw_gantt(nothing))
    assert "Fields and roads" not in render_day_page(nothing)
    one_place = replace(result, places=(MapPlace("a", 5.0, 5.0), MapPlace("b", 5.0, 5.0)))
    assert draw_road_map(one_place) is not None


def test_a_map_of_roads_has_a_title_unless_the_page_has_one(result: DayResult) -> None:
    drawn, plain = draw_road_map(result), draw_road_map(result, has_title=False)
    assert drawn is not None and [one.get_text() for one in drawn.texts] == ["Fields and roads"]
    assert plain is not None and not plain.texts
