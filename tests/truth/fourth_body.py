"""The tractor of the fourth reference: rigid bodies in maximal coordinates on tyres of bristles, stepped by 1 ms.

Front axle, chassis and implement are bodies of their own (place, heading and their rates, in the plane), held together
by stiff springs and dampers; the implement hangs on links with lateral play. Each of four tyres is a row of bristles
that the rolling carries through the contact: a bristle stretches while it sticks and slides at the limit of a parabolic
pressure. An electric motor turns the steering column: a loop at 100 Hz with a profile for large moves, on an encoder
of its own, against dry friction. A pump with a ramp and a pressure limit drives the rear wheels through oil. The step
is semi-implicit (rates first, then places). Headings clockwise from north in radians, wheel angles in degrees to the
right, the rest in SI.
"""

import math
from typing import NamedTuple

import numba
import numpy as np
import numpy.typing as npt

from tests.truth import laws as known
from tests.truth.ground import LOCK_DEG, look_up, measured_angle, measured_curvature, sum_waves

Array = npt.NDArray[np.float64]

STEP_S, ROW_STEPS, GRAVITY = 0.001, 5, 9.80665
BRISTLES, FRICTION, HITCH_SHARE = 5, 0.75, -0.35
FRONT_GRIP, REAR_GRIP, DRIVE_GRIP = 9.0, 10.0, 25.0  # per load: side force per slip (1/rad), pull per slip
COARSE_DEG, FINE_DEG, LOOP_S, FRICTION_DEG_S2, MOTOR_GAIN = 5.0, 0.4, 0.01, 20.0, 120.0
LOOP_LATE_S = 0.027  # cycle of the bus, half a sample of the loop, and the motor
PUMP_S, PUMP_RAMP, OIL_HZ, OIL_DAMPING, ROLLING = 0.30, 0.7, 4.0, 0.7, 0.04
OWN_SPEED_LAG_S, TRIM_PER_S = 0.35, 0.5  # of the drive without a fault; of the pump, which makes up for its leakage
EAST, NORTH, HEADING, MOTOR, WHEEL, SPEED, WHEEL_SPEED, COMMAND, YAW, SIDE = range(10)
COLUMNS = 10
P_TINES, P_HITCH, P_DROOP, P_FIELD, P_FURROW, P_REAR_STEER, P_TORQUE, P_HUNT = range(21, 29)
PARAMETERS = 29


class Machine(NamedTuple):
    """Masses (kg), lengths (m) ahead of the rear axle, pins, and the measured radii (c, p) to the right and left.

    The front axle is pinned at `pin` ahead of the rear axle, `trail` behind its own middle; an articulated machine
    bends there and its wheels do not steer.
    """

    mass: float
    inertia: float
    base: float
    centre: float
    track: float
    axle_mass: float
    axle_inertia: float
    pin: float
    trail: float
    articulated: bool
    tool_mass: float
    tool_m: float
    patch_m: float
    right_c: float
    right_p: float
    left_c: float
    left_p: float


class Guide(NamedTuple):
    """The line of a closed loop (start, bearing in rad), what its estimator gets, and how it looks ahead."""

    closed: bool
    east: float
    north: float
    bearing: float
    position_late: int
    heading_late: int
    forward: float
    right: float
    reach: float
    bias: float


@numba.njit(cache=True)
def compute_tyre_force(
    z: Array, along: float, aside: float, load: float, grip: float, limit: float, patch: float
) -> float:
    """Side force (N, to the right) of a tyre after its bristles `z` (m) moved on by a step."""
    dx = patch / BRISTLES
    stiffness = grip * load / (dx * 0.5 * BRISTLES * (BRISTLES + 1))
    flow, force, pressure = abs(along) / dx, 0.0, 0.0
    for i in range(BRISTLES):
        x = (i + 0.5) / BRISTLES
        pressure += x * (1.0 - x)
    ahead = 0.0
    for i in range(BRISTLES):
        k = i if along >= 0.0 else BRISTLES - 1 - i
        old, x = z[k], (i + 0.5) / BRISTLES
        z[k] = old + STEP_S * (aside - flow * (old - ahead))
        most = limit * load * x * (1.0 - x) / pressure / stiffness
        z[k] = min(max(z[k], -most), most)
        ahead = old
        force -= stiffness * z[k]
    return force


@numba.njit(cache=True)
def choose_stage(stage: int, gap: float, band: float) -> int:
    """Stage of the steering loop: 0 at rest, 1 holding, 2 a large move along a profile."""
    size = abs(gap)
    if size >= COARSE_DEG or (stage == 2 and size > max(FINE_DEG, 1.05 * band)):
        return 2
    if size > (0.95 if stage == 1 else 1.05) * band:
        return 1
    return 0


@numba.njit(cache=True)
def turn_motor(motor: Array, wanted: float, powered: bool) -> None:
    """Move angle and rate of the motor (deg, deg/s) by a step towards a wanted rate, against dry friction."""
    drive = MOTOR_GAIN * (wanted - motor[1]) if powered else -60.0 * motor[1]
    if abs(motor[1]) < 0.05 and abs(drive) <= FRICTION_DEG_S2:
        motor[1] = 0.0
    else:
        way = motor[1] if abs(motor[1]) >= 0.05 else drive
        motor[1] += STEP_S * (drive - math.copysign(FRICTION_DEG_S2, way))
    motor[0] = min(max(motor[0] + STEP_S * motor[1], -LOCK_DEG), LOCK_DEG)


@numba.njit(cache=True)
def drive_pump(oil: Array, target: float, lag: float, wheel_speed: float, droop: float, weight: float) -> None:
    """Move the drive (aim, pump flow as m/s, push in N, trim) by a step: ramp, pressure limit, oil as a spring."""
    late = lag - OWN_SPEED_LAG_S
    if late > 0.0:
        oil[0] += STEP_S * (target - oil[0]) / late
    else:
        oil[0] = target
    mass, pulse = weight / GRAVITY, 2.0 * math.pi * OIL_HZ
    leak = 2.0 * OIL_DAMPING / (mass * pulse)  # m/s of flow lost per N
    oil[3] += STEP_S * TRIM_PER_S * (leak * oil[2] - oil[3])
    wanted = (oil[0] + oil[3]) * (1.0 - droop)
    ramp = min(max((wanted - oil[1]) / PUMP_S, -PUMP_RAMP), PUMP_RAMP)
    most = 0.35 * weight
    if abs(oil[2]) > most:
        ramp -= math.copysign(2.0 * (abs(oil[2]) / most - 1.0), oil[2])
    oil[1] += STEP_S * ramp
    oil[2] += STEP_S * mass * pulse**2 * (oil[1] - wheel_speed - leak * oil[2])


@numba.njit(cache=True)
def pull_joint(a: Array, va: Array, fa: float, b: Array, vb: Array, fb: float, stiff: float, damp: float,
               play: float, na: Array, nb: Array) -> None:  # fmt: skip
    """Add forces (forward, right, moment; world axes for the first two) of a pin to both bodies.

    The pin is `fa` ahead of the centre of body a and `fb` ahead of that of b; across a it has `play` to either side.
    """
    sa, ca, sb, cb = math.sin(a[2]), math.cos(a[2]), math.sin(b[2]), math.cos(b[2])
    de, dn = b[0] + fb * sb - a[0] - fa * sa, b[1] + fb * cb - a[1] - fa * ca
    ve = vb[0] + fb * vb[2] * cb - va[0] - fa * va[2] * ca
    vn = vb[1] - fb * vb[2] * sb - va[1] + fa * va[2] * sa
    along, aside = de * sa + dn * ca, de * ca - dn * sa
    gap = math.copysign(max(abs(aside) - play, 0.0), aside)
    loose = 1.0 if abs(aside) >= play else 0.05
    forward = stiff * along + damp * (ve * sa + vn * ca)
    right = stiff * gap + loose * damp * (ve * ca - vn * sa)
    east, north = forward * sa + right * ca, forward * ca - right * sa
    na[0] += east
    na[1] += north
    na[2] += fa * (east * ca - north * sa)
    nb[0] -= east
    nb[1] -= north
    nb[2] -= fb * (east * cb - north * sb)


@numba.njit(cache=True)
def push_wheel(
    body: Array, rate: Array, ahead: float, right: float, angle: float, push: float, load: float, grip: float,
    limit: float, patch: float, creep_e: float, creep_n: float, z: Array, n: Array,
) -> None:  # fmt: skip
    """Add the force of a wheel (ahead of and right of its body's centre, turned by `angle` rad) on moving ground."""
    s, c = math.sin(body[2]), math.cos(body[2])
    ve = rate[0] + ahead * rate[2] * c - right * rate[2] * s - creep_e
    vn = rate[1] - ahead * rate[2] * s - right * rate[2] * c - creep_n
    sw, cw = math.sin(body[2] + angle), math.cos(body[2] + angle)
    along, aside = ve * sw + vn * cw, ve * cw - vn * sw
    side = compute_tyre_force(z, along, aside, load, grip, limit, patch)
    side -= load * aside * max(1.0 - abs(along) / 0.3, 0.0)  # at rest nothing else damps the bristles
    forward = push
    east, north = forward * sw + side * cw, forward * cw - side * sw
    n[0] += east
    n[1] += north
    n[2] += ahead * (east * c - north * s) - right * (east * s + north * c)


@numba.njit(cache=True)
def guide_machine(
    trace: Array, row: int, ahead_m: float, seen: Array, estimate: Array, guide: Guide, m: Machine
) -> float:
    """Command (deg) of the autosteer: an observer of offset and heading error, and an LQR with a look at the line."""
    old, turned = max(row - guide.position_late, 0), max(row - guide.heading_late, 0)
    heading = trace[old, HEADING]
    east = trace[old, EAST] + guide.forward * math.sin(heading) + guide.right * math.cos(heading) - guide.east
    north = trace[old, NORTH] + guide.forward * math.cos(heading) - guide.right * math.sin(heading) - guide.north
    aside = east * math.cos(guide.bearing) - north * math.sin(guide.bearing) + seen[row]
    error = trace[turned, HEADING] + guide.bias - guide.bearing
    error = math.atan2(math.sin(error), math.cos(error))
    way = max(trace[row, SPEED], 0.0) * 0.1
    bend = measured_curvature(trace[row, COMMAND], m)
    estimate[0] += way * math.sin(estimate[1])
    estimate[1] += way * bend
    estimate[0] += 0.45 * (aside - estimate[0])
    estimate[1] += 0.5 * (error - estimate[1])
    off = min(max(estimate[0] - ahead_m, -1.5), 1.5)
    wanted = -off / guide.reach**2 - 1.5 * math.sin(estimate[1]) / guide.reach
    return min(max(measured_angle(wanted, m), -22.0), 22.0)


@numba.njit(cache=True)
def choose_motor_rate(trace: Array, row: int, stage: int, p: Array) -> tuple[int, float]:
    """Stage of the steering loop and the rate (deg/s) it wants, from the command as old as it is when it arrives."""
    old = row - round(p[known.P_DEAD_TIME] / (STEP_S * ROW_STEPS)) - 2
    order = trace[old, COMMAND] if old >= 0 else trace[0, COMMAND]
    back = max(row - round(p[P_HUNT] / (STEP_S * ROW_STEPS)), 0)
    gap = order - trace[back, MOTOR]
    stage = choose_stage(stage, gap, p[known.P_DEAD_BAND])
    if stage == 2:
        return stage, math.copysign(p[known.P_RATE], gap)
    return stage, gap / max(p[known.P_LAG] - LOOP_LATE_S, 0.5 * p[known.P_LAG]) if stage == 1 else 0.0


@numba.njit(cache=True)
def push_axles(
    place: Array, rate: Array, force: Array, z: Array, mech: float, rear: float, pull: float, front_load: float,
    rear_load: float, soft: float, limit: float, creep_e: float, creep_n: float, rough: Array, m: Machine,
) -> None:  # fmt: skip
    """Add the forces of four wheels: the inner front wheel turns more, the rear ones pull."""
    # A limit is one across the machine, not the wheel; the front slides first, so that the machine does not spin.
    front_limit, rear_limit = limit / math.cos(0.0 if m.articulated else mech), 1.04 * limit
    for k in range(2):
        right, steer = (k - 0.5) * m.track, 0.0
        if not m.articulated and mech != 0.0:
            steer = math.atan(1.0 / (1.0 / math.tan(mech) - right / m.base))
        push_wheel(place[1], rate[1], 0.0, right, steer + rough[0], 0.0, front_load, soft, front_limit, m.patch_m,
                   creep_e, creep_n, z[k], force[1])  # fmt: skip
        push_wheel(place[0], rate[0], -m.centre, right, rear + rough[1], 0.5 * pull, rear_load, REAR_GRIP, rear_limit,
                   m.patch_m, creep_e, creep_n, z[2 + k], force[0])  # fmt: skip


@numba.njit(cache=True)
def join_bodies(place: Array, rate: Array, force: Array, hitch: float, mech: float, mech_rate: float, play: float,
                m: Machine) -> None:  # fmt: skip
    """Add the forces of the front pin and of the hitch, and of what holds the bodies in line."""
    pull_joint(place[0], rate[0], m.pin - m.centre, place[1], rate[1], -m.trail, 800.0 * m.mass, 8.4 * m.mass, 0.0,
               force[0], force[1])  # fmt: skip
    rest, rest_rate = (mech, mech_rate) if m.articulated else (0.0, 0.0)
    twist = 6400.0 * m.axle_inertia * (place[0, 2] + rest - place[1, 2])
    twist += 120.0 * m.axle_inertia * (rate[0, 2] + rest_rate - rate[1, 2])
    force[1, 2] += twist
    force[0, 2] -= twist
    pull_joint(place[0], rate[0], hitch - m.centre, place[2], rate[2], m.tool_m, 600.0 * m.tool_mass,
               35.0 * m.tool_mass, play, force[0], force[2])  # fmt: skip
    twist = 300.0 * m.tool_mass * (place[0, 2] - place[2, 2]) + 15.0 * m.tool_mass * (rate[0, 2] - rate[2, 2])
    force[2, 2] += twist
    force[0, 2] -= twist


@numba.njit(cache=True)
def work_implement(body: Array, rate: Array, force: Array, weight: float, down: float, tines: float,
                   turn: float) -> None:  # fmt: skip
    """Add what the soil does to the implement: drag, a side force against sliding, and a moment of side draft."""
    s, c = math.sin(body[2]), math.cos(body[2])
    along, aside = rate[0] * s + rate[1] * c, rate[0] * c - rate[1] * s
    drag = down * 0.005 * weight * math.tanh(along / 0.2)
    side = down * (0.05 + tines) * weight * aside / (abs(along) + 0.3)
    force[0] -= drag * s + side * c
    force[1] -= drag * c - side * s
    force[2] += turn * down * math.tanh(abs(along) / 0.2)


@numba.njit(cache=True)
def move_bodies(place: Array, rate: Array, force: Array, m: Machine) -> None:
    """A semi-implicit step: rates by the forces, places by the new rates."""
    for body in range(3):
        mass = (m.mass, m.axle_mass, m.tool_mass)[body]
        inertia = (m.inertia, m.axle_inertia, 0.4 * m.tool_mass)[body]
        rate[body, 0] += STEP_S * force[body, 0] / mass
        rate[body, 1] += STEP_S * force[body, 1] / mass
        rate[body, 2] += STEP_S * force[body, 2] / inertia
        for axis in range(3):
            place[body, axis] += STEP_S * rate[body, axis]


@numba.njit(cache=True)
def place_bodies(start: Array, place: Array, m: Machine) -> None:
    """Put tractor, axle and implement in line behind one another, the rear axle at `start` (m, m, rad)."""
    s, c = math.sin(start[2]), math.cos(start[2])
    for body, ahead in ((0, m.centre), (1, m.pin + m.trail), (2, HITCH_SHARE * m.base - m.tool_m)):
        place[body, 0], place[body, 1], place[body, 2] = start[0] + ahead * s, start[1] + ahead * c, start[2]


@numba.njit(cache=True)
def compute_front_load(m: Machine) -> float:
    """The load (N) of one front wheel."""
    lever = m.mass * m.centre + m.axle_mass * (m.pin + m.trail) + m.tool_mass * (HITCH_SHARE * m.base - m.tool_m)
    return 0.5 * GRAVITY * lever / m.base


@numba.njit(cache=True)
def drive_machine(
    start: Array, signal: Array, targets: Array, downs: Array, seen: Array, drift: Array, waves: Array, clock: float,
    base: Array, laws: Array, broken: Array, guide: Guide, m: Machine, bends: Array, angles: Array,
    moment: float,
) -> tuple[Array, Array]:  # fmt: skip
    """A drive. Returns rows (k, 10) every 5 ms, and parameters in force (k, 29).

    `signal` is the command (deg) or the line's offset (m), `broken` (k, 2) tells per row whether commands no longer
    reach the motor, and the side to which it runs by itself; `bends` and `angles` are the mechanical wheel angle (rad)
    of a curvature at 5 km/h, `moment` what turns the implement for a curvature of 1/m.
    """
    rows = len(signal)
    trace, kept = np.zeros((rows, COLUMNS)), np.zeros((rows, PARAMETERS))
    place, rate, force = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3))
    z, motor, oil, estimate, p = np.zeros((4, BRISTLES)), np.zeros(2), np.zeros(4), np.zeros(2), base.copy()
    hitch = HITCH_SHARE * m.base
    place_bodies(start, place, m)
    weight = GRAVITY * (m.mass + m.axle_mass + m.tool_mass)
    front_load = compute_front_load(m)
    rear_load = 0.5 * weight - front_load
    motor[0] = 0.0 if guide.closed else signal[0]
    play, wheel_speed, command, stage, mech, mech_rate, down = motor[0], 0.0, motor[0], 0, 0.0, 0.0, downs[0]
    wanted, wake, rough = 0.0, 0.0, np.zeros(2)
    for row in range(rows):
        speed = rate[0, 0] * math.sin(place[0, 2]) + rate[0, 1] * math.cos(place[0, 2])
        s, c = math.sin(place[0, 2]), math.cos(place[0, 2])
        east, north = place[0, 0] - m.centre * s, place[0, 1] - m.centre * c
        time = row * STEP_S * ROW_STEPS
        move = command - motor[0]
        known.evaluate_laws(laws, base, p, time, clock + time, east, north, downs[row], play, move, speed)
        if row % 20 == 0:
            command = signal[row]
            if guide.closed:
                ahead_m = signal[min(row + 120, rows - 1)]
                command = guide_machine(trace, max(row - 1, 0), ahead_m, seen, estimate, guide, m)
        elif not guide.closed and row % 4 == 0:
            command = signal[row]
        trace[row, EAST], trace[row, NORTH], trace[row, HEADING] = east, north, place[0, 2]
        trace[row, MOTOR], trace[row, WHEEL], trace[row, SPEED] = motor[0], play, speed
        trace[row, WHEEL_SPEED], trace[row, COMMAND], trace[row, YAW] = wheel_speed, command, rate[0, 2]
        trace[row, SIDE] = speed * rate[0, 2]
        kept[row] = p
        if row % 2 == 0:
            stage, wanted = choose_motor_rate(trace, row, stage, p)
        if broken[row, 1] != 0.0:
            wanted = broken[row, 1] * p[known.P_RATE]
        powered = broken[row, 0] == 0.0
        half = 0.5 * p[known.P_PLAY]
        wheel = play + p[known.P_OFFSET] + p[P_FURROW] * math.sin(1.3 * north) * math.tanh(abs(speed))
        wheel += p[P_TORQUE] * (oil[2] / weight - ROLLING)
        rough[0] = sum_waves(place[1, 0], place[1, 1], waves) + drift[row]
        rough[1] = sum_waves(east + 37.0, north, waves)
        field = 0.0
        if p[P_FIELD] != 0.0:
            field = min(max(180.0 * sum_waves(0.35 * east, 0.35 * north + 50.0, waves), -2.0), 2.0)
        bend = measured_curvature(wheel, m) * known.compute_path_factor(p, east, north, time, wheel < 0.0)
        new = look_up(bend * (1.0 + p[P_FIELD] * field), bends, angles)
        mech_rate, mech = (new - mech) / (STEP_S * ROW_STEPS) if row else 0.0, new
        down += min(max(downs[row] - down, -0.01), 0.01)
        limit = min(FRICTION, p[known.P_LIMIT])
        soft = 1.0 / (1.0 / FRONT_GRIP + math.radians(p[known.P_UNDERSTEER]) * GRAVITY)
        wake += STEP_S * ROW_STEPS / 0.8 * (min(abs(motor[1]) / 10.0, 1.0) - wake)
        creep = p[known.P_SLOPE] * abs(speed) * math.sin(p[known.P_SLOPE_TO] - place[0, 2])
        for _ in range(ROW_STEPS):
            turn_motor(motor, wanted, powered)
            play = min(max(play, motor[0] - half), motor[0] + half)
            force[:] = 0.0
            u = rate[0, 0] * math.sin(place[0, 2]) + rate[0, 1] * math.cos(place[0, 2])
            drive_pump(oil, targets[row], p[known.P_SPEED_LAG], wheel_speed, p[P_DROOP] * wake, weight)
            rolling = wheel_speed * (1.0 - p[known.P_SLIP]) * (1.0 - p[known.P_TOOL_SLIP] * down)
            pull = DRIVE_GRIP * 2.0 * rear_load * (rolling - u) / (abs(u) + 1.0)
            pull = min(max(pull, -0.6 * weight), 0.6 * weight)
            braked = ROLLING * weight * math.tanh(wheel_speed / 0.05)
            wheel_speed += STEP_S * (oil[2] - pull - braked) / (0.12 * m.mass)
            push_axles(place, rate, force, z, mech, -p[P_REAR_STEER] * mech, pull, front_load, rear_load, soft, limit,
                       creep * c, -creep * s, rough, m)  # fmt: skip
            join_bodies(place, rate, force, hitch, mech, mech_rate, 0.02 + p[P_HITCH] * down, m)
            work_implement(place[2], rate[2], force[2], weight, down, p[P_TINES], p[known.P_DRAFT] * moment)
            move_bodies(place, rate, force, m)
    return trace, kept
