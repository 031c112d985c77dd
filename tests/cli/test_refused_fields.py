"""Field files that cannot be planned: one clear sentence, exit status 2, and nothing touched."""

import json
import re
from pathlib import Path
from typing import Any

import pytest
import shapely

from fields import Field
from fields.geometry.obstacles import Obstacle
from planner.errors import RequestError
from planner.evaluation.preparation import prepare_context
from planner.evaluation.work_order import WorkOrder
from planner.pipeline.ranking import check_margin
from planner.request.plan_request import PlanRequest
from tests.cli.conftest import Run
from tests.cli.refusals import SQUARE, assert_refused
from tests.drawn_fields import feature, line, point, rectangle, ring, write_features

pytestmark = pytest.mark.usefixtures("first_layout")

FIELD_FILES = [
    ("text", "is not JSON"), ("bow", "crosses itself"), ("flat", "'flat.geojson'"),
    ("degrees", "look like degrees; leave out --local"), ("narrow", "working width of 3 m"),
    ("several", "holds 2 fields; choose one"), ("ground", "'lava'"), ("missing", "no field file"),
]  # fmt: skip
OBSTACLES: list[tuple[list[Any], tuple[str, ...]]] = [
    ([feature(ring((-1, -1), (101, -1), (101, 61), (-1, 61)), role="obstacle")], ("(--margin) of 0.3 m", "leave 0 m2")),
    ([feature(point(50, 30), role="obstacle", kind="cow")], ("'cow'", "'radius_m'")),
    ([feature(line((0, 0), (100, 0)), edge="wall")], ("'edge' of a line", "'wall'", "use 'fence' or 'open'")),
    ([feature(line((0, 0), (100, 0)), edge=3)], ("'edge' of a line", "is 3", "use 'fence' or 'open'")),
    ([feature(line((20, 30), (80, 30)), edge="fence")], ("does not follow the boundary", "20.0 m away")),
    ([feature(line((20, 5), (80, 5)), edge="open", id="gap")], ("line 'gap' with edge 'open'", "5.0 m away")),
    (
        [feature(point(350, 30), role="obstacle", kind="pole", id="mast")],
        ("Obstacle 'mast' (pole)", "lies outside the field, 250 m away", "check the coordinates"),
    ),
    ([feature(line((5, 5)), edge="fence")], ("fewer than 2 distinct positions",)),
    ([feature(line((0, 0), (0, "x")), edge="fence")], ("is not a number",)),
]


@pytest.mark.parametrize("command", ["plan", "field"])
@pytest.mark.parametrize(("name", "words"), FIELD_FILES)
def test_field_files(headland: Run, folder: Path, command: str, name: str, words: str) -> None:
    assert_refused(headland(command, f"{name}.geojson", "--local"), words)


@pytest.mark.parametrize("command", ["plan", "field"])
@pytest.mark.parametrize(("features", "words"), OBSTACLES)
def test_obstacles_and_edges(
    headland: Run, folder: Path, command: str, features: list[Any], words: tuple[str, ...]
) -> None:
    assert_refused(_with(headland, folder, command, [feature(SQUARE), *features]), *words)


def _with(headland: Run, folder: Path, command: str, features: list[Any], *options: str) -> Any:
    """What a command says to a file of these features, which is gone afterwards."""
    place = write_features(folder / "features.geojson", *features)
    try:
        return headland(command, place.name, "--local", *options)
    finally:
        place.unlink()


@pytest.mark.parametrize("command", ["plan", "field"])
def test_fences_and_margins(headland: Run, folder: Path, command: str) -> None:
    closed = [feature(SQUARE, edge="fence", name="pen")]
    assert_refused(_with(headland, folder, command, closed), "fence round field 'pen' has no opening", "'entrance'")
    gap = feature(line((40, 0), (42, 0)), edge="open")
    assert_refused(_with(headland, folder, command, [*closed, gap]), "no opening", "3 m or more")
    hedge = [feature(SQUARE, edge="hedge")]
    assert_refused(_with(headland, folder, command, hedge), "'edge' of the boundary", "'hedge'")
    gate = feature(point(50, 0), role="entrance")
    margin = ("--margin", "40")
    assert_refused(
        _with(headland, folder, command, [*closed, gate], *margin), "fences", "--margin) of 40 m", "margin of 20 m"
    )
    assert_refused(_with(headland, folder, command, [feature(SQUARE)], "--margin", "60"), "60 m", "60 m across")
    pole = feature(point(50, 30), role="obstacle", kind="pole")
    told = _with(headland, folder, command, [feature(SQUARE, name="plot"), pole], "--margin", "45")
    assert_refused(told, "--margin) of 45 m is too wide for field 'plot'", "leaves 50", "of 6000 m2")


@pytest.mark.slow
def test_a_margin_that_leaves_hardly_any_room_is_told(headland: Run, folder: Path) -> None:
    """A pole in the middle of 60 m with a margin of 29 m leaves a neck of 0.75 m on either side of it."""
    pole = feature(point(50, 30), role="obstacle", kind="pole")
    options = ("--margin", "29", "--tractors", "1", "--strategies", "split-field", "--no-headland", "--explain")
    outcome = _with(headland, folder, "plan", [feature(SQUARE), pole], *options)
    told = " ".join(outcome.out.split())
    assert outcome.status == 3 and "of work are left" in told
    assert "out of reach of this machine, or not worth the drive" in told
    assert re.search(r"No recommendation: only \d+\.\d % of .* is worked; 49 % is margin of 29 m to obstacles\.", told)


def test_a_margin_is_to_blame_where_no_plan_works() -> None:
    """The same pole and margin: 55 % of the field is left, too much to refuse a plan but enough to explain none."""
    field = Field("plot", shapely.box(0, 0, 100, 60), obstacles=(Obstacle("pole", shapely.Point(50, 30), 0.25),))
    context = prepare_context(WorkOrder(PlanRequest(field="plot", margin_m=29.0, no_headland=True), field))
    check_margin(context, feasible=True)
    with pytest.raises(RequestError, match=r"margin_m\) of 29 m leaves 5\d %.*no plan works there.*smaller margin"):
        check_margin(context, feasible=False)


@pytest.mark.slow
def test_a_margin_that_takes_much_of_the_field_is_told(headland: Run, folder: Path) -> None:
    """A pole at the end of 100 m x 60 m with a margin of 40 m."""
    pole = feature(point(0, 30), role="obstacle", kind="pole")
    options = ("--tractors", "1", "--strategies", "split-field", "--no-headland", "--processes", "1")
    told = _with(headland, folder, "plan", [feature(SQUARE), pole], "--margin", "40", *options)
    assert told.status == 3 and "44 % is margin of 40 m" in " ".join(told.out.split())


def test_what_is_not_used_is_named_and_what_is_fenced_is_told(headland: Run, folder: Path) -> None:
    features = [
        feature(SQUARE), feature(line((0, 0), (100, 0)), edge="fence"), feature(line((3, 3), (9, 9)), role="drain"),
        feature(point(5, 5)),
        feature(line((100, 0), (100, 30), (160, 30)), edge="fence"),
    ]  # fmt: skip
    outcome = _with(headland, folder, "field", features, "--json")
    assert outcome.status == 0
    assert json.loads(outcome.out)["fence_m"] == pytest.approx(130, abs=7), "it bends off gradually"
    told = " ".join(outcome.err.split())
    assert "1 LineString with role 'drain'." in told and "(1) point, radius 1 m" in told
    assert "of 90 m of a line with edge 'fence'" in told and "the rest is not used" in told


def test_obstacles_off_the_field_are_named(headland: Run, folder: Path) -> None:
    def pole(x: float, **more: Any) -> Any:
        return feature(point(x, 30), role="obstacle", kind="pole", **more)

    outcome = _with(headland, folder, "field", [feature(SQUARE), pole(50), pole(400, id="mast"), pole(105)], "--json")
    assert outcome.status == 0 and len(json.loads(outcome.out)["obstacles"]) == 2
    told = " ".join(outcome.err.split())
    assert "Obstacle 'mast' (pole), 300 m away, lies outside the field and is skipped." in told
    assert "An obstacle (pole) stands beside the field, not in it" in told
    several = [feature(SQUARE, id="a"), feature(rectangle(500, 0, 100, 60), id="b"), pole(550)]
    place = write_features(folder / "many.geojson", *several)
    try:
        told = headland("field", "many.geojson#a", "--local").err
    finally:
        place.unlink()
    assert "1 obstacle of 'many.geojson' is away from this field and is skipped." in " ".join(told.split())


@pytest.mark.parametrize("command", ["plan", "field"])
def test_metres_passed_as_degrees(headland: Run, folder: Path, command: str) -> None:
    assert_refused(headland(command, "good.geojson"), "add --local")


def test_a_folder_is_no_field(headland: Run, folder: Path) -> None:
    assert_refused(headland("plan", "inner"), "'inner' is a folder")


def test_a_sample_misspelt_names_the_nearest(headland: Run, folder: Path) -> None:
    assert_refused(headland("plan", "iwamisawa"), "did you mean 'iwamizawa'?", "a sample: denmark, iwamizawa")


def test_a_part_that_is_not_there_lists_those_that_are(headland: Run, folder: Path) -> None:
    assert_refused(headland("plan", "several.geojson#7", "--local"), "'7'", "0.60 ha")
