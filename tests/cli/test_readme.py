"""Every command of the README and the guide runs as written; experiments where they are driven anyhow."""

import os
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely

from fields.geometry.field import Field
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

MAX_README_LINES = 150
LEFT_OUT = (*SERVING, EXPERIMENTS, "headland setup")  # compiles everything where it is not yet
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


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the files that the commands name; what a service has is there as well."""
    from fields.documents.reader import read_field
    from fields.documents.writer import write_field
    from tests.truth.model import make_logs
    from vehicle.model.tractor import BatteryParameters, load_tractor
    from vehicle.model.tractor_writer import format_tractor_toml

    place = tmp_path_factory.mktemp("readme")
    os.environ["HEADLAND_DATA"] = str(place / "data")
    parcel = read_field("netherlands")
    part = shapely.box(-30.0, -150.0, 40.0, -80.0)  # chosen: 70 m of 360, as sizes are not tested here
    write_field(replace(parcel, boundary=parcel.boundary & part), place / "myfarm.geojson")
    write_hill(parcel, place / "dtm.tif")
    battery = BatteryParameters(capacity_kwh=30.0)
    electric = load_tractor("eg105").model_copy(update={"drive": "electric", "battery": battery})
    (place / "electric.toml").write_text(format_tractor_toml(electric), encoding="utf-8")
    (place / "runs").mkdir()
    hidden = {"steering_offset": {"angle_deg": 1.0}, "wheel_slip": {"ratio": 0.15}}
    for number, log in enumerate(make_logs(hidden, seed=3, origin=parcel.origin_m, rate_hz=10.0)):
        log.to_csv(place / "runs" / f"{number}.csv", index=False)
        log.to_csv(place / "run.csv", index=False)
    return place


@pytest.fixture(scope="module")
def printed() -> dict[str, str]:
    """What lines of the README printed that have run."""
    return {}


@pytest.mark.slow
@pytest.mark.parametrize("line", [line for line in list_readme_commands() if not line.startswith(LEFT_OUT)])
def test_command(
    line: str, folder: Path, headland: Run, monkeypatch: pytest.MonkeyPatch, printed: dict[str, str]
) -> None:
    monkeypatch.chdir(folder)
    printed[line] = run_as_written(line, folder, headland)


@pytest.mark.slow
def test_examples_in_python(folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """All blocks as one script, as a reader would go through them."""
    monkeypatch.chdir(folder)
    blocks = re.findall(r"```python\n(.*?)```", read_page("python").text, flags=re.DOTALL)
    assert len(blocks) >= 5
    names: dict[str, object] = {"__name__": "__main__"}
    for block in blocks:
        exec(compile(block, "python.md", "exec"), names)
    assert "width_m | " in capsys.readouterr().out


@pytest.mark.slow
def test_the_first_answer_is_what_the_command_prints(headland: Run, printed: dict[str, str]) -> None:
    text = README.read_text(encoding="utf-8")
    shown = re.findall(r"```text\n(.*?)```", text, flags=re.DOTALL)[0]
    command = next(line for line in list_readme_commands() if "--deadline" in line)
    if command not in printed:
        printed[command] = headland(*command.split()[1:]).out
    lines, printed_lines = (_drop_not_shown(text) for text in (shown, printed[command]))
    assert len(lines) > 8 and printed_lines[: len(lines)] == lines


def _drop_not_shown(text: str) -> list[str]:
    """The lines without that on plans that are not shown: it counts all strategies that there are."""
    return [line for line in text.splitlines() if not line.startswith("Not shown: ")]


def test_every_beginning_is_one_of_the_guide() -> None:
    assert all(any(line.startswith(words) for line in list_guide_commands()) for words in SELDOM)


@pytest.mark.slow
@pytest.mark.parametrize("line", [
    pytest.param(line, marks=pytest.mark.matrix if line.startswith(SELDOM) else ())
    for line in list_guide_commands() if not line.startswith(LEFT_OUT)
])  # fmt: skip
def test_guide_command(line: str, folder: Path, headland: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    writing = [line for line in list_readme_commands() if " new " in line or " --save " in line]
    if not all((folder / line.split(" --save ")[-1].split()[0]).exists() for line in writing if " --save " in line):
        for line in writing:
            run_as_written(line, folder, headland)
    run_as_written(line, folder, headland)
