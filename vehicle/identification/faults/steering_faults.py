"""Steering that stops following its commands during a run, told from a wheel sensor that stops.

A wheel angle, or the angle that the path needs, must stay within what commands allow. Beyond that by degrees, for
seconds, is no effect of the catalogue: those are late, slow, or a share of the angle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vehicle.identification.faults.angle_deviation import AngleDeviations
from vehicle.identification.faults.following_change import FollowingChange, find_following_changes
from vehicle.identification.faults.heading_jumps import correct_heading_jumps
from vehicle.identification.faults.level_steps import mark_level_step
from vehicle.identification.faults.steering_evidence import (
    STEP_S,
    TURN_S,
    PathScale,
    SteeringEvidence,
    build_evidence_segments,
    find_largest_angles,
    fit_path_scale,
)
from vehicle.identification.faults.thresholds import (
    FAULT_JOIN_S,
    FAULT_LEAST_S,
    FAULT_NEEDED_SIGMAS,
    FAULT_SHARE_LEFT,
    FAULT_SHARE_MORE,
    FAULT_SLIDING_MPS2,
    FAULT_TOLERANCE_DEG,
)
from vehicle.identification.faults.vanishing_gain import PathSpan, find_spans_by_law, measure_path_shares
from vehicle.identification.faults.wheel_standstill import Standstill, find_faulty_standstills, measure_unrest
from vehicle.identification.logs.column_faults import POSITION_LOST, WHEEL_SENSOR_FROZEN
from vehicle.identification.logs.gating import FIRST_ROW_LINE, number_segments
from vehicle.identification.logs.schema import Array, GatedRows, Log, LogFault, Mask
from vehicle.identification.logs.sparse_steering import SPARSE_S, STEERING_LOOSE, STEERING_STUCK, STEERING_WORDS

_FOLLOWING_DEG = 1.2  # chosen: an angle this close to that of a usual steering follows
_FEWEST_ROWS = 20  # of a run beside its faults, to have a use
_END_S = 2.0  # chosen: a fault that ends so near to the end of the log lasts until then
# Chosen, deg and share of the largest angle: wheels that run away from their command to the end of their travel.
_RUN_AWAY_DEG, _AT_LOCK_SHARE = 5.0, 0.85
_MOVE_DEG, _MOVE_S = 1.5, 2.0  # chosen: commands that move this far within this time show whether wheels follow
_CLEAR_SHARE_ERROR = 0.2  # chosen: half is followed or not by two and a half standard errors
_STILL_DEG = 1.5  # chosen: a sensor that hardly moves
_MOST_FAULTY_SHARE = 0.6  # of the driving time of a set: more is no fault of some runs, but what these columns hold
# Chosen: share of a departure by the heading that the course confirms where it is clear, and below which it denies it,
# and how far (share of the departure) its noise may reach to have a say.
_CONFIRMED_SHARE, _DENIED_SHARE, _COURSE_NOISE_SHARE = 0.8, 0.5, 0.25
# A heading is lost where it leaves the course by this much (deg, and times the usual) for FAULT_LEAST_S.
_LOST_HEADING_DEG, _LOST_HEADING_SIGMAS = 5.0, 4.0

WORDS = {
    **STEERING_WORDS,
    POSITION_LOST: "heading_deg leaves the course for seconds while the path stays as steered: the heading of the "
    "receiver is not valid",
    WHEEL_SENSOR_FROZEN: "steering_deg does not follow the commands while the path does",
}


@dataclass(frozen=True)
class _Span:
    """A fault in one segment: its id and the indices of its first and last row of the grid.

    `earliest` and `shown` are the rows between which it began, where commands at rest do not show when; `by_path` is
    whether the path shows it and not the wheel angle.
    """

    id: str
    first: int
    last: int
    earliest: int | None = None
    shown: int | None = None
    by_path: bool = False


def mark_steering_faults(logs: Sequence[Log]) -> list[Log]:
    """Return the logs with faults of the steering added to `faults`, and without the rows of these faults.

    Steps of a level go first: wheels that stand elsewhere than they say look as if they did not follow.
    """
    logs = mark_level_step(correct_heading_jumps(logs))
    locks, lock = find_largest_angles(logs), _find_largest_command(logs)
    segments = [build_evidence_segments(log, locks) for log in logs]
    scale = fit_path_scale([segment for parts in segments for segment in parts])
    unrest_deg = measure_unrest([segment for parts in segments for segment in parts])
    standstills = find_faulty_standstills(segments, unrest_deg)
    changes = find_following_changes(logs, segments, unrest_deg)
    deviations = AngleDeviations([segment for parts in segments for segment in parts])
    spans = [
        [_find_faults(*row, scale, lock, unrest_deg, deviations) for row in zip(parts, stills, changed, strict=True)]
        for parts, stills, changed in zip(segments, standstills, changes, strict=True)
    ]
    if scale is not None:
        spans = _drop_spans_by_law(logs, segments, spans, scale)
    seconds = sum(float(np.ptp(segment.time_s)) for parts in segments for segment in parts)
    faulty_s = STEP_S * sum(
        span.last - span.first for parts in spans for segment_spans in parts for span in segment_spans
    )
    if faulty_s > _MOST_FAULTY_SHARE * seconds:
        return list(logs)
    marked = [_mark_log(*row) for row in zip(logs, segments, spans, strict=True)]
    return _leave_out_faulty_runs(marked)


def _drop_spans_by_law(
    logs: Sequence[Log],
    segments: Sequence[Sequence[SteeringEvidence]],
    spans: Sequence[Sequence[Sequence[_Span]]],
    scale: PathScale,
) -> list[list[list[_Span]]]:
    """Return the spans by run and segment without those of a path whose gain follows a law."""
    by_path = [
        PathSpan(run, number, span.first, span.last)
        for run, parts in enumerate(spans)
        for number, found in enumerate(parts)
        for span in found
        if span.by_path and span.id in STEERING_WORDS
    ]
    by_law = set[PathSpan]()
    if by_path:
        blocks = [
            [measure_path_shares(log, segment, scale) for segment in parts]
            for log, parts in zip(logs, segments, strict=True)
        ]
        by_law = find_spans_by_law(by_path, blocks)
    return [
        [
            [span for span in found if not span.by_path or PathSpan(run, number, span.first, span.last) not in by_law]
            for number, found in enumerate(parts)
        ]
        for run, parts in enumerate(spans)
    ]


def _leave_out_faulty_runs(logs: Sequence[Log]) -> list[Log]:
    """Return the logs that have rows left; the first of them carries the faults of the others."""
    left = [log for log in logs if log.rows_used >= _FEWEST_ROWS]
    if not left or len(left) == len(logs):
        return list(logs)
    faults = [fault for log in logs if log.rows_used < _FEWEST_ROWS for fault in log.faults]
    return [replace(left[0], faults=(*left[0].faults, *faults)), *left[1:]]


def _find_largest_command(logs: Sequence[Log]) -> float:
    """Return the largest angle (deg) that was commanded: wheels that run away pass it or come near."""
    return max(
        (float(np.abs(log.steering_command_deg[log.used]).max()) for log in logs
         if log.steering_command_deg is not None and log.used.any()),
        default=0.0,
    )  # fmt: skip


def _find_faults(
    segment: SteeringEvidence,
    standstills: Sequence[Standstill],
    changes: Sequence[FollowingChange],
    scale: PathScale | None,
    lock: float,
    unrest_deg: float,
    deviations: AngleDeviations,
) -> list[_Span]:
    """Return the faults of a segment: of the wheel angle against the commands, and of the path against both.

    Wheels go `unrest_deg` from their commands by themselves, and by what `deviations` show wherever an angle is held.

    Columns that change every few seconds do not say what was commanded in between.
    """
    if segment.hold_s > SPARSE_S:
        return []
    if segment.command is None:
        return _find_path_faults(segment, scale, lock)
    if segment.wheel is None:
        return _find_path_faults(segment, scale, lock)
    beyond = _measure_beyond(segment, segment.wheel, unrest_deg) > 0.0
    following = np.abs(segment.wheel - segment.usual) < max(_FOLLOWING_DEG, 0.5 * unrest_deg)
    spans = [
        span
        for span in _find_spans(beyond, following, segment.usual, segment.wheel)
        if not _is_usual_elsewhere(segment, span, unrest_deg, deviations)
    ]
    spans = _join_standstills(spans, standstills)
    spans = [replace(span, id=_name_wheel_fault(segment, span, scale, lock)) for span in _join_changes(spans, changes)]
    path_spans = [
        span
        for span in _find_path_faults(segment, scale, lock)
        if not any(span.first <= other.last and other.first <= span.last for other in spans)
    ]
    return [*[span for span in spans if span.id], *path_spans]


def _measure_beyond(segment: SteeringEvidence, wheel: Array, unrest_deg: float) -> Array:
    """Return how far wheels (k, deg) are beyond what the commands of a segment allow (k, deg), negative within."""
    beyond: Array = np.maximum(segment.low - wheel, wheel - segment.high) - max(FAULT_TOLERANCE_DEG, unrest_deg)
    return beyond


def _is_usual_elsewhere(segment: SteeringEvidence, span: _Span, unrest_deg: float, deviations: AngleDeviations) -> bool:
    """Whether the wheel angle leaves its commands in a span no further than wherever these angles are held."""
    assert segment.wheel is not None
    rows = slice(span.first, span.last + 1)
    wheel = segment.wheel.copy()
    wheel[rows] -= deviations.compute_elsewhere(segment, span.first, span.last)
    still = np.minimum(_measure_beyond(segment, segment.wheel, unrest_deg), _measure_beyond(segment, wheel, unrest_deg))
    return int(np.count_nonzero(still[rows] > 0.0)) * STEP_S < FAULT_LEAST_S


def _join_standstills(spans: Sequence[_Span], standstills: Sequence[Standstill]) -> list[_Span]:
    """Return the spans with those of standing wheels: these know better when it ended, and when it began, unless a
    wheel that moved by itself showed it before."""
    joined = list(spans)
    for still in standstills:
        # Wheels that nobody saw move are not known to have followed before.
        earliest = still.first if still.first > 0 else still.shown
        window = (earliest, still.shown) if earliest < still.shown else (None, None)
        span = _Span(STEERING_LOOSE, (earliest + still.shown) // 2, still.last, *window)
        overlapping = [other for other in joined if other.first <= still.last and still.first <= other.last]
        ran_away = any((other.first if other.shown is None else other.shown) < still.first for other in overlapping)
        if overlapping:
            before = min(overlapping, key=lambda other: other.first)
            last = max(still.last, max(other.last for other in overlapping))
            span = replace(before, last=last) if ran_away else replace(span, last=last)
        joined = [*[other for other in joined if other not in overlapping], span]
    return joined


def _join_changes(spans: Sequence[_Span], changes: Sequence[FollowingChange]) -> list[_Span]:
    """Return the spans with those of wheels that follow less than before, which last longer than single misses."""
    joined = list(spans)
    for change in changes:
        overlapping = [span for span in joined if span.first <= change.last and change.first <= span.last]
        # Wheels that stand or run away know better when they followed again.
        if any(2 * (span.last - span.first) > change.last - change.first for span in overlapping):
            continue
        span = _Span(STEERING_LOOSE, change.first, change.last)
        if overlapping:
            before = min(overlapping, key=lambda one: one.first)
            span = before if before.first < change.first else span
            span = replace(span, last=max(change.last, *(one.last for one in overlapping)))
        joined = [*[one for one in joined if one not in overlapping], span]
    return joined


def _find_spans(bad: Mask, following: Mask, expected: Array, angle: Array) -> list[_Span]:
    """Return spans of bad rows, those near each other as one, from and to rows whose `angle` (k, deg) follows what is
    `expected`."""
    rows = np.flatnonzero(bad)
    if not len(rows):
        return []
    groups = np.split(rows, np.flatnonzero(np.diff(rows) > FAULT_JOIN_S / STEP_S) + 1)
    spans = []
    for group in groups:
        if len(group) * STEP_S < FAULT_LEAST_S:
            continue
        before, after = np.flatnonzero(following[: group[0]]), np.flatnonzero(following[group[-1] :])
        shown = int(before[-1]) + 1 if len(before) else 0
        earliest = _find_earliest_onset(following, expected, angle, shown) if len(before) else 0
        last = int(group[-1] + after[0]) if len(after) else len(bad) - 1
        # The middle is the best guess.
        window = (earliest, shown) if earliest < shown else (None, None)
        spans.append(_Span(STEERING_LOOSE, (earliest + shown) // 2, last, *window))
    return spans


def _find_earliest_onset(following: Mask, expected: Array, angle: Array, first: int) -> int:
    """Return the earliest row of an onset that shows at row `first`.

    Where only a new command shows that nothing follows, it broke at any time since the last command that was followed.
    Wheels that move away by themselves show when.
    """
    reach = round(_MOVE_S / STEP_S)
    end = min(first + reach, len(angle) - 1)
    demand_deg, moved_deg = expected[end] - expected[first], angle[end] - angle[first]
    if (
        abs(moved_deg) > _MOVE_DEG
        and moved_deg * (demand_deg if abs(demand_deg) > _MOVE_DEG else expected[end] - angle[end]) < 0
    ):
        return first
    moved = np.zeros(len(expected))
    moved[reach:] = np.abs(expected[reach:] - expected[:-reach])
    if float(np.max(moved[first : first + 2 * reach])) < _MOVE_DEG:
        return first
    shown = np.flatnonzero(following[:first] & (moved[:first] > _MOVE_DEG))
    # The new command itself is followed for the moment that valves take.
    shown = shown[shown < first - 2 * reach]
    if not len(shown) or float(np.max(moved[int(shown[-1]) + reach : first - reach], initial=0.0)) > _MOVE_DEG:
        return first
    return int(shown[-1])


def _name_wheel_fault(segment: SteeringEvidence, span: _Span, scale: PathScale | None, lock: float) -> str:
    """Return the id of a fault of the wheel angle; empty where the path follows and the sensor moves on its own."""
    rows = slice(span.first, span.last + 1)
    assert segment.wheel is not None
    if scale is not None:
        needed = scale.compute_needed_angle(segment.curvature[rows])
        known = np.isfinite(needed)
        if known.any():
            low, high = np.quantile(segment.wheel[rows], (0.05, 0.95))
            share = _measure_followed_share(segment, span, scale) if high - low < _STILL_DEG else None
            if share is None:
                by_wheel = float(np.median(np.abs(needed - segment.wheel[rows])[known]))
                by_command = float(np.median(np.abs(needed - segment.usual[rows])[known]))
                share = 1.0 if by_command < by_wheel else 0.0
            if share > 0.5:
                return WHEEL_SENSOR_FROZEN if high - low < _STILL_DEG else ""
    return STEERING_STUCK if _is_run_away(segment.wheel[rows], segment.usual[rows], lock) else STEERING_LOOSE


def _measure_followed_share(segment: SteeringEvidence, span: _Span, scale: PathScale) -> float | None:
    """Return the share of the commands' changes in a span that the path follows; None where that is not clear.

    Levels say less: small angles bend a path by another share than large ones.
    """
    rows = np.arange(span.first if span.earliest is None else span.earliest, span.last + 1)
    needed = scale.compute_needed_angle(segment.curvature[rows])
    known = np.isfinite(needed)
    columns = np.column_stack([segment.usual[rows], np.ones(len(rows))])[known]
    squares = float(np.sum((columns[:, 0] - columns[:, 0].mean()) ** 2)) if known.any() else 0.0
    if squares <= 0.0:
        return None
    theta = np.linalg.lstsq(columns, needed[known], rcond=None)[0]
    # Curvature is an average over TURN_S, so only so many rows are independent.
    variance = float(np.mean((needed[known] - columns @ theta) ** 2)) * TURN_S / STEP_S
    return float(theta[0]) if variance / squares < _CLEAR_SHARE_ERROR**2 else None


def _is_run_away(angle: Array, expected: Array, lock: float) -> bool:
    """Whether an angle leaves what is expected and ends up near the lock."""
    known = np.isfinite(angle)
    angle, expected = angle[known], expected[known]
    if len(angle) < 2:
        return False
    end = float(np.median(angle[len(angle) // 2 :]))
    ran = abs(end) - float(np.sign(end)) * float(angle[0])
    beyond = float(np.sign(end)) * (end - float(np.median(expected[len(expected) // 2 :])))
    return ran > _RUN_AWAY_DEG and beyond > _RUN_AWAY_DEG and abs(end) > _AT_LOCK_SHARE * lock


def _find_path_faults(segment: SteeringEvidence, scale: PathScale | None, lock: float) -> list[_Span]:
    """Return spans in which the path needs another angle than the wheels have, or than the commands allow."""
    if scale is None or not segment.by_heading:
        return []  # the course of an antenna swings where wheels move
    if segment.wheel is None:
        low, high, expected = segment.low, segment.high, segment.usual
    else:
        reach = round(1.0 / STEP_S)
        windows = np.lib.stride_tricks.sliding_window_view(np.pad(segment.wheel, reach, mode="edge"), 2 * reach + 1)
        low, high, expected = windows.min(axis=1), windows.max(axis=1), segment.wheel
    tolerance = FAULT_TOLERANCE_DEG + FAULT_NEEDED_SIGMAS * scale.sigma_deg
    needed = scale.compute_needed_angle(segment.curvature)
    least = np.where(low > 0.0, FAULT_SHARE_LEFT, FAULT_SHARE_MORE) * low - tolerance
    most = np.where(high > 0.0, FAULT_SHARE_MORE, FAULT_SHARE_LEFT) * high + tolerance
    with np.errstate(invalid="ignore"):
        beyond = (needed < least) | (needed > most)
        # Tyres that slide lose a share of the bend, at a lateral acceleration; wheels that hang loose have none.
        turns_less = np.abs(needed) < np.abs(expected)
        sliding = turns_less & (segment.pace**2 * np.abs(segment.curvature) > FAULT_SLIDING_MPS2)
        following = np.abs(needed - expected) < _FOLLOWING_DEG + scale.sigma_deg
    bad = beyond & ~sliding
    spans = [
        replace(checked, by_path=True)
        for span in _find_spans(bad, following, expected, needed)
        if (checked := _check_by_course(segment, scale, span, bad, needed - expected)) is not None
    ]
    if segment.wheel is not None:
        return spans  # wheels that ran away would show in their sensor
    return [
        replace(span, id=STEERING_STUCK)
        if span.id == STEERING_LOOSE
        and _is_run_away(needed[span.first : span.last + 1], expected[span.first : span.last + 1], lock)
        else span
        for span in spans
    ]


def _check_by_course(
    segment: SteeringEvidence, scale: PathScale, span: _Span, bad: Mask, apart_deg: Array
) -> _Span | None:
    """Return a span of the path's evidence that the course confirms, or that of a heading that is not valid.

    `bad` are the rows whose path by the heading needs another angle, by `apart_deg`. Wheels that do not follow bend the
    course as well; where only the heading turns, the steering is sound. None where nothing is clear.
    """
    by_course = scale.compute_needed_angle(segment.course_curvature)
    by_heading = scale.compute_needed_angle(segment.curvature)
    rows = span.first + np.flatnonzero(
        bad[span.first : span.last + 1] & np.isfinite(by_course[span.first : span.last + 1])
    )
    others = ~bad & np.isfinite(by_course) & np.isfinite(by_heading)
    if len(rows) * STEP_S < FAULT_LEAST_S or not others.any():
        return span
    side = np.sign(apart_deg[rows])
    shown = float(np.mean(np.abs(apart_deg[rows])))
    confirmed = float(np.mean(side * (by_course - by_heading + apart_deg)[rows]))
    noise = 1.4826 * float(np.median(np.abs(by_course - by_heading)[others]))
    if confirmed >= _CONFIRMED_SHARE * shown:
        return span
    lost = _find_lost_heading(segment, span)
    if lost is not None or confirmed <= 0.0:
        return lost
    is_noisy = noise > _COURSE_NOISE_SHARE * shown
    return span if is_noisy or confirmed >= _DENIED_SHARE * shown else None


def _find_lost_heading(segment: SteeringEvidence, span: _Span) -> _Span | None:
    """Return the rows about a span in which the heading leaves the course; None where they are too few."""
    error = np.abs(segment.heading_error)
    usual = 1.4826 * float(np.nanmedian(error))
    start = max(span.first - round(FAULT_LEAST_S / STEP_S), 0)
    near = error[start : span.last + round(FAULT_LEAST_S / STEP_S) + 1]
    with np.errstate(invalid="ignore"):
        lost = start + np.flatnonzero(near > max(_LOST_HEADING_DEG, _LOST_HEADING_SIGMAS * usual))
    if len(lost) * STEP_S < FAULT_LEAST_S:
        return None
    return _Span(POSITION_LOST, int(lost[0]), int(lost[-1]))


def _mark_log(log: Log, segments: Sequence[SteeringEvidence], spans: Sequence[Sequence[_Span]]) -> Log:
    """Return a log with its faults, joined where they are near each other, and without their rows."""
    faults: list[LogFault] = []
    end_s = float(log.time_s[log.used][-1]) if log.used.any() else 0.0
    for segment, segment_spans in zip(segments, spans, strict=True):
        for span in sorted(segment_spans, key=lambda one: one.first):
            from_s, to_s = float(segment.time_s[span.first]), float(segment.time_s[span.last])
            last_to_s = None if to_s >= end_s - _END_S else to_s
            between_s = (
                None
                if span.earliest is None or span.shown is None
                else (float(segment.time_s[span.earliest]), float(segment.time_s[span.shown]))
            )
            faults.append(LogFault(span.id, log.name, from_s, last_to_s, WORDS[span.id], between_s))
    for fault in faults:
        log = _leave_out_rows(log, fault)
    return replace(log, faults=(*log.faults, *faults))


def _leave_out_rows(log: Log, fault: LogFault) -> Log:
    bad = log.used & (log.time_s >= (fault.from_s if fault.between_s is None else fault.between_s[0]))
    if fault.to_s is not None:
        bad &= log.time_s <= fault.to_s
    rows = np.flatnonzero(bad)
    if not len(rows):
        return log
    used = log.used & ~bad
    rule = f"{fault.id.replace('_', ' ')}: {fault.words}"
    gated = (*log.gated, GatedRows(rule, len(rows), int(rows[0]) + FIRST_ROW_LINE))
    return replace(log, used=used, segment=number_segments(log.time_s, used), gated=gated)
