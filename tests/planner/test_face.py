"""`headland` is all that programs import: the guide says so, and names that are taken are told."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import fields
import planner
from planner.cli.alias import headland
from planner.guide.guide_pages import list_pages

ROOT = Path(__file__).parents[2]
ROOMS = ("fields", "planner", "reports", "strategies", "vehicle")
IMPORT = re.compile(rf"^\s*(?:>>> )?(?:from|import)\s+(?:{'|'.join(ROOMS)})\b.*$", re.MULTILINE)
IMPORTED = re.compile(r"^\s*from headland import (.+)$", re.MULTILINE)


def run(code: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """A script of a user in a folder, with Headland's sources behind it on the path."""
    (folder / "script.py").write_text(code, encoding="utf-8")
    environment = os.environ | {"PYTHONPATH": os.pathsep.join((str(ROOT), str(ROOT / "planner/cli/alias")))}
    words = [sys.executable, str(folder / "script.py")]
    return subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True, check=False, timeout=60)


def test_no_page_imports_anything_else() -> None:
    texts = {page.topic: page.text for page in list_pages()} | {"README": (ROOT / "README.md").read_text("utf-8")}
    assert {topic: IMPORT.findall(text) for topic, text in texts.items() if IMPORT.search(text)} == {}
    names = {name for text in texts.values() for line in IMPORTED.findall(text) for name in line.split(", ")}
    assert len(names) > 10 and names <= set(headland.__all__)


def test_every_name_is_there_and_the_type_checker_knows_the_same() -> None:
    assert len(set(headland.__all__)) == len(headland.__all__)
    assert {name for names in headland._HOMES.values() for name in names} == set(headland.__all__)
    assert all(getattr(headland, name) is not None for name in headland.__all__)
    assert headland.read_field is fields.read_field and headland.plan is planner.plan


@pytest.mark.parametrize("own", ["fields.py", "vehicle/__init__.py", "planner.py"])
@pytest.mark.parametrize("before", ["", "import {room}\n"])
def test_a_module_that_hides_one_of_headland_is_named(own: str, before: str, tmp_path: Path) -> None:
    (tmp_path / own).parent.mkdir(exist_ok=True)
    (tmp_path / own).write_text("mine = 1\n")
    room = own.partition("/")[0].removesuffix(".py")
    done = run(f"{before.format(room=room)}import headland\nheadland.plan\n", tmp_path)
    assert done.returncode == 1
    last = done.stderr.splitlines()[-1]
    assert last.startswith(f"ImportError: {tmp_path / own} hides the package '{room}' of Headland; rename it")
    code = f"import {room}\nprint({room}.mine)"
    assert run(code, tmp_path).stdout == "1\n", "what is the user's stays the user's"


def test_other_modules_of_the_user_do_not_matter(tmp_path: Path) -> None:
    (tmp_path / "field.py").write_text("mine = 1\n")
    done = run("import field, headland\nprint(headland.read_field('denmark').name, field.mine)", tmp_path)
    assert done.stdout == "denmark 1\n", done.stderr
