"""Noise drawn as the filter of surprises believes in it: soil under a replay, and receivers that show it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vehicle.layout import DT_S
from vehicle.learnt import Settings
from vehicle.measured.logs.record import Array
from vehicle.measured.replay.course import Stretch
from vehicle.measured.replay.replaying import Rig, seen
from vehicle.measured.replay.states import ANGLE, FORWARD, X, Y
from vehicle.measured.surprise.whitening import DRIFT_MEMORY_S, SOIL_MEMORY_S, Noise


def noisy_instruments(
    rig: Rig, noise: Noise, stretch: Stretch, states: Array, settings: Settings, rng: np.random.Generator
) -> tuple[Stretch, Array, Array]:
    """The stretch with positions and headings as noisy instruments show the states; wheel angle and speed without."""
    antenna, heading, wheel, speed = seen(rig, stretch, states, settings)
    dt = np.diff(stretch.time, prepend=0.0)

    def instrument(white: float, drift: float) -> Array:
        return white * rng.standard_normal(stretch.rows) + drift * coloured(rng, np.exp(-dt / DRIFT_MEMORY_S))

    east = antenna[:, 0] + instrument(noise.position, noise.position_drift)
    north = antenna[:, 1] + instrument(noise.position, noise.position_drift)
    seen_heading = heading + (instrument(noise.heading, noise.heading_drift) if stretch.heading_seen else 0.0)
    return replace(stretch, east=east, north=north, heading=seen_heading), wheel, speed


def over_rough_ground(noise: Noise, states: Array, rng: np.random.Generator) -> Array:
    """Replayed states (n, 5) turned, step by step, by the disturbance of the soil."""
    pushes = noise.soil * coloured(rng, np.exp(-np.full(len(states), DT_S) / SOIL_MEMORY_S))
    extra = np.cumsum(pushes * np.abs(states[:, FORWARD]) * DT_S)
    out = states.copy()
    dx, dy = np.diff(states[:, X]), np.diff(states[:, Y])
    c, s = np.cos(extra[:-1]), np.sin(extra[:-1])
    out[1:, X] = states[0, X] + np.cumsum(dx * c - dy * s)
    out[1:, Y] = states[0, Y] + np.cumsum(dx * s + dy * c)
    out[:, ANGLE] += extra
    return out


def coloured(rng: np.random.Generator, keep: Array) -> Array:
    """Unit noise (n,) of which every value keeps a share (n,) of the one before."""
    white = rng.standard_normal(len(keep))
    out = np.empty(len(keep))
    out[0] = white[0]
    fresh = np.sqrt(1.0 - keep * keep) * white
    for i in range(1, len(keep)):
        out[i] = keep[i] * out[i - 1] + fresh[i]
    return out
