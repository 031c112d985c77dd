"""Every command of the README and the guide runs as written; experiments where they are driven anyhow."""

import os
import re
import shutil
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import shapely

from fields.documents.reader import read_field
from fields.documents.writer import write_field
from fields.geometry.field import Field
from fields.sample_fields import read_sample_text
from planner.guide.guide_pages import list_pages, read_page
from tests.cli.conftest import Run
from tests.cli.examples import (
    EXPERIMENTS,
    README,
    SERVING,
    list_commands,
    list_guide_commands,
    list_readme_commands,
    run_as_written,
)
from tests.truth.drives import Drive, circles, default_programme, straight

MAX_README_LINES = 150
LEFT_OUT = (*SERVING, EXPERIMENTS, "headland setup")  # compiles everything where it is not yet
FIRST_ANSWER = "headland plan denmark --tractors 1-3"
PARTS = {
    "netherlands": shapely.box(-30.0, -150.0, 40.0, -80.0), "denmark": shapely.box(-50.0, -40.0, 50.0, 40.0),
    "iwamizawa": shapely.box(0.0, 0.0, 90.0, 70.0),
}  # fmt: skip
SELDOM = (
    "headland plan denmark", "headland plan iwamizawa --tractors", "headland plan iwamizawa netherlands",
    "headland plan myfarm.geojson --soil", "headland diagnose runs", "headland diagnose --demo",
    "headland diagnose sample", "headland day day.toml", "headland compare-headlands", "headland study",
    "headland plan myfarm.geojson --width 3 --tractors 1-3", "headland plan myfarm.geojson --margin",
    "headland plan myfarm.geojson --tractor my-eg105.toml",
)  # fmt: skip
"""Beginnings of the guide's commands that take long: in the matrix alone, as their kind runs in the README or in files
of its own, and so do their options."""


def test_the_readme_is_short() -> None:
    assert len(README.read_text(encoding="utf-8").splitlines()) <= MAX_README_LINES


def test_readme_and_guide_show_every_command() -> None:
    from planner.cli.main import app

    pages = [line for page in list_pages() for line in list_commands(page.text)]
    shown = {line.split()[1] for line in (*list_readme_commands(), *pages)}
    assert {info.name or info.callback.__name__ for info in app.registered_commands if info.callback} <= shown


def write_hill(field: Field, path: Path) -> None:
    """A raster of a field that rises by 3 % to the east, with a hill of 2 m in the middle."""
    from fields.terrain.elevation_grid import ElevationGrid, lay_nodes
    from fields.terrain.rasters import render_raster

    frame = lay_nodes(field.boundary, 5.0, 400.0)
    x, y = frame.list_places().T
    heights = (20.0 + 0.03 * x + 2.0 * np.exp(-(x**2 + y**2) / 5e3)).reshape(frame.rows, frame.columns)
    east, north = field.origin_m
    grid = ElevationGrid(frame.west_m + east, frame.south_m + north, frame.spacing_m, heights)
    (content,) = render_raster(grid, str(field.crs), path)
    path.write_bytes(content)


@cache
def find_origin_m() -> tuple[float, float]:
    """Where the parcel is whose part is the field; asked for before the sample gives way to its part."""
    return read_field("netherlands").origin_m


def write_runs(place: Path, drives: list[Drive], rate_hz: float) -> None:
    """Logs of a tractor whose steering is off and whose wheels slip."""
    from tests.truth.model import make_logs

    hidden = {"steering_offset": {"angle_deg": 1.0}, "wheel_slip": {"ratio": 0.15}}
    for number, log in enumerate(make_logs(hidden, 3, drives, origin=find_origin_m(), rate_hz=rate_hz)):
        log.to_csv(place / "runs" / f"{number}.csv", index=False)
        log.to_csv(place / "run.csv", index=False)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the files that the commands name, and parts of samples; what a service has is there as well."""
    from vehicle.model.tractor import BatteryParameters, load_tractor
    from vehicle.model.tractor_writer import format_tractor_toml

    place = tmp_path_factory.mktemp("readme")
    os.environ["HEADLAND_DATA"] = str(place / "data")
    (place / "parts").mkdir()
    for name, part in PARTS.items():
        field = read_field(name)
        write_field(replace(field, boundary=field.boundary & part), place / "parts" / name)
    shutil.copy(place / "parts" / "netherlands", place / "myfarm.geojson")
    parcel = read_field("netherlands")
    write_hill(parcel, place / "dtm.tif")
    battery = BatteryParameters(capacity_kwh=30.0)
    electric = load_tractor("eg105").model_copy(update={"drive": "electric", "battery": battery})
    (place / "electric.toml").write_text(format_tractor_toml(electric), encoding="utf-8")
    (place / "runs").mkdir()
    write_runs(place, [straight(90.0, seconds=40.0), circles(1), circles(-1)], rate_hz=5.0)
    return place


@pytest.fixture
def in_short(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Commands run in the folder, on parts of samples and their first layouts: neither is tested here."""
    monkeypatch.chdir(folder)
    monkeypatch.setattr(
        "fields.documents.sources.read_sample_text",
        lambda name: (folder / "parts" / name).read_text("utf-8") if name in PARTS else read_sample_text(name),
    )
    monkeypatch.setattr("planner.evaluation.preparation.choose_quickest_index", lambda *_: 0)


@pytest.mark.slow
@pytest.mark.usefixtures("in_short")
@pytest.mark.parametrize(
    "line", [line for line in list_readme_commands() if not line.startswith((*LEFT_OUT, FIRST_ANSWER))]
)
def test_command(line: str, folder: Path, headland: Run) -> None:
    run_as_written(line, folder, headland)


@pytest.mark.slow
@pytest.mark.usefixtures("in_short")
def test_examples_in_python(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """All blocks as one script, as a reader would go through them on a machine with one core."""
    monkeypatch.setattr(os, "cpu_count", lambda: 1)
    blocks = re.findall(r"```python\n(.*?)```", read_page("python").text, flags=re.DOTALL)
    assert len(blocks) >= 5
    names: dict[str, object] = {"__name__": "__main__"}
    for block in blocks:
        exec(compile(block, "python.md", "exec"), names)
    assert "width_m | " in capsys.readouterr().out


@pytest.mark.slow
def test_the_first_answer_is_what_the_command_prints(headland: Run, folder: Path) -> None:
    """But for the line on plans that are not shown, which counts all strategies that there are."""
    shown = re.findall(r"```text\n(.*?)```", README.read_text(encoding="utf-8"), flags=re.DOTALL)[0]
    (command,) = [line for line in list_readme_commands() if line.startswith(FIRST_ANSWER)]
    texts = shown, run_as_written(command, folder, headland)
    lines, found = ([line for line in text.splitlines() if not line.startswith("Not shown: ")] for text in texts)
    assert len(lines) > 8 and found[: len(lines)] == lines


def test_every_beginning_is_one_of_the_guide() -> None:
    assert all(any(line.startswith(words) for line in list_guide_commands()) for words in SELDOM)


@pytest.mark.slow
@pytest.mark.usefixtures("in_short")
@pytest.mark.parametrize("line", [
    pytest.param(line, marks=pytest.mark.matrix if line.startswith(SELDOM) else ())
    for line in list_guide_commands() if not line.startswith(LEFT_OUT)
])  # fmt: skip
def test_guide_command(line: str, folder: Path, headland: Run) -> None:
    writing = [line for line in list_readme_commands() if " new " in line or " --save " in line]
    if not all((folder / line.split(" --save ")[-1].split()[0]).exists() for line in writing if " --save " in line):
        for line in writing:
            run_as_written(line, folder, headland)
    if line.startswith("headland diagnose runs"):
        write_runs(folder, default_programme(), rate_hz=10.0)  # a soil is saved where the slip is certain
    run_as_written(line, folder, headland)
