"""Instruments of the fifth reference: two loggers on a bus, merged by nearest time; messages are dropped and rounded.

The receiver's error is a Gauss-Markov process of a minute, as of reflections; the antenna stands on a mast, and nobody
corrects its tilt. The heading is that of two antennas, or of a gyroscope that course over ground holds by and by.

| cause outside, of instruments | values | what it is |
|---|---|---|
| gyro_scale | share, hold_s | heading from a gyroscope that turns so much too far, and is held loosely |
| wheel_hysteresis | angle_deg | the wheel sensor has play of its own; the computer steers by another one |
| mast_spring | hertz, damping | the mast swings |
| roll_lever | height_m | a mast so much higher |
| magnet | size_deg, east_m, north_m, radius_m | headings are wrong near a place |
| kalman_lag | way_m | positions are smoothed over this way: the slower, the later |
| grid_scale | east | eastings grow by this ratio too fast |
| baseline_flex | share | the heading of two antennas turns with roll |
| rim_speed | here | speed is that of the wheels |
| stamp_jitter | time_s | rows get the time at which they came |
| course_heading | here | the heading is the course of the antenna |
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np
import numpy.typing as npt
import pandas as pd

from tests.truth import fifth_body as body
from tests.truth.cases import COLUMN_NAMES, ColumnClock, Fault, TruthCase
from tests.truth.fifth_drivers import MAST_M
from tests.truth.ground import find_point
from tests.truth.laws import follow_law
from tests.truth.signals import FROZEN, NO_CLOCK, draw_slow, is_within, lose_position, pick_held, round_to

Array = npt.NDArray[np.float64]
ROW_S, NOMINAL_M, DAY_STARTS_S = body.STEP_S * body.ROW_STEPS, 1.1, 25_000.0


@dataclass(frozen=True)
class Instruments:
    """Errors (standard deviations), last digits, memories (s) and shares of messages lost."""

    pace_s: float = 0.05
    lost: float = 0.01
    position_m: float = 0.007
    wander_m: float = 0.015
    wander_s: float = 60.0
    heading_deg: float = 0.12
    gyro_deg_s: float = 0.015
    gyro_held_s: float = 15.0
    speed_mps: float = 0.012
    speed_digit: float = 0.01
    wheel_deg: float = 0.03
    wheel_digit: float = 0.1
    receiver_s: float = 0.02


INSTRUMENTS = Instruments()
EXACT = Instruments(0.005, 0.0, 0.0, 0.0, 60.0, 0.0, 0.0, 15.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@numba.njit(cache=True)
def smooth_rows(values: Array, time_s: Array) -> Array:
    """First-order low pass of rows every 5 ms with a time constant (s) per row."""
    out = values.copy()
    for i in range(1, len(out)):
        out[i] = out[i - 1] + (values[i] - out[i - 1]) * min(ROW_S / max(time_s[i], ROW_S), 1.0)
    return out


@numba.njit(cache=True)
def swing_rows(values: Array, hertz: float, damping: float) -> Array:
    """What a swinging mast makes of rows every 5 ms (second order, semi-implicit)."""
    out, place, rate, pulse = values.copy(), values[0], 0.0, 2.0 * math.pi * hertz
    for i in range(1, len(out)):
        rate += ROW_S * (pulse**2 * (values[i] - place) - 2.0 * damping * pulse * rate)
        place += ROW_S * rate
        out[i] = place
    return out


@numba.njit(cache=True)
def follow_play(values: Array, width: float) -> Array:
    """Rows behind play of this width."""
    out = values.copy()
    for i in range(1, len(out)):
        out[i] = min(max(out[i - 1], values[i] - 0.5 * width), values[i] + 0.5 * width)
    return out


def draw_markov(rng: np.random.Generator, count: int, memory_s: float) -> Array:
    """Unit-variance Gauss-Markov process of rows every 5 ms."""
    return draw_slow(rng, ROW_S * np.arange(count), memory_s, count * ROW_S + memory_s / 8.0 + 1.0, 40)


def list_conditions(rows: Array, clock_s: float) -> Array:
    """What laws of instruments depend on, in every row (k, 7)."""
    time = ROW_S * np.arange(len(rows))
    places = (body.EAST, body.NORTH, body.DOWN, body.WHEEL, body.SPEED)
    return np.column_stack([time, clock_s + time, *(rows[:, place] for place in places)])


def draw_receiver_error(case: TruthCase, index: int, count: int, tool: Instruments) -> Array:
    """Slow errors (count, 2) of the receiver (m, east and north): driver and log see the same."""
    rng = np.random.default_rng([case.seed, index, 51])
    return tool.wander_m * np.column_stack([draw_markov(rng, count, tool.wander_s) for _ in range(2)])


def list_times(rows_s: Array, clock: ColumnClock, fault: Fault | None, tool: Instruments,
               rng: np.random.Generator) -> Array:  # fmt: skip
    """When the message of each row (k, s) was measured: the nearest one, or the last where a column is held."""
    pace = clock.hold_s or min(tool.pace_s, 0.8 * float(np.median(np.diff(rows_s))))
    steps = pace * (1.0 + (clock.hold_jitter or 0.02) * rng.uniform(-1.0, 1.0, int(rows_s[-1] / pace * 1.3) + 8))
    sent = np.cumsum(steps) - steps[0] - pace * rng.uniform()
    sent = sent[(rng.random(len(sent)) >= tool.lost) | (clock.hold_s > 0.0)]
    after = np.clip(np.searchsorted(sent, rows_s), 1, len(sent) - 1)
    last = after - 1
    is_next = (sent[after] - rows_s < rows_s - sent[last]) & (clock.hold_s == 0.0) & (rows_s > sent[0])
    shown = np.where(is_next, sent[after], sent[last])
    out: Array = shown - clock.delay_s - clock.offset_s - clock.drift_s_per_min * shown / 60.0
    if fault is not None:
        out[is_within(fault, out)] = fault.from_s
    return np.maximum(out, 0.0)


def find_positions(case: TruthCase, index: int, rows: Array, here: Array, errors: Array) -> Array:
    """Where the receiver says its antenna is, every 5 ms (k, 2), m east and north."""
    outside = case.outside
    lever = [follow_law(case, name, index, here) for name in ("antenna_forward", "antenna_right")]
    lean = rows[:, body.ROLL] * (MAST_M + outside.get("roll_lever", {}).get("height_m", 0.0))
    if "mast_spring" in outside:
        spring = outside["mast_spring"]
        push = rows[:, body.SPEED] * rows[:, body.YAW] + 9.8 * rows[:, body.ROLL]
        lean = lean - swing_rows(push / (2.0 * math.pi * spring["hertz"]) ** 2, spring["hertz"], spring["damping"])
    east, north = find_point(rows[:, body.EAST], rows[:, body.NORTH], rows[:, body.HEADING], NOMINAL_M + lever[0],
                             lever[1] + lean)  # fmt: skip
    place = np.column_stack([east * outside.get("grid_scale", {}).get("east", 1.0), north]) + errors[: len(rows)]
    if "kalman_lag" in outside:
        late = outside["kalman_lag"]["way_m"] / np.maximum(np.abs(rows[:, body.SPEED]), 0.3)
        place = np.column_stack([smooth_rows(np.ascontiguousarray(place[:, k]), late) for k in range(2)])
    return place


def find_headings(case: TruthCase, index: int, rows: Array, here: Array, places: Array, tool: Instruments,
                  rng: np.random.Generator) -> Array:  # fmt: skip
    """What the heading column's instrument says every 5 ms (deg, not wrapped)."""
    outside, true = case.outside, np.degrees(rows[:, body.HEADING])
    said = true + follow_law(case, "heading_bias", index, here)
    if case.seed % 2 or "gyro_scale" in outside:
        gyro = outside.get("gyro_scale", {"share": 0.0, "hold_s": tool.gyro_held_s})
        drift = tool.gyro_deg_s * float(rng.standard_normal()) * ROW_S
        raw = np.cumsum(gyro["share"] * np.diff(true, prepend=true[0]) + drift)
        said = said + raw - smooth_rows(raw, np.full(len(raw), gyro["hold_s"]))
    if "magnet" in outside:
        magnet = outside["magnet"]
        away = np.hypot(rows[:, body.EAST] - magnet["east_m"], rows[:, body.NORTH] - magnet["north_m"])
        said = said + magnet["size_deg"] * np.exp(-((away / magnet["radius_m"]) ** 2))
    if "baseline_flex" in outside:
        said = said + outside["baseline_flex"]["share"] * np.degrees(rows[:, body.ROLL])
    if "course_heading" in outside:
        span = 40
        way = places[span:] - places[:-span]
        course = np.unwrap(np.arctan2(way[:, 0], way[:, 1]))
        moving = np.hypot(way[:, 0], way[:, 1]) > 0.06
        held = np.interp(np.arange(len(course)), np.flatnonzero(moving), course[moving])
        said = np.degrees(np.concatenate([np.full(span, held[0]), held]))
    return np.asarray(said, dtype=np.float64)


def read_log(
    case: TruthCase, index: int, rows: Array, clock_s: float, errors: Array, tool: Instruments
) -> pd.DataFrame:
    """The log of a run from its rows every 5 ms."""
    rng, outside, here = np.random.default_rng([case.seed, index, 52]), case.outside, list_conditions(rows, clock_s)
    grid = ROW_S * np.arange(len(rows), dtype=np.float64)
    times = np.arange(0.0, grid[-1] - 2.0, 1.0 / case.rate_hz) + 0.5 * ROW_S
    faults = [fault for fault in case.faults if fault.run == index]
    frozen = {FROZEN[fault.id]: fault for fault in faults if fault.id in FROZEN}
    clocks = {name: case.columns.get(name, NO_CLOCK) for name in COLUMN_NAMES}
    at = {name: list_times(times, clocks[name], frozen.get(name), tool, rng) for name in COLUMN_NAMES}
    late = follow_law(case, "gnss_latency", index, here) + tool.receiver_s
    for name in ("position", "heading"):
        at[name] = np.maximum(at[name] - np.interp(at[name], grid, late), 0.0)

    def read(name: str, column: Array, noise: float, digit: float = 0.0, scale: float = 1.0) -> Array:
        clock = clocks[name]
        passed = smooth_rows(np.ascontiguousarray(column), np.full(len(column), clock.filter_s))
        shown = scale * np.interp(at[name], grid, passed if clock.filter_s else column)
        _, number = np.unique(at[name], return_inverse=True)
        shown = shown + noise * rng.standard_normal(len(times))[number]
        return round_to(shown, digit)

    places = find_positions(case, index, rows, here, errors)
    speed = np.abs(rows[:, body.RIM if "rim_speed" in outside else body.SPEED])
    wheel = follow_play(rows[:, body.MOTOR].copy(), outside.get("wheel_hysteresis", {}).get("angle_deg", 0.0))
    now = pick_held(rows, times, ROW_S)
    columns = {
        "time_s": np.round(times + clock_s + DAY_STARTS_S, 3),
        "easting_m": read("position", places[:, 0], tool.position_m),
        "northing_m": read("position", places[:, 1], tool.position_m),
        "heading_deg": np.mod(read("heading", find_headings(case, index, rows, here, places, tool, rng),
                                   tool.heading_deg), 360.0),
        "speed_mps": np.maximum(read("speed", speed, tool.speed_mps, tool.speed_digit, clocks["speed"].scale), 0.0),
        "speed_command_mps": np.abs(now[:, body.TARGET]),
        "steering_command_deg": np.round(pick_held(rows[:, body.COMMAND], at["steering_command"], ROW_S), 2),
        "steering_deg": read("steering", wheel, tool.wheel_deg, tool.wheel_digit, clocks["steering"].scale),
        "shuttle": now[:, body.GEAR].astype(int),
        "implement": now[:, body.DOWN].astype(int),
    }  # fmt: skip
    count = int(times[-1] / ROW_S) + 9
    lose_position(columns, times, faults, rng, 6.28, lambda: draw_slow(rng, times, 2.0, count * ROW_S + 1.25, 40))
    if "stamp_jitter" in outside:
        size = outside["stamp_jitter"]["time_s"]
        columns["time_s"] = np.round(columns["time_s"] + np.minimum(rng.exponential(size, len(times)),
                                                                    0.9 / case.rate_hz), 3)  # fmt: skip
    return pd.DataFrame({name: np.round(cells, 4) for name, cells in columns.items()})
