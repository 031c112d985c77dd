"""Logs made to show the idea: a short programme driven by this simulator with one effect hidden, drawn from a seed.

These logs come from the simulator that then diagnoses them, with noise on ground and instruments. They show how a
diagnosis works, not how good it is: that is measured on an independent model of a tractor.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from vehicle.effects import BY_ID, effect, neutral
from vehicle.kinds import Draw
from vehicle.layout import DT_S
from vehicle.learnt import Settings
from vehicle.measured.logs.reading import log_from_frame
from vehicle.measured.logs.record import Array, Log
from vehicle.measured.replay.course import Stretch
from vehicle.measured.replay.drives import PACE_MPS, Pieces, blank
from vehicle.measured.replay.replaying import Rig, make_rig, replay
from vehicle.measured.replay.states import ANGLE, X, Y
from vehicle.measured.surprise.draws import noisy_instruments, over_rough_ground
from vehicle.measured.surprise.whitening import Noise
from vehicle.tractor import Tractor

NOISE = Noise(0.010, 0.015, 0.002, 0.0017, 0.0025, 0.006)  # chosen: RTK with two antennas, ordinary soil
WHEEL_DIGIT_DEG, SPEED_NOISE_MPS = 0.1, 0.02  # chosen: usual digits and noise of sensors
PLACE = (10.0, 5.0, 16.0)  # east, north, radius of a circle (m) that several runs of the programme cross


@dataclass(frozen=True)
class Hidden:
    """What was hidden: the effect and its values."""

    id: str
    values: dict[str, float]

    @property
    def words(self) -> str:
        """The effect in the words of a verdict."""
        return effect(self.id).words(self.values)


def _waves(size: float, seconds: float, step: float) -> Pieces:
    steps = int(seconds / step)
    return tuple((step, size * 2.0 / math.pi * math.asin(math.sin(2 * math.pi * i * step / 15.0)), 1.0, 0.0)
                 for i in range(steps))  # fmt: skip


def programme() -> tuple[tuple[str, float, Pieces], ...]:
    """Name, first heading (deg from north) and pieces of every run: about nine minutes."""

    def turns(angles: tuple[float, ...], seconds: float, pace: float = 1.0, tool: float = 0.0) -> Pieces:
        return tuple((seconds, angle, pace, tool) for angle in angles)

    return (
        ("straight_east", 90.0, turns((0.0,), 40.0)),
        ("straight_west", 270.0, turns((0.0,), 40.0)),
        ("circles_right", 0.0, turns((6.0, 12.0, 20.0, 30.0), 12.0)),
        ("circles_left", 0.0, turns((-6.0, -12.0, -20.0, -30.0), 12.0)),
        ("steps", 45.0, turns((3.0, -3.0, 8.0, -8.0, 15.0, -15.0, 20.0, -20.0, 4.0, -10.0), 5.0)),
        ("small_steps", 200.0, turns((0.5, 0.0, -0.7, 0.3, 1.2, 0.0, -1.5, -0.6, 0.8, 2.0, 0.0, -2.0), 4.0)),
        ("waves", 300.0, _waves(3.0, 45.0, 0.2)),
        ("implement", 0.0, tuple((10.0, 0.0, 1.0, float(i % 2)) for i in range(5))),
        ("speeds", 120.0, tuple((9.0, a, s, 0.0) for a in (9.0, -9.0) for s in (0.6, 1.3, 2.1))),
        ("fast_circles", 30.0, tuple((11.0, a, s, 0.0) for a in (18.0, -18.0) for s in (0.7, 2.1))),
        ("implement_weave", 160.0, tuple((7.0, a, 1.3, t) for t in (0.0, 1.0) for a in (0.0, 7.0, -7.0))),
    )


def draw_hidden(seed: int, tractor: Tractor, name: str | None = None) -> Hidden:
    """An effect drawn at random (or the one given), with a value of 0.9 to 1.4 times its usual size, either way."""
    rng = np.random.default_rng(seed)
    drawn = str(rng.choice(sorted(BY_ID)))
    entry = effect(name or drawn)
    draw = Draw(float(rng.uniform(0.9, 1.4)), entry.worse_when_less, PLACE)
    return Hidden(entry.id, entry.kind.drawn(entry.params, neutral(entry.id, tractor.steering), draw, rng))


def demo_logs(hidden: Hidden | None, tractor: Tractor, ground: str, seed: int, rate_hz: float = 20.0) -> list[Log]:
    """Logs of the programme with the hidden effect (or none), noise and rounding."""
    rig = make_rig(tractor, ground, (0.0, 0.0))
    settings: Settings = {} if hidden is None else {hidden.id: hidden.values}
    rng = np.random.default_rng([seed, 1])
    return [_log(rig, name, bearing, pieces, settings, rng, rate_hz) for name, bearing, pieces in programme()]


def _log(
    rig: Rig, name: str, bearing: float, pieces: Pieces, settings: Settings, rng: np.random.Generator, rate_hz: float
) -> Log:
    import pandas as pd

    drive = blank(0, math.radians(90.0 - bearing), pieces, PACE_MPS, 1.0 / rate_hz)
    place = rng.uniform(-10.0, 10.0, 2)
    # Effects that belong to a place look at the measured pose, so the drive is made twice: to learn where it goes.
    states = replay(rig, drive, settings, from_sensor=False, from_speed=False)
    path = states[:, [X, Y]]
    drive = _placed(drive, states, place - 0.5 * (path.max(axis=0) + path.min(axis=0)))
    for _ in range(3):
        states = replay(rig, drive, settings, from_sensor=False, from_speed=False)
        drive = _placed(drive, states, np.zeros(2))
    rough = over_rough_ground(NOISE, states, rng)
    measured, wheel, speed = noisy_instruments(rig, NOISE, drive, rough, settings, rng)
    frame = pd.DataFrame({
        "time_s": drive.time, "easting_m": np.round(measured.east, 3), "northing_m": np.round(measured.north, 3),
        "heading_deg": np.round(np.mod(90.0 - np.degrees(measured.heading), 360.0), 2),
        "speed_mps": np.round(np.maximum(speed + SPEED_NOISE_MPS * rng.standard_normal(drive.rows), 0.0), 2),
        "speed_command_mps": drive.target, "steering_command_deg": np.round(np.degrees(_known(drive.command)), 3),
        "steering_deg": np.round(np.degrees(wheel) / WHEEL_DIGIT_DEG) * WHEEL_DIGIT_DEG,
        "implement": drive.working.astype(int),
    })  # fmt: skip
    return log_from_frame(frame, name)


def _known(values: Array | None) -> Array:
    assert values is not None
    return values


def _placed(drive: Stretch, states: Array, shift: Array) -> Stretch:
    grid = np.arange(len(states)) * DT_S
    x, y = states[:, X] + shift[0], states[:, Y] + shift[1]
    grids = dict(drive.grids) | {"east": x, "north": y, "heading": states[:, ANGLE]}
    return replace(
        drive, grids=grids, east=np.interp(drive.time, grid, x), north=np.interp(drive.time, grid, y),
        heading=np.interp(drive.time, grid, states[:, ANGLE]),
    )  # fmt: skip
