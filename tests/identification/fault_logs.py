"""Logs of the second reference in which something breaks at a moment, and clean ones."""

from functools import lru_cache

import numpy as np
import pandas as pd

from tests.truth.drives import three_speeds_programme
from tests.truth.second import second_logs
from vehicle.identification.logs.reader import build_log
from vehicle.identification.logs.schema import Log

START_S, RUNS = 100.0, ("there", "back", "right", "left", "steps", "waves", "tool", "lines")


@lru_cache(maxsize=1)
def clean_frames() -> dict[str, pd.DataFrame]:
    """One clean set: eight runs of 56 s at 10 Hz, one of them with a path follower."""
    return {frame.attrs["name"]: frame for frame in second_logs({}, 61, three_speeds_programme())}


@lru_cache(maxsize=1)
def clean_logs() -> dict[str, Log]:
    """The same as they are read."""
    return {name: build_log(frame, name) for name, frame in clean_frames().items()}


def rows_of(frame: pd.DataFrame, from_s: float, to_s: float | None) -> np.ndarray:
    """The rows from and to seconds after the start, or to the end."""
    seconds = frame.time_s.to_numpy() - START_S
    return np.flatnonzero((seconds >= from_s) & (seconds < (np.inf if to_s is None else to_s)))


def freeze(frame: pd.DataFrame, columns: tuple[str, ...], from_s: float, to_s: float | None) -> pd.DataFrame:
    """The last value before again and again."""
    frame, rows = frame.copy(), rows_of(frame, from_s, to_s)
    for name in columns:
        frame.loc[rows, name] = frame[name][max(rows[0] - 1, 0)]
    return frame


def degrade(frame: pd.DataFrame, from_s: float, to_s: float | None, size_m: float, seed: int) -> pd.DataFrame:
    """Positions that scatter."""
    frame, rows = frame.copy(), rows_of(frame, from_s, to_s)
    for name, errors in zip(
        ("easting_m", "northing_m"), np.random.default_rng(seed).normal(0.0, size_m, (2, len(rows))), strict=True
    ):
        frame.loc[rows, name] += errors
    return frame


def ignore_commands(frame: pd.DataFrame, from_s: float, to_s: float | None, sensor: bool) -> pd.DataFrame:
    """Commands to one side and the other that the path does not follow; nor does the wheel angle, unless `sensor`."""
    frame, rows = frame.copy(), rows_of(frame, from_s, to_s)
    seconds = frame.time_s.to_numpy()[rows] - frame.time_s[rows[0]]
    commands = np.where(seconds % 16.0 < 8.0, 20.0, -20.0)
    frame.loc[rows, "steering_command_deg"] = commands
    if sensor:
        frame.loc[rows, "steering_deg"] = np.round(commands + 0.05 * np.sin(37.0 * seconds), 2)
    return frame
