"""Paths of the experiments as missions. They start at the origin; "ahead" is north, to the right is east."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from vehicle.compile import CompiledPlan
from vehicle.errors import VehicleError
from vehicle.missions import TRACK, Leg, Mission, Task

Array = npt.NDArray[np.float64]
FINE_M = 0.1
RUN_OUT_M = 6.0  # room behind the measured part, so that braking is not measured


def straight(length_m: float, speed_mps: float, ground: str = "asphalt") -> Mission:
    """A straight path ahead."""
    return _mission(np.array([[0.0, 0.0], [0.0, length_m]]), speed_mps, ground)


def with_jump(program: CompiledPlan, at_m: float, offset_m: float) -> CompiledPlan:
    """The program of a straight path ahead, its part beyond `at_m` moved to the right by `offset_m`.

    Path 1 and path 2 of the step response: the lookahead point jumps across first, the controlled point later.
    """
    length = float(program.cumulative[-1])
    points = np.array([[0.0, 0.0], [0.0, at_m], [offset_m, at_m], [offset_m, length]])
    legs = program.legs.copy()
    legs["last_segment"] = 2
    return replace(program, points=points, cumulative=np.array([0.0, at_m, at_m, length]), legs=legs)


def wave(amplitude_m: float, omega: float, periods: float, speed_mps: float, ground: str) -> Mission:
    """P_y = A sin(omega P_x) (Eq. 3.1) over a number of periods, P_x ahead and P_y to the left."""
    if not (amplitude_m > 0 and omega > 0):
        raise VehicleError(f"A wave of {amplitude_m:g} m and {omega:g} per metre cannot be driven; use values above 0.")
    end = 2.0 * math.pi * periods / omega + RUN_OUT_M
    x = np.linspace(0.0, end, max(2, round(end / FINE_M)) + 1)
    return _mission(np.stack([-amplitude_m * np.sin(omega * x), x], axis=1), speed_mps, ground)


def _mission(points: Array, speed_mps: float, ground: str) -> Mission:
    return Mission((Leg(points, speed_mps, ground=ground, task=Task(TRACK)),))
