"""The tractor of the third reference: four wheels, a pivoted front axle, a driveline with a governor, a spool valve.

Body axes are forward, right and clockwise; headings are clockwise from north; what stands on the scale of the wheel
sensor is in degrees, positive to the right, the rest in SI. Each wheel has a steering angle by the linkage (most of
Ackermann's difference), a load by the accelerations (the rear axle carries the roll: the front one pivots), a side
force of a brush on a relaxing carcass inside a friction ellipse. Steps of Heun.
"""

import math
from typing import NamedTuple

import numba
import numpy as np
import numpy.typing as npt

from tests.truth.ground import LOCK_DEG

Array = npt.NDArray[np.float64]

GRAVITY, MASS, INERTIA, FRONT, REAR = 9.80665, 3850.0, 6500.0, 1.3, 1.1
BASE = FRONT + REAR
TRACK, MASS_HEIGHT, PIVOT_HEIGHT = 1.6, 0.85, 0.45
FRONT_LOAD, REAR_LOAD = 0.5 * MASS * GRAVITY * REAR / BASE, 0.5 * MASS * GRAVITY * FRONT / BASE  # of one wheel, N
FRONT_STIFFNESS, REAR_STIFFNESS, SOFTENING = 8.0, 11.0, 0.25  # per load and rad at the static load; loss with load
RELAXATION_M, CARCASS_DAMPING, FRICTION = 0.35, 9000.0, 0.75
REAR_GRIP = 1.06  # side friction of the lugs behind over that of the front tyres
ACKERMANN_SHARE = 0.85
LEAN_S = 0.15  # for the loads to follow the accelerations
SHAFT_MASS, SLIP_STIFFNESS, SLIP_SPEED, TORQUE_S = 1500.0, 320000.0, 0.8, 0.06
ROLLING_RESISTANCE, FRONT_DRIVE_SHARE = 0.06, 0.4
OWN_SPEED_LAG_S, GOVERNOR_S, INTEGRAL_S = 0.35, 0.12, 1.5
BRAKE_SPEED, BRAKE_SHARE = 0.1, 0.5  # m/s below which a standing tractor is held, by this share of its weight
SPOOL_S, PRESSURE_S, OVERLAP, PUMP_DEG_PER_S = 0.018, 0.05, 0.04, 75.0
RIGHT_AREA, LEFT_AREA = 1.02, 0.98  # speed of the cylinder per flow, by the side it moves to
SWITCH_DEG, RELEASE_DEG = 5.0, 0.3
SWING_RATE, SWING_DAMPING = 2.6, 0.08  # of a trailed implement: rad/s, share of critical
TABLE_SIZE, TABLE_MOST = 801, 0.45  # curvature (1/m) on both sides

EAST, NORTH, HEADING, AHEAD, SIDEWAYS, YAW_RATE, TYRE = range(7)  # the deflections of four tyres begin at TYRE
(SHAFT, INTEGRAL, TORQUE, WHEEL, SPOOL, PRESSURE, SIDE_PULL, FORWARD_PULL, SWING, SWING_SPEED,
 REFERENCE) = range(10, 21)  # fmt: skip
STATES = 21


(RUT, CREEP, FRICTION_SIDE, FRONT_SHARE, REAR_SHARE, FRONT_SIDE_N, HITCH_SIDE_N, ACCEL_EAST, ACCEL_NORTH, LOST, LOCKED,
 DRAG_N, LEFT_FLAT, TARGET, LAG_S, FEED) = range(16)  # fmt: skip
SURROUNDINGS = 16


class Odd(NamedTuple):
    """Causes outside the catalogue, neutral by default: SI, and degrees on the scale of the wheel sensor."""

    front_stiffness: float = 1.0
    acceleration: float = 0.7
    wind_east: float = 0.0  # m/s2
    wind_north: float = 0.0
    fall_east: float = 0.0  # m/s2 downhill
    fall_north: float = 0.0
    slope_to: float = 0.0  # rad, bearing of a cross slope
    speed_link: float = 0.0  # deg per m/s above 5 km/h, towards straight on both sides
    wobble: float = 0.0  # deg
    wobble_m: float = 2.0
    swing_n: float = 0.0  # N per unit of swing
    locked: float = 0.0
    locked_from_s: float = 0.0
    moist: float = 1.0
    moist_east: float = 0.0
    moist_north: float = 0.0
    moist_radius: float = 1.0
    stiction: float = 0.0  # deg
    hitch_n: float = 0.0
    hunting: float = 0.0
    hunting_s: float = 3.0
    flat: float = 0.0  # share lost each minute by the front left tyre
    joint: float = 0.0  # share of the bend that an articulated front half takes
    tree_m: float = 0.0
    tree_east: float = 0.0
    tree_width: float = 6.0


class Breaks(NamedTuple):
    """When the steering breaks (s since the start; from beyond to: never), and how."""

    loose_from: float = 1.0
    loose_to: float = 0.0
    linkage: float = 0.0
    stuck_from: float = 1.0
    stuck_to: float = 0.0
    stuck_side: float = 1.0


class Way(NamedTuple):
    """The line that a closed loop keeps to (start m, bearing rad), and where its antenna is and should be."""

    closed: bool
    east: float
    north: float
    bearing: float
    forward: float
    right: float
    assumed_forward: float
    heading_bias: float


@numba.njit(cache=True)
def look_up(curvature: float, table: Array) -> float:
    """Mean angle of the front wheels (rad) that gives a curvature on the calibrated ground."""
    place = (min(max(curvature / TABLE_MOST, -1.0), 1.0) + 1.0) * 0.5 * (TABLE_SIZE - 1)
    left = min(int(place), TABLE_SIZE - 2)
    return table[left] + (place - left) * (table[left + 1] - table[left])


@numba.njit(cache=True)
def split_angle(mean: float, side: float) -> float:
    """Angle (rad) of the right (side 1) or left (-1) front wheel at a mean angle: a share of Ackermann's difference."""
    tangent = math.tan(mean)
    true = math.atan(tangent / (1.0 - side * 0.5 * TRACK / BASE * tangent))
    return mean + ACKERMANN_SHARE * (true - mean)


@numba.njit(cache=True)
def load_wheels(side_pull: float, forward_pull: float, out: Array) -> None:
    """Loads (N) of front left, front right, rear left, rear right at accelerations (m/s2) to the right and ahead.

    The front axle turns freely about its pivot: it takes the moment of its own side force at the height of the pivot
    only, and the rear axle all else.
    """
    moment = MASS * side_pull * MASS_HEIGHT
    front = 2.0 * FRONT_LOAD / GRAVITY * side_pull * PIVOT_HEIGHT
    back = 0.5 * MASS * forward_pull * MASS_HEIGHT / BASE
    for one in range(4):
        left = 1.0 if one % 2 == 0 else -1.0
        static = FRONT_LOAD - back if one < 2 else REAR_LOAD + back
        out[one] = max(static + left * (front if one < 2 else moment - front) / TRACK, 200.0)


@numba.njit(cache=True)
def push_tyre(slip: float, load: float, static: float, stiffness: float, friction: float, used: float) -> float:
    """Side force (N) of a brush at a slip (sliding per rolling); `used` is the share of grip that driving takes."""
    linear = stiffness * load * (1.0 + SOFTENING * (1.0 - load / static)) * slip
    most = friction * load * math.sqrt(max(1.0 - used * used, 0.04))
    ratio = abs(linear) / most
    if ratio >= 3.0:
        return -math.copysign(most, linear)
    return -linear * (1.0 - ratio / 3.0 + ratio * ratio / 27.0)


@numba.njit(cache=True)
def derive_body(state: Array, mean: float, drive: float, env: Array, loads: Array, out: Array) -> float:
    """Rates of the body, its tyres and its driveline at a mean wheel angle (rad). Returns the front side force (N).

    `drive` is the share of the front axle in the driving force, `env` what acts from outside (indices above).
    """
    u, v, r, heading = state[AHEAD], state[SIDEWAYS], state[YAW_RATE], state[HEADING]
    load_wheels(state[SIDE_PULL], state[FORWARD_PULL], loads)
    grip = FRICTION * MASS * GRAVITY
    push = SLIP_STIFFNESS * (state[SHAFT] * (1.0 - env[LOST]) - u) / (abs(u) + SLIP_SPEED)
    push = min(max(push, -grip), grip)
    cosine, sine = math.cos(heading), math.sin(heading)
    drag = env[DRAG_N]
    if abs(env[TARGET]) < 0.02 and abs(u) < BRAKE_SPEED:
        drag += BRAKE_SHARE * MASS * GRAVITY
    ahead_n = -drag * math.tanh(u / 0.05) + MASS * (env[ACCEL_EAST] * sine + env[ACCEL_NORTH] * cosine)
    side_n = MASS * (env[ACCEL_EAST] * cosine - env[ACCEL_NORTH] * sine)
    side_n += env[HITCH_SIDE_N] + env[FRONT_SIDE_N]
    moment = FRONT * env[FRONT_SIDE_N] - (REAR + 1.0) * env[HITCH_SIDE_N]
    front_n = 0.0
    for one in range(4):
        left = 1.0 if one % 2 == 0 else -1.0
        front = one < 2
        angle = split_angle(mean, -left) if front else 0.0
        arm = FRONT if front else -REAR
        along, across = u + left * 0.5 * TRACK * r, v + arm * r
        c, s = math.cos(angle), math.sin(angle)
        rolling = along * c + across * s
        aside = across * c - along * s - env[CREEP] * abs(u) + (env[RUT] * abs(rolling) if front else 0.0)
        deflection = state[TYRE + one]
        out[TYRE + one] = aside - abs(rolling) * deflection / RELAXATION_M
        pull = 0.5 * push * (drive if front else 1.0 - drive)
        static = FRONT_LOAD if front else REAR_LOAD
        stiffness = FRONT_STIFFNESS * env[FRONT_SHARE] if front else REAR_STIFFNESS * env[REAR_SHARE]
        if one == 0:
            stiffness *= 1.0 - env[LEFT_FLAT]
            pull -= 0.08 * env[LEFT_FLAT] * loads[0] * math.tanh(u / 0.05)
        if not front and env[LOCKED] > 0.0:
            pull -= env[LOCKED] * SLIP_STIFFNESS * 0.25 * left * 0.5 * TRACK * r / (abs(u) + SLIP_SPEED)
        used = min(abs(pull) / (FRICTION * loads[one]), 0.98)
        friction = env[FRICTION_SIDE] * (1.0 if front else REAR_GRIP)
        force = push_tyre(deflection / RELAXATION_M, loads[one], static, stiffness, friction, used)
        force -= CARCASS_DAMPING * out[TYRE + one]
        x, y = pull * c - force * s, pull * s + force * c
        ahead_n += x
        side_n += y
        moment += arm * y + left * 0.5 * TRACK * x
        if front:
            front_n += y
    out[EAST], out[NORTH] = u * sine + v * cosine, u * cosine - v * sine
    out[HEADING], out[YAW_RATE] = r, moment / INERTIA
    out[AHEAD], out[SIDEWAYS] = ahead_n / MASS + v * r, side_n / MASS - u * r
    out[SIDE_PULL] = (side_n / MASS - state[SIDE_PULL]) / LEAN_S
    out[FORWARD_PULL] = (ahead_n / MASS - state[FORWARD_PULL]) / LEAN_S
    govern(state, push, env, out)
    return front_n


@numba.njit(cache=True)
def govern(state: Array, push: float, env: Array, out: Array) -> None:
    """Rates of the reference speed, the shaft, the governor's integral and the torque (as a force at the wheels)."""
    target, whole = env[TARGET], MASS + SHAFT_MASS
    resistance = ROLLING_RESISTANCE * MASS * GRAVITY
    slip = math.tanh(target / 0.05) * resistance * (abs(target) + SLIP_SPEED) / SLIP_STIFFNESS
    gap = (target + slip - state[REFERENCE]) / (max(env[LAG_S], OWN_SPEED_LAG_S) - 0.5 * TORQUE_S)
    out[REFERENCE] = min(max(gap, -env[FEED]), env[FEED])
    error = state[REFERENCE] - state[SHAFT]
    force = whole * (out[REFERENCE] + error / GOVERNOR_S) + state[INTEGRAL]
    force += resistance * math.tanh(state[SHAFT] / 0.05)
    out[INTEGRAL] = whole * error / GOVERNOR_S / INTEGRAL_S if abs(target) > 0.05 else -state[INTEGRAL] / 0.5
    out[TORQUE] = (force - state[TORQUE]) / TORQUE_S
    out[SHAFT] = (state[TORQUE] - push) / SHAFT_MASS


@numba.njit(cache=True)
def derive_steering(state: Array, demand: float, front_n: float, out: Array) -> None:
    """Rates of spool, pressure and wheel sensor: the spool opens past its overlap, flow falls with the load."""
    out[SPOOL] = (demand - state[SPOOL]) / SPOOL_S
    scrub = 0.3 * (1.0 - math.tanh(abs(state[AHEAD]) / 0.3))
    out[PRESSURE] = (0.3 + scrub + abs(front_n) / 40000.0 - state[PRESSURE]) / PRESSURE_S
    size = max(abs(state[SPOOL]) - OVERLAP, 0.0) * PUMP_DEG_PER_S
    share = math.sqrt(max(1.0 - 0.25 * state[PRESSURE], 0.1) / (1.0 - 0.25 * 0.3))
    speed = math.copysign(min(size * share, PUMP_DEG_PER_S), state[SPOOL])
    speed *= RIGHT_AREA if speed > 0.0 else LEFT_AREA
    if (state[WHEEL] >= LOCK_DEG and speed > 0.0) or (state[WHEEL] <= -LOCK_DEG and speed < 0.0):
        speed = 0.0
    out[WHEEL] = speed


@numba.njit(cache=True)
def settle(mean: float, speed: float, seconds: float, share: float) -> Array:
    """State of the tractor after driving with a fixed mean wheel angle (rad), with neutral surroundings."""
    state, k1, k2, middle = np.zeros(STATES), np.zeros(STATES), np.zeros(STATES), np.zeros(STATES)
    env, loads, dt = clear_surroundings(speed), np.zeros(4), 0.0025
    for _ in range(int(seconds / dt)):
        derive_body(state, mean, share, env, loads, k1)
        for one in range(STATES):
            middle[one] = state[one] + dt * k1[one]
        derive_body(middle, mean, share, env, loads, k2)
        for one in range(STATES):
            state[one] += 0.5 * dt * (k1[one] + k2[one])
    return state


@numba.njit(cache=True)
def clear_surroundings(target: float) -> Array:
    """Surroundings of a plane field without disturbances at a target speed (m/s)."""
    env = np.zeros(SURROUNDINGS)
    env[FRICTION_SIDE], env[FRONT_SHARE], env[REAR_SHARE] = FRICTION, 1.0, 1.0
    env[TARGET], env[LAG_S], env[FEED] = target, OWN_SPEED_LAG_S, 0.7
    env[DRAG_N] = ROLLING_RESISTANCE * MASS * GRAVITY
    return env
