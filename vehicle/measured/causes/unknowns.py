"""What no tractor file and no log tells of a tractor: free in every fit, as far as tractors differ in it.

The base model carries tyres of an assumed stiffness, turns at once with its wheels, and takes the measured speed for
that of the moment. Real tractors differ: each difference is a column of its own, whose amount is expected to be 0 and
to differ by 1 from tractor to tractor. Without them such a difference poses as whatever effect is like it, as stiffer
tyres do as understeer and a shifted antenna.
"""

from __future__ import annotations

import math

import numpy as np

from vehicle.circles import CIRCLE_SPEED_MPS
from vehicle.measured.causes.dependence import Response, Terms
from vehicle.measured.fit.fitting import Fit
from vehicle.measured.logs.record import Array
from vehicle.measured.replay.course import Stretch
from vehicle.measured.replay.replaying import Rig
from vehicle.measured.surprise.bench import Bench
from vehicle.measured.surprise.whitening import Increments
from vehicle.measured.thresholds import SENSORS_S

GRAVITY_MPS2 = 9.80665
LEAST_SHARE = 0.1  # of the speed of circles: slower the way says little of its bend


def unknowns(bench: Bench, fit: Fit) -> Array:
    """Columns (n, 3) of the surprises, each per usual difference: slip of the tyres, lag of turning, lag of the speed.

    That amounts are about 0 is told by the first rows of the stretches, in which the logs say nothing: together they
    are surprised by 1 for an amount of 1.
    """
    response, rows = Response(bench, fit), bench.course.rows
    stretches = bench.course.stretches
    path = [response.local(i, _differences(bench.rig, s, response.moves[i])) for i, s in enumerate(stretches)]
    out = np.concatenate([*path, np.zeros((2 * rows, path[0].shape[1]))])
    expected = 1.0 / math.sqrt(len(stretches))
    for place in response.places:
        out[place.start : place.start + 3] = expected * np.eye(3)
    return out


def _differences(rig: Rig, stretch: Stretch, move: Increments) -> Terms:
    """What the usual differences add to the motion simulated between rows: stiffer tyres, a turn and a speed ahead.

    Tyres that do not slip at all differ from those of the base model by as much as ones twice as soft. They keep the
    measured radius at the speed of the circles it was measured on.
    """
    dt, zero = np.diff(stretch.time), np.zeros_like(move.ahead)
    spin, pace = move.turned / dt, move.ahead / dt
    front, rear, base = float(rig.ground["front_slope"][0]), float(rig.ground["rear_slope"][0]), rig.tractor.wheelbase_m
    bend = np.divide(spin, pace, out=zero.copy(), where=np.abs(pace) > CIRCLE_SPEED_MPS * LEAST_SHARE)
    inwards = spin * pace / (GRAVITY_MPS2 * rear) * move.ahead
    faster = bend * (pace * pace - CIRCLE_SPEED_MPS**2)
    less_lost = faster * (1.0 / front - 1.0 / rear) / GRAVITY_MPS2 * (1.0 + (bend * base) ** 2) / base
    return [
        Increments(zero, -inwards, less_lost * move.ahead),
        Increments(zero, zero, SENSORS_S * np.gradient(spin, stretch.time[:-1]) * dt),
        Increments(SENSORS_S * np.gradient(pace, stretch.time[:-1]) * dt, zero, zero),
    ]
