"""Instruments of the fourth reference: each sends messages at its own pace, a logger writes down the last that came.

So a row is as old as messages are: by the pace of the instrument, what it needs to send, and what a case adds. The
heading is fused from a gyroscope and two antennas and drifts with both.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pandas as pd

from tests.truth import fourth_body as body
from tests.truth.cases import ColumnClock, Fault, TruthCase
from tests.truth.drives import Drive
from tests.truth.ground import find_point
from tests.truth.laws import follow_law
from tests.truth.signals import FROZEN, NO_CLOCK, draw_slow, is_within, lose_position, low_pass, pick_held, round_to

Array = npt.NDArray[np.float64]
ROW_S = body.STEP_S * body.ROW_STEPS


@dataclass(frozen=True)
class Instruments:
    """Pace and delay of messages (s), and the errors of each instrument (standard deviations)."""

    pace_s: float = 0.05
    fast_pace_s: float = 0.02
    send_s: float = 0.005
    send_jitter_s: float = 0.002
    phase_s: tuple[float, float] = (0.012, 0.03)  # of the logger behind the receiver: messages of its epoch have come
    row_jitter_s: float = 0.001
    position_m: float = 0.006
    wander_m: float = 0.012
    wander_s: float = 40.0
    heading_deg: float = 0.06
    compass_deg: float = 0.25
    compass_s: float = 2.0
    gyro_deg_s: float = 0.01
    speed_mps: float = 0.012
    wheel_deg: float = 0.04
    wheel_digit_deg: float = 0.03


INSTRUMENTS = Instruments()
EXACT = Instruments(0.005, 0.005, 0.0, 0.0, (0.0, 0.0), 0.0, 0.0, 0.0, 40.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0)


def find_antenna(values: Mapping[str, Mapping[str, float]], nominal_m: float) -> tuple[float, float]:
    """Where the antenna really stands: ahead of the rear axle, and to its right (m)."""
    return nominal_m + values["antenna_forward"]["distance_m"], values["antenna_right"]["distance_m"]


def choose_messages(rows_s: Array, pace_s: float, clock: ColumnClock, tool: Instruments,
                    rng: np.random.Generator) -> Array:  # fmt: skip
    """When the message that each row (k, s) shows was measured (k, s); not before 0."""
    pace = clock.hold_s if clock.hold_s > 0.0 else pace_s
    count = int(rows_s[-1] / pace * (1.0 + clock.hold_jitter)) + 4
    steps = pace * (1.0 + clock.hold_jitter * rng.uniform(-1.0, 1.0, count))
    measured = np.cumsum(steps) - steps[0] - (rng.uniform(0.0, pace) if clock.hold_s > 0.0 else 0.0)
    came = measured + tool.send_s + tool.send_jitter_s * np.abs(rng.standard_normal(count))
    came = np.maximum.accumulate(came)
    shown = measured[np.maximum(np.searchsorted(came, rows_s + 1e-9, side="right") - 1, 0)]
    old: Array = shown - clock.delay_s - clock.offset_s - clock.drift_s_per_min * shown / 60.0
    return np.maximum(old, 0.0)


def sample_rows(values: Array, at_s: Array) -> Array:
    """Values (k,) of rows every 5 ms at other times."""
    out: Array = np.interp(at_s, ROW_S * np.arange(len(values)), values)
    return out


def read_instruments(case: TruthCase, drive: Drive, index: int, rows: Array, clock_s: float, nominal_m: float,
                     tool: Instruments, rng: np.random.Generator) -> pd.DataFrame:  # fmt: skip
    """The log of a run from its rows (tests.truth.fourth_body), with everything that instruments add and lose."""
    times = np.arange(0.0, drive.duration_s - 1e-9, 1.0 / case.rate_hz) + rng.uniform(*tool.phase_s)
    times = times + tool.row_jitter_s * np.clip(rng.standard_normal(len(times)), -3.0, 3.0)
    at = {
        name: choose_messages(times, tool.fast_pace_s if "steering" in name else tool.pace_s,
                              case.columns.get(name, NO_CLOCK), tool, rng)
        for name in ("position", "heading", "speed", "steering", "steering_command")
    }  # fmt: skip
    faults = [fault for fault in case.faults if fault.run == index]
    for name in at:
        at[name] = hold_frozen(at[name], faults, name)
    columns = {
        "time_s": np.round(times + clock_s, 3),
        **read_position(case, index, rows, at["position"], clock_s, nominal_m, tool, rng),
        "heading_deg": read_heading(case, index, rows, at["heading"], clock_s, tool, rng),
        "speed_mps": read_speed(case, rows, at["speed"], tool, rng),
        "speed_command_mps": drive.speed(times),
        "steering_command_deg": read_command(case, rows, at["steering_command"]),
        "steering_deg": read_wheel(case, rows, at["steering"], tool, rng),
        "shuttle": drive.shuttle(times).astype(int),
        "implement": drive.implement(times).astype(int),
    }  # fmt: skip
    lose_position(columns, times, faults, rng, 2.0 * math.pi, lambda: draw_wander(rng, times, 1.5))
    return pd.DataFrame(columns)


def read_command(case: TruthCase, rows: Array, at_s: Array) -> Array:
    """The command in force (deg), as its message says it."""
    return np.round(pick_held(filter_column(case, "steering_command", rows[:, body.COMMAND]), at_s, ROW_S), 3)


def filter_column(case: TruthCase, name: str, values: Array) -> Array:
    """Values (k,) after the low pass and the scale of their column."""
    clock = case.columns.get(name, NO_CLOCK)
    return clock.scale * low_pass(values, ROW_S, clock.filter_s)


def hold_frozen(at_s: Array, faults: list[Fault], name: str) -> Array:
    """Message times of a column that stops at the onset of its fault."""
    out = at_s.copy()
    for fault in faults:
        if FROZEN.get(fault.id) == name:
            out[is_within(fault, at_s)] = fault.from_s
    return out


def read_position(case: TruthCase, index: int, rows: Array, at_s: Array, clock_s: float, nominal_m: float,
                  tool: Instruments, rng: np.random.Generator) -> dict[str, Array]:  # fmt: skip
    """Antenna positions, late as the receiver is; the same message keeps its noise."""
    here = list_conditions(rows, clock_s)
    lever = [follow_law(case, name, index, here) for name in ("antenna_forward", "antenna_right")]
    sway = case.outside.get("antenna_sway", {}).get("m_per_mps2", 0.0)
    late = find_latency(case, index, rows, clock_s, at_s)
    east, north = find_point(rows[:, body.EAST], rows[:, body.NORTH], rows[:, body.HEADING], nominal_m + lever[0],
                             lever[1] + sway * rows[:, body.SIDE])  # fmt: skip
    out = {}
    for name, axis, other in (("easting_m", east, north), ("northing_m", north, east)):
        shown = sample_rows(filter_column(case, "position", axis), late)
        shown = shown + tool.wander_m * draw_wander(rng, late, tool.wander_s)
        shown = shown + tool.position_m * draw_per_message(rng, at_s)
        shown = shown + spoil_position(case, name, sample_rows(other, late), shown, late)
        out[name] = np.round(shown, 3)
    return out


def spoil_position(case: TruthCase, name: str, other: Array, own: Array, at_s: Array) -> Array:
    """What reflections at a place and a wandering base add to one coordinate."""
    total, phase = np.zeros(len(own)), 0.0 if name == "easting_m" else 1.7
    if "multipath" in case.outside:
        size = case.outside["multipath"]["size_m"]
        total += size * np.sin(own / 2.1 + phase) * np.sin(other / 1.7 + 2.0 * phase) * (own + other > 0.0)
    if "base_drift" in case.outside:
        drift = case.outside["base_drift"]
        total += drift["size_m"] * np.sin(2.0 * math.pi * at_s / drift["period_s"] + phase)
    return total


def read_heading(case: TruthCase, index: int, rows: Array, at_s: Array, clock_s: float, tool: Instruments,
                 rng: np.random.Generator) -> Array:  # fmt: skip
    """Fused heading (deg): turned by a gyroscope, pulled to two antennas, wrong as the case has it."""
    true = np.degrees(rows[:, body.HEADING])
    bias = follow_law(case, "heading_bias", index, list_conditions(rows, clock_s))
    error = fuse_error(len(true), tool, rng)
    if "gyro_walk" in case.outside:
        walk = case.outside["gyro_walk"]["size_deg"]
        error = error + walk * draw_wander(rng, ROW_S * np.arange(len(true), dtype=np.float64), 12.0)
    if "compass_deviation" in case.outside:
        compass = case.outside["compass_deviation"]
        error = error + compass["size_deg"] * np.sin(np.radians(true - compass["bearing_deg"]))
    seen = filter_column(case, "heading", true + bias + error)
    late = find_latency(case, index, rows, clock_s, at_s)
    out: Array = np.round(np.mod(sample_rows(seen, late) + tool.heading_deg * draw_per_message(rng, at_s), 360.0), 3)
    return out


def fuse_error(count: int, tool: Instruments, rng: np.random.Generator) -> Array:
    """Error (deg) of the fused heading: the gyroscope's bias against the antennas', low-passed."""
    noise = np.repeat(rng.standard_normal(count // 20 + 1), 20)[:count]
    bias = tool.gyro_deg_s * float(rng.standard_normal()) * tool.compass_s
    return low_pass(tool.compass_deg * noise, ROW_S, tool.compass_s) + bias


def read_speed(case: TruthCase, rows: Array, at_s: Array, tool: Instruments, rng: np.random.Generator) -> Array:
    """Speed over ground, never negative; a radar may see nothing below its threshold."""
    speed = sample_rows(filter_column(case, "speed", np.abs(rows[:, body.SPEED])), at_s)
    speed = speed + tool.speed_mps * draw_per_message(rng, at_s) * np.minimum(speed / 0.2, 1.0)
    if "radar_threshold" in case.outside:
        low = case.outside["radar_threshold"]["speed_mps"]
        speed = np.where(speed < low, 0.0, speed - 0.15 * low)
    return np.maximum(np.round(speed, 3), 0.0)


def read_wheel(case: TruthCase, rows: Array, at_s: Array, tool: Instruments, rng: np.random.Generator) -> Array:
    """Angle of the column's encoder as a wheel angle (deg)."""
    wheel = sample_rows(filter_column(case, "steering", rows[:, body.MOTOR]), at_s)
    wheel = wheel + tool.wheel_deg * draw_per_message(rng, at_s)
    return np.round(round_to(wheel, tool.wheel_digit_deg), 3) if tool.wheel_digit_deg > 0.0 else wheel


def draw_per_message(rng: np.random.Generator, at_s: Array) -> Array:
    """Unit noise (k,) that is the same in all rows that show one message."""
    _, number = np.unique(at_s, return_inverse=True)
    out: Array = rng.standard_normal(int(number.max()) + 1)[number]
    return out


def draw_wander(rng: np.random.Generator, at_s: Array, memory_s: float) -> Array:
    """Unit-variance noise (k,) over time with this memory."""
    return draw_slow(rng, at_s, memory_s, float(np.max(at_s)) + memory_s, 4)


def list_conditions(rows: Array, clock_s: float) -> Array:
    """What laws of instruments depend on, in every row (k, 7)."""
    time, none = ROW_S * np.arange(len(rows)), np.zeros(len(rows))
    return np.column_stack([time, clock_s - 30_000.0 + time, rows[:, body.EAST], rows[:, body.NORTH], none,
                            rows[:, body.WHEEL], rows[:, body.SPEED]])  # fmt: skip


def find_latency(case: TruthCase, index: int, rows: Array, clock_s: float, at_s: Array) -> Array:
    """Times of measurement less the receiver's latency."""
    late = follow_law(case, "gnss_latency", index, list_conditions(rows, clock_s))
    return np.maximum(at_s - sample_rows(late, at_s), 0.0)
