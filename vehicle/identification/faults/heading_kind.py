"""What a heading column is where it is no heading: the course of the positions, or the sum of a gyroscope.

The course of an antenna a ahead of the axle leaves the heading by atan(a tan(angle) / base). Logged as a heading it
turns with the wheel angle itself, by a / base, and to it the antenna never moves sideways. A vehicle that bends in its
middle with its antenna above its front axle has such headings too, and its positions are those of such a tractor.

A gyroscope whose scale is off turns by a share more, or less, than the course does. A compass that is wrong by the
direction it points to does so too where a field is driven in loops of one kind; its own columns take that: iron that is
magnetic turns its needle to and fro once per turn, iron that is not does so twice.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vehicle.identification.faults.steering_evidence import (
    COURSE_TURN_S,
    LEAST_PACE_MPS,
    STEP_S,
    SteeringEvidence,
    build_evidence_segments,
    find_largest_angles,
)
from vehicle.identification.faults.turning_kind import KNOWN_SHARE, fit_robustly, measure_turning
from vehicle.identification.logs.directions import COURSE_HEADING
from vehicle.identification.logs.schema import Array, Log
from vehicle.model.tractor import Tractor

# Chosen, of the wheelbase: an antenna nearer to the axle goes where the tractor points. Of the turn that the course of
# an antenna should have: the mean of a second or two lowers it; headings of 60 other sets reach a seventh.
_LEAST_LEVER_SHARE, _COURSE_SHARES = 0.1, (0.4, 1.5)
# Chosen, of the lever and times its standard error: a jointed vehicle has its antenna so near to its front axle only by
# chance.
_STILL_SHARE, _STILL_SIGMAS, _TURNING_SIGMAS = 0.03, 2.0, 4.0
# Chosen: a U-turn fits in, and a heading that a receiver holds in the long run forgets little.
_WINDOW_S, _THIN_S = 12.0, 0.3
# Chosen: 75 sets of three references without such a gyroscope show at most 0.5 %; scales of 1.6 to 2.9 % show 0.9 to
# 1.9 %, four to seven times its standard error.
_LEAST_SCALE, _SCALE_SIGMAS = 0.008, 4.0
_LEFT_SHARE = 0.5  # chosen: beside two swings per turn nine tenths of a scale are left, and nothing of what they faked
_WINDOWS_PER_ONE = math.sqrt(_WINDOW_S / _THIN_S)  # windows overlap; in errors so many of them are one
# Chosen, rad: 60 sets without such a compass show less than 5 standard errors; one of 3 degrees shows 13.
_LEAST_SWING, _SWING_SIGMAS = math.radians(1.0), 7.0


def drop_course_headings(logs: Sequence[Log], tractor: Tractor) -> list[Log]:
    """Return the logs without headings that are the course of the antenna, which `corrections` tell.

    What a drive in reverse has shown of one log holds for all of a set.
    """
    is_known = any(COURSE_HEADING in log.corrections for log in logs)
    if not is_known and not _has_course_headings(logs, tractor):
        return list(logs)
    return [
        log
        if log.heading_deg is None
        else replace(log, heading_deg=None, corrections=(*log.corrections, COURSE_HEADING))
        for log in logs
    ]


def _has_course_headings(logs: Sequence[Log], tractor: Tractor) -> bool:
    """Whether the headings turn with the angle as the course of the antenna does, and it does not move sideways."""
    ahead_m = tractor.antenna_forward_m
    if ahead_m < _LEAST_LEVER_SHARE * tractor.wheelbase_m:
        return False
    measure = measure_turning(logs)
    if measure.joint_share is None or measure.antenna_m is None or measure.antenna_error_m > KNOWN_SHARE * ahead_m:
        return False
    low, high = (share * ahead_m / tractor.wheelbase_m for share in _COURSE_SHARES)
    turns_alike = max(low, _TURNING_SIGMAS * measure.joint_error) < measure.joint_share < high
    return turns_alike and abs(measure.antenna_m) < _STILL_SHARE * ahead_m + _STILL_SIGMAS * measure.antenna_error_m


def find_heading_scale(logs: Sequence[Log]) -> float | None:
    """Return by what share the headings turn more than the course, where they clearly do as of a gyroscope; else
    None.

    Two swings per turn of a compass look like a scale in some loops; a delay does so beside them. So a scale is clear
    without the swings, and is left beside them.
    """
    rows = _collect_changes(logs)
    if len(rows) < _WINDOW_S / _THIN_S:
        return None
    (scale, sigma), (beside, _) = _fit_scale(rows[:, :-2]), _fit_scale(rows)
    is_clear = abs(scale) > max(_LEAST_SCALE, _SCALE_SIGMAS * sigma)
    return scale if is_clear and beside / scale > _LEFT_SHARE else None


def find_double_swing(logs: Sequence[Log]) -> float | None:
    """Return by how much (rad) headings leave the course to and fro twice per turn, where they clearly do; else None.

    A drift across a slope does so once per turn, a delay with the rate of turning.
    """
    rows = _collect_changes(logs)
    if len(rows) < _WINDOW_S / _THIN_S:
        return None
    value, error, _ = fit_robustly(rows[:, 1:], rows[:, 0])
    error = error * _WINDOWS_PER_ONE
    if abs(value[0]) > _SCALE_SIGMAS * error[0]:
        return None
    swing = math.hypot(*value[-2:])
    return swing if swing > max(_LEAST_SWING, _SWING_SIGMAS * float(np.max(error[-2:]))) else None


def _fit_scale(rows: Array) -> tuple[float, float]:
    """Return by what share headings turn more than the course, and its standard error; see _compare_ends."""
    value, error, _ = fit_robustly(rows[:, 1:], rows[:, 0])
    return float(value[0]), float(error[0]) * _WINDOWS_PER_ONE


def _collect_changes(logs: Sequence[Log]) -> Array:
    """Return the rows (k, 9) of all logs with a heading; see _compare_ends."""
    locks = find_largest_angles(logs)
    windows = [
        _compare_ends(log, part)
        for log in logs
        if log.heading_deg is not None
        for part in build_evidence_segments(log, locks)
    ]
    return np.concatenate([np.zeros((0, 9)), *windows])


def _compare_ends(log: Log, part: SteeringEvidence) -> Array:
    """Return a row (k, 9) per window: by how much heading minus course changes (rad), and what may change it.

    These are the turn of the heading (rad); curvature, rate of turning and the same by the speed, for the lever of the
    antenna, a delay, and creeping tyres; and two directions of a compass, for one swing per turn and for two.
    """
    assert log.heading_deg is not None
    used, half = np.flatnonzero(log.used), round(0.5 * COURSE_TURN_S / STEP_S)
    heading = np.interp(part.time_s, log.time_s[used], np.unwrap(np.radians(log.heading_deg[used])))
    # A course is that of a chord: it compares with the mean of the headings along it, and the lever with their turn.
    mean = np.convolve(heading, np.full(2 * half + 1, 1.0 / (2 * half + 1)), mode="same")
    rate = np.full(len(heading), np.nan)
    rate[half:-half] = (heading[2 * half :] - heading[: -2 * half]) / COURSE_TURN_S
    apart = np.radians(part.heading_error) + mean - heading
    curvature = rate / np.maximum(part.pace, LEAST_PACE_MPS)
    swings = (np.sin(mean), np.cos(mean), np.sin(2.0 * mean), np.cos(2.0 * mean))
    columns = (apart, mean, curvature, rate, part.pace * rate, *swings)
    reach = round(_WINDOW_S / STEP_S)
    rows = np.arange(half, len(heading) - reach - half, round(_THIN_S / STEP_S))
    changes = np.array([column[rows + reach] - column[rows] for column in columns]).T
    finite: Array = changes[np.isfinite(changes).all(axis=1)]
    return finite
