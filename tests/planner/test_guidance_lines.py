"""The guidance of a saved plan: lines made by hand, found again in longitude and latitude."""

import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from fields.errors import HeadlandError
from planner.pipeline.outputs.guidance_lines import build_guidance
from tests.planner.saved_plans import BEND, GROUND, HOLE, SQUARE, in_metres, leg, saved
from vehicle.missions.plan import Mission, Plan
from vehicle.missions.plan_file import format_plan, parse_saved_plan

GARBLED: list[dict[str, Any]] = [
    {**GROUND, "boundary_m": [[[0, 0], [1, 1]]]},
    {**GROUND, "boundary_m": "none"},
    {**GROUND, "boundary_m": [[[0, 0], [1, None], [2, 2]]]},
    {**GROUND, "entrance_m": ["here", 1]},
    {**GROUND, "obstacles": [1]},
    {"name": "x"},
]


def test_lines_stand_in_driving_order_with_names_of_their_own() -> None:
    told = build_guidance(saved())
    assert [line.name for line in told.lines] == [
        "T1 01 round 1 side 1", "T1 02 track 1", "T2 01 track 2a", "T2 02 track 2b",
    ]  # fmt: skip
    assert [(line.tractor, line.order, line.kind, line.is_straight) for line in told.lines] == [
        (1, 1, "round", False), (1, 2, "track", True), (2, 1, "track", True), (2, 2, "track", True),
    ]  # fmt: skip


def test_lines_are_where_they_are_driven() -> None:
    one = saved()
    bend, first, *_ = build_guidance(one).lines
    assert np.abs(in_metres(one, bend.points) - BEND).max() < 1e-6
    assert np.abs(in_metres(one, first.points) - [[97.0, 9.0], [7.0, 9.004]]).max() < 1e-6  # two legs, one line
    assert first.length_m == pytest.approx(90.0, abs=1e-3)


def test_a_bearing_is_from_true_north() -> None:
    """Grid north of UTM is off by the convergence, by hand atan(tan(9.94 - 9 deg) sin 56.97 deg)."""
    off_deg = math.degrees(math.atan(math.tan(math.radians(0.94)) * math.sin(math.radians(56.97))))
    westwards = build_guidance(saved()).lines[1]
    grid_deg = 270.0 + math.degrees(math.atan2(0.004, 90.0))
    assert westwards.bearing_deg == pytest.approx(grid_deg + off_deg, abs=2e-3)


@pytest.mark.parametrize(("off_m", "straight"), [(0.009, True), (0.012, False)])
def test_a_line_is_straight_to_a_centimetre(off_m: float, straight: bool) -> None:
    bent = leg("track", 0, 0, [0.0, 0.0], [40.0, off_m], [80.0, 0.0])
    (line,) = build_guidance(replace(saved(), plan=Plan((Mission((bent,)),)))).lines
    assert (line.is_straight, len(line.points)) == (straight, 2 if straight else 3)


def test_the_field_comes_along() -> None:
    one = saved()
    told = build_guidance(one)
    assert told.field == "Søndre Mark"
    for ring, meant in zip(told.boundary.rings, (SQUARE, HOLE), strict=True):
        assert np.abs(in_metres(one, ring) - meant).max() < 1e-6
    assert told.area_m2 == pytest.approx(100 * 60 - 15 * 10)
    assert len(told.headland_interior[0].rings) == 2 and told.obstacles[0].name == "pond"
    assert told.entrance is not None
    assert np.abs(in_metres(one, np.array([told.entrance])) - [[0.0, 30.0]]).max() < 1e-6


def test_what_is_no_line_is_counted() -> None:
    assert build_guidance(saved()).left_out == (("orders to give way", 1), ("turns", 2), ("ways in and out", 1))
    assert build_guidance(saved(), 2).left_out == (("turns", 1), ("ways in and out", 1))


def test_one_tractor_keeps_its_names() -> None:
    told = build_guidance(saved(), 2)
    assert told.has_other_tractors and [line.name for line in told.lines] == ["T2 01 track 2a", "T2 02 track 2b"]


def test_a_plan_keeps_the_outlines_of_its_field() -> None:
    one = saved()
    text = format_plan(one.plan, crs=one.crs, origin_m=one.origin_m, scenario=one.scenario, ground=one.ground)
    again = parse_saved_plan(text)
    assert again.ground == json.loads(json.dumps(GROUND)) and again.crs == one.crs
    assert "ground" not in json.loads(format_plan(one.plan))
    assert parse_saved_plan(format_plan(one.plan)).ground == {}


def test_a_plan_without_its_field_has_lines_alone() -> None:
    told = build_guidance(replace(saved(), ground={}))
    assert told.boundary is None and told.field == "field.geojson" and len(told.lines) == 4


@pytest.mark.parametrize("ground", GARBLED)
def test_garbled_outlines_are_refused(ground: dict[str, Any]) -> None:
    with pytest.raises(
        HeadlandError, match=r"^The outlines of the field in the plan are garbled; save the plan again\.$"
    ):
        build_guidance(replace(saved(), ground=ground))


@pytest.mark.parametrize(
    ("one", "words"),
    [
        (replace(saved(), crs=None), "is in local metres, and guidance needs longitude and latitude"),
        (replace(saved(), crs="EPSG:4326"), "outside the earth"),
        (replace(saved(), crs="EPSG:nonsense"), "EPSG:nonsense"),
        (replace(saved(), origin_m=(1e12, 1e12)), "cannot be converted|outside the earth"),
    ],
)
def test_a_plan_without_a_place_on_the_earth_is_refused(one: Any, words: str) -> None:
    with pytest.raises(HeadlandError, match=words):
        build_guidance(one)


@pytest.mark.parametrize("tractor", [0, 3, -1])
def test_a_tractor_that_is_not_there_is_refused(tractor: int) -> None:
    with pytest.raises(HeadlandError, match="the plan has tractors 1 to 2"):
        build_guidance(saved(), tractor)
