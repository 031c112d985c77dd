"""Whether two tractors both get home: ways drawn by hand, on which they are 2 m long and wide."""

from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from strategies.programmes.ways_home import WayBook
from vehicle.missions.plan import Leg, Mission

Place = tuple[float, float]

BESIDE = (0.0, 1.5), (-50.0, 1.5)
"""A track in the other direction beside the one from (-50, 0) to (0, 0)."""


def list_places(path: Any) -> np.ndarray:
    return np.column_stack([path.poses[name] for name in ("x", "y", "angle")])


class NearCheck:
    """One that stands nearer than 2 m to a path bars it."""

    def find_blocked_parts(self, standing: Any, driving: Any) -> np.ndarray:
        places, poses = (list_places(path)[:, :2] for path in (standing, driving))
        gaps_m = np.hypot(*(places[:, None] - poses[None]).transpose(2, 0, 1))
        return np.array([(hold, pose, pose) for hold, pose in np.argwhere(gaps_m < 2.0)], int).reshape(-1, 3)


def draw_way(*places: Place, waits: tuple[int, ...] = ()) -> Any:
    """A way along places; the tractor may wait before the legs with these numbers."""
    legs = [
        Leg(np.array([begin, end]), 2.0, may_wait=number in waits)
        for number, (begin, end) in enumerate(pairwise(places))
    ]
    return WayBook(0.0).build_way(Mission(tuple(legs)))


@pytest.mark.parametrize(
    ("one", "other", "side"),
    [
        (draw_way((-50, 0), (-8, 0), (0, 0), (0, -30), waits=(1,)), draw_way(*BESIDE, (-50, 30)), 0),
        (draw_way((0, -30), (0, 0), (-50, 0)), draw_way((-50, 30), (-50, 1.5), (0, 1.5)), 1),
        (draw_way((-50, 0), (0, 0), (0, -30)), draw_way((0, 30), *BESIDE, (-50, 30)), None),
        (draw_way((-50, 0), (0, 0), (0, -30)), draw_way((0, 9), (-50, 9)), None),
        # One ends in the way of the other, which is done before, or waits aside; where both do, neither place helps.
        (draw_way((-50, 0), (0, 0)), draw_way((0, 30), (0, -30)), None),
        (draw_way((0, -30), (0, -9), (0, 0), waits=(1,)), draw_way((30, 0), (-30, 0), (0, -1), waits=(1,)), 1),
        (draw_way((0, -30), (0, -9), (0, 0), waits=(1,)), draw_way((30, 0), (-30, 0), (-30, 5)), None),
    ],
)  # fmt: skip
def test_where_two_are_stuck(one: Any, other: Any, side: int | None) -> None:
    book = WayBook(0.0)
    assert book.find_stuck_side(one, other, NearCheck()) == side  # type: ignore[arg-type]
    assert book.find_stuck_side(other, one, NearCheck()) == side  # type: ignore[arg-type]


def test_a_way_has_its_holds_and_the_centre_of_mass_behind_the_point() -> None:
    legs = (Leg(np.array([(0.0, 0.0), (8.0, 0.0)]), 2.0), Leg(np.array([(8.0, 0.0), (2.0, 0.0)]), 2.0, gear=-1))
    way = WayBook(1.0).build_way(Mission((legs[0], legs[1].copy_with(may_wait=True))))
    poses = list_places(way.path)
    assert way.holds == (0, 10, len(poses) - 1)
    assert np.array_equal(list_places(way.stands), poses[list(way.holds)])
    assert poses[[0, 9, 10, -1]].tolist() == [[-1.0, 0.0, 0.0], [7.0, 0.0, 0.0], [7.0, 0.0, 0.0], [1.0, 0.0, 0.0]]
