"""Causes outside the catalogue that spoil what the instruments of the fifth reference show.

The antenna stands on a mast, and nobody corrects its tilt. The heading is that of two antennas, or of a gyroscope that
course over ground holds by and by.

| cause | values | what it is |
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

import math

import numba
import numpy as np
import numpy.typing as npt

from tests.truth import fifth_body as body
from tests.truth.cases import TruthCase
from tests.truth.fifth_drivers import MAST_M

Array = npt.NDArray[np.float64]
ROW_S = body.STEP_S * body.ROW_STEPS
GYRO_DEG_S, GYRO_HELD_S = 0.015, 15.0


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


def find_lean(case: TruthCase, rows: Array) -> Array:
    """How far the antenna leans to the right on its mast (k,), m."""
    lean: Array = rows[:, body.ROLL] * (MAST_M + case.outside.get("roll_lever", {}).get("height_m", 0.0))
    if "mast_spring" in case.outside:
        spring = case.outside["mast_spring"]
        push = rows[:, body.SPEED] * rows[:, body.YAW] + 9.8 * rows[:, body.ROLL]
        lean = lean - swing_rows(push / (2.0 * math.pi * spring["hertz"]) ** 2, spring["hertz"], spring["damping"])
    return lean


def spoil_places(case: TruthCase, rows: Array, places: Array) -> Array:
    """Positions (k, 2) on a stretched grid, or behind a filter."""
    out = places * (case.outside.get("grid_scale", {}).get("east", 1.0), 1.0)
    if "kalman_lag" in case.outside:
        late = case.outside["kalman_lag"]["way_m"] / np.maximum(np.abs(rows[:, body.SPEED]), 0.3)
        out = np.column_stack([smooth_rows(np.ascontiguousarray(out[:, k]), late) for k in range(2)])
    return out


def spoil_headings(case: TruthCase, rows: Array, headings_deg: Array, places: Array, rng: np.random.Generator) -> Array:
    """What the heading column's instrument makes of headings (k,), not wrapped."""
    outside, true, said = case.outside, np.degrees(rows[:, body.HEADING]), headings_deg
    if case.seed % 2 or "gyro_scale" in outside:
        gyro = outside.get("gyro_scale", {"share": 0.0, "hold_s": GYRO_HELD_S})
        drift = GYRO_DEG_S * float(rng.standard_normal()) * ROW_S
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
