"""The sixth reference: a hydrostatic carrier on brush tyres in field work and free driving, on a CAN bus logger.

Seven runs: three of field work (passes with the implement down, turns at the headland, steered by a guidance that sees
what the receiver sees) and four of free driving (slalom, circles, starts and stops, a person's bends). Nothing of the
program under test is used. Outside the catalogue: `crosswind` (gusty, on a tall tank), `steering_hunt` (wheels that
swing behind the sensor), `mast_sway` (an antenna that swings on a bent mast), `soft_tyre` (a pull to one side).
"""

import math
from collections.abc import Callable, Mapping

import numpy as np
import pandas as pd

from tests.truth import sixth_body as body
from tests.truth.cases import TruthCase
from tests.truth.effects import NEUTRAL
from tests.truth.laws import encode_law, stack_laws
from tests.truth.sixth_recorder import draw_wander, record_run

Array = np.ndarray
Rng = np.random.Generator
GAP_S, TICK_S, PATH_M = 300.0, 0.1, 0.25
SIDE_MPS2, SIDE_N, TURN_NM = 1.2, 350.0, 230.0  # lateral acceleration that drivers allow; the ground's bumps
RUNS = ("field", "slalom", "circles", "field", "person", "stops", "field")
PROGRAMMES = ("nearest", "last")  # how the logger merges messages: see tests.truth.sixth_recorder


def build_parameters(case: TruthCase) -> Array:
    """Parameters of a case in the order of KEYS. Raises ValueError for an unknown cause, a column or a fault."""
    if set(case.outside) - {name for name, _ in body.OUTSIDE_KEYS} or case.columns or case.faults:
        raise ValueError(f"The sixth reference cannot hide {case.outside or 'clocks of columns and faults'}.")
    given: dict[str, Mapping[str, float]] = {**case.effects, **case.outside}
    return np.array([given.get(name, NEUTRAL.get(name, {})).get(key, 0.0) for name, key in body.KEYS])


def lay_field(rng: Rng, tall: float, wide: float) -> Array:
    """A path up and down a field round the origin: east, north, speed, implement down, every PATH_M."""
    pace, slow, bearing = rng.uniform(1.3, 2.6), rng.uniform(1.0, 2.0), math.radians(rng.uniform(0.0, 360.0))
    side, radius, rows = float(rng.choice([-1.0, 1.0])), 0.5 * wide, []
    for k in range(5):
        way = 1.0 if k % 2 == 0 else -1.0
        rows += [(side * wide * (k - 1), way * y, pace, 1.0) for y in np.arange(-0.5 * tall, 0.5 * tall, PATH_M)]
        for turn in np.arange(0.0, math.pi, PATH_M / radius):
            across = wide * (k - 1) + radius * (1.0 - math.cos(turn))
            rows.append((side * across, way * (0.5 * tall + radius * math.sin(turn)), slow, 0.0))
    path, cos, sin = np.array(rows), math.cos(bearing), math.sin(bearing)
    path[:, :2] = path[:, :2] @ np.array([[cos, -sin], [sin, cos]])
    return path


def hold_values(rng: Rng, ticks: int, low_s: float, high_s: float, draw: Callable[[], float]) -> Array:
    """Values drawn one after the other, each held for some seconds."""
    out, at = np.empty(ticks), 0
    while at < ticks:
        more = at + int(rng.uniform(low_s, high_s) / TICK_S)
        out[at:more], at = draw(), more
    return out


def limit_speed(speed: Array, angle: Array) -> Array:
    """Speeds (m/s) that a driver would dare at these angles (deg), to hundredths; 0 stays 0."""
    bend = np.array([abs(body.compute_curvature(float(one))) for one in angle])
    return np.round(np.minimum(speed, np.sqrt(SIDE_MPS2 / np.maximum(bend, 1e-3))), 2)


def plan_free(name: str, rng: Rng, ticks: int) -> Array:
    """Commanded angle (deg), speed (m/s) and implement per tick of a free drive."""
    time, tool = TICK_S * np.arange(ticks), np.zeros(ticks)
    if name == "slalom":
        size = hold_values(rng, ticks, 14.0, 24.0, lambda: rng.uniform(8.0, 17.0))
        period = hold_values(rng, ticks, 20.0, 40.0, lambda: rng.uniform(5.0, 9.0))
        angle = size * np.sin(np.cumsum(math.tau * TICK_S / period))
        speed = limit_speed(hold_values(rng, ticks, 12.0, 20.0, lambda: rng.uniform(2.0, 3.5)), size)
    elif name == "circles":
        side = float(rng.choice([-1.0, 1.0])) * np.where(np.arange(12) % 2, -1.0, 1.0)
        angles = iter(side * rng.uniform(5.0, 26.0, 12))
        angle = hold_values(rng, ticks, 13.0, 22.0, lambda: next(angles))
        speed = limit_speed(hold_values(rng, ticks, 8.0, 14.0, lambda: rng.uniform(1.2, 3.5)), angle)
    elif name == "stops":
        angle = hold_values(rng, ticks, 5.0, 9.0, lambda: rng.choice([0.0, 1.0, 1.0]) * rng.uniform(-9.0, 9.0))
        level = iter(np.where(np.arange(60) % 3 == 2, 0.0, rng.uniform(1.0, 3.5, 60)))
        speed = limit_speed(hold_values(rng, ticks, 4.0, 8.0, lambda: next(level)), angle)
    else:
        angle = np.clip(9.0 * draw_wander(rng, time, 2.5), -24.0, 24.0)
        angle = hold_values(rng, ticks, 1.5, 4.5, lambda: rng.uniform(-20.0, 20.0)) * 0.7 + 0.3 * angle
        speed = hold_values(rng, ticks, 8.0, 16.0, lambda: rng.uniform(1.2, 2.8))
        speed, tool = limit_speed(speed, np.full(ticks, 20.0)), (np.sin(math.tau * time / 40.0) > 0.0) * 1.0
    return np.column_stack([np.round(angle, 1), speed, tool])


def drive_plan(case: TruthCase, plan: Array, path: Array, run: int = 0, quiet: bool = False) -> Array:
    """Rows of a drive before any instrument sees it; `quiet` is even ground and a perfect guidance receiver."""
    rng, ticks, p = np.random.default_rng([case.seed, run, 61]), len(plan), build_parameters(case)
    places = {law.effect: body.KEYS.index((law.effect, next(iter(NEUTRAL[law.effect])))) for law in case.laws}
    laws = stack_laws([encode_law(law, places[law.effect], run) for law in case.laws])
    loud = np.array([SIDE_N, TURN_NM, 1.0]) * (0.0 if quiet else 1.0)
    wander = np.column_stack([draw_wander(rng, TICK_S * np.arange(ticks), memory) for memory in (0.7, 0.5, 4.0)]) * loud
    when, fine = np.arange(ticks), np.arange(ticks * body.TICK) / body.TICK
    bumps = np.column_stack([np.interp(fine, when, wander[:, k]) for k in range(3)])
    noise = rng.normal(size=(ticks, 3)) * np.array([0.008, 0.008, 0.2]) * (0.0 if quiet else 1.0)
    state = np.zeros(22)
    state[:3] = *rng.uniform(-7.0, 7.0, 2), rng.uniform(0.0, math.tau)
    if len(path):
        way = path[4, :2] - path[0, :2]
        state[:3] = *(path[0, :2] + rng.normal(0.0, 0.1, 2)), math.atan2(*way) + rng.normal(0.0, 0.03)
    return body.drive_machine(state, p, laws, plan, path, bumps, noise, run * GAP_S)  # type: ignore[no-any-return]


def make_run(case: TruthCase, run: int) -> pd.DataFrame:
    """One run as the logger has it, its name in `attrs`."""
    rng, name = np.random.default_rng([case.seed, run, 62]), RUNS[run]
    ticks, path = int(rng.uniform(75.0, 115.0) / TICK_S), np.empty((0, 4))
    plan = np.zeros((ticks, 3)) if name == "field" else plan_free(name, rng, ticks)
    if name == "field":
        path = lay_field(rng, rng.uniform(30.0, 40.0), rng.uniform(12.5, 14.0))
    frame = record_run(drive_plan(case, plan, path, run), build_parameters(case), case, run, run * GAP_S)
    frame.attrs["name"] = f"{name} {run + 1}"
    return frame


def make_sixth_logs(case: TruthCase) -> list[pd.DataFrame]:
    """The logs of a case: one frame per run, in the columns of a log. Raises ValueError for an unknown programme."""
    if case.programme not in PROGRAMMES:
        raise ValueError(f"The programme {case.programme!r} is unknown; use one of: {', '.join(PROGRAMMES)}.")
    return [make_run(case, run) for run in range(len(RUNS))]
