"""The tractor of the fifth reference: one rigid body that rolls on four TMeasy tyres, with an implement drawn behind.

States are those of the body at its centre of mass (ahead, sideways, turning, roll) and of each wheel (speed of its
rim, relaxed side slip). Differentials are open, the driveline regulates the mean speed of the rear rims. Loads shift
with roll and pull. A valve integrates oil into the wheel angle: it has an overlap, leaks, and gets what the pump gives
at this engine speed. The implement follows its drawbar while it works and is carried when lifted; its draft comes in
pulses, a row for each side. Steps of 1 ms, semi-implicit in the rims. Headings clockwise from north in rad, wheel
angles in degrees to the right, else SI.

Tyres: Rill, TMeasy, "Road Vehicle Dynamics" (2011): initial slope, peak, and a fall to sliding, for combined slip.
"""

import math

import numba
import numpy as np
import numpy.typing as npt

from tests.truth import laws as known
from tests.truth.fifth_drivers import choose_command
from tests.truth.ground import EG105, LOCK_DEG, look_up, measured_curvature, sum_waves

Array = npt.NDArray[np.float64]

STEP_S, ROW_STEPS, GRAVITY = 0.001, 5, 9.80665
MASS, INERTIA, FRONT, REAR, TRACK, RIM_KG = 3850.0, 6200.0, 1.3, 1.1, 1.6, 130.0
BASE, HITCH_M, DRAWBAR_M, HALF_WIDTH_M = FRONT + REAR, 0.4, 2.2, 1.2
HEIGHT, ROLL_INERTIA, ROLL_STIFF, ROLL_DAMP, FRONT_ROLL, MAST_M = 0.9, 2200.0, 260000.0, 14000.0, 0.2, 2.7
FRONT_GRIP, REAR_GRIP, FRICTION, PEAK, ALONG, SLIDE, LEVEL = 9.5, 10.5, 0.75, 2.5, 6.0, 0.98, 1.04
RELAXATION_M, CARCASS, REST_SPEED, ROLLING, FRONT_TORQUE = 0.4, 5000.0, 0.8, 0.05, 0.4
DRIVE_GAIN, DRIVE_REST, MOST_PULL, RAMP, DRIVE_S, OWN_SPEED_LAG_S = 60000.0, 40000.0, 0.45, 0.8, 0.28, 0.35
COARSE_DEG, FINE_DEG, SPOOL_S, OVERLAP, COMPENSATED, CONTROLLER_ROWS, LOOP_LATE_S = 5.0, 0.5, 0.015, 0.03, 0.9, 4, 0.025
EAST, NORTH, HEADING, MOTOR, WHEEL, SPEED, RIM, COMMAND, YAW, ROLL, TARGET, DOWN, GEAR = range(13)
COLUMNS = 13
(P_LIFT, P_TYRE, P_LOCK, P_CRAB, P_WIND, P_WIND_TO, P_FURROW, P_PUMP, P_LEAK, P_TANK, P_SOFT, P_PULL) = range(21, 33)
PARAMETERS = 33


@numba.njit(cache=True)
def compute_tyre_ratio(along: float, aside: float, load: float, static: float, grip: float, friction: float) -> float:
    """Force per combined slip (N) of a tyre at slips along (times ALONG) and aside."""
    slope = grip * load * (1.2 - 0.2 * load / static)
    most = friction * load
    peak, slip = PEAK * most / slope, math.hypot(ALONG * along, aside)
    share = slip / peak
    if share <= 1.0:
        return slope / (1.0 + share * (share + PEAK - 2.0))
    fall = min((share - 1.0) / 3.0, 1.0)
    return most * (1.0 - (1.0 - SLIDE) * fall * fall * (3.0 - 2.0 * fall)) / slip


@numba.njit(cache=True)
def turn_valve(valve: Array, trace: Array, row: int, p: Array, engine: float, broken: float, running: float) -> None:
    """The steering computer (valve: angle, spool, asked spool, stage): every 20 ms it asks for a spool."""
    if running != 0.0:
        valve[2] = running * p[known.P_RATE] / p[P_PUMP] + math.copysign(OVERLAP, running)
    elif broken != 0.0:
        valve[2] = 0.0
    elif row % CONTROLLER_ROWS == 0:
        old = row - round(p[known.P_DEAD_TIME] / (STEP_S * ROW_STEPS))
        gap = trace[max(old, 0), COMMAND] - valve[0]
        size = abs(gap)
        if size >= COARSE_DEG or (valve[3] == 2.0 and size > max(FINE_DEG, p[known.P_DEAD_BAND])):
            valve[3] = 2.0
        else:
            valve[3] = 1.0 if size > p[known.P_DEAD_BAND] else 0.0
        rate = p[known.P_RATE] if valve[3] == 2.0 else size / max(p[known.P_LAG] - LOOP_LATE_S, 0.5 * p[known.P_LAG])
        share = rate / p[P_PUMP] + COMPENSATED * OVERLAP if valve[3] > 0.0 else 0.0
        valve[2] = math.copysign(share, gap)
    most = engine + OVERLAP
    valve[2] = min(max(valve[2], -most), most)


@numba.njit(cache=True)
def find_bend(play: float, p: Array, row: Array, time: float, east: float, north: float) -> float:
    """Curvature (1/m) that the linkage asks for at the wheels' angle `play` on the sensor's scale."""
    wheel = play + p[known.P_OFFSET] - p[known.P_UNDERSTEER] * row[SPEED] * row[YAW]
    return measured_curvature(wheel, EG105) * known.compute_path_factor(p, east, north, time, wheel < 0.0)


@numba.njit(cache=True)
def load_wheels(body: Array, pull: float, lifted: float, out: Array) -> None:
    """Loads (N) of front left, front right, rear left, rear right from roll, pull and the lift of the drawbar."""
    twist = (ROLL_STIFF * body[6] + ROLL_DAMP * body[7]) / TRACK
    back = 0.5 * MASS * pull * HEIGHT / BASE + 0.5 * lifted
    for k in range(4):
        side = 1.0 if k % 2 else -1.0
        static = 0.5 * MASS * GRAVITY * (REAR if k < 2 else FRONT) / BASE
        share = FRONT_ROLL if k < 2 else 1.0 - FRONT_ROLL
        out[k] = max(static + (-back if k < 2 else back) + side * share * twist, 300.0)


@numba.njit(cache=True)
def push_wheels(
    body: Array, rims: Array, slips: Array, loads: Array, mech: float, torque: float, rut: float, creep: float,
    p: Array, limit: float, lost: float, leak: float, locked: float, out: Array,
) -> None:  # fmt: skip
    """Move rims and side slips by a step; `out` gets the forces ahead and to the right, and the moment."""
    out[:] = 0.0
    tangent = math.tan(mech)
    for k in range(4):
        side, front = (1.0 if k % 2 else -1.0), k < 2
        ahead = FRONT if front else -REAR
        steer = math.atan(tangent / (1.0 - side * 0.5 * TRACK * tangent / BASE)) + rut if front else p[P_CRAB]
        along = body[3] - side * 0.5 * TRACK * body[5]
        aside = body[4] + ahead * body[5] - creep
        c, s = math.cos(steer), math.sin(steer)
        rolling, sliding = along * c + aside * s, aside * c - along * s
        base = abs(rims[k]) + REST_SPEED
        wanted = sliding / max(abs(rolling), 0.25)
        rate = (wanted - slips[k]) * (abs(rolling) + 0.15) / RELAXATION_M
        slips[k] += STEP_S * rate
        soft = max(1.0 - leak, 0.3) if k % 2 == 0 else 1.0
        static = 0.5 * MASS * GRAVITY * (REAR if front else FRONT) / BASE
        grip = soft * (FRONT_GRIP if front else REAR_GRIP)
        along_slip = (rims[k] * (1.0 - lost) - rolling) / base
        ratio = compute_tyre_ratio(along_slip, slips[k], loads[k], static, grip, FRICTION)
        side_ratio = ratio
        if limit < FRICTION:  # of the ground to the side; the front slides first, so that the tractor does not spin
            most = LEVEL * limit * (1.0 / math.cos(mech) if front else 1.06)
            side_ratio = min(ratio, compute_tyre_ratio(0.0, slips[k], loads[k], static, grip, most))
        stiff = ALONG * ratio / base
        drive = 0.5 * torque * (FRONT_TORQUE if front else 1.0 - FRONT_TORQUE)
        drive -= (ROLLING + 0.15 * (1.0 - soft)) * loads[k] * math.tanh(rims[k] / 0.05)
        if not front:
            drive -= locked * 50000.0 * (rims[k] - rims[5 - k])
        rims[k] = (rims[k] + STEP_S / RIM_KG * (drive + stiff * rolling)) / (
            1.0 + STEP_S / RIM_KG * stiff * (1.0 - lost)
        )
        x = stiff * (rims[k] * (1.0 - lost) - rolling)
        y = -side_ratio * slips[k] - CARCASS * RELAXATION_M * rate * min(abs(rolling), 1.0)
        fx, fy = x * c - y * s, x * s + y * c
        out[0] += fx
        out[1] += fy
        out[2] += ahead * fy - side * 0.5 * TRACK * fx


@numba.njit(cache=True)
def move_body(body: Array, force: Array, tilt: float, soft: float) -> None:
    """A step of the body (east, north, heading, ahead, sideways, turning, roll, roll rate) under its forces."""
    pull, push = force[0] / MASS, force[1] / MASS
    u, v, r = body[3], body[4], body[5]
    body[3] += STEP_S * (pull + v * r)
    body[4] += STEP_S * (push - u * r + GRAVITY * tilt)
    body[5] += STEP_S * force[2] / INERTIA
    if abs(body[3]) < 0.05:
        body[4] *= 1.0 - 8.0 * STEP_S
        body[5] *= 1.0 - 8.0 * STEP_S
    lean = -MASS * HEIGHT * push - ROLL_STIFF / soft * body[6] - ROLL_DAMP * body[7]
    body[7] += STEP_S * lean / ROLL_INERTIA
    body[6] += STEP_S * body[7]
    body[2] += STEP_S * body[5]
    s, c = math.sin(body[2]), math.cos(body[2])
    body[0] += STEP_S * (body[3] * s + body[4] * c)
    body[1] += STEP_S * (body[3] * c - body[4] * s)


@numba.njit(cache=True)
def drive_rims(line: Array, target: float, mean: float, lag: float) -> float:
    """Driving force (N) at the rims; `line` is aim, late aim and integral (m/s, m/s, N)."""
    late = lag - OWN_SPEED_LAG_S
    line[0] = line[0] + STEP_S * (target - line[0]) / late if late > 0.0 else target
    line[1] += STEP_S * min(max((line[0] - line[1]) / DRIVE_S, -RAMP), RAMP)
    gap, most = line[1] - mean, MOST_PULL * MASS * GRAVITY
    line[2] = min(max(line[2] + STEP_S * DRIVE_REST * gap, -most), most)
    return min(max(DRIVE_GAIN * gap + line[2], -most), most)


@numba.njit(cache=True)
def pull_hitch(body: Array, tool: float, down: float, pulses: Array, pull: float, gain: float, p: Array, time: float,
               out: Array) -> None:  # fmt: skip
    """Add what drawbar, wind and furrows do to the tractor; `gain` is the hitch's side force (N) per curvature."""
    moving = math.tanh(body[3] / 0.2)
    left, right = p[P_PULL] * down * (1.0 + pulses[0]), p[P_PULL] * down * (1.0 + pulses[1])
    whole = 0.5 * (left + right) * moving + p[P_TANK] * (pull + 0.04 * GRAVITY * moving)
    bent = tool - body[2]
    aside = -whole * math.sin(bent) + 0.5 * (left - right) * moving * HALF_WIDTH_M / DRAWBAR_M
    aside += gain * p[known.P_DRAFT] * down * moving
    out[0] -= whole * math.cos(bent)
    out[1] += aside
    out[2] -= (REAR + HITCH_M) * aside
    if p[P_WIND] != 0.0:
        gust = 1.0 + 0.5 * math.sin(0.9 * time) * math.sin(0.23 * time + 1.0)
        out[2] += down * p[P_WIND] * gust * math.sin(p[P_WIND_TO] - body[2])
    if p[P_FURROW] != 0.0:
        out[1] += 0.7 * p[P_FURROW] * down * math.sin(2.0 * math.pi * body[0] / 1.8) * math.cos(body[2])
        out[2] += FRONT * p[P_FURROW] * down * math.sin(2.0 * math.pi * body[0] / 1.8) * math.cos(body[2])


@numba.njit(cache=True)
def drive_tractor(
    start: Array, parts: Array, seen: Array, hands: Array, pulses: Array, ruts: Array, tilts: Array, clock: float,
    base: Array, laws: Array, broken: Array, guide: Array, bends: Array, angles: Array, gain: float,
) -> Array:  # fmt: skip
    """Rows (k, COLUMNS) of a run every 5 ms from a place (m, m, rad), at rest, by parts (tests.truth.fifth_drivers).

    `seen` (k, 2) is how wrong the driver's receiver is (m), `hands` (k,) his own noise, `pulses` (k, 2) the draft's;
    `bends` and `angles` are the mean angle of the front wheels (rad) of a curvature at 5 km/h.
    """
    rows = len(seen)
    trace, p, body = np.zeros((rows, COLUMNS)), base.copy(), np.zeros(8)
    rims, slips, loads, force, line, valve = (np.zeros(4), np.zeros(4), np.zeros(4), np.zeros(3), np.zeros(3),
                                              np.zeros(4))  # fmt: skip
    memory = np.zeros(6)
    body[0], body[1], body[2] = start[0] + REAR * math.sin(start[2]), start[1] + REAR * math.cos(start[2]), start[2]
    play, tool, down, part, pull, command = 0.0, start[2], parts[0, 5], 0, 0.0, 0.0
    memory[0], memory[1], memory[2] = start[0], start[1], start[2]
    for row in range(rows):
        time = row * STEP_S * ROW_STEPS
        while part < len(parts) - 1 and time >= parts[part, 1]:
            part += 1
            memory[0], memory[1] = trace[row - 1, EAST], trace[row - 1, NORTH]
            memory[2] = trace[row - 1, HEADING]
        s, c = math.sin(body[2]), math.cos(body[2])
        east, north = body[0] - REAR * s, body[1] - REAR * c
        here = trace[row]
        here[EAST], here[NORTH], here[HEADING], here[MOTOR], here[WHEEL] = east, north, body[2], valve[0], play
        here[SPEED], here[RIM], here[YAW], here[ROLL] = body[3], 0.5 * (rims[2] + rims[3]), body[5], body[6]
        here[TARGET], here[GEAR], here[DOWN] = parts[part, 4], parts[part, 6], parts[part, 5]
        known.evaluate_laws(
            laws, base, p, time, clock + time, east, north, here[DOWN], play, command - valve[0], body[3]
        )
        command = choose_command(trace, row, parts[part], command, seen, hands, guide, memory)
        here[COMMAND] = command
        engine = 0.55 + 0.45 * min(abs(here[TARGET]) / 2.2, 1.0)
        turn_valve(valve, trace, row, p, engine, broken[row, 0], broken[row, 1])
        half = 0.5 * p[known.P_PLAY]
        mech = look_up(find_bend(play, p, here, time, east, north), bends, angles)
        rut, tilt = sum_waves(east + BASE * s, north + BASE * c, ruts), sum_waves(east, north, tilts)
        here[ROLL] += tilt
        down += min(max(here[DOWN] - down, -0.01), 0.01)
        lost = 1.0 - (1.0 - p[known.P_SLIP]) * (1.0 - p[known.P_TOOL_SLIP] * down)
        creep = p[known.P_SLOPE] * abs(body[3]) * math.sin(p[known.P_SLOPE_TO] - body[2])
        leak, limit = p[P_TYRE] * (clock + time) / 60.0, min(FRICTION, p[known.P_LIMIT])
        lifted = p[P_LIFT] * p[P_PULL] * down * (1.0 + 0.5 * (pulses[row, 0] + pulses[row, 1]))
        locked = 1.0 if p[P_LOCK] > 0.0 and time >= p[P_LOCK] else 0.0
        for _ in range(ROW_STEPS):
            valve[1] += STEP_S / SPOOL_S * (valve[2] - valve[1])
            flow = math.copysign(max(abs(valve[1]) - OVERLAP, 0.0), valve[1]) * p[P_PUMP]
            valve[0] = min(max(valve[0] + STEP_S * (flow - p[P_LEAK] * valve[0]), -LOCK_DEG), LOCK_DEG)
            play = min(max(play, valve[0] - half), valve[0] + half)
            torque = drive_rims(line, here[TARGET], 0.5 * (rims[2] + rims[3]), p[known.P_SPEED_LAG])
            load_wheels(body, pull, lifted, loads)
            push_wheels(body, rims, slips, loads, mech, torque, rut, creep, p, limit, lost, leak, locked, force)
            pull_hitch(body, tool, down, pulses[row], pull, gain, p, time, force)
            pull += STEP_S / 0.1 * (force[0] / MASS - pull)
            move_body(body, force, tilt, p[P_SOFT])
            swing = body[3] * math.sin(body[2] - tool) / DRAWBAR_M
            if here[DOWN] > 0.5 or (p[P_TANK] > 0.0 and body[3] > 0.0):
                tool += STEP_S * (swing - (HITCH_M + REAR) / DRAWBAR_M * body[5] * math.cos(body[2] - tool))
            else:
                tool += STEP_S * (body[2] - tool) / 0.7 + STEP_S * body[5]
    return trace
