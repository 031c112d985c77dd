"""Faults that begin during a run: a table of what may change, and how likely each row is with the change and without.

Every entry gives nats per step of the grid: the log likelihood of what was measured if it is broken, less that if it is
as before. A fault is a span whose sum is beyond LEAST_NATS and as large as it can be; what else is nearly as likely is
the time between which it began. Of spans of one run that overlap, the one that explains more stays.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fields.arrays import Flags, Floats
from vehicle.identification.diagnosis.search import ADD_NATS, BETTER_NATS
from vehicle.identification.faults.steering_evidence import (
    OFFSET_DEG,
    STEP_S,
    BendScale,
    RunEvidence,
    build_run_evidence,
    find_lock,
    fit_path_scales,
    measure_swing,
    shift,
    slide_minimum,
)
from vehicle.identification.logs.column_faults import LOST_WORDS, POSITION_LOST
from vehicle.identification.logs.schema import GAP_SAMPLES, Log, LogFault
from vehicle.identification.logs.series import find_new_rows
from vehicle.identification.logs.standing_columns import (
    HEADING_FROZEN,
    SPEED_FROZEN,
    STEERING_LOOSE,
    STEERING_STUCK,
    STEERING_WORDS,
    STILL_READINGS,
    WHEEL_SENSOR_FROZEN,
)
from vehicle.identification.logs.thresholds import (
    CLEARLY_APART_DEG,
    FEWEST_READINGS,
    MOMENT_S,
    PATH_MPS,
    POSITION_NOISE_M,
    STEADY_SHARE,
    STEERING_SPREAD_DEG,
    WHEEL_NOISE_DEG,
)

# Shares of an angle that a path may need: a patch without grip leaves half, and no cause doubles it.
LEAST_GAIN, MOST_GAIN = 0.4, 1.7
SLIDING_MPS2 = 0.3  # a path that turns less than its wheels at this lateral acceleration may be that of sliding tyres
MOST_NATS = 3.0  # per second: tails of noise are heavy, and a second is one sample
IDLE_NATS = 0.05  # per second that says nothing
UNCLEAR_S = 8.0  # and no more than this before it: the middle of that is told
USUAL_QUANTILE = 0.98  # of how far runs are beyond what is allowed
HOLD_TAIL = 1.5  # holds have a wider tail than the longest of the others shows
STAND_S = 0.3  # per nat: a column that stands still for a second or two only stutters
MOST_FAULTY_SHARE = 0.6  # of all driving: more is no fault of some runs

HELD_COLUMNS = {"heading_deg": HEADING_FROZEN, "speed_mps": SPEED_FROZEN, "steering_deg": WHEEL_SENSOR_FROZEN}
"""What a reader of one log may not see freeze; positions that freeze it sees."""
WORDS = {
    **STEERING_WORDS,
    **{reading.fault_id: reading.words for reading in STILL_READINGS.values()},
    POSITION_LOST: LOST_WORDS,
    WHEEL_SENSOR_FROZEN: "steering_deg does not follow the commands while the path does",
}

Channel = tuple[Floats, Floats]
"""What an entry of MEASURES reads in a run (k,), NaN where nothing is known: how far it is beyond what is allowed, and
the nats per second that speak for "as before" where it is not."""

PLACED_NATS = 0.5  # per second, of positions where their neighbours have them: a receiver without a fix is so rarely


@dataclass(frozen=True)
class OnsetSpan:
    """A change in a run (index) from `first_s` to `last_s`, perhaps from `earliest_s` to `latest_s`, and its nats."""

    id: str
    run: int
    earliest_s: float
    first_s: float
    last_s: float
    latest_s: float
    nats: float


def mark_onset_faults(logs: Sequence[Log]) -> list[Log]:
    """Return the logs with the faults that begin in them in `faults`, and without the rows of these faults.

    Logs of which nothing is left are dropped; the first log carries their faults.
    """
    spans = find_onset_spans(logs)
    seconds = sum(float(np.ptp(log.time_s[log.used])) for log in logs if log.used.any())
    if sum(span.last_s - span.first_s for span in spans) > MOST_FAULTY_SHARE * seconds:
        return list(logs)
    marked = []
    for run, log in enumerate(logs):
        own = [span for span in spans if span.run == run]
        end_s = float(np.max(log.time_s[log.used], initial=-math.inf))
        lost = [span for span in own if span.id == POSITION_LOST]
        kept = [one for one in log.faults if not any(span.first_s <= one.from_s <= span.latest_s for span in lost)]
        log = replace(log, faults=tuple(kept))  # what positions without a fix seemed to show
        for span in sorted(own, key=lambda one: one.first_s):
            to_s = None if span.latest_s >= end_s - MOMENT_S else span.last_s
            is_unclear = span.first_s - span.earliest_s >= MOMENT_S
            between_s = (span.earliest_s, span.first_s) if is_unclear else None
            from_s = 0.5 * (span.earliest_s + span.first_s) if is_unclear else span.first_s
            fault = LogFault(span.id, log.name, from_s, to_s, WORDS[span.id], between_s)
            bad: Flags = (log.time_s >= fault.earliest_s) & (log.time_s <= (math.inf if to_s is None else to_s))
            log = log.add_fault(fault, bad)
        marked.append(log)
    left = [log for log in marked if log.rows_used >= FEWEST_READINGS]
    if not left or len(left) == len(marked):
        return marked
    faults = [fault for log in marked if log.rows_used < FEWEST_READINGS for fault in log.faults]
    return [replace(left[0], faults=(*left[0].faults, *faults)), *left[1:]]


def find_onset_spans(logs: Sequence[Log]) -> list[OnsetSpan]:
    """Find what begins in runs of a set; no two spans of a run overlap."""
    lock_deg = find_lock(logs)
    built = [(run, build_run_evidence(log, lock_deg)) for run, log in enumerate(logs)]
    numbers, runs = [run for run, one in built if one is not None], [one for _, one in built if one is not None]
    spans = [span for column in HELD_COLUMNS for span in _find_frozen_spans(logs, column)]
    scales = fit_path_scales(runs) if runs else []
    for measure, least_sigma in MEASURES.items() if runs else ():
        channels = [measure(run, scales) for run in runs]
        # How far the other runs are beyond what is allowed, without the one that is so most.
        known = [excess[np.isfinite(excess)] for excess, _ in channels]
        usual = [float(np.quantile(excess, USUAL_QUANTILE)) if len(excess) else 0.0 for excess in known]
        others = [sorted(usual[:number] + usual[number + 1 :]) for number in range(len(usual))]
        sigmas = [max(least_sigma, other[-2] if len(other) > 1 else 0.0) for other in others]
        for number, one, channel, sigma in zip(numbers, runs, channels, sigmas, strict=True):
            # The log likelihood ratio of broken against as before, per step of the grid; 0 where nothing is known.
            excess, against = channel
            broken = np.minimum(0.5 * (excess / sigma) ** 2, MOST_NATS)
            ratio = np.where(excess > 0.0, broken, -np.minimum(against, MOST_NATS)) - IDLE_NATS
            for rows, nats, reach in _find_likely_rows(np.nan_to_num(ratio) * STEP_S):
                name = POSITION_LOST if measure is _measure_place else _find_steering_id(one, scales, rows, lock_deg)
                earliest = rows.start if name == STEERING_STUCK else reach.start  # wheels that run show when
                places = [earliest, rows.start, rows.stop - 1, reach.stop - 1]
                earliest_s, first_s, last_s, latest_s = one.time_s[places].tolist()
                if name:
                    spans.append(OnsetSpan(name, number, earliest_s, first_s, last_s, latest_s, nats))
    chosen: list[OnsetSpan] = []
    for span in sorted(spans, key=lambda one: -one.nats):
        own = [other for other in chosen if other.run == span.run]
        if not any(span.first_s <= other.last_s and other.first_s <= span.last_s for other in own):
            chosen.append(span)
    return chosen


# --- likelihood --------------------------------------------------------------------------------------------------


def _find_likely_rows(nats: Floats) -> list[tuple[slice, float, slice]]:
    """Find spans with the largest sums of nats (k,): rows, sums, and rows about as likely to be first and last."""
    found, open_parts = [], [(0, len(nats))]
    while open_parts:
        start, stop = open_parts.pop()
        total = np.concatenate([[0.0], np.cumsum(nats[start:stop])])
        gain = total - np.minimum.accumulate(total)
        last = int(np.argmax(gain))
        if gain[last] < ADD_NATS:
            continue
        first = int(np.flatnonzero(total[:last] == total[:last].min())[-1])
        before = np.flatnonzero(total[: first + 1] - total[first] > BETTER_NATS)
        after = np.flatnonzero(total[last] - total[last:] > BETTER_NATS)
        earliest = max(int(before[-1]) if len(before) else 0, first - round(UNCLEAR_S / STEP_S))
        latest = last + int(after[0]) if len(after) else stop - start
        rows = slice(start + first, start + last)
        found.append((rows, float(gain[last]), slice(start + earliest, start + latest)))
        open_parts += [(start, rows.start), (rows.stop, stop)]
    return found


# --- the table ---------------------------------------------------------------------------------------------------


def _find_excess(angle: Floats, low: Floats, high: Floats) -> Floats:
    return np.asarray(np.maximum(np.maximum(low - angle, angle - high), 0.0))


def _find_following(angle: Floats, expected: Floats) -> Floats:
    """Nats per second for an angle (k, deg) that moved in the last second as expected."""
    steps = round(1.0 / STEP_S)
    moved, steered = (values - shift(values, -steps) for values in (angle, expected))
    alike = np.minimum(np.abs(moved), np.abs(steered))
    return np.asarray(np.where(moved * steered > 0.0, 0.5 * (alike / STEERING_SPREAD_DEG) ** 2, 0.0))


def _measure_wheel(run: RunEvidence, scales: Sequence[BendScale | None]) -> Channel:
    """The wheel angle against what commands allow."""
    if run.wheel is None or run.command is None:
        return run.unknown, run.unknown
    excess = np.where(run.known, _find_excess(run.wheel, run.low, run.high), np.nan)
    return excess, _find_following(run.wheel, run.usual)


def _measure_swing(run: RunEvidence, scales: Sequence[BendScale | None]) -> Channel:
    """How much less the wheels move to and fro than any steering with a dead band to both sides would."""
    needed = run.list_needed(scales)
    angle, gain = (run.wheel, 1.0) if run.wheel is not None else (needed[0][0] if needed else None, LEAST_GAIN)
    if angle is None or run.command is None:
        return run.unknown, run.unknown
    short = gain * (run.steered - 2.0 * OFFSET_DEG) - measure_swing(np.nan_to_num(angle))
    return np.where(run.known & np.isfinite(angle), np.maximum(short, 0.0), np.nan), _find_following(angle, run.usual)


def _measure_path(run: RunEvidence, scales: Sequence[BendScale | None]) -> Channel:
    """The angle that the path needs against that of the wheels: the nearer of heading and course."""
    low, high = run.low, run.high
    if run.wheel is not None:
        reach = round(1.0 / STEP_S)
        low, high = slide_minimum(run.wheel, reach) - OFFSET_DEG, -slide_minimum(-run.wheel, reach) + OFFSET_DEG
    expected = run.angle
    low = np.where(low > 0.0, LEAST_GAIN, MOST_GAIN) * low
    high = np.where(high > 0.0, MOST_GAIN, LEAST_GAIN) * high
    channels = []
    for needed, bends in run.list_needed(scales):
        sliding = (np.abs(needed) < np.abs(expected)) & (run.pace**2 * np.abs(bends) > SLIDING_MPS2)
        excess = np.where(sliding, 0.0, _find_excess(needed, low, high))
        channels.append((excess, _find_following(needed, expected)))
    if not channels:
        return run.unknown, run.unknown
    excesses, followings = (np.array(part) for part in zip(*channels, strict=True))
    return np.where(run.known, excesses.min(axis=0), np.nan), followings.max(axis=0)


def _measure_place(run: RunEvidence, _scales: Sequence[BendScale | None]) -> Channel:
    """Positions against their neighbours."""
    return run.aside, np.full(len(run.time_s), PLACED_NATS)


def _find_steering_id(run: RunEvidence, scales: Sequence[BendScale | None], rows: slice, lock_deg: float) -> str:
    """The name of steering that does not follow: what the wheels do if the path is theirs, else that of the sensor."""
    needed = next((one for one, _ in run.list_needed(scales)), None)
    angle = run.wheel if run.wheel is not None else needed
    if needed is not None and np.isfinite(needed[rows]).any() and run.wheel is not None and run.command is not None:
        apart = [float(np.nanmedian(np.abs(needed - other)[rows])) for other in (run.wheel, run.usual)]
        if apart[1] < apart[0] - WHEEL_NOISE_DEG:
            is_still = float(np.ptp(np.quantile(run.wheel[rows], (0.05, 0.95)))) < STEERING_SPREAD_DEG
            return WHEEL_SENSOR_FROZEN if is_still else ""
    known = None if angle is None else np.isfinite(angle[rows])
    if angle is None or known is None or np.count_nonzero(known) < 2:
        return STEERING_LOOSE
    # Wheels that leave what is expected and end near the lock have run away.
    shown, expected = angle[rows][known], run.usual[rows][known]
    end = float(np.median(shown[len(shown) // 2 :]))
    side = float(np.sign(end))
    ran, beyond = side * (end - shown[0]), side * (end - np.median(expected[len(shown) // 2 :]))
    has_run = min(ran, beyond) > CLEARLY_APART_DEG and abs(end) > STEADY_SHARE * lock_deg
    return STEERING_STUCK if has_run else STEERING_LOOSE


MEASURES = {
    _measure_wheel: WHEEL_NOISE_DEG, _measure_swing: WHEEL_NOISE_DEG, _measure_path: WHEEL_NOISE_DEG,
    _measure_place: POSITION_NOISE_M,
}  # fmt: skip
"""What may change, and its least standard deviation; what it is depends on the span."""


def _find_frozen_spans(logs: Sequence[Log], column: str) -> list[OnsetSpan]:
    """Find values that are held for far longer than any in other runs. Holds of a value have a tail exp(-t / m), m from
    the longest of the other runs; as many as there are is the price of choosing the longest."""
    holds = [_list_holds(log, column) for log in logs]
    spans = []
    for run, (firsts, lasts, seconds) in enumerate(holds):
        others = np.concatenate([np.empty(0), *(hold[2] for other, hold in enumerate(holds) if other != run)])
        pool = others if len(others) else np.sort(seconds)[:-1]
        if not len(pool):
            continue
        price = math.log(len(pool) + 1.0)
        nats = seconds / max(HOLD_TAIL * float(pool.max()) / price, STAND_S) - price
        spans += [
            OnsetSpan(HELD_COLUMNS[column], run, first, first, last, last, value)
            for first, last, value in zip(firsts.tolist(), lasts.tolist(), nats.tolist(), strict=True)
            if value > ADD_NATS
        ]
    return spans


def _list_holds(log: Log, column: str) -> tuple[Floats, Floats, Floats]:
    """First and last time of every value that a column holds, and for how long the tractor drove in it (s)."""
    values, measured = getattr(log, column), log.measured_rows.get(column)
    rows = np.flatnonzero(log.used if measured is None else log.used & measured)
    if values is None or len(rows) < FEWEST_READINGS:
        return np.empty(0), np.empty(0), np.empty(0)
    # Seconds driven up to each row, as most of positions, speed and commanded speed say.
    used = np.flatnonzero(log.used)
    used_s = log.time_s[used]
    around = np.stack([np.interp(used_s + shift_s, used_s, axis[used]) for axis in (log.easting_m, log.northing_m)
                      for shift_s in (-1.0, 1.0)])  # fmt: skip
    paces = [np.hypot(around[1] - around[0], around[3] - around[2]) / 2.0]
    paces += [values[used] for values in (log.speed_mps, log.speed_command_mps) if values is not None]
    moving = np.sort(np.stack(paces), axis=0)[-2 if len(paces) > 1 else -1] > PATH_MPS
    step = np.diff(used_s, prepend=used_s[0])
    step = np.where(step <= (GAP_SAMPLES + 0.5) * np.median(step), step, 0.0)
    driven = np.zeros(len(log.time_s))
    driven[used] = np.cumsum(step * moving)
    changes = find_new_rows(values[rows])
    ends = np.append(changes[1:], len(rows) - 1)
    time = log.time_s[rows]
    return time[changes], time[ends], (driven[rows][ends] - driven[rows][changes])
