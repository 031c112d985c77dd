"""Section 5.3: a virtual tractor kept to another one over a link, its frames late and sparse.

The master drives the path of Fig. 5.4 on its own: a long straight, a corner to the left, a long straight. The slave, a
twin, gets the frames the master sends: its commands, and where it is.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vehicle.missions import TRACK, Leg, Mission, Task
from vehicle.tractor import Implement, Tractor
from vehicle.twin.motion import Noise
from vehicle.twin.stepper import Stepper, StepperState
from vehicle.twin.twin import Fix, Twin

Array = npt.NDArray[np.float64]
# Fig. 5.4 has no scale. Of these lengths only the time of the corner is told, 60 to 80 s at 4 km/h (Fig. 5.7).
FIRST_M, RADIUS_M, SECOND_M = 67.0, 10.0, 50.0
BEYOND_M = 5.0
MASTER_HZ = 30  # divides the rates of the links below and their ages


@dataclass(frozen=True, eq=False)
class Drive:
    """What a master did: the truth (t, 4) of time, antenna and heading, and what it showed at the same times."""

    truth: Array
    shown: tuple[StepperState, ...]


@dataclass(frozen=True, eq=False)
class Apart:
    """Twin less master at even times (t,): distance (m), heading (rad), and across the master's path (m).

    `track` (t, 2) is where the twin was.
    """

    time_s: Array
    distance_m: Array
    heading_rad: Array
    across_m: Array
    track: Array


def corner(speed_mps: float, ground: str = "soil", share: float = 1.0) -> Mission:
    """The path of Fig. 5.4: long straight, corner to the left, long straight; `share` shortens the straights."""
    angles = np.linspace(0.0, 0.5 * math.pi, 31)
    arc = np.stack([RADIUS_M * (np.cos(angles) - 1.0), share * FIRST_M + RADIUS_M * np.sin(angles)], axis=1)
    end = arc[-1] - [share * SECOND_M, 0.0]
    points = np.concatenate([[[0.0, 0.0]], arc, [end]])
    return Mission((Leg(points, speed_mps, ground=ground, task=Task(TRACK)),))


def drive_master(
    tractor: Tractor, speed_mps: float, *, hidden: Mapping[str, float] | None = None, noise: Noise | None = None,
    seed: int = 1, share: float = 1.0,
) -> Drive:  # fmt: skip
    """Drive the path from a stand to its end; what it shows has the noise, `share` is that of `corner`."""
    master = Stepper(corner(speed_mps, share=share), tractor, Implement(), hidden=hidden, noise=noise, seed=seed)
    master.released = 1
    truth, shown = [], []
    step = 0
    while not master.state.done:
        master.advance(step / MASTER_HZ)
        real = master.truth
        truth.append((real.time_s, real.x_m, real.y_m, real.heading_rad))
        shown.append(master.state)
        step += 1
    return Drive(np.array(truth), tuple(shown))


def couple(
    drive: Drive, tractor: Tractor, way: str, *, rate_hz: float, age_s: float, noise: Noise | None = None,
    look_hz: int = 10, poses: bool = True,
) -> tuple[Apart, Twin]:  # fmt: skip
    """Let a twin of a tractor follow a drive by frames of a rate that come in so late; the twin is handed back too.

    The two are compared `look_hz` times a second. Without `poses` the twin is told commands alone.
    """
    first = drive.shown[0]
    twin = Twin(tractor, Implement(), _fix(first, 0.0), way=way, noise=noise)
    frames = list(drive.shown[:: round(MASTER_HZ / rate_hz)])
    rows = []
    looks = drive.truth[:: MASTER_HZ // look_hz]
    for real in looks:
        while frames and frames[0].time_s + age_s <= real[0] + 1e-9:
            _come_in(twin, frames.pop(0), age_s, poses)
        now = twin.advance(float(real[0]))
        rows.append((now.x_m, now.y_m, now.heading_rad))
    return _apart(drive, looks, np.array(rows)), twin


def _fix(shown: StepperState, age_s: float) -> Fix:
    return Fix(shown.time_s, shown.x_m, shown.y_m, shown.heading_rad, shown.speed_mps, shown.time_s + age_s)


def _come_in(twin: Twin, frame: StepperState, age_s: float, poses: bool) -> None:
    fix = _fix(frame, age_s)
    twin.advance(fix.arrived_s)
    twin.command(frame.time_s, frame.steering_command_rad, frame.speed_command_mps, frame.implement)
    if poses:
        twin.measured(fix)


def _apart(drive: Drive, real: Array, twin: Array) -> Apart:
    from shapely import LineString, distance, points

    line = np.concatenate([drive.truth[:: MASTER_HZ // 10, 1:3], _beyond(drive.truth)])
    turned = twin[:, 2] - real[:, 3]
    return Apart(
        real[:, 0], np.hypot(*(twin[:, :2] - real[:, 1:3]).T), np.arctan2(np.sin(turned), np.cos(turned)),
        np.asarray(distance(points(twin[:, :2]), LineString(line))), twin[:, :2],
    )  # fmt: skip


def _beyond(truth: Array) -> Array:
    """A point (1, 2) straight on from the end: a twin that stops later than its master is not beside its path."""
    _, x, y, angle = truth[-1]
    return np.array([[x + BEYOND_M * math.cos(angle), y + BEYOND_M * math.sin(angle)]])
