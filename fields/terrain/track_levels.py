"""Levels of tracks to each other: receivers of different days differ by a constant, which crossings of tracks show."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fields.terrain.elevation_grid import FloatArray

CELL_M = 5.0
"""Tracks are compared in square cells of this size: half a pass wide, and slopes change little within."""
MIN_SHARED_CELLS = 5
ANCHOR_WEIGHT = 1e-6
"""Pull of all offsets to 0; it only sets the mean of tracks that are levelled to each other."""


def level_tracks(tracks: Sequence[FloatArray]) -> FloatArray:
    """How much the heights of each track (n, 3) lie above those of the others, mean 0 (least squares over cells).

    Tracks that share fewer than MIN_SHARED_CELLS cells say nothing about each other.
    """
    levels = [_average_cells(track) for track in tracks]
    rows, differences = [], []
    for first in range(len(tracks)):
        for second in range(first + 1, len(tracks)):
            shared = levels[first].keys() & levels[second].keys()
            if len(shared) < MIN_SHARED_CELLS:
                continue
            row = np.zeros(len(tracks))
            row[first], row[second] = 1.0, -1.0
            weight = np.sqrt(len(shared))
            rows.append(row * weight)
            differences.append(
                weight * float(np.median([levels[first][cell] - levels[second][cell] for cell in shared]))
            )
    anchors = np.sqrt(ANCHOR_WEIGHT) * np.eye(len(tracks))
    right = np.concatenate([differences, np.zeros(len(tracks))])
    return np.asarray(np.linalg.lstsq(np.vstack([*rows, anchors]), right, rcond=None)[0])


def _average_cells(track: FloatArray) -> dict[tuple[int, int], float]:
    """Mean height of a track in every cell that it touches."""
    cells, owners, counts = np.unique(
        np.floor(track[:, :2] / CELL_M).astype(np.int64), axis=0, return_inverse=True, return_counts=True
    )
    means = np.bincount(owners.ravel(), track[:, 2]) / counts
    return {(int(east), int(north)): float(mean) for (east, north), mean in zip(cells, means, strict=True)}
