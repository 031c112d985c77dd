"""A drive of the third reference, step by step: steering computer, path follower, soil, causes and what breaks."""

import math

import numba
import numpy as np
import numpy.typing as npt

from tests.truth import laws as known
from tests.truth import third_body as body
from tests.truth.ground import EG105, MAP_SPEED_MPS, measured_curvature
from tests.truth.third_body import Breaks, Odd, Way

Array = npt.NDArray[np.float64]
STEP_S = 0.0025
COMPUTER_STEPS = 4  # of the steering computer: every 10 ms
LOOP_S = 0.1
WAVES = 14
SLEEP, WAKE = 0.92, 1.05  # shares of the dead band
FOLLOWER_GAIN, FOLLOWER_INTEGRAL, FOLLOWER_SPEED, MOST_COMMAND_DEG = 0.55, 0.02, 0.5, 25.0


@numba.njit(cache=True)
def find_rut(east: float, north: float, heading: float, waves: Array) -> float:
    """Side push of the ground on the front wheels (slip) at a place: ridges push one way however they are crossed."""
    to_east, to_north = 0.0, 0.0
    for one in range(WAVES):
        x = math.cos(waves[one, 0] * east + waves[one, 1] * north + waves[one, 2])
        to_east += waves[one, 3] * x
        to_north += waves[one, 4] * x
    return to_east * math.cos(heading) - to_north * math.sin(heading)


@numba.njit(cache=True)
def see_past_trees(east: float, north: float, odd: Odd) -> tuple[float, float]:
    """Error of a position (m, east and north) near a row of trees that runs north."""
    if odd.tree_m == 0.0:
        return 0.0, 0.0
    near = odd.tree_m * math.exp(-(((east - odd.tree_east) / odd.tree_width) ** 2))
    return near * (0.7 + 0.3 * math.sin(north / 3.0)), 0.4 * near * math.sin(north / 5.0 + 1.0)


@numba.njit(cache=True)
def steer_to_line(
    trace: Array, row: int, old: int, old_heading: int, offset: float, error_east: float, error_north: float,
    integral: float, way: Way, odd: Odd,
) -> tuple[float, float]:  # fmt: skip
    """Command (deg) that keeps the front axle on a line, and the cross error (m): Stanley's law with an integral.

    `old`, `old_heading` are the rows of the trace that position and heading of the receiver come from.
    """
    true, heading = trace[old, body.HEADING], trace[old_heading, body.HEADING] + way.heading_bias
    ahead = way.forward - body.REAR
    east = trace[old, body.EAST] + ahead * math.sin(true) + way.right * math.cos(true)
    north = trace[old, body.NORTH] + ahead * math.cos(true) - way.right * math.sin(true)
    more_east, more_north = see_past_trees(east, north, odd)
    rest = body.BASE - way.assumed_forward
    east += error_east + more_east + rest * math.sin(heading) - way.east
    north += error_north + more_north + rest * math.cos(heading) - way.north
    aside = east * math.cos(way.bearing) - north * math.sin(way.bearing) - offset
    turn = heading - way.bearing
    turn = math.atan2(math.sin(turn), math.cos(turn))
    speed = abs(trace[row, body.SHAFT])
    wanted = math.degrees(-turn - math.atan(FOLLOWER_GAIN * aside / (FOLLOWER_SPEED + speed)) - integral)
    return min(max(wanted, -MOST_COMMAND_DEG), MOST_COMMAND_DEG), aside


@numba.njit(cache=True)
def surround(
    state: Array, time: float, day: float, down: float, target: float, rough: float, gust: float, depth: float,
    laws: Array, waves: Array, odd: Odd, env: Array,
) -> None:  # fmt: skip
    """Fill `env` with what acts on the body here and now."""
    east, north, heading = state[body.EAST], state[body.NORTH], state[body.HEADING]
    u, angle = state[body.AHEAD], state[body.WHEEL]
    here = (time, day, east, north, down, angle, angle, u)
    slope = known.evaluate_law(laws[known.P_SLOPE], *here)
    moist = 1.0
    if odd.moist != 1.0:
        outside = math.hypot(east - odd.moist_east, north - odd.moist_north) - odd.moist_radius
        moist = odd.moist + (1.0 - odd.moist) * min(max(0.5 + outside / 3.0, 0.0), 1.0)
    limit = known.evaluate_law(laws[known.P_LIMIT], *here)
    env[body.RUT] = find_rut(east, north, heading, waves) + rough
    env[body.CREEP] = slope * math.sin(odd.slope_to - heading)
    env[body.FRICTION_SIDE] = min(limit, body.FRICTION) * moist
    env[body.FRONT_SHARE] = odd.front_stiffness * moist
    env[body.REAR_SHARE] = moist
    draft = known.evaluate_law(laws[known.P_DRAFT], *here) * down
    # The force that turns the front axle's brush by the slip that bends the path so.
    env[body.FRONT_SIDE_N] = -2.0 * body.push_tyre(
        draft * body.BASE, body.FRONT_LOAD, body.FRONT_LOAD, body.FRONT_STIFFNESS, body.FRICTION, 0.0
    )
    env[body.HITCH_SIDE_N] = odd.hitch_n * depth * down - odd.swing_n * state[body.SWING]
    wind = 1.0 + 0.6 * gust
    env[body.ACCEL_EAST] = odd.wind_east * wind + odd.fall_east
    env[body.ACCEL_NORTH] = odd.wind_north * wind + odd.fall_north
    slip = known.evaluate_law(laws[known.P_SLIP], *here)
    tool_slip = known.evaluate_law(laws[known.P_TOOL_SLIP], *here) * down
    env[body.LOST] = 1.0 - (1.0 - slip) * (1.0 - tool_slip)
    env[body.LOCKED] = odd.locked if time >= odd.locked_from_s else 0.0
    env[body.DRAG_N] = body.ROLLING_RESISTANCE * body.MASS * body.GRAVITY * (1.0 + 20.0 * rough)
    env[body.LEFT_FLAT] = min(odd.flat * time / 60.0, 0.85)
    env[body.TARGET] = target * (1.0 + odd.hunting * math.sin(2.0 * math.pi * time / odd.hunting_s))
    env[body.LAG_S] = known.evaluate_law(laws[known.P_SPEED_LAG], *here)
    env[body.FEED] = odd.acceleration


@numba.njit(cache=True)
def find_mean_angle(
    state: Array, play: float, way_m: float, front_n: float, here: tuple[float, ...], half_play: float, laws: Array,
    odd: Odd, table: Array,
) -> float:  # fmt: skip
    """Mean angle of the front wheels (rad): play, linkage and what hides in them, then the calibrated curve."""
    wheel = min(max(play, state[body.WHEEL] - half_play), state[body.WHEEL] + half_play)
    wheel += known.evaluate_law(laws[known.P_OFFSET], *here)
    wheel -= known.evaluate_law(laws[known.P_UNDERSTEER], *here) * front_n / (2.0 * body.FRONT_LOAD / body.GRAVITY)
    if odd.wobble != 0.0:
        wheel += odd.wobble * math.sin(2.0 * math.pi * way_m / odd.wobble_m)
    if odd.speed_link != 0.0:
        less = odd.speed_link * (abs(state[body.AHEAD]) - MAP_SPEED_MPS)
        wheel -= less * math.tanh(wheel)
    factor = known.evaluate_law(laws[known.P_GAIN], *here) * known.evaluate_law(laws[known.P_PATCH], *here)
    factor *= known.evaluate_law(laws[known.P_DRIFT], *here)
    if wheel < 0.0:
        factor *= known.evaluate_law(laws[known.P_LEFT], *here)
    return body.look_up(measured_curvature(wheel, EG105) * factor, table)


@numba.njit(cache=True)
def demand_opening(gap: float, stage: int, stiction: float, here: tuple[float, ...], laws: Array) -> tuple[float, int]:
    """Opening asked of the spool (-1 to 1) and the stage of the computer: 0 at rest, 1 fine, 2 slewing."""
    size, side = abs(gap), math.copysign(1.0, gap)
    toward = (here[0], here[1], here[2], here[3], here[4], side, here[6], here[7])
    band = known.evaluate_law(laws[known.P_DEAD_BAND], *toward)
    if size >= body.SWITCH_DEG:
        stage = 2
    elif stage == 2 and size < max(body.RELEASE_DEG, WAKE * band):
        stage = 1
    elif stage == 1 and size < max(SLEEP * band, 0.15 * stiction):
        stage = 0
    elif stage == 0 and size > max(WAKE * band, stiction):
        stage = 1
    if stage == 0:
        return 0.0, stage
    if stage == 2:
        speed = known.evaluate_law(laws[known.P_RATE], *toward)
    else:
        speed = size / max(known.evaluate_law(laws[known.P_LAG], *toward), 0.03)
    return side * (min(speed / body.PUMP_DEG_PER_S, 1.0) + body.OVERLAP), stage


@numba.njit(cache=True)
def roll_on(
    start: Array, day: float, signal: Array, targets: Array, downs: Array, depths: Array, rough: Array, gusts: Array,
    old: npt.NDArray[np.int64], old_heading: npt.NDArray[np.int64], errors: Array, late: int, drive: float,
    laws: Array, waves: Array, odd: Odd, breaks: Breaks, way: Way, table: Array,
) -> tuple[Array, Array]:  # fmt: skip
    """A drive. Returns states (steps, STATES) and the command in force (deg), a row per STEP_S.

    `signal` is the angle commanded (deg) or the offset wanted (m) of a closed loop, the valve gets it `late` steps
    later; `old` and `old_heading` are the rows that the loop's receiver reports, `errors` (steps, 2) how wrong it is.
    """
    steps, dt = len(signal), STEP_S
    trace, held = np.zeros((steps, body.STATES)), np.zeros(steps)
    k1, k2, middle = np.zeros(body.STATES), np.zeros(body.STATES), np.zeros(body.STATES)
    env, loads, state = np.zeros(body.SURROUNDINGS), np.zeros(4), start.copy()
    play, output, demand, stage = start[body.WHEEL], start[body.WHEEL], 0.0, 0
    integral, way_m, front_n, before, free = 0.0, 0.0, 0.0, 0.0, 0.0
    every = round(LOOP_S / dt)
    for row in range(steps):
        trace[row] = state
        time, down = row * dt, downs[row]
        here = (time, day + time, state[body.EAST], state[body.NORTH], down, state[body.WHEEL], state[body.WHEEL],
                state[body.AHEAD])  # fmt: skip
        if not way.closed:
            output = signal[row]
        elif row % every == 0:
            output, aside = steer_to_line(trace, row, min(old[row], row), min(old_heading[row], row), signal[row],
                                          errors[row, 0], errors[row, 1], integral, way, odd)  # fmt: skip
            if abs(aside) < 0.5:
                integral = min(max(integral + FOLLOWER_INTEGRAL * aside * LOOP_S, -0.06), 0.06)
        held[row] = output
        stuck = breaks.stuck_from <= time < breaks.stuck_to
        loose = breaks.loose_from <= time < breaks.loose_to
        if row % COMPUTER_STEPS == 0:
            gap = (held[row - late] if row >= late else start[body.WHEEL]) - state[body.WHEEL]
            demand, stage = demand_opening(gap, stage, odd.stiction, here, laws)
            if stuck:
                demand = breaks.stuck_side * (
                    known.evaluate_law(laws[known.P_RATE], *here) / body.PUMP_DEG_PER_S + body.OVERLAP
                )
            elif loose and breaks.linkage == 0.0:
                demand = 0.0
        half_play = 0.5 * known.evaluate_law(laws[known.P_PLAY], *here)
        surround(state, time, day + time, down, targets[row], rough[row], gusts[row], depths[row], laws, waves, odd,
                 env)  # fmt: skip
        torn = loose and breaks.linkage > 0.0
        free = free * (1.0 - dt / 0.8) if torn else play
        for stage_of_step in range(2):
            now = state if stage_of_step == 0 else middle
            out = k1 if stage_of_step == 0 else k2
            if torn:
                mean = body.look_up(measured_curvature(free, EG105), table)
            else:
                mean = find_mean_angle(now, play, way_m, front_n, here, half_play, laws, odd, table)
            front_n = body.derive_body(now, mean, drive, env, loads, out)
            body.derive_steering(now, demand, front_n, out)
            out[body.SWING] = now[body.SWING_SPEED]
            force = -now[body.YAW_RATE] * abs(now[body.AHEAD]) - now[body.SWING]
            out[body.SWING_SPEED] = body.SWING_RATE**2 * force - (
                2.0 * body.SWING_DAMPING * body.SWING_RATE * now[body.SWING_SPEED]
            )
            if stage_of_step == 0:
                for one in range(body.STATES):
                    middle[one] = state[one] + dt * k1[one]
        for one in range(body.STATES):
            state[one] += 0.5 * dt * (k1[one] + k2[one])
        bend_joint(state, mean - before if row > 0 else 0.0, odd.joint)
        before = mean
        play = min(max(play, state[body.WHEEL] - half_play), state[body.WHEEL] + half_play)
        way_m += abs(state[body.AHEAD]) * dt
    return trace, held


@numba.njit(cache=True)
def bend_joint(state: Array, change: float, share: float) -> None:
    """Turn the front half of an articulated tractor about its rigid axle by its share of a change of the joint."""
    if share == 0.0:
        return
    before = state[body.HEADING]
    state[body.HEADING] = before + share * change
    state[body.EAST] += body.REAR * (math.sin(state[body.HEADING]) - math.sin(before))
    state[body.NORTH] += body.REAR * (math.cos(state[body.HEADING]) - math.cos(before))
