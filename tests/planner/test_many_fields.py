"""Many fields in one table: names with stars, answers that are kept, a cluster whose worker is killed."""

import json
import os
import signal
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from fields.geometry.chosen_places import add_obstacles
from fields.geometry.field import Field
from planner.errors import HeadlandError
from planner.evaluation.work_order import WorkOrder
from planner.farm.inventory import load_example_farm
from planner.pipeline import many_fields
from planner.pipeline.executors import SerialExecutor, connect_cluster
from planner.pipeline.many_fields import (
    append_record,
    expand_field_names,
    hash_order,
    iter_answers,
    read_answer_file,
    replace_records,
    share_obstacles,
)
from planner.request.option_texts import parse_widths
from planner.request.plan_request import PlanRequest
from reports.plan.comparison import ComparisonRow
from reports.plan.figures import format_ranking_json
from tests.drawn_fields import feature, point, rectangle, write_farm, write_features


@pytest.mark.parametrize("named", ["elevation", "soil"])
def test_answers_hold_for_what_the_files_hold(tmp_path: Path, named: str) -> None:
    """The Elevation.txt of a folder, and a table of soils in a folder with the mark of names."""
    folder = tmp_path / "a#b"
    folder.mkdir()
    path = folder / ("Elevation.txt" if named == "elevation" else "soils.csv")
    value = str(folder) if named == "elevation" else f"{path}#north"
    inputs = WorkOrder(PlanRequest(**{named: value}))  # type: ignore[arg-type]
    keys = set()
    for text in ("one", "two"):
        path.write_text(text)
        keys.add(hash_order(inputs))
    assert len(keys) == 2


@pytest.fixture
def farm(tmp_path: Path) -> Path:
    """Three fields in one file: one of them much too small."""
    return write_farm(tmp_path / "farm.geojson", north=(0, 70, 40), tiny=(200, 2, 2), south=(400, 60, 50))


def list_orders(farm: Path, *widths: float) -> list[WorkOrder]:
    return [
        WorkOrder(PlanRequest(field, local=True, width_m=width, tractors=(1,), no_headland=True))
        for field in expand_field_names([f"{farm}#*"], local=True)
        for width in widths
    ]


def told(answer: ComparisonRow) -> str:
    return str(answer.refusal) if answer.ranking is None else format_ranking_json(answer.ranking)


def test_a_star_stands_for_every_field_of_a_file(farm: Path) -> None:
    assert expand_field_names([f"{farm}#*"], local=True) == (f"{farm}#north", f"{farm}#tiny", f"{farm}#south")


def test_a_pond_is_left_out_of_all_fields_and_told(farm: Path) -> None:
    document = json.loads(farm.read_text())
    document["features"].append(feature(rectangle(20, 10, 10, 10), name="pond") | {"id": "pond"})
    farm.write_text(json.dumps(document))
    remarks: list[str] = []
    names = expand_field_names([f"{farm}#*", f"{farm}#pond"], local=True, show_remarks=remarks.extend)
    assert names == (f"{farm}#north", f"{farm}#tiny", f"{farm}#south", f"{farm}#pond")
    assert len(remarks) == 1 and "'pond' (in 'north')" in remarks[0]


def test_obstacles_and_names_count_where_they_lie(farm: Path) -> None:
    """A tree is in the south field, 430,20 as well; what no field has is refused, and so is a number."""
    document = json.loads(farm.read_text())
    document["features"].append(feature(point(450, 20), name="Eiche"))
    farm.write_text(json.dumps(document))
    names = (f"{farm}#north", f"{farm}#south")

    def share(**more: tuple[str, ...]) -> list[PlanRequest]:
        return share_obstacles([PlanRequest(name, local=True, **more) for name in names])  # type: ignore[arg-type]

    north, south = share(obstacles=("430,20",), ignored=("eiche",))
    assert (north.obstacles, north.ignored, south.obstacles, south.ignored) == ((), (), ("430,20",), ("eiche",))
    with pytest.raises(HeadlandError, match="lies 930 m outside"):
        share(obstacles=("1000,20",))
    with pytest.raises(HeadlandError, match="names no obstacle"):
        share(ignored=("Mast",))
    with pytest.raises(HeadlandError, match="with several fields give the name"):
        share(ignored=("1",))


def test_an_obstacle_is_looked_for_once_in_every_field(farm: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """However many widths: a comparison may ask for hundreds of fields in several."""
    tried: list[Sequence[str]] = []

    def add(field: Field, texts: Sequence[str]) -> Field:
        tried.append(texts)
        return add_obstacles(field, texts)

    monkeypatch.setattr(many_fields, "add_obstacles", add)
    names = (f"{farm}#north", f"{farm}#south")
    share_obstacles(
        [PlanRequest(name, local=True, width_m=width, obstacles=("430,20",)) for name in names for width in (3.0, 6.0)]
    )
    assert len(tried) == len(names)


def test_fields_of_one_name_are_told_apart_by_number(tmp_path: Path) -> None:
    named = ((0, "twin"), (200, "twin"), (400, "other"))
    features = [feature(rectangle(x, 0, 70, 40), name=name) | {"id": name} for x, name in named]
    path = write_features(tmp_path / "twins.geojson", *features)
    assert expand_field_names([f"{path}#*"], local=True) == (f"{path}#twin-1", f"{path}#twin-2", f"{path}#other")


def test_files_with_a_star_come_sorted_and_each_field_once(farm: Path) -> None:
    for name in ("b", "a"):
        (farm.parent / f"{name}.json").write_text("{}", encoding="utf-8")
    pattern = str(farm.parent / "*.json")
    expected = tuple(str(farm.parent / f"{name}.json") for name in "ab")
    assert expand_field_names([pattern, expected[0]]) == expected
    assert expand_field_names(["denmark", "denmark", "sweden"]) == ("denmark", "sweden")
    with pytest.raises(HeadlandError, match="No file matches"):
        expand_field_names([str(farm.parent / "*.kml")])


def test_widths() -> None:
    assert parse_widths("3,6, 4.5,3") == (3.0, 6.0, 4.5)
    for nonsense in ("", "3,", "wide", "3;6", "nan", "1e9999"):
        with pytest.raises(HeadlandError, match="is not a width"):
            parse_widths(nonsense)


def test_a_name_in_brackets_is_no_pattern_where_there_is_such_a_file(tmp_path: Path) -> None:
    (tmp_path / "a#b").mkdir()
    path = write_farm(tmp_path / "a#b" / "farm[1].geojson", north=(0, 70, 40), south=(200, 60, 50))
    both = f"{path}#north", f"{path}#south"
    assert expand_field_names([f"{path}#*", str(path)], local=True) == (*both, str(path))
    assert expand_field_names([f"{tmp_path}/a#b/farm*.geojson#*"], local=True) == both


@pytest.mark.slow
def test_one_field_that_fails_does_not_end_the_rest(farm: Path) -> None:
    found = dict(iter_answers(SerialExecutor(), list_orders(farm, 3.0)))
    assert sorted(found) == [0, 1, 2]
    assert "100 m2" in str(found[1].refusal)
    for index in (0, 2):
        assert (ranking := found[index].ranking) is not None and ranking.best is not None


def test_the_digest_changes_with_the_order_and_with_the_file(farm: Path) -> None:
    one, two = (list_orders(farm, width)[0] for width in (3.0, 4.0))
    before = hash_order(one)
    assert before == hash_order(list_orders(farm, 3.0)[0])
    assert before != hash_order(two)
    farm.write_text(farm.read_text(encoding="utf-8") + " ", encoding="utf-8")
    assert before != hash_order(one)


def test_answers_are_kept_and_read_back_whole(tmp_path: Path) -> None:
    path = tmp_path / "kept.jsonl"
    assert read_answer_file(path) == {}
    replace_records(path, [])
    for key in ("b", "a"):
        append_record(path, {"key": key, "refusal": "Øde mark"})
    assert list(read_answer_file(path)) == ["b", "a"]
    with path.open("a", encoding="utf-8") as file:
        file.write('{"key": "c", "ref')
    assert list(read_answer_file(path)) == ["b", "a"]
    replace_records(path, [{"key": "a"}, {"key": "b"}])
    assert path.read_text(encoding="utf-8") == '{"key": "a"}\n{"key": "b"}\n'


def test_a_file_of_something_else_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "kept.jsonl"
    for text in ("a,b\n1,2\n", "[1]\n", '{"key": 3}\n'):
        path.write_text(text, encoding="utf-8")
        with pytest.raises(HeadlandError, match="not an answer of Headland"):
            read_answer_file(path)
        assert path.read_text(encoding="utf-8") == text


@pytest.fixture
def workers() -> Iterator[object]:
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, protocol="tcp", silence_logs=50
    ) as local:
        yield local


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_a_cluster_gives_the_same_answers_though_a_worker_is_killed(farm: Path, workers: object) -> None:
    asked = list_orders(farm, 3.0, 4.0)
    alone = {index: told(answer) for index, answer in iter_answers(SerialExecutor(), asked)}
    with connect_cluster(workers.scheduler_address) as executor:  # type: ignore[attr-defined]
        found, pids = {}, [nanny.pid for nanny in workers.workers.values()]  # type: ignore[attr-defined]
        for index, answer in iter_answers(executor, asked):
            found[index] = told(answer)
            if pids:
                os.kill(pids.pop(), signal.SIGKILL)
                pids.clear()
    assert found == alone


def test_what_a_farm_carries_and_when_it_works_is_in_the_answer_and_in_its_digest(farm: Path) -> None:
    (order,) = list_orders(farm, 3.0)[:1]
    times = load_example_farm().times
    late = replace(order, times=times)
    assert hash_order(order) != hash_order(late)
    assert hash_order(order) != hash_order(replace(order, simulates_all=True))
    ((_, answer),) = iter_answers(SerialExecutor(), [late])
    assert answer.ranking.best.transport_s is not None
