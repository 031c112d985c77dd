"""Drives that nobody has made yet: programmes a person can follow, and what a tractor would log on them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from vehicle.layout import DT_S
from vehicle.learnt import Settings
from vehicle.measured.logs.record import Array
from vehicle.measured.replay.course import Course, Stretch
from vehicle.measured.replay.replaying import Rig, replay, seen

STEP_S = 0.1  # rows of a simulated log: the usual 10 Hz
PACE_MPS = 1.4  # 5 km/h, the speed of the thesis's experiments
Piece = tuple[float, float, float, float]
Pieces = tuple[Piece, ...]


@dataclass(frozen=True)
class Drill:
    """A drive for a person to make: passes of a first heading (deg to the right of the usual one) and pieces.

    A piece is (seconds, wheel angle in deg, share of the usual speed, implement 0 or 1).
    """

    id: str
    words: str
    passes: tuple[tuple[float, Pieces], ...]

    @property
    def seconds(self) -> float:
        """Length of the drive."""
        return sum(piece[0] for _, pieces in self.passes for piece in pieces)


def _drill(id: str, words: str, *passes: tuple[float, Pieces]) -> Drill:
    return Drill(id, words, passes)


DRILLS: tuple[Drill, ...] = (
    _drill("implement-lifted", "Drive straight ahead for 30 s, implement up for the first 15 s, then down.",
           (0.0, ((15.0, 0.0, 1.0, 0.0), (15.0, 0.0, 1.0, 1.0)))),
    _drill("there-and-back", "Drive the same straight line there and back, 20 s each way, the implement as it was.",
           (0.0, ((20.0, 0.0, 1.0, 1.0),)), (180.0, ((20.0, 0.0, 1.0, 1.0),))),
    _drill("there-and-back-lifted", "Drive the same straight line there and back, 20 s each way, implement up.",
           (0.0, ((20.0, 0.0, 1.0, 0.0),)), (180.0, ((20.0, 0.0, 1.0, 0.0),))),
    _drill("circles", "Drive a circle to the right and one to the left at 15 degrees, 20 s each.",
           (0.0, ((20.0, 15.0, 1.0, 0.0),)), (0.0, ((20.0, -15.0, 1.0, 0.0),))),
    _drill("two-speeds", "Drive a circle at 12 degrees for 20 s slowly and for 15 s at twice the speed.",
           (0.0, ((20.0, 12.0, 0.7, 0.0), (15.0, 12.0, 2.0, 0.0)))),
    _drill("steps", "Steer in steps of 4, 8 and 15 degrees to both sides, 4 s each.",
           (0.0, tuple((4.0, a, 1.0, 0.0) for a in (0.0, 4.0, -4.0, 8.0, -8.0, 15.0, -15.0, 0.0)))),
    _drill("small-steps", "Steer in steps of half a degree up to 2 degrees and back, 4 s each.",
           (0.0, tuple((4.0, a, 1.0, 0.0) for a in (0.0, 0.5, 0.0, -1.0, 0.5, 2.0, 0.0, -2.0, 0.0)))),
    _drill("bends-at-speeds", "Weave at 10 degrees, 6 s each way, at three speeds.",
           (0.0, tuple((6.0, a, s, 0.0) for s in (0.6, 1.2, 2.0) for a in (10.0, -10.0)))),
    _drill("four-ways", "Drive straight ahead to all four points of the compass, 15 s each, implement up.",
           *[(float(way), ((15.0, 0.0, 1.0, 0.0),)) for way in (0, 90, 180, 270)]),
)  # fmt: skip


def driven(rig: Rig, drill: Drill, heading: float, pace: float, settings: Settings) -> Course:
    """The passes of a drill as the tractor with these effects would log them, without noise.

    `heading` (rad) and `pace` (m/s) are the usual ones.
    """
    made = [
        _logged(rig, blank(run, heading - math.radians(turn), pieces, pace), settings)
        for run, (turn, pieces) in enumerate(drill.passes)
    ]
    names = tuple(f"pass {run + 1}" for run in range(len(made)))
    return Course(names, tuple(made), (0.0, 0.0), sum(one.rows for one in made))


def _logged(rig: Rig, empty: Stretch, settings: Settings) -> Stretch:
    """A blank drive with what the instruments show of it."""
    states = replay(rig, empty, settings, from_sensor=False, from_speed=True)
    antenna, angle, wheel, speed = (np.ascontiguousarray(part) for part in seen(rig, empty, states, settings))
    grid = np.arange(len(states)) * DT_S
    grids = dict(empty.grids)
    for name, values in (("east", antenna[:, 0]), ("north", antenna[:, 1]), ("heading", angle), ("wheel", wheel)):
        grids[name] = np.interp(grid, empty.time, values)
    return replace(
        empty, east=antenna[:, 0], north=antenna[:, 1], heading=angle, wheel=wheel, speed=speed, grids=grids
    )


def usual(stretches: Sequence[Stretch]) -> tuple[float, float]:
    """The heading driven most (rad; of a drive that repeats, the same) and the median speed (m/s) of a course."""
    east = np.concatenate([np.cos(one.heading) for one in stretches])
    north = np.concatenate([np.sin(one.heading) for one in stretches])
    pace = float(np.median(np.concatenate([one.pace for one in stretches]))) or PACE_MPS
    return math.atan2(float(north.mean()), float(east.mean())), pace


def blank(run: int, heading: float, pieces: Pieces, pace: float, step: float = STEP_S) -> Stretch:
    """A drive that has only its commands yet: pieces as in Drill, `heading` in rad, a row every `step` seconds."""
    ends = np.cumsum([piece[0] for piece in pieces])
    time = np.arange(0.0, ends[-1] - 1e-9, step)
    grid = np.arange(math.ceil(time[-1] / DT_S) + 1) * DT_S

    def at(times: npt.NDArray[Any], column: int, factor: float) -> Array:
        values = np.array([piece[column] for piece in pieces]) * factor
        return values[np.minimum(np.searchsorted(ends, times, side="right"), len(pieces) - 1)]

    columns = {"command": (1, math.pi / 180.0), "target": (2, pace), "working": (3, 1.0), "speed": (2, pace)}
    grids = {name: at(grid, *how) for name, how in columns.items()}
    grids |= {"east": np.zeros(len(grid)), "north": np.zeros(len(grid)), "heading": np.full(len(grid), heading)}
    rows = {name: at(time, *how) for name, how in columns.items()}
    zero = np.zeros(len(time))
    return Stretch(
        run, 0.0, time, zero, zero, np.full(len(time), heading), True, rows["speed"], True, None, rows["command"],
        rows["target"], rows["working"], grids,
    )  # fmt: skip
