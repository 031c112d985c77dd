"""Results of task logs for tables, pages and exports: runs, comparison with a plan, learned values."""

from __future__ import annotations

from dataclasses import dataclass

from fields.arrays import Floats

WORKING, TURNING, TRANSIT, STANDING, UNLOGGED = "working", "turning", "ways", "standing", "not logged"
ACTIVITY_KINDS = (WORKING, TURNING, TRANSIT, STANDING, UNLOGGED)
"""Activities of a machine, in the order of tables."""


@dataclass(frozen=True)
class RunFigures:
    """The figures of a run in seconds, metres, square metres, m/s and litres; None where the log does not have them.

    Attributes:
        seconds: from the first row to the last.
        by_kind_s: seconds of every kind of `ACTIVITY_KINDS`; without a work state all driving is "ways".
        active_m, inactive_m: length driven at work and off work, as counted by the machine, else from the positions.
        counted_m, placed_m: total length by the counters (None without) and by the positions.
        area_m2: worked area, as counted by the machine, else length at work times width.
        area_counted: whether the machine counted it.
        lifts: times the implement stopped working.
        turns: of all kinds; u_turn_s: median seconds of those that lead back without a stop.
        stops: standstills of five seconds or more.
        working_mps: median speed of the rows at work that move.
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
        """Share of the time at work."""
        return None if self.active_m is None or not self.seconds else self.by_kind_s[WORKING] / self.seconds

    @property
    def moving_s(self) -> float:
        """Time of all driving."""
        return sum(self.by_kind_s[kind] for kind in (WORKING, TURNING, TRANSIT))


@dataclass(frozen=True)
class ImportedRun:
    """One imported run: its name, format, field, file and figures, and remarks on it.

    `start` is "2020-01-02T17:30:20" or "", `file` the log file it was written to; `notes` are parts of sentences.
    """

    name: str
    form: str
    start: str
    field: str
    file: str
    figures: RunFigures
    notes: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class GroundCoverage:
    """Ground of a field: areas in m2 worked, worked again and missed, and the shapes for a map.

    `unworked` holds rings (n, 2) of missed pieces, largest first, `overlaps` those of ground worked twice or more.
    """

    worked_m2: float
    overlap_m2: float
    missed_m2: float
    unworked: tuple[Floats, ...]
    overlaps: tuple[Floats, ...]


@dataclass(frozen=True, eq=False)
class ComparisonSide:
    """One side of a comparison: the plan, or the logs.

    Attributes:
        machines: number of tractors of a plan, or of logs.
        figures: of all machines together.
        work_lines, idle_lines: lines (n, 2) at work and off work, metres.
        ground: None where the field or the work state is not known.
    """

    machines: int
    figures: RunFigures
    work_lines: tuple[Floats, ...]
    idle_lines: tuple[Floats, ...]
    ground: GroundCoverage | None


@dataclass(frozen=True)
class TimeDifference:
    """A difference in machine time: the activity, driven minus planned seconds, and the cause in words."""

    what: str
    seconds: float
    words: str


@dataclass(frozen=True, eq=False)
class PlanComparison:
    """A plan beside the logs of the work.

    Attributes:
        name: of the field.
        boundary: rings (n, 2) of the field and its holes in metres, empty where it is not known.
        width_m: of the plan.
        differences: parts of the difference in machine time, largest first.
        notes: sentences on what was left out or assumed.
    """

    name: str
    field_m2: float | None
    boundary: tuple[Floats, ...]
    width_m: float
    planned: ComparisonSide
    as_driven: ComparisonSide
    differences: tuple[TimeDifference, ...]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class LearnedOutcome:
    """One value learned from logs, and what was done with it in the farm file.

    Attributes:
        key: of the farm file, such as "uncertainty.turn_cv".
        value, low, high: in the units of the file, with the 95 % interval, None without one.
        measured: what was measured, in words, with the number of events and runs.
        done: what was done with it, in words.
        runs: names of its runs.
    """

    key: str
    value: float | str
    low: float | None
    high: float | None
    measured: str
    done: str
    runs: tuple[str, ...]
