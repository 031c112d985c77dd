"""Wheels that from a moment on stand elsewhere than their sensor says: a bent tie rod, a slipped sensor, a flat tyre.

The angle that the path needs, less the one that is measured (without a sensor: that of a usual steering), then steps by
a constant. What speed, implement, side, direction of travel, place or time do to a path is no step: it must be seen at
once, last until the run ends, and be the same on straights and bends and wherever else there is driving on both sides.

Headings that jump once and stay off, of an instrument that was reset or turned on its mount, are turned back. No
tractor turns so far between two rows, and the course over ground shows that it did not.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fields.arrays import Flags, Floats, Integers
from vehicle.identification.faults.steering_evidence import (
    COURSE_TURN_S,
    STEP_S,
    RunEvidence,
    build_run_evidence,
    find_lock,
    fit_path_scales,
    shift,
)
from vehicle.identification.logs.schema import Log, LogFault, list_gap_rows
from vehicle.identification.logs.series import measure_spread, wrap_degrees
from vehicle.identification.logs.thresholds import (
    ALIKE_SHARE,
    CLEARLY_APART_DEG,
    DOUBT_SIGMAS,
    FEW_SHARE,
    FEWEST_LINE_ROWS,
    FEWEST_PARTS,
    FEWEST_TIMES,
    LASTING_S,
    MAJORITY,
    MOMENT_S,
    NEAR_SHARE,
    PART_S,
    READING_S,
    STEADY_SHARE,
    SURE_SIGMAS,
    TURN_S,
    TURNED_DEG,
    WHEEL_NOISE_DEG,
    WINDOW_S,
)

STEERING_JUMP = "steering_jump"
_THIN_S = 2.0 * STEP_S  # between rows of the search; nearer ones say about the same
_LEAST_SIDE_S = 3.0 * PART_S  # driving on each side, and parts of it that have a level each
_FEWEST_OTHERS, _ALONE_SIDE_S = 2, FEWEST_PARTS * _LEAST_SIDE_S  # with fewer other runs, the least on each side
_LEAST_SHARE, _MOST_SHARE = 0.55, 1.6  # chosen: of the step, as driving alike on both sides shows it
_STRAIGHT_DEG = 4.0  # chosen: smaller angles are those of straights
_CLEAR_DEG = 3.0 * _STRAIGHT_DEG  # smaller angles for a moment show a step at once
_PLACE_M, _BEYOND_M = 25.0, 10.0  # chosen: squares of the field; driving on the other side of the place of a step
_GAINS = (0.5, 2.0)  # chosen: of an angle needed per angle measured
_PASSES, _ROUNDS = 5, 3  # of a fit; of a search without, and with the step of the round before
_MOST_PARTS = 400  # chosen: limits the time of long runs
HEADING_JUMP = "heading_jump"
_MOST_DEG = 180.0 - TURNED_DEG  # more is a heading that points backwards, less than CLEARLY_APART_DEG is its noise
_JUMP_NOISES = 12.0  # chosen, of the scatter of a heading from row to row
_HEADING_NEAR_DEG = 1.5  # chosen: from the level of its side, beside a share of the jump


@dataclass(frozen=True, eq=False)
class _LevelRows:
    """Rows of a grid of all runs (k,): run, time (s), angle measured and needed (deg), pace (m/s), implement, direction
    of travel (rad), gear, place (m)."""

    run: Integers
    time_s: Floats
    angle: Floats
    needed: Floats
    pace: Floats
    implement: Floats
    course: Floats
    gear: Floats
    east: Floats
    north: Floats


def mark_level_step(logs: Sequence[Log]) -> list[Log]:
    """Return the logs with the step of one of them in its `faults`, without the rows unlike the other runs; of a single
    run, without those of the shorter side."""
    lock_deg = find_lock(logs)
    runs = [build_run_evidence(log, lock_deg) for log in logs]
    rows = _collect_rows(logs, runs)
    step = None if rows is None else _find_level_step(rows)
    if step is None:
        return list(logs)
    number, time_s, size_deg, is_after_odd, earliest_s = step
    log, run = logs[number], runs[number]
    size, side, other = f"{abs(size_deg):.1f} deg", *(("right", "left") if size_deg > 0.0 else ("left", "right"))
    column, causes = "steering_deg", "a tie rod is bent, the wheel sensor slipped, or a tyre is flat"
    if log.steering_deg is None:
        column, causes = "steering_command_deg", "a tie rod is bent, a tyre is flat, or the steering lost its centre"
    what = f"the path bends as if the wheels stood {size} further to the {side} than {column} says: {causes}"
    if run is not None and run.wheel is not None and run.command is not None:
        apart, is_after = run.wheel - run.usual, run.time_s >= time_s
        before, after = (float(np.median(apart[run.known & part])) for part in (~is_after, is_after))
        if _LEAST_SHARE < (before - after) / size_deg < _MOST_SHARE:
            what = (
                f"steering_deg reads {size} further to the {other} than before, while the path follows the commands as "
                "before: the wheel sensor slipped"
            )
    words = f"{what}; {'these rows are left out' if is_after_odd else 'the rows before are left out'}"
    odd = log.time_s >= earliest_s if is_after_odd else log.time_s < time_s
    between_s = (earliest_s, time_s) if earliest_s < time_s else None
    fault = LogFault(STEERING_JUMP, log.name, 0.5 * (earliest_s + time_s), None, words, between_s)
    marked = log.add_fault(fault, odd)
    return [marked if one is log else one for one in logs]


def _find_level_step(rows: _LevelRows) -> tuple[int, float, float, bool, float] | None:
    """Return the one step of a set of logs; None where no run or more than one seems to have any.

    That is its run (index), when (s), by how much further to the right the path needs its wheels (deg), whether what is
    after it is unlike the other runs (of a single run, shorter), and from when on it may have been (s): large angles
    and slow driving do not show it at once.
    """
    # What bends paths otherwise: gains by angle, side and pace, the implement, and slopes.
    angle, turn = rows.angle, rows.angle * rows.pace**2
    columns = [
        angle, np.abs(angle), angle * np.abs(angle) / 20.0, angle**3 / 400.0, turn / 4.0, np.abs(turn) / 4.0,
        rows.implement, rows.pace, np.cos(rows.course), np.sin(rows.course), rows.gear,
    ]  # fmt: skip
    nuisance = np.stack([column - np.mean(column) for column in columns], axis=1)
    best: dict[int, tuple[int, float]] = {}
    step: Floats | None = None
    for _ in range(_ROUNDS):
        residual, gain = _compute_residual(rows, nuisance, step)
        best = {int(run): found for run in np.unique(rows.run) if (found := _find_best(rows, residual, int(run)))}
        if not best:
            return None
        run = max(best, key=lambda one: abs(best[one][1]))
        step = ((rows.run == run) & (np.arange(len(rows.run)) >= best[run][0])).astype(np.float64)
    others = [abs(size) for other, (_, size) in best.items() if other != run]
    first, size = best[run]
    if others and max(others) > NEAR_SHARE * abs(size):
        return None
    own, number = rows.run == run, np.arange(len(rows.run))
    before, after = own & (number < first), own & (number >= first)
    least_s = _ALONE_SIDE_S if len(others) < _FEWEST_OTHERS else _LEAST_SIDE_S
    if min(np.count_nonzero(before), np.count_nonzero(after)) * _THIN_S < least_s:
        return None
    size = float(np.median(residual[after]) - np.median(residual[before]))
    odd, usual = _choose_usual(rows, residual, before, after, size)
    if not _is_step(rows, residual, (before, after), (usual, odd), size):
        return None
    time_s, width = float(rows.time_s[first]), round(MOMENT_S / _THIN_S)
    # It began after the last moment in which the path needed small angles only.
    small = np.pad((np.abs(rows.needed[before]) < _CLEAR_DEG).astype(np.float64), (width - 1, 0))
    clear = rows.time_s[before][np.convolve(small, np.ones(width), mode="valid") > width - 0.5]
    last_clear_s = float(clear[-1]) if len(clear) else time_s
    earliest_s = last_clear_s if time_s - last_clear_s > LASTING_S else time_s
    # Small angles often bend a path less than large ones do; the scale is that of all angles.
    turned_deg = size / float(np.clip(np.median(gain[before | after]), *_GAINS))
    return run, time_s, turned_deg, odd is after, earliest_s


def _collect_rows(logs: Sequence[Log], runs: Sequence[RunEvidence | None]) -> _LevelRows | None:
    """Collect the rows every _THIN_S of all runs whose path is known; None where they are too few."""
    scales = fit_path_scales([run for run in runs if run is not None])
    tables, second = [np.zeros((10, 0))], round(1.0 / STEP_S)
    width = 2 * round(0.5 * TURN_S / STEP_S) + 1
    for number, (log, run) in enumerate(zip(logs, runs, strict=True)):
        if run is None or run.hold_s > READING_S:
            continue
        needed = next((angle for angle, _ in run.list_needed(scales)), run.unknown)
        angle = np.convolve(np.pad(run.angle, width // 2, mode="edge"), np.full(width, 1.0 / width), mode="valid")
        chosen = np.arange(0, len(needed), round(_THIN_S / STEP_S))
        chosen = chosen[np.isfinite(needed[chosen])]
        course = np.arctan2(*(shift(run.place, second) - shift(run.place, -second)))
        implement = np.round(np.interp(run.time_s, log.time_s[log.used], log.implement[log.used]))
        columns = (run.time_s, angle, needed, run.pace, implement, course, np.round(run.gear), *run.place)
        tables.append(np.stack([np.full(len(chosen), float(number)), *(column[chosen] for column in columns)]))
    table = np.concatenate(tables, axis=1)
    if table.shape[1] < FEWEST_LINE_ROWS:
        return None
    return _LevelRows(table[0].astype(np.int64), *table[1:])


def _compute_residual(rows: _LevelRows, nuisance: Floats, step: Floats | None) -> tuple[Floats, Floats]:
    """Return the angle needed beyond that measured (k, deg) without what the nuisance columns explain, and how much the
    angle needed changes per angle measured (k,). Each run has a level of its own, which is left in, as is the step."""
    runs = [(rows.run == run).astype(np.float64) for run in np.unique(rows.run)]
    levels = np.stack([*runs, *([] if step is None else [step])], axis=1)
    columns = np.concatenate([nuisance, levels], axis=1)
    values = rows.needed - rows.angle
    weights: Floats = np.ones(len(values))
    ridge = 1e-3 * np.eye(columns.shape[1])
    theta = np.zeros(columns.shape[1])
    for _ in range(_PASSES):
        weighted = columns * weights[:, None]
        theta = np.asarray(np.linalg.solve(columns.T @ weighted + ridge, weighted.T @ values), dtype=np.float64)
        apart = np.abs(values - columns @ theta)
        sigma = max(measure_spread(apart), 1e-3)
        weights = np.square(np.minimum(DOUBT_SIGMAS * sigma / np.maximum(apart, 1e-9), 1.0))
    residual: Floats = values - nuisance @ theta[: nuisance.shape[1]]
    side, size, push = np.sign(rows.angle), np.abs(rows.angle), rows.pace**2 / 4.0
    derivatives = np.stack([np.ones(len(side)), side, size / 10.0, 3.0 * size**2 / 400.0, push, side * push], axis=1)
    return residual, 1.0 + derivatives @ theta[: derivatives.shape[1]]


def _find_best(rows: _LevelRows, residual: Floats, run: int) -> tuple[int, float] | None:
    """Return the row of the best step of a run, and its size (deg); None in a run too short for any."""
    own = np.flatnonzero(rows.run == run)
    part_s = max(0.5 * PART_S, len(own) * _THIN_S / _MOST_PARTS)
    levels, size = _measure_levels(residual[own], part_s), round(part_s / _THIN_S)
    least = math.ceil(_LEAST_SIDE_S / part_s)
    if len(levels) < 2 * least:
        return None

    def measure_scatter(part: Floats) -> float:
        return float(np.sum(np.abs(part - np.median(part))))

    costs = [measure_scatter(levels[:split]) + measure_scatter(levels[split:])
             for split in range(least, len(levels) - least + 1)]  # fmt: skip
    split = least + int(np.argmin(costs))
    before, after = float(np.median(levels[:split])), float(np.median(levels[split:]))
    reach = round(max(2.0 * WINDOW_S, 2.0 * part_s) / _THIN_S)
    window = np.arange(max(split * size - reach, 0), min(split * size + reach, len(own)))
    gain = np.abs(residual[own[window]] - before) - np.abs(residual[own[window]] - after)
    # Where the sum of what the level before explains worse begins to grow for good.
    refined = int(window[0]) + int(np.argmin(np.concatenate([[0.0], np.cumsum(gain)])))
    return int(own[min(refined, len(own) - 1)]), after - before


def _measure_levels(values: Floats, part_s: float) -> Floats:
    """Return the medians of parts of about `part_s` of values (k,)."""
    size = round(part_s / _THIN_S)
    return np.array([np.median(values[start : start + size]) for start in range(0, len(values) - size + 1, size)])


def _is_step(
    rows: _LevelRows, residual: Floats, sides: tuple[Flags, Flags], alike: tuple[Flags, Flags], size: float
) -> bool:
    """Whether a step of a size (deg) between two sides of a run is clear, sharp, flat on both, and of no other cause.
    `alike` are the rows of the usual side, with those of other runs at its level, and of the odd one."""
    if abs(size) < WHEEL_NOISE_DEG or not all(_is_flat(residual[side], size) for side in sides):
        return False
    near = round(WINDOW_S / _THIN_S)
    for side, rows_near in zip(sides, (slice(-near, None), slice(0, near)), strict=True):
        if not abs(float(np.median(residual[side][rows_near]) - np.median(residual[side]))) < NEAR_SHARE * abs(size):
            return False
    usual, odd = alike
    size = size if odd is sides[1] else -size
    return _is_alike(rows, residual, usual, odd, size) and (
        _is_seen_in_same_places(rows, residual, usual, odd, size) or _is_crossed(rows, residual, *sides)
    )


def _choose_usual(rows: _LevelRows, residual: Floats, before: Flags, after: Flags, size: float) -> tuple[Flags, Flags]:
    """Return the side that is unlike the other runs, and the rows of the other side with those runs that are at its
    level: what they drive says how the path is otherwise."""
    levels = {int(run): float(np.median(residual[rows.run == run])) for run in np.unique(rows.run[~(before | after)])}
    middle = 0.5 * float(np.median(residual[before]) + np.median(residual[after]))
    likeness = sum(1 if (level - middle) * size < 0.0 else -1 for level in levels.values())
    if likeness == 0:
        likeness = int(np.count_nonzero(before) - np.count_nonzero(after))
    odd, usual = (after, before) if likeness >= 0 else (before, after)
    level = float(np.median(residual[usual]))
    alike = [run for run in levels if abs(levels[run] - level) < NEAR_SHARE * abs(size)]
    return odd, usual | np.isin(rows.run, alike)


def _is_flat(side: Floats, size: float) -> bool:
    """Whether a side (k, deg) stays at its level in nearly all of its parts, and does not drift."""
    levels, level = _measure_levels(side, PART_S), float(np.median(side))
    apart = np.abs(levels - level)
    clipped = np.clip(levels, level - abs(size), level + abs(size))
    slope = float(np.polyfit(np.linspace(-0.5, 0.5, len(levels)), clipped, 1)[0])
    return (
        abs(size) > SURE_SIGMAS * measure_spread(apart)
        and float(np.mean(apart < NEAR_SHARE * abs(size))) >= STEADY_SHARE
        and abs(slope) < ALIKE_SHARE * abs(size)
    )


def _is_alike(rows: _LevelRows, residual: Floats, usual: Flags, odd: Flags, size: float) -> bool:
    """Whether all that is driven on both sides shows the step, on straights and in bends."""
    # By the path: where the sensor is off, straights have an angle.
    bend = np.sign(rows.needed) * (np.abs(rows.needed) > _STRAIGHT_DEG)
    pace = rows.pace > float(np.median(rows.pace[odd]))
    quarter = np.round(rows.course / (0.5 * np.pi)) % 4.0
    shown = []
    for condition in (bend, pace, quarter, rows.implement, rows.gear):
        for value in np.unique(condition[odd]):
            sides = [side & (condition == value) for side in (usual, odd)]
            if min(map(np.count_nonzero, sides)) * _THIN_S < PART_S:
                continue
            level, other = (float(np.median(residual[side])) for side in sides)
            if not _LEAST_SHARE < (other - level) / size < _MOST_SHARE:
                return False
            shown += [value] if condition is bend else []
    cell = _number_cells(quarter, rows.implement, bend == 0.0, rows.gear)
    common = [value for value in np.unique(cell[odd]) if np.sum(usual & (cell == value)) * _THIN_S >= PART_S]
    if float(np.mean(np.isin(cell[odd], common))) < ALIKE_SHARE:
        return False
    # A bend to one side alone may be bent by another gain.
    return len(shown) > 1 or (shown == [0.0] and _is_followed(rows.angle[odd], residual[odd]))


def _number_cells(*columns: Floats) -> Integers:
    """Number rows by what they have in all columns (k,)."""
    return np.unique(np.stack(columns).T, axis=0, return_inverse=True)[1].ravel()


def _is_followed(angle: Floats, residual: Floats) -> bool:
    """Whether the path clearly follows what the angle does about its level: it is an offset, and nothing is loose."""
    about = angle - np.mean(angle)
    squares = float(np.sum(about**2))
    if squares <= 0.0:
        return False
    slope = float(np.sum(about * residual)) / squares
    left = residual - np.mean(residual) - slope * about
    # Curvature is an average over TURN_S, so only so many rows are independent.
    error = float(np.sqrt(np.mean(left**2) * TURN_S / _THIN_S / squares))
    return abs(slope) + DOUBT_SIGMAS * error < NEAR_SHARE


def _is_seen_in_same_places(rows: _LevelRows, residual: Floats, usual: Flags, odd: Flags, size: float) -> bool:
    """Whether squares of the field that were driven on without the step as well show it."""
    number = _number_cells(np.floor(rows.east / _PLACE_M), np.floor(rows.north / _PLACE_M))
    seen = [value for value in np.unique(number[odd]) if np.sum(usual & (number == value)) * _THIN_S >= LASTING_S]
    least = max(ALIKE_SHARE * np.count_nonzero(odd), PART_S / _THIN_S)
    if np.count_nonzero(odd & np.isin(number, seen)) < least:
        return False
    apart = np.concatenate(
        [residual[odd & (number == value)] - np.median(residual[usual & (number == value)]) for value in seen]
    )
    return _LEAST_SHARE < float(np.median(apart)) / size < _MOST_SHARE


def _is_crossed(rows: _LevelRows, residual: Floats, before: Flags, after: Flags) -> bool:
    """Whether a step begins on a straight, and no border of ground across it is between before and after."""
    first = int(np.flatnonzero(after)[0])
    near = (before | after) & (np.abs(rows.time_s - rows.time_s[first]) < WINDOW_S)
    if float(np.quantile(np.abs(rows.needed[near]), 0.9)) > _STRAIGHT_DEG:
        return False
    course = rows.course[first]
    ahead = (rows.east - rows.east[first]) * np.sin(course) + (rows.north - rows.north[first]) * np.cos(course)
    first_level, last_level = (float(np.median(residual[side])) for side in (before, after))
    for side, far, level, other in ((before, 1.0, first_level, last_level), (after, -1.0, last_level, first_level)):
        beyond = side & (far * ahead > _BEYOND_M)
        # Enough rows beyond the place of the step are at the level of their own side.
        if np.count_nonzero(beyond) < FEW_SHARE * np.count_nonzero(side):
            return False
        if not _LEAST_SHARE < (float(np.median(residual[beyond])) - other) / (level - other) < _MOST_SHARE:
            return False
    return True


def correct_heading_jumps(logs: Sequence[Log]) -> list[Log]:
    """Return the logs with headings beside a jump turned back, the jump in `faults`, and no rows about it.

    A heading that often leaps is noise, or of another fault. Headings are turned on the side that is further from the
    course.
    """
    corrected = []
    for log in logs:
        jumps = _list_candidates(log)
        levels = _compare_levels(log, *jumps[0]) if len(jumps) == 1 else None
        if levels is not None and log.heading_deg is not None:
            (last_before, first_after, _), (before_deg, after_deg) = jumps[0], levels
            size_deg, heading = after_deg - before_deg, log.heading_deg.copy()
            if abs(before_deg) - abs(after_deg) > MAJORITY * abs(size_deg):
                heading[: last_before + 1] += size_deg
            else:
                heading[first_after:] -= size_deg
            side, count = "right" if size_deg > 0.0 else "left", len(log.time_s)
            words = (
                f"heading_deg jumps by {abs(size_deg):.1f} deg to the {side} and stays there while the course goes on: "
                "the instrument was reset, or moved on its mount"
            )
            fault = LogFault(HEADING_JUMP, log.name, float(log.time_s[first_after]), None, words)
            bad = np.isin(np.arange(count), list_gap_rows(last_before, first_after, count))
            log = log.add_fault(fault, bad, heading_deg=heading % 360.0)
        corrected.append(log)
    return corrected


def _list_candidates(log: Log) -> list[tuple[int, int, float]]:
    """Return the rows on both sides of the steps of the heading that no tractor turns, and by how much (deg)."""
    measured = log.measured_rows.get("heading_deg")
    rows = np.flatnonzero(log.used if measured is None else log.used & measured)
    if log.heading_deg is None or len(rows) < 4 * FEWEST_TIMES:
        return []
    time, turn = log.time_s[rows], np.diff(np.unwrap(np.radians(log.heading_deg[rows])))
    step_s = np.diff(time)
    rate = np.degrees(turn) / np.maximum(step_s, 1e-6)
    changes = np.abs(np.diff(np.degrees(turn)))
    least = max(CLEARLY_APART_DEG, _JUMP_NOISES * float(np.median(changes)))
    jumps = []
    for row in np.flatnonzero((np.abs(np.degrees(turn)) > 0.5 * least) & (step_s <= MOMENT_S)):
        before = np.flatnonzero((time[1:] <= time[row]) & (time[:-1] >= time[row] - MOMENT_S))
        after = np.flatnonzero((time[:-1] >= time[row + 1]) & (time[1:] <= time[row + 1] + MOMENT_S))
        if min(len(before), len(after)) < FEWEST_TIMES:
            continue
        # What it turned about a step is between the rates of both sides.
        near = np.median(rate[before]), np.median(rate[after])
        most = [float(np.max(np.abs(rate[side] * step_s[row]))) for side in (before, after)]
        size_deg = math.degrees(turn[row]) - 0.5 * float(near[0] + near[1]) * float(step_s[row])
        if least + max(most) < abs(size_deg) < _MOST_DEG:
            jumps.append((int(rows[row]), int(rows[row + 1]), size_deg))
    return jumps


def _compare_levels(log: Log, last_before: int, first_after: int, size_deg: float) -> tuple[float, float] | None:
    """Return heading minus course (deg) before and after a jump; None where it does not step by as much, and stay."""
    run, half = build_run_evidence(log, math.inf), round(0.5 * COURSE_TURN_S / STEP_S)
    if run is None or run.heading is None:
        return None
    # Heading minus course, without what the antenna swings in bends.
    known = np.isfinite(run.bends[1])
    course = np.arctan2(*(np.sign(run.gear) * (shift(run.place, half) - shift(run.place, -half))))
    error = wrap_degrees(np.degrees(run.heading - course)[known])
    time, curvature = run.time_s[known], run.bends[1][known]
    columns = np.stack([curvature, np.abs(curvature)], axis=1)
    # The changes from bend to bend, not the level that jumps, say how far an antenna swings.
    lag = round(3.0 / STEP_S)
    if len(error) > 3 * lag:
        turned, apart = columns[lag:] - columns[:-lag], error[lag:] - error[:-lag]
        small = np.abs(apart) < max(4.0 * measure_spread(apart), 3.0)
        if np.count_nonzero(small) > lag:
            error = error - columns @ np.linalg.lstsq(turned[small], apart[small], rcond=None)[0]
    after = time >= log.time_s[first_after]
    levels = []
    for side in (~after & (time <= log.time_s[last_before]), after):
        if np.count_nonzero(side) * STEP_S < WINDOW_S:
            return None
        level = float(np.median(error[side]))
        # Headings of a side stay at its level, in each part of the time.
        off, near_deg = error[side] - level, ALIKE_SHARE * abs(size_deg)
        if float(np.mean(np.abs(off) < near_deg + _HEADING_NEAR_DEG)) < STEADY_SHARE:
            return None
        parts = ((time[side] - time[side][0]) // (2.0 * WINDOW_S)).astype(np.int64)
        long_parts = [part for part in np.unique(parts) if np.sum(parts == part) > PART_S / STEP_S]
        if any(abs(float(np.median(off[parts == part]))) >= 2.0 * near_deg for part in long_parts):
            return None
        levels.append(level)
    alike = max(_HEADING_NEAR_DEG, ALIKE_SHARE * abs(size_deg))
    return (levels[0], levels[1]) if abs(levels[1] - levels[0] - size_deg) < alike else None
