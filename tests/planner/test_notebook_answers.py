"""Planned answers in Python: short in text, escaped as HTML, and the same lengths, areas and files as the plan's."""

import json
import math
import pydoc
import sys
from dataclasses import replace
from datetime import UTC, time
from pathlib import Path
from typing import Any

import pytest
import shapely

import planner
from fields import Field
from planner import PlanningResult, PlanRequest, SerialExecutor, diagnose, plan, plan_day, replay
from planner.day.input_file import parse_day
from planner.errors import RequestError
from planner.farm.settings import FarmTimes
from planner.pipeline.outputs.saved_plans import write_saved_plan
from planner.service.sandbox.readings import read_day_form
from reports.plan.figures import format_ranking_csv
from strategies.lines.line_wishes import name_line
from tests.reports.test_notebook import EVIL, check_shown
from tests.service.conftest import SMALL
from tests.truth.drives import default_programme
from tests.truth.model import make_logs
from vehicle.identification.diagnosis.results import Diagnosis
from vehicle.missions.plan_file import parse_saved_plan

pytestmark = pytest.mark.usefixtures("first_layout")

UTM = "EPSG:32654"
GROUND = shapely.box(0, 0, 40, 70).difference(shapely.box(15, 30, 20, 34))


def answer_on(field: Field, **options: Any) -> PlanningResult:
    request = PlanRequest(field="drawn", **{"tractors": (1, 2), "strategies": ("split-field",), **options})
    return plan(request, field=field, executor=SerialExecutor())


@pytest.fixture(scope="module")
def answer() -> PlanningResult:
    """A field with a hole and a nasty name, on the earth."""
    return answer_on(Field(EVIL, GROUND, crs=UTM, origin_m=(540_000.0, 4_780_000.0), entrance=(0.0, 0.0)), width_m=4.0)


@pytest.fixture(scope="module")
def refused() -> PlanningResult:
    """A field with too few tracks for the tractors, in local metres."""
    return answer_on(Field("narrow", shapely.box(0, 0, 30, 70)), tractors=(40,))


@pytest.mark.slow
def test_answers_are_short_and_their_html_is_small_and_escaped(answer: PlanningResult, refused: PlanningResult) -> None:
    risky = replace(answer, ranking=replace(answer.ranking, field_name="x" * 9000))
    for one in (answer, refused, risky):
        html = check_shown(one)
        assert EVIL not in html and html.count("<img") == 1
        check_shown(one.ranking)
    assert "&lt;script&gt;" in answer._repr_html_() and ". 1 tractor: done in" in repr(answer)
    assert refused.ranking.best is None and "No plan works" in repr(refused)
    assert all(len(repr(one)) < 300 for one in (*answer.pictures.values(), answer.context))


@pytest.mark.slow
def test_lines_are_as_long_as_the_legs_of_the_plan(answer: PlanningResult) -> None:
    frame, missions = answer.to_geodataframe(), answer.run.plan.missions
    work = frame[frame["kind"].isin(["swath", "headland pass"])]
    legs = [leg for mission in missions for leg in mission.legs]
    assert work["length_m"].sum() == pytest.approx(math.fsum(leg.length_m for leg in legs if leg.task.is_work))
    assert set(work["name"]) == {name_line(leg.task) for leg in legs if leg.task.is_work} >= {"1a", "R1.1", "R1.2"}
    for number, mission in enumerate(missions, start=1):
        driven = frame[frame["tractor"] == number]
        assert driven["length_m"].sum() == pytest.approx(math.fsum(leg.length_m for leg in mission.legs))
        assert driven["order"].tolist() == list(range(1, len(driven) + 1))
    assert set(frame["kind"]) >= {"swath", "headland pass", "turn", "boundary", "obstacle", "entrance"}


def test_geometries_are_on_the_earth_and_measured_in_metres(answer: PlanningResult) -> None:
    frame = answer.to_geodataframe()
    assert frame.crs == "EPSG:4326" and frame.total_bounds[:2] == pytest.approx((141.49, 43.17), abs=0.01)
    metres = frame.to_crs(UTM)
    lines = frame["tractor"].notna()
    assert metres.length[lines].tolist() == pytest.approx(frame["length_m"][lines].tolist(), abs=1e-3)
    assert metres.area[frame["kind"] == "boundary"].tolist() == pytest.approx([GROUND.area], rel=1e-6)
    assert frame["area_m2"][frame["kind"] == "obstacle"].tolist() == pytest.approx([20.0])
    best = answer.ranking.best
    assert frame["area_m2"][frame["kind"] == "missed ground"].sum() <= (best.missed_m2 or 0) + 0.1


@pytest.mark.slow
def test_without_a_plan_or_a_place_there_is_the_field_in_metres(refused: PlanningResult) -> None:
    frame = refused.to_geodataframe()
    assert frame.crs is None and frame["kind"].tolist() == ["boundary"] and frame["tractor"].isna().all()
    assert frame["area_m2"].tolist() == [2100.0]


def test_what_is_missing_for_geometries_is_said(answer: PlanningResult, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "geopandas", None)
    with pytest.raises(RequestError, match=r"pip install 'headland\[geo\]'"):
        answer.to_geodataframe()


@pytest.mark.slow
def test_files_are_those_of_the_command(answer: PlanningResult, refused: PlanningResult, tmp_path: Path) -> None:
    text = answer.save(tmp_path / "best.json").read_text(encoding="utf-8")
    assert text == write_saved_plan(answer.context, answer.run.plan, answer.ranking)
    assert parse_saved_plan(text).plan.tractors == answer.run.plan.tractors
    assert answer.save(tmp_path / "a.csv").read_text(encoding="utf-8") == format_ranking_csv(answer.ranking)
    for one in (answer, refused):
        assert one.save(tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
        page = one.save(tmp_path / "a.html").read_text(encoding="utf-8")
        assert "<title" in page and EVIL not in page
        assert one.plot().get_title("left")
    with pytest.raises(RequestError, match="No plan is feasible"):
        refused.save(tmp_path / "none.json")
    assert not (tmp_path / "none.json").exists()


@pytest.mark.parametrize("name", ["plan", "plan_day", "study", "diagnose", "replay"])
def test_help_shows_an_example_and_what_comes_back(name: str) -> None:
    text = pydoc.getdoc(getattr(planner, name))
    assert "Example:" in text and f"headland.{name}(" in text and "Returns a" in text and "to_pandas()" in text


@pytest.mark.parametrize(("given", "seconds"), [(time(13), 46_800), ("13:00", 46_800), (time(7, 5, 30), 25_530)])
def test_times_of_day_are_times_or_their_text(given: Any, seconds: int) -> None:
    more: dict[str, Any] = {"deadline_s": "23:59", "rain": time(18)}
    request = PlanRequest(start_s=given, **more)
    assert request.start_s == seconds and request.rain == "18:00"
    assert request == PlanRequest(start_s=seconds, deadline_s=86_340, rain="18:00")


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ("25:00", "start_s '25:00' is not a time of day; write hh:mm, for instance 13:00."),
        ("8", "start_s '8' is not a time of day; write hh:mm, for instance 08:00."),
        ("8.30", "start_s '8.30' is not a time of day; write hh:mm, for instance 08:30."),
        (time(13, tzinfo=UTC), "start_s 13:00:00+00:00 has a time zone; give the local time of the field, such as"),
        (1.5, "start_s is 1.5; give a whole number."),
    ],
)
def test_times_that_are_none_are_refused(given: Any, sentence: str) -> None:
    with pytest.raises(RequestError) as refusal:
        PlanRequest(start_s=given)
    assert str(refusal.value).startswith(sentence) and refusal.value.parameter == "start_s"


def test_a_request_prints_what_it_asks_for() -> None:
    request = PlanRequest("denmark", start_s=46_800, tractors=(1, 2))
    assert repr(request) == "PlanRequest(field='denmark', tractors=(1, 2), start_s=46800)"
    assert eval(repr(request)) == request and eval(repr(PlanRequest())) == PlanRequest()


def test_days_and_farms_take_times_without_quotes() -> None:
    machines = '[[fields]]\nfile = "denmark"\nwindows = {}\n[[fleets]]\nname = "a"\n'
    head = 'farm = "example"\nstart = {}\nlight = {}\nrain = {}\ndate = {}\n'
    quoted, _ = parse_day(
        head.format('"07:00"', '"06:10-20:40"', '"15:00"', '"2026-05-01"') + machines.format('["08:00-12:00"]'), "day"
    )
    text = head.format("07:00:00", "[06:10:00, 20:40:00]", "15:00:00", "2026-05-01")
    text += machines.format("[[08:00:00, 12:00:00]]")
    bare, _ = parse_day(text, "day")
    assert bare == quoted
    values = read_day_form(text, [])["values"]
    assert (values["start"], values["light"], values["date"]) == ("07:00", "06:10-20:40", "2026-05-01")
    assert values["fields"][0]["windows"] == ["08:00-12:00"]
    times: dict[str, Any] = {"shift_start": time(7), "breaks": ((time(12), time(12, 30)),)}
    assert FarmTimes(**times) == FarmTimes(shift_start="07:00", breaks=("12:00-12:30",))


def test_a_saved_plan_remembers_the_time_that_was_given(answer: PlanningResult) -> None:
    given: dict[str, Any] = {"start_s": time(8, 30)}
    context = replace(answer.context, request=replace(answer.context.request, **given))
    assert json.loads(write_saved_plan(context, answer.run.plan))["scenario"]["start_s"] == 30_600


@pytest.mark.slow
def test_a_replay_and_a_diagnosis_go_to_pandas_as_their_json(tmp_path: Path) -> None:
    logs = []
    for number, table in enumerate(make_logs({"steering_offset": {"angle_deg": 1.0}}, 3, default_programme()[:2])):
        logs.append(tmp_path / f"{number}.csv")
        table.to_csv(logs[-1], index=False)
    replayed, found = replay(logs[0]), diagnose(logs)
    for result in (replayed, found):
        check_shown(result)
        result.plot()
    errors = json.loads(replayed.save(tmp_path / "replay.json").read_text(encoding="utf-8"))["error"]
    frame = replayed.to_pandas().set_index("horizon_s")
    assert {f"{horizon:g}": row.to_dict() for horizon, row in frame.iterrows()} == errors
    effects = json.loads(found.save(tmp_path / "diagnosis.json").read_text(encoding="utf-8"))["effects"]
    assert found.to_pandas()["id"].tolist() == [one["id"] for one in effects]
    assert isinstance(found, Diagnosis) and replayed.save(tmp_path / "a.png").stat().st_size > 1000
    assert len(repr(replayed.replayed)) < 1000


@pytest.mark.slow
def test_a_day_is_planned_from_its_file(tmp_path: Path) -> None:
    (tmp_path / "north.geojson").write_bytes(SMALL)
    (tmp_path / "day.toml").write_text(
        'farm = "example"\nstart = 07:00:00\nstrategies = ["split-field"]\n[yard]\nlon = 4.6\nlat = 52.1\n'
        '[[fields]]\nfile = "north.geojson"\nlocal = true\nname = "north"\nlon = 4.6\nlat = 52.1\n'
        'loss_per_ha = 300.0\n[[fleets]]\nname = "robots"\n'
    )
    day = plan_day(tmp_path / "day.toml", samples=200)
    jobs = json.loads(day.save(tmp_path / "day.json").read_text(encoding="utf-8"))["jobs"]
    assert day.to_pandas()["end_s"].tolist() == [job["end_s"] for job in jobs] and len(jobs) == 1
    assert "north" in check_shown(day)
