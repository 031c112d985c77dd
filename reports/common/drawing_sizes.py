"""Sizes of drawings: charts of pages in units of their picture, pictures in inches, marks in shares of a map."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ChartFrame:
    """Size of a chart and the room around its curves, for values of `scale_x` and `scale_y`; y is down."""

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

    def scale_x(self, value: float, low: float, high: float) -> float:
        """The place of a value on an axis from `low` at the left to `high` at the right."""
        return self.left + (value - low) / (high - low) * (self.width - self.left - self.right_room)

    def scale_y(self, value: float, low: float, high: float) -> float:
        """The place of a value on an axis from `low` at the bottom to `high` at the top."""
        return self.top + (high - value) / (high - low) * (self.height - self.top - self.bottom_room)


CURVE_FRAME = ChartFrame(width=720.0, height=300.0, left=64.0, right_room=20.0, top=12.0, bottom_room=44.0)
BAR_FRAME = ChartFrame(width=360.0, height=200.0, left=40.0, right_room=8.0, top=12.0, bottom_room=40.0)
# Numbers of tractors below, times or prices at the left, both with the name of their axis.
TIME_FRAME = ChartFrame(width=720.0, height=340.0, left=86.0, right_room=16.0, top=18.0, bottom_room=56.0)
RISK_FRAME = ChartFrame(width=720.0, height=420.0, left=86.0, right_room=16.0, top=18.0, bottom_room=56.0)

PAGE_INCHES, COLUMN_INCHES = 10.0, 7.5  # width of a picture on its own, and of one in a notebook or beside text
LINE_INCHES = 0.24  # of a legend or a title
HATCH_SHARE = 0.011  # of the larger side of a map, between two lines over unworked ground
