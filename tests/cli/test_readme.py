"""Every command and every example of the README runs as written; experiments where they are driven anyhow."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.cli.examples import EXPERIMENTS, README, commands, run_as_written

SERVING = ("headland serve", "headland demo", "headland robot")  # go on until ended; tests of the service start them


def test_the_readme_shows_every_command() -> None:
    from planner.main import app

    shown = {line.split()[1] for line in commands()}
    assert {info.name or info.callback.__name__ for info in app.registered_commands if info.callback} <= shown


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the files the README's commands name; what a service has is there as well."""
    from fields.read import read_field
    from fields.write import write_field
    from tests.truth.model import make_logs

    place = tmp_path_factory.mktemp("readme")
    os.environ["HEADLAND_DATA"] = str(place / "data")
    write_field(read_field("netherlands"), place / "myfarm.geojson")
    (place / "runs").mkdir()
    for number, log in enumerate(make_logs({"steering_offset": {"angle_deg": 1.0}}, seed=3)[:8]):
        log.to_csv(place / "runs" / f"{number}.csv", index=False)
        log.to_csv(place / "run.csv", index=False)
    return place


def test_examples_in_python(folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """All blocks as one script, as a reader would go through them; what is printed is what the comments say."""
    monkeypatch.chdir(folder)
    blocks = re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), flags=re.DOTALL)
    assert len(blocks) >= 5
    names: dict[str, object] = {"__name__": "__main__"}
    for block in blocks:
        exec(compile(block, "README.md", "exec"), names)
    printed = capsys.readouterr().out
    said = re.findall(r"print\(refusal.*?# (.*)", "".join(blocks))
    assert said and all(line in printed.splitlines() for line in said)


@pytest.mark.parametrize("line", [line for line in commands() if not line.startswith((*SERVING, EXPERIMENTS))])
def test_command(line: str, folder: Path, headland: Callable[..., Any], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    run_as_written(line, folder, headland)
