"""What an extension is worth on logs held out: errors by the tractor as it was, and as extended.

Pieces are compared in pairs, before and after: an error counts as risen only where the rise is more than the scatter
between pieces, as a few held-out runs hold only a few of the longer ones.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from vehicle.identification.diagnosis.corrections import correct_logs
from vehicle.identification.diagnosis.results import HoldoutResult, HoldoutRun
from vehicle.identification.logs.schema import Array, Log, Mask
from vehicle.identification.logs.thresholds import DOUBT_SIGMAS
from vehicle.identification.replay.drive_segments import build_dataset
from vehicle.identification.replay.horizon_errors import Pieces, compute_horizon_errors, measure_dataset
from vehicle.identification.replay.rig import build_rig_and_corrections
from vehicle.model.tractor import Tractor

HARM_FACTOR = 1.05  # an error that changes by less than a twentieth is the same
LEAST_HARM = np.array([5e-4, math.radians(0.03)])  # m and rad: smaller errors differ by the last digits of instruments


def measure_holdout(logs: Sequence[Log], tractor: Tractor, extended: Tractor, ground: str) -> HoldoutResult:
    """Replay logs that had no part in anything by the tractor as it was and by the extended one.

    Raises LogError where no segment can be replayed.
    """
    dataset = build_dataset(correct_logs(logs, tractor), (tractor.antenna_forward_m, tractor.antenna_right_m))
    old, new = (
        measure_dataset(dataset, *build_rig_and_corrections(machine, ground, dataset.origin))
        for machine in (tractor, extended)
    )
    return compare_pieces(dataset.names, old, new, dataset.has_speed)


def compare_pieces(names: tuple[str, ...], old: Pieces, new: Pieces, has_speed: bool, words: str = "") -> HoldoutResult:
    """Compare the errors of runs of these names by two tractors."""
    by_run = tuple(
        HoldoutRun(name, *(compute_horizon_errors(pieces, run) for pieces in (old, new)))
        for run, name in enumerate(names)
    )
    before, after = (compute_horizon_errors(pieces) for pieces in (old, new))
    return HoldoutResult(names, before, after, is_extension_helpful(old, new, has_speed), by_run, words)


def is_extension_helpful(old: Pieces, new: Pieces, with_along: bool) -> bool:
    """Whether errors fall together, at least one noticeably, and none rises by more than the scatter of its pieces.

    All horizons weigh the same, and distance and heading too; without `with_along` only the distance across counts.
    """
    if is_extension_harmful(old, new, with_along):
        return False
    changes = [np.where(noticeable, change, 0.0) for _, change, noticeable in _list_changes(old, new, with_along)]
    together = np.concatenate(changes) if changes else np.zeros(1)
    return bool(together.mean() < 0.0 and together.min() < -math.log(HARM_FACTOR))


def is_extension_harmful(old: Pieces, new: Pieces, with_along: bool) -> bool:
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
    distance = pieces[:, 2] + (pieces[:, 3] if with_along else 0.0)
    return np.stack([distance, np.nan_to_num(pieces[:, 4])], axis=1)


def _list_changes(old: Pieces, new: Pieces, with_along: bool) -> Iterator[tuple[float, Array, Mask]]:
    """By horizon the logarithm of the change of the two errors (2,), and whether each is noticeable."""
    for horizon in (horizon for horizon in old if len(old[horizon])):
        rows = float(old[horizon][:, 5].sum())
        first, last = (
            np.maximum(np.sqrt(_join_kinds(pieces[horizon], with_along).sum(axis=0) / rows), 1e-9)
            for pieces in (old, new)
        )
        yield horizon, np.log(last / first), np.abs(last - first) > LEAST_HARM


def compute_rise_sigmas(old: Array, new: Array) -> Array:
    """Return the rise of squared errors (k,) from paired pieces (p, k), in its standard errors; inf for one."""
    rises = new - old
    if len(rises) < 2:
        return np.full(rises.shape[1], np.inf)
    spread = rises.std(axis=0, ddof=1) * math.sqrt(len(rises))
    sigmas: Array = rises.sum(axis=0) / np.maximum(spread, 1e-12)
    return sigmas
