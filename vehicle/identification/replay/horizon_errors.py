"""Open-loop error over horizons: one replay per run, each piece aligned with the measurement by a rigid motion."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vehicle.fast_math import compute_cosine_sine, round_number
from vehicle.identification.logs.schema import Array
from vehicle.identification.replay.drive_segments import HORIZONS_S, DriveDataset, DriveSegment
from vehicle.identification.replay.rig import ReplayRig, replay_segment, simulate_logged_values
from vehicle.jit import compile_function
from vehicle.model.tractor import Settings

HEADING_TRUST_RAD = 0.035  # 2 degrees, what a compass may be off
POSITION_TRUST_M = 0.01  # a centimetre, what a receiver with corrections is off


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
    """Return cosines and sines (k,) of the difference of headings (k,) and simulated angles."""
    for k in range(len(heading)):
        cosines[k], sines[k] = compute_cosine_sine(heading[k] - angle[k])


@compile_function
def _fit_rotation_and_centroids(  # type: ignore[no-untyped-def]
    first, end, east, north, x, y, cosines, sines
) -> tuple[float, float, float, float, float, float]:
    """Return cosine and sine of the rotation of fit_rigid_motion, and the centroids, from those of the heading
    differences."""
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


@compile_function
def add_centred_values(starts, ends, values, out) -> None:  # type: ignore[no-untyped-def]
    """Add values (k,) to `out` (k,), centred in every piece of write_anchored_errors."""
    for piece in range(len(starts)):
        first, end = starts[piece], ends[piece]
        total = 0.0
        for k in range(first, end):
            total += values[k]
        middle = total / (end - first)
        for k in range(first, end):
            out[k] += values[k] - middle


LONGEST_REST_S = HORIZONS_S[0]  # less than the shortest horizon at the end of a segment is not judged
FEWEST_PIECE_ROWS = 4  # three numbers of the rigid fit, and one left to be wrong
InstrumentColumns = tuple[Array, Array, Array, Array]
HorizonSquares = dict[float, Array]
HalfSettings = tuple[Settings, Settings]
PieceBounds = tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]


@dataclass(frozen=True)
class HorizonError:
    """Root mean square error across and along the path (cm) and of the heading (deg; nan without one)."""

    cross_cm: float
    along_cm: float
    heading_deg: float


def compute_anchored_errors(segment: DriveSegment, antenna: Array, heading: Array, rows: slice) -> Array:
    """Return cross, along (m) and heading (rad) errors per row (k, 3) after the best rotation and shift of a piece."""
    return compute_piece_errors(segment, antenna, heading, (np.array([rows.start]), np.array([rows.stop])))[rows]


def compute_piece_errors(segment: DriveSegment, antenna: Array, heading: Array, bounds: PieceBounds) -> Array:
    """Return the errors of all pieces, in the rows of the segment (k, 3); headings are nan where none was measured."""
    out = np.zeros((segment.rows, 3))
    x, y = np.ascontiguousarray(antenna[:, 0]), np.ascontiguousarray(antenna[:, 1])
    write_anchored_errors(*bounds, segment.east, segment.north, segment.heading, x, y, heading, out)
    if not segment.heading_measured:
        out[:, 2] = np.nan
    return out


def split_pieces(time: Array, horizon: float) -> list[slice]:
    """Split a segment into whole pieces of a horizon."""
    return [slice(int(i), int(j)) for i, j in zip(*find_piece_bounds(time, horizon), strict=True)]


def find_piece_bounds(time: Array, horizon: float) -> PieceBounds:
    """Return the first rows (p,) of whole pieces of a horizon, and the rows (p,) after their last."""
    starts = np.arange(0.0, time[-1] - horizon + 1e-6, horizon)
    edges = np.searchsorted(time, np.append(starts, starts[-1] + horizon if len(starts) else 0.0) - 1e-9)
    has_enough_rows = np.diff(edges) >= FEWEST_PIECE_ROWS
    return edges[:-1][has_enough_rows], edges[1:][has_enough_rows]


def list_covering_bounds(time: Array, horizon: float) -> list[PieceBounds]:
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


def simulate_instruments(
    rig: ReplayRig, segment: DriveSegment, settings: Settings, by_speed: bool = False
) -> InstrumentColumns:
    """Simulate the instruments when the commands are driven with these effects.

    With `by_speed` at the measured speed, if any, so that errors of the speed do not show in the path.
    """
    states = replay_segment(rig, segment, settings, from_sensor=False, from_speed=by_speed and segment.speed_measured)
    return simulate_logged_values(rig, segment, states, settings)


def sum_squared_errors_by_horizon(segment: DriveSegment, antenna: Array, heading: Array) -> HorizonSquares:
    """Return sums of squares (cross, along, heading) and rows per horizon, (4,) each."""
    sums = {horizon: np.zeros(4) for horizon in HORIZONS_S}
    for horizon in HORIZONS_S:
        for starts, ends in list_covering_bounds(segment.time, horizon):
            errors = compute_piece_errors(segment, antenna, heading, (starts, ends))
            rows = int((ends - starts).sum())
            if rows:
                sums[horizon] += np.array([*(errors * errors).sum(axis=0), rows])
    return sums


def make_zero_squared_errors(runs: int) -> list[HorizonSquares]:
    """Return empty sums of squares per run."""
    return [{horizon: np.zeros(4) for horizon in HORIZONS_S} for _ in range(runs)]


def sum_squared_errors_by_run(
    dataset: DriveDataset, rig: ReplayRig, settings: Settings, by_speed: bool = False
) -> list[HorizonSquares]:
    """Return the sums of squares of every run; `by_speed` is that of simulate_instruments."""
    totals = make_zero_squared_errors(len(dataset.names))
    for segment in dataset.segments:
        antenna, heading, _, _ = simulate_instruments(rig, segment, settings, by_speed)
        for horizon, part in sum_squared_errors_by_horizon(segment, antenna, heading).items():
            totals[segment.run][horizon] += part
    return totals


def compute_horizon_errors(totals: list[HorizonSquares]) -> dict[float, HorizonError]:
    """Return the error of all runs together per horizon, without horizons that no run is long enough for."""
    errors = {}
    for horizon in HORIZONS_S:
        total = np.sum([run_sums[horizon] for run_sums in totals], axis=0)
        if total[3] > 0:
            cross, along, heading = np.sqrt(total[:3] / total[3])
            errors[horizon] = HorizonError(100.0 * float(cross), 100.0 * float(along), math.degrees(float(heading)))
    return errors


def compute_relative_run_errors(
    totals: list[HorizonSquares], noise_floor: list[HorizonSquares], along: bool = True, horizon: float = 5.0
) -> Array:
    """Return the error of every run (runs,): squares over those of noise alone, averaged over the three kinds.

    Without `along` the error along the path is left out, as where speeds were only derived from positions.
    """
    scale = np.sum([run_sums[horizon] for run_sums in noise_floor], axis=0)
    noise_unit = scale[:3] / max(scale[3], 1.0)
    errors = []
    for run_sums in totals:
        rows = max(run_sums[horizon][3], 1.0)
        shares = run_sums[horizon][:3] / rows / np.maximum(noise_unit, 1e-12)
        shares = shares if along else np.delete(shares, 1)
        errors.append(float(np.nanmean(shares)) if np.isfinite(shares).any() else 0.0)
    return np.array(errors)
