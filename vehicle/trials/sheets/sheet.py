"""What experiments give to reports: numbers beside the thesis's, plots as plain arrays, tables as text.

TABLE_3_1 to TABLE_4_3 are the numbers that the thesis prints, in centimetres, metres and degrees as printed.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from fields.arrays import Floats

# Trajectory difference between the digital twin and the real tractor: (speed, statistic) -> per offset.
TABLE_3_1 = {
    (3, "maximum"): (8.4, 8.7, 7.3, 8.3, 6.3, 6.6, 8.4, 9.2),
    (3, "average"): (3.7, 3.4, 3.3, 2.6, 2.6, 3.1, 4.5, 3.3),
    (5, "maximum"): (12.6, 7.8, 8.7, 5.0, 9.2, 6.5, 6.4, 11.5),
    (5, "average"): (5.0, 3.9, 2.9, 1.6, 2.9, 2.0, 1.8, 3.8),
}
TABLE_3_2 = {
    ("proposed", 3, "maximum"): (24.0, 10.7, 7.5, 9.4, 8.9, 9.1, 14.5, 14.6),
    ("proposed", 3, "average"): (11.6, 5.0, 2.8, 3.3, 3.8, 3.8, 7.1, 5.2),
    ("proposed", 5, "maximum"): (39.8, 10.8, 7.0, 7.4, 9.5, 8.1, 14.9, 21.6),
    ("proposed", 5, "average"): (16.4, 5.4, 2.8, 2.5, 4.3, 2.6, 4.5, 7.4),
    ("traditional", 3, "maximum"): (37.5, 20.7, 10.3, 11.1, 9.1, 15.7, 22.7, 23.6),
    ("traditional", 3, "average"): (13.9, 8.7, 4.9, 5.7, 4.0, 5.4, 8.9, 8.6),
    ("traditional", 5, "maximum"): (50.3, 33.7, 19.9, 9.7, 13.0, 23.4, 41.8, 44.9),
    ("traditional", 5, "average"): (23.0, 12.3, 5.7, 3.7, 6.3, 7.4, 12.2, 14.6),
}
# Average lateral error over the last 15 m of path 2.
TABLE_3_3 = {
    ("physical space", 3): (2.5, 2.4, 2.7, 2.5, 3.4, 3.0, 2.0, 1.8),
    ("physical space", 5): (1.5, 2.2, 2.3, 2.4, 3.6, 3.1, 2.1, 1.5),
    ("proposed", 3): (3.3, 3.2, 3.1, 3.6, 3.8, 4.3, 3.4, 3.8),
    ("proposed", 5): (3.6, 2.9, 2.5, 2.7, 4.0, 4.2, 3.0, 5.6),
    ("traditional", 3): (3.9, 3.1, 3.1, 3.2, 3.7, 4.0, 3.9, 3.9),
    ("traditional", 5): (5.1, 3.2, 2.5, 3.3, 4.3, 3.9, 4.6, 4.4),
}
# Physical space; the column of the digital twin is lost.
_ERRORS = (
    ("lateral error, maximum", "cm"), ("lateral error, average", "cm"),
    ("heading error, maximum", "deg"), ("heading error, average", "deg"),
)  # fmt: skip
TABLE_3_4 = {
    (path, *error): value
    for path, values in ((1, (13.9, 5.2, 3.8, 1.49)), (2, (11.7, 2.3, 2.2, 0.52)))
    for error, value in zip(_ERRORS, values, strict=True)
}
# From the text of section 3.4 about the lost column: twin less physical, per pass.
TWIN_DIFFERENCES = {("lateral error, average", "cm"): (2.0, 0.4), ("heading error, average", "deg"): (0.2, 0.14)}
# Radius in metres at 25, 30 and 35 degrees; None is oversteer.
TABLE_4_1: dict[str, tuple[float | None, ...]] = {
    "kinematic": (5.36, 4.53, 3.88),
    "linear": (5.89, 4.92, 4.19),
    "nonlinear": (7.30, 6.79, None),
}
# Lateral error (m) maximum and average, heading error (degrees) maximum and average.
TABLE_4_3 = {
    ("asphalt", "real"): (0.207, 0.107, 15.68, 7.86),
    ("asphalt", "nonlinear"): (0.203, 0.106, 15.67, 7.87),
    ("asphalt", "linear"): (0.201, 0.101, 15.44, 7.82),
    ("mud", "real"): (0.372, 0.167, 22.3, 9.12),
    ("mud", "nonlinear"): (0.369, 0.163, 23.5, 9.70),
    ("mud", "linear"): (0.271, 0.122, 20.2, 8.38),
}
MUD_RATIO = TABLE_4_3["mud", "nonlinear"][1] / TABLE_4_3["mud", "linear"][1]  # of the average lateral errors


@dataclass(frozen=True)
class ThesisComparison:
    """A number of the thesis beside ours; None if there is none, with the reason in `note`."""

    experiment: str
    quantity: str
    unit: str
    thesis: float | None
    ours: float | None
    note: str = ""

    @property
    def difference_pct(self) -> float | None:
        """Difference of ours from the thesis, in percent of the thesis."""
        if self.thesis is None or self.ours is None or self.thesis == 0.0:
            return None
        return 100.0 * (self.ours / self.thesis - 1.0)


@dataclass(frozen=True, eq=False)
class PlotLine:
    """A line of a plot: x and y (t,), a colour number, and per point the stage of the steering simulator, if any."""

    label: str
    x: Floats
    y: Floats
    colour: int = 0
    dashed: bool = False
    stages: Floats | None = None


@dataclass(frozen=True, eq=False)
class PlotPanel:
    """Lines over two axes; `equal_axes` draws both to one scale. `missing`, if given, says what a nan value means."""

    title: str
    x_label: str
    y_label: str
    lines: tuple[PlotLine, ...]
    equal_axes: bool = False
    missing: str = ""


def build_map_panel(title: str, lines: Iterable[PlotLine]) -> PlotPanel:
    """Lines on a map, to scale."""
    return PlotPanel(title, "East (m)", "North (m)", tuple(lines), equal_axes=True)


def build_time_panel(title: str, y_label: str, lines: Iterable[PlotLine]) -> PlotPanel:
    """Lines over time."""
    return PlotPanel(title, "Time (s)", y_label, tuple(lines))


def build_track_line(label: str, place: Floats, colour: int) -> PlotLine:
    """A path (t, 2) on a map, from its own start."""
    return PlotLine(label, place[:, 0] - place[0, 0], place[:, 1] - place[0, 1], colour)


@dataclass(frozen=True, eq=False)
class HeatMap:
    """Values (rows, columns) over two axes; `missing` says what nan means."""

    title: str
    x_label: str
    y_label: str
    value_label: str
    x: Floats
    y: Floats
    values: Floats
    missing: str


@dataclass(frozen=True)
class TextTable:
    """A small table of words and numbers."""

    title: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True, eq=False)
class ExperimentSheet:
    """One experiment: name, title, findings in words, comparisons, plots and tables."""

    name: str
    title: str
    words: tuple[str, ...]
    comparisons: tuple[ThesisComparison, ...] = ()
    panels: tuple[PlotPanel | HeatMap, ...] = ()
    tables: tuple[TextTable, ...] = ()


@dataclass(frozen=True, eq=False)
class SteeredDrive:
    """The result of a steered drive. `radius_m` is the radius of the antenna's circle, None if there is none; slips are
    at the end, in degrees; `trace_rows` are time, x, y, heading (clockwise from north, degrees) and wheel angle
    (degrees), ten a second.
    """

    radius_m: float | None
    stable: bool
    slip_front_deg: float
    slip_rear_deg: float
    trace_rows: Floats


@dataclass(frozen=True)
class DriveCheck:
    """One drive of `headland tractor check`: the expected and the driven value (None: the drive did not finish).

    It is good if the two differ by at most `tolerance`, in `unit`; an expected value of 0 is an error with that limit.
    `advice` says what to check if it is not good.
    """

    drive: str
    ground: str
    unit: str
    expected: float
    driven: float | None
    tolerance: float
    advice: str

    @property
    def difference(self) -> float | None:
        """Driven less expected."""
        return None if self.driven is None else self.driven - self.expected

    @property
    def is_good(self) -> bool:
        """Whether the driven value is within the tolerance."""
        deviation = self.difference
        return deviation is not None and (abs(deviation) if self.expected else max(deviation, 0.0)) <= self.tolerance


@dataclass(frozen=True)
class TractorVerdict:
    """The verdict on a tractor file: whether its values fit together, in words, and all drives."""

    tractor: str
    holds_together: bool
    words: tuple[str, ...]
    checks: tuple[DriveCheck, ...]
