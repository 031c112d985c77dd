"""Programmes of the third reference by name: those of tests.truth.drives, and what else people drive."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tests.truth.drives import (
    ROAD_MPS,
    Drive,
    Signal,
    chirp,
    constant,
    default_programme,
    drive,
    stairs,
    three_speeds_programme,
)

SECONDS = 56.0


def draw_stairs(seed: int, most: float, shortest_s: float, longest_s: float) -> Signal:
    """Angles up to `most` held for times within bounds; the same for the same seed."""
    rng = np.random.default_rng([seed, 5])
    treads = [(rng.uniform(shortest_s, longest_s), most * rng.uniform(-1.0, 1.0)) for _ in range(60)]
    return stairs(*treads)


def mixed_programme() -> list[Drive]:
    """Eight runs of 56 s: straight there and back, random steps small and large, a chirp, circles, implement, lines."""
    paces = stairs((14.0, 1.0), (14.0, 2.0), (14.0, 1.4), (14.0, 2.4))
    down = stairs((12.0, 1.0), (12.0, 0.0), (16.0, 1.0), (16.0, 0.0))
    circles = stairs((12.0, 10.0), (16.0, 22.0), (12.0, -12.0), (16.0, -24.0))
    return [
        drive("out", SECONDS, constant(0.0), stairs((28.0, 1.4), (28.0, 2.2)), 0.0, bearing_deg=20.0),
        drive("home", SECONDS, constant(0.0), stairs((28.0, 1.4), (28.0, 2.2)), 1.0, bearing_deg=200.0),
        drive("random_large", SECONDS, draw_stairs(1, 20.0, 2.0, 6.0), 1.4),
        drive("random_small", SECONDS, draw_stairs(2, 2.5, 1.5, 4.0), paces),
        drive("chirp", SECONDS, chirp(7.0, 0.04, 0.5, SECONDS), 1.6),
        drive("circles", SECONDS, circles, stairs((20.0, 1.2), (18.0, 2.4), (18.0, 1.8))),
        drive("implement", SECONDS, draw_stairs(3, 8.0, 5.0, 9.0), 1.6, down),
        lay_lines("lines", 110.0, 1.6, 0.0),
    ]


def lay_lines(name: str, bearing_deg: float, speed: float, implement: float) -> Drive:
    """Closed loop along a line that jumps sideways now and then."""
    lines = stairs((12.0, 0.5), (14.0, -0.8), (14.0, 0.9), (16.0, 0.0))
    return drive(name, SECONDS, lines, speed, implement, 1.0, bearing_deg, closed_loop=True)


def sway_lines(name: str, bearing_deg: float, speed: float, implement: float) -> Drive:
    """Closed loop along a line that sways as a contour does."""
    return drive(
        name, SECONDS, lambda time: 1.2 * np.sin(time / 5.0) + 0.6 * np.sin(time / 2.3), speed, implement, 1.0,
        bearing_deg, closed_loop=True,
    )  # fmt: skip


def closed_programme() -> list[Drive]:
    """Eight closed-loop runs in six directions at three speeds, half of them with the implement working."""
    return [
        lay_lines("north", 0.0, 1.4, 0.0),
        lay_lines("south", 180.0, 1.4, 1.0),
        lay_lines("east", 90.0, 2.2, 1.0),
        lay_lines("west", 270.0, 2.2, 0.0),
        sway_lines("contour_up", 45.0, 1.0, 0.0),
        sway_lines("contour_down", 225.0, 1.8, 1.0),
        sway_lines("contour_north", 0.0, 1.8, 0.0),
        sway_lines("contour_west", 270.0, 1.4, 1.0),
    ]


def one_sided_programme() -> list[Drive]:
    """Six runs of circles to the right only, at two speeds."""
    sizes = ((6.0, 14.0), (9.0, 20.0), (12.0, 25.0), (5.0, 10.0), (16.0, 22.0), (8.0, 28.0))
    return [
        drive(f"right_{index}", SECONDS, stairs((28.0, low), (28.0, high)), 1.4 if index % 2 == 0 else 2.0)
        for index, (low, high) in enumerate(sizes)
    ]


def one_speed_programme() -> list[Drive]:
    """The three-speeds programme at one speed without a halt."""
    return [replace(run, speed=constant(ROAD_MPS)) for run in three_speeds_programme()]


def ordered_programme() -> list[Drive]:
    """Eight runs in each of which the angle grows with time, four to either side."""
    runs = []
    for index in range(8):
        side, start = (1.0 if index % 2 == 0 else -1.0), 1.0 + 0.7 * index
        treads = [(SECONDS / 8.0, side * (start + 2.8 * tread)) for tread in range(8)]
        runs.append(drive(f"grow_{index}", SECONDS, stairs(*treads), (1.2, 1.4, 1.8, 2.0)[index // 2]))
    return runs


PROGRAMMES: dict[str, Callable[[], list[Drive]]] = {
    "three_speeds": three_speeds_programme,
    "default": default_programme,
    "mixed": mixed_programme,
    "closed": closed_programme,
    "one_sided": one_sided_programme,
    "one_speed": one_speed_programme,
    "ordered_angles": ordered_programme,
}
