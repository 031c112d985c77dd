"""Open-loop error over horizons: one replay per run, anchored again for every stretch by a rigid fit in closed form."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from vehicle.measured.fit.heldout import half_of
from vehicle.measured.logs.record import Array
from vehicle.measured.replay.anchoring import anchor_pieces
from vehicle.measured.replay.course import DT_S, Stretch
from vehicle.measured.replay.replaying import Settings, replay, seen
from vehicle.measured.surprise.bench import Bench, Channel
from vehicle.measured.surprise.whitening import DRIFT_MEMORY_S, SOIL_MEMORY_S, Noise

HORIZONS_S = (1.0, 5.0, 10.0, 20.0)
FEWEST_ROWS = 4
Seen = tuple[Array, Array, Array, Array]
Squares = dict[float, Array]
Halves = tuple[Settings, Settings]
EDGE_S = 0.5  # pieces begin a row before or after their time


@dataclass(frozen=True)
class Error:
    """Root mean square of the error across and along the way (cm) and of the heading (deg; nan without one)."""

    cross_cm: float
    along_cm: float
    heading_deg: float


def anchored(stretch: Stretch, antenna: Array, heading: Array, rows: slice) -> Array:
    """Cross, along (m) and heading (rad) errors per row (k, 3) after the best turn and shift of the simulated piece."""
    return anchored_pieces(stretch, antenna, heading, [rows])[rows]


def anchored_pieces(stretch: Stretch, antenna: Array, heading: Array, parts: list[slice]) -> Array:
    """The errors of all pieces, in the rows of the stretch (k, 3); headings are nan where none was measured."""
    starts, ends = (np.array([getattr(one, edge) for one in parts], dtype=np.int64) for edge in ("start", "stop"))
    out = np.zeros((stretch.rows, 3))
    x, y = np.ascontiguousarray(antenna[:, 0]), np.ascontiguousarray(antenna[:, 1])
    anchor_pieces(starts, ends, stretch.east, stretch.north, stretch.heading, x, y, heading, out)
    if not stretch.heading_seen:
        out[:, 2] = np.nan
    return out


def pieces(time: Array, horizon: float) -> list[slice]:
    """Whole pieces of a horizon, one after another."""
    starts = np.arange(0.0, time[-1] - horizon + 1e-6, horizon)
    edges = np.searchsorted(time, np.append(starts, starts[-1] + horizon if len(starts) else 0.0) - 1e-9)
    return [slice(int(i), int(j)) for i, j in pairwise(edges) if j - i >= FEWEST_ROWS]


def chain(bench: Bench, stretch: Stretch, settings: Settings) -> Seen:
    """What the instruments would have shown had the commands been driven with these effects."""
    return seen(bench.rig, stretch, replay(bench.rig, stretch, settings, from_sensor=False, from_speed=False), settings)


def squares(stretch: Stretch, antenna: Array, heading: Array, half: int | None = None) -> Squares:
    """Sums of squares (cross, along, heading) and rows per horizon: (4,) each, of all pieces or of those of a half."""
    found = {}
    for horizon in HORIZONS_S:
        parts = pieces(stretch.time, horizon)
        if half is not None:
            starts = np.array([stretch.time[part.start] for part in parts])
            parts = [part for part, mine in zip(parts, half_of(starts + EDGE_S) == half, strict=True) if mine]
        errors = anchored_pieces(stretch, antenna, heading, parts)
        rows = sum(part.stop - part.start for part in parts)
        found[horizon] = np.array([*(errors * errors).sum(axis=0), rows]) if rows else np.zeros(4)
    return found


def run_squares(bench: Bench, settings: Mapping[int, Settings | Halves]) -> list[Squares]:
    """Sums of squares of every run; `settings` may differ from run to run, and between the halves of a run."""
    runs = len(bench.course.names)
    totals: list[Squares] = [{h: np.zeros(4) for h in HORIZONS_S} for _ in range(runs)]
    for stretch in bench.course.stretches:
        mine = settings[stretch.run]
        for half, one in enumerate(mine) if isinstance(mine, tuple) else ((None, mine),):
            antenna, heading, _, _ = chain(bench, stretch, one)
            for horizon, part in squares(stretch, antenna, heading, half).items():
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


def floor_squares(bench: Bench, settings: Mapping[int, Settings], seed: int = 7) -> list[Squares]:
    """Sums of squares that noise alone leaves: a replay of the model with the scatter seen in these logs.

    Wheel angle and speed scatter as they do while nothing changes, and as commands are off in time; the ground and the
    instruments have noise of the strength told from quick changes. What the model itself gets wrong has no part in it.
    """
    rng = np.random.default_rng(seed)
    runs = len(bench.course.names)
    totals: list[Squares] = [{h: np.zeros(4) for h in HORIZONS_S} for _ in range(runs)]
    for index, stretch in enumerate(bench.course.stretches):
        mine = settings[stretch.run]
        plain = chain(bench, stretch, mine)
        noisy = _noisy(bench, index, plain, mine, rng)
        for horizon, part in squares(noisy, plain[0], plain[1]).items():
            totals[stretch.run][horizon] += part
    return totals


def _noisy(bench: Bench, index: int, plain: Seen, settings: Settings, rng: np.random.Generator) -> Stretch:
    """The stretch as it might have been measured had the model been true."""
    stretch = bench.course.stretches[index]
    grid = np.arange(len(stretch.grids["speed"])) * DT_S
    grids = dict(stretch.grids)
    for name, simulated, channel in (
        ("wheel", plain[2], bench.wheel[index]), ("speed", plain[3], bench.speed[index])
    ):  # fmt: skip
        off = np.zeros(stretch.rows) if channel is None else channel.scatter * _remembered(rng, channel, stretch.rows)
        grids[name] = np.interp(grid, stretch.time, simulated + off)
    drawn = replace(stretch, grids=grids, wheel=plain[2])
    states = over_rough_ground(bench.noise, replay(bench.rig, drawn, settings, True, True), rng)
    return noisy_instruments(bench, stretch, states, settings, rng)[0]


def _remembered(rng: np.random.Generator, channel: Channel, rows: int) -> Array:
    """Unit noise with the memory of a channel from row to row."""
    return _coloured_by(rng, np.full(rows, channel.memory))


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
    """Unit noise with a memory (s), one value per step."""
    return _coloured_by(rng, np.exp(-dt / memory))


def _coloured_by(rng: np.random.Generator, keep: Array) -> Array:
    """Unit noise of which every value keeps a share of the one before."""
    white = rng.standard_normal(len(keep))
    out = np.empty(len(keep))
    out[0] = white[0]
    fresh = np.sqrt(1.0 - keep * keep) * white
    for i in range(1, len(keep)):
        out[i] = keep[i] * out[i - 1] + fresh[i]
    return out


def total_error(totals: list[Squares], floor: list[Squares], along: bool = True, horizon: float = 5.0) -> Array:
    """Error of every run as one number: squares over those of noise alone, averaged over the three kinds (runs,).

    Without `along` the error along the way has no part in it, as where speeds were only derived from positions.
    """
    scale = np.sum([one[horizon] for one in floor], axis=0)
    unit = scale[:3] / max(scale[3], 1.0)
    out = []
    for one in totals:
        rows = max(one[horizon][3], 1.0)
        shares = one[horizon][:3] / rows / np.maximum(unit, 1e-12)
        shares = shares if along else np.delete(shares, 1)
        out.append(float(np.nanmean(shares)) if np.isfinite(shares).any() else 0.0)
    return np.array(out)
