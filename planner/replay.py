"""One run replayed: what was measured, what the simulation makes of the same commands, and the error by horizon."""

from __future__ import annotations

import math

import numpy as np

from vehicle.learnt import Settings
from vehicle.measured.answer.verdict import Replayed, ReplayedStretch
from vehicle.measured.logs.reading import read_log, remarks
from vehicle.measured.logs.record import Array
from vehicle.measured.replay.anchoring import best_motion
from vehicle.measured.replay.course import Stretch, make_course
from vehicle.measured.replay.horizons import anchored, chain, errors_of, pieces, run_squares
from vehicle.measured.replay.replaying import Rig, own_rig
from vehicle.tractor import load_tractor

LAID_S, PIECE_S = 5.0, 5.0


def replayed(log: str, tractor: str, ground: str, fixes: tuple[str, ...] = ()) -> tuple[Replayed, list[str]]:
    """Replay a log with the effects of the tractor file; and the remarks on its columns and rows.

    Raises LogError and VehicleError.
    """
    machine = load_tractor(tractor)
    run = read_log(log, fixes, machine.wheelbase_m)
    course = make_course([run])
    rig, settings = own_rig(machine, ground, course.origin)
    errors = errors_of(run_squares(course, rig, {0: settings}))
    stretches = tuple(_stretch(rig, stretch, settings) for stretch in course.stretches)
    left_out = course.rows_read - course.rows
    return Replayed(run.name, machine.name, tuple(settings), errors, stretches, left_out), remarks(run)


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
