"""Files whose fields share ids or names: every field has a key of its own, and no name means two by chance."""

from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fields import list_fields, read_field
from fields.documents.reader import list_fields_with_notes
from fields.formats.features import build_document
from planner.pipeline.many_fields import expand_field_names
from tests.drawn_fields import feature
from tests.fields.geojson import SQUARE_M, collection, moved, polygon, refusal


def make_features(*names: tuple[Any, Any]) -> list[dict[str, Any]]:
    """Squares side by side, each with an id and a name."""
    return [
        {**feature(polygon(moved(SQUARE_M, 300.0 * place)), name=name), "id": key}
        for place, (key, name) in enumerate(names)
    ]


def list_keys(*names: tuple[Any, Any]) -> list[str]:
    return [one.key for one in build_document(make_features(*names), "plot").polygons]


@pytest.mark.parametrize(("names", "keys"), [
    ([("a", None), ("b", None)], ["a", "b"]),
    ([("a", None), ("a", None), ("a", None)], ["a-1", "a-2", "a-3"]),
    ([("a", "b"), ("b", "c")], ["a", "b-1"]),  # the id of one is the name of another
    ([("a", None), ("a-1", None), ("a", None)], ["a-2", "a-1", "a-3"]),  # a number that would clash itself
    ([("a", None), ("A", None)], ["a", "A"]),
    ([("  ", None), (None, ""), (None, None)], ["0", "1", "2"]),
    ([(None, None), (0, None)], ["0-1", "0"]),  # an id that looks like the position of another
    ([(1, None), (1, None), (None, None)], ["1-1", "1-2", "2"]),
    ([("x\x00", None), ("x\x01", None)], ["x?-1", "x?-2"]),
    ([("*", None), ("b", None)], ["*-1", "b"]),  # the star means all fields
])  # fmt: skip
def test_keys(names: list[tuple[Any, Any]], keys: list[str]) -> None:
    assert list_keys(*names) == keys


words = st.none() | st.sampled_from(["a", "a-1", "a-2", "A", "", " ", "*", "0", "1", "2", "0-1", "a#1", "?", "\x00"])


@given(names=st.lists(st.tuples(words | st.integers(0, 4), words), min_size=1, max_size=8))
def test_a_key_picks_one_field(names: list[tuple[Any, Any]]) -> None:
    keys = list_keys(*names)
    assert len(set(keys)) == len(names)
    owners = [{str(name).strip() for name in pair if name is not None} for pair in names]
    for place, key in enumerate(keys):
        assert not any(key in other for number, other in enumerate(owners) if number != place)


def test_fifteen_features_are_fifteen_fields(saved: Any) -> None:
    """Ten ids for fifteen features, among them numbers that are positions of others."""
    file = saved(collection(*make_features(*[(place % 10, None) for place in range(15)])))
    fields, notes = list_fields_with_notes(file, local=True)
    assert [one.area_ha for one in fields] == [2.0] * 15
    assert notes == (
        "Ids or names that another field of the file has too got a number: '0-1', '1-1', '2-1', '3-1', '4-1', '0-2', "
        "'1-2', '2-2', '3-2', '4-2'.",
    )
    told: list[str] = []
    names = expand_field_names([f"{file}#*"], local=True, show_remarks=told.extend)
    assert len(set(names)) == 15 and tuple(told) == notes
    west = [read_field(name, local=True).boundary.bounds[0] for name in names]
    assert west == [300.0 * place for place in range(15)]
    assert refusal(f"{file}#3", local=True) == "2 fields of 'plot.geojson' are named '3'; choose one of 3-1, 3-2."


def test_parts_of_a_multipolygon_and_names_with_a_hash(saved: Any) -> None:
    parts = [[moved(SQUARE_M, 300.0 * place)] for place in range(2)]
    several = feature({"type": "MultiPolygon", "coordinates": parts}, name="Field #1")
    file: Path = saved(collection(several, feature(polygon(moved(SQUARE_M, 900.0)), name="Field #2")))
    assert [one.key for one in list_fields(file, local=True)] == ["Field #1-1", "Field #1-2", "Field #2"]
    assert read_field(f"{file}#Field #1-2", local=True).boundary.bounds[0] == 300.0
    assert read_field(f"{file}#Field #2", local=True).boundary.bounds[0] == 900.0
