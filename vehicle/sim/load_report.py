"""What a run says of its loads: why a tractor got stuck, and how far each stayed from rolling over."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from vehicle.arrays import Records
from vehicle.missions.run import RollOverMargin, Stall
from vehicle.records import GRAVITY_MPS2
from vehicle.sim.load_terms import BRAKES, SHORTAGES, STALL_MPS, find_thrust_limit

Record = Any  # one of vehicle.records


def build_stall(tractor: int, time_s: float, state: Record, model: Record, ground: Record) -> Stall:
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
        draft_n = pull_n if state["working"] else 0.0
        needed_n = weight_n * (ahead * direction + float(ground["rolling"])) + draft_n
        available_n = find_thrust_limit(_view(model), _view(ground), STALL_MPS, float(state["wheel_slip"]))[0]
    leg = int(state["leg"] - state["first_leg"])
    place = float(state["x"]), float(state["y"])
    return Stall(time_s, tractor, leg, *place, ahead * direction, SHORTAGES[shortage], needed_n, available_n)


def _view(record: Record) -> Any:
    return np.array([record]).view(np.recarray)[0]


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
