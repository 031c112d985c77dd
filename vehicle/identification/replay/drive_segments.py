"""Logs prepared for replay: segments driven in one gear, resampled on the simulation's time grid. A tractor made ready
for it: what planning compiles of it, with effects in it or without.

Where no heading was logged it is the course of the antenna and the angle from the heading to that course. The rear axle
follows the antenna like a load on a rod, so its direction is a tractrix of the antenna's path: over a straight piece of
length s the angle b between rod and path shrinks as tan(b/2) exp(-s/length).

Windows of 20 s take turns in fitting a model and in being simulated with it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from fields.arrays import Flags, Floats, Integers
from fields.errors import MAX_NAMED
from vehicle.identification.errors import LogError
from vehicle.identification.logs.schema import GAP_SAMPLES, SHORTEST_SEGMENT_S, Log, split_drive_segments
from vehicle.identification.logs.series import compute_change, denoise_angles, measure_spread
from vehicle.identification.logs.terrain import CrossSlope, estimate_cross_slope, estimate_grade_speed
from vehicle.identification.logs.thresholds import ALIKE_SHARE, GRID_S, TURN_S, WHEEL_NOISE_DEG
from vehicle.jit import compile_function
from vehicle.model.effects import SLOPE_DRIFT, STEERING_CLOCK
from vehicle.model.ground import find_ground_index
from vehicle.model.tractor import (
    Implement,
    LogCorrections,
    Settings,
    Tractor,
    get_log_corrections,
    remove_log_corrections,
)
from vehicle.records import DT_S, HISTORY_STEPS
from vehicle.sim.calibration import build_steering_tables
from vehicle.sim.compile import build_ground_records, build_model_record

# Chosen: a chord that noise alone makes as long in one of 600 rows has no direction; a tractor that stands has none.
_STANDING_SIGMAS = 3.6
# Chosen: held positions and tight bends look like noise, which is not so fast.
_DRIVING_MPS = 0.5
COURSE_CHORD_S = 0.6  # one centimetre of antenna noise is one degree of course at walking pace
_MOST_ANGLE_RAD = math.radians(60.0)  # no tractor turns tighter

Antenna = tuple[float, float]

_STANDING_S = 2.0 * GRID_S  # chosen: wheels that follow a command move by more than noise meanwhile
WHEEL_LEAD_S = -0.05  # wheels that move so much before their command are stamped by another clock
_WHEEL_LAGS_S = np.arange(-1.0, 1.55, 0.05)
HORIZONS_S = (1.0, 5.0, 10.0, 20.0)  # over which errors are compared: from a moment to a short swath at 5 km/h
WINDOW_S = HORIZONS_S[-1]  # so that no error piece lies in two windows


@dataclass(frozen=True, eq=False)
class DriveSegment:
    """Part of a run without gap or gear change. SI and radians, steering positive right, heading mathematical.

    Per row (k,): `time`, `east`, `north` (from the origin of the dataset), `heading` (continuous), `heading_measured`
    (False where the log has none and the course replaces it), `speed`, `wheel`, `command`, `target`, `working`; a
    column that the log lacks is None. Per step of 1/60 s (n,): the same inputs in `grids`, and `across`, the measured
    slope of the ground to the right (m/m), if any. A log with a slower receiver has more rows than positions; their
    times and wheel angles are `logged_wheel`. `start_s` is the time since the start of the run at the first row. `gear`
    is 1, or -1 in reverse, where `speed` and `target` are negative and the heading is opposite to the direction of
    travel. `measured_rows` are the rows (k,) in which columns were measured that are slower than the log; see
    _select_measured_rows. `earlier_commands` (m,) are those of the steps of the grid before the first row, as far back
    as a delay reaches, which a delayed steering still follows.
    """

    run: int
    start_s: float
    time: Floats
    east: Floats
    north: Floats
    heading: Floats
    heading_measured: bool
    speed: Floats
    speed_measured: bool
    wheel: Floats | None
    command: Floats | None
    target: Floats | None
    working: Floats
    grids: dict[str, Floats]
    gear: float = 1.0
    logged_wheel: tuple[Floats, Floats] | None = None
    measured_rows: Mapping[str, Flags] = field(default_factory=dict)
    earlier_commands: Floats = field(default_factory=lambda: np.empty(0))

    @property
    def steps_s(self) -> Floats:
        """Times of the steps of the grid (n, s)."""
        return np.asarray(np.arange(len(self.grids["speed"])) * DT_S, dtype=np.float64)

    @cached_property
    def denoised_wheel_angle(self) -> Floats:
        """The measured wheel angle on the grid (n,), denoised; raises AttributeError where none was measured."""
        if self.wheel is None:
            raise AttributeError("This segment has no measured wheel angle.")
        time, wheel = self.logged_wheel or (self.time, self.wheel)
        return np.asarray(np.interp(self.steps_s, time, denoise_angles(time, wheel)))

    @property
    def speed_in_gear(self) -> Floats:
        """Logged speed in the gear driven (k,), at least 0."""
        return self.gear * self.speed

    @property
    def rows(self) -> int:
        """Number of rows."""
        return len(self.time)


@dataclass(frozen=True, eq=False)
class DriveDataset:
    """All runs: names, segments, the origin subtracted, rows read, the ground's slope, sentences on its use, and the
    time (s) of the first used row of every run."""

    names: tuple[str, ...]
    segments: tuple[DriveSegment, ...]
    origin: tuple[float, float]
    rows_read: int
    cross_slope: CrossSlope = field(default_factory=CrossSlope)
    remarks: tuple[str, ...] = ()
    run_starts_s: Floats = field(default_factory=lambda: np.empty(0))

    @cached_property
    def effect_places(self) -> dict[str, tuple[float, ...]]:
        """Known places of effects, by effect (see EffectKind.get_kind_for_place)."""
        places: dict[str, tuple[float, ...]] = {}
        if self.cross_slope.across:
            places[SLOPE_DRIFT] = self.cross_slope.mean_plane
        if (lag_s := measure_wheel_lag(self.segments)) < WHEEL_LEAD_S:
            places[STEERING_CLOCK] = (lag_s,)
        return places

    @property
    def rows(self) -> int:
        """Number of used rows."""
        return sum(segment.rows for segment in self.segments)

    @property
    def seconds(self) -> float:
        """Driving time used."""
        return float(sum(segment.time[-1] - segment.time[0] for segment in self.segments))

    @property
    def has_speed(self) -> bool:
        """Whether all speeds were measured."""
        return all(segment.speed_measured for segment in self.segments)


def measure_wheel_lag(segments: Sequence[DriveSegment]) -> float:
    """Return the lag (s) at which wheel angles are most alike commands, inf without both or where both hardly move."""
    misfits, known = np.zeros(len(_WHEEL_LAGS_S)), False
    for segment in segments:
        if segment.wheel is None or segment.command is None or "wheel" in segment.measured_rows:
            continue
        steps_s, wheel, command = segment.steps_s, segment.grids["wheel"], segment.grids["command"]
        inside = (steps_s > 1.5) & (steps_s < steps_s[-1] - 1.5)
        if not inside.any() or float(np.std(command[inside])) < math.radians(1.0):
            continue
        known = True
        for place, lag in enumerate(_WHEEL_LAGS_S):
            late = np.interp(steps_s[inside][::6] + lag, steps_s, wheel)
            misfits[place] += float(np.abs(late - command[inside][::6]).sum())
    return float(_WHEEL_LAGS_S[int(np.argmin(misfits))]) if known else math.inf


def build_dataset(logs: Sequence[Log], antenna: Antenna = (0.0, 0.0)) -> DriveDataset:
    """Build segments; `antenna` (m) is ahead of the rear axle and to the right. Raises LogError where all are short."""
    used = [log.used for log in logs]
    east = np.concatenate([log.easting_m[rows] for log, rows in zip(logs, used, strict=True)])
    north = np.concatenate([log.northing_m[rows] for log, rows in zip(logs, used, strict=True)])
    origin = (float(np.round(np.median(east))), float(np.round(np.median(north))))
    cross_slope, (speed_share, grade_remarks) = estimate_cross_slope(logs), estimate_grade_speed(logs)
    segments = list[DriveSegment]()
    for run, log in enumerate(logs):
        if speed_share and log.speed_command_mps is not None:
            log = replace(log, speed_command_mps=log.speed_command_mps * speed_share[run])
        across = cross_slope.across[run] if cross_slope.across else None
        for rows in split_drive_segments(log)[0]:
            segments.append(_build_segment(log, rows, run, origin, antenna, None if across is None else across[rows]))
    if not segments:
        reasons = []
        for log in logs[:MAX_NAMED]:
            lasts_s = (float(log.time_s[rows[-1]] - log.time_s[rows[0]]) for rows in split_drive_segments(log)[1])
            reasons.append(f"in {log.name} the longest lasts {max(lasts_s, default=0.0):.1f} s")
            if log.gated:
                worst = max(log.gated, key=lambda one: one.rows)
                reasons[-1] += f", {worst.rows} of {len(log.used)} rows are unusable: {worst.rule} (first in line "
                reasons[-1] += f"{worst.first_line})"
        more_logs = f"; and {len(logs) - MAX_NAMED} more" if len(logs) > MAX_NAMED else ""
        raise LogError(
            f"No log holds {SHORTEST_SEGMENT_S:g} s driven in one gear without a gap: {'; '.join(reasons)}{more_logs}; "
            "fill or leave out such columns, or log at least one such run."
        )
    rows_read = sum(len(log.used) for log in logs)
    ground = (*cross_slope.remarks, *grade_remarks)
    starts_s = np.array([float(log.time_s[log.used][0]) if log.used.any() else 0.0 for log in logs])
    names = tuple(log.name for log in logs)
    return DriveDataset(names, tuple(segments), origin, rows_read, cross_slope, ground, starts_s)


def _build_segment(
    log: Log, rows: Integers, run: int, origin: tuple[float, float], antenna: Antenna, across: Floats | None = None
) -> DriveSegment:
    """Build one segment; `across` is the measured slope to the right per row, if any."""
    time = log.time_s[rows] - log.time_s[rows[0]]
    east, north = log.easting_m[rows] - origin[0], log.northing_m[rows] - origin[1]
    gear = float(np.sign(log.shuttle[rows[0]]))
    course, pace = compute_course(time, east, north)
    if gear < 0.0:
        course += math.pi
    if log.heading_deg is None:
        heading = course - compute_course_offset(time, course, pace, gear * antenna[0])
    else:
        heading = np.unwrap(math.pi / 2 - np.radians(log.heading_deg[rows]))
    if log.speed_mps is None:
        speed = gear * pace * np.cos(course - heading) - antenna[1] * np.gradient(heading, time)
    else:
        speed = gear * log.speed_mps[rows]
    columns: dict[str, Floats | None] = {"east": east, "north": north, "heading": heading, "speed": speed}
    columns |= {
        "wheel": None if log.steering_deg is None else np.radians(log.steering_deg[rows]),
        "command": None if log.steering_command_deg is None else np.radians(log.steering_command_deg[rows]),
        "target": None if log.speed_command_mps is None else gear * log.speed_command_mps[rows],
        "working": log.implement[rows],
    }
    wheel, fresh = columns["wheel"], slice(None) if log.fresh is None else log.fresh[rows]
    measured: dict[str, Any] = {name: None if values is None else values[fresh] for name, values in columns.items()}
    return DriveSegment(
        run=run,
        start_s=float(log.time_s[rows[0]] - log.time_s[log.used][0]),
        time=time[fresh],
        heading_measured=log.heading_deg is not None,
        speed_measured=log.speed_mps is not None,
        grids=resample_on_grid(time, columns | {"across": across}),
        gear=gear,
        logged_wheel=None if log.fresh is None or wheel is None else (time, wheel),
        measured_rows=_select_measured_rows(log, rows, fresh),
        earlier_commands=_select_earlier_commands(log, rows),
        **measured,
    )


def _select_earlier_commands(log: Log, rows: Integers) -> Floats:
    """Return the commands (m, rad) on the grid before the first of the rows, used for a replay or not, up to a gap.
    After a gap, or at the start of a log, wheels that stand had reached the command before."""
    command, row = log.steering_command_deg, int(rows[0])
    if command is None:
        return np.empty(0)
    time = log.time_s[: row + 1] - log.time_s[row]
    with np.errstate(invalid="ignore"):
        steps = np.diff(time)
        known = (steps > 0.0) & (steps <= GAP_SAMPLES * log.step_s) & np.isfinite(command[:row])
        known &= time[:-1] >= -HISTORY_STEPS * DT_S
    first = row - (int(np.argmin(known[::-1])) if not known.all() else row)
    if first == row:
        if log.steering_deg is None:
            return np.empty(0)
        begun = rows[log.time_s[rows] <= log.time_s[rows[0]] + max(_STANDING_S, 1.5 * log.step_s)]
        if float(np.ptp(log.steering_deg[begun])) > WHEEL_NOISE_DEG:
            return np.empty(0)
        return np.full(HISTORY_STEPS, math.radians(float(log.steering_deg[rows[0]])))
    time, command = time[first:], command[first : row + 1]
    grid = -DT_S * np.arange(math.floor(-time[0] / DT_S), 0, -1)
    return np.asarray(np.radians(command)[np.searchsorted(0.5 * (time[1:] + time[:-1]), grid)])


def _select_measured_rows(log: Log, rows: Integers, fresh: slice | Flags) -> dict[str, Flags]:
    """Return the rows of a segment in which its slower columns were measured, or the next ones with a position.

    A wheel angle is compared with commands, so it counts (`wheel`) in the rows of find_compared_rows; `angle` are the
    rows in which it was measured itself.
    """
    names = {"angle": "steering_deg", "command": "steering_command_deg", "speed": "speed_mps"}
    measured = {name: log.measured_rows[column][rows] for name, column in names.items() if column in log.measured_rows}
    if ("angle" in measured or "command" in measured) and log.steering_command_deg is not None:
        all_rows = np.ones(len(rows), dtype=np.bool_)
        measured["wheel"] = find_compared_rows(
            measured.get("angle", all_rows), measured.get("command", all_rows), log.steering_command_deg[rows]
        )
    positions, out = np.arange(len(rows))[fresh], {}
    for name, mask in measured.items():
        next_rows = np.searchsorted(positions, np.flatnonzero(mask))
        out[name] = np.zeros(len(positions), dtype=np.bool_)
        out[name][next_rows[next_rows < len(positions)]] = True
    return out


def find_compared_rows(angle: Flags, commanded: Flags, command: Floats) -> Flags:
    """Return the rows (k,) in which a wheel angle says something of its own about the commands (k,), from the rows in
    which either was measured.

    That is every angle while the command stands still, and the last one between two that differ: all of those depend on
    the same guess of what was commanded in between.
    """
    rows, knots = np.flatnonzero(angle), np.flatnonzero(commanded)
    next_knots = np.searchsorted(knots, rows)
    is_known = (next_knots > 0) & (next_knots < len(knots))
    before, after = (knots[np.clip(next_knots + shift, 0, len(knots) - 1)] for shift in (-1, 0))
    is_still = is_known & ((command[before] == command[after]) | (after - before == 1))
    is_last = np.append(np.diff(next_knots) > 0, True) & (is_known | np.isin(rows, knots))
    out = np.zeros(len(angle), dtype=np.bool_)
    out[rows[is_still | is_last]] = True
    return out


def resample_on_grid(time: Floats, columns: dict[str, Floats | None]) -> dict[str, Floats]:
    """Resample columns (None: not logged) on the grid, commands held from halfway between two rows."""
    steps = math.ceil((time[-1] - time[0]) / DT_S) + 1
    grid = np.arange(steps) * DT_S
    middles = 0.5 * (time[1:] + time[:-1])
    nearest = np.searchsorted(middles, grid)
    grids = {}
    for name, values in columns.items():
        if values is not None:
            is_held = name in ("command", "target", "working")
            grids[name] = values[nearest] if is_held else np.interp(grid, time, values)
    return grids


def compute_half_numbers(seconds: Floats) -> Integers:
    """Return the half (0 or 1) of times since the start of a segment: its windows, counted from 0, alternate."""
    return (seconds / WINDOW_S).astype(np.int64) % 2


def compute_course(time: Floats, east: Floats, north: Floats) -> tuple[Floats, Floats]:
    """Return course over ground (continuous) and speed from positions, over chords of COURSE_CHORD_S."""
    before, after = time - 0.5 * COURSE_CHORD_S, time + 0.5 * COURSE_CHORD_S
    before, after = np.maximum(before, time[0]), np.minimum(after, time[-1])
    dx, dy = (compute_change(time, axis, before, after) for axis in (east, north))
    pace = np.hypot(dx, dy) / (after - before)
    angle = np.arctan2(dy, dx)
    # The noise of positions (m) from row to row shows in their third differences.
    thirds = np.concatenate([np.diff(east, 3), np.diff(north, 3)])
    noise = measure_spread(thirds) / math.sqrt(20.0) if len(thirds) else 0.0
    noise_pace = _STANDING_SIGMAS * math.sqrt(2.0) * noise / COURSE_CHORD_S
    fastest = float(pace.max())
    if fastest > _DRIVING_MPS:
        noise_pace = min(noise_pace, ALIKE_SHARE * fastest)
    moving = np.flatnonzero(pace > max(0.3 * float(np.median(pace)), noise_pace))
    if len(moving) == 0:
        return np.zeros(len(time)), pace
    course: Floats = np.interp(np.arange(len(time)), moving, np.unwrap(angle[moving]))
    return course, pace


def compute_course_offset(time: Floats, course: Floats, pace: Floats, length: float) -> Floats:
    """Return the angle (k, rad) from the heading to the antenna's course; `length` (m) is from the rear axle to the
    antenna, negative where it trails the axle."""
    out = np.zeros(len(time))
    if length == 0.0 or len(time) < 2:
        return out
    distances = 0.5 * (pace[1:] + pace[:-1]) * np.diff(time)
    # Behind the axle the rod is pushed, which is unstable; backwards in time it is pulled.
    step, length = (1 if length > 0.0 else -1), abs(length)
    since = time if step > 0 else time[-1] - time[::-1]
    course, distances = course[::step].copy(), distances[::step].copy()
    # The angle at the first row is as on a circle with the curvature of the path there.
    rows = min(int(np.searchsorted(since, TURN_S)), len(distances))
    path_length = float(distances[:rows].sum())
    bend = float(course[rows] - course[0]) / path_length if path_length > 0.1 * length else 0.0
    most_sine = math.sin(_MOST_ANGLE_RAD)
    first = math.asin(min(max(length * bend, -most_sine), most_sine))
    _compute_pulled_rod_angles(course, distances, length, first, out)
    return out[::step].copy()


@compile_function
def _compute_pulled_rod_angles(course, distances, length, first, out) -> None:  # type: ignore[no-untyped-def]
    """Return the angles (k,) between path and rod, pulled along courses (k,) and distances between them (k - 1,)."""
    out[0] = angle = first
    for k in range(len(distances)):
        turned = 0.5 * (course[k + 1] - course[k])
        angle = 2.0 * math.atan(math.tan(0.5 * (angle + turned)) * math.exp(-distances[k] / length)) + turned
        out[k + 1] = angle


# --- the tractor -------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class ReplayRig:
    """A tractor ready for replay: its compiled model without effects, the ground, the steering table, and limits to
    where a discrepancy model was observed; one that is still being fitted has none."""

    tractor: Tractor
    model: Any
    ground: Any
    table: Floats
    origin: tuple[float, float] = (0.0, 0.0)
    ranges: Mapping[str, float] = field(default_factory=dict)

    def build_effective_model(self, settings: Settings) -> Any:
        """Build the model record with effects; places in the field are moved to the origin of the dataset."""
        model = self.model.copy()
        fields = LogCorrections(settings, self.ranges).fields
        fields["affected"] = 1.0
        fields["patch_east"] -= self.origin[0]
        fields["patch_north"] -= self.origin[1]
        for name, value in fields.items():
            model[0][name] = value
        return model


def build_rig(tractor: Tractor, ground: str, origin: tuple[float, float]) -> ReplayRig:
    """Build the rig of a tractor without the effects learnt from logs; raises VehicleError for an unknown ground."""
    bare = remove_log_corrections(tractor)
    index = find_ground_index(ground)
    model = np.zeros(1, dtype=build_model_record(bare, Implement()).dtype)
    model[0] = build_model_record(bare, Implement())
    return ReplayRig(bare, model, build_ground_records()[index : index + 1], build_steering_tables(bare)[index], origin)


def build_rig_and_corrections(tractor: Tractor, ground: str, origin: tuple[float, float]) -> tuple[ReplayRig, Settings]:
    """Build the rig of a tractor, with the ranges of its discrepancy model, and return what its file has from logs."""
    learnt_effects = get_log_corrections(tractor)
    return replace(build_rig(tractor, ground, origin), ranges=learnt_effects.ranges), learnt_effects.settings
