"""Where two ways come too near: against outlines drawn as polygons, pose by pose."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from vehicle.clearance import beside
from vehicle.compile import compile_model
from vehicle.meetings import BLOCK, Trail, meetings, poses_of
from vehicle.tractor import Implement, load_tractor

MODELS = np.array([compile_model(load_tractor("eg105"), Implement())])
SURE_M = 1e-6  # nearer to a limit than this, two ways of calculating may differ


def machine(pose: Any) -> shapely.Geometry:
    """Tractor and implement of a pose as polygons."""
    model = MODELS[0]
    boxes = [
        shapely.box(model["tail"], -model["half_width"], model["nose"], model["half_width"]),
        shapely.box(model["tool_tail"], -model["tool_half_width"], model["tool_front"], model["tool_half_width"]),
    ]
    turned = shapely.affinity.rotate(shapely.MultiPolygon(boxes), pose["angle"], origin=(0, 0), use_radians=True)
    return shapely.affinity.translate(turned, pose["x"], pose["y"])


def wander(rng: np.random.Generator, count: int) -> Trail:
    """A way of so many poses, 0.8 m apart, that turns at random in a square of about 40 m."""
    angle = rng.uniform(0.0, math.tau) + np.cumsum(rng.normal(0.0, 0.15, count))
    steps = 0.8 * np.column_stack([np.cos(angle), np.sin(angle)])
    place = rng.uniform(-10.0, 10.0, 2) + np.cumsum(steps, axis=0)
    return Trail(poses_of(np.column_stack([place, angle])))


@settings(max_examples=12, deadline=None)
@given(st.integers(0, 10_000), st.floats(0.05, 1.0), st.floats(0.01, 0.05))
def test_all_places_and_no_others_are_found(seed: int, clearance_m: float, beside_m: float) -> None:
    rng = np.random.default_rng(seed)
    a, b = wander(rng, 3 * BLOCK + 5), wander(rng, 2 * BLOCK + 1)
    met = {
        (i, j) for i, first, last in meetings(a, b, MODELS, clearance_m, beside_m).tolist()
        for j in range(first, last + 1)
    }  # fmt: skip
    shapes = [[machine(pose) for pose in each.poses] for each in (a, b)]
    records = [each.poses.view(np.recarray) for each in (a, b)]
    model = MODELS.view(np.recarray)[0]
    for i, one in enumerate(shapes[0]):
        for j, other in enumerate(shapes[1]):
            aligned = beside.__wrapped__(records[0][i], model, records[1][j], model)
            limit, distance = beside_m if aligned else clearance_m, one.distance(other)
            if abs(distance - limit) > SURE_M:
                assert ((i, j) in met) == (distance < limit)


def test_rows_are_in_order_and_as_long_as_can_be() -> None:
    rng = np.random.default_rng(4)
    found = meetings(wander(rng, 400), wander(rng, 300), MODELS, 0.8, 0.1)
    assert len(found) > 20 and (found[:, 1] <= found[:, 2]).all()
    assert (np.diff(found[:, 0]) >= 0).all()
    same = found[1:, 0] == found[:-1, 0]
    assert (found[1:, 1][same] > found[:-1, 2][same] + 1).all()


def test_who_meets_whom_does_not_depend_on_who_is_asked_first() -> None:
    rng = np.random.default_rng(5)
    a, b = wander(rng, 90), wander(rng, 120)

    def pairs(found: Any) -> set[tuple[int, int]]:
        return {(i, j) for i, first, last in found.tolist() for j in range(first, last + 1)}

    forth, back = pairs(meetings(a, b, MODELS, 0.5, 0.1)), pairs(meetings(b, a, MODELS, 0.5, 0.1))
    assert forth and forth == {(i, j) for j, i in back}


def test_more_rows_than_there_is_room_for_at_first_are_all_found() -> None:
    still = Trail(poses_of(np.zeros((40, 3))))
    back_and_forth = np.array([(0.0 if n % 2 else 100.0, 0.0, 0.0) for n in range(80)])
    found = meetings(still, Trail(poses_of(back_and_forth)), MODELS, 0.5, 0.5)
    assert len(found) == 40 * 40 and set(found[:, 1].tolist()) == set(range(1, 80, 2))


@pytest.mark.parametrize("metres", [60.0, 4000.0])
def test_ways_far_apart_meet_nowhere(metres: float) -> None:
    way = np.column_stack([np.arange(0.0, 50.0, 0.8), np.zeros(63), np.zeros(63)])
    aside = way + np.array([0.0, metres, 0.0])
    assert len(meetings(Trail(poses_of(way)), Trail(poses_of(aside)), MODELS, 0.8, 0.1)) == 0
