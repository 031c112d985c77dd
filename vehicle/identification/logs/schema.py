"""A measured log: its columns, its rows, what may be wrong with it, and its segments driven in one gear."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from fields.arrays import Flags, Floats, Integers
from vehicle.identification.logs.thresholds import GAP_STEPS, PART_S

Columns = dict[str, Floats]

NEEDED_COLUMNS = ("time_s", "easting_m", "northing_m")
STEERING_COLUMNS = ("steering_command_deg", "steering_deg")
OPTIONAL_COLUMNS = (
    "heading_deg", "speed_mps", "speed_command_mps", "shuttle", "implement", "roll_deg", "pitch_deg", "elevation_m",
)  # fmt: skip
COLUMNS = NEEDED_COLUMNS + STEERING_COLUMNS + OPTIONAL_COLUMNS
GAP_SAMPLES = 2.0 * GAP_STEPS  # half a second at the usual 10 Hz, bridged by a straight line
SHORTEST_SEGMENT_S = PART_S  # one piece of the 5 s horizon, over which errors are compared


@dataclass(frozen=True)
class GatedRows:
    """Rows excluded by one rule; `first_line` counts the header as line 1."""

    rule: str
    rows: int
    first_line: int


@dataclass(frozen=True)
class LogFault:
    """Something that breaks during a run: its id, its times in `time_s` (`to_s` None: until the log ends), and what.

    `between_s` are the times between which it began, where these columns do not show when; `from_s` is the middle.
    """

    id: str
    run: str
    from_s: float
    to_s: float | None
    words: str
    between_s: tuple[float, float] | None = None

    @property
    def rule(self) -> str:
        """The rule under which its rows are left out."""
        return f"{self.id.replace('_', ' ')}: {self.words}"

    @property
    def earliest_s(self) -> float:
        """From when on it may have been."""
        return self.from_s if self.between_s is None else self.between_s[0]

    @property
    def sentence(self) -> str:
        """The run and what began when."""
        words = self.words.rstrip(".")
        return f"{words[:1].upper()}{words[1:]}." if self.run in words else f"{self.run}: {words}."


@dataclass(frozen=True, eq=False)
class ColumnFault:
    """A fault of one column: what to say of it, and the rows (of the file) in which its value is none."""

    fault: LogFault
    rows: Integers


@dataclass(frozen=True, eq=False)
class Log:
    """One run. Arrays have one value per row of the file, in the units of their names; None when a column is absent.

    Every present column except roll and pitch is finite on the rows that are `used`. `segment` numbers the parts
    between gaps of more than five samples, from 0; it is -1 on unused rows. Speeds are never negative (noise down to
    -0.1 m/s counts as 0): the direction is in `shuttle` (-1, 0, 1), which is 1 throughout when the file has no such
    column; `implement` is then 0 throughout. `other_names` are further paths under which the same file was given;
    `corrections` are sentences on instrument errors that were corrected. The measured speed was divided by
    `speed_factor`; `stray_steering_deg` is the standard deviation of a wheel angle that was dropped because it is
    unrelated to the path. Positions and heading were measured in the `fresh` rows (None: in all) and are interpolated
    between them; `measured_rows` has the rows in which a column that is slower than the log was measured, those of
    positions as `easting_m`. `coarse_columns` are columns that were dropped for their resolution, with the size of
    their steps. `set_remarks` are sentences on the set of logs, carried by one of them; `faults` began during the run,
    or during one that has no row left, and their rows are not used. `elevation_m` are logged heights of the antenna,
    NaN where they are missing. `ground_fall` (n, 2) is the known fall of the ground (m/m) to the east and to the north;
    `ground_source` says, as a plural, where it is known from. `origin_deg` is the longitude and latitude of the origin
    of positions that were logged in degrees.
    """

    name: str
    time_s: Floats
    easting_m: Floats
    northing_m: Floats
    heading_deg: Floats | None
    speed_mps: Floats | None
    speed_command_mps: Floats | None
    steering_command_deg: Floats | None
    steering_deg: Floats | None
    shuttle: Floats
    implement: Floats
    roll_deg: Floats | None
    pitch_deg: Floats | None
    used: Flags
    segment: Integers
    gated: tuple[GatedRows, ...]
    ignored_columns: tuple[str, ...] = ()
    other_names: tuple[str, ...] = ()
    corrections: tuple[str, ...] = ()
    speed_factor: float = 1.0
    stray_steering_deg: float = 0.0
    fresh: Flags | None = None
    measured_rows: Mapping[str, Flags] = field(default_factory=dict)
    coarse_columns: Mapping[str, float] = field(default_factory=dict)
    set_remarks: tuple[str, ...] = ()
    faults: tuple[LogFault, ...] = ()
    elevation_m: Floats | None = None
    ground_fall: Floats | None = None
    ground_source: str = ""
    origin_deg: tuple[float, float] | None = None

    @property
    def rows_used(self) -> int:
        """Number of usable rows."""
        return int(np.count_nonzero(self.used))

    @property
    def rows_gated(self) -> int:
        """Number of excluded rows."""
        return len(self.used) - self.rows_used

    @property
    def segment_count(self) -> int:
        """Number of segments between gaps."""
        return int(self.segment.max()) + 1

    @property
    def step_s(self) -> float:
        """Median time between used rows (s)."""
        return float(np.median(np.diff(self.time_s[self.used])))

    def correct_columns(self, sentence: str, **changed: Any) -> Log:
        """Return the log with changed columns, and the sentence on them."""
        return replace(self, corrections=(*self.corrections, sentence), **changed)

    def exclude_rows(self, rule: str, bad: Flags, **changed: Any) -> Log:
        """Return the log without the `bad` ones of the used rows, counted under a rule."""
        rows, used = np.flatnonzero(bad & self.used), self.used & ~bad
        if len(rows):
            changed["gated"] = (*self.gated, GatedRows(rule, len(rows), find_file_line(rows)))
        return replace(self, used=used, segment=number_segments(self.time_s, used), **changed)

    def add_fault(self, fault: LogFault, bad: Flags, **changed: Any) -> Log:
        """Return the log with a fault and without its rows."""
        return self.exclude_rows(fault.rule, bad, faults=(*self.faults, fault), **changed)


def list_gap_rows(last_before: int, first_after: int, count: int) -> Integers:
    """Return the rows about a jump between two rows, of so many rows, whose absence is a gap between segments."""
    missing = math.ceil(GAP_SAMPLES) + 1 - (first_after - last_before - 1)
    side = max(math.ceil(0.5 * missing), 1)
    return np.arange(max(last_before - side + 1, 0), min(first_after + side, count))


def find_file_line(rows: Integers) -> int:
    """Return the line of the first of these rows in the file, of which the header is line 1."""
    return int(rows[0]) + 2


def number_segments(time: Floats, used: Flags) -> Integers:
    """Return the segment of each used row, -1 for the others; a gap of more than GAP_SAMPLES steps starts one."""
    out = np.full(len(time), -1, dtype=np.int64)
    steps = np.diff(time[used])
    if len(steps):
        out[used] = np.concatenate([[0], np.cumsum(steps > (GAP_SAMPLES + 0.5) * np.median(steps))])
    elif used.any():
        out[used] = 0
    return out


def split_drive_segments(log: Log) -> tuple[list[Integers], list[Integers]]:
    """Split a log into segments in one gear without a gap.

    Returns the rows of the segments that are long enough to replay, and the rows of the others, all from the first to
    the last in which the position was measured.
    """
    long_segments: list[Integers] = []
    short_segments: list[Integers] = []
    rows = np.flatnonzero(log.used)
    # A few excluded rows are no gap, unless the gear changed in them.
    is_stated = np.isfinite(log.shuttle)
    gear = np.sign(log.shuttle[is_stated])
    number = np.zeros(len(log.shuttle), dtype=np.int64)
    number[is_stated] = np.cumsum(np.diff(gear, prepend=gear[:1]) != 0.0)
    change = (np.diff(log.segment[rows]) != 0) | (np.diff(number[rows]) != 0)
    for segment_rows in np.split(rows, np.flatnonzero(change) + 1):
        measured = np.flatnonzero(np.ones(len(segment_rows)) if log.fresh is None else log.fresh[segment_rows])
        if len(measured):
            measured_rows = segment_rows[measured[0] : measured[-1] + 1]
            enough = log.time_s[measured_rows[-1]] - log.time_s[measured_rows[0]] >= SHORTEST_SEGMENT_S
            (long_segments if enough else short_segments).append(measured_rows)
    return long_segments, short_segments
