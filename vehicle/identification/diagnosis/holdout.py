"""What an extension is worth on logs held out: errors by the tractor as it was, and as extended.

Pieces are compared in pairs, before and after: an error counts as risen only where the rise is more than the scatter
between pieces, as a few held-out runs hold only a few of the longer ones.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from vehicle.identification.diagnosis.corrections import correct_logs
from vehicle.identification.diagnosis.results import ErrorsByHorizon, HoldoutResult, HoldoutRun
from vehicle.identification.logs.schema import Array, Log, Mask
from vehicle.identification.logs.thresholds import DOUBT_SIGMAS
from vehicle.identification.replay.drive_segments import HORIZONS_S, DriveDataset, build_dataset, compute_half_numbers
from vehicle.identification.replay.horizon_errors import (
    HalfSettings,
    HorizonError,
    compute_piece_errors,
    list_covering_bounds,
    simulate_instruments,
)
from vehicle.identification.replay.rig import ReplayRig, build_rig_and_corrections
from vehicle.model.tractor import Settings, Tractor

HARM_FACTOR = 1.05  # an error that changes by less than a twentieth is the same
LEAST_HARM_CM, LEAST_HARM_DEG = 0.05, 0.03  # smaller errors differ by the last digits of the instruments
UNITS = np.array([100.0, 100.0, math.degrees(1.0)])  # from m, m and rad to cm, cm and deg
LEAST = np.array([LEAST_HARM_CM, LEAST_HARM_DEG])
PiecesByHorizon = Mapping[float, Array]
"""By horizon (s) a row per piece (p, 5): its run, squared errors (cm2, cm2, deg2) summed over its rows, and rows."""


def measure_holdout(logs: Sequence[Log], tractor: Tractor, extended: Tractor, ground: str) -> HoldoutResult:
    """Replay logs that had no part in anything by the tractor as it was and by the extended one.

    Raises LogError where no segment can be replayed.
    """
    dataset = build_dataset(correct_logs(logs, tractor), (tractor.antenna_forward_m, tractor.antenna_right_m))
    old, new = (_measure_pieces(dataset, machine, ground) for machine in (tractor, extended))
    has_speed = all(segment.speed_measured for segment in dataset.segments)
    by_run = tuple(
        HoldoutRun(name, *(compute_errors(pieces, run) for pieces in (old, new)))
        for run, name in enumerate(dataset.names)
    )
    return HoldoutResult(
        dataset.names, compute_errors(old), compute_errors(new), is_extension_helpful(old, new, has_speed), by_run
    )


def _measure_pieces(dataset: DriveDataset, machine: Tractor, ground: str) -> PiecesByHorizon:
    """Replay all segments by a tractor."""
    rig, settings = build_rig_and_corrections(machine, ground, dataset.origin)
    return measure_pieces(dataset, rig, dict.fromkeys(range(len(dataset.names)), settings))


def measure_pieces(
    dataset: DriveDataset, rig: ReplayRig, settings: Mapping[int, Settings | HalfSettings]
) -> PiecesByHorizon:
    """Replay all segments, each with the settings of its run, or with one for each half of its windows of 20 s."""
    rows: dict[float, list[Array]] = {horizon: [] for horizon in HORIZONS_S}
    parts = [(segment, half, own) for segment in dataset.segments for half, own in _list_halves(settings[segment.run])]
    for segment, half, own in parts:
        antenna, heading, _, _ = simulate_instruments(rig, segment, own)
        for horizon in HORIZONS_S:
            for starts, ends in list_covering_bounds(segment.time, horizon):
                if half is not None:
                    middle = 0.5 * (segment.time[starts] + segment.time[ends - 1])
                    is_half = compute_half_numbers(middle) == half
                    starts, ends = starts[is_half], ends[is_half]
                squares = (compute_piece_errors(segment, antenna, heading, (starts, ends)) * UNITS) ** 2
                rows[horizon] += [
                    np.array([segment.run, *squares[first:end].sum(axis=0), end - first])
                    for first, end in zip(starts, ends, strict=True)
                ]
    return {horizon: np.array(pieces) for horizon, pieces in rows.items() if pieces}


def _list_halves(settings: Settings | HalfSettings) -> list[tuple[int | None, Settings]]:
    return list(enumerate(settings)) if isinstance(settings, tuple) else [(None, settings)]


def compute_errors(pieces: PiecesByHorizon, run: int | None = None) -> ErrorsByHorizon:
    """Return the root mean square errors of all pieces, or of those of one run, by horizon."""
    errors = {}
    for horizon, every in pieces.items():
        rows = every if run is None else every[every[:, 0] == run]
        if len(rows):
            errors[horizon] = HorizonError(*map(float, np.sqrt(rows[:, 1:4].sum(axis=0) / rows[:, 4].sum())))
    return errors


def is_extension_helpful(old: PiecesByHorizon, new: PiecesByHorizon, with_along: bool) -> bool:
    """Whether errors fall together, at least one noticeably, and none rises by more than the scatter of its pieces.

    All horizons weigh the same, and distance and heading too; without `with_along` only the distance across counts.
    """
    if is_extension_harmful(old, new, with_along):
        return False
    changes = [np.where(noticeable, change, 0.0) for _, change, noticeable in _list_changes(old, new, with_along)]
    together = np.concatenate(changes) if changes else np.zeros(1)
    return bool(together.mean() < 0.0 and together.min() < -math.log(HARM_FACTOR))


def is_extension_harmful(old: PiecesByHorizon, new: PiecesByHorizon, with_along: bool) -> bool:
    """Whether the distance rises over some horizon, noticeably and by more than the scatter of its pieces; or the
    heading does while the distances do not fall together."""
    risen, fallen = np.zeros(2, dtype=np.bool_), 0.0
    for horizon, change, is_noticeable in _list_changes(old, new, with_along):
        rise = compute_rise_sigmas(_join_kinds(old[horizon], with_along), _join_kinds(new[horizon], with_along))
        risen |= (change > math.log(HARM_FACTOR)) & is_noticeable & (rise > DOUBT_SIGMAS)
        fallen += float(change[0]) * float(is_noticeable[0])
    return bool(risen[0] or (risen[1] and fallen >= 0.0))


def _join_kinds(pieces: Array, with_along: bool) -> Array:
    """Squared errors per piece (p, 2) as they are judged: the distance, across alone without `with_along`, and the
    heading, 0 where none was measured."""
    distance = pieces[:, 1] + (pieces[:, 2] if with_along else 0.0)
    return np.stack([distance, np.nan_to_num(pieces[:, 3])], axis=1)


def _list_changes(old: PiecesByHorizon, new: PiecesByHorizon, with_along: bool) -> Iterator[tuple[float, Array, Mask]]:
    """By horizon the logarithm of the change of the two errors (2,), and whether each is noticeable."""
    for horizon in old:
        rows = max(float(old[horizon][:, 4].sum()), 1.0)
        first, last = (
            np.maximum(np.sqrt(_join_kinds(pieces[horizon], with_along).sum(axis=0) / rows), 1e-9)
            for pieces in (old, new)
        )
        yield horizon, np.log(last / first), np.abs(last - first) > LEAST


def compute_rise_sigmas(old: Array, new: Array) -> Array:
    """Return the rise of squared errors (k,) from paired pieces (p, k), in its standard errors; inf for one."""
    rises = new - old
    if len(rises) < 2:
        return np.full(rises.shape[1], np.inf)
    spread = rises.std(axis=0, ddof=1) * math.sqrt(len(rises))
    sigmas: Array = rises.sum(axis=0) / np.maximum(spread, 1e-12)
    return sigmas
