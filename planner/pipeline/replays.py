"""Replays of measured logs: one run by a tractor file, and all runs of a diagnosis by the file as it was and by the
extended one, which convinces of it.

Errors are those of the report: pieces of equal length, each aligned with the measurement by its best rotation and
shift.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fields.arrays import Floats
from planner.errors import attach_parameter
from planner.pipeline.log_ground import HeightFile, add_known_ground
from reports.common.rendering import ResultView, ShownResult
from reports.diagnosis.replay import build_replay_view
from vehicle.identification.diagnosis.corrections import correct_logs
from vehicle.identification.diagnosis.results import (
    PathPair,
    PieceErrors,
    PlaceErrors,
    ReplayedSegment,
    ReplayEvidence,
    ReplayResult,
)
from vehicle.identification.logs.reader import list_remarks, read_log
from vehicle.identification.logs.schema import Log
from vehicle.identification.logs.series import mark_spans
from vehicle.identification.logs.table import MappingSource
from vehicle.identification.replay.drive_segments import (
    DriveSegment,
    ReplayRig,
    build_dataset,
    build_rig_and_corrections,
)
from vehicle.identification.replay.horizon_errors import (
    ERROR_PIECE_S,
    compute_horizon_errors,
    compute_piece_errors,
    find_piece_bounds,
    fit_rigid_motion,
    list_covering_bounds,
    measure_dataset,
)
from vehicle.identification.replay.simulation import simulate_instruments
from vehicle.model.tractor import Settings, Tractor, resolve_tractor

ALIGNMENT_S = 5.0  # of a path that is then left alone
PIECES_S = 2.0 * ERROR_PIECE_S, ERROR_PIECE_S  # long enough to show a bend, else the length of the verdict
MOST_TIME_BINS, MOST_VALUE_BINS, MOST_SQUARES = 60, 12, 24
MOST_PATHS, MOST_PATH_S, MOST_PATH_POINTS = 12, 240.0, 240
SMALLEST_SQUARE_M = 0.1  # model cars drive on a few metres
ROUND_STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)


@dataclass(frozen=True, eq=False, repr=False)
class Replay(ShownResult):
    """A replayed run with its errors, and the remarks on the log's columns and rows.

    `to_pandas()` has a row per length of the pieces compared; `plot()` draws the measured and the simulated path;
    `save()` writes .json, .html or .png.
    """

    replayed: ReplayResult
    remarks: tuple[str, ...]

    def get_view(self) -> ResultView:
        """Paths, errors and remarks."""
        return build_replay_view(self.replayed, self.remarks)


def replay(
    log: Log | str | Path,
    *,
    tractor: Tractor | str | Path = "eg105",
    ground: str = "soil",
    fixes: Sequence[str] = (),
    mapping: MappingSource = None,
    heights: HeightFile | str | Path | None = None,
) -> Replay:
    """Replay a log (an object, or a file read with `fixes` and `mapping`) with the effects of a tractor (object, name
    or file).

    Example:

        run = headland.replay("run.csv", tractor="eg105")
        run.replayed.errors[5.0].cross_cm  # error across over pieces of 5 s, cm
        run.to_pandas()                    # a row per length of the pieces: cross_cm, along_cm, heading_deg
        run.plot()                         # the measured and the simulated path

    Returns a Replay: `replayed` (the run with its errors and simulated paths) and `remarks` on the log. `heights` are
    as in `diagnose`: what the tractor file says per slope is then that of the ground under every row.

    Raises LogError, VehicleError and, for heights, ElevationError.
    """
    with attach_parameter("tractor"):
        machine = resolve_tractor(tractor)
    with attach_parameter("log"):
        run = log if isinstance(log, Log) else read_log(log, fixes, machine.wheelbase_m, mapping=mapping)
        (run,) = add_known_ground([run], heights)
        course = build_dataset([run], (machine.antenna_forward_m, machine.antenna_right_m))
    with attach_parameter("ground"):
        rig, settings = build_rig_and_corrections(machine, ground, course.origin)
    errors = compute_horizon_errors(measure_dataset(course, rig, settings))
    segments = tuple(_replay_segment(rig, segment, settings) for segment in course.segments)
    left_out = course.rows_read - course.rows
    replayed = ReplayResult(run.name, machine.name, tuple(settings), errors, segments, left_out)
    of_ground = course.remarks if run.ground_fall is not None else ()
    return Replay(replayed, (*list_remarks(run), *run.set_remarks, *of_ground))


def _replay_segment(rig: ReplayRig, segment: DriveSegment, settings: Settings) -> ReplayedSegment:
    antenna, heading, wheel, speed = simulate_instruments(rig, segment, settings)
    bounds = find_piece_bounds(segment.time, ERROR_PIECE_S)
    errors = compute_piece_errors(segment, antenna, heading, bounds)
    parts = tuple((rows, errors[rows]) for rows in (slice(int(i), int(j)) for i, j in zip(*bounds, strict=True)))
    return ReplayedSegment(segment, _align_path(segment, antenna, heading), wheel, speed, parts)


def build_evidence(logs: Sequence[Log], tractor: Tractor, extended: Tractor, ground: str) -> ReplayEvidence:
    """Replay logs with a tractor file and with the extended one; raises LogError where no segment can be replayed."""
    dataset = build_dataset(correct_logs(logs, tractor), (tractor.antenna_forward_m, tractor.antenna_right_m))
    rigs = [build_rig_and_corrections(machine, ground, dataset.origin) for machine in (tractor, extended)]
    lasts_s = [float(segment.time[-1]) for segment in dataset.segments]
    longest = sorted(range(len(lasts_s)), key=lambda number: -lasts_s[number])[:MOST_PATHS]
    piece_s = next((length for length in PIECES_S if max(lasts_s) >= length), PIECES_S[-1])
    parts, driven_s = [], 0.0
    for segment in dataset.segments:
        parts.append(_measure_segment(segment, rigs, piece_s, driven_s))
        driven_s += float(segment.time[-1] - segment.time[0])
    time_s, speed, angle, place, squares = map(np.concatenate, zip(*parts, strict=True))
    step_s = max(piece_s, _round_up(driven_s / MOST_TIME_BINS))
    return ReplayEvidence(
        piece_s,
        bin_errors(time_s, squares, np.arange(0.0, driven_s + step_s, step_s), fewest_rows=1),
        bin_errors(speed, squares, choose_edges(speed)),
        bin_errors(angle, squares, choose_edges(angle)),
        _map_errors(place, squares, logs, dataset.origin),
        # The longest segments, in the order of driving.
        tuple(
            _pair_paths(segment, dataset.names[segment.run], rigs)
            for number, segment in enumerate(dataset.segments)
            if number in longest
        ),
    )


def _measure_segment(
    segment: DriveSegment, rigs: Sequence[tuple[ReplayRig, Settings]], piece_s: float, driven_s: float
) -> list[Floats]:
    """Of rows of all pieces: driving time, speed, wheel angle (deg), place, and squared errors (k, 4) in cm2: across
    before and after, then along before and after."""
    poses = [simulate_instruments(rig, segment, settings)[:2] for rig, settings in rigs]
    angle = segment.wheel if segment.wheel is not None else segment.command
    steering = np.zeros(segment.rows) if angle is None else np.degrees(angle)
    place = np.column_stack([segment.east, segment.north])
    columns = (driven_s + segment.time, segment.speed_in_gear, steering, place)
    parts = []
    for bounds in list_covering_bounds(segment.time, piece_s):
        old, new = (100.0 * compute_piece_errors(segment, *pose, bounds)[:, :2] for pose in poses)
        squares = np.column_stack([old[:, 0], new[:, 0], old[:, 1], new[:, 1]]) ** 2
        used = mark_spans(segment.rows, zip(bounds[0], bounds[1] - 1, strict=True))
        parts.append([column[used] for column in (*columns, squares)])
    return list(map(np.concatenate, zip(*parts, strict=True)))


def choose_edges(values: Floats) -> Floats:
    """Choose round edges of at most MOST_VALUE_BINS bins of equal width that hold all values."""
    if len(values) == 0:
        return np.array([0.0, 1.0])
    low, high = float(values.min()), float(values.max())
    step = _round_up((high - low) / (MOST_VALUE_BINS - 1)) if high > low else 1.0
    first, last = math.floor(low / step + 1e-9), math.floor(high / step + 1e-9) + 1
    edges: Floats = step * np.arange(first, last + 1, dtype=np.float64)
    return edges


def _round_up(value: float) -> float:
    """Return the next round number: 1, 2, 2.5 or 5 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(max(value, 1e-6)))
    return float(next(factor * power for factor in ROUND_STEPS if factor * power >= value * (1.0 - 1e-9)))


def bin_errors(values: Floats, squares: Floats, edges: Floats, fewest_rows: int = 10) -> PieceErrors:
    """Return the root mean squares of errors, given as squares (k, 4), in bins of a value (k,)."""
    number = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)
    rows = np.bincount(number, minlength=len(edges) - 1)
    kept = rows >= fewest_rows
    means = [
        np.sqrt(np.bincount(number, column, len(edges) - 1)[kept] / np.maximum(rows[kept], 1)) for column in squares.T
    ]
    return PieceErrors(edges[:-1][kept], edges[1:][kept], rows[kept].astype(np.float64), *means)


def _map_errors(place: Floats, squared: Floats, logs: Sequence[Log], origin: tuple[float, float]) -> PlaceErrors:
    """Return the errors in squares of a map, both kinds together, and the slope of the ground, where every log knows
    its fall and every square has rows of it."""
    if len(place) == 0:
        empty = np.zeros(0)
        return PlaceErrors(empty, empty, SMALLEST_SQUARE_M, empty, empty)
    low = place.min(axis=0)
    side = max(SMALLEST_SQUARE_M, _round_up(float(np.ptp(place, axis=0).max()) / MOST_SQUARES))
    squares, number = np.unique(np.floor((place - low) / side), axis=0, return_inverse=True)
    number = number.ravel()
    counts = np.bincount(number)
    before, after = (
        np.sqrt(np.bincount(number, squared[:, first] + squared[:, first + 2]) / counts) for first in (0, 1)
    )
    corners, slopes = low + side * squares, None
    falls = [log.ground_fall[log.used] for log in logs if log.ground_fall is not None]
    if len(falls) == len(logs):
        driven = np.concatenate([np.column_stack([log.easting_m[log.used], log.northing_m[log.used]]) for log in logs])
        numbers = {tuple(cell): number for number, cell in enumerate(squares.tolist())}
        cells = np.floor((driven - origin - low) / side).tolist()
        owners = np.array([numbers.get(tuple(cell), -1) for cell in cells])
        known = owners >= 0
        rows = np.bincount(owners[known], minlength=len(corners))
        if rows.all():
            slopes = np.bincount(owners[known], np.hypot(*np.concatenate(falls)[known].T), len(corners)) / rows
    return PlaceErrors(corners[:, 0], corners[:, 1], side, before, after, slopes)


def _pair_paths(segment: DriveSegment, name: str, rigs: Sequence[tuple[ReplayRig, Settings]]) -> PathPair:
    end = max(int(np.searchsorted(segment.time, MOST_PATH_S)), 2)
    rows = np.arange(0, end, math.ceil(end / MOST_PATH_POINTS))
    paths = []
    for rig, settings in rigs:
        paths.append(_align_path(segment, *simulate_instruments(rig, segment, settings)[:2])[rows])
    measured = np.column_stack([segment.east, segment.north])[rows]
    return PathPair(name, segment.start_s + segment.time[rows], measured, *paths)


def _align_path(segment: DriveSegment, antenna: Floats, heading: Floats) -> Floats:
    """Return a simulated path (k, 2), turned and shifted so that its first seconds lie on the measurement."""
    rows = max(int(np.searchsorted(segment.time, ALIGNMENT_S)), 2)
    x, y = np.ascontiguousarray(antenna[:, 0]), np.ascontiguousarray(antenna[:, 1])
    angle, *middles = fit_rigid_motion(0, rows, segment.east, segment.north, segment.heading, x, y, heading)
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    return np.asarray(antenna @ turn.T + (np.array(middles[:2]) - turn @ np.array(middles[2:])))
