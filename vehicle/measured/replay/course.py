"""Logs made ready for replay: stretches driven in one gear, on the simulation's own time grid."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from vehicle.effects import SLOPE_DRIFT, STEP_HZ
from vehicle.layout import DT_S
from vehicle.measured.errors import LogError
from vehicle.measured.logs.grade import grade
from vehicle.measured.logs.record import Array, Log, Rows
from vehicle.measured.logs.stretches import SHORTEST_S, driven_stretches
from vehicle.measured.logs.tilt import Tilt, tilt
from vehicle.measured.replay.steadying import steadied
from vehicle.measured.replay.towed import towed

CHORD_S = 0.6  # a centimetre of antenna noise is a degree of course at walking pace
Antenna = tuple[float, float]
_SHOWN_LOGS = 3  # of a refusal: more are counted


@dataclass(frozen=True, eq=False)
class Stretch:
    """A stretch of one run without gap or gear change. SI and radians, steering positive right, heading mathematical.

    Per row (k,): `time`, `east`, `north` (from the origin of the set), `heading` (continuous), `heading_seen` (False
    where the log has none and the course stands in), `speed`, `wheel`, `command`, `target`, `working`; a column that
    the log lacks is None. Per step of 1/60 s (n,): the same inputs in `grids`, and `across`, the slope of the ground to
    the right (m/m), where it was measured; a log with a slower receiver has more rows behind the grids, whose times and
    wheel angles are `logged_wheel`. `start_s` is the time since the start of the run at the first row. `gear` is 1, or
    -1 in reverse, where `speed` and `target` are negative and the heading points away from the way driven.
    """

    run: int
    start_s: float
    time: Array
    east: Array
    north: Array
    heading: Array
    heading_seen: bool
    speed: Array
    speed_seen: bool
    wheel: Array | None
    command: Array | None
    target: Array | None
    working: Array
    grids: dict[str, Array]
    gear: float = 1.0
    logged_wheel: tuple[Array, Array] | None = None

    @cached_property
    def direction(self) -> tuple[Array, Array]:
        """Cosine and sine of the heading on the grid (n,)."""
        return np.cos(self.grids["heading"]), np.sin(self.grids["heading"])

    @cached_property
    def steps_s(self) -> Array:
        """Times of the steps of the grid (n, s)."""
        return step_times(len(self.grids["speed"]))

    @cached_property
    def steady_wheel(self) -> Array:
        """The measured wheel angle on the grid (n,) without the noise of its sensor.

        Raises AttributeError where none was measured.
        """
        if self.wheel is None:
            raise AttributeError("A stretch without a measured wheel angle has none that is steadied either.")
        grid = np.arange(len(self.grids["wheel"])) * DT_S
        time, wheel = self.logged_wheel or (self.time, self.wheel)
        steady: Array = np.interp(grid, time, steadied(time, wheel))
        return steady

    @property
    def pace(self) -> Array:
        """Speed in the gear driven (k,): as the log has it, not below 0."""
        return self.gear * self.speed

    @property
    def rows(self) -> int:
        """Number of rows."""
        return len(self.time)


@dataclass(frozen=True, eq=False)
class Course:
    """All runs of a set: names, stretches, the origin taken off the positions, rows read, the ground's slope.

    `remarks` say what was made of roll and pitch.
    """

    names: tuple[str, ...]
    stretches: tuple[Stretch, ...]
    origin: tuple[float, float]
    rows_read: int
    tilt: Tilt = field(default_factory=Tilt)
    remarks: tuple[str, ...] = ()

    @property
    def places(self) -> dict[str, tuple[float, ...]]:
        """What is known beforehand of where effects are, by effect (see vehicle.measured.fit.knobs)."""
        return {SLOPE_DRIFT: self.tilt.plane} if self.tilt.known else {}

    @property
    def rows(self) -> int:
        """Rows in use."""
        return sum(one.rows for one in self.stretches)

    @property
    def seconds(self) -> float:
        """Driving time in use."""
        return float(sum(one.time[-1] - one.time[0] for one in self.stretches))

    def of(self, run: int) -> list[Stretch]:
        """Stretches of one run."""
        return [one for one in self.stretches if one.run == run]


def step_times(steps: int) -> Array:
    """Times (s) of so many steps.

    Over 60, not times DT_S: the last bit differs, and the last digits of a diagnosis with it.
    """
    return np.arange(steps, dtype=np.float64) / STEP_HZ


def make_course(logs: Sequence[Log], antenna: Antenna = (0.0, 0.0)) -> Course:
    """Stretches of all logs; `antenna` (m) is how far it stands ahead of the rear axle and to the right.

    Raises LogError when nothing long enough is left.
    """
    used = [log.used for log in logs]
    east = np.concatenate([log.easting_m[rows] for log, rows in zip(logs, used, strict=True)])
    north = np.concatenate([log.northing_m[rows] for log, rows in zip(logs, used, strict=True)])
    origin = (float(np.round(np.median(east))), float(np.round(np.median(north))))
    slopes, climbs, stretches = tilt(logs), grade(logs), list[Stretch]()
    for run, log in enumerate(logs):
        if climbs.share and log.speed_command_mps is not None:
            log = replace(log, speed_command_mps=log.speed_command_mps * climbs.share[run])
        across = slopes.across[run] if slopes.known else None
        for rows in driven_stretches(log)[0]:
            stretches.append(_stretch(log, rows, run, origin, antenna, None if across is None else across[rows]))
    if not stretches:
        raise LogError(_nothing_long(logs))
    rows_read = sum(len(log.used) for log in logs)
    ground = (*slopes.remarks, *climbs.remarks)
    return Course(tuple(log.name for log in logs), tuple(stretches), origin, rows_read, slopes, ground)


def _nothing_long(logs: Sequence[Log]) -> str:
    """Why no log has a stretch to replay: per log the rule that took most rows, of three logs at most."""
    why = []
    for log in logs[:_SHOWN_LOGS]:
        worst = max(log.gated, key=lambda one: one.rows, default=None)
        lost = "" if worst is None else (
            f", {worst.rows} of {len(log.used)} rows are lost to: {worst.rule} (first in line {worst.first_line})"
        )  # fmt: skip
        longest = max(
            (float(log.time_s[rows[-1]] - log.time_s[rows[0]]) for rows in driven_stretches(log)[1]), default=0.0
        )
        why.append(f"in {log.name} the longest lasts {longest:.1f} s{lost}")
    more = f"; and {len(logs) - _SHOWN_LOGS} more" if len(logs) > _SHOWN_LOGS else ""
    return (
        f"No log holds {SHORTEST_S:g} s driven in one gear without a gap: {'; '.join(why)}{more}; fill or leave out "
        "such columns, or log at least one such run."
    )


def _stretch(
    log: Log, rows: Rows, run: int, origin: tuple[float, float], antenna: Antenna, across: Array | None = None
) -> Stretch:
    """A stretch; `across` is the slope to the right per row, where it was measured."""
    time = log.time_s[rows] - log.time_s[rows[0]]
    east, north = log.easting_m[rows] - origin[0], log.northing_m[rows] - origin[1]
    gear = float(np.sign(log.shuttle[rows[0]]))
    course, pace = _course(time, east, north)
    if gear < 0.0:
        course += math.pi
    if log.heading_deg is None:
        heading = course - towed(time, course, pace, gear * antenna[0])
    else:
        heading = np.unwrap(math.pi / 2 - np.radians(log.heading_deg[rows]))
    if log.speed_mps is None:
        speed = gear * pace * np.cos(course - heading) - antenna[1] * np.gradient(heading, time)
    else:
        speed = gear * log.speed_mps[rows]
    columns = {
        "wheel": _angle(log.steering_deg, rows),
        "command": _angle(log.steering_command_deg, rows),
        "target": None if log.speed_command_mps is None else gear * log.speed_command_mps[rows],
        "across": across,
    }
    working = log.implement[rows]
    grids = on_grid(
        time, {"east": east, "north": north, "heading": heading, "speed": speed, "working": working, **columns}
    )
    wheel, fresh = columns["wheel"], slice(None) if log.fresh is None else log.fresh[rows]
    measured = {name: None if values is None else values[fresh] for name, values in columns.items()}
    return Stretch(
        run, float(log.time_s[rows[0]] - log.time_s[log.used][0]), time[fresh], east[fresh], north[fresh],
        heading[fresh], log.heading_deg is not None, speed[fresh], log.speed_mps is not None,
        measured["wheel"], measured["command"], measured["target"], working[fresh], grids, gear,
        None if log.fresh is None or wheel is None else (time, wheel),
    )  # fmt: skip


def _angle(column: Array | None, rows: Rows) -> Array | None:
    return None if column is None else np.radians(column[rows])


def _course(time: Array, east: Array, north: Array) -> tuple[Array, Array]:
    """Course over ground (continuous) and speed from positions, over chords of CHORD_S."""
    before, after = time - 0.5 * CHORD_S, time + 0.5 * CHORD_S
    before, after = np.maximum(before, time[0]), np.minimum(after, time[-1])
    dx = np.interp(after, time, east) - np.interp(before, time, east)
    dy = np.interp(after, time, north) - np.interp(before, time, north)
    pace = np.hypot(dx, dy) / (after - before)
    angle = np.arctan2(dy, dx)
    moving = np.flatnonzero(pace > 0.3 * float(np.median(pace)))
    if len(moving) == 0:
        return np.zeros(len(time)), pace
    course: Array = np.interp(np.arange(len(time)), moving, np.unwrap(angle[moving]))
    return course, pace


def on_grid(time: Array, columns: dict[str, Array | None]) -> dict[str, Array]:
    """Columns on the grid: measured values between rows by line, commands from halfway between two rows on.

    None stands for a column that the log lacks.
    """
    steps = math.ceil((time[-1] - time[0]) / DT_S) + 1
    grid = np.arange(steps) * DT_S
    middles = 0.5 * (time[1:] + time[:-1])
    nearest = np.searchsorted(middles, grid)
    grids = {}
    for name, values in columns.items():
        if values is not None:
            held = name in ("command", "target", "working")
            grids[name] = values[nearest] if held else np.interp(grid, time, values)
    return grids
