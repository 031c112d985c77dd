"""The noise of a channel: what a window of residuals is like where the model is right.

The covariance of a window is a sum of known matrices with unknown amounts: noise of the sensor, random walks, and what
the base model never gets right (a yaw rate that wanders, timing, a speed that is a little off) carried through the
geometry of the window. Its start is not estimated: place and direction have a wide prior and are integrated out. What
slow wheel angles leave open is known and has no amount.
Windows follow a Student t distribution, so that one odd window does not decide.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize

from fields.arrays import Flags, Floats
from vehicle.identification.diagnosis.drive_data import (
    PATH_STEP_S,
    POSE_CELL_S,
    POSE_CELLS,
    SENSOR_CELL_S,
    SENSOR_CELLS,
    DriveData,
)

FREEDOM = 10.0  # of the Student t of a window: any from 4 to 30 gives the same names
UNSEEN_VARIANCE = 1e4  # of a cell without a sample, far above any residual: m2 or rad2
FREE_START_RAD = 0.2  # standard deviation of the direction at the start of a window, after the alignment
MOST_LOG_AMOUNT = 7.0  # how far the logarithm of a variance may go from its usual value
LOG_AMOUNT_SIGMA = 3.0  # standard deviation of that logarithm: a factor of 20
SETTLED_SHARE = 1e-6  # of the cost: a twentieth of a nat for ten minutes of logs
SMALLEST_HALF = 20  # rows from which a triangular matrix is inverted as a whole: smaller halves take no less time
COMMAND_JITTER = 0.29  # of the step between rows: 1 / sqrt(12), a command may have come at any time in between


class NoisePart(NamedTuple):
    """A part of the noise of a channel: its usual standard deviation, by which a fit begins; the most that is still
    noise; for how long (s) it is remembered, 0 for white noise; and what shows a pose in which it is louder."""

    usual: float
    most: float = math.inf
    memory_s: float = 0.0
    shown_by: str = ""


# Usual are RTK positions, a dual-antenna heading, farm tyres. The most is one to two times what nine in ten of 53 sets
# of three truths by other hands stay under; of crab, which fits overstate, eight in ten. White noise of receivers and
# sensors has no limit.
POSE_PARTS = (
    NoisePart(4e-3),  # positions, m
    NoisePart(1e-3),  # headings, rad
    NoisePart(6e-4, 0.02, shown_by="position"),  # positions that wander
    NoisePart(1e-3, 0.01, 20.0),  # headings that are off for a while
    NoisePart(3e-3, 0.005, 0.6, "path"),  # yaw rates that wander: a bump, a rut, a slope
    NoisePart(1e-3, 0.0012, 3.0, "path"),
    NoisePart(5e-4, 0.0005, 20.0, "path"),
    NoisePart(1e-2, 0.02, 3.0, "path"),  # yaw rates in proportion to turning
    NoisePart(8e-3, 0.02, shown_by="speed"),  # speeds that are a little off
    NoisePart(3e-3, 0.003, 5.0, "speed"),
    NoisePart(1e-3, 0.005, 3.0, "heading"),  # crab
    NoisePart(3e-3, 0.006),  # timing
)
SENSOR_PARTS = {
    "wheel": (
        NoisePart(math.radians(0.04)), NoisePart(math.radians(0.03), 3e-4, 0.3),
        NoisePart(math.radians(0.02), 8e-4, 3.0), NoisePart(0.02, 0.05), NoisePart(0.03, 0.07, 0.3),
    ),
    "speed": (
        NoisePart(0.01), NoisePart(0.005, 0.008, 1.0), NoisePart(0.003, 0.004, 10.0), NoisePart(0.1, 0.015),
        NoisePart(0.1, 0.13, 1.0),
    ),
}  # fmt: skip
"""White and slow noise (rad, m/s), and errors of timing (s) in proportion to the rate of change, white and slow."""


@dataclass(eq=False)
class ChannelNoise:
    """The distribution of the residuals of a channel, window by window.

    `parts` (p, w, n, n) are known matrices, `amounts` (p,) logarithms of their variances, `known` (w, n, n) the
    covariance of the start and of what else has no amount, `observed` (w, n) the cells with a sample.
    """

    parts: Floats
    amounts: Floats
    known: Floats
    free_count: int
    observed: Flags
    usual: Floats = field(init=False)

    def __post_init__(self) -> None:
        self.usual = self.amounts.copy()
        self.counts = np.maximum(self.observed.sum(axis=1) - self.free_count, 0)
        self.fixed = self.known + UNSEEN_VARIANCE * (~self.observed)[:, :, None] * np.eye(self.observed.shape[1])
        self.set_amounts(self.amounts)

    def set_amounts(self, amounts: Floats) -> None:
        """Factor the covariance for other amounts (p,)."""
        self.amounts = amounts.copy()
        covariance = np.tensordot(np.exp(amounts), self.parts, axes=1) + self.fixed
        lower: Floats = np.asarray(np.linalg.cholesky(covariance), dtype=np.float64)
        self.inverse = invert_lower(lower)
        self.log_sizes = np.log(np.diagonal(lower, axis1=1, axis2=2))

    def whiten(self, residuals: Floats) -> Floats:
        """Residuals (w, n) or (w, n, k) as independent ones of unit size."""
        if residuals.ndim == 2:
            return np.asarray((self.inverse @ residuals[:, :, None])[:, :, 0])
        return np.asarray(self.inverse @ residuals)

    def compute_log_density(self, white: Floats) -> Floats:
        """Log density (w,) of whitened residuals (w, n)."""
        squares = (white * white).sum(axis=1)
        log_sizes = self.log_sizes.sum(axis=1)
        return np.asarray(-log_sizes - 0.5 * (FREEDOM + self.counts) * np.log1p(squares / FREEDOM))

    def compute_cell_densities(self, white: Floats) -> Floats:
        """The same split among cells (w, n), each given those before it; 0 where nothing was measured."""
        seen = self.observed
        squares = white * white * seen
        counts = np.cumsum(seen, axis=1) - 1
        total = np.cumsum(squares, axis=1)
        density = -0.5 * (FREEDOM + counts + 1) * np.log1p(total / FREEDOM)
        density += 0.5 * (FREEDOM + counts) * np.log1p((total - squares) / FREEDOM)
        return np.asarray((density - self.log_sizes) * seen)

    def compute_weights(self, white: Floats) -> Floats:
        """Weights (w,) of windows in a least-squares step: small for odd ones."""
        return np.asarray((FREEDOM + self.counts) / (FREEDOM + (white * white).sum(axis=1)))

    def fit(self, residuals: Floats, iterations: int) -> None:
        """Fit the amounts to residuals (w, n), with a wide prior around the usual ones."""
        if not self.observed.any():
            return

        def evaluate(amounts: Floats) -> tuple[float, Floats]:
            self.set_amounts(amounts)
            white = self.whiten(residuals)
            solved = np.einsum("wba,wb->wa", self.inverse, white)
            weights = self.compute_weights(white)
            inner = weights[:, None, None] * solved[:, :, None] * solved[:, None, :]
            inner -= self.inverse.transpose(0, 2, 1) @ self.inverse
            parts = self.parts.reshape(len(amounts), -1)
            slope = 0.5 * (parts @ inner.ravel()) * np.exp(amounts)
            away = (amounts - self.usual) / LOG_AMOUNT_SIGMA
            cost = -self.compute_log_density(white).sum() + 0.5 * float(away @ away)
            return cost, -slope + away / LOG_AMOUNT_SIGMA

        bounds = [(usual - MOST_LOG_AMOUNT, usual + MOST_LOG_AMOUNT) for usual in self.usual]
        best = minimize(evaluate, self.amounts, jac=True, method="L-BFGS-B", bounds=bounds,
                        options={"maxiter": iterations, "ftol": SETTLED_SHARE})  # fmt: skip
        self.set_amounts(np.asarray(best.x))


def invert_lower(lower: Floats) -> Floats:
    """The inverses of lower triangular matrices (w, n, n), by halves: a third of the time of a general inverse."""
    size = lower.shape[1]
    if size <= SMALLEST_HALF:
        return np.asarray(np.linalg.inv(lower))
    half = size // 2
    first, last = invert_lower(lower[:, :half, :half]), invert_lower(lower[:, half:, half:])
    out = np.zeros_like(lower)
    out[:, :half, :half], out[:, half:, half:] = first, last
    out[:, half:, :half] = -last @ (lower[:, half:, :half] @ first)
    return out


def compute_memory(times: Floats, time_constant: float) -> Floats:
    """Covariance (n, n) of unit noise that forgets with a time constant (s), at once for 0."""
    apart = np.abs(times[:, None] - times[None])
    return np.asarray(np.exp(-apart / time_constant)) if time_constant else np.eye(len(times))


def build_pose_noise(data: DriveData, ahead: float, wheelbase_m: float) -> ChannelNoise:
    """Noise of east, north and heading together (w, 3 n); the antenna is `ahead` (m) of the rear axle."""
    n, windows = POSE_CELLS, data.windows
    times = np.asarray(POSE_CELL_S * np.arange(n), dtype=np.float64)
    one = np.broadcast_to(np.eye(n), (windows, n, n))
    speed, heading, yaw = cut_motion(data)
    total = integrate_cells()
    cosine, sine = np.cos(heading)[:, :, None], np.sin(heading)[:, :, None]
    along, none = speed[:, :, None], np.zeros((windows, n, n))
    by_yaw = build_yaw_response(data, ahead)
    by_speed = np.concatenate([total @ (cosine * one), total @ (sine * one), none], axis=1)
    by_crab = np.concatenate([-(total @ (along * sine * one)), total @ (along * cosine * one), none], axis=1)
    by_time = np.concatenate([along * cosine * one, along * sine * one, yaw[:, :, None] * one], axis=1)
    by_turning = by_yaw * np.abs(yaw)[:, None, :]

    def place(position: float, direction: float, memory: Floats) -> Floats:
        block = np.kron(np.diag([position, position, direction]), memory)
        return np.broadcast_to(block, (windows, 3 * n, 3 * n))

    memories = [compute_memory(times, part.memory_s) for part in POSE_PARTS]
    walk = np.minimum(times[:, None], times[None]) + POSE_CELL_S
    carried = (by_yaw, by_yaw, by_yaw, by_turning, by_speed, by_speed, by_crab, by_time)
    parts = [place(1.0, 0.0, memories[0]), place(0.0, 1.0, memories[1]), place(1.0, 0.0, walk),
             place(0.0, 1.0, memories[3])]  # fmt: skip
    parts += [how @ memory @ how.transpose(0, 2, 1) for how, memory in zip(carried, memories[4:], strict=True)]
    # The place and the direction at the start of a window are unknown: a rigid motion.
    free = np.zeros((windows, 3 * n, 3))
    free[:, :n, 0] = free[:, n : 2 * n, 1] = 1.0
    east = (speed * np.cos(heading)) @ total.T + ahead * np.cos(heading)
    north = (speed * np.sin(heading)) @ total.T + ahead * np.sin(heading)
    free[:, :, 2] = FREE_START_RAD * np.concatenate([-north, east, np.ones_like(east)], axis=1)
    by_wheel = by_yaw * (speed / wheelbase_m)[:, None, :]
    known = free @ free.transpose(0, 2, 1) + by_wheel @ build_bridges(data) @ by_wheel.transpose(0, 2, 1)
    observed = np.concatenate([data.east.observed, data.north.observed, data.heading.observed], axis=1)
    amounts = np.log(np.square([part.usual for part in POSE_PARTS]))
    return ChannelNoise(np.array(parts), amounts, np.asarray(known), 3, observed)


def build_bridges(data: DriveData) -> Floats:
    """Covariance (w, n, n) of wheel angles (rad2) between readings more seldom than the rows: a change may have come at
    any time in between, so a straight line from one to the next is off by a Brownian bridge of the size of the change.
    """
    covariance = np.zeros((data.windows, POSE_CELLS, POSE_CELLS))
    middles = POSE_CELL_S * (np.arange(POSE_CELLS) + 0.5)
    starts_s = PATH_STEP_S * (data.window_starts - data.path_starts[data.window_segments])
    for window, number in enumerate(data.window_segments):
        segment = data.segments[number]
        angles, name = (segment.command, "command") if segment.wheel is None else (segment.wheel, "angle")
        knots = np.flatnonzero(segment.measured_rows.get(name, False))
        if angles is None or len(knots) < 2:
            continue
        begins, changes = segment.time[knots], np.diff(angles[knots])
        gaps = np.clip(np.searchsorted(begins, starts_s[window] + middles) - 1, 0, len(changes) - 1)
        share = np.clip((starts_s[window] + middles - begins[gaps]) / np.diff(begins)[gaps], 0.0, 1.0)
        bridge = changes[gaps] ** 2 * (np.minimum(share[:, None], share) - share[:, None] * share)
        covariance[window] = bridge * (gaps[:, None] == gaps)
    return covariance


def cut_motion(data: DriveData) -> tuple[Floats, Floats, Floats]:
    """Speed, heading and yaw rate in the cells of the windows (w, n)."""
    speed, heading = data.cut(data.path["speed"], POSE_CELLS), data.cut(data.path["heading"], POSE_CELLS)
    return speed, heading, np.gradient(heading, POSE_CELL_S, axis=1)


def integrate_cells() -> Floats:
    """The matrix (n, n) that integrates a rate over the cells of a window."""
    return np.asarray(POSE_CELL_S * (np.tril(np.ones((POSE_CELLS, POSE_CELLS)), -1) + 0.5 * np.eye(POSE_CELLS)))


def build_yaw_response(data: DriveData, ahead: float) -> Floats:
    """Change of the pose (w, 3 n, n) per change of the yaw rate in each cell."""
    speed, heading, _ = cut_motion(data)
    total = integrate_cells()
    cosine, sine, along = np.cos(heading)[:, :, None], np.sin(heading)[:, :, None], speed[:, :, None]
    turned = np.broadcast_to(total, (data.windows, POSE_CELLS, POSE_CELLS))
    return np.concatenate(
        [-(total @ (along * sine * total)) - ahead * sine * total,
         total @ (along * cosine * total) + ahead * cosine * total, turned], axis=1)  # fmt: skip


def build_sensor_noise(data: DriveData, channel: str) -> ChannelNoise:
    """Noise (w, n) of the wheel angle (rad) or of the speed (m/s); angles are also off by when a command came."""
    n, observed, parts = SENSOR_CELLS, getattr(data, channel).observed, SENSOR_PARTS[channel]
    least_s, least_memory_s = (COMMAND_JITTER * data.row_step_s, data.row_step_s) if channel == "wheel" else (0.0, 0.0)
    times = np.asarray(SENSOR_CELL_S * np.arange(n), dtype=np.float64)
    one = np.broadcast_to(np.eye(n), (data.windows, n, n))
    rate: Floats = np.asarray(np.gradient(data.cut(data.path[channel], n), SENSOR_CELL_S, axis=1))
    slow = [np.broadcast_to(compute_memory(times, part.memory_s), one.shape) for part in parts[1:3]]
    timing = rate[:, :, None] * compute_memory(times, max(parts[4].memory_s, least_memory_s)) * rate[:, None, :]
    sizes = (*(part.usual for part in parts[:4]), max(parts[4].usual, least_s))
    covariances = np.array([one, *slow, rate[:, :, None] ** 2 * one, timing])
    return ChannelNoise(covariances, np.log(np.square(sizes)), np.zeros(one.shape), 0, observed)
