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
MASTER_HZ = 30  # divides the rates of the links below and their ages


@dataclass(frozen=True, eq=False)
class Drive:
    """What a master did: the truth (t, 4) of time, antenna and heading, and what it showed at the same times."""

    truth: Array
    shown: tuple[StepperState, ...]


@dataclass(frozen=True, eq=False)
class Apart:
    """Twin less master, ten times a second: time (t,), distance (m), heading (rad), and across the master's path (m).

    `at_corrections` (k, 2) are distance (m) and heading (rad) between the twin and each fix as it came in: what the
    thesis could record. `track` (t, 2) is where the twin was.
    """

    time_s: Array
    distance_m: Array
    heading_rad: Array
    across_m: Array
    at_corrections: Array
    track: Array


def corner(speed_mps: float, ground: str = "soil") -> Mission:
    """The path of Fig. 5.4: long straight, corner to the left, long straight."""
    angles = np.linspace(0.0, 0.5 * math.pi, 31)
    arc = np.stack([RADIUS_M * (np.cos(angles) - 1.0), FIRST_M + RADIUS_M * np.sin(angles)], axis=1)
    end = arc[-1] - [SECOND_M, 0.0]
    points = np.concatenate([[[0.0, 0.0]], arc, [end]])
    return Mission((Leg(points, speed_mps, ground=ground, task=Task(TRACK)),))


def drive_master(
    tractor: Tractor, speed_mps: float, *, hidden: Mapping[str, float] | None = None, noise: Noise | None = None,
    seed: int = 1,
) -> Drive:  # fmt: skip
    """Drive the path from a stand to its end; what it shows has the noise."""
    master = Stepper(corner(speed_mps), tractor, Implement(), hidden=hidden, noise=noise, seed=seed)
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
    drive: Drive, tractor: Tractor, way: str, *, rate_hz: float, age_s: float, noise: Noise | None = None
) -> tuple[Apart, Twin]:
    """Let a twin of a tractor follow a drive by frames of a rate that come in so late; the twin is handed back too."""
    first = drive.shown[0]
    twin = Twin(tractor, Implement(), _fix(first, 0.0), way=way, noise=noise)
    frames = list(drive.shown[:: round(MASTER_HZ / rate_hz)])
    rows, corrections = [], []
    for real in drive.truth[:: MASTER_HZ // 10]:
        while frames and frames[0].time_s + age_s <= real[0] + 1e-9:
            frame = frames.pop(0)
            corrections.append(_come_in(twin, frame, age_s))
        now = twin.advance(float(real[0]))
        rows.append((now.x_m, now.y_m, now.heading_rad))
    return _apart(drive, np.array(rows), np.array(corrections)), twin


def _fix(shown: StepperState, age_s: float) -> Fix:
    return Fix(shown.time_s, shown.x_m, shown.y_m, shown.heading_rad, shown.speed_mps, shown.time_s + age_s)


def _come_in(twin: Twin, frame: StepperState, age_s: float) -> tuple[float, float]:
    """Hand a frame to the twin; how far the twin was from it when it came in (m, rad)."""
    fix = _fix(frame, age_s)
    before = twin.advance(fix.arrived_s)
    twin.command(frame.time_s, frame.steering_command_rad, frame.speed_command_mps, frame.implement)
    twin.measured(fix)
    turned = math.remainder(before.heading_rad - fix.heading_rad, 2.0 * math.pi)
    return math.hypot(before.x_m - fix.x_m, before.y_m - fix.y_m), turned


def _apart(drive: Drive, twin: Array, corrections: Array) -> Apart:
    from shapely import LineString, distance, points

    real = drive.truth[:: MASTER_HZ // 10]
    turned = twin[:, 2] - real[:, 3]
    across = np.asarray(distance(points(twin[:, :2]), LineString(drive.truth[:: MASTER_HZ // 10, 1:3])))
    return Apart(
        real[:, 0], np.hypot(*(twin[:, :2] - real[:, 1:3]).T), np.arctan2(np.sin(turned), np.cos(turned)), across,
        corrections, twin[:, :2],
    )  # fmt: skip
