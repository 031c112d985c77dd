"""The first run says that it compiles and how long, and a bar counts what is done and tells what is left."""

import contextvars
import io
from collections.abc import Callable
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

import pytest
import rich.console

from planner.cli.common import progress, terminal
from planner.errors import WorkerError
from planner.pipeline import executors, kernels, worker_tasks
from reports.common.language import Reader, set_reader

README = Path(__file__).parents[2] / "README.md"
MISSING = [kernels.Kernel(kernels.PLAN, 9.0, f"a.b{number}.c", "float64") for number in range(3)]
Clock = Callable[[float], None]


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    """Sets the time that bars see."""
    now = [100.0]
    monkeypatch.setattr("time.monotonic", lambda: now[0])

    def advance(seconds: float) -> None:
        now[0] += seconds

    return advance


@pytest.fixture
def missing(monkeypatch: pytest.MonkeyPatch) -> list[kernels.Kernel]:
    """Functions that are missing on this machine; on one core each is compiled at once."""
    found: list[kernels.Kernel] = []
    monkeypatch.setattr(kernels, "list_missing_kernels", lambda uses=(): list(found))
    monkeypatch.setattr(kernels, "compile_share", lambda share: None)
    monkeypatch.setattr(worker_tasks, "warm_up_simulation", lambda: None)
    monkeypatch.setattr("os.cpu_count", lambda: 1)
    return found


def test_a_first_run_says_how_long_it_compiles(
    missing: list[kernels.Kernel], capsys: pytest.CaptureFixture[str]
) -> None:
    missing += MISSING
    terminal.warm_up()
    said = capsys.readouterr().err
    assert said == "Compiling the simulator for this machine (3 functions): first run only, about 25 s.\n"
    readme = " ".join(README.read_text(encoding="utf-8").split())
    assert "The first run compiles the simulator for your machine, which takes about half a minute" in readme


def test_of_what_is_on_disk_or_compiled_in_a_moment_nothing_is_said(
    missing: list[kernels.Kernel], capsys: pytest.CaptureFixture[str]
) -> None:
    terminal.warm_up()
    missing.append(kernels.Kernel(kernels.PLAN, 1.0, "a.b.c", "float64"))
    terminal.warm_up()
    assert capsys.readouterr() == ("", "")


def test_a_bar_counts_and_says_what_is_left(clock: Clock) -> None:
    bar = progress.StageBar("Loading")
    assert (bar.words, bar.share, bar.describe_left()) == ("Loading", None, "")
    bar.expect({"Compiling": 20.0, "Planning": 20.0})
    bar.report("Compiling", 0, 4)
    assert (bar.words, bar.share, bar.describe_left()) == ("Compiling: 0 of 4", 0.0, "about 0:40 left")
    clock(10.0)
    bar.report("Compiling", 1, 4, 0.5)
    assert (bar.share, bar.describe_left()) == (0.25, "about 0:30 left"), "as expected"
    clock(3.0)
    assert bar.describe_left() == "about 0:27 left", "counts down between reports"
    bar.report("Planning", 0, 0)
    assert (bar.words, bar.share) == ("Planning", 0.5), "a total that is not known yet is not shown"
    clock(1000.0)
    assert bar.describe_left() == "nearly done"


def test_twice_as_slow_as_expected_leaves_about_twice_as_much(clock: Clock) -> None:
    bar = progress.StageBar("")
    bar.expect({"Compiling": 1000.0})
    clock(1000.0)
    bar.report("Compiling", 5, 10)
    assert bar.left_s == pytest.approx(1000.0, rel=0.02)


def test_without_expectations_the_share_tells_what_is_left(clock: Clock) -> None:
    bar = progress.StageBar("Reading")
    clock(6.0)
    bar.report("Reading", 0, 9)
    assert bar.describe_left() == ""
    bar.report("Reading", 3, 9)
    assert (bar.words, bar.describe_left()) == ("Reading: 3 of 9", "about 0:12 left")


def test_a_service_compiles_in_another_process_for_its_reader(
    missing: list[kernels.Kernel], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    missing += MISSING
    monkeypatch.setattr(executors, "LocalPool", lambda processes: executors.SerialExecutor())
    contextvars.copy_context().run(compile_for, Reader("de"))
    assert "Der Simulator wird für diesen Rechner kompiliert (3 Funktionen)" in capsys.readouterr().err


def test_a_compiling_process_that_is_killed_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    killed = executors.SerialExecutor()
    monkeypatch.setattr(killed, "submit", lambda *_: (_ for _ in ()).throw(BrokenProcessPool()))
    monkeypatch.setattr(executors, "LocalPool", lambda processes: killed)
    with pytest.raises(WorkerError, match="killed, probably for lack of memory"):
        terminal.compile_apart((kernels.PLAN,))


def compile_for(reader: Reader) -> None:
    set_reader(reader)
    terminal.compile_apart((kernels.PLAN,))


@pytest.mark.parametrize("columns", [60, 80])
def test_a_terminal_sees_the_stage_from_the_start(monkeypatch: pytest.MonkeyPatch, columns: int) -> None:
    screen = io.StringIO()
    shown = rich.console.Console(file=screen, force_terminal=True, width=columns)
    monkeypatch.setattr(progress, "Console", lambda stderr: shown)
    with progress.open_stage_bar("Loading the simulator") as bar:
        bar.expect({"Compiling functions": 9.0})
        bar.report("Compiling functions", 12, 42, 0.25)
    assert "Loading the simulator" in screen.getvalue()
    last = next(line for line in screen.getvalue().replace("\r", "\n").splitlines()[::-1] if "Compiling" in line)
    assert "Compiling functions: 12 of 42" in last and "left" in last and "?" not in last


def test_elsewhere_no_bar_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    with terminal.create_progress_callback("Working") as report:
        report(1, 2)
    assert capsys.readouterr() == ("", "")
