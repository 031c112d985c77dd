"""What is kept of simulated field times."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely

from fields.field import Field
from planner.chance.graph import Graph, Link
from planner.content import KINDS, ROOMS, _imported, code_version, digest
from planner.day.cache import Cache, user_folder
from planner.day.times import FieldTime, Task, field_times, packed, unknown
from planner.pool import SerialExecutor
from planner.scenario import Scenario
from vehicle.tractor import Implement, load_tractor

GRAPH = Graph(
    tractors=2, first=(0, 2), tractor=np.array([0, 0, 1]), driven_s=np.array([0.1, 1.0 / 3.0, 7e-9]),
    group=np.array([0, 1, 0]), kind=np.array([0, 1, 0]), worked_m=np.array([10.0, 0.0, 1e6 / 7.0]), order=(0, 2, 1),
    links=(Link(2, 1, 0.1 + 0.2, 1.0, at_end=True),), stand_s=np.array([0.0, 300.1, 0.0]),
    leaving=np.array([False, True, False]),
)  # fmt: skip


@pytest.fixture
def task() -> Task:
    field = Field("one", shapely.box(0, 0, 40, 80))
    return Task(field, Scenario(field="one", tractors=(1,)), load_tractor("eg105"), Implement())


def test_what_is_kept_comes_back_to_the_last_bit(tmp_path: Path, task: Task) -> None:
    cache = Cache(tmp_path / "deep" / "down")
    kept = FieldTime("split-field", 2, 1.0 / 3.0, 99.1, None, GRAPH)
    assert cache.write(task.key, packed(kept))
    ((found,),), written = field_times([[task]], cache, SerialExecutor())
    assert written and found is not None and found.graph is not None
    assert packed(found) == packed(kept)
    assert found.graph.links == GRAPH.links and found.graph.driven_s.tolist() == GRAPH.driven_s.tolist()
    assert [path.name for path in (tmp_path / "deep" / "down").iterdir()] == [f"{task.key}.json"]


def test_the_name_is_that_of_the_content(task: Task) -> None:
    renamed = replace(task.field, name="two", crs="EPSG:32632", origin_m=(5.0, 6.0), remarks=("Hm.",))
    assert replace(task, field=renamed).key == task.key
    assert replace(task, scenario=replace(task.scenario, field="two")).key == task.key
    wider = replace(task, field=Field("one", shapely.box(0, 0, 40.001, 80)))
    more = replace(task, scenario=replace(task.scenario, tractors=(2,)))
    other = replace(task, tractor=load_tractor("mr1000a"))
    longer = replace(task, implement=Implement(length_m=0.8))
    assert len({task.key, wider.key, more.key, other.key, longer.key}) == 5
    assert digest("a", ["b"]) != digest("a", "b") and len(code_version()) == 64


def test_every_room_counts_with_its_data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    root = Path(__file__).parents[2]
    assert {path.parent.name for path in root.glob("*/__init__.py")} - {"tests"} == set(ROOMS)
    monkeypatch.setattr("planner.content.__file__", str(tmp_path / "planner" / "content.py"))
    found = [code_version.__wrapped__()]
    for place in [f"{room}/deep/it{kind}" for room in ROOMS for kind in KINDS]:
        (tmp_path / place).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / place).write_text("x")
        found.append(code_version.__wrapped__())
    assert len({*found}) == 1 + len(KINDS) * len(ROOMS)


def test_field_times_are_kept_while_only_what_they_do_not_use_changes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sources = {
        "planner/work.py": "from vehicle import drive\nfrom planner.ways import lead\n",
        "planner/__init__.py": "",
        "planner/ways/__init__.py": "from planner.ways.far import lead\n",
        "planner/ways/far.py": "from strategies.registry import all\n",
        "planner/ways/other.py": "",
        "planner/service/api.py": "import planner.work\n",
        "vehicle/__init__.py": "",
        "vehicle/drive.py": "def go():\n    import fields.place\n",
        "fields/place.py": "import numpy\n",
        "strategies/registry.py": "from importlib import import_module\nimport_module('one')\n",
        "strategies/one.py": "",
        "strategies/data.toml": "",
    }
    for name, text in sources.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    monkeypatch.setattr("planner.content.__file__", str(tmp_path / "planner" / "content.py"))
    first, unused = code_version.__wrapped__("planner.work"), set()
    for name, text in sources.items():
        (tmp_path / name).write_text(text + "# changed\n")
        if code_version.__wrapped__("planner.work") == first:
            unused.add(name)
        (tmp_path / name).write_text(text)
    assert unused == {"planner/ways/other.py", "planner/service/api.py"}


def test_field_times_depend_on_physics_and_plans_and_not_on_who_asks_for_them() -> None:
    root = Path(__file__).parents[2]
    used = {path.relative_to(root).as_posix() for path in _imported(root, "planner.day.times")}
    assert used >= {
        "planner/day/times.py", "planner/candidates/evaluate.py", "planner/chance/graph.py", "vehicle/loop.py",
        "strategies/interleaved.py", "strategies/orders/sequence.py", "fields/layout.py", "planner/__init__.py",
    }  # fmt: skip
    assert not [path for path in used if path.startswith(("planner/service", "planner/commands", "planner/day/solve"))]


@pytest.mark.parametrize("text", ["", "{", "[]", '{"strategy": "x"}', '{"graph": {"first": 3}}', "\x00"])
def test_what_is_not_whole_is_not_there(tmp_path: Path, task: Task, text: str) -> None:
    (tmp_path / f"{task.key}.json").write_text(text)
    assert unknown([[task]], Cache(tmp_path)) == 1


def test_a_folder_that_takes_no_files_only_costs_time(tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("")
    assert not Cache(blocked / "sub").write("name", {"a": 1})
    assert Cache(blocked / "sub").read("name") is None
    assert Cache(None).write("name", {}) and Cache(None).read("name") is None


def test_a_file_is_never_half_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cache = Cache(tmp_path)
    assert cache.write("name", {"a": 1})

    def full(*_: object) -> None:
        raise OSError("the disk is full")

    monkeypatch.setattr("os.replace", full)
    assert not cache.write("name", {"a": 2})
    assert [path.name for path in tmp_path.iterdir()] == ["name.json"]
    assert json.loads((tmp_path / "name.json").read_text()) == {"a": 1}


@pytest.mark.parametrize("system", ["linux", "darwin", "win32"])
def test_every_system_has_its_folder(system: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("sys.platform", system)
    monkeypatch.delenv("HEADLAND_CACHE", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("LOCALAPPDATA", str(tmp_path))
    assert "headland" in user_folder().parts
    assert system == "darwin" or tmp_path in user_folder().parents
    monkeypatch.setenv("HEADLAND_CACHE", str(tmp_path / "own"))
    assert user_folder() == tmp_path / "own"
