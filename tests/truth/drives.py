"""Drives a person could make to show what a tractor does, as programmes of commands over time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Signal = Callable[[Array], Array]
ROAD_MPS = 1.4


def constant(value: float) -> Signal:
    """The same value all the time."""
    return lambda time: np.full_like(time, value)


def stairs(*treads: tuple[float, float]) -> Signal:
    """Values held one after another: (seconds, value); the last one is held on."""
    ends = np.cumsum([seconds for seconds, _ in treads])
    values = np.array([value for _, value in treads])
    return lambda time: values[np.minimum(np.searchsorted(ends, time, side="right"), len(values) - 1)]


def triangle(size: float, period_s: float) -> Signal:
    """A triangular wave that starts at 0 and rises."""
    return lambda time: size * 2.0 / np.pi * np.arcsin(np.sin(2.0 * np.pi * time / period_s))


def chirp(size: float, low_hz: float, high_hz: float, seconds: float) -> Signal:
    """A sine whose frequency grows evenly on a logarithmic scale."""
    growth = np.log(high_hz / low_hz) / seconds
    return lambda time: size * np.sin(2.0 * np.pi * low_hz / growth * np.expm1(growth * time))


@dataclass(frozen=True, eq=False)
class Drive:
    """One run: signals over seconds from its start.

    `steering` in degrees (positive right), or, when `closed_loop`, the wanted offset in metres (positive right) from
    the line through the start along the bearing. `bearing_deg` is the first heading, clockwise from north; None lets
    the truth draw it.
    """

    name: str
    duration_s: float
    steering: Signal
    speed: Signal
    implement: Signal
    shuttle: Signal
    bearing_deg: float | None
    closed_loop: bool

    def mirrored(self) -> Drive:
        """The same drive with left and right exchanged."""
        bearing = None if self.bearing_deg is None else -self.bearing_deg
        return replace(self, steering=lambda time: -self.steering(time), bearing_deg=bearing)


def drive(
    name: str,
    duration_s: float,
    steering: Signal,
    speed: Signal | float = ROAD_MPS,
    implement: Signal | float = 0.0,
    shuttle: Signal | float = 1.0,
    bearing_deg: float | None = None,
    closed_loop: bool = False,
) -> Drive:
    """A Drive in which numbers stand for constant signals."""
    speed, implement, shuttle = (
        signal if callable(signal) else constant(float(signal)) for signal in (speed, implement, shuttle)
    )
    return Drive(name, duration_s, steering, speed, implement, shuttle, bearing_deg, closed_loop)


def circles(side: int, speed_mps: float = ROAD_MPS) -> Drive:
    """Four circles, each tighter than the last, to the right (side 1) or the left (side -1)."""
    angles = [(15.0, side * angle) for angle in (6.0, 12.0, 20.0, 30.0)]
    return drive(f"circles_{'right' if side > 0 else 'left'}", 60.0, stairs(*angles), speed_mps)


def straight(bearing_deg: float, implement: float = 0.0, seconds: float = 55.0) -> Drive:
    """Straight ahead along a bearing."""
    return drive(f"straight_{bearing_deg:03.0f}", seconds, constant(0.0), ROAD_MPS, implement, 1.0, bearing_deg)


def steps(sizes: Sequence[float], hold_s: float, name: str, speed_mps: float = ROAD_MPS) -> Drive:
    """Step steers from one angle to the next."""
    return drive(name, hold_s * len(sizes), stairs(*[(hold_s, size) for size in sizes]), speed_mps)


def implement_lifts(bearing_deg: float) -> Drive:
    """Straight passes with the implement lowered and lifted every 12 s."""
    down = stairs(*[(12.0, float(index % 2)) for index in range(5)])
    return drive("implement_straight", 60.0, constant(0.0), ROAD_MPS, down, bearing_deg=bearing_deg)


def implement_weave() -> Drive:
    """Gentle bends with the implement working in the second half."""
    bends = stairs((8.0, 0.0), (8.0, 6.0), (8.0, -6.0), (6.0, 0.0), (6.0, 0.0), (8.0, 6.0), (8.0, -6.0), (6.0, 0.0))
    return drive("implement_weave", 58.0, bends, 1.8, stairs((30.0, 0.0), (28.0, 1.0)))


def speed_steps() -> Drive:
    """A long bend each way at changing speed."""
    speeds = stairs((8.0, 0.8), (8.0, 1.8), (8.0, 3.0), (8.0, 1.2), (8.0, 2.4), (8.0, 0.8), (8.0, 3.0), (8.0, 1.6))
    return drive("speed_steps", 64.0, stairs((32.0, 7.0), (32.0, -7.0)), speeds)


def fast_circles() -> Drive:
    """The same lock slowly and fast, right and then left."""
    speeds = stairs((14.0, 1.0), (16.0, 3.0), (14.0, 1.0), (16.0, 3.0))
    return drive("fast_circles", 60.0, stairs((30.0, 18.0), (30.0, -18.0)), speeds)


def figure_eight() -> Drive:
    """One circle to each side."""
    return drive("figure_eight", 56.0, stairs((28.0, 18.0), (28.0, -20.0)), 2.0)


def stop_and_go() -> Drive:
    """Halts between slightly bent stretches."""
    speeds = stairs(*[(9.0 if index % 2 == 0 else 3.0, (1.0 - index % 2) * (1.0 + 0.2 * index)) for index in range(10)])
    return drive("stop_and_go", 58.0, stairs((24.0, 4.0), (24.0, -4.0), (10.0, 0.0)), speeds)


def autosteer(bearing_deg: float, implement: float) -> Drive:
    """Closed loop along a line that jumps sideways now and then, as from one track to the next."""
    lines = stairs((12.0, 0.6), (14.0, -0.9), (14.0, 0.8), (15.0, 0.0))
    name = f"autosteer_{bearing_deg:03.0f}"
    return drive(name, 55.0, lines, 1.8, implement, 1.0, bearing_deg, closed_loop=True)


def reversing() -> Drive:
    """Forward, neutral, and backwards around a bend."""
    gears = stairs((15.0, 1.0), (3.0, 0.0), (15.0, -1.0), (3.0, 0.0), (19.0, 1.0))
    speeds = stairs((13.0, 1.2), (5.0, 0.0), (13.0, 0.9), (5.0, 0.0), (19.0, 1.2))
    return drive("reversing", 55.0, stairs((15.0, 5.0), (18.0, -10.0), (22.0, 5.0)), speeds, shuttle=gears)


def default_programme() -> list[Drive]:
    """Sixteen runs of 55 to 64 s, about a quarter of an hour, that reveal every effect of the catalogue."""
    return [
        straight(90.0),
        straight(270.0),
        circles(1),
        circles(-1),
        steps((3.0, -3.0, 6.0, -6.0, 12.0, -12.0, 20.0, -20.0, 4.0, -10.0, 0.0), 5.5, "steps"),
        steps((0.4, 0.0, -0.6, 0.3, 1.2, 0.0, -1.5, -0.7, 0.8, 2.0, 0.0, -2.0, -1.2, 0.6, 0.0), 4.0, "small_steps"),
        drive("slow_triangle", 60.0, triangle(3.0, 15.0)),
        drive("chirp", 60.0, chirp(6.0, 0.04, 0.6, 60.0)),
        speed_steps(),
        fast_circles(),
        implement_lifts(0.0),
        implement_weave(),
        figure_eight(),
        stop_and_go(),
        autosteer(180.0, 1.0),
        steps((14.0, -14.0, 8.0, -14.0, 14.0, -8.0, 3.0, -3.0, 20.0, -20.0, 0.0), 5.0, "fast_steps", 2.4),
    ]


def three_speeds_programme() -> list[Drive]:
    """Eight runs of 56 s at 3, 5 and 8 km/h: what a person drives who wants to see much in little time.

    The tightest bend is driven at two speeds, the faster of which reaches a friction limit of the clear size.
    """
    slow, road, fast = 3.0 / 3.6, 5.0 / 3.6, 8.0 / 3.6
    paces = stairs((18.0, slow), (20.0, fast), (18.0, road))
    small = stairs(*[(4.0, size) for size in (0.4, 0.0, -0.6, 1.2, 0.0, -1.5, 0.8)])
    wave = triangle(3.0, 14.0)
    down = stairs(*[(14.0, float(index % 2)) for index in range(4)])
    rises = stairs((16.0, road), (5.0, 0.0), (15.0, fast), (20.0, slow))
    turns = ((12.0, 8.0), (12.0, 18.0), (16.0, 18.0), (16.0, 26.0))
    laps = stairs((12.0, road), (12.0, slow), (16.0, fast), (8.0, road), (8.0, fast))
    return [
        drive("there", 56.0, constant(0.0), paces, bearing_deg=90.0),
        drive("back", 56.0, constant(0.0), paces, bearing_deg=270.0),
        drive("right", 56.0, stairs(*turns), laps),
        drive("left", 56.0, stairs(*[(seconds, -angle) for seconds, angle in turns]), laps),
        steps((3.0, -3.0, 8.0, -8.0, 15.0, -15.0, 22.0, -22.0, 5.0, -12.0, 2.0, 0.0), 56.0 / 12.0, "steps"),
        drive("waves", 56.0, lambda time: np.where(time < 28.0, small(time), wave(time)), slow),
        drive("tool", 56.0, stairs((28.0, 0.0), (14.0, 6.0), (14.0, -6.0)), stairs((28.0, road), (28.0, fast)), down,
              bearing_deg=0.0),
        drive("lines", 56.0, stairs((14.0, 0.6), (16.0, -0.8), (14.0, 0.7), (12.0, 0.0)), rises, bearing_deg=180.0,
              closed_loop=True),
    ]  # fmt: skip


def one_way_programme(bearing_deg: float = 90.0) -> list[Drive]:
    """Four straight passes, all the same way and with the implement down: offset, draft and slope look the same."""
    return [replace(straight(bearing_deg, 1.0), name=f"one_way_{index}") for index in range(4)]
