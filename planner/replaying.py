"""One run replayed: what was measured, what the simulation makes of the same commands, and the error by horizon."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from planner.errors import about
from vehicle.learnt import Settings
from vehicle.measured.answer.verdict import Replayed, ReplayedStretch
from vehicle.measured.logs.reading import read_log, remarks
from vehicle.measured.logs.record import Array, Log
from vehicle.measured.replay.anchoring import best_motion
from vehicle.measured.replay.course import Stretch, make_course
from vehicle.measured.replay.horizons import anchored, chain, errors_of, pieces, run_squares
from vehicle.measured.replay.replaying import Rig, own_rig
from vehicle.tractor import Tractor, as_tractor

LAID_S, PIECE_S = 5.0, 5.0


@dataclass(frozen=True, eq=False)
class Replay:
    """A replayed run with its errors, and the remarks on the log's columns and rows."""

    replayed: Replayed
    remarks: tuple[str, ...]


def replay(
    log: Log | str | Path,
    *,
    tractor: Tractor | str | Path = "eg105",
    ground: str = "soil",
    fixes: Sequence[str] = (),
) -> Replay:
    """Replay a log (an object, or a file read with `fixes`) with the effects of a tractor (object, name or file).

    Raises LogError and VehicleError.
    """
    with about("tractor"):
        machine = as_tractor(tractor)
    with about("log"):
        run = log if isinstance(log, Log) else read_log(log, fixes, machine.wheelbase_m)
        course = make_course([run], (machine.antenna_forward_m, machine.antenna_right_m))
    with about("ground"):
        rig, settings = own_rig(machine, ground, course.origin)
    errors = errors_of(run_squares(course, rig, {0: settings}))
    stretches = tuple(_stretch(rig, stretch, settings) for stretch in course.stretches)
    left_out = course.rows_read - course.rows
    told = Replayed(run.name, machine.name, tuple(settings), errors, stretches, left_out)
    return Replay(told, tuple(remarks(run)))


def _stretch(rig: Rig, stretch: Stretch, settings: Settings) -> ReplayedStretch:
    antenna, heading, wheel, speed = chain(rig, stretch, settings)
    turn, shift = lay_on(stretch, antenna, heading)
    parts = tuple((rows, anchored(stretch, antenna, heading, rows)) for rows in pieces(stretch.time, PIECE_S))
    return ReplayedStretch(stretch, antenna @ turn.T + shift, wheel, speed, parts)


def lay_on(stretch: Stretch, antenna: Array, heading: Array, seconds: float = LAID_S) -> tuple[Array, Array]:
    """Turn (2, 2) and shift (2,) that lay the first seconds of the simulation on the measurement."""
    rows = max(int(np.searchsorted(stretch.time, seconds)), 2)
    x, y = np.ascontiguousarray(antenna[:, 0]), np.ascontiguousarray(antenna[:, 1])
    angle, *middles = best_motion(0, rows, stretch.east, stretch.north, stretch.heading, x, y, heading)
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    return turn, np.array(middles[:2]) - turn @ np.array(middles[2:])
