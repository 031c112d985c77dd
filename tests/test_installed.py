"""The installed package holds every module, page, table and template of this folder."""

import subprocess
import sys
import sysconfig
from importlib.metadata import Distribution
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
ROOMS = ("planner", "vehicle", "fields", "strategies", "reports")
LOADED = """
import sys
from importlib import import_module
from pathlib import Path

modules = [import_module(name) for name in sys.stdin.read().split()]
places = {Path(module.__file__).parents[module.__name__.count(".") + hasattr(module, "__path__")] for module in modules}
print(*places)

from vehicle.control.speed import compute_follower_speed
from vehicle.model.tractor import load_tractor

print(load_tractor("eg105").name)
print(compute_follower_speed(5.0, 6.0, 1.0), *compute_follower_speed.signatures)
"""


@pytest.fixture
def installed() -> Path:
    """The folder into which the package is installed."""
    place = Path(sysconfig.get_path("purelib"))
    if not list(Distribution.discover(name="headland", path=[str(place)])):
        pytest.skip("headland is not installed in this environment")
    if not (place / "planner").is_dir():
        pytest.skip("headland is installed as a link to its sources")
    return place


def contents(place: Path) -> dict[str, bytes]:
    """Bytes of the files of all rooms below a folder, but for what Python keeps there."""
    files = [file for room in ROOMS for file in (place / room).rglob("*") if file.is_file()]
    return {str(file.relative_to(place)): file.read_bytes() for file in files if "__pycache__" not in file.parts}


def test_every_file_is_installed(installed: Path) -> None:
    assert contents(installed) == contents(ROOT)


def test_the_command_starts_from_what_is_installed(installed: Path, tmp_path: Path) -> None:
    command = Path(sys.executable).with_name("headland")
    words = [command, "field", "denmark", "--list", "--json"]
    done = subprocess.run(words, cwd=tmp_path, env={}, capture_output=True, text=True, timeout=240, check=False)
    assert done.returncode == 0, done.stderr
    assert '"area_ha"' in done.stdout


def test_every_module_is_loaded_from_what_is_installed(installed: Path, tmp_path: Path) -> None:
    """All of them with nothing but what is installed in reach, a tractor out of its data, and one formula compiled."""
    files = [file.relative_to(installed) for room in ROOMS for file in (installed / room).rglob("*.py")]
    parts = [file.with_suffix("").parts for file in files if "migrations" not in file.parts]  # these alembic loads
    names = [".".join(part[:-1] if part[-1] == "__init__" else part) for part in parts]
    assert len(names) > 300
    done = subprocess.run(
        [sys.executable, "-I", "-c", LOADED], input="\n".join(names), cwd=tmp_path, env={}, capture_output=True,
        text=True, timeout=240, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == [str(installed), "Yanmar EG105", "0.5 (float64, float64, float64)"]
