"""Open-loop error over horizons: one replay per run, anchored again for every stretch by a rigid fit in closed form."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vehicle.learnt import Settings
from vehicle.measured.logs.record import Array
from vehicle.measured.replay.anchoring import anchor_pieces
from vehicle.measured.replay.course import Course, Stretch
from vehicle.measured.replay.replaying import Pair, Rig, antenna_seen, replays, seen
from vehicle.measured.replay.windows import half_of

HORIZONS_S = (1.0, 5.0, 10.0, 20.0)  # from a moment to a short swath at 5 km/h
FEWEST_ROWS = 4  # three numbers of the rigid fit and one that can be wrong
Seen = tuple[Array, Array, Array, Array]
Squares = dict[float, Array]
Halves = tuple[Settings, Settings]
Cuts = tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]
Half = tuple[Stretch, Settings, int | None]  # a stretch, its settings, and the half of it they are for, if not all
MOST_STEPS = 200_000  # chosen, of stretches driven at a time: about an hour, of which states and poses take 15 MB
EDGE_S = 0.5  # a piece begins at a row, up to half a second (at 1 Hz) off its time


@dataclass(frozen=True)
class Error:
    """Root mean square of the error across and along the way (cm) and of the heading (deg; nan without one)."""

    cross_cm: float
    along_cm: float
    heading_deg: float


def anchored(stretch: Stretch, antenna: Array, heading: Array, rows: slice) -> Array:
    """Cross, along (m) and heading (rad) errors per row (k, 3) after the best turn and shift of the simulated piece."""
    return anchored_pieces(stretch, antenna, heading, (np.array([rows.start]), np.array([rows.stop])))[rows]


def anchored_pieces(stretch: Stretch, antenna: Array, heading: Array, cut: Cuts) -> Array:
    """The errors of all pieces, in the rows of the stretch (k, 3); headings are nan where none was measured."""
    out = np.zeros((stretch.rows, 3))
    x, y = np.ascontiguousarray(antenna[:, 0]), np.ascontiguousarray(antenna[:, 1])
    anchor_pieces(*cut, stretch.east, stretch.north, stretch.heading, x, y, heading, out)
    if not stretch.heading_seen:
        out[:, 2] = np.nan
    return out


def pieces(time: Array, horizon: float) -> list[slice]:
    """Whole pieces of a horizon, one after another."""
    return [slice(int(i), int(j)) for i, j in zip(*cuts(time, horizon), strict=True)]


def cuts(time: Array, horizon: float) -> Cuts:
    """First rows (p,) of whole pieces of a horizon, and the rows (p,) behind their last."""
    starts = np.arange(0.0, time[-1] - horizon + 1e-6, horizon)
    edges = np.searchsorted(time, np.append(starts, starts[-1] + horizon if len(starts) else 0.0) - 1e-9)
    enough = np.diff(edges) >= FEWEST_ROWS
    return edges[:-1][enough], edges[1:][enough]


def chain(rig: Rig, stretch: Stretch, settings: Settings, by_speed: bool = False) -> Seen:
    """What the instruments would have shown had the commands been driven with these effects.

    With `by_speed` at the speed that was measured, where it was: so a fault of the speed leaves no trace of its own.
    """
    (states,) = _driven(rig, [(stretch, settings)], by_speed)
    return seen(rig, stretch, states, settings)


def driven_poses(rig: Rig, each: Sequence[Pair], by_speed: bool = False) -> list[tuple[Array, Array]]:
    """Antenna (k, 2) and heading (k,) of chain alone, for many stretches, each with its settings."""
    states = _driven(rig, each, by_speed)
    return [antenna_seen(rig, stretch, mine, one) for (stretch, one), mine in zip(each, states, strict=True)]


def _driven(rig: Rig, each: Sequence[Pair], by_speed: bool) -> list[Array]:
    """States of stretches, those of one kind side by side."""
    found: dict[int, Array] = {}
    for timed in (False, True):
        mine = [number for number, (stretch, _) in enumerate(each) if (by_speed and stretch.speed_seen) is timed]
        states = replays(rig, [each[number] for number in mine], from_sensor=False, from_speed=timed)
        found.update(zip(mine, states, strict=True))
    return [found[number] for number in range(len(each))]


def squares(stretch: Stretch, antenna: Array, heading: Array, half: int | None = None) -> Squares:
    """Sums of squares (cross, along, heading) and rows per horizon: (4,) each, of all pieces or of those of a half."""
    sums = {}
    for horizon in HORIZONS_S:
        starts, ends = cuts(stretch.time, horizon)
        if half is not None:
            mine = half_of(stretch.time[starts] + EDGE_S) == half
            starts, ends = starts[mine], ends[mine]
        errors = anchored_pieces(stretch, antenna, heading, (starts, ends))
        rows = int((ends - starts).sum())
        sums[horizon] = np.array([*(errors * errors).sum(axis=0), rows]) if rows else np.zeros(4)
    return sums


def no_squares(runs: int) -> list[Squares]:
    """Sums of squares of runs, before any stretch is added."""
    return [{horizon: np.zeros(4) for horizon in HORIZONS_S} for _ in range(runs)]


def run_squares(
    course: Course, rig: Rig, settings: Mapping[int, Settings | Halves], by_speed: bool = False
) -> list[Squares]:
    """Sums of squares of every run; `settings` may differ from run to run, and between the halves of a run.

    `by_speed` is that of chain.
    """
    totals, each = no_squares(len(course.names)), list[Half]()
    for stretch in course.stretches:
        mine = settings[stretch.run]
        halves = enumerate(mine) if isinstance(mine, tuple) else ((None, mine),)
        each += [(stretch, one, half) for half, one in halves]
    for some in _batches(each):
        poses = driven_poses(rig, [(stretch, one) for stretch, one, _ in some], by_speed)
        for (stretch, _, half), (antenna, heading) in zip(some, poses, strict=True):
            for horizon, part in squares(stretch, antenna, heading, half).items():
                totals[stretch.run][horizon] += part
    return totals


def _batches(each: Sequence[Half]) -> Iterator[list[Half]]:
    """What is driven at a time, so that the poses of hours need not all be there at once."""
    batch, steps = list[Half](), 0
    for one in each:
        batch.append(one)
        steps += len(one[0].grids["speed"])
        if steps >= MOST_STEPS:
            yield batch
            batch, steps = [], 0
    yield batch


def errors_of(totals: list[Squares]) -> dict[float, Error]:
    """Errors of all runs together; horizons that no run is long enough for are left out."""
    errors = {}
    for horizon in HORIZONS_S:
        whole = np.sum([one[horizon] for one in totals], axis=0)
        if whole[3] > 0:
            cross, along, heading = np.sqrt(whole[:3] / whole[3])
            errors[horizon] = Error(100.0 * float(cross), 100.0 * float(along), math.degrees(float(heading)))
    return errors


def total_error(totals: list[Squares], floor: list[Squares], along: bool = True, horizon: float = 5.0) -> Array:
    """Error of every run as one number: squares over those of noise alone, averaged over the three kinds (runs,).

    Without `along` the error along the way has no part in it, as where speeds were only derived from positions.
    """
    scale = np.sum([one[horizon] for one in floor], axis=0)
    unit = scale[:3] / max(scale[3], 1.0)
    out = []
    for one in totals:
        rows = max(one[horizon][3], 1.0)
        shares = one[horizon][:3] / rows / np.maximum(unit, 1e-12)
        shares = shares if along else np.delete(shares, 1)
        out.append(float(np.nanmean(shares)) if np.isfinite(shares).any() else 0.0)
    return np.array(out)
