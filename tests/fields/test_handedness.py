"""The hand of an outline: mirrored it is the other one, moved it stays."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fields.layout.bearings import choose_longer_reach_direction, find_handedness

L = np.array([(0, 0), (160, 0), (160, 45), (50, 45), (50, 150), (0, 150)], dtype=float)
SLANTED = np.array([(0, 0), (150, 0), (190, 70), (40, 70)], dtype=float)
TRIANGLE = np.array([(0, 0), (180, 20), (60, 130)], dtype=float)
MIRROR = np.array([1.0, -1.0])


@pytest.mark.parametrize("outline", [L, SLANTED, TRIANGLE], ids=["L", "slanted", "triangle"])
@given(angle=st.floats(0.0, 2 * math.pi), east=st.floats(-500, 500), first=st.integers(0, 5), closed=st.booleans())
def test_moved_it_stays_and_mirrored_it_changes(
    outline: np.ndarray, angle: float, east: float, first: int, closed: bool
) -> None:
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    moved = np.roll(outline, first, axis=0) @ turn.T + (east, 3.0)
    if closed:
        moved = np.concatenate([moved, moved[:1]])
    assert find_handedness([moved]) == find_handedness([outline]) == -find_handedness([moved * MIRROR])
    assert find_handedness([moved[::-1]]) == find_handedness([moved])


@pytest.mark.parametrize("outline", [L, TRIANGLE], ids=["L", "triangle"])
@given(angle=st.floats(0.0, 2 * math.pi), along=st.floats(-math.pi, math.pi), east=st.floats(-500, 500))
def test_a_line_points_the_same_way_on_a_field_that_is_moved(
    outline: np.ndarray, angle: float, along: float, east: float
) -> None:
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    points = choose_longer_reach_direction(along, [outline])
    assert math.remainder(points - along, math.pi) == pytest.approx(0.0, abs=1e-9)
    for given_rad in (along + angle, along + angle + math.pi):
        moved = choose_longer_reach_direction(math.remainder(given_rad, 2 * math.pi), [outline @ turn.T + (east, 3.0)])
        assert math.remainder(moved - points - angle, 2 * math.pi) == pytest.approx(0.0, abs=1e-6)
    mirrored = choose_longer_reach_direction(-along, [outline * MIRROR])
    assert math.remainder(mirrored + points, 2 * math.pi) == pytest.approx(0.0, abs=1e-6)


def test_a_line_points_where_the_outline_reaches_farther() -> None:
    wedge = np.array([(0, -20), (100, -2), (100, 2), (0, 20)], dtype=float)
    assert choose_longer_reach_direction(0.0, [wedge]) == choose_longer_reach_direction(math.pi, [wedge]) == 0.0
    rectangle = np.array([(0, 0), (200, 0), (200, 80), (0, 80)], dtype=float)
    assert (choose_longer_reach_direction(0.5, [rectangle]), choose_longer_reach_direction(-0.5, [rectangle])) == (
        0.5,
        -0.5,
    )


@pytest.mark.parametrize("outline", [[(0, 0), (200, 0), (200, 80), (0, 80)], [(0, 0), (100, 0), (50, 170)]])
def test_what_is_symmetric_has_none(outline: list[tuple[float, float]]) -> None:
    ring = np.array(outline, dtype=float)
    assert find_handedness([ring]) == find_handedness([ring * MIRROR]) == 1


def test_a_hole_or_an_entrance_gives_a_rectangle_a_hand() -> None:
    ring = np.array([(0, 0), (200, 0), (200, 80), (0, 80)], dtype=float)
    hole = np.array([(98, 35), (104, 35), (104, 37)], dtype=float)
    assert find_handedness([ring, hole]) == -find_handedness([ring * MIRROR, hole * MIRROR])
    assert find_handedness([ring], [(0.0, 0.0)]) == -find_handedness([ring], [(0.0, 80.0)])
