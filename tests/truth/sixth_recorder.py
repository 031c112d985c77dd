"""A CAN bus logger: messages at rates and in steps of their own, merged to one row each 0.1 s.

`nearest`: a cell has the message nearest in time, and is empty where none came within 50 ms; a busy bus loses an eighth
of the positions, and headings and commanded speeds come at 5 Hz. `last`: a cell has the last message, and is empty when
that is older than 0.25 s. Positions have slow RTK errors, and the receiver is out for a second or so in some runs.
"""

import math

import numpy as np
import pandas as pd

from tests.truth import sixth_body as body
from tests.truth.cases import TruthCase
from tests.truth.ground import find_point
from tests.truth.signals import colour_noise

Array = np.ndarray
ORIGIN_M = (412_300.0, 5_411_200.0)
NEAR_S, OLD_S, TRANSPORT_S, JITTER_S, LOST = 0.05, 0.25, 0.008, 0.004, 0.125
RTK, COMPASS = (0.01, 25.0, 0.005, 0.001), (0.15, 6.0, 0.25, 0.01)  # slow error, its memory (s), noise, step
RECEIVED = (body.EAST, body.NORTH, body.HEADING, body.MAST)
MESSAGES: dict[str, tuple[float, float, float]] = {
    "speed_mps": (10.0, 0.02, 0.01), "speed_command_mps": (10.0, 0.0, 0.01), "steering_command_deg": (20.0, 0.0, 0.05),
    "steering_deg": (50.0, 0.04, 0.05), "implement": (10.0, 0.0, 1.0), "shuttle": (10.0, 0.0, 1.0),
}  # fmt: skip
"""Column: messages per second, noise, step."""


def time_messages(rng: np.random.Generator, rate_hz: float, end_s: float) -> Array:
    """When messages come (s): a phase of at most 30 ms before the rows, a clock 20 ppm off, jitter."""
    count, phase = int(end_s * rate_hz), -rng.uniform(0.005, min(0.03, 0.9 / rate_hz))
    ideal = phase + np.arange(1, count + 1) / rate_hz * (1.0 + rng.normal(0.0, 2e-5))
    return ideal + rng.uniform(0.0, JITTER_S, count)


def merge_messages(programme: str, rows_s: Array, sent_s: Array, values: Array) -> Array:
    """A value per row, the nearest or the last message, NaN where none is near enough."""
    if programme == "last":
        at = np.searchsorted(sent_s, rows_s, side="right") - 1
        good = (at >= 0) & (rows_s - sent_s[np.maximum(at, 0)] <= OLD_S)
    else:
        at = np.clip(np.searchsorted(sent_s, rows_s), 1, len(sent_s) - 1)
        at = at - (rows_s - sent_s[at - 1] < sent_s[at] - rows_s)
        good = np.abs(rows_s - sent_s[at]) <= NEAR_S
    return np.where(good, values[np.maximum(at, 0)], np.nan)


def draw_wander(rng: np.random.Generator, when_s: Array, memory_s: float) -> Array:
    """Values at some times (s) that wander about 0 with deviation 1."""
    steps = np.diff(when_s, prepend=[when_s[0] - 2.0, when_s[0] - 1.0])
    white = rng.normal(size=len(when_s))
    return colour_noise(np.concatenate([[rng.normal()], white]), steps, memory_s)[1:]


def read_receiver(rng: np.random.Generator, rows: Array, p: Array, when_s: Array) -> Array:
    """Easting and northing (m) and heading (deg) of a receiver in its messages: late, off and noisy."""
    seen, time = when_s - TRANSPORT_S - p[body.LATENCY], body.STEP_S * np.arange(1, len(rows) + 1)
    east, north, heading, mast = (np.interp(seen, time, rows[:, k]) for k in RECEIVED)
    ahead, aside = p[body.AHEAD], p[body.ASIDE] + mast  # the mass is where the file has the antenna
    east, north = find_point(east + ORIGIN_M[0], north + ORIGIN_M[1], heading, ahead, aside)
    values = np.column_stack([east, north, np.degrees(heading) + p[body.BIAS]])
    for k, (slow, memory_s, fast, step) in enumerate((RTK, RTK, COMPASS)):
        values[:, k] += slow * draw_wander(rng, when_s, memory_s) + rng.normal(0.0, fast, len(when_s))
        values[:, k] = np.round(np.round(values[:, k] / step) * step, 3)
    values[:, 2] %= 360.0
    return values


def record_run(rows: Array, p: Array, case: TruthCase, run: int, start_s: float) -> pd.DataFrame:
    """The log of a run that begins at `start_s` of the day, from the rows of its drive and the parameters `p`."""
    rng, programme = np.random.default_rng([case.seed, run, 63]), case.programme
    end_s = len(rows) * body.STEP_S
    rows_s = np.arange(0.3, end_s - 0.05, 1.0 / case.rate_hz)
    log = {"time_s": np.round(start_s + rows_s, 3)}
    fixes = time_messages(rng, 10.0, end_s)
    lost = rng.uniform(10.0, end_s - 10.0) if rng.random() < 0.4 else math.inf
    fixes = fixes[(fixes < lost) | (fixes > lost + rng.uniform(0.6, 2.0))]
    seen = read_receiver(rng, rows, p, fixes)
    came = rng.random(len(fixes)) > (0.0 if programme == "last" else LOST)
    for k, name in enumerate(("easting_m", "northing_m", "heading_deg")):
        sent = came if k < 2 else slice(None, None, 1 if programme == "last" else 2)
        log[name] = merge_messages(programme, rows_s, fixes[sent], seen[sent, k])
    sources = {"speed_mps": np.abs(rows[:, body.SPEED]), "speed_command_mps": rows[:, body.TARGET],
               "steering_command_deg": rows[:, body.COMMAND], "steering_deg": rows[:, body.SENSOR],
               "implement": rows[:, body.SWITCH], "shuttle": np.ones(len(rows))}  # fmt: skip
    for name, (rate_hz, noise, step) in MESSAGES.items():
        slow = 0.5 if name == "speed_command_mps" and programme == "nearest" else 1.0
        sent = time_messages(rng, slow * rate_hz, end_s)
        at = np.clip((sent / body.STEP_S).astype(int) - 1, 0, len(rows) - 1)
        values = np.round((sources[name][at] + rng.normal(0.0, noise, len(sent))) / step) * step
        log[name] = merge_messages(programme, rows_s, sent, np.round(values, 3))
    log["speed_mps"] = np.abs(log["speed_mps"])
    return pd.DataFrame(log)
