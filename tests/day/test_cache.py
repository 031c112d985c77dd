"""What is kept of simulated field times."""

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely

from fields.geometry.field import Field
from planner.day.field_times import (
    FieldTime,
    compute_field_times,
    count_uncached_field_times,
    hash_field_time_order,
    pack_field_time,
)
from planner.evaluation.work_order import WorkOrder
from planner.pipeline.executors import SerialExecutor
from planner.pipeline.fingerprint import (
    FILE_SUFFIXES,
    PACKAGES,
    hash_code,
    hash_content,
    hash_sources,
)
from planner.pipeline.result_cache import ResultCache, find_cache_folder
from planner.request.plan_request import PlanRequest
from planner.risk.leg_graph import LegConsumption, LegGraph, WaitLink
from vehicle.model.tractor import Implement, load_tractor

GRAPH = LegGraph(
    tractors=2,
    first_nodes=(0, 2),
    tractor=np.array([0, 0, 1]),
    driven_s=np.array([0.1, 1.0 / 3.0, 7e-9]),
    group=np.array([0, 1, 0]),
    kind=np.array([0, 1, 0]),
    worked_m=np.array([10.0, 0.0, 1e6 / 7.0]),
    order=(0, 2, 1),
    links=(WaitLink(2, 1, 0.1 + 0.2, 1.0, at_end=True),),
    stand_s=np.array([0.0, 300.1, 0.0]),
    leaving=np.array([False, True, False]),
    fuel=LegConsumption(np.array([0.1, 1.0 / 7.0, 0.0]), 2.0 / 3600.0),
)


@pytest.fixture
def task() -> WorkOrder:
    field = Field("one", shapely.box(0, 0, 40, 80))
    return WorkOrder(PlanRequest(field="one", tractors=(1,)), field, load_tractor("eg105"), Implement())


def test_what_is_kept_comes_back_to_the_last_bit(tmp_path: Path, task: WorkOrder) -> None:
    cache = ResultCache(tmp_path / "deep" / "down")
    kept = FieldTime("split-field", 2, 1.0 / 3.0, 99.1, None, GRAPH)
    assert cache.write(hash_field_time_order(task), pack_field_time(kept))
    ((found,),), written = compute_field_times([[task]], cache, SerialExecutor())
    assert written and found is not None and found.graph is not None
    assert pack_field_time(found) == pack_field_time(kept)
    assert found.graph.links == GRAPH.links and found.graph.driven_s.tolist() == GRAPH.driven_s.tolist()
    assert [path.name for path in (tmp_path / "deep" / "down").iterdir()] == [f"{hash_field_time_order(task)}.json"]


def test_the_name_is_that_of_the_content(task: WorkOrder) -> None:
    renamed = replace(task.field, name="two", crs="EPSG:32632", origin_m=(5.0, 6.0), remarks=("Hm.",))
    for same in (replace(task, field=renamed), replace(task, request=replace(task.request, field="two"))):
        assert hash_field_time_order(same) == hash_field_time_order(task)
    wider = replace(task, field=Field("one", shapely.box(0, 0, 40.001, 80)))
    more = replace(task, request=replace(task.request, tractors=(2,)))
    other = replace(task, tractor=load_tractor("mr1000a"))
    longer = replace(task, implement=Implement(length_m=0.8))
    assert len({hash_field_time_order(one) for one in (task, wider, more, other, longer)}) == 5
    assert hash_content("a", ["b"]) != hash_content("a", "b") and len(hash_code()) == 64


def test_heights_count_by_what_their_file_holds(tmp_path: Path, task: WorkOrder) -> None:
    def find_key(name: Path, x_m: float = 0.0) -> str:
        field = replace(task.field, elevation=str(name), origin_m=(x_m, 0.0))
        return hash_field_time_order(replace(task, field=field))

    first, copy, folder = (tmp_path / name for name in ("a.asc", "b.asc", "agopengps"))
    keys = [hash_field_time_order(task), find_key(first)]
    for text in ("100", "101"):
        first.write_text(text)
        copy.write_text(text)
        keys.append(find_key(first))
        assert find_key(copy) == keys[-1]
    first.with_suffix(".prj").write_text("EPSG:25832")
    keys += [find_key(first), find_key(first, 5.0)]
    folder.mkdir()
    for text in ("1", "2"):
        (folder / "Elevation.txt").write_text(text)
        (folder / "Sections.txt").write_text("not read")
        keys.append(find_key(folder))
    (folder / "Sections.txt").write_text("still not")
    assert find_key(folder) == keys[-1] and len(set(keys)) == len(keys)


def test_a_refusal_of_heights_is_not_kept_and_shows_no_folder(tmp_path: Path, task: WorkOrder) -> None:
    lost = replace(task, field=replace(task.field, elevation=str(tmp_path / "lost.tif")))
    cache = ResultCache(tmp_path / "cache")
    ((refused,),), is_cached = compute_field_times([[lost]], cache, SerialExecutor())
    assert is_cached and refused is not None and count_uncached_field_times([[lost]], cache) == 1
    assert "names the heights 'lost.tif'" in refused.reason and "upload" in refused.reason
    assert str(tmp_path) not in refused.reason and "remove the property elevation" in refused.reason


def test_every_room_counts_with_its_data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    root = Path(__file__).parents[2]
    assert {path.parent.name for path in root.glob("*/__init__.py")} - {"tests"} == set(PACKAGES)
    monkeypatch.setattr(
        "planner.pipeline.fingerprint.__file__", str(tmp_path / "planner" / "pipeline" / "fingerprint.py")
    )
    found = [hash_code.__wrapped__()]
    for place in [f"{room}/deep/it{kind}" for room in PACKAGES for kind in FILE_SUFFIXES]:
        (tmp_path / place).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / place).write_text("x")
        found.append(hash_code.__wrapped__())
    assert len({*found}) == 1 + len(FILE_SUFFIXES) * len(PACKAGES)


@pytest.mark.parametrize("text", ["", "{", "[]", '{"strategy": "x"}', '0\n{"reason": "x", "left_ha": 0.0}', "\x00"])
def test_what_is_not_whole_is_not_there(tmp_path: Path, task: WorkOrder, text: str) -> None:
    (tmp_path / f"{hash_field_time_order(task)}.json").write_text(text)
    assert count_uncached_field_times([[task]], ResultCache(tmp_path)) == 1


def test_a_folder_that_takes_no_files_only_costs_time(tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("")
    assert not ResultCache(blocked / "sub").write("name", {"a": 1})
    assert ResultCache(blocked / "sub").read("name") is None
    assert ResultCache(None).write("name", {}) and ResultCache(None).read("name") is None


def test_a_file_is_never_half_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cache = ResultCache(tmp_path)
    assert cache.write("name", {"a": 1})

    def full(*_: object) -> None:
        raise OSError("the disk is full")

    monkeypatch.setattr("os.replace", full)
    assert not cache.write("name", {"a": 2})
    assert [path.name for path in tmp_path.iterdir()] == ["name.json"]
    assert cache.read("name") == {"a": 1}


@pytest.mark.parametrize(("source", "beside"), [("TASKDATA.XML", "TLG00001.BIN"), ("work.shp", "work.dbf")])
def test_what_files_beside_a_source_hold_counts(tmp_path: Path, source: str, beside: str) -> None:
    hashes = []
    for content in ("one", "two"):
        (tmp_path / source).write_text("same", encoding="utf-8")
        (tmp_path / beside).write_text(content, encoding="utf-8")
        hashes.append(hash_sources([str(tmp_path / source)]))
    assert hashes[0] != hashes[1] and len(hashes[0]) == 2


@pytest.mark.parametrize("system", ["linux", "darwin", "win32"])
def test_every_system_has_its_folder(system: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("sys.platform", system)
    monkeypatch.delenv("HEADLAND_CACHE", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("LOCALAPPDATA", str(tmp_path))
    assert "headland" in find_cache_folder().parts
    assert system == "darwin" or tmp_path in find_cache_folder().parents
    monkeypatch.setenv("HEADLAND_CACHE", str(tmp_path / "own"))
    assert find_cache_folder() == tmp_path / "own"


def test_a_user_without_a_home_has_a_folder(monkeypatch: pytest.MonkeyPatch) -> None:
    def find_none() -> Path:
        raise RuntimeError("Could not determine home directory.")

    for name in ("HEADLAND_CACHE", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(Path, "home", find_none)
    assert Path(tempfile.gettempdir()) in find_cache_folder().parents
