"""Noise drawn on simulated drives: soil that pushes a tractor about, and receivers that scatter."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from vehicle.identification.logs.schema import Array
from vehicle.identification.replay.drive_segments import DriveSegment
from vehicle.identification.replay.rig import (
    ANGLE_COLUMN,
    FORWARD_COLUMN,
    X_COLUMN,
    Y_COLUMN,
    ReplayRig,
    simulate_logged_values,
)
from vehicle.model.tractor import Settings
from vehicle.records import DT_S

# Chosen, s: how long a receiver drifts to one side, and a patch of soil pushes.
SOIL_MEMORY_S, DRIFT_MEMORY_S = 0.5, 60.0  # a rut or a clod at walking pace; drift of satellite positions


@dataclass(frozen=True)
class NoiseLevels:
    """Standard deviations: white position and heading, their slow drifts, yaw disturbance of the soil, speed.

    Position in m, heading in rad, soil in rad per m driven, along in m per root second.
    """

    position: float
    position_drift: float
    heading: float
    heading_drift: float
    soil: float
    along: float


def add_instrument_noise(
    rig: ReplayRig,
    noise: NoiseLevels,
    segment: DriveSegment,
    states: Array,
    settings: Settings,
    rng: np.random.Generator,
) -> tuple[DriveSegment, Array, Array]:
    """Return the segment with noisy positions and headings of the states; wheel angle and speed have no noise."""
    antenna, heading, wheel, speed = simulate_logged_values(rig, segment, states, settings)
    dt = np.diff(segment.time, prepend=0.0)

    def draw_instrument_noise(white: float, drift: float) -> Array:
        return white * rng.standard_normal(segment.rows) + drift * draw_coloured_noise(
            rng, np.exp(-dt / DRIFT_MEMORY_S)
        )

    east = antenna[:, 0] + draw_instrument_noise(noise.position, noise.position_drift)
    north = antenna[:, 1] + draw_instrument_noise(noise.position, noise.position_drift)
    noisy_heading = heading + (
        draw_instrument_noise(noise.heading, noise.heading_drift) if segment.heading_measured else 0.0
    )
    return replace(segment, east=east, north=north, heading=noisy_heading), wheel, speed


def add_soil_noise(
    noise: NoiseLevels, states: Array, rng: np.random.Generator, other_turns: Array | float = 0.0
) -> Array:
    """Return replayed states (n, 5) turned, step by step, by the disturbance of the soil; and by other turns (n,), rad
    since the start."""
    pushes = noise.soil * draw_coloured_noise(rng, np.exp(-np.full(len(states), DT_S) / SOIL_MEMORY_S))
    extra = np.cumsum(pushes * np.abs(states[:, FORWARD_COLUMN]) * DT_S) + other_turns
    out = states.copy()
    dx, dy = np.diff(states[:, X_COLUMN]), np.diff(states[:, Y_COLUMN])
    c, s = np.cos(extra[:-1]), np.sin(extra[:-1])
    out[1:, X_COLUMN] = states[0, X_COLUMN] + np.cumsum(dx * c - dy * s)
    out[1:, Y_COLUMN] = states[0, Y_COLUMN] + np.cumsum(dx * s + dy * c)
    out[:, ANGLE_COLUMN] += extra
    return out


def draw_coloured_noise(rng: np.random.Generator, memory: Array) -> Array:
    """Draw unit noise (n,) in which every value keeps a share (n,) of the one before."""
    white = rng.standard_normal(len(memory))
    out = np.empty(len(memory))
    out[0] = white[0]
    innovations = np.sqrt(1.0 - memory * memory) * white
    for i in range(1, len(memory)):
        out[i] = memory[i] * out[i - 1] + innovations[i]
    return out
