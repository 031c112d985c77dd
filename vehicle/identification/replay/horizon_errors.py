"""Open-loop error over horizons: one replay per run, each piece aligned with the measurement by a rigid motion."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from fields.arrays import Floats, Integers
from vehicle.fast_math import compute_cosine_sine, round_number
from vehicle.identification.replay.drive_segments import HORIZONS_S, DriveDataset, DriveSegment, ReplayRig
from vehicle.identification.replay.simulation import simulate_instruments
from vehicle.jit import compile_function
from vehicle.model.tractor import Settings

HEADING_TRUST_RAD = 0.035  # 2 degrees, what a compass may be off
POSITION_TRUST_M = 0.01  # a centimetre, what a receiver with corrections is off
LONGEST_REST_S = HORIZONS_S[0]  # less than the shortest horizon at the end of a segment is not judged
FEWEST_PIECE_ROWS = 4  # three numbers of the rigid fit, and one left to be wrong
ERROR_PIECE_S = HORIZONS_S[1]  # of the errors that are told in words and shares
Pieces = Mapping[float, Floats]
"""By horizon (s) a row per piece (p, 6): its run, its middle (s since the start of its segment), squares of the errors
across and along (m2) and of the heading (rad2; nan without one) summed over its rows, and its rows."""
PieceBounds = tuple[Integers, Integers]


@compile_function
def fit_rigid_motion(  # type: ignore[no-untyped-def]
    first, end, east, north, heading, x, y, angle
) -> tuple[float, float, float, float, float]:
    """Fit the rotation that lays rows `first` to `end` of a simulation on the measurement; returns it with both
    centroids (east, north).

    Positions decide the rotation; headings only where the tractor hardly moves.
    """
    cosines, sines = np.empty(end), np.empty(end)
    _compute_turn_components(heading[:end], angle, cosines, sines)
    cosine, sine, pe, pn, qe, qn = _fit_rotation_and_centroids(first, end, east, north, x, y, cosines, sines)
    return math.atan2(sine, cosine), pe, pn, qe, qn


@compile_function
def _compute_turn_components(heading, angle, cosines, sines) -> None:  # type: ignore[no-untyped-def]
    """Write the cosine and sine of the difference of each heading (k,) and simulated angle to `cosines` and `sines`."""
    for k in range(len(heading)):
        cosines[k], sines[k] = compute_cosine_sine(heading[k] - angle[k])


@compile_function
def _fit_rotation_and_centroids(  # type: ignore[no-untyped-def]
    first, end, east, north, x, y, cosines, sines
) -> tuple[float, float, float, float, float, float]:
    """Return cosine and sine of the rotation of fit_rigid_motion, and centroids, from heading differences."""
    pe = pn = qe = qn = sine = cosine = 0.0
    for k in range(first, end):
        pe += east[k]
        pn += north[k]
        qe += x[k]
        qn += y[k]
        sine += sines[k]
        cosine += cosines[k]
    rows = end - first
    pe, pn, qe, qn = pe / rows, pn / rows, qe / rows, qn / rows
    cosine, sine = _normalise_direction(cosine, sine)
    trust = rows * (POSITION_TRUST_M / HEADING_TRUST_RAD) ** 2
    cosine, sine = trust * cosine, trust * sine
    for k in range(first, end):
        ae, an, be, bn = east[k] - pe, north[k] - pn, x[k] - qe, y[k] - qn
        sine += be * an - bn * ae
        cosine += be * ae + bn * an
    cosine, sine = _normalise_direction(cosine, sine)
    return cosine, sine, pe, pn, qe, qn


@compile_function
def _normalise_direction(cosine: float, sine: float) -> tuple[float, float]:
    """Return the unit vector of a sum of directions; straight ahead where they cancel."""
    size = math.hypot(cosine, sine)
    if size == 0.0:
        return 1.0, 0.0
    return cosine / size, sine / size


@compile_function
def write_anchored_errors(starts, ends, east, north, heading, x, y, angle, out) -> None:  # type: ignore[no-untyped-def]
    """Write the errors per row after the best rigid motion of each piece to `out` (k, 3): cross, along, heading.

    `starts`, `ends` (p,) bound the pieces in rows; `east`, `north`, `heading` are measured, `x`, `y`, `angle`
    simulated. Rows outside every piece are not changed.
    """
    rows = len(east)
    cosines, sines, heading_cosine, heading_sine = np.empty(rows), np.empty(rows), np.empty(rows), np.empty(rows)
    _compute_turn_components(heading, angle, cosines, sines)
    for k in range(rows):
        heading_cosine[k], heading_sine[k] = compute_cosine_sine(heading[k])
    for piece in range(len(starts)):
        first, end = starts[piece], ends[piece]
        cosine, sine, pe, pn, qe, qn = _fit_rotation_and_centroids(first, end, east, north, x, y, cosines, sines)
        turn = math.atan2(sine, cosine)
        for k in range(first, end):
            be, bn = x[k] - qe, y[k] - qn
            off_east, off_north = east[k] - pe - be * cosine + bn * sine, north[k] - pn - be * sine - bn * cosine
            out[k, 0] = off_east * heading_sine[k] - off_north * heading_cosine[k]
            out[k, 1] = off_east * heading_cosine[k] + off_north * heading_sine[k]
            heading_error = heading[k] - angle[k] - turn
            out[k, 2] = heading_error - 2.0 * math.pi * round_number(heading_error / (2.0 * math.pi))


@dataclass(frozen=True)
class HorizonError:
    """Root mean square error across and along the path (cm) and of the heading (deg; nan without one)."""

    cross_cm: float
    along_cm: float
    heading_deg: float


def compute_piece_errors(segment: DriveSegment, antenna: Floats, heading: Floats, bounds: PieceBounds) -> Floats:
    """Return the errors of all pieces, in the rows of the segment (k, 3); headings are nan where none was measured."""
    out = np.zeros((segment.rows, 3))
    x, y = np.ascontiguousarray(antenna[:, 0]), np.ascontiguousarray(antenna[:, 1])
    write_anchored_errors(*bounds, segment.east, segment.north, segment.heading, x, y, heading, out)
    if not segment.heading_measured:
        out[:, 2] = np.nan
    return out


def find_piece_bounds(time: Floats, horizon: float) -> PieceBounds:
    """Return the first rows (p,) of whole pieces of a horizon, and the rows (p,) after their last."""
    starts = np.arange(0.0, time[-1] - horizon + 1e-6, horizon)
    edges = np.searchsorted(time, np.append(starts, starts[-1] + horizon if len(starts) else 0.0) - 1e-9)
    has_enough_rows = np.diff(edges) >= FEWEST_PIECE_ROWS
    return edges[:-1][has_enough_rows], edges[1:][has_enough_rows]


def list_covering_bounds(time: Floats, horizon: float) -> list[PieceBounds]:
    """Return the bounds of the whole pieces from the start of a segment and, where more than LONGEST_REST_S remain
    after them, of one more that ends with the segment.

    All horizons then judge the same driving: of 56 s, pieces of 20 s from the start alone leave out the last 16 s, and
    with them what only shows there. Pieces of one item do not overlap.
    """
    starts, ends = find_piece_bounds(time, horizon)
    rest_s = math.fmod(time[-1] + 1e-6, horizon)
    if time[-1] < horizon - 1e-6 or rest_s <= LONGEST_REST_S:
        return [(starts, ends)]
    first = int(np.searchsorted(time, time[-1] - horizon - 1e-9))
    if len(time) - first < FEWEST_PIECE_ROWS:
        return [(starts, ends)]
    return [(starts, ends), (np.array([first]), np.array([len(time)]))]


def measure_pieces(segment: DriveSegment, antenna: Floats, heading: Floats) -> Pieces:
    """Return the errors of all pieces of a segment, whose antenna (k, 2) and heading (k,) were simulated."""
    pieces = {}
    for horizon in HORIZONS_S:
        rows = [np.zeros((0, 6))]
        for starts, ends in list_covering_bounds(segment.time, horizon):
            squares = compute_piece_errors(segment, antenna, heading, (starts, ends)) ** 2
            middles = 0.5 * (segment.time[starts] + segment.time[ends - 1])
            rows += [
                np.array([[segment.run, middle, *squares[first:end].sum(axis=0), end - first]])
                for middle, first, end in zip(middles, starts, ends, strict=True)
            ]
        pieces[horizon] = np.concatenate(rows)
    return pieces


def join_pieces(parts: Iterable[Pieces]) -> Pieces:
    """Return all pieces of several segments."""
    every = list(parts)
    return {horizon: np.concatenate([one[horizon] for one in every]) for horizon in HORIZONS_S}


def measure_dataset(dataset: DriveDataset, rig: ReplayRig, settings: Settings) -> Pieces:
    """Replay all segments with these effects."""
    return join_pieces(
        measure_pieces(segment, *simulate_instruments(rig, segment, settings)[:2]) for segment in dataset.segments
    )


def sum_by_run(pieces: Pieces, runs: int, horizon: float = ERROR_PIECE_S) -> Floats:
    """Return the squares of every run (runs, 4): across, along (m2), heading (rad2), and rows."""
    numbers = pieces[horizon][:, 0].astype(np.int64)
    return np.stack([np.bincount(numbers, column, runs) for column in pieces[horizon][:, 2:].T], axis=1)


def compute_horizon_errors(pieces: Pieces, run: int | None = None) -> dict[float, HorizonError]:
    """Return the error of all pieces, or of those of one run, per horizon; horizons without a piece are left out."""
    errors = {}
    for horizon, every in pieces.items():
        rows = every if run is None else every[every[:, 0] == run]
        if len(rows):
            cross, along, heading = np.sqrt(rows[:, 2:5].sum(axis=0) / rows[:, 5].sum())
            errors[horizon] = HorizonError(100.0 * float(cross), 100.0 * float(along), math.degrees(float(heading)))
    return errors


def compute_relative_error(pieces: Pieces, noise_floor: Pieces, runs: int, along: bool, horizon: float) -> float:
    """Return the error of all runs: squares over those of noise alone, averaged over the three kinds, run by run.

    Without `along` the error along the path is left out, as where speeds were only derived from positions.
    """
    kinds = [0, 1, 2] if along else [0, 2]
    floor, sums = noise_floor[horizon][:, 2:].sum(axis=0), sum_by_run(pieces, runs, horizon)
    noise_unit = np.maximum(floor[:3] / max(floor[3], 1.0), 1e-12)
    shares = (sums[:, :3] / np.maximum(sums[:, 3:], 1.0) / noise_unit)[:, kinds]
    counts = np.isfinite(shares).sum(axis=1)
    return float((np.nansum(shares, axis=1) / np.maximum(counts, 1)).sum())
