"""What an experiment hands to a report: numbers beside the thesis, pictures as plain arrays, tables as text."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Comparison:
    """One number of the thesis beside ours; None where there is none, with the reason in `note`."""

    experiment: str
    quantity: str
    unit: str
    thesis: float | None
    ours: float | None
    note: str = ""

    @property
    def difference_pct(self) -> float | None:
        """Ours less the thesis over the thesis, in percent."""
        if self.thesis is None or self.ours is None or self.thesis == 0.0:
            return None
        return 100.0 * (self.ours / self.thesis - 1.0)


@dataclass(frozen=True, eq=False)
class Line:
    """A line of a panel: x and y (t,), a colour by number, and per point the stage of the steering simulator if any."""

    label: str
    x: Array
    y: Array
    colour: int = 0
    dashed: bool = False
    stages: Array | None = None


@dataclass(frozen=True, eq=False)
class Panel:
    """Lines over two axes; `equal` draws both to one scale. A value of nan is what `missing` names, if it is named."""

    title: str
    x_label: str
    y_label: str
    lines: tuple[Line, ...]
    equal: bool = False
    missing: str = ""


@dataclass(frozen=True, eq=False)
class HeatMap:
    """Values (rows, columns) over two axes; nan is what `missing` names."""

    title: str
    x_label: str
    y_label: str
    value_label: str
    x: Array
    y: Array
    values: Array
    missing: str


@dataclass(frozen=True)
class TextTable:
    """A small table of words and numbers."""

    title: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True, eq=False)
class Sheet:
    """One experiment: what it is, what came out, and what to look at."""

    name: str
    title: str
    words: tuple[str, ...]
    comparisons: tuple[Comparison, ...] = ()
    panels: tuple[Panel | HeatMap, ...] = ()
    tables: tuple[TextTable, ...] = ()


@dataclass(frozen=True, eq=False)
class Driven:
    """What came out. `radius_m` is that of the antenna's circle, None without one; slips at the end, in degrees;
    `track` rows are time, x, y, heading (clockwise from north, degrees) and wheel angle (degrees), ten a second.
    """

    radius_m: float | None
    stable: bool
    slip_front_deg: float
    slip_rear_deg: float
    track: Array


@dataclass(frozen=True)
class Proof:
    """One drive of `headland tractor check`: what the file asks for and what was driven (None: not to its end).

    It is good when the two differ by `tolerance` at most, in `unit`; a drive that is asked for 0 is an error with
    that limit. `advice` says what to look at where it is not good.
    """

    drive: str
    ground: str
    unit: str
    asked: float
    driven: float | None
    tolerance: float
    advice: str

    @property
    def difference(self) -> float | None:
        """Driven less asked."""
        return None if self.driven is None else self.driven - self.asked

    @property
    def good(self) -> bool:
        """Whether what was driven is near enough to what was asked."""
        apart = self.difference
        return apart is not None and (abs(apart) if self.asked else max(apart, 0.0)) <= self.tolerance


@dataclass(frozen=True)
class Proved:
    """A tractor file, driven: whether it holds together, in words, and every drive."""

    tractor: str
    holds_together: bool
    words: tuple[str, ...]
    proofs: tuple[Proof, ...]
