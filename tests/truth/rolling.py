"""The tractor of the second reference: no tyres and no forces, a rear axle that rolls along a measured radius curve.

State machine and valve: a steering computer looks at the wheel angle every 10 ms and is at rest, fine or slewing; what
it asks of the valve, the spool follows with a lag of its own. Drive line: the acceleration itself is limited in how
fast it changes. Ground: a curvature of its own for each metre driven, not for each second. Angles of the wheels in
degrees to the right, headings in radians clockwise from north, everything else in SI.
"""

import math
from typing import NamedTuple

import numba
import numpy as np
import numpy.typing as npt

from tests.truth.ground import Curve, measured_curvature

Array = npt.NDArray[np.float64]

REAR_TO_MASS_M = 1.1
SAMPLE_S, SPOOL_S = 0.01, 0.02
COARSE_DEG, FINE_DEG = 5.0, 0.4  # slewing begins at this gap, and ends at that one
SLEEP, WAKE = 0.9, 1.1  # shares of the dead band at which the computer comes to rest, and wakes
AT_REST, FINE, SLEWING = 0, 1, 2
YAW_S = 0.06
MOST_ACCELERATION, JERK, SPEED_GAIN, PULL_S = 0.7, 2.5, 3.0, 0.05  # m/s2, m/s3, 1/s, s
OWN_SPEED_LAG_S = 1.0 / SPEED_GAIN  # of small changes of speed, without a fault
GRAVITY = 9.80665
EDGE_M = 0.4
CAP_POWER = 12.0

EAST, NORTH, HEADING, YAW_RATE, WAY, SPEED, ACCELERATION, WANTED, WHEEL, SPOOL = range(10)
STATES = 10


class Faults(NamedTuple):
    """What is wrong with the tractor: degrees of steering, the rest in SI."""

    offset: float
    gain: float
    left_gain: float
    lag: float
    rate: float
    dead_band: float
    half_play: float
    limit: float
    understeer: float
    slope_east: float
    slope_north: float
    draft: float
    slip: float
    tool_slip: float
    speed_lag: float
    patch: float
    patch_east: float
    patch_north: float
    patch_radius: float
    drift: float


class Guide(NamedTuple):
    """The line a closed-loop drive keeps to (start and bearing, rad) and how its position reaches it."""

    closed: bool
    east: float
    north: float
    bearing: float
    late_steps: int
    forward: float
    right: float


@numba.njit(cache=True)
def of_rear_axle(curvature: float) -> float:
    """Curvature of the rear axle's path where the centre of mass has the given one: both turn about one point."""
    ahead = min(abs(curvature) * REAR_TO_MASS_M, 0.9)
    return curvature / math.sqrt(1.0 - ahead * ahead)


@numba.njit(cache=True)
def grip_at(east: float, north: float, time: float, f: Faults) -> float:
    """Factor on the curvature here and now; the edge of a patch is a ramp."""
    factor = 1.0 + f.drift * time / 60.0
    if f.patch != 1.0:
        outside = math.hypot(east - f.patch_east, north - f.patch_north) - f.patch_radius
        inside = min(max(0.5 - outside / EDGE_M, 0.0), 1.0)
        factor *= 1.0 + (f.patch - 1.0) * inside
    return factor


@numba.njit(cache=True)
def path_curvature(state: Array, play: float, time: float, rough: float, down: float, curve: Curve, f: Faults) -> float:
    """Curvature of the rear axle's path (1/m): radius curve, faults, roughness of the ground, limit of the tyres."""
    speed = state[SPEED]
    wheel = min(max(play, state[WHEEL] - f.half_play), state[WHEEL] + f.half_play) + f.offset
    wheel -= f.understeer * speed * state[YAW_RATE]
    bend = measured_curvature(wheel, curve) * f.gain * grip_at(state[EAST], state[NORTH], time, f)
    if wheel < 0.0:
        bend *= f.left_gain
    bend = of_rear_axle(bend + f.draft * down)
    share = abs(bend) * speed * speed / (f.limit * GRAVITY)
    return bend / (1.0 + share**CAP_POWER) ** (1.0 / CAP_POWER) + rough


@numba.njit(cache=True)
def slopes(
    state: Array, ask: float, target: float, play: float, time: float, rough: float, down: float, curve: Curve,
    f: Faults, out: Array,
) -> None:  # fmt: skip
    """Time derivative of the state while the steering computer asks for a wheel speed of `ask` (deg/s)."""
    out[SPOOL] = (ask - state[SPOOL]) / SPOOL_S
    out[WHEEL] = state[SPOOL]
    aim = state[WANTED]
    late = f.speed_lag - OWN_SPEED_LAG_S  # lags in a row add up to the fault's
    out[WANTED] = (target - aim) / late if late > 0.0 else 0.0
    if late <= 0.0:
        aim = target
    speed, gap = state[SPEED], aim - state[SPEED]
    # An acceleration from which the jerk allowed comes to rest just as the speed is reached.
    pull = math.copysign(min(SPEED_GAIN * abs(gap), math.sqrt(2.0 * 0.7 * JERK * abs(gap)), MOST_ACCELERATION), gap)
    out[ACCELERATION] = min(max((pull - state[ACCELERATION]) / PULL_S, -JERK), JERK)
    out[SPEED] = state[ACCELERATION]
    over = speed * (1.0 - f.slip) * (1.0 - f.tool_slip * down)
    heading = state[HEADING]
    out[YAW_RATE] = (over * path_curvature(state, play, time, rough, down, curve, f) - state[YAW_RATE]) / YAW_S
    out[HEADING] = state[YAW_RATE]
    slide = abs(over) * (f.slope_east * math.cos(heading) - f.slope_north * math.sin(heading))
    out[EAST] = over * math.sin(heading) + slide * math.cos(heading)
    out[NORTH] = over * math.cos(heading) - slide * math.sin(heading)
    out[WAY] = abs(over)


@numba.njit(cache=True)
def moved(state: Array, dt: float, change: Array, out: Array) -> None:
    """The state `dt` seconds on at a constant rate of change."""
    for one in range(STATES):
        out[one] = state[one] + dt * change[one]


@numba.njit(cache=True)
def next_stage(stage: int, gap: float, f: Faults) -> int:
    """What the steering computer does at a gap (deg) between command and wheels: a machine with memory both ways."""
    size = abs(gap)
    if size >= COARSE_DEG:
        return SLEWING
    if stage == SLEWING:
        return SLEWING if size > max(FINE_DEG, WAKE * f.dead_band) else FINE
    if stage == FINE:
        return FINE if size > SLEEP * f.dead_band else AT_REST
    return FINE if size > WAKE * f.dead_band else AT_REST


@numba.njit(cache=True)
def asked(stage: int, gap: float, f: Faults) -> float:
    """Wheel speed (deg/s) asked of the valve; spool and computer together have the time constant of the fault."""
    if stage == SLEWING:
        return math.copysign(f.rate, gap)
    return gap / max(f.lag - SPOOL_S, 0.5 * f.lag) if stage == FINE else 0.0


@numba.njit(cache=True)
def line_angle(trace: Array, row: int, offset: float, seen: float, guide: Guide) -> float:
    """Wheel angle (deg) that keeps to a line: the heading error, and an angle that grows with the distance from it."""
    old = max(row - guide.late_steps, 0)
    heading, speed = trace[old, HEADING], abs(trace[old, SPEED])
    east = trace[old, EAST] + guide.forward * math.sin(heading) + guide.right * math.cos(heading) - guide.east
    north = trace[old, NORTH] + guide.forward * math.cos(heading) - guide.right * math.sin(heading) - guide.north
    aside = east * math.cos(guide.bearing) - north * math.sin(guide.bearing) - offset + seen
    error = math.atan2(math.sin(heading - guide.bearing), math.cos(heading - guide.bearing))
    wanted = -error - math.atan(0.5 * aside / (0.6 + speed))
    return min(max(math.degrees(wanted), -22.0), 22.0)


@numba.njit(cache=True)
def roll_out(
    start: Array, dt: float, signal: Array, targets: Array, downs: Array, seen: Array, beats: npt.NDArray[np.bool_],
    late: int, ground: Array, ground_m: float, curve: Curve, f: Faults, guide: Guide,
) -> tuple[Array, Array]:  # fmt: skip
    """A drive by Runge-Kutta 4. Returns states (steps, 10) and the command in force (deg), one row per `dt` seconds.

    `signal` is the angle commanded (deg), or the offset wanted (m) of a closed loop, taken over at `beats`; the valve
    sees it `late` steps later. `ground` is a curvature (1/m) for every `ground_m` driven.
    """
    steps = len(signal)
    trace, held = np.zeros((steps, STATES)), np.zeros(steps)
    k1, k2, k3, k4, middle = (np.zeros(STATES), np.zeros(STATES), np.zeros(STATES), np.zeros(STATES), np.zeros(STATES))
    state, play, output, ask, stage = start.copy(), start[WHEEL], start[WHEEL], 0.0, AT_REST
    every = max(round(SAMPLE_S / dt), 1)
    for row in range(steps):
        trace[row] = state
        if beats[row]:
            output = line_angle(trace, row, signal[row], seen[row], guide) if guide.closed else signal[row]
        held[row] = output
        if row % every == 0:
            gap = (held[row - late] if row >= late else start[WHEEL]) - state[WHEEL]
            stage = next_stage(stage, gap, f)
            if stage == AT_REST:
                state[SPOOL] = 0.0  # springs close the valve
            ask = asked(stage, gap, f)
        time, target, down = row * dt, targets[row], downs[row]
        place = state[WAY] / ground_m
        left = min(int(place), len(ground) - 2)
        rough = ground[left] + (place - left) * (ground[left + 1] - ground[left])
        slopes(state, ask, target, play, time, rough, down, curve, f, k1)
        moved(state, 0.5 * dt, k1, middle)
        slopes(middle, ask, target, play, time + 0.5 * dt, rough, down, curve, f, k2)
        moved(state, 0.5 * dt, k2, middle)
        slopes(middle, ask, target, play, time + 0.5 * dt, rough, down, curve, f, k3)
        moved(state, dt, k3, middle)
        slopes(middle, ask, target, play, time + dt, rough, down, curve, f, k4)
        for one in range(STATES):
            state[one] += dt / 6.0 * (k1[one] + 2.0 * k2[one] + 2.0 * k3[one] + k4[one])
        play = min(max(play, state[WHEEL] - f.half_play), state[WHEEL] + f.half_play)
    return trace, held
