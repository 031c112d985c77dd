"""A Kalman filter over a tractor's pose and what turns and slows it, given how the model moved it.

As in vehicle.measured.surprise.whitening the pose is advanced by simulated increments, and soil and slow drifts of the
receivers are parts of the state; here step by step, as fixes come in. The same filter serves twice:

- the tracker lets the tractor turn and slip otherwise than the model for seconds: it finds out how the real one drives
  now, and foretells it over the age of the next fix;
- the witness believes that the tractor is as its file says, on ordinary soil, with ordinary instruments. What still
  surprises it is what noise does not explain (vehicle.twin.doubt).

State (10,): east, north (m) of the centre of mass, heading (rad), turn besides the model's (rad per m driven), slip
ahead (share of the way), drift of heading, east, north, and how much later than taken commands come into force, as a
share of the time between two that were seen: always, and just now. Measured: east and north of the antenna, heading,
speed.
"""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass

import numpy as np

from vehicle.jit import compiled
from vehicle.twin.motion import DRIFT_MEMORY_S, SOIL_MEMORY_S, Array, Noise

SIZE, SEEN = 10, 4
TURN, SLIP, HEADING_DRIFT, EAST_DRIFT, NORTH_DRIFT, LATER, LATER_NOW = range(3, 10)
# Commands come into force at any time between two that were seen (sd 1 / root 12, rounded up); the beat of a link and
# of a tractor's controller stay in step for minutes, what one manoeuvre meets is forgotten after it.
LATER_SD, LATER_S, LATER_NOW_S = 0.35, 600.0, 3.0
# What would shift a pose, per typical size of an effect of the catalogue; see vehicle.twin.doubt.
OFFSET, GAIN, LEFT, LATE_TURN, SLIPPING, SLOPE_EAST, SLOPE_NORTH, DRAFT, TOOL_SLIP = range(9)
BIAS, FORWARD, RIGHT, LATE = range(9, 13)
SHIFTS = 13


@dataclass(frozen=True)
class Trust:
    """What a filter believes of the tractor and its instruments: standard deviations, and memories in s.

    Turn in rad per m, slip as a share, along in m per root second; `start_m` and `start_rad` of the pose at the start.
    """

    turn_per_m: float
    turn_s: float
    slip: float
    slip_s: float
    along_m: float
    heading_drift_rad: float
    drift_m: float
    drift_s: float
    position_m: float
    heading_rad: float
    speed_mps: float
    start_m: float = 0.05
    start_rad: float = 0.02


def tracking(noise: Noise) -> Trust:
    """The tracker's trust: for seconds the tractor may turn by what an offset of the wheels of 1 degree does more than
    its file says, and slip 8 %, the usual sizes in the catalogue."""
    return Trust(
        0.007, 3.0, 0.08, 5.0, 0.02, noise.heading_drift_rad, noise.position_drift_m, DRIFT_MEMORY_S,
        noise.position_m, noise.heading_rad, max(noise.speed_mps, 0.02),
    )  # fmt: skip


def witnessing(noise: Noise) -> Trust:
    """The witness's trust: the file is right, and noise is what it is said to be."""
    return Trust(
        noise.soil_per_m, SOIL_MEMORY_S, 0.0, 1.0, noise.along_m, noise.heading_drift_rad, noise.position_drift_m,
        DRIFT_MEMORY_S, noise.position_m, noise.heading_rad, 1.0,
    )  # fmt: skip


class Belief:
    """Estimate (10,), its covariance (10, 10) and the trust as an array."""

    def __init__(self, trust: Trust, pose: Array) -> None:
        self.spec = np.array(astuple(trust))
        self.estimate, self.cov = np.zeros(SIZE), np.zeros((SIZE, SIZE))
        self.start(pose, trust.start_m, trust.start_rad)

    def start(self, pose: Array, position_m: float, heading_rad: float) -> None:
        """Believe a pose (x, y, angle) so far."""
        spec = self.spec
        self.estimate[:] = 0.0
        self.estimate[:3] = pose
        sure = [position_m, position_m, heading_rad, spec[0], spec[2], spec[5], spec[6], spec[6], LATER_SD, LATER_SD]
        self.cov[:] = np.diag(np.square(sure))

    def unsure_of_place(self, position_m: float) -> None:
        """Believe that the tractor may be so much farther away; of all else as before."""
        self.cov[0, 0] += position_m**2
        self.cov[1, 1] += position_m**2


@compiled
def spread(  # type: ignore[no-untyped-def]
    estimate, cov, spec, angle, nominal, dt, own, working, rear, shifts, sizes
) -> None:  # fmt: skip
    """Let a belief follow a piece of motion `nominal` (vehicle.twin.rolling) that began at the heading `angle`.

    `own` moves the pose of the estimate too. What the wheels do turns a tractor about its rear axle, `rear` m behind
    the centre of mass. `shifts` (k, 10) are how far the truth would be from the estimate with each effect at its size
    in `sizes` (k,).
    """
    f, r, turned, way = nominal[0], nominal[1], nominal[2], nominal[3]
    cosine, sine = math.cos(angle), math.sin(angle)
    east, north = f * cosine + r * sine, f * sine - r * cosine
    turn, slip = math.exp(-dt / spec[1]), math.exp(-dt / spec[3])
    slow = math.exp(-dt / spec[7])
    step = np.eye(SIZE)
    step[0, 2], step[1, 2] = -north, east
    # Turning besides carries the end of the piece aside by half its angle.
    step[2, TURN], step[0, TURN], step[1, TURN] = way, -0.5 * way * north, 0.5 * way * east
    step[0, SLIP], step[1, SLIP] = east, north
    step[TURN, TURN], step[SLIP, SLIP] = turn, slip
    step[HEADING_DRIFT, HEADING_DRIFT] = step[EAST_DRIFT, EAST_DRIFT] = step[NORTH_DRIFT, NORTH_DRIFT] = slow
    beat, now = math.exp(-dt / LATER_S), math.exp(-dt / LATER_NOW_S)
    for late, keep in ((LATER, beat), (LATER_NOW, now)):
        ahead, bend = -nominal[6] * nominal[5], -nominal[6] * nominal[4]
        step[0, late], step[1, late] = ahead * cosine - rear * bend * sine, ahead * sine + rear * bend * cosine
        step[2, late], step[late, late] = bend, keep
    if own:
        for i in range(3):
            for j in range(TURN, SIZE):
                estimate[i] += step[i, j] * estimate[j]
        estimate[0] += east
        estimate[1] += north
        estimate[2] += turned
    for j in range(TURN, SIZE):
        estimate[j] *= step[j, j]
    cov[:] = step @ cov @ step.T
    cov[TURN, TURN] += spec[0] ** 2 * (1.0 - turn * turn)
    cov[SLIP, SLIP] += spec[2] ** 2 * (1.0 - slip * slip)
    cov[HEADING_DRIFT, HEADING_DRIFT] += spec[5] ** 2 * (1.0 - slow * slow)
    cov[EAST_DRIFT, EAST_DRIFT] += spec[6] ** 2 * (1.0 - slow * slow)
    cov[NORTH_DRIFT, NORTH_DRIFT] += spec[6] ** 2 * (1.0 - slow * slow)
    pace = min(way / dt, 1.0)  # a tractor that stands does not scatter
    push, side = (spec[4] * pace) ** 2 * dt, (0.1 * spec[4] * pace) ** 2 * dt
    cov[0, 0] += push * cosine * cosine + side * sine * sine
    cov[1, 1] += push * sine * sine + side * cosine * cosine
    cov[0, 1] += (push - side) * cosine * sine
    cov[1, 0] += (push - side) * cosine * sine
    # Between two that were seen there may have been others: turning is as unsure again where it changes.
    bend = nominal[6] * nominal[4]
    swing = np.array([-rear * bend * sine, rear * bend * cosine, bend])
    cov[:3, :3] += np.outer(swing, swing)
    cov[LATER, LATER] += LATER_SD**2 * (1.0 - beat * beat)
    cov[LATER_NOW, LATER_NOW] += LATER_SD**2 * (1.0 - now * now)
    for k in range(len(shifts)):
        shifts[k] = step @ shifts[k]
        bend = ahead = 0.0
        if k == OFFSET:
            bend = way
        elif k == GAIN or (k == LEFT and turned > 0.0):
            bend = turned
        elif k == LATE_TURN:
            bend = -nominal[4]
        elif k == DRAFT:
            bend = way * working
        elif k == SLIPPING:
            ahead = -1.0
        elif k == TOOL_SLIP:
            ahead = -working
        aside = way * (sine if k == SLOPE_EAST else -cosine if k == SLOPE_NORTH else 0.0)
        bend, ahead, aside = bend * sizes[k], ahead * sizes[k], aside * sizes[k]
        shifts[k, 0] += ahead * east - 0.5 * bend * north - rear * bend * sine + aside * sine
        shifts[k, 1] += ahead * north + 0.5 * bend * east + rear * bend * cosine - aside * cosine
        shifts[k, 2] += bend


@compiled
def scalar_update(estimate, cov, h, surprise, variance, shifts, shown, means) -> float:  # type: ignore[no-untyped-def]
    """One measured number: `h` (10,) how it depends on the state, `surprise` what it is more than expected.

    Each effect would have shown `shown` (k,) more; `means` (k,) gets what it makes of the whitened surprise, which is
    handed back. Shifts are corrected as the estimate is.
    """
    cross = cov @ h
    total = float(h @ cross) + variance
    root = math.sqrt(total)
    gain = cross / total
    estimate += gain * surprise
    for k in range(len(shifts)):
        more = float(h @ shifts[k]) + shown[k]
        means[k] = more / root
        shifts[k] -= gain * more
    cov -= np.outer(gain, cross)
    return surprise / root  # type: ignore[no-any-return]


@compiled
def measure(  # type: ignore[no-untyped-def]
    estimate, cov, spec, fix, ahead, aside, forward, spin, unsure, shifts, sizes, gate, whitened, means
) -> bool:  # fmt: skip
    """Take a fix (4,): east, north of the antenna, heading, speed. False, and nothing is taken, where it is absurd.

    `ahead` and `aside` are the antenna's lever, `forward` and `spin` the model's speed and turning rate, `unsure`
    by how much that speed may be wrong (m/s); below 0 the measured speed is left out. `whitened` (4,) gets the
    surprises, each over what was expected of it, and independent of each other where the belief is right; `means`
    (4, k) what each effect makes of them. A fix is absurd where one of them is beyond `gate`.
    """
    cosine, sine = math.cos(estimate[2]), math.sin(estimate[2])
    lever_east, lever_north = ahead * cosine + aside * sine, ahead * sine - aside * cosine
    rows = np.zeros((SEEN, SIZE))
    rows[0, 0] = rows[0, EAST_DRIFT] = rows[1, 1] = rows[1, NORTH_DRIFT] = rows[2, 2] = rows[2, HEADING_DRIFT] = 1.0
    rows[0, 2], rows[1, 2] = -lever_north, lever_east
    rows[3, SLIP] = forward
    turned = fix[2] - estimate[2] - estimate[HEADING_DRIFT]
    surprise = np.array([
        fix[0] - estimate[0] - lever_east - estimate[EAST_DRIFT],
        fix[1] - estimate[1] - lever_north - estimate[NORTH_DRIFT],
        math.atan2(math.sin(turned), math.cos(turned)),
        fix[3] - forward * (1.0 + estimate[SLIP]),
    ])
    variance = np.array([spec[8] ** 2, spec[8] ** 2, spec[9] ** 2, spec[10] ** 2 + unsure * unsure])
    seen = SEEN if unsure >= 0.0 else SEEN - 1
    for i in range(seen):
        if abs(surprise[i]) > gate * math.sqrt(rows[i] @ cov @ rows[i] + variance[i]):
            return False
    first = estimate.copy()
    shown = np.zeros((SEEN, len(shifts)))
    if len(shifts) > 0:
        shown[2, BIAS] = sizes[BIAS]
        shown[0, FORWARD], shown[1, FORWARD] = sizes[FORWARD] * cosine, sizes[FORWARD] * sine
        shown[0, RIGHT], shown[1, RIGHT] = sizes[RIGHT] * sine, -sizes[RIGHT] * cosine
        shown[0, LATE], shown[1, LATE] = -sizes[LATE] * forward * cosine, -sizes[LATE] * forward * sine
        shown[2, LATE] = -sizes[LATE] * spin
    whitened[:] = 0.0
    means[:] = 0.0
    for i in (2, 0, 1, 3):  # the heading first: a place that leaps says nothing of it
        if i >= seen:
            continue
        left = surprise[i] - rows[i] @ (estimate - first)
        whitened[i] = scalar_update(estimate, cov, rows[i], left, variance[i], shifts, shown[i], means[i])
    return True
