"""What is installed is what is in this folder: every module, page, table and template."""

import subprocess
import sys
import sysconfig
from importlib.metadata import Distribution
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
ROOMS = ("planner", "vehicle", "fields", "strategies", "reports")


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
    words = [command, "field", "denmark", "--json"]
    done = subprocess.run(words, cwd=tmp_path, env={}, capture_output=True, text=True, timeout=240, check=False)
    assert done.returncode == 0, done.stderr
    assert '"area_ha"' in done.stdout
