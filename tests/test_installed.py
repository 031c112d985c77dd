"""The installed package holds every module, page, table and template of this folder."""

import shutil
import subprocess
import sys
import sysconfig
import zipfile
from importlib.metadata import Distribution, version
from pathlib import Path

import pytest

import planner

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
BUILT = """
import sys
from setuptools import build_meta

print(getattr(build_meta, sys.argv[1])(sys.argv[2]))
"""
NAMED = """
import runpy
import site
import sys

site.addsitedir(sys.argv[1])
sys.path.append(sys.argv[2])
import headland
import planner

assert all(getattr(headland, name) is getattr(planner, name) for name in planner.__all__)
assert set(planner.__all__) <= set(headland.__all__) <= set(dir(headland))
from headland import PlanRequest
assert PlanRequest is planner.PlanRequest
print(planner.__file__)
sys.argv = ["headland", "field", "denmark", "--list", "--json"]
runpy.run_module("headland", run_name="__main__")
"""
LEAST_SETUPTOOLS = 77  # what pyproject.toml asks of whoever builds


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
    words = [str(command), "guide", "glossary"]
    done = subprocess.run(words, cwd=tmp_path, env={}, capture_output=True, text=True, timeout=240, check=False)
    assert done.returncode == 0, done.stderr
    assert "Glossary" in done.stdout


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


@pytest.fixture(scope="module")
def sources(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The sources in a folder of their own, as building leaves files beside them."""
    if int(version("setuptools").split(".")[0]) < LEAST_SETUPTOOLS:
        pytest.skip("setuptools is too old to build headland")
    folder = tmp_path_factory.mktemp("sources")
    for name in (*ROOMS, "pyproject.toml", "README.md", "LICENSE"):
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(ROOT / name, folder / name)
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["build_wheel", pytest.param("build_editable", marks=pytest.mark.matrix)])
def test_the_own_name_is_what_planner_is(kind: str, sources: Path, tmp_path: Path) -> None:
    """From a wheel and from an editable install, with nothing else of this project in reach."""
    run = {"capture_output": True, "text": True, "timeout": 240, "check": False}
    built = subprocess.run([sys.executable, "-c", BUILT, kind, str(tmp_path)], cwd=sources, **run)  # type: ignore[call-overload]
    assert built.returncode == 0, built.stderr
    place = tmp_path / "site"
    with zipfile.ZipFile(tmp_path / built.stdout.splitlines()[-1]) as wheel:
        wheel.extractall(place)
    libraries = tmp_path / "libraries"
    libraries.mkdir()
    for entry in Path(sysconfig.get_path("purelib")).iterdir():
        if entry.name.split("-")[0] not in (*ROOMS, "headland") and entry.suffix != ".pth":
            (libraries / entry.name).symlink_to(entry)
    words = [sys.executable, "-I", "-S", "-c", NAMED, str(place), str(libraries)]
    done = subprocess.run(words, cwd=tmp_path, env={}, **run)  # type: ignore[call-overload]
    assert done.returncode == 0, done.stderr
    own = place if kind == "build_wheel" else sources
    assert Path(done.stdout.splitlines()[0]) == own / "planner" / "__init__.py"
    assert '"area_ha"' in done.stdout


def test_the_own_name_hands_on_every_name() -> None:
    from planner.cli.alias import headland

    assert all(getattr(headland, name) is getattr(planner, name) for name in planner.__all__)
    with pytest.raises(AttributeError, match="no attribute 'plans'"):
        headland.plans  # noqa: B018
