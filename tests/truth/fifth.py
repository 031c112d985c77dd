"""The fifth reference: a rolling body on TMeasy tyres with a drawn implement, driven by three kinds of drivers.

The tractor is tests.truth.fifth_body, the drivers and their runs fifth_drivers, what spoils its instruments
fifth_outside, what its cases are drawn from in menus. It shares with others the measured radii of the tractor, the
tables of effects and laws, the forms of cases and the recorder. Imports nothing of the project it tests.

| cause outside, of the body | values | what it is |
|---|---|---|
| weight_shift | share | a heavy draft lifts the front axle by this share of itself |
| tyre_leak | per_minute | the left tyres soften over the day |
| axle_lock | from_s | the rear wheels are locked together from some time on |
| crab_axle | run, angle_deg | the rear axle stands askew in one run |
| boom_wind | moment_nm, bearing_deg | wind turns the unfolded boom |
| furrow_walls | side_n | wheels are led by furrows that run north, while the implement works |
| weak_pump | deg_per_s | oil is short at low engine speed |
| leaky_valve | per_s | the wheels creep to the middle, and are brought back late |
| pushed_tank | mass_kg | a tank without a brake pulls and pushes |
| soft_springs | ratio | the tractor leans so many times as far |
"""

import math
from functools import lru_cache

import numpy as np
import numpy.typing as npt
import pandas as pd

from tests.truth import fifth_body as body
from tests.truth.cases import TruthCase
from tests.truth.effects import complete
from tests.truth.fifth_drivers import build_programme, lay_parts
from tests.truth.fifth_outside import ROW_S, find_lean, follow_play, spoil_headings, spoil_places
from tests.truth.ground import CIRCLES_RAD, MAP_SPEED_MPS, draw_waves, measure_curvature, mirror_curve
from tests.truth.laws import P_DEAD_BAND, P_DRAFT, fill_parameters
from tests.truth.recorder import (
    ANTENNA_FORWARD_M,
    Instruments,
    Signals,
    build_log,
    draw_position_errors,
    find_ages,
    find_antenna,
    list_row_times,
    record_run,
)
from tests.truth.signals import draw_slow, mark_broken, pick_held

Array = npt.NDArray[np.float64]
MARGIN_S, DRAFT_N, HEAVY_N, OIL_DEG_S = 2.5, 1500.0, 6000.0, 60.0
INSTRUMENTS = Instruments(
    position_m=0.007, wander_m=0.015, wander_s=60.0, heading_deg=0.12, speed_mps=0.012, speed_digit_mps=0.01,
    wheel_deg=0.03, wheel_digit_deg=0.1, pace_s=0.05, fast_pace_s=0.05, lost=0.01, shows_nearest=True, receiver_s=0.02,
)  # fmt: skip
RUT_RAD, TILT_RAD, WAVES, PULSES = 0.003, 0.005, 16, 0.25
OUTSIDE_BODY = {
    "weight_shift": (body.P_LIFT, "share"), "tyre_leak": (body.P_TYRE, "per_minute"),
    "axle_lock": (body.P_LOCK, "from_s"), "crab_axle": (body.P_CRAB, "angle_deg"),
    "boom_wind": (body.P_WIND, "moment_nm"), "furrow_walls": (body.P_FURROW, "side_n"),
    "weak_pump": (body.P_PUMP, "deg_per_s"), "leaky_valve": (body.P_LEAK, "per_s"),
    "pushed_tank": (body.P_TANK, "mass_kg"), "soft_springs": (body.P_SOFT, "ratio"),
}  # fmt: skip
OUTSIDE_SENSORS = ("gyro_scale", "wheel_hysteresis", "mast_spring", "roll_lever", "magnet", "kalman_lag", "grid_scale",
                   "baseline_flex", "rim_speed", "stamp_jitter", "course_heading")  # fmt: skip


def build_parameters(case: TruthCase, index: int = 0) -> tuple[Array, Array]:
    """Parameters of the body in a run (33,) and laws (n, 7). Raises ValueError for an unknown cause outside."""
    base, laws = fill_parameters(case, index, body.PARAMETERS)
    base[body.P_PUMP], base[body.P_LEAK], base[body.P_SOFT] = OIL_DEG_S, 0.001, 1.0
    base[body.P_PULL] = HEAVY_N if "weight_shift" in case.outside else DRAFT_N
    for name, numbers in case.outside.items():
        if name in OUTSIDE_BODY and numbers.get("run", index) == index:
            place, key = OUTSIDE_BODY[name]
            base[place] = math.radians(numbers[key]) if name == "crab_axle" else numbers[key]
        elif name not in (*OUTSIDE_SENSORS, *OUTSIDE_BODY):
            raise ValueError(f"The cause {name!r} is unknown.")
    base[body.P_WIND_TO] = math.radians(case.outside.get("boom_wind", {}).get("bearing_deg", 0.0))
    if "leaky_valve" in case.outside:
        base[P_DEAD_BAND] = max(base[P_DEAD_BAND], 0.5)
    return base, laws


def drive_alone(mech: float, speed: float, seconds: float, side: float = 0.0) -> Array:
    """Rows on even ground without a fault at one mean angle of the front wheels (rad), or with a side force (N)."""
    base, laws = build_parameters(TruthCase("clean", 0))
    base[P_DRAFT] = 1.0 if side else 0.0
    rows, still = int(seconds / ROW_S), np.zeros((1, 4))
    parts = lay_parts((0.0, seconds, 0.0, 0.0, speed, float(side != 0.0)))
    return body.drive_tractor(
        np.zeros(3), parts, np.zeros((rows, 2)), np.zeros(rows), np.zeros((rows, 2)), still, still, 0.0, base, laws,
        np.zeros((rows, 2)), np.zeros(6), np.array([-1.0, 1.0]), np.full(2, mech), side,
    )  # fmt: skip


@lru_cache(maxsize=1)
def calibrate_tractor() -> tuple[Array, Array, float]:
    """Curvatures, the angles (rad) that drive them at 5 km/h, and the hitch's side force (N) per curvature."""

    def find_bend(*alone: float) -> float:
        return measure_curvature(drive_alone(*alone)[int(9.0 / ROW_S) :], body.REAR)

    bends, trial = np.array([find_bend(angle, MAP_SPEED_MPS, 14.0) for angle in CIRCLES_RAD]), -1500.0
    return *mirror_curve(bends, CIRCLES_RAD), trial / find_bend(0.0, MAP_SPEED_MPS, 16.0, trial)


def drive_run(case: TruthCase, parts: Array, bearing_deg: float, index: int) -> Array:
    """Rows of a run every 5 ms before any instrument sees it."""
    rows = int((parts[-1, 1] + MARGIN_S) / ROW_S)
    time = ROW_S * np.arange(rows, dtype=np.float64)
    rng, field = np.random.default_rng([case.seed, index, 54]), np.random.default_rng([case.seed, 55])
    ruts, tilts = (draw_waves(field, size, WAVES, 20.0) for size in (RUT_RAD, TILT_RAD))
    pulses = PULSES * np.column_stack([draw_slow(rng, time, 0.4, time[-1] + 1.1, 40) for _ in range(2)])
    base, laws = build_parameters(case, index)
    start = np.array([*rng.uniform(-8.0, 8.0, 2), math.radians(bearing_deg)])
    return body.drive_tractor(
        start, parts, draw_position_errors(case, index, time, INSTRUMENTS), rng.standard_normal(rows), pulses, ruts,
        tilts, index * find_gap(case), base, laws, mark_broken(case.faults, index, time),
        guide_driver(case), *calibrate_tractor(),
    )  # fmt: skip


def find_gap(case: TruthCase) -> float:
    """Seconds from the start of one run to that of the next: hours where something moves with the day."""
    return 700.0 if any(law.kind == "over_day" for law in case.laws) or "tyre_leak" in case.outside else 180.0


def guide_driver(case: TruthCase) -> Array:
    """What a driver's receiver does: rows that it is late, true and assumed antenna, heading bias (rad)."""
    values, ages = complete(case.effects), find_ages(case, INSTRUMENTS.receiver_s)
    bias = math.radians(values["heading_bias"]["angle_deg"])
    return np.array([*(round(age / ROW_S) for age in ages), *find_antenna(values), ANTENNA_FORWARD_M, bias])


def log_run(case: TruthCase, name: str, parts: Array, bearing_deg: float, index: int) -> pd.DataFrame:
    """A run as its loggers have it, its name in `attrs`."""
    rows = drive_run(case, parts, bearing_deg, index)
    rng, outside = np.random.default_rng([case.seed, index, 52]), case.outside
    speed = rows[:, body.RIM if "rim_speed" in outside else body.SPEED]
    wheel = follow_play(rows[:, body.MOTOR].copy(), outside.get("wheel_hysteresis", {}).get("angle_deg", 0.0))
    east, north, heading, command, down = (
        rows[:, place] for place in (body.EAST, body.NORTH, body.HEADING, body.COMMAND, body.DOWN)
    )
    signals = Signals(ROW_S, index * find_gap(case), east, north, heading, speed, wheel, command, down)
    places = signals.place_antenna(case, index, sway_m=find_lean(case, rows))
    places = spoil_places(case, rows, places + draw_position_errors(case, index, signals.time_s, INSTRUMENTS))
    headings = np.degrees(heading) + signals.follow(case, "heading_bias", index)
    headings = spoil_headings(case, rows, headings, places, rng)
    times = list_row_times(float(parts[-1, 1]), case.rate_hz, INSTRUMENTS, rng)
    columns, now = (
        record_run(case, index, signals, places, headings, times, INSTRUMENTS, rng),
        pick_held(rows, times, ROW_S),
    )
    columns |= {"speed_command_mps": np.abs(now[:, body.TARGET]), "shuttle": now[:, body.GEAR].astype(int),
                "implement": now[:, body.DOWN].astype(int)}  # fmt: skip
    if "stamp_jitter" in outside:
        late = np.minimum(rng.exponential(outside["stamp_jitter"]["time_s"], len(times)), 0.9 / case.rate_hz)
        columns["time_s"] = np.round(columns["time_s"] + late, 3)
    return build_log(name, columns)


def make_fifth_logs(case: TruthCase) -> list[pd.DataFrame]:
    """The logs of a case: one frame per run of its programme, in the columns of a log."""
    runs = build_programme(case.programme, case.seed)
    return [log_run(case, *run, index) for index, run in enumerate(runs)]
