"""Where on its track a tractor stands clear of the ways that others drive past it.

A way sweeps ground with the outline of tractor and implement. What of that lies across a track must not be within
reach of a tractor that waits there, in the queue or in its place in formation.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from strategies.job import Job, Pass
from strategies.ways.paths import Path

Floats = npt.NDArray[np.float64]

STEP_M = 0.5
ROOM_M = 0.75  # between a tractor that waits and one that passes
ASIDE_M = 0.5  # to the side, unless they are on lines as far apart as neighbouring tracks
SETTLED_M, SWAY_M = 4.0, 1.0  # behind a bend a tractor sways so far from its line, and for how long
BESIDE = 0.98  # working widths that these are apart
PARALLEL_RAD = math.radians(10.0)


@dataclass(frozen=True, eq=False)
class Blocked:
    """Stretches of a track, as open intervals (n, 2) of metres from its beginning, where nobody may stand."""

    low: Floats
    high: Floats

    def before(self, place_m: float) -> float:
        """The last clear place up to one."""
        while (inside := (self.low < place_m) & (place_m < self.high)).any():
            place_m = float(self.low[inside].min())
        return place_m

    def after(self, place_m: float) -> float:
        """The first clear place from one on."""
        while (inside := (self.low < place_m) & (place_m < self.high)).any():
            place_m = float(self.high[inside].max())
        return place_m


def poses_on(path: Path) -> Floats:
    """Poses along a path and on beyond it until they are settled, at most STEP_M apart (n, 4).

    Columns are x, y (m), heading (rad) and whether a tractor is still settling there, as it does so far behind a bend.
    """
    segments = [*path.segments, replace(path.segments[-1], length_m=SETTLED_M, curvature=0.0)]
    counts, since, bent_m = [], [], math.inf
    for segment in segments:
        counts.append(max(1, math.ceil(segment.length_m / STEP_M)))
        since.append(bent_m)
        bent_m = 0.0 if segment.curvature != 0.0 else bent_m + segment.length_m
    owner = np.repeat(np.arange(len(segments)), counts)
    length, curvature, gear = np.array([(one.length_m, one.curvature, one.gear) for one in segments])[owner].T
    step = np.arange(1, len(owner) + 1) - (np.cumsum(counts) - counts)[owner]
    driven = length * step / np.array(counts)[owner]
    settling = (np.array(since)[owner] + driven <= SETTLED_M) & (curvature == 0.0)
    kept = settling | (owner < len(path.segments))
    begun = np.array([*path.poses(), path.end])[owner]
    bend = 0.5 * curvature * gear * driven
    angle = begun[:, 2] + bend
    run = gear * driven * np.sinc(bend / math.pi)
    x, y = begun[:, 0] + run * np.cos(angle), begun[:, 1] + run * np.sin(angle)
    poses = np.column_stack([x, y, angle + bend, settling])[kept]
    return np.concatenate([[[*path.start, 0.0]], poses])


def blocked_on(job: Job, this: Pass, ways: Iterable[Floats]) -> Blocked:
    """Where a tractor on a pass would stand in the way of others; `ways` are poses as of `poses_on`."""
    some = list(ways)
    if not some:
        return Blocked(np.empty(0), np.empty(0))
    x0, y0, heading = job.entry(this)
    x, y, angle, settling = np.concatenate(some).T
    angle = angle - heading
    along = (x - x0) * math.cos(heading) + (y - y0) * math.sin(heading)
    across = (y - y0) * math.cos(heading) - (x - x0) * math.sin(heading)
    cosine, sine = np.cos(angle), np.sin(angle)
    beside = (np.abs(sine) < math.sin(PARALLEL_RAD)) & (np.abs(across) > BESIDE * job.layout.width_m)
    room = np.where(settling > 0.0, SWAY_M, np.where(beside, 0.0, ASIDE_M))
    lows, highs = [], []
    for rear, front, half in job.manner.boxes:
        end, side = np.array([(end, side) for end in (rear, front) for side in (-half, half)]).T[:, :, None]
        ahead = along + end * cosine - side * sine
        aside = across + end * sine + side * cosine
        (first, last), (right, left) = ((reach.min(axis=0), reach.max(axis=0)) for reach in (ahead, aside))
        for my_rear, my_front, my_half in job.manner.boxes:
            over = (right < my_half + room) & (left > -my_half - room)
            lows.append(first[over] - my_front - ROOM_M)
            highs.append(last[over] - my_rear + ROOM_M)
    return Blocked(np.concatenate(lows), np.concatenate(highs))
