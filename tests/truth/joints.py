"""Vehicles that turn in three ways, by kinematics alone: front wheels, rear wheels, or a joint in the middle.

Rolling without slip. A vehicle with one steered axle turns about its other, fixed axle: yaw rate v tan(angle) / base,
with no sideways motion at the fixed axle (for example Rajamani, Vehicle Dynamics and Control, section 2.2, with the
fixed axle in the place of the rear one). A jointed vehicle of lengths f and r from its joint to its front and its rear
axle turns its front unit by (v sin(angle) + r * rate) / (f cos(angle) + r), where v is the speed of its front axle and
rate that of the joint, and its rear unit by that minus the rate (Corke and Ridley, Steering kinematics for a
center-articulated mobile robot, IEEE Trans. Robotics and Automation 17(2), 2001).

Angles follow their commands late, at a limited rate, with a lag of first order. Imports nothing of the project it
tests.
"""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pandas as pd

from tests.truth.drives import Drive
from tests.truth.recorder import build_log, read_switches

Array = npt.NDArray[np.float64]
FRONT, REAR, JOINT = "front", "rear", "joint"
STEP_S, ROW_S = 0.02, 0.1
LATE_S, RATE_DEG_PER_S, LAG_S, SPEED_LAG_S = 0.15, 16.0, 0.15, 0.5
POSITION_M, HEADING_DEG, ANGLE_DEG, SPEED_MPS = 0.012, 0.25, 0.15, 0.03


@dataclass(frozen=True)
class Jointed:
    """A vehicle: how it turns, its wheelbase, where its antenna is (m ahead of its rear axle when straight).

    `front_share` is the part of the base before the joint; the antenna of a jointed vehicle is on its front unit, or
    on its rear one (`on_rear_unit`).
    """

    turns_by: str
    base_m: float
    antenna_m: float
    front_share: float = 0.5
    on_rear_unit: bool = False

    def find_pose(self, front: tuple[float, float, float], angle: float) -> tuple[float, float, float]:
        """East, north and heading of the antenna from those of the front axle and the angle (rad)."""
        east, north, heading = front
        ahead = self.antenna_m - self.base_m
        if self.on_rear_unit:
            part = self.front_share * self.base_m
            east, north = east - part * math.sin(heading), north - part * math.cos(heading)
            heading, ahead = heading - angle, ahead + part
        return east + ahead * math.sin(heading), north + ahead * math.cos(heading), heading

    def derive_pose(self, heading: float, angle: float, rate: float, speed: float) -> tuple[float, float, float]:
        """East, north (m/s) and turn (rad/s) of the front axle of a vehicle of this speed at its driven axle."""
        if self.turns_by == FRONT:
            turn = speed * math.tan(angle) / self.base_m
            aside = turn * self.base_m
        elif self.turns_by == REAR:
            turn, aside = speed * math.tan(angle) / self.base_m, 0.0
        else:
            part, rest = self.front_share * self.base_m, (1.0 - self.front_share) * self.base_m
            turn, aside = (speed * math.sin(angle) + rest * rate) / (part * math.cos(angle) + rest), 0.0
        return (
            speed * math.sin(heading) + aside * math.cos(heading),
            speed * math.cos(heading) - aside * math.sin(heading),
            turn,
        )


def drive_jointed(vehicle: Jointed, drive: Drive, seed: int, sensed: bool = True) -> pd.DataFrame:
    """The drive as a log in the columns of the contract; without a wheel angle unless it is `sensed`."""
    rng = np.random.default_rng([seed, 51])
    time = np.arange(0.0, drive.duration_s, STEP_S)
    commands, targets = drive.steering(time), drive.speed(time) * drive.shuttle(time)
    late = round(LATE_S / STEP_S)
    bearing = rng.uniform(0.0, 2.0 * math.pi) if drive.bearing_deg is None else math.radians(drive.bearing_deg)
    front, angle, speed = (0.0, 0.0, bearing), float(commands[0]), float(targets[0])
    rows = np.zeros((len(time), 5))
    for step in range(len(time)):
        rows[step] = *vehicle.find_pose(front, math.radians(angle)), angle, speed
        gap = float(commands[max(step - late, 0)]) - angle
        rate = min(max(gap / LAG_S, -RATE_DEG_PER_S), RATE_DEG_PER_S)
        speed += (float(targets[step]) - speed) * STEP_S / SPEED_LAG_S
        # The middle of a step, where headings and angles hardly differ from their means.
        heading, middle = front[2], math.radians(angle + 0.5 * STEP_S * rate)
        turn = vehicle.derive_pose(heading, middle, math.radians(rate), speed)[2]
        moved = vehicle.derive_pose(heading + 0.5 * STEP_S * turn, middle, math.radians(rate), speed)
        front = front[0] + STEP_S * moved[0], front[1] + STEP_S * moved[1], heading + STEP_S * turn
        angle += STEP_S * rate
    return _measure(rows[:: round(ROW_S / STEP_S)], time[:: round(ROW_S / STEP_S)], drive, rng, sensed)


def _measure(rows: Array, time: Array, drive: Drive, rng: np.random.Generator, sensed: bool) -> pd.DataFrame:
    """Rows (k, 5) of pose (m, m, rad), angle (deg) and speed as instruments show them."""
    noise = rng.standard_normal((5, len(time)))
    columns = {
        "time_s": time,
        "easting_m": np.round(rows[:, 0] + POSITION_M * noise[0], 3),
        "northing_m": np.round(rows[:, 1] + POSITION_M * noise[1], 3),
        "heading_deg": np.round(np.mod(np.degrees(rows[:, 2]) + HEADING_DEG * noise[2], 360.0), 2),
        "speed_mps": np.round(np.maximum(np.abs(rows[:, 4]) + SPEED_MPS * noise[4], 0.0), 3),
        "steering_command_deg": np.round(drive.steering(time), 2),
    }
    wheel = {"steering_deg": np.round(rows[:, 3] + ANGLE_DEG * noise[3], 2)} if sensed else {}
    return build_log(drive.name, columns | wheel | read_switches(drive, time))
