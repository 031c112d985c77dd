"""Logs of other vehicles: of another size than the given tractor, or turning otherwise than the model; and headings
that are only the course of the antenna.

No effect makes a tractor turn twice as tightly as its file says, and no wheel turns far beyond its lock. Logs that do
are of another vehicle, and any fitted cause would only compensate for its size.

A vehicle with one steered axle turns by the angle of its wheels alone, about an axle that does not move sideways. One
that bends in its middle turns with the change of the angle too, by r / (f + r), r and f from the joint to its axles, at
any speed and at rest (Corke and Ridley, IEEE Trans. Robotics and Automation 17(2), 2001). So does a heading that is the
course of an antenna a ahead of the axle, by a / base, and to it that antenna never moves sideways. Where rear wheels
steer, the axle that does not move sideways is a wheelbase further ahead.

Two numbers tell these apart: how far the heading turns with the change of the angle, and how far the antenna is ahead
of the axle that does not move sideways.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fields.arrays import Floats, Integers
from fields.errors import mark_parameter
from vehicle.datasheet.sheet import QUANTITIES
from vehicle.identification.errors import LogError
from vehicle.identification.faults.steering_evidence import (
    STEP_S,
    RunEvidence,
    build_run_evidence,
    fit_robustly,
    follow_command,
    shift,
)
from vehicle.identification.logs.directions import COURSE_HEADING
from vehicle.identification.logs.motion import (
    CLEAR_STEERING_DEG,
    compute_bends,
    compute_path_chords,
    find_largest_steering,
)
from vehicle.identification.logs.schema import Log
from vehicle.identification.logs.thresholds import (
    ALIKE_SHARE,
    DOUBT_SIGMAS,
    FEW_SHARE,
    FEWEST_LINE_CHORDS,
    FEWEST_LINE_ROWS,
    MAJORITY,
    MEASURED_SIGMAS,
    NEARLY_SHARE,
    READING_S,
    STEERING_SPREAD_DEG,
    SURE_SIGMAS,
    WINDOW_S,
)
from vehicle.model.effects import CATALOGUE, PATH, POSITION, STEERING, get_effect
from vehicle.model.tractor import Tractor

_CLEAR_ANGLE_DEG = 8.0  # chosen, of the steering: an offset, draft or slope of 3 degrees is less than half of it
_ROUGH_ERROR_SHARE = 1.0 - NEARLY_SHARE  # relative standard error of a ratio from such chords: surely within 40 %
_LOCK_SHARE = 1.0 + ALIKE_SHARE  # of the file's lock, and clear steering beyond that: more than errors of sensors
_COMMAND_SHARE = 2.0  # the same for commands, which controllers send beyond the lock
_LARGEST_LOCK_DEG, _SMALLEST_WHEELBASE_M = QUANTITIES["max_steering_deg"].high, QUANTITIES["wheelbase_m"].low
_MASSES_KG = (0.01, 200_000.0)  # limits of a tractor file
_COMMAND_LAG_SHARE = 1.0 / _COMMAND_SHARE  # least apparent gain where the wheels hardly reach the command
ARTICULATED, REAR_STEERED = "articulated", "rear_steered"
WINDOW_STEPS = round(READING_S / STEP_S)  # over which changes are taken
THIN_STEPS = 3  # between them
MOST_ROWS = 10_000
PIECE_STEPS = round(12.0 * WINDOW_S / STEP_S)  # two minutes
MOST_STEPS = 50 * PIECE_STEPS  # of longer logs pieces are looked at
MOST_HOLD_S = 0.5 * READING_S  # steering columns that change more rarely do not show when the angle moved
LEAST_MOVED_RAD = math.radians(40.0)  # root of the sum of squared changes that show how heading follows
MOST_WHEELBASES = 3.0  # driven in a window: then the path has forgotten how the angle changed
# Of 142 sets of two references, those without a joint show at most 0.04 rad per rad, those with one 0.35 to 0.65.
JOINT_SHARES, LEAST_NATS = (0.2, 0.85), 20.0
COURSE_SHARES = (0.4, 1.5)  # of a / base, as the course over a second or two shows it
STILL_SHARE, NEAR_STILL_SHARE = 0.03, 0.2  # of the antenna's distance: it does not move sideways
# Of the wheelbase: how near to the front axle; how well that is known, and the least lever.
_AT_AXLE_SHARE, KNOWN_SHARE = 0.15, FEW_SHARE
TRAILS_M = (2.5, 6.0)  # drawbars of drawn implements, which push the tractor until they have swung out
# Late (s), rate (deg/s) and lag (s) of the angle that the heading follows: by clocks and tyres, and after a command.
SENSED = tuple((0.1 * step, math.inf, lag_s) for step, lag_s in itertools.product(range(-6, 11), (0.0, 0.2, 0.4)))
COMMANDED = tuple(itertools.product((0.0, 0.15, 0.3, 0.5), (6.0, 10.0, 16.0, 30.0), (0.1, 0.3, 0.6)))
_JOINT_WORDS = (
    "These logs look like a vehicle that bends in its middle (articulated): its heading changes by {:.2f} degrees per "
    "degree of the steering angle at any speed; the model steers its front wheels, so causes between the wheels and "
    "the positions are not named."
)
_COURSE_WORDS = " If it does not bend, heading_deg is the course of the antenna: leave that column out."
_REAR_WORDS = (
    "These logs look like a vehicle that steers its rear wheels: the axle that does not move sideways is {0:.1f} m "
    "further ahead than the rear axle of the tractor file, where its front axle is; the model steers its front wheels, "
    "so neither the place of the antenna nor a delay of the positions is named. If the front wheels steer, the antenna "
    "is {0:.1f} m further back than the file says."
)
_FAKED_BY_REAR_WHEELS = frozenset(
    {"antenna_forward", "gnss_latency", "position_delay", "heading_delay", "heading_filter", "clock_offset_position",
     "clock_offset_heading"}
)  # fmt: skip


@dataclass(frozen=True)
class MeasuredSize:
    """Size shown by logs: curvature over the file's (None: not shown) and its error, largest angle, range of speeds."""

    bend_ratio: float | None
    bend_ratio_error: float
    angle_deg: float
    speed_mps: tuple[float, float]


def measure_size(logs: Sequence[Log], tractor: Tractor, ground: str) -> MeasuredSize:
    """Measure the size relative to a tractor file on a ground: measured over expected curvature, the slope of a line,
    or roughly of one through zero where the steering hardly varies."""
    parts = [np.empty((3, 0))]
    for log in logs:
        bends, chords = compute_bends(log), compute_path_chords(log)
        if bends is not None and chords is not None:
            parts.append(np.stack([*bends[:2], chords.speed]))
    angle, curvature, pace = np.concatenate(parts, axis=1)
    expected, is_clear = compute_file_curvature(angle, tractor, ground), np.abs(angle) >= _CLEAR_ANGLE_DEG
    ratio, error = None, math.inf
    if len(angle) >= FEWEST_LINE_CHORDS and float(np.std(angle)) >= STEERING_SPREAD_DEG:
        x, y = expected - expected.mean(), curvature - curvature.mean()
        slope, correlation = _fit_line_through_zero(x, y)
        if correlation > MAJORITY:  # a command that the path hardly follows says nothing about size
            ratio, error = slope, math.sqrt(2.0 * float(np.var(y - slope * x)) / float(x @ x))
    if ratio is None and np.count_nonzero(is_clear) >= FEWEST_LINE_CHORDS:
        slope, correlation = _fit_line_through_zero(expected[is_clear], curvature[is_clear])
        if correlation > MAJORITY:
            ratio, error = slope, _ROUGH_ERROR_SHARE * slope
    speeds = (float(np.quantile(pace, 0.05)), float(np.quantile(pace, 0.95))) if len(pace) else (0.0, 0.0)
    return MeasuredSize(ratio, error, max(map(find_largest_steering, logs)), speeds)


def _fit_line_through_zero(x: Floats, y: Floats) -> tuple[float, float]:
    """Return the slope of a line through 0 and the correlation of the points (k,)."""
    square = float(x @ x)
    return float(x @ y) / max(square, 1e-30), float(x @ y) / math.sqrt(square * float(y @ y) + 1e-30)


def compute_file_curvature(angle_deg: Floats, tractor: Tractor, ground: str) -> Floats:
    """Return the curvature (1/m, positive right) that the file gives for wheel angles, extrapolated beyond the lock."""
    if ground not in tractor.radius:
        return np.tan(np.radians(angle_deg)) / tractor.wheelbase_m
    law = tractor.get_power_law(ground)
    return np.array(
        [0.0 if abs(angle) < 1e-9 else math.copysign(1.0 / law.compute_radius_m(angle), angle) for angle in angle_deg]
    )


def explain_other_vehicle(logs: Sequence[Log], tractor: Tractor, ground: str) -> str:
    """Why the logs cannot be of this tractor, as a clause; empty where they can."""
    size = measure_size(logs, tractor, ground)
    gain_param = next(param for param in get_effect("steering_gain").params)
    file_gain = tractor.effects["steering_gain"].value["ratio"] if "steering_gain" in tractor.effects else 1.0
    sensed = all(log.steering_deg is not None for log in logs)
    least_gain = gain_param.low * file_gain * (1.0 if sensed else _COMMAND_LAG_SHARE)
    if size.bend_ratio is not None and not (
        least_gain <= size.bend_ratio + SURE_SIGMAS * size.bend_ratio_error
        and size.bend_ratio - SURE_SIGMAS * size.bend_ratio_error <= gain_param.high * file_gain
    ):
        return (
            f"at the same wheel angles their path bends {size.bend_ratio:.2g} times as much as the file of "
            f"{tractor.name} says, and faults of a tractor only explain {gain_param.low:g} to {gain_param.high:g}"
        )
    share = _LOCK_SHARE if sensed else _COMMAND_SHARE
    if size.angle_deg > share * tractor.max_steering_deg + CLEAR_STEERING_DEG:
        return (
            f"their wheels turn to {size.angle_deg:.0f} degrees, and the steering lock of {tractor.name} is at "
            f"{tractor.max_steering_deg:g}"
        )
    return ""


def refuse_other_vehicle(logs: Sequence[Log], tractor: Tractor, ground: str) -> None:
    """Raise LogError where the logs cannot be of this tractor, with the size that they suggest."""
    misfit = explain_other_vehicle(logs, tractor, ground)
    if not misfit:
        return
    suggested, speeds = scale_to_logs(logs, tractor, ground), measure_size(logs, tractor, ground).speed_mps
    slow_and_fast = dict.fromkeys(f"{speed:.2g}" for speed in speeds)
    radius = 1.0 / float(compute_file_curvature(np.array([suggested.max_steering_deg]), suggested, ground)[0])
    make = "write a tractor file of this size"
    if suggested.wheelbase_m >= _SMALLEST_WHEELBASE_M:
        make = "make a tractor file of this size with `headland tractor new`"
    raise LogError(
        f"These logs are not of this tractor: {misfit}. Driven at {' to '.join(slow_and_fast)} m/s, they suggest a "
        f"wheelbase of {suggested.wheelbase_m:.2g} m and a turning radius of {radius:.2g} m at "
        f"{suggested.max_steering_deg:.0f} degrees, the largest angle driven; {make}, name the right tractor, or give "
        f"{mark_parameter('as_driven')} to use this size.",
        parameter="tractor",
    )


def scale_to_logs(logs: Sequence[Log], tractor: Tractor, ground: str) -> Tractor:
    """Return the tractor scaled to the size that the logs suggest; unchanged where they fit it.

    All lengths scale with the wheelbase, the mass with its cube and forces with the mass: logs of a path do not show
    them. Radii are those driven at the same angles.
    """
    if not explain_other_vehicle(logs, tractor, ground):
        return tractor
    size = measure_size(logs, tractor, ground)
    scale = 1.0 / size.bend_ratio if size.bend_ratio else 1.0
    scale = min(max(scale, 0.01 / tractor.rear_axle_m), 30.0 / tractor.length_m)
    lengths = (
        "front_axle_m", "rear_axle_m", "track_m", "length_m", "width_m", "rear_overhang_m", "antenna_forward_m",
        "antenna_right_m",
    )  # fmt: skip
    changed: dict[str, object] = {name: getattr(tractor, name) * scale for name in lengths}
    mass = min(max(tractor.mass_kg * scale**3, _MASSES_KG[0]), _MASSES_KG[1])
    changed["mass_kg"] = mass
    changed["max_steering_deg"] = min(math.ceil(size.angle_deg), _LARGEST_LOCK_DEG)
    changed["radius"] = {
        name: {side: (factor / scale, power) for side, (factor, power) in (("right", law.right), ("left", law.left))}
        for name, law in tractor.radius.items()
    }
    forces = ("proportional_n_s_per_m", "integral_n_per_m", "derivative_n_s2_per_m", "max_drive_n")
    lengths_ahead = ("lookahead_m", "turn_lookahead_m", "lateral_limit_m")
    for part, names, (times, over) in (
        ("speed", forces, (mass, tractor.mass_kg)),
        ("guidance", lengths_ahead, (scale, 1.0)),
    ):
        own = getattr(tractor, part).model_dump()
        changed[part] = own | {name: own[name] * times / over for name in names}
    values = tractor.model_dump() | {"name": f"{tractor.name} as driven", "effects": {}, "discrepancy_model": None}
    return Tractor.model_validate(values | changed)


@dataclass(frozen=True)
class OtherTurning:
    """A vehicle that turns in another way than the model: ARTICULATED or REAR_STEERED, a sentence, and effects that
    only stand in for that in these logs."""

    kind: str
    words: str
    faked_ids: frozenset[str]


@dataclass(frozen=True)
class TurningMeasure:
    """What logs show, with standard errors; None where they do not show it.

    `joint_share`: turn of the heading per change of the angle (rad/rad); `nats`: how much likelier it makes the turns;
    `antenna_m`: how far the antenna is ahead of the axle that does not move sideways.
    """

    joint_share: float | None
    joint_error: float
    nats: float
    antenna_m: float | None
    antenna_error_m: float
    pace_mps: float


@dataclass(frozen=True, eq=False)
class _Windows:
    """Changes about the `chosen` rows (k,) of a run: heading (rad), path sideways and ahead (m)."""

    run: RunEvidence
    chosen: Integers
    turn: Floats
    aside: Floats
    ahead: Floats


def find_other_turning(logs: Sequence[Log], tractor: Tractor) -> OtherTurning | None:
    """Return how the vehicle of the logs turns; None where it turns by its front wheels, or the logs do not show it."""
    measure, base, ahead_m = measure_turning(logs), tractor.wheelbase_m, tractor.antenna_forward_m
    share, antenna = measure.joint_share, measure.antenna_m
    if not measure.pace_mps * WINDOW_STEPS * STEP_S < MOST_WHEELBASES * base:
        return None
    least = max(JOINT_SHARES[0], MEASURED_SIGMAS * measure.joint_error)
    if share is not None and least < abs(share) < JOINT_SHARES[1] and measure.nats > LEAST_NATS:
        is_still = antenna is not None and abs(antenna) < NEAR_STILL_SHARE * ahead_m
        words = _JOINT_WORDS.format(abs(share)) + (_COURSE_WORDS if is_still else "")
        # The effects between wheels and positions; without a wheel angle also those between command and wheels.
        blocks = {PATH, POSITION} | ({STEERING} if any(log.steering_deg is None for log in logs) else set())
        faked = frozenset(effect.id for effect in CATALOGUE if effect.block in blocks or effect.is_of_log_alone)
        return OtherTurning(ARTICULATED, words, faked)
    if antenna is None or measure.antenna_error_m > KNOWN_SHARE * base:
        return None
    is_rear = abs(antenna - ahead_m + base) <= _AT_AXLE_SHARE * base
    words = _REAR_WORDS.format(ahead_m - antenna)
    return OtherTurning(REAR_STEERED, words, _FAKED_BY_REAR_WHEELS) if is_rear else None


def drop_course_headings(logs: Sequence[Log], tractor: Tractor) -> list[Log]:
    """Return the logs without headings that are the course of the antenna, told in `corrections`: they turn with the
    angle as that does, and it does not move sideways. What a drive in reverse has shown of one holds for all."""
    ahead_m, is_course = tractor.antenna_forward_m, any(COURSE_HEADING in log.corrections for log in logs)
    if not is_course and ahead_m >= KNOWN_SHARE * tractor.wheelbase_m:
        measure = measure_turning(logs)
        low, high = (share * ahead_m / tractor.wheelbase_m for share in COURSE_SHARES)
        if measure.joint_share is not None and measure.antenna_m is not None:
            turns_alike = max(low, SURE_SIGMAS * measure.joint_error) < measure.joint_share < high
            most_m = STILL_SHARE * ahead_m + DOUBT_SIGMAS * measure.antenna_error_m
            is_known = measure.antenna_error_m <= KNOWN_SHARE * ahead_m
            is_course = is_known and turns_alike and abs(measure.antenna_m) < most_m
    return [
        log if log.heading_deg is None or not is_course else log.correct_columns(COURSE_HEADING, heading_deg=None)
        for log in logs
    ]


def measure_turning(logs: Sequence[Log]) -> TurningMeasure:
    """Measure how heading and antenna follow the wheel angle, in logs with a heading; nothing is known without one."""
    runs = [run for log in logs if log.heading_deg is not None and (run := build_run_evidence(log, math.inf))]
    runs = [run for run in runs if run.hold_s <= MOST_HOLD_S]
    sensed, commanded = ([run for run in runs if getattr(run, name) is not None] for name in ("wheel", "command"))
    is_sensed = len(sensed) >= len(commanded)
    runs = sensed if is_sensed else commanded
    thin = math.ceil(sum(len(run.time_s) for run in runs) / MOST_STEPS)
    if thin > 1:  # evenly chosen pieces of long runs: more of them tell nothing new
        runs = [run.cut(slice(begin, begin + PIECE_STEPS)) for run in runs
                for begin in range(0, len(run.time_s), PIECE_STEPS)][::thin]  # fmt: skip
    stride = THIN_STEPS * max(math.ceil(sum(len(run.time_s) for run in runs) / THIN_STEPS / MOST_ROWS), 1)
    windows, half = [], WINDOW_STEPS // 2
    for run in runs:
        assert run.heading is not None
        gaps = np.cumsum(np.append(0, ~run.known))
        places = np.arange(2 * half, len(run.time_s) - 2 * half, stride)
        chosen = places[gaps[places + 2 * half] == gaps[places - 2 * half]]
        turn = (shift(run.heading, half) - shift(run.heading, -half))[chosen]
        step = (shift(run.place, half) - shift(run.place, -half))[:, chosen]
        # The mean of the headings in a window, as its middle one has all the noise of one row.
        mean = np.mean([run.heading[chosen + steps] for steps in range(-half, half + 1)], axis=0)
        ahead = step[0] * np.sin(mean) + step[1] * np.cos(mean)
        windows.append(_Windows(run, chosen, turn, step[0] * np.cos(mean) - step[1] * np.sin(mean), ahead))
    if sum(len(one.turn) for one in windows) < FEWEST_LINE_ROWS:
        return TurningMeasure(None, math.inf, 0.0, None, math.inf, 0.0)
    pace_mps = float(np.median(np.abs(np.concatenate([one.ahead for one in windows])))) / (WINDOW_STEPS * STEP_S)
    return TurningMeasure(*_fit_joint(windows, is_sensed, stride), *_fit_antenna(windows), pace_mps)


def _fit_joint(windows: Sequence[_Windows], is_sensed: bool, stride: int) -> tuple[float | None, float, float]:
    """Return the turn per change of the angle, its standard error, and by how many nats it is likelier than none."""
    turn = np.concatenate([one.turn for one in windows])
    best, least, least_without = None, math.inf, math.inf
    for steering in SENSED if is_sensed else COMMANDED:
        columns = np.concatenate([_list_columns(one, is_sensed, *steering) for one in windows])
        if best is None and float(np.sqrt(np.sum(columns[:, 0] ** 2))) < LEAST_MOVED_RAD:
            return None, math.inf, 0.0
        fit = fit_robustly(columns, turn)
        least_without = min(least_without, fit_robustly(columns[:, 1:], turn)[2])
        if fit[2] < least:
            best, least = fit, fit[2]
    assert best is not None
    windows_apart = len(turn) * stride / WINDOW_STEPS  # windows overlap: so many say something of their own
    return float(best[0][0]), float(best[1][0]), 0.5 * windows_apart * math.log(least_without / least)


def _list_columns(windows: _Windows, is_sensed: bool, late_s: float, rate: float, lag_s: float) -> Floats:
    """Return what turns depend on (k, n) under a steering: the change of the angle, then the path by the angle."""
    half, time, run = WINDOW_STEPS // 2, windows.run.time_s, windows.run
    source = run.wheel if is_sensed else run.command
    assert source is not None
    if is_sensed:
        source, late_s, rate = np.interp(time - late_s, time, source), 0.0, 1e6
    angle = np.radians(follow_command(source, late_s, rate, lag_s, float(source[0])) if lag_s > 0.0 else source)
    moved = (shift(angle, half) - shift(angle, -half))[windows.chosen]
    speed = windows.ahead / (WINDOW_STEPS * STEP_S)
    pace = np.interp(time, time[windows.chosen], speed) if len(speed) else np.zeros(len(time))
    way_m, weights, trails = np.cumsum(np.abs(pace)) * STEP_S, np.exp(-0.1 * np.arange(60)), []
    for length_m in TRAILS_M:  # a drawn implement follows the angle over the way
        even_m = np.arange(0.0, way_m[-1] + length_m, 0.1 * length_m)
        along = np.interp(even_m, way_m, angle)
        padded = np.concatenate([np.full(59, along[0]), along])
        trails.append(np.interp(way_m, even_m, np.convolve(padded, weights / weights.sum(), mode="valid")))
    shapes = (angle, np.abs(angle), angle**3, angle * np.abs(angle), pace**2 * angle, np.ones(len(angle)), *trails)
    mean = np.full(WINDOW_STEPS + 1, WINDOW_STEPS * STEP_S / (WINDOW_STEPS + 1))
    bends = [np.convolve(pace * shape, mean, mode="same")[windows.chosen] for shape in shapes]
    return np.stack([moved, *bends, speed * moved], axis=1)


def _fit_antenna(windows: Sequence[_Windows]) -> tuple[float | None, float]:
    """Return how far ahead (m) of the axle without sideways motion the antenna is, and its standard error. Beside it: a
    bias of the heading, a position later than the heading, tyres that creep, all by their own columns."""
    turn, aside, ahead = np.concatenate([np.stack([one.turn, one.aside, one.ahead]) for one in windows], axis=1)
    if float(np.sqrt(np.sum(turn**2))) < LEAST_MOVED_RAD:
        return None, math.inf
    speed = ahead / (WINDOW_STEPS * STEP_S)
    columns = np.stack([turn, ahead, speed * turn, speed * np.abs(speed) * turn], axis=1)
    # One speed does not separate them: no position is later by more than tenths of a second, or tyres so soft.
    value, error, _ = fit_robustly(columns, aside, np.array([100.0, 1.0, 0.3, 0.05]))
    return float(value[0]), float(error[0])
