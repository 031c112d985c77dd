"""A disc of other grip is found where it is."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.identification.analytic_drives import circle, course
from tests.identification.residual_models import rig
from vehicle.identification.cause_selection import grip_patches
from vehicle.identification.cause_selection.covariates import PathResponse
from vehicle.identification.cause_selection.grip_patches import find_best_patch
from vehicle.identification.fit.residual_fit import make_empty_fit
from vehicle.identification.residuals.innovations import PoseIncrements
from vehicle.identification.residuals.residual_model import build_residual_model

PLACE, RADIUS = (22.0, 31.0), 9.0


class Plain(PathResponse):
    """Residuals that are the turning itself, row by row: what another grip does is known without a filter."""

    def __init__(self, residual_model: Any, fit: Any) -> None:
        self.residual_model, self.fit = residual_model, fit
        self.increments = [residual_model.move]
        self.places = [slice(0, 3 * residual_model.dataset.segments[0].rows)]
        self.inverse, self.side = np.zeros((0, 0)), np.zeros(0)

    def compute_turn_responses(self, index: int, turns: np.ndarray, first: int = 0) -> np.ndarray:
        made = np.zeros((turns.shape[1] + 1, 3, len(turns)))
        made[:-1, 0] = turns.T
        return made.reshape(-1, len(turns))


def field_of_bends(grip: float, angle_deg: float = 9.0) -> tuple[Any, Any]:
    """Bends up and down a field of 60 m, with wheels at an angle; inside the disc the tractor turns by `grip` more than
    simulated."""
    east, north = (axis.ravel() for axis in np.meshgrid(np.arange(0.0, 60.0, 1.0), np.arange(0.0, 60.0, 1.0)))
    turned = 0.05 * np.sin(0.37 * np.arange(len(east) - 1))
    wheel = np.full(len(east), math.radians(angle_deg))
    segment = SimpleNamespace(east=east, north=north, rows=len(east), time=0.1 * np.arange(len(east)), wheel=wheel)
    dataset = SimpleNamespace(segments=(segment,), origin=(1000.0, 2000.0))
    move = PoseIncrements(np.ones_like(turned), np.zeros_like(turned), turned)
    inside = np.hypot(east[:-1] - PLACE[0], north[:-1] - PLACE[1]) < RADIUS
    residuals = np.zeros((len(east), 3))
    residuals[:-1, 0] = grip * turned * inside
    fit = SimpleNamespace(residuals=residuals.ravel(), jacobian=np.zeros((3 * len(east), 0)))
    return SimpleNamespace(dataset=dataset, move=move), fit


@pytest.fixture(autouse=True)
def plain_response(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(grip_patches, "PathResponse", Plain)


def test_a_disc_of_other_grip_is_found_in_the_frame_of_the_logs() -> None:
    patch = find_best_patch(*field_of_bends(0.3))
    assert patch is not None
    assert math.hypot(patch[0] - 1000.0 - PLACE[0], patch[1] - 2000.0 - PLACE[1]) < 1.0
    assert patch[2] == pytest.approx(RADIUS, abs=1.0)


def test_rows_that_only_keep_a_line_show_no_grip() -> None:
    assert find_best_patch(*field_of_bends(0.3, angle_deg=2.0)) is None


def test_the_gain_of_the_disc_is_all_that_is_left() -> None:
    residual_model, fit = field_of_bends(0.3)
    response = Plain(residual_model, fit)
    loss = float(fit.residuals @ fit.residuals)
    # A disc twice as wide turns four times as much, of which a quarter is wrong.
    same, wide = grip_patches._compute_patch_gains(response, [(*PLACE, RADIUS), (*PLACE, 2.0 * RADIUS)])
    assert same == pytest.approx(loss) and wide == pytest.approx(0.25 * loss, rel=0.1)
    assert grip_patches._compute_patch_gains(response, [(-99.0, 0.0, 1.0)]) == [0.0], "nobody drove there"


def test_a_long_segment_in_pieces_says_what_it_says_as_a_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    """With the filter of the paths, which forgets a turn well within what is followed before a piece."""
    frame = circle(0.05, 400.0).assign(steering_deg=8.0)
    shaken = frame.assign(northing_m=frame.northing_m + 0.05 * np.sin(0.2 * frame.time_s))
    residual_model = build_residual_model(course(shaken), rig(), {})
    response = PathResponse(residual_model, make_empty_fit(residual_model))
    segment = residual_model.dataset.segments[0]
    place = (float(segment.east.max()), float(segment.north.mean()), 8.0)
    told = []
    for length in (1e9, 60.0):
        monkeypatch.setattr(grip_patches, "PATCH_PIECE_S", length)
        pieces, cells = list(grip_patches._split_pieces((segment,))), grip_patches._GripCells(response)
        assert [piece.begin for piece in pieces[1:]] == [piece.end for piece in pieces[:-1]]
        assert (pieces[0].begin, pieces[-1].end) == (0, segment.rows) and len(pieces) == max(round(400.0 / length), 1)
        told.append((grip_patches._compute_patch_gains(response, [place])[0], cells.side, cells.square, cells.turned))
    whole, cut = told
    assert cut[0] == pytest.approx(whole[0], rel=0.01) and whole[0] > 1.0
    for one, other in zip(whole[1:], cut[1:], strict=True):
        assert np.abs(other - one).max() < 0.01 * np.abs(one).max()


def test_the_same_everywhere_is_nowhere_in_particular() -> None:
    residual_model, fit = field_of_bends(0.0)
    assert find_best_patch(residual_model, fit) is None


def test_a_circle_is_the_sum_over_its_cells() -> None:
    rng = np.random.default_rng(6)
    east, north, side, turned = rng.uniform(0.0, 9.0, (4, 25))
    square = rng.standard_normal((25, 25))
    away = np.hypot(east - east[:, None], north - north[:, None])
    squares, sides, turns = np.zeros((3, 25))
    grip_patches._sum_cells_inside_radius(away, 3.0, square, side, turned, squares, sides, turns)
    for place, near in enumerate((away < 3.0).astype(float)):
        slow = near @ square @ near, near @ side, near @ turned
        assert (squares[place], sides[place], turns[place]) == pytest.approx(slow)


def test_circles_are_sought_where_enough_is_turned_and_not_nearly_all() -> None:
    """The best cell of every size that may be the middle, told the slow way."""
    rng = np.random.default_rng(7)
    cells = object.__new__(grip_patches._GripCells)
    cells.size, (cells.east, cells.north) = 1.0, rng.uniform(0.0, 9.0, (2, 60))
    cells.side, cells.turned = rng.standard_normal(60), rng.uniform(0.0, 0.2, 60) ** 2
    cells.turned[:5] = 0.3
    half = rng.standard_normal((60, 60))
    cells.square = half @ half.T
    slow, passed = [], 0
    for radius in cells.size * np.array(grip_patches.RADII_CELLS):
        best = (0.0, (0.0, 0.0, 0.0))
        for e, n in zip(cells.east, cells.north, strict=True):
            near = (np.hypot(cells.east - e, cells.north - n) < radius).astype(float)
            gain = float(near @ cells.side) ** 2 / float(near @ cells.square @ near)
            if (
                grip_patches.FEWEST_TURNED_RAD
                < near @ cells.turned
                < grip_patches.MOST_TURNING_SHARE * cells.turned.sum()
            ):
                best = max(best, (gain, (e, n, radius)))
            else:
                passed += gain > best[0]
        slow.append(best)
    assert passed, "some would be better"
    for one, other in zip(
        cells.find_best_circles(), sorted(slow, reverse=True)[: grip_patches.MOST_POLISHED], strict=True
    ):
        assert one[0] == pytest.approx(other[0]) and one[1] == pytest.approx(other[1])
