"""The advice of a refusal is followed, by reading it: then there is a plan, or another refusal, and never the same."""

import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
import shapely

from fields.geometry.field import Field
from fields.geometry.obstacles import Obstacle
from planner.errors import HeadlandError
from planner.evaluation.preparation import prepare_context
from planner.evaluation.work_order import WorkOrder
from planner.request.plan_request import PlanRequest

pytestmark = pytest.mark.usefixtures("first_layout")

STRIP = Field("strip", shapely.box(0, 0, 120, 17))
LANE = Field("lane", shapely.box(0, 0, 150, 7))
SQUARE = Field("square", shapely.box(0, 0, 40, 40))
WEDGE = Field("wedge", shapely.Polygon([(0, 0), (110, 0), (0, 30)]))
POND = Field("pond", shapely.box(0, 0, 60, 60), obstacles=(Obstacle("pond", shapely.Point(30, 30), 18.0),))
TREE = Field("tree", shapely.box(0, 0, 70, 50), obstacles=(Obstacle("tree", shapely.Point(22, 25), 1.0),))
GATE = Field("gate", shapely.box(0, 0, 60, 40), entrance=(0.0, 20.0))
LAID_OUT: list[tuple[Field, dict[str, Any]]] = [
    (STRIP, {"width_m": 24.0, "no_headland": True}),
    (LANE, {"width_m": 9.0}),
    (SQUARE, {"headland_m": 21.0, "no_headland": True}),
    (STRIP, {"headland_m": 9.0, "no_headland": True, "bearing_deg": 0.0}),
    (POND, {"margin_m": 40.0}),
    (TREE, {"margin_m": 60.0}),
    (SQUARE, {"radius_m": 2.0}),
    (SQUARE, {"radius_m": 90.0}),
]
"""Refused while the field is laid out."""

TOO_DEEP: list[tuple[Field, dict[str, Any]]] = [
    (STRIP, {"width_m": 3.0, "headland_passes": 4}),
    (STRIP, {"width_m": 3.0, "headland_m": 20.0}),
    (LANE, {"width_m": 1.5, "headland_passes": 6}),
    (SQUARE, {"width_m": 6.0, "headland_passes": 5}),
    (SQUARE, {"width_m": 3.0, "headland_m": 60.0}),
    (WEDGE, {"headland_passes": 6}),
    (TREE, {"width_m": 24.0, "headland_passes": 2}),
]
"""Asked for more headland than there is room for."""

Change = Callable[..., PlanRequest]


READINGS: list[tuple[str, Change]] = [
    (r"use a headland \(headland_m\) of ([\d.]+) m", lambda request, m: replace(request, headland_m=float(m))),
    (r"use an implement \(width_m\) of ([\d.]+) m or less", lambda request, m: replace(request, width_m=float(m))),
    (r"use a bearing \(bearing_deg\) of (\d+) deg", lambda request, deg: replace(request, bearing_deg=float(deg))),
    (r"use a margin of ([\d.]+) m", lambda request, m: replace(request, margin_m=float(m))),
    (r"radius.* use (?:a smaller one, )?([\d.]+) m or more", lambda request, m: replace(request, radius_m=float(m))),
]
"""How advice reads, and what it does to a request."""


def follow(advice: str, request: PlanRequest) -> PlanRequest:
    """The request as advised; fails for advice that says nothing to do."""
    for pattern, change in READINGS:
        found = re.search(pattern, advice)
        if found:
            return change(request, *found.groups())
    raise AssertionError(f"nothing to do in: {advice}")


def leave_out_numbers(sentence: str) -> str:
    """The sentence as one remembers it: the same refusal of another width is the same."""
    return re.sub(r"[\d.]+", "0", sentence)


def refuse_layout(field: Field, request: PlanRequest) -> str:
    """The sentence of a refusal of the layout; empty where the field is laid out."""
    try:
        prepare_context(WorkOrder(request, field))
    except HeadlandError as refusal:
        return str(refusal)
    return ""


@pytest.mark.parametrize(("field", "options"), LAID_OUT)
def test_advice_of_a_field_that_cannot_be_laid_out(field: Field, options: dict[str, Any]) -> None:
    request = PlanRequest(field=field.name, **{"tractors": (1,), **options})
    refusal = refuse_layout(field, request)
    assert refusal, "this field is laid out: not a case of this test"
    again = refuse_layout(field, follow(refusal, request))
    assert leave_out_numbers(again) != leave_out_numbers(refusal), again


@pytest.mark.parametrize(("field", "options"), TOO_DEEP)
def test_a_headland_is_as_deep_as_there_is_room_for(field: Field, options: dict[str, Any]) -> None:
    layout = prepare_context(WorkOrder(PlanRequest(field=field.name, **{"tractors": (1,), **options}), field)).layout
    room_m = shapely.maximum_inscribed_circle(field.boundary).length
    assert layout.headland_m < room_m + layout.width_m
    assert f"The field has no room for more headland passes than {layout.headland_passes}." in layout.field.remarks
