"""The cache of compiled functions on disk: it saves time, and never changes or ends a run."""

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
CALLEE = "from vehicle.jit import compile_function\n\n@compile_function\ndef inner(x):\n    return {} * x\n"
CALLER = "from vehicle.jit import compile_function\nfrom vehicle.one import inner\n\n"
CALLER += "@compile_function\ndef outer(x):\n    return inner(x) + 1.0\n"
CODE = "from vehicle.two import outer; print(outer(3.0), sum(outer.stats.cache_hits.values()))"
DAMAGED = """
import sys
from itertools import product
from pathlib import Path
from vehicle import jit

def load():
    for name in ("vehicle.one", "vehicle.two"):
        sys.modules.pop(name, None)
    jit._print_once.cache_clear()
    from vehicle.two import outer
    print(outer(3.0), sum(outer.stats.cache_hits.values()), file=sys.stderr)

load()
for kind, damage in product(("*.nbi", "*.nbc"), ("empty", "cut", "garbage")):
    print("damaged:", kind, damage, file=sys.stderr)
    for path in Path("kept").rglob(kind):
        content = path.read_bytes()
        path.write_bytes({"empty": b"", "cut": content[: len(content) // 2], "garbage": b"\\xff" * 99}[damage])
    load()
    load()
"""
"""Each damage to the cache in turn; after each both modules are loaded again, twice, as processes would."""
Run = Callable[..., tuple[str, str]]


@pytest.fixture
def room(tmp_path: Path) -> Path:
    """A copy of the two packages, with a function of one module that calls one of another."""
    for name in ("fields", "vehicle"):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__"))
    (tmp_path / "vehicle" / "one.py").write_text(CALLEE.format("2.0"))
    (tmp_path / "vehicle" / "two.py").write_text(CALLER)
    return tmp_path


@pytest.fixture
def run(room: Path) -> Run:
    """Output of a separate process: result and number of functions loaded from disk, and standard error."""

    def start(code: str = CODE, **environment: str) -> tuple[str, str]:
        whole = {**os.environ, "PYTHONPATH": str(room), "NUMBA_CACHE_DIR": str(room / "kept"), **environment}
        whole["PYTHONDONTWRITEBYTECODE"] = "1"  # its bytecode is taken as fresh after a change within one second
        words = [sys.executable, "-W", "error", "-c", code]
        done = subprocess.run(words, capture_output=True, text=True, env=whole, timeout=120, cwd=room, check=True)
        return done.stdout.strip(), done.stderr

    return start


@pytest.mark.matrix
def test_the_second_run_loads_from_disk(run: Run) -> None:
    assert run() == ("7.0 0", "")
    assert run() == ("7.0 1", "")


@pytest.mark.slow
def test_a_changed_callee_is_compiled_into_its_callers(run: Run, room: Path) -> None:
    run()
    (room / "vehicle" / "one.py").write_text(CALLEE.format("5.0"))
    assert run() == ("16.0 0", "")
    assert run() == ("16.0 1", "")


@pytest.mark.matrix
def test_a_changed_callee_in_another_folder_of_a_package_is_compiled_into_its_callers(run: Run, room: Path) -> None:
    for name in ("moves", "tours"):
        (room / "strategies" / name).mkdir(parents=True)
    inner = room / "strategies" / "moves" / "inner.py"
    inner.write_text(CALLEE.format("2.0"))
    (room / "strategies" / "tours" / "outer.py").write_text(CALLER.replace("vehicle.one", "strategies.moves.inner"))
    code = CODE.replace("vehicle.two", "strategies.tours.outer")
    environment = {**os.environ, "PYTHONPATH": str(room), "NUMBA_CACHE_DIR": str(room / "kept")}

    def start() -> str:
        words = [sys.executable, "-c", code]
        return subprocess.run(words, capture_output=True, text=True, env=environment, cwd=room, check=True).stdout

    assert [start(), start()] == ["7.0 0\n", "7.0 1\n"]
    inner.write_text(CALLEE.format("5.0"))
    assert start() == "16.0 0\n"


@pytest.mark.slow
def test_what_is_shipped_is_used_where_the_sources_are_the_same(run: Run, room: Path) -> None:
    """Compiled for a generic processor, and loaded on this one where nothing else is kept."""
    types = "(__import__('numba').float64,)"
    ship = f"from vehicle.two import outer; from vehicle.jit import ship_overload; t = {types}; outer.compile(t); "
    run(ship + "ship_overload(outer, t)", NUMBA_CPU_NAME="generic", NUMBA_CACHE_DIR=str(room / "builder"))
    asked = f"; from vehicle.jit import is_compiled; print(is_compiled(outer, {types}))"
    assert run(CODE + asked) == ("7.0 1\nTrue", "")
    (room / "vehicle" / "one.py").write_text(CALLEE.format("5.0"))
    assert run() == ("16.0 0", "")


@pytest.mark.matrix
def test_a_damaged_file_that_was_shipped_is_as_good_as_none(run: Run, room: Path) -> None:
    types = "(__import__('numba').float64,)"
    ship = f"from vehicle.two import outer; from vehicle.jit import ship_overload; t = {types}; outer.compile(t); "
    run(ship + "ship_overload(outer, t)", NUMBA_CPU_NAME="generic", NUMBA_CACHE_DIR=str(room / "builder"))
    damaged = list((room / "vehicle" / "kernels").rglob("*.nbc"))
    for path in damaged:
        path.write_bytes(b"damaged")
    assert damaged and run() == ("7.0 0", "")
    assert run() == ("7.0 1", ""), "what this machine compiled is kept"


@pytest.mark.slow
def test_only_what_python_calls_gets_machine_code(run: Run) -> None:
    """A callee is linked into its caller; called itself, it is compiled for that."""
    code = "from vehicle.two import outer; from vehicle.one import inner; print(outer(3.0), len(inner.overloads), "
    assert run(code + "inner(3.0), len(inner.overloads))") == ("7.0 0 6.0 1", "")


@pytest.mark.slow
def test_damaged_files_are_compiled_again(run: Run) -> None:
    _, said = run(DAMAGED)
    first, *reports = said.split("damaged: ")
    assert first == "7.0 0\n"
    assert len(reports) == 6
    for report in reports:
        how, note, anew, kept = report.splitlines()
        assert note.startswith("Note: ") and "is compiled again" in note, how
        assert (anew, kept) == ("7.0 0", "7.0 1"), how


@pytest.mark.slow
def test_without_a_folder_that_can_be_written_to(run: Run) -> None:
    """Only the named folder may be used, and it cannot be created: a read-only installation without a home."""
    nowhere = {"NUMBA_CACHE_LOCATOR_CLASSES": "UserProvidedCacheLocator", "NUMBA_CACHE_DIR": f"{__file__}/no"}
    result, said = run(**nowhere)
    assert result == "7.0 0"
    assert said.count("\n") == 1 and "cannot be stored on disk" in said and "NUMBA_CACHE_DIR" in said


@pytest.mark.matrix
def test_a_disk_that_fills_up(run: Run, room: Path) -> None:
    """The folder takes an empty file, as it does on a full disk, but nothing larger."""
    limited = "import resource, signal; signal.signal(signal.SIGXFSZ, signal.SIG_IGN); "
    limited += "resource.setrlimit(resource.RLIMIT_FSIZE, (16, 16)); "
    pytest.importorskip("resource")
    whole = {**os.environ, "PYTHONPATH": str(room), "NUMBA_CACHE_DIR": str(room / "kept")}
    words = [sys.executable, "-B", "-c", limited + CODE]
    done = subprocess.run(words, capture_output=True, text=True, env=whole, timeout=120, cwd=room, check=False)
    assert (done.returncode, done.stdout.strip()) == (0, "7.0 0"), done.stderr
    assert done.stderr.count("\n") == 1 and "cannot be stored on disk" in done.stderr
