"""Open-loop error over horizons: one replay per run, anchored again for every stretch by a rigid fit in closed form."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from vehicle.measured.bench import Bench
from vehicle.measured.course import DT_S, Stretch
from vehicle.measured.record import Array
from vehicle.measured.replay import Settings, replay, seen
from vehicle.measured.whitening import DRIFT_MEMORY_S, SOIL_MEMORY_S, Noise

HORIZONS_S = (1.0, 5.0, 10.0, 20.0)
HEADING_TRUST_RAD = 0.035
POSITION_TRUST_M = 0.01
FEWEST_ROWS = 4
Seen = tuple[Array, Array, Array, Array]
Squares = dict[float, Array]


@dataclass(frozen=True)
class Error:
    """Root mean square of the error across and along the way (cm) and of the heading (deg; nan without one)."""

    cross_cm: float
    along_cm: float
    heading_deg: float


def anchored(stretch: Stretch, antenna: Array, heading: Array, rows: slice) -> Array:
    """Cross, along (m) and heading (rad) errors per row after the best turn and shift of the simulated piece.

    Positions decide the turn; headings only where the tractor hardly moves.
    """
    p = np.stack([stretch.east[rows], stretch.north[rows]], axis=1)
    q = antenna[rows]
    p0, q0 = p.mean(axis=0), q.mean(axis=0)
    a, b = p - p0, q - q0
    turned = stretch.heading[rows] - heading[rows]
    weak = len(p) * (POSITION_TRUST_M / HEADING_TRUST_RAD) ** 2
    mean = math.atan2(float(np.sin(turned).mean()), float(np.cos(turned).mean()))
    sine = float(np.sum(b[:, 0] * a[:, 1] - b[:, 1] * a[:, 0])) + weak * math.sin(mean)
    cosine = float(np.sum(a * b)) + weak * math.cos(mean)
    angle = math.atan2(sine, cosine)
    c, s = math.cos(angle), math.sin(angle)
    off = a - np.stack([b[:, 0] * c - b[:, 1] * s, b[:, 0] * s + b[:, 1] * c], axis=1)
    way = stretch.heading[rows]
    along = off[:, 0] * np.cos(way) + off[:, 1] * np.sin(way)
    cross = off[:, 0] * np.sin(way) - off[:, 1] * np.cos(way)
    head = np.angle(np.exp(1j * (turned - angle))) if stretch.heading_seen else np.full(len(p), np.nan)
    return np.stack([cross, along, head], axis=1)


def pieces(time: Array, horizon: float) -> list[slice]:
    """Whole pieces of a horizon, one after another."""
    starts = np.arange(0.0, time[-1] - horizon + 1e-6, horizon)
    edges = np.searchsorted(time, np.append(starts, starts[-1] + horizon if len(starts) else 0.0) - 1e-9)
    return [slice(int(i), int(j)) for i, j in pairwise(edges) if j - i >= FEWEST_ROWS]


def chain(bench: Bench, stretch: Stretch, settings: Settings) -> Seen:
    """What the instruments would have shown had the commands been driven with these effects."""
    return seen(bench.rig, stretch, replay(bench.rig, stretch, settings, from_sensor=False, from_speed=False), settings)


def squares(stretch: Stretch, antenna: Array, heading: Array) -> Squares:
    """Sums of squares (cross, along, heading) and rows per horizon: (4,) each."""
    found = {}
    for horizon in HORIZONS_S:
        total = np.zeros(4)
        for rows in pieces(stretch.time, horizon):
            errors = anchored(stretch, antenna, heading, rows)
            total[:3] += (errors * errors).sum(axis=0)
            total[3] += len(errors)
        found[horizon] = total
    return found


def run_squares(bench: Bench, settings: Mapping[int, Settings]) -> list[Squares]:
    """Sums of squares of every run; `settings` may differ from run to run."""
    runs = len(bench.course.names)
    totals: list[Squares] = [{h: np.zeros(4) for h in HORIZONS_S} for _ in range(runs)]
    for stretch in bench.course.stretches:
        antenna, heading, _, _ = chain(bench, stretch, settings[stretch.run])
        for horizon, part in squares(stretch, antenna, heading).items():
            totals[stretch.run][horizon] += part
    return totals


def errors_of(totals: list[Squares]) -> dict[float, Error]:
    """Errors of all runs together; horizons that no run is long enough for are left out."""
    found = {}
    for horizon in HORIZONS_S:
        whole = np.sum([one[horizon] for one in totals], axis=0)
        if whole[3] > 0:
            cross, along, heading = np.sqrt(whole[:3] / whole[3])
            found[horizon] = Error(100.0 * float(cross), 100.0 * float(along), math.degrees(float(heading)))
    return found


def floor_squares(bench: Bench, settings: Settings, seed: int = 7) -> list[Squares]:
    """Sums of squares that noise alone leaves: a replay of the model with the scatter seen in these logs.

    Wheel angle and speed get what was left of them in the log, shifted in time by chance; the ground and the
    instruments get noise of the strength told from quick changes. Nothing that repeats with the drive survives this.
    """
    rng = np.random.default_rng(seed)
    runs = len(bench.course.names)
    totals: list[Squares] = [{h: np.zeros(4) for h in HORIZONS_S} for _ in range(runs)]
    for stretch in bench.course.stretches:
        plain = chain(bench, stretch, settings)
        noisy = _noisy(bench, stretch, plain, settings, rng)
        for horizon, part in squares(noisy, plain[0], plain[1]).items():
            totals[stretch.run][horizon] += part
    return totals


def _noisy(bench: Bench, stretch: Stretch, plain: Seen, settings: Settings, rng: np.random.Generator) -> Stretch:
    """The stretch as it might have been measured had the model been true."""
    grid = np.arange(len(stretch.grids["speed"])) * DT_S
    grids = dict(stretch.grids)
    for name, measured, simulated in (("wheel", stretch.wheel, plain[2]), ("speed", stretch.speed, plain[3])):
        left = np.zeros(stretch.rows) if measured is None else np.roll(measured - simulated, rng.integers(stretch.rows))
        grids[name] = np.interp(grid, stretch.time, simulated + left)
    drawn = replace(stretch, grids=grids, wheel=plain[2])
    states = over_rough_ground(bench.noise, replay(bench.rig, drawn, settings, True, True), rng)
    return noisy_instruments(bench, stretch, states, settings, rng)[0]


def noisy_instruments(
    bench: Bench, stretch: Stretch, states: Array, settings: Settings, rng: np.random.Generator
) -> tuple[Stretch, Array, Array]:
    """The stretch with positions and headings as noisy instruments show the states; wheel angle and speed without."""
    antenna, heading, wheel, speed = seen(bench.rig, stretch, states, settings)
    noise, dt = bench.noise, np.diff(stretch.time, prepend=0.0)

    def instrument(white: float, drift: float) -> Array:
        return white * rng.standard_normal(stretch.rows) + drift * _coloured(rng, dt, DRIFT_MEMORY_S)

    east = antenna[:, 0] + instrument(noise.position, noise.position_drift)
    north = antenna[:, 1] + instrument(noise.position, noise.position_drift)
    seen_heading = heading + (instrument(noise.heading, noise.heading_drift) if stretch.heading_seen else 0.0)
    return replace(stretch, east=east, north=north, heading=seen_heading), wheel, speed


def over_rough_ground(noise: Noise, states: Array, rng: np.random.Generator) -> Array:
    """Replayed states turned, step by step, by the disturbance of the soil."""
    pushes = noise.soil * _coloured(rng, np.full(len(states), DT_S), SOIL_MEMORY_S)
    extra = np.cumsum(pushes * np.abs(states[:, 4]) * DT_S)
    out = states.copy()
    dx, dy = np.diff(states[:, 0]), np.diff(states[:, 1])
    c, s = np.cos(extra[:-1]), np.sin(extra[:-1])
    out[1:, 0] = states[0, 0] + np.cumsum(dx * c - dy * s)
    out[1:, 1] = states[0, 1] + np.cumsum(dx * s + dy * c)
    out[:, 2] += extra
    return out


def _coloured(rng: np.random.Generator, dt: Array, memory: float) -> Array:
    """Unit noise with a memory, one value per step."""
    white = rng.standard_normal(len(dt))
    keep = np.exp(-dt / memory)
    out = np.empty(len(dt))
    out[0] = white[0]
    fresh = np.sqrt(1.0 - keep * keep) * white
    for i in range(1, len(dt)):
        out[i] = keep[i] * out[i - 1] + fresh[i]
    return out


def total_error(totals: list[Squares], floor: list[Squares], horizon: float = 5.0) -> Array:
    """Error of every run as one number: squares over those of noise alone, averaged over the three kinds (runs,)."""
    scale = np.sum([one[horizon] for one in floor], axis=0)
    unit = scale[:3] / max(scale[3], 1.0)
    out = []
    for one in totals:
        rows = max(one[horizon][3], 1.0)
        shares = one[horizon][:3] / rows / np.maximum(unit, 1e-12)
        out.append(float(np.nanmean(shares)) if np.isfinite(shares).any() else 0.0)
    return np.array(out)
