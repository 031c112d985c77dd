"""One run replayed: what was measured, what the simulation makes of the same commands, and the error by horizon."""

from __future__ import annotations

import math

import numpy as np

from vehicle.measured.anchoring import HEADING_TRUST_RAD, POSITION_TRUST_M
from vehicle.measured.bench import Bench, first_noise
from vehicle.measured.course import Stretch, make_course
from vehicle.measured.horizons import anchored, chain, errors_of, pieces, run_squares
from vehicle.measured.logs import read_log, remarks
from vehicle.measured.record import Array
from vehicle.measured.replay import Settings, own_rig
from vehicle.measured.verdict import Replayed, ReplayedStretch
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
    bench = Bench(course, rig, first_noise(course), (), (), ())
    errors = errors_of(run_squares(bench, {0: settings}))
    stretches = tuple(_stretch(bench, stretch, settings) for stretch in course.stretches)
    left_out = course.rows_read - course.rows
    return Replayed(run.name, machine.name, tuple(settings), errors, stretches, left_out), remarks(run)


def _stretch(bench: Bench, stretch: Stretch, settings: Settings) -> ReplayedStretch:
    antenna, heading, wheel, speed = chain(bench, stretch, settings)
    turn, shift = lay_on(stretch, antenna, heading)
    parts = tuple((rows, anchored(stretch, antenna, heading, rows)) for rows in pieces(stretch.time, PIECE_S))
    return ReplayedStretch(stretch, antenna @ turn.T + shift, wheel, speed, parts)


def lay_on(stretch: Stretch, antenna: Array, heading: Array, seconds: float = LAID_S) -> tuple[Array, Array]:
    """Turn (2, 2) and shift (2,) that lay the simulated start on the measured one.

    Least squares over the first seconds, positions with the trust of `anchoring`; headings decide while it stands.
    """
    rows = slice(0, max(int(np.searchsorted(stretch.time, seconds)), 2))
    measured = np.stack([stretch.east[rows], stretch.north[rows]], axis=1)
    simulated = antenna[rows]
    a, b = measured - measured.mean(axis=0), simulated - simulated.mean(axis=0)
    apart = np.exp(1j * (stretch.heading[rows] - heading[rows]))
    trust = (POSITION_TRUST_M / HEADING_TRUST_RAD) ** 2
    both = complex(np.sum(a * b), np.sum(b[:, 0] * a[:, 1] - b[:, 1] * a[:, 0])) + trust * complex(apart.sum())
    angle = math.atan2(both.imag, both.real)
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    return turn, measured.mean(axis=0) - turn @ simulated.mean(axis=0)
