"""Where a tractor on a column would stand in the way of others that pass its end.

The outline of tractor and implement sweeps ground along a move; a tractor must not wait where that reaches its column.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from strategies.path_planning.paths import DrivePath, Pose
from strategies.site.site import Site

Floats = npt.NDArray[np.float64]

POSE_STEP_M = 0.5
WAIT_CLEARANCE_M = 0.75  # between a tractor that waits and one that passes
SIDE_CLEARANCE_M = 0.5  # to the side, unless they are on lines as far apart as neighbouring swaths
SETTLED_M, SWAY_M = 4.0, 1.0  # length behind a bend on which a tractor is off its line, and by how much
BESIDE_WIDTHS = 0.98  # working widths between such lines
PARALLEL_RAD = math.radians(10.0)


@dataclass(frozen=True, eq=False)
class BlockedSpans:
    """Open intervals (n, 2) along a column, in metres from its begin, where nobody may stand."""

    low_m: Floats
    high_m: Floats

    def find_clear_before(self, place_m: float) -> float:
        """The last clear place up to `place_m`."""
        while (inside := (self.low_m < place_m) & (place_m < self.high_m)).any():
            place_m = float(self.low_m[inside].min())
        return place_m

    def find_clear_after(self, place_m: float) -> float:
        """The first clear place from `place_m` on."""
        while (inside := (self.low_m < place_m) & (place_m < self.high_m)).any():
            place_m = float(self.high_m[inside].max())
        return place_m


def sample_poses(path: DrivePath) -> Floats:
    """Poses along a path, and beyond its end until the tractor has settled, at most POSE_STEP_M apart (n, 4).

    Columns are x, y (m), heading (rad) and 1 where a tractor is still settling behind a bend.
    """
    segments = [*path.segments, replace(path.segments[-1], length_m=SETTLED_M, curvature=0.0, gear=1)]
    counts, since_bend_m, bent_m = [], [], math.inf
    for segment in segments:
        counts.append(max(1, math.ceil(segment.length_m / POSE_STEP_M)))
        since_bend_m.append(bent_m)
        bent_m = 0.0 if segment.curvature != 0.0 else bent_m + segment.length_m
    owner = np.repeat(np.arange(len(segments)), counts)
    length, curvature, gear = np.array([(one.length_m, one.curvature, one.gear) for one in segments])[owner].T
    step = np.arange(1, len(owner) + 1) - (np.cumsum(counts) - counts)[owner]
    driven_m = length * step / np.array(counts)[owner]
    settling = (np.array(since_bend_m)[owner] + driven_m <= SETTLED_M) & (curvature == 0.0)
    is_kept = settling | (owner < len(path.segments))
    begin_poses = np.array([*path.list_segment_starts(), path.end])[owner]
    bend = 0.5 * curvature * gear * driven_m
    angle = begin_poses[:, 2] + bend
    run = gear * driven_m * np.sinc(bend / math.pi)
    x, y = begin_poses[:, 0] + run * np.cos(angle), begin_poses[:, 1] + run * np.sin(angle)
    poses = np.column_stack([x, y, angle + bend, settling])[is_kept]
    return np.concatenate([[[*path.start, 0.0]], poses])


def find_blocked_spans(site: Site, begin: Pose, pose_rows: Iterable[Floats]) -> BlockedSpans:
    """Where a tractor on a column from a pose on would stand in the way of poses as from `sample_poses`."""
    sampled = list(pose_rows)
    if not sampled:
        return BlockedSpans(np.empty(0), np.empty(0))
    x0, y0, heading = begin
    x, y, angle, settling = np.concatenate(sampled).T
    angle = angle - heading
    along = (x - x0) * math.cos(heading) + (y - y0) * math.sin(heading)
    across = (y - y0) * math.cos(heading) - (x - x0) * math.sin(heading)
    cosine, sine = np.cos(angle), np.sin(angle)
    beside = (np.abs(sine) < math.sin(PARALLEL_RAD)) & (np.abs(across) > BESIDE_WIDTHS * site.width_m)
    room_m = np.where(settling > 0.0, SWAY_M, np.where(beside, 0.0, SIDE_CLEARANCE_M))
    lows, highs = [], []
    for rear, front, half in site.rules.boxes:
        end, side = np.array([(end, side) for end in (rear, front) for side in (-half, half)]).T[:, :, None]
        ahead = along + end * cosine - side * sine
        aside = across + end * sine + side * cosine
        (first, last), (right_m, left_m) = ((reach.min(axis=0), reach.max(axis=0)) for reach in (ahead, aside))
        for my_rear, my_front, my_half in site.rules.boxes:
            over = (right_m < my_half + room_m) & (left_m > -my_half - room_m)
            lows.append(first[over] - my_front - WAIT_CLEARANCE_M)
            highs.append(last[over] - my_rear + WAIT_CLEARANCE_M)
    return BlockedSpans(np.concatenate(lows), np.concatenate(highs))
