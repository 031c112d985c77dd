"""What driven work comes to: result types that tables, pages and exports are made from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Points = npt.NDArray[np.float64]
WORKING, TURNING, WAY, STANDING, UNLOGGED = "working", "turning", "ways", "standing", "not logged"
KINDS = (WORKING, TURNING, WAY, STANDING, UNLOGGED)
"""What a machine can be doing, in the order of tables."""


@dataclass(frozen=True)
class Figures:
    """What a run comes to. Seconds, metres, square metres, m/s and litres; None where the log does not tell.

    Attributes:
        seconds: from the first row to the last.
        by_kind_s: seconds of every kind of KINDS; without a work state all that moves is "ways".
        active_m, inactive_m: driven at work and off it, as counted by the machine, else from the positions.
        counted_m, placed_m: driven in all, by the counters (None without) and by the positions.
        area_m2: worked, as counted by the machine, else driven at work times the width.
        area_counted: whether it was counted by the machine.
        lifts: times the implement stopped working.
        turns: of all kinds; u_turn_s: seconds of those that lead back without a stop, in the median.
        stops: stands of five seconds and more.
        working_mps: median of the rows at work that move; turning_mps: length over time of all turns without a stop.
    """

    seconds: float
    by_kind_s: dict[str, float]
    active_m: float | None
    inactive_m: float | None
    counted_m: float | None
    placed_m: float
    area_m2: float | None
    area_counted: bool
    lifts: int | None
    turns: int | None
    u_turns: int | None
    u_turn_s: float | None
    stops: int
    stops_s: float
    working_mps: float | None
    turning_mps: float | None
    fuel_l: float | None
    width_m: float | None
    rows: int

    @property
    def share_working(self) -> float | None:
        """Share of the time that was worked."""
        return None if self.active_m is None or not self.seconds else self.by_kind_s[WORKING] / self.seconds

    @property
    def moving_s(self) -> float:
        """Time in which it moved, whatever for."""
        return sum(self.by_kind_s[kind] for kind in (WORKING, TURNING, WAY))

    @property
    def net_s(self) -> float:
        """The time without stops."""
        return self.seconds - self.stops_s


@dataclass(frozen=True)
class RunTold:
    """One imported run: what it is called, where it is from, its file, its figures, and what is odd about it.

    `start` is "2020-01-02T17:30:20" or "", `file` the log file it was written to, `notes` parts of sentences.
    """

    name: str
    form: str
    start: str
    field: str
    file: str
    figures: Figures
    notes: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Ground:
    """Ground of a field: areas in m2 worked, worked again and missed, and the shapes for a map.

    `missed` holds rings (n, 2) of missed pieces, the largest first, `again` those of ground worked twice or more.
    """

    worked_m2: float
    overlap_m2: float
    missed_m2: float
    missed: tuple[Points, ...]
    again: tuple[Points, ...]


@dataclass(frozen=True, eq=False)
class Side:
    """One side of a comparison: what was planned, or what was driven.

    Attributes:
        machines: tractors of a plan; logs of what was driven.
        figures: of all of them together.
        work, idle: lines (n, 2) driven at work and off it, metres.
        ground: None where the field is not known or nobody said when the implement worked.
    """

    machines: int
    figures: Figures
    work: tuple[Points, ...]
    idle: tuple[Points, ...]
    ground: Ground | None


@dataclass(frozen=True)
class Difference:
    """Machine time that was driven more than planned, and why: `seconds` (less where below 0), and words."""

    what: str
    seconds: float
    words: str


@dataclass(frozen=True, eq=False)
class Comparison:
    """A plan and what was driven of it.

    Attributes:
        name: of the field.
        boundary, holes: rings (n, 2) of the field in metres, nothing where it is not known.
        width_m: of the plan.
        differences: what adds up to the difference in machine time, the largest first.
        notes: sentences on what was left out or taken for something.
    """

    name: str
    field_m2: float | None
    boundary: tuple[Points, ...]
    width_m: float
    planned: Side
    driven: Side
    differences: tuple[Difference, ...]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class Taught:
    """One value that logs taught, and what became of it in the farm file.

    Attributes:
        key: of the farm file, such as "chances.turn_cv".
        value, low, high: as they stand in the file; the interval of 95 %, None where there is none.
        measured: what was measured for it, in words, with the number of events and runs.
        done: what was done with it in the farm file, in words.
        runs: names of the runs it is from.
    """

    key: str
    value: float | str
    low: float | None
    high: float | None
    measured: str
    done: str
    runs: tuple[str, ...]
