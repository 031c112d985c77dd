"""The noise floor: the error that a true model would still have in these logs.

Noise is drawn from the model of the Kalman filter: soil under a replay, and receivers that observe it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from vehicle.identification.logs.schema import Array
from vehicle.identification.replay.drive_segments import DriveSegment
from vehicle.identification.replay.horizon_errors import (
    HorizonSquares,
    InstrumentColumns,
    make_zero_squared_errors,
    simulate_instruments,
    sum_squared_errors_by_horizon,
)
from vehicle.identification.replay.rig import ReplayRig, replay_segment, simulate_logged_values
from vehicle.identification.replay.state_cache import ANGLE_COLUMN, FORWARD_COLUMN, X_COLUMN, Y_COLUMN
from vehicle.identification.residuals.innovations import (
    DRIFT_MEMORY_S,
    SOIL_MEMORY_S,
    NoiseLevels,
    simulate_segment_increments,
)
from vehicle.identification.residuals.residual_model import ResidualModel
from vehicle.identification.residuals.unknown_turns import COMMAND_FIRST, estimate_unknown_turns
from vehicle.model.tractor import Settings
from vehicle.records import DT_S

_SAME_GAP_SHARE = 1e-9  # of a variance per second: rows of one gap differ by rounding alone


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


def compute_noise_floor(
    residual_model: ResidualModel, settings: Mapping[int, Settings], seed: int = 7, tolerated: Settings | None = None
) -> list[HorizonSquares]:
    """Return the sums of squares that noise alone leaves: a replay of the model with the scatter of these logs.

    Wheel angle and speed scatter as they do in steady driving, and as commands are off in time; ground and instruments
    have noise of the strength estimated from quick changes. Errors of the model have no part in it, except `tolerated`
    effects of the speed, by which drive lines differ.
    """
    rng = np.random.default_rng(seed)
    unknown_turns = _estimate_unknown_turns(residual_model, settings)
    totals = make_zero_squared_errors(len(residual_model.dataset.names))
    for index, segment in enumerate(residual_model.dataset.segments):
        run_settings = settings[segment.run]
        base_columns = simulate_instruments(residual_model.rig, segment, run_settings)
        simulated_columns = (
            simulate_instruments(residual_model.rig, segment, {**(tolerated or {}), **run_settings})
            if tolerated
            else base_columns
        )
        noisy = _simulate_noisy_segment(
            residual_model, index, simulated_columns, run_settings, rng, unknown_turns[index]
        )
        for horizon, part in sum_squared_errors_by_horizon(noisy, base_columns[0], base_columns[1]).items():
            totals[segment.run][horizon] += part
    return totals


def _simulate_noisy_segment(
    residual_model: ResidualModel,
    index: int,
    simulated_columns: InstrumentColumns,
    settings: Settings,
    rng: np.random.Generator,
    turn_variances: Array,
) -> DriveSegment:
    """Return the segment as it might have been measured had the model been true."""
    segment = residual_model.dataset.segments[index]
    grid = np.arange(len(segment.grids["speed"])) * DT_S
    grids = dict(segment.grids)
    for name, simulated, channel in (
        ("wheel", simulated_columns[2], residual_model.wheel[index]),
        ("speed", simulated_columns[3], residual_model.speed[index]),
    ):
        scatter = np.zeros(segment.rows)
        if channel is not None:
            scatter = channel.scatter * draw_coloured_noise(rng, np.full(segment.rows, channel.memory))
        grids[name] = np.interp(grid, segment.time, simulated + scatter)
    noisy_segment = replace(segment, grids=grids, wheel=simulated_columns[2])
    states = replay_segment(residual_model.rig, noisy_segment, settings, True, True)
    turns = np.interp(grid, segment.time, _draw_unknown_turns(turn_variances, np.diff(segment.time), rng))
    states = add_soil_noise(residual_model.noise, states, rng, turns)
    return add_instrument_noise(residual_model.rig, residual_model.noise, segment, states, settings, rng)[0]


def _estimate_unknown_turns(residual_model: ResidualModel, settings: Mapping[int, Settings]) -> list[Array]:
    """Return the variances (k - 1,) of turns for lack of commands, or of wheel angles without any, per segment."""
    dataset, rig = residual_model.dataset, residual_model.rig
    if not any(segment.measured_rows for segment in dataset.segments):
        return [np.zeros(segment.rows - 1) for segment in dataset.segments]
    turned = [np.diff(simulate_instruments(rig, segment, settings[segment.run])[1]) for segment in dataset.segments]
    obeyed = [
        simulate_segment_increments(rig, _obey_commands(segment), settings[segment.run]).turned
        for segment in dataset.segments
    ]
    return estimate_unknown_turns(dataset, turned, residual_model.noise, COMMAND_FIRST, obeyed)


def _obey_commands(segment: DriveSegment) -> DriveSegment:
    """Return the segment with wheels that are at once where they are commanded; as it is without commands."""
    if segment.command is None:
        return segment
    grids = {**segment.grids, "wheel": segment.grids["command"]}
    return replace(segment, grids=grids, wheel=segment.command, logged_wheel=None)


def _draw_unknown_turns(variances: Array, steps_s: Array, rng: np.random.Generator) -> Array:
    """Draw the sums (k,) of turns with these variances (k - 1, rad2) in rows of so many seconds (k - 1).

    Each gap between two readings, in which the variance grows evenly, turns by its standard deviation to a side that is
    drawn: of the few large gaps of a run, sizes drawn as well would make the floor a matter of luck.
    """
    if not variances.any():
        return np.zeros(len(variances) + 1)
    per_second = variances / steps_s
    begins = np.abs(np.diff(per_second, prepend=-1.0)) > _SAME_GAP_SHARE * per_second
    gaps = np.cumsum(begins) - 1
    sums, seconds = np.bincount(gaps, variances), np.bincount(gaps, steps_s)
    turns = np.where(rng.random(len(sums)) < 0.5, -1.0, 1.0) * np.sqrt(sums)
    return np.append(0.0, np.cumsum(turns[gaps] / seconds[gaps] * steps_s))
