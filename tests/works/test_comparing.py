"""Plans against runs: ground by hand, and a plan driven with a known pace and known stops."""

import json
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import shapely

from planner.errors import RequestError
from planner.pipeline.example_logs import EXAMPLE_PACE, ExampleTaskData, simulate_task_data
from planner.pipeline.outputs.saved_plans import read_machines, write_saved_plan
from planner.pipeline.plan_comparison import _find_compared_field, compare_plan_with_runs
from planner.pipeline.planning import plan
from planner.request.plan_request import PlanRequest
from planner.task_logs.log_import import import_runs
from planner.task_logs.runs.run_records import ProjectedRun, compute_course_deg
from planner.task_logs.runs.worked_ground import measure_coverage
from reports.task_logs.report import (
    build_comparison_table,
    format_comparison_json,
    list_comparison_rows,
    render_comparison_page,
)
from reports.task_logs.run_results import STANDING, TURNING, WORKING, PlanComparison
from tests.drawn_fields import feature, line, rectangle, ring, write_features
from tests.fields.farm_files import place
from tests.printing import print_text

WIDTH_M = 6.0


def straight(*xs: float) -> ProjectedRun:
    """Tracks of 100 m to the north at these eastings, off work between them; 1 m a second."""
    xy = np.concatenate([np.column_stack([np.full(101, x), np.arange(101.0)]) for x in xs])
    works = np.tile(np.append(np.ones(100, dtype=bool), False), len(xs))
    time_s = np.arange(float(len(xy)))
    return ProjectedRun(
        name="by hand", log_format="CSV", crs="EPSG:32633", time_s=time_s, xy=xy, heading_deg=np.zeros(len(xy)),
        speed_mps=np.ones(len(xy)), is_working=works,
    )  # fmt: skip


def test_ground_by_hand() -> None:
    field = shapely.box(0.0, 0.0, 30.0, 100.0)
    # 6 m wide at 3, 8 and 17: 0 to 6, 5 to 11 and 14 to 20 m; 1 m twice, 3 and 10 m not at all.
    found = measure_coverage([straight(3.0, 8.0), straight(17.0)], field, WIDTH_M, 0.0)
    assert found.worked_m2 == pytest.approx(1700.0, abs=1.0)
    assert found.overlap_m2 == pytest.approx(100.0, abs=1.0)
    assert found.missed_m2 == pytest.approx(1300.0, abs=1.0)
    assert [round(shapely.Polygon(ring).area) for ring in found.unworked] == [1000, 300]
    assert shapely.union_all([shapely.Polygon(ring) for ring in found.overlaps]).area == pytest.approx(100.0, abs=1.0)


def test_a_run_that_never_works_leaves_all_ground() -> None:
    run = straight(3.0)
    idle = replace(run, is_working=np.zeros(len(run.xy), dtype=bool))
    found = measure_coverage([idle], shapely.box(0.0, 0.0, 30.0, 100.0), WIDTH_M, 0.0)
    assert (found.worked_m2, found.overlap_m2, found.missed_m2, found.overlaps) == (0.0, 0.0, 3000.0, ())


def test_the_tool_is_behind_the_antenna() -> None:
    field = shapely.box(0.0, -50.0, 6.0, 150.0)
    found = measure_coverage([straight(3.0)], field, WIDTH_M, 2.0)
    assert found.worked_m2 == pytest.approx(600.0, abs=1.0)
    missed = sorted((shapely.Polygon(ring).bounds for ring in found.unworked), key=lambda bounds: bounds[1])
    assert missed[0][3] == pytest.approx(-2.0, abs=0.01) and missed[1][1] == pytest.approx(98.0, abs=0.01)


def test_standing_adds_no_ground() -> None:
    run = straight(3.0)
    stands = np.random.default_rng(1).normal(0.0, 0.4, (60, 2)) + np.array([3.0, 50.0])
    xy = np.concatenate([run.xy[:50], stands, run.xy[50:]])
    speed = np.concatenate([np.ones(50), np.zeros(60), np.ones(51)])
    works = np.concatenate([run.is_working[:50], np.ones(60, dtype=bool), run.is_working[50:]])
    jittered = replace(
        run,
        xy=xy,
        speed_mps=speed,
        is_working=works,
        heading_deg=compute_course_deg(xy),
        time_s=np.arange(float(len(xy))),
    )
    assert measure_coverage([jittered], shapely.box(0, 0, 6, 100), WIDTH_M, 0.0).overlap_m2 < 8.0


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, ExampleTaskData]:
    """A plan for two tractors, runs that were imported of its example, and the truth of that."""
    folder = tmp_path_factory.mktemp("plan")
    corners = [place(x, y)[::-1] for x, y in ((0, 0), (60, 0), (60, 120), (0, 120))]
    (folder / "field.geojson").write_text(json.dumps(ring(*corners)))
    scenario = PlanRequest(
        field=str(folder / "field.geojson"), width_m=WIDTH_M, tractors=(2,), strategies=("split-field",), samples=0
    )
    found = plan(scenario)
    assert found.run is not None
    (folder / "plan.json").write_text(write_saved_plan(found.context, found.run.plan))
    made = simulate_task_data(folder / "plan.json", seed=4)
    (folder / "TASKDATA").mkdir()
    for name, content in made.files.items():
        (folder / "TASKDATA" / name).write_bytes(content)
    (folder / "runs").mkdir()
    for name, text in import_runs([str(folder / "TASKDATA")]).files.items():
        (folder / "runs" / name).write_text(text)
    return folder / "plan.json", folder / "runs", made


@pytest.fixture(scope="module")
def found(driven: tuple[Path, Path, ExampleTaskData]) -> PlanComparison:
    return compare_plan_with_runs(driven[0], [driven[1]])


def test_the_truth_of_the_example_comes_back(driven: tuple[Path, Path, ExampleTaskData], found: PlanComparison) -> None:
    stops = [seconds for truth in driven[2].truths for seconds in truth.stops_s]
    assert len(stops) >= 2 and found.as_driven.machines == 2
    a, b = found.planned.figures, found.as_driven.figures
    assert b.stops == len(stops)
    assert b.by_kind_s[STANDING] == pytest.approx(sum(stops), abs=1.0 * len(stops))
    assert b.working_mps == pytest.approx(EXAMPLE_PACE * (a.working_mps or 0.0), rel=0.01)
    assert b.by_kind_s[WORKING] == pytest.approx(a.by_kind_s[WORKING] / EXAMPLE_PACE, rel=0.02)
    assert b.by_kind_s[TURNING] == pytest.approx(a.by_kind_s[TURNING] / EXAMPLE_PACE, rel=0.05)
    assert (a.turns, a.lifts) == (b.turns, b.lifts)
    # Once a second each end of a track is half a second late in the mean; what begins there may be slower than work.
    assert b.working_mps is not None and b.lifts is not None
    assert b.active_m == pytest.approx(a.active_m, abs=0.5 * b.working_mps * b.lifts)


def test_ground_is_the_same_where_the_same_lines_were_driven(found: PlanComparison) -> None:
    a, b = found.planned.ground, found.as_driven.ground
    assert a is not None and b is not None and found.field_m2 == pytest.approx(7200.0, rel=2e-3)
    assert a.worked_m2 + a.missed_m2 == pytest.approx(found.field_m2)
    # Once a second a track begins and ends up to 1.25 m late or early: 0.5 m in the mean, 6 m wide, 40 times.
    assert b.worked_m2 == pytest.approx(a.worked_m2, abs=0.5 * WIDTH_M * 2 * (found.as_driven.figures.lifts or 0))


def test_differences_add_up(found: PlanComparison) -> None:
    whole = found.as_driven.figures.seconds - found.planned.figures.seconds
    assert sum(one.seconds for one in found.differences) == pytest.approx(whole, abs=5.0)
    sizes = [abs(one.seconds) for one in found.differences]
    assert sizes == sorted(sizes, reverse=True)
    (slower,) = (one for one in found.differences if one.words.startswith("at work "))
    kmh = [float(word) for word in re.findall(r"[\d.]+(?= km/h)", slower.words)]
    assert kmh[0] == pytest.approx(EXAMPLE_PACE * kmh[1], abs=0.1)
    # As much longer as the pace says, of all that was planned at work.
    planned_s = found.planned.figures.by_kind_s[WORKING]
    assert slower.seconds == pytest.approx(planned_s * (1.0 / EXAMPLE_PACE - 1.0), rel=0.1)


def test_table_page_and_json_tell_the_same(found: PlanComparison) -> None:
    text, page = print_text(build_comparison_table(found)), render_comparison_page(found)
    told = json.loads(format_comparison_json(found))
    for what, planned, driven, _ in list_comparison_rows(found):
        assert what in text and planned in text and driven in text
        assert f"<td>{planned}</td><td>{driven}</td>" in page
    assert told["driven"]["stops"] == found.as_driven.figures.stops
    assert told["planned"]["ground"]["worked_m2"] == pytest.approx(found.planned.ground.worked_m2)  # type: ignore[union-attr]


def test_a_plan_of_a_part_is_compared_on_that_part(tmp_path: Path) -> None:
    ditch = feature(line((-5, 45), (65, 45)), role="obstacle", width_m=2.0)
    place = write_features(tmp_path / "divided.geojson", feature(rectangle(0, 0, 60, 70)), ditch)
    saved: Any = SimpleNamespace(scenario={}, crs=None)
    for part, area_m2 in ((None, 60 * 70), (2, 60 * (25 - 1.0 - 0.3))):
        request = PlanRequest(str(place), local=True, part=part)
        tractor, implement = read_machines(saved, request)
        run: Any = SimpleNamespace(saved=saved, request=request, tractor=tractor, implement=implement)
        field, is_known = _find_compared_field(run, [], [])
        assert is_known and field.area == pytest.approx(area_m2, rel=0.01)


def test_runs_of_other_fields_are_left_out(driven: tuple[Path, Path, ExampleTaskData], tmp_path: Path) -> None:
    plan_file, runs, _ = driven
    for path in runs.iterdir():
        text = path.read_text()
        if path.suffix == ".json":
            told = json.loads(text)
            text = json.dumps(told | {"crs": "EPSG:32634"})
        (tmp_path / path.name).write_text(text)
    with pytest.raises(RequestError, match="None of 2 runs is in the field"):
        compare_plan_with_runs(plan_file, [tmp_path])
    both = compare_plan_with_runs(plan_file, [runs, tmp_path])
    assert both.as_driven.machines == 2 and both.notes[0] == "2 runs in other places skipped."


def test_runs_without_a_work_state_compare_what_they_know(
    driven: tuple[Path, Path, ExampleTaskData], tmp_path: Path
) -> None:
    plan_file, runs, made = driven
    for path in runs.iterdir():
        text = path.read_text()
        if path.suffix == ".csv":
            text = "\n".join(line.rpartition(",")[0] for line in text.splitlines())
        (tmp_path / path.name).write_text(text)
    found = compare_plan_with_runs(plan_file, [tmp_path])
    assert found.as_driven.ground is None and found.as_driven.work_lines == ()
    assert {one.what for one in found.differences} == {"moving", STANDING}
    told = {row[0] for row in list_comparison_rows(found)}
    assert "moving" in told and not told & {WORKING, TURNING, "worked, ha"}
    assert "Some runs have no work state, so ground and work are not compared." in found.notes
    stops = sum(seconds for truth in made.truths for seconds in truth.stops_s)
    assert found.as_driven.figures.stops_s == pytest.approx(stops, rel=0.1)
