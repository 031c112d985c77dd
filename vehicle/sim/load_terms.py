"""Forces of a tractor that pulls a load or drives over terrain, and what its engine, wheels and brakes can give.

The plane of the simulation is the map: metres, speeds and headings are those that a receiver shows. On the map gravity
is the force -m g times the gradient of the height: along the path its work is exactly that of the climb, and across it
it is to the weight as on the slope itself, so that tyres slip as much. Draft and inertia are taken as on level ground,
which is off by 1 / cos of the slope: 0.5 % at a slope of 10 %, 2 % at 20 %.

Thrust is the force of the driven wheels that rolling resistance is still to be taken from, positive in the direction of
travel. Compiled functions take records of vehicle.records; the fields of MODEL count where `loaded` is 1. The last
functions say after a run why a tractor got stuck, and how far each stayed from rolling over.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from fields.arrays import Records
from vehicle.energy.traction import SLIP_RATE
from vehicle.jit import compile_function, inline_function
from vehicle.missions.run import RollOverMargin, Stall
from vehicle.records import GRAVITY_MPS2
from vehicle.sim.effect_terms import CREEP_MPS

LEAST_GAIN_RATE = 1e-3  # of traction per slip: below it Newton's method is too near to a division by 0
SLACK_MPS = 0.1  # the set speed waits this far ahead of a tractor that lacks power
# Chosen: a tractor that lacks something is stuck if it stays below this speed for so long, and runs away above that.
STALL_MPS, RUNAWAY_MPS, STALL_AFTER_S = 0.2, 1.0, 3.0
SHORTAGES = ("nothing", "drive force", "grip", "power", "brakes")
"""What a tractor can lack, by the number in its state."""
NOTHING, FORCE, GRIP, POWER, BRAKES = range(len(SHORTAGES))


@inline_function
def compute_slopes(state, cosine: float, sine: float) -> tuple[float, float]:  # type: ignore[no-untyped-def]
    """Rise per metre ahead and to the right, by cosine and sine of the heading."""
    east, north = state.slope_east, state.slope_north
    return east * cosine + north * sine, east * sine - north * cosine


@inline_function
def compute_pull(model, ground, slope: float, speed: float, working: float) -> float:  # type: ignore[no-untyped-def]
    """Force (N, against going ahead) of slope and implement, and what step_body leaves out of rolling resistance.

    There that grows smoothly with speed, and lacks 2 % of its full value at 2 m/s.
    """
    size = abs(speed)
    share = min(max(speed * (1.0 / CREEP_MPS), -1.0), 1.0)
    draft = working * (model.draft_constant + (model.draft_linear + model.draft_square * size) * size)
    weight = model.mass * GRAVITY_MPS2
    return weight * slope + share * draft + ground.rolling * weight * (share - speed / (size + CREEP_MPS))  # type: ignore[no-any-return]


@compile_function
def find_thrust_limit(model, ground, speed: float, slip: float) -> tuple[float, int]:  # type: ignore[no-untyped-def]
    """Largest thrust (N) at a speed (m/s, not negative) and slip, and what limits it.

    The largest drive force of a tractor file stands for grip where that is not known.
    """
    limit, shortage = model.max_drive, FORCE
    if model.driven_weight > 0.0:
        limit = model.driven_weight * (model.best_gain + ground.rolling - model.inverse_mobility)
        shortage = GRIP
    power = model.axle_power * (1.0 - slip) / max(speed, CREEP_MPS) - model.driven_weight * model.slip_resistance * slip
    if power < limit:
        limit, shortage = power, POWER
    return limit, shortage


@inline_function
def refine_slip(slip: float, thrust: float, model, ground) -> float:  # type: ignore[no-untyped-def]
    """Slip of the driven wheels for a thrust (N), one step of Newton's method better than `slip`.

    Thrust changes little in a time step, so that one step from the slip of the step before is enough. At the slip of
    the best pull the curve is taken as the parabola that it has there; a thrust out of reach keeps the largest slip.
    Wheels that brake count as without slip. Solves what vehicle.energy.traction.solve_slip solves from nothing.
    """
    gain = thrust * model.per_driven_weight - ground.rolling + model.inverse_mobility
    rest = model.envelope * math.exp(-SLIP_RATE * slip)
    rate = SLIP_RATE * rest - model.slip_resistance
    if rate < LEAST_GAIN_RATE:
        slip = model.max_slip - math.sqrt(2.0 * max(model.best_gain - gain, 0.0) / rest) * (1.0 / SLIP_RATE)
    else:
        slip += (gain - (model.envelope - rest - model.slip_resistance * slip)) / rate
    return min(max(slip, 0.0), model.max_slip)  # type: ignore[no-any-return]


@compile_function
def limit_drive(state, model, ground, wanted: float, speed: float, dt: float) -> float:  # type: ignore[no-untyped-def]
    """The drive force (N, positive ahead) that a tractor can give of what its speed control wants.

    Where it can give less, the set speed waits until it can, as a driver or a governor would, and the time is counted
    that the tractor is stuck or runs away (`short_time`). Updates `thrust`, `wheel_slip` and `shortage`.
    """
    goal = state.reference_speed if state.reference_speed != 0.0 else speed
    direction = -1.0 if goal < 0.0 else 1.0
    travel, thrust, shortage = speed * direction, wanted * direction, NOTHING
    limit, lack = find_thrust_limit(model, ground, max(travel, 0.0), state.wheel_slip)
    if thrust > limit:
        thrust, shortage = limit, lack
        ahead = max(travel, 0.0) + SLACK_MPS
        if state.reference_speed * direction > ahead:
            state.reference_speed = ahead * direction
            state.last_error = state.reference_speed - speed
        state.integral = min(state.integral * direction, 0.0) * direction
    elif thrust < -model.brake_limit:
        thrust, shortage = -model.brake_limit, BRAKES
    if model.driven_weight > 0.0:
        state.wheel_slip = refine_slip(state.wheel_slip, thrust, model, ground)
    goal_size = abs(state.target_speed)
    is_stuck = shortage != NOTHING and shortage != BRAKES and travel < min(STALL_MPS, 0.5 * goal_size)
    runs_away = shortage == BRAKES and abs(speed) > goal_size + RUNAWAY_MPS
    state.short_time = state.short_time + dt if is_stuck or runs_away else 0.0
    state.shortage, state.thrust = shortage, thrust
    return thrust * direction


@inline_function
def note_overturning(state, slope_right: float, speed: float, spin: float) -> None:  # type: ignore[no-untyped-def]
    """Keep the largest sideways push over weight, and its place, from a slope and a turn (`spin` counter-clockwise)."""
    push = abs(speed * spin * (1.0 / GRAVITY_MPS2) - slope_right)
    if push > state.overturn:
        state.overturn, state.overturn_x, state.overturn_y = push, state.x, state.y
        state.overturn_leg = state.leg - state.first_leg


def build_stall(tractor: int, time_s: float, state: Any, model: Any, ground: Any) -> Stall:
    """The stall of a tractor, from its state and its MODEL and GROUND record."""
    shortage, goal = int(state["shortage"]), float(state["target_speed"])
    direction = -1.0 if goal < 0.0 else 1.0
    angle = float(state["angle"])
    ahead = float(state["slope_east"]) * math.cos(angle) + float(state["slope_north"]) * math.sin(angle)
    weight_n = float(model["mass"]) * GRAVITY_MPS2
    if shortage == BRAKES:
        down = -ahead if state["forward"] > 0.0 else ahead
        needed_n, available_n = weight_n * (down - float(ground["rolling"])), float(model["brake_limit"])
    else:
        size = abs(goal)
        pull_n = float(model["draft_constant"] + (model["draft_linear"] + model["draft_square"] * size) * size)
        model_view, ground_view = (np.array([record]).view(np.recarray)[0] for record in (model, ground))
        draft_n = pull_n if state["working"] else 0.0
        needed_n = weight_n * (ahead * direction + float(ground["rolling"])) + draft_n
        available_n = find_thrust_limit(model_view, ground_view, STALL_MPS, float(state["wheel_slip"]))[0]
    leg = int(state["leg"] - state["first_leg"])
    place = float(state["x"]), float(state["y"])
    return Stall(time_s, tractor, leg, *place, ahead * direction, SHORTAGES[shortage], needed_n, available_n)


def build_roll_over_margins(states: Records, track_m: float, centre_height_m: float) -> tuple[RollOverMargin, ...]:
    """The least margin of every tractor: where a rigid body on its track would tip, less the largest sideways push."""
    tip_rad = math.atan(0.5 * track_m / centre_height_m)
    return tuple(
        RollOverMargin(
            tip_rad - math.atan(float(state["overturn"])),
            float(state["overturn_x"]),
            float(state["overturn_y"]),
            int(state["overturn_leg"]),
        )
        for state in states
    )
