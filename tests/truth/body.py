"""The tractor of the truth model: a single-track body on sprung, saturating tyres, stepped with Runge-Kutta 4.

Everything here is in the vehicle's own sense: forward, right, clockwise; heading clockwise from north; the wheel
angle in degrees, positive to the right. The tyre is a contact patch on a spring: its deflection y obeys
dy/dt = sliding - |rolling| y / sigma, and its force is -mu N tanh(C y / (sigma mu N)) plus carcass damping. It has the
usual relaxation length sigma, saturates at mu N, and stays regular down to a standstill.
"""

import math
from typing import NamedTuple

import numba
import numpy as np
import numpy.typing as npt

from tests.truth.ground import EG105, MAP_SPEED_MPS, look_up, measured_curvature

Array = npt.NDArray[np.float64]

MASS, INERTIA, FRONT, REAR, GRAVITY = 3850.0, 6500.0, 1.3, 1.1, 9.80665
BASE = FRONT + REAR
FRONT_LOAD, REAR_LOAD = MASS * GRAVITY * REAR / BASE, MASS * GRAVITY * FRONT / BASE
FRONT_STIFFNESS, REAR_STIFFNESS = 8.0 * FRONT_LOAD, 11.0 * REAR_LOAD  # N/rad
FRONT_DAMPING, REAR_DAMPING = 35000.0, 45000.0  # N s/m
FRICTION = 0.75
SPEED_LAG_S, ACCELERATION = 0.35, 0.7
SWITCH_DEG, RELEASE_DEG = 5.0, 0.3
SLIDE_LENGTH_M, PATCH_EDGE_M = 0.5, 0.5

EAST, NORTH, HEADING, SIDEWAYS, SPIN, FRONT_Y, REAR_Y, WHEEL_SPEED, ACTUATOR, SLIDE = range(10)
STATES = 10


class Ground(NamedTuple):
    """Ground that is no plane, and what it does to a tractor.

    It falls by `fall_east` and `fall_north` (m/m) on the whole, with waves `wave_m` high and `length_m` long on top.
    The tractor is carried aside by `drift` metres per metre driven and slope across the way, and loses the share
    `climb` of its speed per slope that it drives up.
    """

    fall_east: float = 0.0
    fall_north: float = 0.0
    wave_m: float = 0.0
    length_m: float = 50.0
    drift: float = 0.0
    climb: float = 0.0


class Hidden(NamedTuple):
    """What the effects do to the body, in SI except the steering angles (deg)."""

    offset: float
    gain: float
    left_gain: float
    lag: float
    rate: float
    dead_band: float
    half_play: float
    limit: float
    understeer: float
    slope: float
    slope_to: float
    draft: float
    slip: float
    tool_slip: float
    speed_lag: float
    patch: float
    patch_east: float
    patch_north: float
    patch_radius: float
    drift: float
    temperature: float
    temperature_period: float
    pull: float
    wobble: float
    wobble_period: float
    relaxation: float
    wind: float
    wind_bearing: float
    clock: float
    ground: Ground = Ground()


class Loop(NamedTuple):
    """The line the closed-loop drive steers for, and how it sees it."""

    closed: bool
    east: float
    north: float
    bearing: float
    latency_steps: int
    antenna_forward: float
    antenna_right: float


@numba.njit(cache=True)
def falls(east: float, north: float, heading: float, ground: Ground) -> tuple[float, float]:
    """Slope of the ground (m/m) to the right of and ahead of a tractor; positive where it falls that way."""
    turn = 2.0 * math.pi / ground.length_m
    steep = ground.wave_m * turn
    to_east = ground.fall_east + steep * math.sin(turn * east) * math.sin(0.7 * turn * north + 1.0)
    to_north = ground.fall_north - 0.7 * steep * math.cos(turn * east) * math.cos(0.7 * turn * north + 1.0)
    cosine, sine = math.cos(heading), math.sin(heading)
    return to_east * cosine - to_north * sine, to_east * sine + to_north * cosine


def steady_table(points: int = 401, largest: float = 0.4) -> tuple[Array, Array]:
    """Curvature of the centre of mass (1/m) and the body's wheel angle (rad) that holds it at 5 km/h.

    Closed form: the yaw rate gives the axle forces, those the slip angles, those the wheel angle.
    """
    spins = np.linspace(-largest, largest, points) * MAP_SPEED_MPS
    share = spins * MAP_SPEED_MPS / GRAVITY  # side force over load, the same on both axles
    sideways = spins * REAR - MAP_SPEED_MPS * slip_for(share, REAR_STIFFNESS / REAR_LOAD)
    course = np.arctan((sideways + FRONT * spins) / MAP_SPEED_MPS)
    angles = course
    for _ in range(40):  # a turned wheel pushes along its own axle: its force is larger by 1 / cos(angle)
        angles = course + np.arctan(slip_for(share / np.cos(angles), FRONT_STIFFNESS / FRONT_LOAD))
    return spins / np.hypot(MAP_SPEED_MPS, sideways), angles


def slip_for(share: Array, stiffness: float) -> Array:
    """Slip (sliding over rolling speed) that gives a side force of `share` of the load; stiffness per load, 1/rad."""
    slip: Array = FRICTION / stiffness * np.arctanh(share / FRICTION)
    return slip


@numba.njit(cache=True)
def valve_rate(gap: float, slewing: bool, lag: float, rate: float, dead_band: float) -> float:
    """Steering speed (deg/s) at a gap between command and wheel angle (deg): smooth in the gap."""
    share = min(max((abs(gap) / max(dead_band, 1e-9) - 0.85) / 0.3, 0.0), 1.0)
    opening = share * share * (3.0 - 2.0 * share)
    if slewing:
        return opening * rate * math.tanh(gap / 0.25)
    return opening * gap / lag


@numba.njit(cache=True)
def curvature_factor(east: float, north: float, time: float, left: bool, h: Hidden) -> float:
    """Factor on the nominal curvature from everything that changes how well the tractor turns."""
    factor = h.gain * (h.left_gain if left else 1.0) * (1.0 + h.drift * time / 60.0)
    if h.temperature != 0.0:
        factor *= 1.0 + h.temperature * math.sin(2.0 * math.pi * (h.clock + time) / h.temperature_period)
    if h.patch != 1.0:
        distance = math.hypot(east - h.patch_east, north - h.patch_north)
        inside = 0.5 * (1.0 - math.tanh((distance - h.patch_radius) / PATCH_EDGE_M))
        factor *= 1.0 + (h.patch - 1.0) * inside
    return factor


@numba.njit(cache=True)
def tyre(deflection: float, change: float, stiffness: float, load: float, damping: float, h: Hidden) -> float:
    """Side force of an axle (N, to its right)."""
    limit = min(h.limit, FRICTION) * load
    return -limit * math.tanh(stiffness * deflection / (h.relaxation * limit)) - damping * change


@numba.njit(cache=True)
def moved(state: Array, dt: float, change: Array, out: Array) -> None:
    """The state `dt` seconds on at a constant rate of change."""
    for one in range(STATES):
        out[one] = state[one] + dt * change[one]


@numba.njit(cache=True)
def rates(
    state: Array, command: float, target: float, play: float, slewing: bool, time: float, push: float, down: float,
    h: Hidden, curvatures: Array, angles: Array, out: Array,
) -> None:  # fmt: skip
    """Time derivative of the state; `play` is the wheel angle before the step, `push` the soil's yaw rate (rad/s).

    What is not hidden is not worked out: angles and their functions are most of the time of a drive.
    """
    out[ACTUATOR] = valve_rate(command - state[ACTUATOR], slewing, h.lag, h.rate, h.dead_band)
    out[WHEEL_SPEED] = min(max((target - state[WHEEL_SPEED]) / h.speed_lag, -ACCELERATION), ACCELERATION)
    u = state[WHEEL_SPEED] * (1.0 - h.slip) * (1.0 - h.tool_slip * down)
    fall_right = 0.0
    if h.ground.drift != 0.0 or h.ground.climb != 0.0:
        fall_right, fall_ahead = falls(state[EAST], state[NORTH], state[HEADING], h.ground)
        u *= 1.0 + h.ground.climb * fall_ahead * (1.0 if u > 0.0 else -1.0)
    v, r = state[SIDEWAYS], state[SPIN]
    wheel = min(max(play, state[ACTUATOR] - h.half_play), state[ACTUATOR] + h.half_play)
    more = h.offset + h.pull * u * u
    if h.wobble != 0.0:
        more += h.wobble * math.sin(2.0 * math.pi * time / h.wobble_period)
    wheel += more
    wheel -= h.understeer * u * r
    bend = measured_curvature(wheel, EG105) * curvature_factor(state[EAST], state[NORTH], time, wheel < 0.0, h)
    angle = look_up(bend + h.draft * down, curvatures, angles)
    cosine, sine = math.cos(angle), math.sin(angle)
    ahead = v + FRONT * r
    rolling = abs(u * cosine + ahead * sine)
    out[FRONT_Y] = ahead * cosine - u * sine - rolling * state[FRONT_Y] / h.relaxation
    out[REAR_Y] = v - REAR * r - abs(u) * state[REAR_Y] / h.relaxation
    front = cosine * tyre(state[FRONT_Y], out[FRONT_Y], FRONT_STIFFNESS, FRONT_LOAD, FRONT_DAMPING, h)
    rear = tyre(state[REAR_Y], out[REAR_Y], REAR_STIFFNESS, REAR_LOAD, REAR_DAMPING, h)
    out[SIDEWAYS] = (front + rear) / MASS - u * r
    out[SPIN] = (front * FRONT - rear * REAR) / INERTIA
    heading = state[HEADING]
    out[HEADING] = r + push * u / MAP_SPEED_MPS
    side = h.ground.drift * abs(u) * fall_right
    if h.slope != 0.0:
        side = h.slope * abs(u) * math.sin(h.slope_to - heading) + side
    out[SLIDE] = (side - state[SLIDE]) * abs(u) / SLIDE_LENGTH_M
    across = v + state[SLIDE]
    out[EAST] = u * math.sin(heading) + across * math.cos(heading)
    out[NORTH] = u * math.cos(heading) - across * math.sin(heading)
    if h.wind != 0.0:
        moving = math.tanh(abs(u) / 0.1) * h.wind
        out[EAST] += moving * math.sin(h.wind_bearing)
        out[NORTH] += moving * math.cos(h.wind_bearing)


@numba.njit(cache=True)
def line_command(trace: Array, row: int, offset: float, seen: float, loop: Loop) -> float:
    """Steering command of the closed-loop drive: pursue a point 5 m ahead on the line, seen late and with noise."""
    old = max(row - loop.latency_steps, 0)
    heading = trace[old, HEADING]
    forward, right = loop.antenna_forward - REAR, loop.antenna_right
    east = trace[old, EAST] + forward * math.sin(heading) + right * math.cos(heading) - loop.east
    north = trace[old, NORTH] + forward * math.cos(heading) - right * math.sin(heading) - loop.north
    lateral = east * math.cos(loop.bearing) - north * math.sin(loop.bearing) - offset + seen
    wanted = -math.atan(lateral / 5.0)
    error = math.atan2(math.sin(heading - loop.bearing), math.cos(heading - loop.bearing))
    return min(max(1.4 * math.degrees(wanted - error), -25.0), 25.0)


@numba.njit(cache=True)
def integrate(
    start: Array, dt: float, commands: Array, targets: Array, offsets: Array, downs: Array, pushes: Array, seen: Array,
    ticks: npt.NDArray[np.bool_], delay: int, h: Hidden, loop: Loop, curvatures: Array, angles: Array,
) -> tuple[Array, Array, Array]:  # fmt: skip
    """Run a drive. Returns states (steps, 10), the held command (deg) and the angle behind the play (deg).

    All inputs have one value per step of `dt` seconds; the controller hands over a new command where `ticks` is set,
    and the valve sees it `delay` steps later.
    """
    steps = len(commands)
    trace = np.zeros((steps, STATES))
    held = np.zeros(steps)
    wheels = np.zeros(steps)
    k1, k2, k3, k4, middle = (np.zeros(STATES), np.zeros(STATES), np.zeros(STATES), np.zeros(STATES), np.zeros(STATES))
    state = start.copy()
    play, output, slewing = start[ACTUATOR], start[ACTUATOR], False
    for row in range(steps):
        trace[row] = state
        if ticks[row]:
            output = line_command(trace, row, offsets[row], seen[row], loop) if loop.closed else commands[row]
        held[row], wheels[row] = output, play
        command = held[row - delay] if row >= delay else start[ACTUATOR]
        gap = abs(command - state[ACTUATOR])
        if gap >= SWITCH_DEG:
            slewing = True
        elif gap < max(RELEASE_DEG, 1.1 * h.dead_band):
            slewing = False
        time, target, push, down = row * dt, targets[row], pushes[row], downs[row]
        rates(state, command, target, play, slewing, time, push, down, h, curvatures, angles, k1)
        moved(state, 0.5 * dt, k1, middle)
        rates(middle, command, target, play, slewing, time + 0.5 * dt, push, down, h, curvatures, angles, k2)
        moved(state, 0.5 * dt, k2, middle)
        rates(middle, command, target, play, slewing, time + 0.5 * dt, push, down, h, curvatures, angles, k3)
        moved(state, dt, k3, middle)
        rates(middle, command, target, play, slewing, time + dt, push, down, h, curvatures, angles, k4)
        for one in range(STATES):
            state[one] += dt / 6.0 * (k1[one] + 2.0 * k2[one] + 2.0 * k3[one] + k4[one])
        play = min(max(play, state[ACTUATOR] - h.half_play), state[ACTUATOR] + h.half_play)
    return trace, held, wheels
