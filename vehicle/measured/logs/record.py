"""What a measured log is: its columns, its rows, and what may be wrong with it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np
import numpy.typing as npt

from fields.errors import named

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
Rows = npt.NDArray[np.int64]

NEEDED = ("time_s", "easting_m", "northing_m")
STEERING = ("steering_command_deg", "steering_deg")
OPTIONAL = ("heading_deg", "speed_mps", "speed_command_mps", "shuttle", "implement", "roll_deg", "pitch_deg")
COLUMNS = NEEDED + STEERING + OPTIONAL


class Fix(StrEnum):
    """Conventions a log may have instead of the contract's; the value is the name of the option."""

    TIME_MS = "time-ms"
    EAST_NORTH_SWAPPED = "east-north-swapped"
    POSITION_DEGREES = "position-degrees"
    POSITION_KM = "position-km"
    SPEED_KMH = "speed-kmh"
    SPEED_MEASURED_KMH = "speed-measured-kmh"
    SPEED_COMMAND_KMH = "speed-command-kmh"
    HEADING_RADIANS = "heading-radians"
    HEADING_CCW_EAST = "heading-ccw-east"
    HEADING_CCW_NORTH = "heading-ccw-north"
    HEADING_REVERSED = "heading-reversed"
    STEERING_RADIANS = "steering-radians"
    STEERING_LEFT = "steering-left-positive"
    IMPLEMENT_REVERSED = "implement-reversed"
    ROLL_LEFT = "roll-left-down"


MEANING = {
    Fix.TIME_MS: "time_s counts milliseconds",
    Fix.EAST_NORTH_SWAPPED: "easting and northing are swapped",
    Fix.POSITION_DEGREES: "easting_m and northing_m are longitude and latitude in degrees",
    Fix.POSITION_KM: "easting_m and northing_m are in kilometres",
    Fix.SPEED_KMH: "speeds are in km/h",
    Fix.SPEED_MEASURED_KMH: "speed_mps is in km/h",
    Fix.SPEED_COMMAND_KMH: "speed_command_mps is in km/h",
    Fix.HEADING_RADIANS: "heading_deg is in radians",
    Fix.HEADING_CCW_EAST: "heading_deg runs counter-clockwise from east",
    Fix.HEADING_CCW_NORTH: "heading_deg runs counter-clockwise from north",
    Fix.HEADING_REVERSED: "heading_deg points backwards",
    Fix.STEERING_RADIANS: "steering angles are in radians",
    Fix.STEERING_LEFT: "steering is positive to the left",
    Fix.IMPLEMENT_REVERSED: "implement is 1 where it is lifted and 0 where it works",
    Fix.ROLL_LEFT: "roll_deg is positive where the left side is lower",
}


def asking(fix: Fix) -> str:
    """How a fix is asked for, inside the sentence of a refusal."""
    return f"{named('fixes')} {fix}"


@dataclass(frozen=True)
class Suspicion:
    """A convention the data speak for, and the numbers that say so.

    `fix` is None when only the log itself can be mended; `what` and `advice` then say what is suspected and what to do.
    With a fix, `advice` adds the other readings that the data allow.
    """

    fix: Fix | None
    why: str
    what: str = ""
    advice: str = ""

    def sentence(self) -> str:
        """What is suspected, why, and the fix, for a refusal."""
        if self.fix is None:
            return f"{self.what} ({self.why}); {self.advice}"
        other = f" ({self.advice})" if self.advice else ""
        return f"{MEANING[self.fix]} ({self.why}); give {asking(self.fix)} to convert{other}"


@dataclass(frozen=True)
class Gated:
    """Rows left out by one rule; `first_line` counts the header as line 1."""

    rule: str
    rows: int
    first_line: int


@dataclass(frozen=True, eq=False)
class Log:
    """One run. Arrays have one value per row of the file, in the units of their names; None when a column is absent.

    Every present column except roll and pitch is finite on the rows that are `used`. `segment` numbers the stretches
    without a gap of more than five samples, from 0; it is -1 on rows that are not used. Speeds are never negative
    (noise down to -0.1 m/s counts as 0): the direction is in `shuttle` (-1, 0, 1), which is 1 throughout when the file
    does not say; `implement` is then 0 throughout. `given_again` holds the further names under which the same file was
    given; `doubts` say what its instruments got wrong and what was set right. `speed_factor` is what the measured speed
    was divided by, `stray_deg` the standard deviation of a wheel angle that moved with nothing and was left out.
    Positions and heading are measured in the rows that are `fresh`, between which they lie on a line (None: in all).
    `coarse` are columns left out for the steps they came in, with the step.
    """

    name: str
    time_s: Array
    easting_m: Array
    northing_m: Array
    heading_deg: Array | None
    speed_mps: Array | None
    speed_command_mps: Array | None
    steering_command_deg: Array | None
    steering_deg: Array | None
    shuttle: Array
    implement: Array
    roll_deg: Array | None
    pitch_deg: Array | None
    used: Mask
    segment: Rows
    gated: tuple[Gated, ...]
    ignored_columns: tuple[str, ...] = ()
    given_again: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()
    speed_factor: float = 1.0
    stray_deg: float = 0.0
    fresh: Mask | None = None
    coarse: Mapping[str, float] = field(default_factory=dict)

    @property
    def rows_used(self) -> int:
        """Number of rows that can be used."""
        return int(np.count_nonzero(self.used))

    @property
    def rows_gated(self) -> int:
        """Number of rows left out."""
        return len(self.used) - self.rows_used

    @property
    def segments(self) -> int:
        """Number of stretches without a gap."""
        return int(self.segment.max()) + 1

    @property
    def step_s(self) -> float:
        """Median time between used rows."""
        return float(np.median(np.diff(self.time_s[self.used])))
