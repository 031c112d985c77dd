"""Turns that nobody saw: steering between two rows in which it was measured, where a column is slower than the log.

Between two measured angles a replay takes the wheels to move evenly. They may have moved at once, at any time: how much
turns are off for it is known as a variance, and headings tell how much of that there was.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from vehicle.identification.logs.schema import Array
from vehicle.identification.replay.drive_segments import DriveDataset, DriveSegment
from vehicle.identification.residuals.innovations import SOIL_MEMORY_S, NoiseLevels
from vehicle.identification.thresholds import OUTLIER_SIGMAS

LEAST_UNKNOWN_SHARE = 0.02  # chosen, of the variance of steps: between measured angles nothing is known exactly
FEWEST_GAPS = 10  # chosen, of a segment: the mean of fewer squares is off by half or more
ANGLE_FIRST, COMMAND_FIRST = ("angle", "command"), ("command", "angle")  # the column that a simulation steers by
Gap = tuple[int, int]  # two rows in which a column was measured, and none in between


def estimate_unknown_turns(
    dataset: DriveDataset,
    turned: Sequence[Array],
    noise: NoiseLevels,
    columns: tuple[str, str],
    obeyed: Sequence[Array] | None = None,
) -> list[Array]:
    """Return the variances (k - 1, rad2) of turns between rows for lack of a measured steering angle, per segment.

    The turns were simulated with the first of the `columns` (angle or command) that a segment has. Those of
    compute_unknown_turns hold for wheels that move in steps; where measured headings are nearer to the simulated turns
    (k - 1, rad), the wheels move more evenly, and all variances are less by one factor. What the instruments and the
    soil turn is not counted again. `obeyed` are turns of wheels that are at once where they are commanded: so much a
    command changes, and wheels that follow later miss a part of the turn one gap later.
    """
    variances = compute_most_unknown_turns(dataset, turned if obeyed is None else obeyed, columns)
    if not any(part.any() for part in variances) or not all(segment.heading_measured for segment in dataset.segments):
        return variances
    sums = np.array(
        [
            _sum_missed_turns(segment, turns, part, noise, _list_gaps(segment, columns), obeyed is not None)
            for segment, turns, part in zip(dataset.segments, turned, variances, strict=True)
        ]
    )
    pooled = sums.sum(axis=0)
    # Programmes differ in how wheels move: where there are gaps enough, a segment has a factor of its own.
    most_share = 1.0 if obeyed is None else math.inf
    own = [each if obeyed is not None and each[2] >= FEWEST_GAPS else pooled for each in sums]
    return [
        min(max(float(squares / most), LEAST_UNKNOWN_SHARE), most_share) * part if most > 0.0 else part
        for (squares, most, _), part in zip(own, variances, strict=True)
    ]


def _sum_missed_turns(
    segment: DriveSegment,
    turns: Array,
    variances: Array,
    noise: NoiseLevels,
    gaps: Sequence[Gap],
    is_later: bool,
) -> tuple[float, float, float]:
    """Return the sum of squares (rad2) by which headings miss simulated turns over gaps with unknown turns, beyond
    instruments and soil, the sum of the unknown variances, and the number of gaps; the next gap belongs to each where
    wheels follow later."""
    squares = most = count = 0.0
    next_ends = dict(gaps)
    for first, own_last in gaps:
        if variances[first] == 0.0:
            continue
        last = next_ends.get(own_last, own_last) if is_later else own_last
        unknown = float(variances[first:last].sum())
        missed = segment.heading[last] - segment.heading[first] - float(turns[first:last].sum())
        known = 2.0 * noise.heading**2 + _compute_soil_variance(segment, noise, first, last)
        squares += min(missed**2, OUTLIER_SIGMAS**2 * (known + unknown)) - known
        most, count = most + unknown, count + 1.0
    return squares, most, count


def _compute_soil_variance(segment: DriveSegment, noise: NoiseLevels, first: int, last: int) -> float:
    """Return the variance (rad2) of the turn by the soil between two rows."""
    seconds = float(segment.time[last] - segment.time[first])
    east, north = (float(values[last] - values[first]) for values in (segment.east, segment.north))
    pace = math.hypot(east, north) / seconds
    return (noise.soil * pace) ** 2 * compute_integrated_variance(seconds)


def compute_most_unknown_turns(dataset: DriveDataset, turned: Sequence[Array], columns: tuple[str, str]) -> list[Array]:
    """Return the variances of compute_unknown_turns per segment, for turns simulated with the first of the `columns`
    (angle or command) that it has."""
    out = []
    for segment, turns in zip(dataset.segments, turned, strict=True):
        is_angle = segment.command is None or (columns == ANGLE_FIRST and segment.wheel is not None)
        values = segment.wheel if is_angle else segment.command
        gaps = _list_gaps(segment, columns)
        moving = [gap for gap in gaps if values is None or values[gap[0]] != values[gap[1]]]
        out.append(compute_unknown_turns(segment, turns, moving))
    return out


def compute_unknown_turns(segment: DriveSegment, turned: Array, gaps: Sequence[Gap]) -> Array:
    """Return the variance (k - 1, rad2) of simulated turns (k - 1, rad) between rows for lack of a steering angle in
    gaps, pairs of rows in which it was measured.

    Between two measured angles the wheels are taken to move evenly, and may have moved at once at any time: a turn of
    rates that differ by r over T s is off by r T / sqrt(12), the standard deviation of a uniform distribution.
    """
    out, steps = np.zeros(len(turned)), np.diff(segment.time)
    rates = turned / steps
    for first, last in gaps:
        change = rates[min(last, len(rates) - 1)] - rates[first]
        out[first:last] = change**2 * (segment.time[last] - segment.time[first]) * steps[first:last] / 12.0
    return out


def _list_gaps(segment: DriveSegment, columns: tuple[str, str]) -> list[Gap]:
    """Return pairs of rows with a measured steering angle, and rows without one in between."""
    has_column = {"angle": segment.wheel is not None, "command": segment.command is not None}
    measured = segment.measured_rows.get(columns[0] if has_column[columns[0]] else columns[1])
    knots = np.arange(segment.rows) if measured is None else np.flatnonzero(measured)
    return [(int(first), int(last)) for first, last in pairwise(knots) if last > first + 1]


def compute_integrated_variance(span: float) -> float:
    """Return the variance of the integral of unit noise with a memory over a span: 2 m^2 (T / m - 1 + exp(-T / m))."""
    memory = SOIL_MEMORY_S
    return 2.0 * memory * memory * (span / memory - 1.0 + math.exp(-span / memory))
