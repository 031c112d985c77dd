"""The machine of the sixth reference: a farm carrier on brush tyres, with oil in its drive line and its steering.

Axes: forward, right, down; headings and yaw clockwise; SI units inside, parameters in the units of tests.truth.effects.
Each axle has two tyres whose stiffness and limit depend on their load, and a slip that builds up over a way. The load
moves with lateral and longitudinal acceleration (the front axle hangs on a pivot) and with the implement. The linkage
is cut so that slow circles have the radius of the tractor file; a wheel speed loop trims what the drive line leaks.
"""

import math

import numpy as np
from numba import njit

from tests.truth.effects import NEUTRAL
from tests.truth.laws import evaluate_laws

Array = np.ndarray
OUTSIDE_KEYS = (("crosswind", "force_n"), ("crosswind", "bearing_deg"), ("steering_hunt", "angle_deg"),
                ("steering_hunt", "period_s"), ("mast_sway", "m_per_mps2"), ("mast_sway", "hertz"),
                ("soft_tyre", "moment_nm"))  # fmt: skip
KEYS = (*((name, key) for name, values in NEUTRAL.items() for key in values), *OUTSIDE_KEYS)
"""Parameters in the order of the constants below."""
(OFFSET, GAIN, ASYMMETRY, DEAD_TIME, LAG, RATE, DEAD_BAND, PLAY, LIMIT, UNDERSTEER, DRIFT, DRIFT_BEARING, DRAFT, SLIP,
 TOOL_SLIP, SPEED_LAG, AHEAD, ASIDE, LATENCY, BIAS, PATCH, PATCH_EAST, PATCH_NORTH, PATCH_RADIUS, GROWTH,
 WIND, WIND_BEARING, HUNT, HUNT_PERIOD, SWAY, SWAY_HERTZ, PULL) = range(len(KEYS))  # fmt: skip
(EAST, NORTH, HEADING, SPEED, SENSOR, MAST, SIDE, YAW, FRONT_SLIP, REAR_SLIP, FLOW, MODE, WHEEL, SWASH, FORCE, TRIM,
 WISH, TOOL, FRONT_PUSH, LEAN, DIVE, MAST_SPEED) = range(22)  # fmt: skip
"""State; rows of a drive have the first six, then the commanded angle and speed, and the switch of the implement."""
COMMAND, TARGET, SWITCH, COLUMNS = 6, 7, 8, 9

STEP_S, TICK = 0.005, 20  # rows, and rows per command: commands come at 10 Hz
MASS, INERTIA, TO_FRONT, TO_REAR, TRACK, HEIGHT, G = 3900.0, 6600.0, 1.31, 1.1, 1.81, 0.95, 9.81
BASE = TO_FRONT + TO_REAR
FRONT, REAR = (66.7e3, 18.0e3), (93.5e3, 26.0e3)  # N/rad at most per tyre, and the load (N) where that is
FRONT_WAY_M, REAR_WAY_M, GRIP, REAR_GRIP = 0.27, 0.31, 0.65, 1.03  # relaxation, friction, rear over front
FRONT_N, REAR_N, TOOL_FRONT_N, TOOL_REAR_N = MASS * G * TO_REAR / BASE, MASS * G * TO_FRONT / BASE, -900.0, 2400.0
FRONT_ROLL, LINK_DEG = 0.2, 0.05  # share of rolling that the pivoted front axle takes; steering lost per m/s2
RIGHT_LAW, LEFT_LAW, LAW_M = (0.4457377 * 1.015, 1.199 * 0.995), (0.3081049 * 0.99, 1.285 * 1.003), 118.4
RIGHT_FLOW, LEFT_FLOW, SPOOL_S, CLOSE_S, SWITCH_DEG, LOCK_DEG = 1.015, 0.985, 0.02, 0.006, 5.0, 34.0
ROLLING_N, DRAFT_N, OIL_N_PER_M, LEAK, RAMP, SWASH_S = 2300.0, 2500.0, 97e3, 3e-5, 0.8, 0.2
TRIM_PER_S, SLIP_PER_N, TOOL_S = 0.7, 1.0 / (25.0 * MASS * G), 0.35
_give = (0.5 / FRONT[0] / math.sin(2.0 * math.atan(0.5 * (FRONT_N + TOOL_FRONT_N) / FRONT[1]))
         + 0.5 / REAR[0] / math.sin(2.0 * math.atan(0.5 * (REAR_N + TOOL_REAR_N) / REAR[1])))  # fmt: skip
DRAFT_NM = BASE**2 / _give  # moment that bends the path by 1/m while the implement loads the tyres


@njit(cache=True)
def push_axle(slip: float, load: float, moved: float, tyre: tuple[float, float], grip: float) -> float:
    """Side force (N) of two brush tyres, `moved` N of load taken from one to the other; against the slip."""
    force = 0.0
    for sign in (-1.0, 1.0):
        weight = max(0.5 * load + sign * moved, 200.0)
        stiffness = tyre[0] * math.sin(2.0 * math.atan(weight / tyre[1]))
        x = min(max(stiffness * slip / (3.0 * grip * weight), -1.0), 1.0)
        force -= grip * weight * (3.0 * x - 3.0 * x * abs(x) + x * x * x)
    return force


@njit(cache=True)
def compute_curvature(angle_deg: float) -> float:
    """Curvature (1/m, positive right) of slow circles of this machine: the file's law within a hundredth."""
    factor, power = RIGHT_LAW if angle_deg > 0.0 else LEFT_LAW
    return math.copysign(factor * abs(angle_deg) ** power / LAW_M, angle_deg)


@njit(cache=True)
def steer_wheels(s: Array, p: Array, command: float, time: float) -> float:
    """Move the cylinder towards a command (deg); returns the kinematic angle (rad) of the front wheels."""
    error = command - s[SENSOR]
    if abs(error) < p[DEAD_BAND]:
        s[MODE] = 0.0
    elif abs(error) >= SWITCH_DEG or s[MODE] == 2.0:
        s[MODE] = 2.0
    else:
        s[MODE] = 1.0
    flow = 0.0
    if s[MODE] == 2.0:  # all that the pump has
        flow = p[RATE] * RIGHT_FLOW if error > 0.0 else -p[RATE] * LEFT_FLOW
    elif s[MODE] == 1.0:
        flow = min(max(error / max(p[LAG] - SPOOL_S, 0.02), -60.0), 60.0)
    s[FLOW] += (flow - s[FLOW]) * STEP_S / (CLOSE_S if s[MODE] == 0.0 else SPOOL_S)
    s[SENSOR] = min(max(s[SENSOR] + s[FLOW] * STEP_S, -LOCK_DEG), LOCK_DEG)
    s[WHEEL] = min(max(s[WHEEL], s[SENSOR] - 0.5 * p[PLAY]), s[SENSOR] + 0.5 * p[PLAY])
    angle = s[WHEEL] + p[OFFSET] - (p[UNDERSTEER] + LINK_DEG) * s[FRONT_PUSH]
    angle += p[HUNT] * math.sin(2.0 * math.pi * time / max(p[HUNT_PERIOD], 0.1) + 0.6 * math.sin(0.13 * time))
    curve = compute_curvature(angle) * p[GAIN] * (1.0 + p[GROWTH] * time / 60.0)
    curve *= p[ASYMMETRY] if angle < 0.0 else 1.0
    if math.hypot(s[EAST] - p[PATCH_EAST], s[NORTH] - p[PATCH_NORTH]) < p[PATCH_RADIUS]:
        curve *= p[PATCH]
    curve = min(max(curve, -0.4), 0.4)
    return math.atan(BASE * curve / math.sqrt(1.0 - (curve * TO_REAR) ** 2))


@njit(cache=True)
def drive_wheels(s: Array, p: Array, target: float) -> float:
    """Force (N) of the hydrostatic drive line towards a target speed: swash plate, oil spring, leak, slow trim."""
    s[WISH] = target if p[SPEED_LAG] <= 0.0 else s[WISH] + (target - s[WISH]) * STEP_S / p[SPEED_LAG]
    slip = p[SLIP] + s[TOOL] * p[TOOL_SLIP] + (s[FORCE] - ROLLING_N) * SLIP_PER_N
    rim = s[SPEED] / (1.0 - min(slip, 0.8))
    lack = TRIM_PER_S * (s[SWASH] - s[TRIM] - rim) if target > 0.0 else -s[TRIM]
    s[TRIM] = min(max(s[TRIM] + lack * STEP_S, -0.35), 0.35)
    tilt = (s[WISH] + (s[TRIM] if s[WISH] > 0.05 else 0.0) - s[SWASH]) / SWASH_S
    s[SWASH] += min(max(tilt, -RAMP), RAMP) * STEP_S
    s[FORCE] += OIL_N_PER_M * (s[SWASH] - rim - LEAK * s[FORCE]) * STEP_S
    return s[FORCE]


@njit(cache=True)
def move_body(s: Array, p: Array, angle: float, force: float, bumps: Array) -> None:
    """One step of the body: `bumps` are sideways (N), turning (Nm) and a gust (share of the wind)."""
    cos, sin, speed = math.cos(angle), math.sin(angle), s[SPEED]
    creep = p[DRIFT] * speed * math.sin(math.radians(p[DRIFT_BEARING]) - s[HEADING])  # the top soil goes downhill
    side = s[SIDE] - creep + TO_FRONT * s[YAW]
    front_side, front_ahead = side * cos - speed * sin, abs(speed * cos + side * sin)
    rear_side = s[SIDE] - creep - TO_REAR * s[YAW]
    s[FRONT_SLIP] += (front_side - front_ahead * s[FRONT_SLIP]) / FRONT_WAY_M * STEP_S
    s[REAR_SLIP] += (rear_side - abs(speed) * s[REAR_SLIP]) / REAR_WAY_M * STEP_S
    rolling, diving = MASS * s[LEAN] * HEIGHT / TRACK, MASS * s[DIVE] * HEIGHT / BASE
    front_load = FRONT_N + s[TOOL] * TOOL_FRONT_N - diving
    rear_load = REAR_N + s[TOOL] * TOOL_REAR_N + diving
    grip, carcass = min(GRIP, p[LIMIT]), 3000.0 / (1.0 + (speed / 0.3) ** 2)
    front = push_axle(s[FRONT_SLIP], front_load, FRONT_ROLL * rolling, FRONT, grip) - carcass * front_side
    rear = push_axle(s[REAR_SLIP], rear_load, (1.0 - FRONT_ROLL) * rolling, REAR, grip * REAR_GRIP)
    rear -= carcass * rear_side
    moving = speed / (abs(speed) + 0.5)
    wind = p[WIND] * (1.0 + 0.4 * bumps[2]) * math.sin(math.radians(p[WIND_BEARING]) - s[HEADING])
    across = front * cos + rear + bumps[0] * moving + wind
    turning = TO_FRONT * front * cos - TO_REAR * rear + bumps[1] * moving - 0.3 * wind
    turning += (s[TOOL] * p[DRAFT] * DRAFT_NM + p[PULL]) * math.tanh(speed / 0.2)
    along = force - front * sin - (ROLLING_N + s[TOOL] * DRAFT_N) * math.tanh(speed / 0.05)
    s[FRONT_PUSH] += (front * cos * G / FRONT_N - s[FRONT_PUSH]) * STEP_S / 0.05
    s[LEAN] += (across / MASS - s[LEAN]) * STEP_S / 0.12
    s[DIVE] += (along / MASS - s[DIVE]) * STEP_S / 0.12
    pull = (2.0 * math.pi * p[SWAY_HERTZ]) ** 2
    s[MAST_SPEED] -= (pull * (s[MAST] + p[SWAY] * across / MASS) + 0.2 * math.sqrt(pull) * s[MAST_SPEED]) * STEP_S
    s[MAST] += s[MAST_SPEED] * STEP_S
    s[SPEED] += (along / MASS + s[SIDE] * s[YAW]) * STEP_S
    s[SIDE] += (across / MASS - speed * s[YAW]) * STEP_S
    s[YAW] += turning / INERTIA * STEP_S
    s[HEADING] += s[YAW] * STEP_S
    s[EAST] += (s[SPEED] * math.sin(s[HEADING]) + s[SIDE] * math.cos(s[HEADING])) * STEP_S
    s[NORTH] += (s[SPEED] * math.cos(s[HEADING]) - s[SIDE] * math.sin(s[HEADING])) * STEP_S


@njit(cache=True)
def pursue_path(row: Array, p: Array, path: Array, at: int, noise: Array) -> tuple[float, int]:
    """Angle (deg) by the file's law towards a point ahead on a path, as the receiver sees it, and the place on it."""
    ahead, aside = p[AHEAD], p[ASIDE] + row[MAST]
    cos, sin = math.cos(row[HEADING]), math.sin(row[HEADING])
    east = row[EAST] + ahead * sin + aside * cos + noise[0]
    north = row[NORTH] + ahead * cos - aside * sin + noise[1]
    at += int(np.argmin(np.hypot(path[at : at + 40, 0] - east, path[at : at + 40, 1] - north)))
    aim = min(at + (18 if path[at, 3] > 0.0 else 11), len(path) - 1)
    way, up = path[aim, 0] - east, path[aim, 1] - north
    turn = math.atan2(way, up) - row[HEADING] - math.radians(p[BIAS] + noise[2])
    curve = 2.0 * math.sin(turn) / max(math.hypot(way, up), 1.0)
    factor, power = (0.4457377, 1.199) if curve > 0.0 else (0.3081049, 1.285)
    angle = min((LAW_M * abs(curve) / factor) ** (1.0 / power), 30.0)
    return math.copysign(angle, curve), at


@njit(cache=True)
def drive_machine(state: Array, base: Array, laws: Array, plan: Array, path: Array, bumps: Array, noise: Array,
                  day_s: float) -> Array:  # fmt: skip
    """Rows every STEP_S. `plan` has angle (deg), speed and switch per tick, or the guidance follows `path` (east,
    north, speed, switch)."""
    rows, s, p, at = np.empty((len(plan) * TICK, COLUMNS)), state.copy(), base.copy(), 0
    command, target, switch = 0.0, 0.0, 0.0
    for i in range(len(rows)):
        time = i * STEP_S
        evaluate_laws(
            laws, base, p, time, day_s + time, s[EAST], s[NORTH], switch, s[WHEEL], command - s[SENSOR], s[SPEED]
        )
        if i % TICK == 0:
            tick = i // TICK
            command, target, switch = plan[tick]
            if len(path):
                seen = max(i - 1 - int(p[LATENCY] / STEP_S), 0)
                if i:
                    command, at = pursue_path(rows[seen], p, path, at, noise[tick])
                target, switch = (path[at, 2], path[at, 3]) if at < len(path) - 14 else (0.0, 0.0)
        rows[i, COMMAND], rows[i, TARGET], rows[i, SWITCH] = command, target, switch
        s[TOOL] += (switch - s[TOOL]) * STEP_S / TOOL_S
        angle = steer_wheels(s, p, rows[max(i - int(p[DEAD_TIME] / STEP_S + 0.5), 0), COMMAND], time)
        move_body(s, p, angle, drive_wheels(s, p, target), bumps[i])
        rows[i, :COMMAND] = s[:COMMAND]
    return rows
