"""A Kalman filter over the pose of a tractor and its deviations from the model's motion.

The pose is advanced by simulated increments, and soil and slow
drifts of the receivers are parts of the state; here step by step, as fixes come in. The same filter serves twice:

- the tracker lets the tractor turn and slip differently from the model for some seconds: it estimates how the real one
  drives now, and predicts this over the age of the next fix;
- the monitor assumes that the tractor is as its file says, on ordinary soil, with ordinary instruments. Its innovations
  show what noise does not explain (vehicle.twin.mismatch).

State (10,): east, north (m) of the centre of mass, heading (rad), extra turn (rad per m driven), slip ahead (share of
the distance), drift of heading, east, north, and the delay of commands beyond the assumed one, as a share of the time
between two observed commands: a lasting part and a momentary one. Measured: east and north of the antenna, heading,
speed.
"""

from __future__ import annotations

import math

import numpy as np

from fields.arrays import Floats
from vehicle.jit import compile_function
from vehicle.model.gnss import DRIFT_MEMORY_S, SOIL_MEMORY_S
from vehicle.twin.step_motion import TractorNoise

MEASUREMENT_SIZE = 4
TURN, SLIP, HEADING_DRIFT, EAST_DRIFT, NORTH_DRIFT, COMMAND_DELAY, COMMAND_DELAY_NOW = range(3, 10)
STATE_SIZE = COMMAND_DELAY_NOW + 1
# Commands take effect at any time between two observed ones (sd 1 / root 12, rounded up). The cycles of a link and of a
# tractor's controller stay in phase for minutes; the momentary part is forgotten after one manoeuvre.
COMMAND_DELAY_SIGMA, COMMAND_DELAY_MEMORY_S, COMMAND_DELAY_NOW_MEMORY_S = 0.35, 600.0, 3.0
# Shifts of a pose per typical size of an effect of the catalogue; see vehicle.twin.mismatch.
OFFSET, GAIN, LEFT_GAIN, LATE_TURN, WHEEL_SLIP, SLOPE_EAST, SLOPE_NORTH, DRAFT, TOOL_SLIP = range(9)
BIAS, FORWARD, RIGHT, LATE = range(9, 13)
SHIFT_COUNT = LATE + 1


# Parameters of a filter: standard deviations of tractor and instruments, and memories in s. Turn is in rad per m, slip
# a share, along in m per root second; headings are in rad, positions and their drift in m, speed in m/s.
TURN_SIGMA, TURN_MEMORY, SLIP_SIGMA, SLIP_MEMORY, ALONG_SIGMA, HEADING_DRIFT_SIGMA, DRIFT_SIGMA, DRIFT_MEMORY = range(8)
POSITION_SIGMA, HEADING_SIGMA, SPEED_SIGMA = range(8, 11)
PLACED_SIGMA_M, PLACED_SIGMA_RAD = 0.05, 0.02  # uncertainty of a pose that a filter begins with


def build_tracker_parameters(noise: TractorNoise) -> Floats:
    """Parameters of the tracker: for some seconds the tractor may turn more than its file says by what a wheel offset
    of 1 degree does, and slip 8 %, the typical sizes in the catalogue."""
    return _build_parameters(noise, (0.007, 3.0), (0.08, 5.0), 0.02, max(noise.speed_mps, 0.02))


def build_monitor_parameters(noise: TractorNoise) -> Floats:
    """Parameters of the monitor: the file is right, and the noise is as given."""
    return _build_parameters(noise, (noise.soil_per_m, SOIL_MEMORY_S), (0.0, 1.0), noise.along_m, 1.0)


def _build_parameters(
    noise: TractorNoise, turn: tuple[float, float], slip: tuple[float, float], along_m: float, speed_mps: float
) -> Floats:
    """Parameters (11,) with the instruments of a noise; `turn` and `slip` are a size and its memory."""
    drift = noise.heading_drift_rad, noise.position_drift_m, DRIFT_MEMORY_S
    return np.array([*turn, *slip, along_m, *drift, noise.position_m, noise.heading_rad, speed_mps])


class PoseFilter:
    """Estimate (10,), its covariance (10, 10) and the parameters (11,)."""

    def __init__(self, parameters: Floats, pose: Floats) -> None:
        self.parameters = parameters
        self.estimate, self.covariance = np.zeros(STATE_SIZE), np.zeros((STATE_SIZE, STATE_SIZE))
        self.reset(pose)

    def reset(self, pose: Floats) -> None:
        """Restart from a pose (x, y, angle)."""
        self.estimate[:] = 0.0
        self.estimate[:3] = pose
        of_pose, of_commands = [PLACED_SIGMA_M, PLACED_SIGMA_M, PLACED_SIGMA_RAD], [COMMAND_DELAY_SIGMA] * 2
        of_motion = self.parameters[[TURN_SIGMA, SLIP_SIGMA, HEADING_DRIFT_SIGMA, DRIFT_SIGMA, DRIFT_SIGMA]]
        sigmas = [*of_pose, *of_motion, *of_commands]
        self.covariance[:] = np.diag(np.square(sigmas))

    @property
    def arrays(self) -> tuple[Floats, Floats, Floats]:
        """Estimate, covariance and parameters, as compiled functions take them."""
        return self.estimate, self.covariance, self.parameters

    def add_position_uncertainty(self, position_m: float) -> None:
        """Add a standard deviation to the place; all else stays."""
        self.covariance[0, 0] += position_m**2
        self.covariance[1, 1] += position_m**2


@compile_function
def _predict_shifts(shifts, sizes, step, nominal, cosine, sine, working, rear, crab) -> None:  # type: ignore[no-untyped-def]
    """Predict the deviations by effects (see `predict_filter`): what a filter predicts, and what each effect adds."""
    f, r, turned, distance_m = nominal[0], nominal[1], nominal[2], nominal[3]
    east, north = f * cosine + r * sine, f * sine - r * cosine
    for k in range(len(shifts)):
        shifts[k] = step @ shifts[k]
        bend = ahead = 0.0
        if k == OFFSET:
            bend = distance_m
        elif k == GAIN or (k == LEFT_GAIN and turned > 0.0):
            bend = turned
        elif k == LATE_TURN:
            bend = -nominal[4]
        elif k == DRAFT:
            bend = distance_m * working
        elif k == WHEEL_SLIP:
            ahead = -1.0
        elif k == TOOL_SLIP:
            ahead = -working
        aside = distance_m * (sine if k == SLOPE_EAST else -cosine if k == SLOPE_NORTH else 0.0)
        bend, ahead, aside = bend * sizes[k], ahead * sizes[k], aside * sizes[k]
        lever = rear - crab if k == DRAFT else rear
        shifts[k, 0] += ahead * east - 0.5 * bend * north - lever * bend * sine + aside * sine
        shifts[k, 1] += ahead * north + 0.5 * bend * east + lever * bend * cosine - aside * cosine
        shifts[k, 2] += bend


@compile_function
def predict_filter(  # type: ignore[no-untyped-def]
    estimate, covariance, parameters, angle, nominal, dt, moves_pose, working, rear, crab, shifts, sizes
) -> None:
    """Predict a filter over a piece of motion `nominal` (vehicle.twin.propagation) that began at the heading `angle`.

    With `moves_pose` the pose of the estimate moves too. Steering turns a tractor about its rear axle, `rear` m behind
    the centre of mass, a side draft about a place `crab` m ahead of that axle. `shifts` (k, 10) are the deviations of
    the truth from the estimate with each effect at its size in `sizes` (k,).
    """
    f, r, turned, distance_m = nominal[0], nominal[1], nominal[2], nominal[3]
    cosine, sine = math.cos(angle), math.sin(angle)
    east, north = f * cosine + r * sine, f * sine - r * cosine
    turn, slip = math.exp(-dt / parameters[TURN_MEMORY]), math.exp(-dt / parameters[SLIP_MEMORY])
    slow = math.exp(-dt / parameters[DRIFT_MEMORY])
    step = np.eye(STATE_SIZE)
    step[0, 2], step[1, 2] = -north, east
    # Extra turn moves the end of the piece aside by half its angle.
    step[2, TURN], step[0, TURN], step[1, TURN] = distance_m, -0.5 * distance_m * north, 0.5 * distance_m * east
    step[0, SLIP], step[1, SLIP] = east, north
    step[TURN, TURN], step[SLIP, SLIP] = turn, slip
    step[HEADING_DRIFT, HEADING_DRIFT] = step[EAST_DRIFT, EAST_DRIFT] = step[NORTH_DRIFT, NORTH_DRIFT] = slow
    persistence, persistence_now = math.exp(-dt / COMMAND_DELAY_MEMORY_S), math.exp(-dt / COMMAND_DELAY_NOW_MEMORY_S)
    for late, retained in ((COMMAND_DELAY, persistence), (COMMAND_DELAY_NOW, persistence_now)):
        ahead, bend = -nominal[6] * nominal[5], -nominal[6] * nominal[4]
        step[0, late], step[1, late] = ahead * cosine - rear * bend * sine, ahead * sine + rear * bend * cosine
        step[2, late], step[late, late] = bend, retained
    if moves_pose:
        for i in range(3):
            for j in range(TURN, STATE_SIZE):
                estimate[i] += step[i, j] * estimate[j]
        estimate[0] += east
        estimate[1] += north
        estimate[2] += turned
    for j in range(TURN, STATE_SIZE):
        estimate[j] *= step[j, j]
    covariance[:] = step @ covariance @ step.T
    covariance[TURN, TURN] += parameters[TURN_SIGMA] ** 2 * (1.0 - turn * turn)
    covariance[SLIP, SLIP] += parameters[SLIP_SIGMA] ** 2 * (1.0 - slip * slip)
    covariance[HEADING_DRIFT, HEADING_DRIFT] += parameters[HEADING_DRIFT_SIGMA] ** 2 * (1.0 - slow * slow)
    covariance[EAST_DRIFT, EAST_DRIFT] += parameters[DRIFT_SIGMA] ** 2 * (1.0 - slow * slow)
    covariance[NORTH_DRIFT, NORTH_DRIFT] += parameters[DRIFT_SIGMA] ** 2 * (1.0 - slow * slow)
    pace = min(distance_m / dt, 1.0)  # no scatter at standstill
    push, side = (parameters[ALONG_SIGMA] * pace) ** 2 * dt, (0.1 * parameters[ALONG_SIGMA] * pace) ** 2 * dt
    covariance[0, 0] += push * cosine * cosine + side * sine * sine
    covariance[1, 1] += push * sine * sine + side * cosine * cosine
    covariance[0, 1] += (push - side) * cosine * sine
    covariance[1, 0] += (push - side) * cosine * sine
    # There may have been other commands between two observed ones: a changing turn is uncertain by as much again.
    bend = nominal[6] * nominal[4]
    swing = np.array([-rear * bend * sine, rear * bend * cosine, bend])
    covariance[:3, :3] += np.outer(swing, swing)
    covariance[COMMAND_DELAY, COMMAND_DELAY] += COMMAND_DELAY_SIGMA**2 * (1.0 - persistence * persistence)
    covariance[COMMAND_DELAY_NOW, COMMAND_DELAY_NOW] += COMMAND_DELAY_SIGMA**2 * (
        1.0 - persistence_now * persistence_now
    )
    _predict_shifts(shifts, sizes, step, nominal, cosine, sine, working, rear, crab)


@compile_function
def update_scalar(  # type: ignore[no-untyped-def]
    estimate, covariance, sensitivity, innovation, variance, shifts, measured_shift, means
) -> float:
    """Update with one measured number of this `sensitivity` (10,) to the state and `innovation`.

    Each effect would add `measured_shift` (k,) to the number; `means` (k,) gets its influence on the whitened
    innovation, which is returned. Shifts are corrected like the estimate.
    """
    cross = covariance @ sensitivity
    total = float(sensitivity @ cross) + variance
    root = math.sqrt(total)
    gain = cross / total
    estimate += gain * innovation
    for k in range(len(shifts)):
        shift = float(sensitivity @ shifts[k]) + measured_shift[k]
        means[k] = shift / root
        shifts[k] -= gain * shift
    covariance -= np.outer(gain, cross)
    return innovation / root  # type: ignore[no-any-return]


@compile_function
def update_by_fix(  # type: ignore[no-untyped-def]
    estimate, covariance, parameters, fix, ahead, aside, forward, spin, speed_uncertainty_mps,
    shifts, sizes, outlier_sigmas, whitened, means,
) -> bool:  # fmt: skip
    """Update with a fix (4,): east, north of the antenna, heading, speed. Returns False, unchanged, for an outlier.

    `ahead` and `aside` are the antenna's lever arm, `forward` and `spin` speed and turning rate of the model;
    `speed_uncertainty_mps` is the uncertainty of that speed, below 0 to ignore the measured speed. `whitened` (4,) gets
    the innovations over their standard deviations, which are independent if the filter is right; `means` (4, k) the
    influence of each effect on them. A fix is an outlier if an innovation exceeds `outlier_sigmas`.
    """
    cosine, sine = math.cos(estimate[2]), math.sin(estimate[2])
    lever_east, lever_north = ahead * cosine + aside * sine, ahead * sine - aside * cosine
    rows = np.zeros((MEASUREMENT_SIZE, STATE_SIZE))
    rows[0, 0] = rows[0, EAST_DRIFT] = rows[1, 1] = rows[1, NORTH_DRIFT] = rows[2, 2] = rows[2, HEADING_DRIFT] = 1.0
    rows[0, 2], rows[1, 2] = -lever_north, lever_east
    rows[3, SLIP] = forward
    turned = fix[2] - estimate[2] - estimate[HEADING_DRIFT]
    innovation = np.array(
        [
            fix[0] - estimate[0] - lever_east - estimate[EAST_DRIFT],
            fix[1] - estimate[1] - lever_north - estimate[NORTH_DRIFT],
            math.atan2(math.sin(turned), math.cos(turned)),
            fix[3] - forward * (1.0 + estimate[SLIP]),
        ]
    )
    speed_variance = parameters[SPEED_SIGMA] ** 2 + speed_uncertainty_mps * speed_uncertainty_mps
    variance = np.array(
        [
            parameters[POSITION_SIGMA] ** 2,
            parameters[POSITION_SIGMA] ** 2,
            parameters[HEADING_SIGMA] ** 2,
            speed_variance,
        ]
    )
    count = MEASUREMENT_SIZE if speed_uncertainty_mps >= 0.0 else MEASUREMENT_SIZE - 1
    for i in range(count):
        if abs(innovation[i]) > outlier_sigmas * math.sqrt(rows[i] @ covariance @ rows[i] + variance[i]):
            return False
    first = estimate.copy()
    measured_shifts = np.zeros((MEASUREMENT_SIZE, len(shifts)))
    if len(shifts) > 0:
        measured_shifts[2, BIAS] = sizes[BIAS]
        measured_shifts[0, FORWARD], measured_shifts[1, FORWARD] = sizes[FORWARD] * cosine, sizes[FORWARD] * sine
        measured_shifts[0, RIGHT], measured_shifts[1, RIGHT] = sizes[RIGHT] * sine, -sizes[RIGHT] * cosine
        measured_shifts[0, LATE] = -sizes[LATE] * forward * cosine
        measured_shifts[1, LATE] = -sizes[LATE] * forward * sine
        measured_shifts[2, LATE] = -sizes[LATE] * spin
    whitened[:] = 0.0
    means[:] = 0.0
    for i in (2, 0, 1, 3):  # the heading first: a jump of the place says nothing about it
        if i >= count:
            continue
        remaining = innovation[i] - rows[i] @ (estimate - first)
        whitened[i] = update_scalar(
            estimate, covariance, rows[i], remaining, variance[i], shifts, measured_shifts[i], means[i]
        )
    return True
