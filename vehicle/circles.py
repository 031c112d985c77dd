"""Circles at a fixed wheel angle: one body, one command, no plan and no world."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from vehicle.bodies import make_body, new_space
from vehicle.compile import compile_grounds, compile_model
from vehicle.engine import Engine
from vehicle.layout import BODY_ANGLE, BODY_PLACE, BODY_SPIN, BODY_VELOCITY, BODY_WIDTH, DT_S, STATE
from vehicle.loop import run_fixed
from vehicle.tractor import Implement, Tractor

CIRCLE_SPEED_MPS = 5.0 / 3.6  # speed of the thesis's experiments
MEASURED_STEPS = 60  # the last second: by then the circle has settled
Array = npt.NDArray[Any]


@dataclass(frozen=True)
class Circle:
    """A drive with a fixed steering angle: the antenna's track (t, 2) and the radius (m) of its circle."""

    track: npt.NDArray[np.float64]
    radius_m: float


def fixed_circle(
    tractor: Tractor, steering_deg: float, ground: int, tables: Array, *, seconds: float, speed_mps: float
) -> Circle:
    """Drive with the wheels at a fixed angle and measure the circle of the antenna over the last second.

    `ground` is its place among vehicle.ground.GROUNDS, `tables` (grounds, n) are steering tables (vehicle.calibration).
    """
    space = new_space()
    engine = Engine(space, [make_body(space, tractor, (0.0, 0.0, math.pi / 2))])
    states = np.zeros(1, dtype=STATE)
    # The wheels stand at the angle from the start: Eq. 2.8 would leave them up to its dead band short of it.
    states["command"] = states["steering"] = math.radians(steering_deg)
    states["target_speed"] = speed_mps
    states["stage"] = 1
    steps = round(seconds / DT_S)
    track = np.empty((steps, BODY_WIDTH))
    run_fixed(
        steps, DT_S, engine.door,
        states, np.array([compile_model(tractor, Implement())]), compile_grounds(), ground, tables, track,
    )  # fmt: skip
    return _measured(track, tractor.antenna_forward_m - tractor.rear_axle_m)


def _measured(track: Array, reach: float) -> Circle:
    """The circle of a point `reach` ahead of the centre of mass, from bodies per step (t, 6)."""
    angle, last = track[:, BODY_ANGLE], track[-MEASURED_STEPS:]
    antenna = track[:, BODY_PLACE] + reach * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    spin, facing = last[:, BODY_SPIN], last[:, BODY_ANGLE]
    velocity = last[:, BODY_VELOCITY] + reach * spin[:, None] * np.stack([-np.sin(facing), np.cos(facing)], axis=1)
    radius = np.hypot(*velocity.T) / np.maximum(np.abs(spin), 1e-12)
    return Circle(antenna, float(radius.mean()))
