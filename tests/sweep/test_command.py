"""`headland sweep` as a user runs it: what it prints and writes, bad input, Ctrl-C and going on."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from planner.evaluation.work_order import WorkOrder
from planner.pipeline.executors import SerialExecutor
from planner.request.plan_request import PlanRequest
from planner.sweeps import sweep as sweeps
from planner.sweeps.axes import read_axes
from planner.sweeps.sweep import sweep
from tests.cli.conftest import built, headland

__all__ = ["built", "headland"]
Run = Callable[..., Any]
FEW = ("--local", "--width", "3,6", "--speed-kmh", "6,9", "--tractors", "1-2", "--processes", "1")
LEAST = ("--local", "--width", "6", "--tractors", "1", "--processes", "1")

pytestmark = pytest.mark.usefixtures("first_layout")


@pytest.fixture
def field(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A field file in a folder of its own, which keeps what is estimated too."""
    from tests.drawn_fields import rectangle

    monkeypatch.setenv("HEADLAND_CACHE", str(tmp_path / "kept"))
    place = tmp_path / "small.geojson"
    place.write_text(json.dumps(rectangle(0, 0, 60, 70)))
    return place


@pytest.mark.slow
def test_table_json_csv_files_and_a_drive(headland: Run, field: Path, tmp_path: Path) -> None:
    page, saved = tmp_path / "page.html", tmp_path / "plan.json"
    service = ("--service", "http://127.0.0.1:8765/")
    files = ("--html", page, "--png", tmp_path / "p.png", "--save", saved)
    few = (*FEW, "--soil", "loam")
    done = headland("sweep", field, *few, *service, *files, "--pick", "1")
    assert done.status == 0, done.err
    assert "8 combinations" in done.out and "driven in full" in done.out
    assert "--width" in page.read_text() and json.loads(saved.read_text())
    assert r"http://127.0.0.1:8765/#/plan?field=small\u0026local=true\u0026soil=loam" in page.read_text()
    data = json.loads(headland("sweep", field, *few, "--json").out)
    assert data["currency"] == "EUR" and data["prices_assumed"], "as headland plan has it"
    assert data["done"] == 8 and set(data["options"]) == {"width_m", "speed_kmh", "tractors"}
    assert data["best"]["command"].startswith(f"headland plan --local --soil loam {field} ")
    assert len(headland("sweep", field, *few, "--csv").out.splitlines()) == 9
    other = ("--tractors", "1-2", "--soil", "loam", "--speed-kmh", "6,9", "--width", "3,6")
    again = json.loads(headland("sweep", field, "--local", *other, "--processes", "1", "--json").out)
    assert again["front"] == data["front"], "in whatever order the options are"


@pytest.mark.parametrize(("words", "sentence"), [
    ("--width 0", "--width"),
    ("--width 3,0", "--width"),
    ("--width 3,x", "holds 'x', which is no number"),
    ("--width 6:3", "give from, to and step"),
    ("--headland-order middle", "'middle' is no headland order; use first, last"),
    ("--width 1:50:0.1 --speed-kmh 1:30:0.1", "more than a sweep takes"),
    ("--tractors 1-99", "use 1 to 50"),
    ("--turn-speed-kmh 5,99", "--turn-speed-kmh"),
    ("--width 3,6 --leave-out 2", "Every width of a sweep numbers its tracks anew"),
    ("--json --csv", "choose one"),
    ("--service farm", "give an address such as https://farm.example"),
    ("--service https://farm.example:99999", "give an address such as https://farm.example"),
    ("--tractor eg105,nosuch", "The tractor 'nosuch' is neither a file nor one of"),
    ("--soil loam,mudd", "The soil 'mudd' is unknown"),
    ("--width 3,6 --rain noon", "--rain 'noon' is none of"),
    ("--width 3,6 --swaths contour", "--swaths contour follows contours, and no heights are known"),
    ("--html page.txt", "does not end in .html"),
])  # fmt: skip
def test_bad_input(headland: Run, field: Path, words: str, sentence: str) -> None:
    done = headland("sweep", field, "--local", *words.split())
    assert done.status == 2 and done.out == ""
    assert sentence in done.err and len(done.err.strip().splitlines()) == 1


@pytest.mark.slow
def test_a_value_that_cannot_be_laid_out_leaves_the_others(headland: Run, field: Path) -> None:
    done = headland("sweep", field, *LEAST, "--swaths", "contour,straight", "--json")
    assert done.status == 0, done.err
    plans = json.loads(done.out)["plans"]
    assert {one["swaths"]: one["feasible"] for one in plans} == {"contour": False, "straight": True}


@pytest.mark.slow
def test_what_the_tractor_cannot_pull_is_not_taken(headland: Run, field: Path, tmp_path: Path) -> None:
    """As `headland plan` says it, whose check is that of the standard; 6 m at 8 km/h can be pulled, at 12 not."""
    few = ("--local", "--tractors", "1", "--width", "6")
    plan = headland("plan", field, *few, "--speed-kmh", "12", "--json")
    assert plan.status == 3
    unmet = json.loads(plan.out)["unmet"]
    assert "needs about 90 kW" in unmet
    swept = ("sweep", field, *few, "--processes", "1")
    data = json.loads(headland(*swept, "--speed-kmh", "8,12", "--json").out)
    assert [one["lacks"] for one in data["plans"]] == [[], ["pull"]] and data["best"]["speed_kmh"] == 8.0
    assert [one["speed_kmh"] for one in data["front"]] == [8.0]
    assert "1 combination cannot be taken: Not feasible" in headland(*swept, "--speed-kmh", "8,12").out.replace(
        "\n", " "
    )
    alone = headland(*swept, "--speed-kmh", "12")
    assert alone.status == 3
    shown = " ".join(alone.out.split())
    assert "No combination does all that was asked for; the nearest is" in shown and unmet in shown
    assert "comes nearest to what was asked for" in shown and "is the one to take" not in shown
    row = headland(*swept, "--speed-kmh", "12", "--csv").out.splitlines()[1]
    assert ",pull,false,true" in row


@pytest.mark.slow
def test_what_a_tractor_cannot_pull_at_all_is_refused_without_driving_the_field(headland: Run, field: Path) -> None:
    weak = ("--draft", "plough", "--soil", "soft")
    done = headland("plan", field, "--local", "--width", "3", *weak, "--speed-kmh", "8", "--tractors", "1")
    assert done.status == 3
    assert "on level ground the tractor works at 2 % of the speed asked for" in " ".join(done.out.split())


@pytest.mark.slow
def test_an_explained_plan_tells_every_remark_and_asks_what_to_check(headland: Run, field: Path) -> None:
    words = ("plan", field, "--local", "--width", "6", "--speed-kmh", "10", "--tractors", "1")
    shown = [" ".join(headland(*words, *more).out.split()) for more in ((), ("--explain",))]
    assert all("needs about 70 kW at the drawbar at 10 km/h" in text for text in shown)
    assert "remarks: --explain" not in shown[1] and "more: --explain" not in shown[1]


def test_python_says_what_a_sweep_takes() -> None:
    with pytest.raises(TypeError, match=r"takes a PlanRequest, such as PlanRequest\(field='denmark'\), not 'denmark'"):
        sweep("denmark", width=[3.0])  # type: ignore[arg-type]


@pytest.mark.slow
def test_a_row_that_is_not_there_and_several_fields_to_save(headland: Run, field: Path, tmp_path: Path) -> None:
    done = headland("sweep", field, *LEAST, "--pick", "99")
    assert done.status == 2 and "--pick is 99; the table has rows 1 to" in done.err
    other = tmp_path / "other.geojson"
    other.write_text(field.read_text())
    done = headland("sweep", field, other, *LEAST, "--save", tmp_path / "plan.json")
    assert done.status == 2 and "are for one field" in done.err


@pytest.mark.slow
def test_all_fields_of_a_file(headland: Run, field: Path, tmp_path: Path) -> None:
    geopandas = pytest.importorskip("geopandas")
    import shapely

    farm, boxes = tmp_path / "farm.gpkg", [shapely.box(x, 56.0, x + 0.0008, 56.0006) for x in (10.0, 10.01)]
    geopandas.GeoDataFrame({"name": ["north", "south"]}, geometry=boxes, crs=4326).to_file(farm)
    few = ("--width", "6", "--tractors", "1", "--processes", "1", "--json")
    data = json.loads(headland("sweep", "--fields", farm, *few).out)
    assert data["field"] == "north + south" and {one["field"] for one in data["plans"]} == {"north", "south"}
    done = headland("sweep", "--fields", tmp_path / "none.gpkg", *few)
    assert done.status == 2 and "There is no field file" in done.err


@pytest.mark.slow
def test_ctrl_c_shows_what_is_done_and_the_same_command_goes_on(
    headland: Run, field: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    estimate, calls = sweeps.estimate_task, list[int]()

    def stop_at_second(*arguments: Any) -> Any:
        calls.append(1)
        if len(calls) == 2:
            raise KeyboardInterrupt
        return estimate(*arguments)

    monkeypatch.setattr(sweeps, "estimate_task", stop_at_second)
    few = ("--local", "--width", "6", "--speed-kmh", "6,9", "--tractors", "1-3", "--processes", "1")
    done = headland("sweep", field, *few)
    assert done.status == 130
    assert "2 of 6 combinations" in done.out
    assert "2 of 6 combinations; the same command goes on with it" in done.err
    done = headland("sweep", field, *few)
    assert done.status == 0 and len(calls) == 4, "what was done is not done again"


@pytest.mark.slow
def test_every_number_of_tractors_is_progress(field: Path) -> None:
    axes, told = read_axes({"width": "6,9", "tractors": "1-2", "price_per_hour": "30,40"}), list[tuple[int, int]]()
    swept = sweeps.Sweep(
        axes, (str(field),), lambda name, each: WorkOrder(replace(PlanRequest(name, local=True), **each))
    )
    swept.run(SerialExecutor(), progress=lambda done, total: told.append((done, total)))
    assert told == [(2, 8), (4, 8), (6, 8), (8, 8)]


def test_a_part_of_a_field_has_its_own_area(field: Path) -> None:
    from tests.drawn_fields import feature, line, rectangle, write_features

    ditch = feature(line((-5, 45), (65, 45)), role="obstacle", width_m=2.0)
    write_features(field, feature(rectangle(0, 0, 60, 70), name="plot"), ditch)
    request = PlanRequest(str(field), local=True, part=2)
    swept = sweeps.Sweep(
        read_axes({"tractors": "1"}), (str(field),), lambda _, each: WorkOrder(replace(request, **each))
    )
    result = swept.build_result()
    assert result.field_name == "plot, part 2"
    assert result.area_ha == pytest.approx(1e-4 * 60 * (25 - 1.0 - request.margin_m), rel=0.01)


def test_files_beyond_the_bound_are_removed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also beside one that another process removes meanwhile, as a link to nowhere is."""
    import os

    from planner.pipeline.result_cache import ResultCache

    cache = ResultCache(tmp_path)
    for number in range(4):
        cache.write(f"n{number}", {"text": "x" * 1000})
        os.utime(tmp_path / f"n{number}.json", (number, number))
    (tmp_path / "a-gone.json").symlink_to(tmp_path / "gone")
    list_all = Path.glob
    monkeypatch.setattr(Path, "glob", lambda folder, pattern: sorted(list_all(folder, pattern)))
    cache.remove_oldest(2500)
    assert [cache.read(f"n{number}") is not None for number in range(4)] == [False, False, True, True]
