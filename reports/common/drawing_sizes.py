"""Sizes of drawings and axes of charts: of pages in units of the picture, of pictures in inches, marks in shares."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

TIME_STEPS_S = (1, 2, 5, 10, 20, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 14400, 21600, 43200, 86400)
"""Between times on an axis, from the smallest on."""
PAGE_INCHES, COLUMN_INCHES = 10.0, 7.5  # width of a picture on its own, and of one in a notebook or beside text
NARROWEST_INCHES = 5.5  # width of a map, for its title and its legend
LINE_INCHES = 0.24  # of a legend or a title
EDGE_SHARE, HATCH_SHARE = 0.03, 0.011  # of the larger side of a map: margin, between two lines over unworked ground


@dataclass(frozen=True)
class ChartAxis:
    """A direction of a picture: values from `low` to `high` lie from `first` to `last`, in its units."""

    low: float
    high: float
    first: float
    last: float

    def place(self, value: float) -> float:
        """Where a value lies."""
        return round(self.first + (self.last - self.first) * (value - self.low) / (self.high - self.low), 1)

    def list_ticks(
        self, steps: Sequence[float] = (), write: Callable[[float], str] | None = None, most: int = 6
    ) -> list[tuple[float, str]]:
        """Places and texts of round values, at most so many apart; by default texts have the decimals of their step.

        It is the smallest of `steps` that is wide enough; else 1, 2 or 5 times a power of ten of the last.
        """
        span = self.high - self.low
        step = next((step for step in steps if span / step <= most), 0.0)
        if not step:
            unit = steps[-1] if steps else 1.0
            power = unit * 10.0 ** math.floor(math.log10(span / unit / most))
            sizes = (factor * power for factor in (1.0, 2.0, 5.0, 10.0))
            step = next(size for size in sizes if span / size <= most * (1.0 + 1e-9))
        decimals = max(0, -math.floor(math.log10(step) + 1e-9))
        first, last = math.ceil(self.low / step - 1e-9), math.floor(self.high / step + 1e-9)
        values = [number * step for number in range(first, last + 1)]
        return [(self.place(value), f"{value:.{decimals}f}" if write is None else write(value)) for value in values]


@dataclass(frozen=True)
class ChartFrame:
    """Size of a chart and the room around its curves; y is down."""

    width: float
    height: float
    left: float
    right_room: float
    top: float
    bottom_room: float

    @property
    def right(self) -> float:
        """The right end of the curves."""
        return self.width - self.right_room

    @property
    def bottom(self) -> float:
        """The lower end of the curves."""
        return self.height - self.bottom_room

    def build_axes(self, x_range: tuple[float, float], y_range: tuple[float, float]) -> tuple[ChartAxis, ChartAxis]:
        """The axes to the right and upwards, for values from the first to the second of their range."""
        return ChartAxis(*x_range, self.left, self.right), ChartAxis(*y_range, self.bottom, self.top)


CURVE_FRAME = ChartFrame(width=720.0, height=300.0, left=64.0, right_room=20.0, top=12.0, bottom_room=44.0)
BAR_FRAME = ChartFrame(width=360.0, height=200.0, left=40.0, right_room=8.0, top=12.0, bottom_room=40.0)
# Numbers of tractors below, times or prices at the left, both with the name of their axis.
TIME_FRAME = ChartFrame(width=720.0, height=340.0, left=86.0, right_room=16.0, top=18.0, bottom_room=56.0)
RISK_FRAME = ChartFrame(width=720.0, height=420.0, left=86.0, right_room=16.0, top=18.0, bottom_room=56.0)
SWEEP_FRAME = ChartFrame(width=560.0, height=400.0, left=64.0, right_room=16.0, top=28.0, bottom_room=48.0)
