"""Errors of a track against its path, and distances between tracks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Deviation:
    """Along a track: distance along the path (m), lateral error (m, positive when the path lies to the right) and
    heading error (rad, positive when the target point lies to the right of where the tractor points), (t,) each.
    """

    along: Array
    lateral: Array
    heading: Array


def deviation(place: Array, angle: Array, path: Array, lookahead_m: float) -> Deviation:
    """Errors of a track (t, 2) with headings (t,) against the polyline `path` (n, 2), searched going forward only.

    The heading error is that of section 2.2.3: to the point of the path `lookahead_m` beyond the projection. The
    search of each point starts where the one before was found and looks 5 m of path ahead.
    """
    step = np.diff(path, axis=0)
    length = np.hypot(*step.T)
    unit = step / length[:, None]
    start = np.concatenate([[0.0], np.cumsum(length)])
    ahead = max(2, int(np.ceil(5.0 / max(float(np.median(length)), 1e-9))))
    along, lateral = np.empty(len(place)), np.empty(len(place))
    here = 0
    for row, point in enumerate(place):
        window = slice(here, min(here + ahead, len(step)))
        relative = point - path[window]
        run = np.clip((relative * unit[window]).sum(axis=1), 0.0, length[window])
        near = int(np.argmin(np.hypot(*(relative - run[:, None] * unit[window]).T)))
        here += near
        (ux, uy), (rx, ry) = unit[here], relative[near]
        along[row], lateral[row] = start[here] + rx * ux + ry * uy, ux * ry - uy * rx
    target = np.stack([np.interp(along + lookahead_m, start, path[:, axis]) for axis in (0, 1)], axis=1) - place
    turned = angle - np.arctan2(target[:, 1], target[:, 0])
    return Deviation(along, lateral, np.arctan2(np.sin(turned), np.cos(turned)))


def distances(track: Array, other: Array) -> Array:
    """Shortest distance of every sixth point of a track (at 60 Hz, ten a second) to another track, the measure of
    Tables 3.1 and 3.2. The other is taken at every third point, which moves it by less than a millimetre.
    """
    from shapely import LineString, distance, points

    line = LineString(np.concatenate([other[::3], other[-1:]]))
    return np.asarray(distance(points(track[::6]), line))
