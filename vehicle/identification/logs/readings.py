"""The catalogue of readings: what a column may mean instead of the contract, one entry each with its conversion.

A reading that is a unit has the band of ratios that only it explains: of what the column shows to what the other
columns say of the same motion, in the units of the contract.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any

import numpy as np

from fields.arrays import Floats
from fields.errors import mark_parameter
from fields.units import HOUR_S, KMH_PER_MPS
from vehicle.identification.errors import LogError
from vehicle.identification.logs.schema import STEERING_COLUMNS, Columns, Log
from vehicle.model.gnss import project_to_metres

Place = tuple[float, float]
Conversion = Callable[[Columns, Place | None], Columns]
Band = tuple[float, float]

_POSITIONS, _SPEEDS = ("easting_m", "northing_m"), ("speed_mps", "speed_command_mps")
MPH, KNOTS = HOUR_S / 1609.344, HOUR_S / 1852.0  # per m/s


def _convert_each(convert: Callable[[Floats], Floats], *names: str) -> Conversion:
    return lambda columns, _reference: {name: convert(columns[name]) for name in names if name in columns}


def _exchange(one: str, other: str) -> Conversion:
    """Exchange two columns; what it makes raises LogError where there is only one of them."""

    def convert(columns: Columns, _reference: Place | None) -> Columns:
        absent = next((name for name in (one, other) if name not in columns), None)
        if absent is not None:
            raise LogError(
                f"{absent} is not logged, and the fix {LogConvention.STEERING_SWAPPED} exchanges it with the other "
                "steering column; remove that fix, or rename the column."
            )
        return {one: columns[other], other: columns[one]}

    return convert


def find_first_place(columns: Columns) -> Place:
    """Return the first finite position of the columns, unconverted."""
    first = np.flatnonzero(np.isfinite(columns["easting_m"]) & np.isfinite(columns["northing_m"]))[0]
    return float(columns["easting_m"][first]), float(columns["northing_m"][first])


def _convert_to_local_metres(columns: Columns, reference: Place | None) -> Columns:
    """Return metres from the reference; raises LogError for values that are no longitude and latitude."""
    longitude, latitude = reference or find_first_place(columns)
    if abs(latitude) > 90.0 or abs(longitude) > 360.0:
        raise LogError(
            f"easting_m {longitude:g} and northing_m {latitude:g} are not a longitude and latitude; "
            f"remove the fix {LogConvention.POSITION_DEGREES}."
        )
    degrees = np.column_stack([columns[name] for name in _POSITIONS])
    metres = np.ascontiguousarray(project_to_metres(degrees, np.array([longitude, latitude])).T)
    return dict(zip(_POSITIONS, metres, strict=True))


def _convert_speeds(units_per_mps: float, *names: str) -> Conversion:
    return _convert_each(lambda values: values / units_per_mps, *names)


class LogConvention(StrEnum):
    """Readings in the order in which they are converted: name of the option, meaning, conversion, and ratios."""

    meaning: str
    convert: Conversion
    ratios: Band

    def __new__(
        cls, option: str, meaning: str, convert: Conversion, ratios: Band = (math.inf, math.inf)
    ) -> LogConvention:
        """Make an entry whose value is the name of its option."""
        entry = str.__new__(cls, option)
        entry._value_, entry.meaning, entry.convert, entry.ratios = option, meaning, convert, ratios
        return entry

    # Of steps to seconds. Logs have 1 to 200 Hz, so steps of 5 to 1000 ms, and each smaller unit has 1000 times more.
    TIME_MS = "time-ms", "time_s counts milliseconds", _convert_each(lambda t: t / 1e3, "time_s"), (5.0, 5e3)
    TIME_US = "time-us", "time_s counts microseconds", _convert_each(lambda t: t / 1e6, "time_s"), (5e3, 5e6)
    TIME_NS = "time-ns", "time_s counts nanoseconds", _convert_each(lambda t: t / 1e9, "time_s"), (5e6, math.inf)
    EAST_NORTH_SWAPPED = "east-north-swapped", "easting and northing are swapped", _exchange(*_POSITIONS)
    # Of the path to what was driven.
    POSITION_DEGREES = (
        "position-degrees", "easting_m and northing_m are longitude and latitude in degrees", _convert_to_local_metres,
        (0.0, 1e-4),
    )  # fmt: skip
    POSITION_KM = (
        "position-km", "easting_m and northing_m are in kilometres",
        _convert_each(lambda metres: metres * 1000.0, *_POSITIONS), (1e-4, 6e-3),
    )  # fmt: skip
    POSITION_FEET = (
        "position-feet", "easting_m and northing_m are in feet",
        _convert_each(lambda feet: feet * 0.3048, *_POSITIONS), (2.9, 3.7),
    )  # fmt: skip
    # Of a speed to that of the path: 3.6, with slip. A command may not be reached for long; where it is in another unit
    # than km/h it must be near.
    SPEED_KMH = "speed-kmh", "speeds are in km/h", _convert_speeds(KMH_PER_MPS, *_SPEEDS)
    SPEED_MEASURED_KMH = (
        "speed-measured-kmh", "speed_mps is in km/h", _convert_speeds(KMH_PER_MPS, "speed_mps"), (2.7, 4.8),
    )  # fmt: skip
    SPEED_COMMAND_KMH = (
        "speed-command-kmh", "speed_command_mps is in km/h",
        _convert_speeds(KMH_PER_MPS, "speed_command_mps"), (2.7, 6.0),
    )  # fmt: skip
    SPEED_MPH = "speed-mph", "speeds are in mph", _convert_speeds(MPH, *_SPEEDS)
    SPEED_MEASURED_MPH = (
        "speed-measured-mph", "speed_mps is in mph", _convert_speeds(MPH, "speed_mps"), (2.1, 2.7),
    )  # fmt: skip
    SPEED_COMMAND_MPH = (
        "speed-command-mph", "speed_command_mps is in mph", _convert_speeds(MPH, "speed_command_mps"), (2.13, 2.4),
    )  # fmt: skip
    SPEED_KNOTS = "speed-knots", "speeds are in knots", _convert_speeds(KNOTS, *_SPEEDS)
    SPEED_MEASURED_KNOTS = (
        "speed-measured-knots", "speed_mps is in knots", _convert_speeds(KNOTS, "speed_mps"), (1.85, 2.1),
    )  # fmt: skip
    SPEED_COMMAND_KNOTS = (
        "speed-command-knots", "speed_command_mps is in knots", _convert_speeds(KNOTS, "speed_command_mps"),
        (1.87, 2.07),
    )  # fmt: skip
    # Of turns of the heading to those of the path: a degree is 0.017; a frozen heading turns by 0.
    HEADING_RADIANS = (
        "heading-radians", "heading_deg is in radians",
        _convert_each(lambda heading: np.mod(np.degrees(heading), 360.0), "heading_deg"), (0.012, 0.025),
    )  # fmt: skip
    HEADING_CCW_EAST = (
        "heading-ccw-east", "heading_deg runs counter-clockwise from east",
        _convert_each(lambda heading: np.mod(90.0 - heading, 360.0), "heading_deg"),
    )  # fmt: skip
    HEADING_CCW_NORTH = (
        "heading-ccw-north", "heading_deg runs counter-clockwise from north",
        _convert_each(lambda heading: np.mod(0.0 - heading, 360.0), "heading_deg"),
    )  # fmt: skip
    HEADING_REVERSED = (
        "heading-reversed", "heading_deg points backwards",
        _convert_each(lambda heading: np.mod(heading + 180.0, 360.0), "heading_deg"),
    )  # fmt: skip
    STEERING_SWAPPED = (
        "steering-swapped", "steering_command_deg and steering_deg are swapped", _exchange(*STEERING_COLUMNS),
    )  # fmt: skip
    STEERING_RADIANS = (
        "steering-radians", "steering angles are in radians", _convert_each(np.degrees, *STEERING_COLUMNS),
    )  # fmt: skip
    STEERING_LEFT = (
        "steering-left-positive", "steering is positive to the left", _convert_each(np.negative, *STEERING_COLUMNS),
    )  # fmt: skip
    IMPLEMENT_REVERSED = (
        "implement-reversed", "implement is 1 where it is lifted and 0 where it works",
        _convert_each(lambda implement: 1.0 - implement, "implement"),
    )  # fmt: skip
    ROLL_LEFT = (
        "roll-left-down", "roll_deg is positive where the left side is lower", _convert_each(np.negative, "roll_deg"),
    )  # fmt: skip

    def explains(self, ratio: float) -> bool:
        """Whether a ratio is one that only this unit explains."""
        return self.ratios[0] <= ratio < self.ratios[1]


SPEED_UNITS = (
    (LogConvention.SPEED_KMH, LogConvention.SPEED_MEASURED_KMH, LogConvention.SPEED_COMMAND_KMH),
    (LogConvention.SPEED_MPH, LogConvention.SPEED_MEASURED_MPH, LogConvention.SPEED_COMMAND_MPH),
    (LogConvention.SPEED_KNOTS, LogConvention.SPEED_MEASURED_KNOTS, LogConvention.SPEED_COMMAND_KNOTS),
)
"""Units of both speeds, of the measured and of the commanded one alone."""


def convert_columns(columns: Columns, fixes: frozenset[LogConvention], reference: Place | None = None) -> Columns:
    """Return the columns in the contract's units and signs.

    Fixes are applied in the order of LogConvention. `reference` is the (longitude, latitude) in degrees that becomes
    the origin of positions given in degrees; by default the first position. Raises LogError.
    """
    out = dict(columns)
    for fix in LogConvention:
        if fix in fixes:
            out |= fix.convert(out, reference)
    return out


def convert_log(log: Log, fix: LogConvention) -> Log:
    """Return the log with one fix applied to all its columns."""
    names = ("time_s", *_POSITIONS, "heading_deg", "speed_mps", "speed_command_mps", *STEERING_COLUMNS, "implement")
    columns = {name: getattr(log, name) for name in names if getattr(log, name) is not None}
    first = int(np.flatnonzero(log.used)[0])
    changed: dict[str, Any] = dict(
        convert_columns(columns, frozenset([fix]), (float(log.easting_m[first]), float(log.northing_m[first])))
    )
    return replace(log, **changed)


def format_fix_option(fix: LogConvention) -> str:
    """Return the option that applies a fix, for use in a refusal."""
    return f"{mark_parameter('fixes')} {fix}"


@dataclass(frozen=True)
class Suspicion:
    """A convention that the log seems to break, and the evidence.

    `fix` is None when only the log itself can be corrected; `what` and `advice` then say what is suspected and what to
    do. With a fix, `advice` adds the other possible explanations.
    """

    fix: LogConvention | None
    why: str
    what: str = ""
    advice: str = ""

    def format_sentence(self) -> str:
        """Return what is suspected, why, and the fix, for a refusal."""
        if self.fix is None:
            return f"{self.what} ({self.why}); {self.advice}"
        other_readings = f" ({self.advice})" if self.advice else ""
        return f"{self.fix.meaning} ({self.why}); give {format_fix_option(self.fix)} to convert{other_readings}"
