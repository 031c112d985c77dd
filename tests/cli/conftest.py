"""The command as a user runs it: in this process where that is enough, in its own where the system matters."""

import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from tests.cli.refusals import contents, lay_out
from tests.drawn_fields import rectangle

COMMAND = [sys.executable, "-W", "error", "-c", "from planner.cli.main import main; main()"]


class Outcome(NamedTuple):
    """What a command left behind."""

    status: int
    out: str
    err: str

    @property
    def sentences(self) -> list[str]:
        """Lines on standard error, but for the word that the simulator is compiled first."""
        lines = (line for line in self.err.splitlines() if line.strip())
        return [line for line in lines if not line.startswith("Compiling the simulator")]


Run = Callable[..., Outcome]
"""Runs the command with its words."""


@pytest.fixture(scope="session", autouse=True)
def compiled_simulator() -> None:
    """Compile before the first test: the notice that this takes a while would stand among the lines on stderr."""
    from planner.pipeline.worker_tasks import warm_up_simulation

    warm_up_simulation()


@pytest.fixture(scope="session", autouse=True)
def kept(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Field times are kept in a folder of the tests, by the processes they start too."""
    os.environ["HEADLAND_CACHE"] = str(tmp_path_factory.mktemp("kept"))


@pytest.fixture(scope="session")
def built() -> Any:
    """The command line as typer makes it: made anew for every command, that would take longer than most of them."""
    from typer.main import get_command

    from planner.cli.main import app

    return get_command(app)


@pytest.fixture
def headland(capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, built: Any) -> Run:
    """Run the command in this process, through the same entry as the installed script, as on a machine with one core.

    Where processes are the point they are asked for, or the command runs in its own.
    """
    monkeypatch.setattr("planner.cli.main.app", built)
    monkeypatch.setattr(os, "cpu_count", lambda: 1)

    def run(*arguments: str | Path) -> Outcome:
        from planner.cli.main import main

        monkeypatch.setattr(sys, "argv", ["headland", *map(str, arguments)])
        capfd.readouterr()
        status = 0
        try:
            main()
        except SystemExit as end:
            status = end.code if isinstance(end.code, int) else 1 if end.code else 0
        captured = capfd.readouterr()
        return Outcome(status, captured.out, captured.err)

    return run


@pytest.fixture(scope="module")
def answers() -> dict[tuple[str, ...], Outcome]:
    """What the command said, by its words."""
    return {}


@pytest.fixture
def once(headland: Run, answers: dict[tuple[str, ...], Outcome]) -> Run:
    """`headland` for words that write nothing: the same words of a file are run once."""

    def run(*arguments: str | Path) -> Outcome:
        words = tuple(map(str, arguments))
        if words not in answers:
            answers[words] = headland(*words)
        return answers[words]

    return run


@pytest.fixture
def headland_process(tmp_path: Path) -> Run:
    """Run the command in a process of its own, in an empty folder."""

    def run(*arguments: str | Path) -> Outcome:
        done = subprocess.run(
            [*COMMAND, *map(str, arguments)], capture_output=True, text=True, timeout=240, cwd=tmp_path, check=False
        )
        return Outcome(done.returncode, done.stdout, done.stderr)

    return run


@pytest.fixture(scope="session")
def command() -> list[str]:
    """The words that start the command."""
    return COMMAND


@pytest.fixture(scope="session")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A field file in local metres, 45 m by 80 m."""
    place = tmp_path_factory.mktemp("fields") / "small.geojson"
    place.write_text(json.dumps(rectangle(0, 0, 45, 80)))
    return place


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder of field files to work in; at the end every file must be as it was, and none added."""
    lay_out(tmp_path)
    monkeypatch.chdir(tmp_path)
    before = contents(tmp_path)
    yield tmp_path
    assert contents(tmp_path) == before
