"""The first run says that it compiles, and how long the README says that takes."""

import threading
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest

from planner.cli.common import terminal

README = Path(__file__).parents[2] / "README.md"


class Asked(threading.Event):
    """An event that is still to come for a number of questions."""

    def __init__(self, times: int) -> None:
        super().__init__()
        self.times = times

    def wait(self, timeout: float | None = None) -> bool:
        self.times -= 1
        return self.times < 0


def told(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], misses: int, times: int) -> str:
    """What is said on standard error while a loop loads that was not found on disk so often."""
    loop = SimpleNamespace(stats=SimpleNamespace(cache_misses=dict.fromkeys(range(misses), 1)))
    monkeypatch.setattr(terminal, "COMPILED_LOOPS", (("a_module", "a_loop"),))
    monkeypatch.setitem(cast(dict[str, object], terminal.sys.modules), "a_module", SimpleNamespace(a_loop=loop))
    terminal._announce_compiling(Asked(times))
    return capsys.readouterr().err


def test_a_first_run_says_how_long_it_compiles(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    said = told(monkeypatch, capsys, misses=1, times=3)
    assert said.splitlines() == [terminal.COMPILING_MESSAGE], "once"
    readme = " ".join(README.read_text(encoding="utf-8").split())
    assert "first run only, about a minute" in said
    assert "The first run compiles the simulator for your machine, which takes about a minute" in readme


def test_of_a_loop_that_is_on_disk_nothing_is_said(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert told(monkeypatch, capsys, misses=0, times=3) == ""


def test_before_its_patience_is_over_it_says_nothing(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert told(monkeypatch, capsys, misses=1, times=0) == ""
