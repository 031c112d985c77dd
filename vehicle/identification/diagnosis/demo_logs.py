"""Demonstration logs: a short programme driven by this simulator with one hidden effect, drawn from a seed.

The simulator that diagnoses these logs also made them, with noise on ground and instruments. They show how a diagnosis
works, not how good it is: that is measured on an independent model of a tractor.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fields.arrays import Floats
from vehicle.identification.diagnosis.next_drive import PROGRAMME_PACE_MPS, ProgrammePieces, build_command_segment
from vehicle.identification.logs.reader import build_log
from vehicle.identification.logs.schema import Log
from vehicle.identification.logs.series import turn_path
from vehicle.identification.replay.drive_segments import DriveSegment, ReplayRig, build_rig
from vehicle.identification.replay.simulation import (
    ANGLE_COLUMN,
    FORWARD_COLUMN,
    X_COLUMN,
    Y_COLUMN,
    replay_segment,
    simulate_logged_values,
)
from vehicle.model.effect_kinds import EffectSample
from vehicle.model.effects import EFFECTS_BY_ID, get_effect, get_neutral_values
from vehicle.model.gnss import DRIFT_MEMORY_S, SOIL_MEMORY_S
from vehicle.model.tractor import Settings, Tractor
from vehicle.records import DT_S
from vehicle.twin.step_motion import TractorNoise

DEMO_NOISE = TractorNoise()
WHEEL_DIGIT_DEG = 0.1  # chosen: a usual digit of a sensor
DEMO_PLACE = (10.0, 5.0, 16.0)  # east, north, radius of a circle (m) that several runs of the programme cross


@dataclass(frozen=True)
class HiddenEffect:
    """The hidden effect and its values."""

    id: str
    values: dict[str, float]

    @property
    def description(self) -> str:
        """The effect as a verdict describes it."""
        return get_effect(self.id).describe(self.values)


def build_programme() -> tuple[tuple[str, float, ProgrammePieces], ...]:
    """Return name, first heading (deg from north) and pieces of every run: about nine minutes."""

    def build_turns(angles: Iterable[float], seconds: float) -> ProgrammePieces:
        return tuple((seconds, angle, 1.0, 0.0) for angle in angles)

    waves = (3.0 * 2.0 / math.pi * math.asin(math.sin(2 * math.pi * i * 0.2 / 15.0)) for i in range(int(45.0 / 0.2)))
    return (
        ("straight_east", 90.0, build_turns((0.0,), 40.0)),
        ("straight_west", 270.0, build_turns((0.0,), 40.0)),
        ("circles_right", 0.0, build_turns((6.0, 12.0, 20.0, 30.0), 12.0)),
        ("circles_left", 0.0, build_turns((-6.0, -12.0, -20.0, -30.0), 12.0)),
        ("steps", 45.0, build_turns((3.0, -3.0, 8.0, -8.0, 15.0, -15.0, 20.0, -20.0, 4.0, -10.0), 5.0)),
        ("small_steps", 200.0, build_turns((0.5, 0.0, -0.7, 0.3, 1.2, 0.0, -1.5, -0.6, 0.8, 2.0, 0.0, -2.0), 4.0)),
        ("waves", 300.0, build_turns(waves, 0.2)),
        ("implement", 0.0, tuple((10.0, 0.0, 1.0, float(i % 2)) for i in range(5))),
        ("speeds", 120.0, tuple((9.0, a, s, 0.0) for a in (9.0, -9.0) for s in (0.6, 1.3, 2.1))),
        ("fast_circles", 30.0, tuple((11.0, a, s, 0.0) for a in (18.0, -18.0) for s in (0.7, 2.1))),
        ("implement_weave", 160.0, tuple((7.0, a, 1.3, t) for t in (0.0, 1.0) for a in (0.0, 7.0, -7.0))),
    )


def draw_hidden_effect(seed: int, tractor: Tractor, name: str | None = None) -> HiddenEffect:
    """Draw an effect (or take the given one) with 0.9 to 1.4 times its usual size, to either side."""
    rng = np.random.default_rng(seed)
    drawn_id = str(rng.choice(sorted(EFFECTS_BY_ID)))
    entry = get_effect(name or drawn_id)
    draw = EffectSample(float(rng.uniform(0.9, 1.4)), entry.is_worse_when_less, DEMO_PLACE)
    return HiddenEffect(
        entry.id, entry.kind.sample_values(entry.params, get_neutral_values(entry.id, tractor.steering), draw, rng)
    )


def simulate_demo_logs(
    hidden: HiddenEffect | None, tractor: Tractor, ground: str, seed: int, rate_hz: float = 20.0
) -> list[Log]:
    """Simulate the logs of the programme with the hidden effect (or none), noise and rounding."""
    import pandas as pd

    rig, rng = build_rig(tractor, ground, (0.0, 0.0)), np.random.default_rng([seed, 1])
    settings: Settings = {} if hidden is None else {hidden.id: hidden.values}
    logs = []
    for name, bearing, pieces in build_programme():
        drive = build_command_segment(0, math.radians(90.0 - bearing), pieces, PROGRAMME_PACE_MPS, 1.0 / rate_hz)
        place = rng.uniform(-10.0, 10.0, 2)
        # Effects of a place use the measured pose, so the drive is simulated again and again, to learn where it goes.
        for number in range(4):
            states = replay_segment(rig, drive, settings, from_sensor=False, from_speed=False)
            path = states[:, [X_COLUMN, Y_COLUMN]]
            move = place - 0.5 * (path.max(axis=0) + path.min(axis=0)) if number == 0 else np.zeros(2)
            shown = {"east": path[:, 0] + move[0], "north": path[:, 1] + move[1], "heading": states[:, ANGLE_COLUMN]}
            grid = np.arange(len(states)) * DT_S
            poses: dict[str, Any] = {key: np.interp(drive.time, grid, values) for key, values in shown.items()}
            drive = replace(drive, grids=drive.grids | shown, **poses)
        assert drive.command is not None and drive.target is not None
        rough = add_soil_noise(DEMO_NOISE, states, rng)
        measured, wheel, speed = add_instrument_noise(rig, DEMO_NOISE, drive, rough, settings, rng)
        shuttle = np.where(drive.target < 0.0, -1, 1)
        speed = shuttle * (speed + DEMO_NOISE.speed_mps * rng.standard_normal(drive.rows))
        frame = pd.DataFrame(
            {
                "time_s": drive.time,
                "easting_m": np.round(measured.east, 3),
                "northing_m": np.round(measured.north, 3),
                "heading_deg": np.round(np.mod(90.0 - np.degrees(measured.heading), 360.0), 2),
                "speed_mps": np.round(np.maximum(speed, 0.0), 2),
                "speed_command_mps": np.abs(drive.target),
                "shuttle": shuttle,
                "steering_command_deg": np.round(np.degrees(drive.command), 3),
                "steering_deg": np.round(np.degrees(wheel) / WHEEL_DIGIT_DEG) * WHEEL_DIGIT_DEG,
                "implement": drive.working.astype(int),
            }
        )
        logs.append(build_log(frame, name))
    return logs


def add_instrument_noise(
    rig: ReplayRig,
    noise: TractorNoise,
    segment: DriveSegment,
    states: Floats,
    settings: Settings,
    rng: np.random.Generator,
) -> tuple[DriveSegment, Floats, Floats]:
    """Return the segment with noisy positions and headings of the states; wheel angle and speed have no noise."""
    antenna, heading, wheel, speed = simulate_logged_values(rig, segment, states, settings)
    dt = np.diff(segment.time, prepend=0.0)

    def draw_instrument_noise(white: float, drift: float) -> Floats:
        memory = np.exp(-dt / DRIFT_MEMORY_S)
        return white * rng.standard_normal(segment.rows) + drift * draw_coloured_noise(rng, memory)

    east = antenna[:, 0] + draw_instrument_noise(noise.position_m, noise.position_drift_m)
    north = antenna[:, 1] + draw_instrument_noise(noise.position_m, noise.position_drift_m)
    if segment.heading_measured:
        heading = heading + draw_instrument_noise(noise.heading_rad, noise.heading_drift_rad)
    return replace(segment, east=east, north=north, heading=heading), wheel, speed


def add_soil_noise(noise: TractorNoise, states: Floats, rng: np.random.Generator) -> Floats:
    """Return replayed states (n, 5) turned, step by step, by the disturbance of the soil."""
    pushes = noise.soil_per_m * draw_coloured_noise(rng, np.exp(-np.full(len(states), DT_S) / SOIL_MEMORY_S))
    extra = np.cumsum(pushes * np.abs(states[:, FORWARD_COLUMN]) * DT_S)
    out = states.copy()
    out[:, [X_COLUMN, Y_COLUMN]] = turn_path(states[:, [X_COLUMN, Y_COLUMN]], extra)
    out[:, ANGLE_COLUMN] += extra
    return out


def draw_coloured_noise(rng: np.random.Generator, memory: Floats) -> Floats:
    """Draw unit noise (n,) in which every value keeps a share (n,) of the one before."""
    white = rng.standard_normal(len(memory))
    out = np.empty(len(memory))
    out[0] = white[0]
    innovations = np.sqrt(1.0 - memory * memory) * white
    for i in range(1, len(memory)):
        out[i] = memory[i] * out[i - 1] + innovations[i]
    return out
