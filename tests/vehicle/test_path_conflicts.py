"""Where two ways come too near: against outlines drawn as polygons, pose by pose."""

import math
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from vehicle.model.tractor import Implement, load_tractor
from vehicle.sim.clearance import is_beside
from vehicle.sim.compile import build_model_record
from vehicle.sim.path_conflicts import BLOCK_SIZE, PosePath, build_poses, find_conflicting_poses

MODELS = np.array([build_model_record(load_tractor("eg105"), Implement())])
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


def wander(rng: np.random.Generator, count: int) -> PosePath:
    """A way of so many poses, 0.8 m apart, that turns at random in a square of about 40 m."""
    angle = rng.uniform(0.0, math.tau) + np.cumsum(rng.normal(0.0, 0.15, count))
    steps = 0.8 * np.column_stack([np.cos(angle), np.sin(angle)])
    place = rng.uniform(-10.0, 10.0, 2) + np.cumsum(steps, axis=0)
    return PosePath(build_poses(np.column_stack([place, angle])))


@settings(max_examples=12)
@given(st.integers(0, 10_000), st.floats(0.05, 1.0), st.floats(0.01, 0.05))
def test_all_places_and_no_others_are_found(seed: int, clearance_m: float, beside_m: float) -> None:
    rng = np.random.default_rng(seed)
    a, b = wander(rng, 3 * BLOCK_SIZE + 5), wander(rng, 2 * BLOCK_SIZE + 1)
    met = {
        (i, j) for i, first, last in find_conflicting_poses(a, b, MODELS, clearance_m, beside_m).tolist()
        for j in range(first, last + 1)
    }  # fmt: skip
    shapes = [[machine(pose) for pose in each.poses] for each in (a, b)]
    records = [each.poses.view(np.recarray) for each in (a, b)]
    model = MODELS.view(np.recarray)[0]
    for i, one in enumerate(shapes[0]):
        for j, other in enumerate(shapes[1]):
            aligned = is_beside.__wrapped__(records[0][i], model, records[1][j], model)
            limit, distance = beside_m if aligned else clearance_m, one.distance(other)
            if abs(distance - limit) > SURE_M:
                assert ((i, j) in met) == (distance < limit)


def test_rows_are_in_order_and_as_long_as_can_be() -> None:
    rng = np.random.default_rng(4)
    found = find_conflicting_poses(wander(rng, 400), wander(rng, 300), MODELS, 0.8, 0.1)
    assert len(found) > 20 and (found[:, 1] <= found[:, 2]).all()
    assert (np.diff(found[:, 0]) >= 0).all()
    same = found[1:, 0] == found[:-1, 0]
    assert (found[1:, 1][same] > found[:-1, 2][same] + 1).all()


def test_conflicts_are_symmetric() -> None:
    rng = np.random.default_rng(5)
    a, b = wander(rng, 90), wander(rng, 120)

    def pairs(found: Any) -> set[tuple[int, int]]:
        return {(i, j) for i, first, last in found.tolist() for j in range(first, last + 1)}

    forth, back = (
        pairs(find_conflicting_poses(a, b, MODELS, 0.5, 0.1)),
        pairs(find_conflicting_poses(b, a, MODELS, 0.5, 0.1)),
    )
    assert forth and forth == {(i, j) for j, i in back}


def test_more_rows_than_the_first_buffer_holds_are_all_found() -> None:
    still = PosePath(build_poses(np.zeros((40, 3))))
    back_and_forth = np.array([(0.0 if n % 2 else 100.0, 0.0, 0.0) for n in range(80)])
    found = find_conflicting_poses(still, PosePath(build_poses(back_and_forth)), MODELS, 0.5, 0.5)
    assert len(found) == 40 * 40 and set(found[:, 1].tolist()) == set(range(1, 80, 2))


@pytest.mark.parametrize("metres", [60.0, 4000.0])
def test_distant_paths_have_no_conflict(metres: float) -> None:
    way = np.column_stack([np.arange(0.0, 50.0, 0.8), np.zeros(63), np.zeros(63)])
    aside = way + np.array([0.0, metres, 0.0])
    assert len(find_conflicting_poses(PosePath(build_poses(way)), PosePath(build_poses(aside)), MODELS, 0.8, 0.1)) == 0
