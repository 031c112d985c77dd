"""A disc of other grip is found where it is."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from vehicle.measured.causes import patches
from vehicle.measured.causes.dependence import Response
from vehicle.measured.causes.patches import best_patch
from vehicle.measured.surprise.whitening import Increments

PLACE, RADIUS = (22.0, 31.0), 9.0


class Plain(Response):
    """Surprises that are the turning itself, row by row: what another grip does is known without a filter."""

    def __init__(self, bench: Any, fit: Any) -> None:
        self.bench, self.fit = bench, fit
        self.moves = [bench.move]
        self.places = [slice(0, len(bench.move.turned))]
        self.inverse, self.side = np.zeros((0, 0)), np.zeros(0)

    def turned(self, index: int, turns: np.ndarray) -> np.ndarray:
        return turns.T


def field_of_bends(grip: float) -> tuple[Any, Any]:
    """Bends up and down a field of 60 m; inside the disc the tractor turns by `grip` more than simulated."""
    east, north = (axis.ravel() for axis in np.meshgrid(np.arange(0.0, 60.0, 1.0), np.arange(0.0, 60.0, 1.0)))
    turned = 0.05 * np.sin(0.37 * np.arange(len(east) - 1))
    stretch = SimpleNamespace(east=east, north=north, rows=len(east))
    course = SimpleNamespace(stretches=(stretch,), origin=(1000.0, 2000.0))
    move = Increments(np.ones_like(turned), np.zeros_like(turned), turned)
    inside = np.hypot(east[:-1] - PLACE[0], north[:-1] - PLACE[1]) < RADIUS
    fit = SimpleNamespace(surprise=grip * turned * inside, slope=np.zeros((len(turned), 0)))
    return SimpleNamespace(course=course, move=move), fit


@pytest.fixture(autouse=True)
def plain_response(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(patches, "Response", Plain)


def test_a_disc_of_other_grip_is_found_in_the_frame_of_the_logs() -> None:
    patch = best_patch(*field_of_bends(0.3))
    assert patch is not None
    assert math.hypot(patch[0] - 1000.0 - PLACE[0], patch[1] - 2000.0 - PLACE[1]) < 1.0
    assert patch[2] == pytest.approx(RADIUS, abs=1.0)


def test_the_gain_of_the_disc_is_all_that_is_left() -> None:
    bench, fit = field_of_bends(0.3)
    response = Plain(bench, fit)
    loss = float(fit.surprise @ fit.surprise)
    assert patches._gain(response, (*PLACE, RADIUS)) == pytest.approx(loss)
    # A disc twice as wide turns four times as much, of which a quarter is wrong.
    assert patches._gain(response, (*PLACE, 2.0 * RADIUS)) == pytest.approx(0.25 * loss, rel=0.1)


def test_the_same_everywhere_is_nowhere_in_particular() -> None:
    bench, fit = field_of_bends(0.0)
    assert best_patch(bench, fit) is None
