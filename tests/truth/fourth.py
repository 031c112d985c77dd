"""The fourth reference: another body, drive, autosteer and other instruments than all others. Imports nothing it tests.

The machine is in tests.truth.fourth_body, drives in fourth_drives, what its cases are drawn from in menus. What it
shares with the other references are the measured radii of one tractor, the tables of effects and laws, and the
recorder. Machines: the tractor `eg105`, an articulated one of its size, and a lawn tractor (`lawn`).
"""

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import numpy.typing as npt
import pandas as pd

from tests.truth import fourth_body as body
from tests.truth.cases import Law, TruthCase
from tests.truth.drives import Drive
from tests.truth.effects import complete
from tests.truth.fourth_drives import build_programme
from tests.truth.ground import (
    CIRCLES_RAD,
    EG105,
    MAP_SPEED_MPS,
    RADIUS_LAW,
    draw_waves,
    measure_curvature,
    measured_curvature,
    mirror_curve,
)
from tests.truth.laws import P_DRAFT, fill_parameters
from tests.truth.recorder import (
    Instruments,
    Signals,
    build_log,
    draw_position_errors,
    draw_wander,
    find_ages,
    find_antenna,
    list_row_times,
    read_switches,
    record_run,
)
from tests.truth.signals import draw_slow, mark_broken

Array = npt.NDArray[np.float64]
ROW_S = body.STEP_S * body.ROW_STEPS
MARGIN_S = 3.0
GROUND_RAD, WAVES, DRIFT_RAD, DRIFT_S = 0.003, 20, 0.0006, 6.0
INSTRUMENTS = Instruments(
    position_m=0.006, wander_m=0.012, wander_s=40.0, heading_deg=0.06, heading_wander_deg=0.04, heading_wander_s=2.0,
    speed_mps=0.012, wheel_deg=0.04, wheel_digit_deg=0.03, row_jitter_s=0.001, phase_s=(0.012, 0.03), pace_s=0.05,
    fast_pace_s=0.02, send_s=0.005, send_jitter_s=0.002,
)  # fmt: skip
LAWN_C = RADIUS_LAW * math.pi / 180.0 / 1.2  # of a wheelbase of 1.2 m, without slip
MACHINES = {
    "eg105": body.Machine(3500.0, 6000.0, 2.4, 0.97, 1.45, 350.0, 230.0, 2.4, 0.0, False, 400.0, 0.9, 0.40, *EG105),
    "articulated": body.Machine(2150.0, 2600.0, 2.4, 0.1, 1.45, 1700.0, 1500.0, 1.2, 1.2, True, 400.0, 0.9, 0.40,
                                *EG105),
    "lawn": body.Machine(270.0, 75.0, 1.2, 0.45, 0.75, 30.0, 4.0, 1.2, 0.0, False, 25.0, 0.4, 0.15,
                         LAWN_C, 1.0, LAWN_C, 1.0),
}  # fmt: skip
MASS_POINT_M = {"eg105": 1.1, "articulated": 1.1, "lawn": 0.55}
"""The point (m ahead of the rear axle) whose circles the measured radii are, and above which the antenna stands."""
OUTSIDE_PARAMETERS = {
    "tine_grip": (body.P_TINES, "share"),
    "loose_hitch": (body.P_HITCH, "play_m"),
    "engine_droop": (body.P_DROOP, "share"),
    "soft_field": (body.P_FIELD, "share"),
    "furrow_pull": (body.P_FURROW, "angle_deg"),
    "rear_steer": (body.P_REAR_STEER, "ratio"),
    "torque_steer": (body.P_TORQUE, "deg_per_weight"),
    "steering_hunt": (body.P_HUNT, "time_s"),
}
OUTSIDE_INSTRUMENTS = ("gyro_walk", "compass_deviation", "multipath", "antenna_sway", "base_drift", "radar_threshold")


@dataclass(frozen=True, eq=False)
class Drawn:
    """A drive as it was: rows of fourth_body every 5 ms, parameters in force, and when in the day it began."""

    time_s: Array
    rows: Array
    parameters: Array
    clock_s: float


def get_machine_name(case: TruthCase) -> str:
    """Which of MACHINES drives a case."""
    if case.programme == "lawn":
        return "lawn"
    return "articulated" if "articulated" in case.outside else "eg105"


def build_parameters(case: TruthCase, index: int = 0) -> tuple[Array, Array]:
    """Parameters of the machine in a run (29,) and its laws. Raises ValueError for an unknown cause outside."""
    base, laws = fill_parameters(case, index, body.PARAMETERS)
    for name, numbers in case.outside.items():
        if name in OUTSIDE_PARAMETERS:
            place, key = OUTSIDE_PARAMETERS[name]
            base[place] = numbers[key]
        elif name not in (*OUTSIDE_INSTRUMENTS, "articulated"):
            raise ValueError(f"The cause {name!r} is unknown.")
    return base, laws


def drive_held(machine: str, angle_rad: float, speed: float, seconds: float, draft: float = 0.0, moment: float = 1.0,
               effects: dict[str, dict[str, float]] | None = None) -> Array:  # fmt: skip
    """Rows of a drive at one mechanical wheel angle on even ground, the implement down where it pulls aside."""
    base, laws = build_parameters(TruthCase("clean", 0, effects or {}))
    base[P_DRAFT] = draft
    rows = int(seconds / ROW_S)
    table = np.array([-1.0, 1.0]), np.full(2, angle_rad)
    m = MACHINES[machine]
    return body.drive_machine(
        np.zeros(3), np.zeros(rows), np.full(rows, speed), np.full(rows, float(draft != 0.0)), np.zeros(rows),
        np.zeros(rows), np.zeros((1, 4)), 0.0, base, laws, np.zeros((rows, 2)), make_guide(), m, *table, moment,
    )[0]  # fmt: skip


@lru_cache(maxsize=8)
def calibrate_machine(machine: str) -> tuple[Array, Array, float]:
    """Curvatures, the mechanical angles (rad) that drive them at 5 km/h, and the moment per curvature of side draft."""

    def find_bend(*held: float) -> float:
        return measure_curvature(drive_held(machine, *held)[int(8.0 / ROW_S) :], MASS_POINT_M[machine])

    bends = np.array([find_bend(angle, MAP_SPEED_MPS, 12.0) for angle in CIRCLES_RAD])
    trial = 0.006 * 4e5 * MACHINES[machine].mass / 3500.0
    return *mirror_curve(bends, CIRCLES_RAD), trial / find_bend(0.0, MAP_SPEED_MPS, 14.0, 1.0, trial)


def make_guide(**fields: float) -> body.Guide:
    """A guide that is off, but for the fields given."""
    plain = {"closed": False, "east": 0.0, "north": 0.0, "bearing": 0.0, "position_late": 4, "heading_late": 4,
             "forward": 1.1, "right": 0.0, "reach": 3.4, "bias": 0.0}  # fmt: skip
    return body.Guide(**(plain | fields))  # type: ignore[arg-type]


def draw_run(case: TruthCase, drive: Drive, index: int, quiet: bool = False) -> Drawn:
    """A run of a case before any instrument sees it; `quiet` leaves out the disturbances of the ground."""
    rng, name = np.random.default_rng([case.seed, index, 41]), get_machine_name(case)
    machine, rows = MACHINES[name], int((drive.duration_s + MARGIN_S) / ROW_S)
    time: Array = ROW_S * np.arange(rows, dtype=np.float64)
    bearing = math.radians(rng.uniform(0.0, 360.0) if drive.bearing_deg is None else drive.bearing_deg)
    start = place_start(drive, machine, bearing, rng.uniform(-8.0, 8.0, 2))
    waves = draw_waves(np.random.default_rng([case.seed, 40]), 0.0 if quiet else GROUND_RAD, WAVES, 15.0)
    drift = (0.0 if quiet else DRIFT_RAD) * draw_slow(rng, time, DRIFT_S, rows * ROW_S + 2.0 * DRIFT_S, 2)
    seen = (0.0 if quiet else 0.006) * rng.standard_normal(rows)
    base, laws = build_parameters(case, index)
    clock = index * find_gap(case)
    target = drive.speed(time) * drive.shuttle(time)
    rows_of, kept = body.drive_machine(
        np.array([*start, bearing]), drive.steering(time), target, drive.implement(time), seen, drift, waves, clock,
        base, laws, mark_broken(case.faults, index, time), guide_run(case, drive, (*start, bearing)), machine,
        *calibrate_machine(name),
    )  # fmt: skip
    return Drawn(time, rows_of, kept, clock)


def find_gap(case: TruthCase) -> float:
    """Seconds from the start of one run to that of the next: an hour is covered where something moves with the day."""
    return 900.0 if any(law.kind == "over_day" for law in case.laws) else 100.0


def guide_run(case: TruthCase, drive: Drive, start: tuple[float, float, float]) -> body.Guide:
    """The line of a closed loop, seen as late and as wrong as the instruments see it."""
    values, ages = complete(case.effects), find_ages(case, 4 * ROW_S)
    forward, right = find_antenna(values, MASS_POINT_M[get_machine_name(case)])
    return make_guide(
        closed=drive.closed_loop, east=start[0], north=start[1], bearing=start[2],
        position_late=round(ages[0] / ROW_S), heading_late=round(ages[1] / ROW_S),
        forward=forward, right=right, bias=math.radians(values["heading_bias"]["angle_deg"]),
        reach=3.4 if get_machine_name(case) != "lawn" else 1.8,
    )  # fmt: skip


def place_start(drive: Drive, machine: body.Machine, bearing: float, shift: Array) -> tuple[float, float]:
    """Where to start for the middle of the run, roughly known beforehand, to be at `shift`."""
    time = np.arange(0.0, drive.duration_s, 0.1)
    angle = np.zeros(len(time)) if drive.closed_loop else drive.steering(time)
    bend = np.array([measured_curvature(float(one), machine) for one in angle])
    way = 0.1 * drive.speed(time) * drive.shuttle(time)
    heading = bearing + np.cumsum(way * bend)
    east, north = np.cumsum(way * np.sin(heading)), np.cumsum(way * np.cos(heading))
    middle = 0.5 * (np.min(east) + np.max(east)), 0.5 * (np.min(north) + np.max(north))
    return float(shift[0] - middle[0]), float(shift[1] - middle[1])


def log_run(case: TruthCase, drive: Drive, index: int, tool: Instruments = INSTRUMENTS) -> pd.DataFrame:
    """A run as its instruments log it, the name of the drive in `attrs`."""
    drawn = draw_run(case, drive, index, quiet=tool == Instruments())
    rng, rows, time = np.random.default_rng([case.seed, index, 42]), drawn.rows, drawn.time_s
    east, north, heading, motor, speed, command = (
        rows[:, place] for place in (body.EAST, body.NORTH, body.HEADING, body.MOTOR, body.SPEED, body.COMMAND)
    )
    signals = Signals(ROW_S, drawn.clock_s, east, north, heading, speed, motor, command, drive.implement(time))
    sway_m = case.outside.get("antenna_sway", {}).get("m_per_mps2", 0.0) * rows[:, body.SIDE]
    places = signals.place_antenna(case, index, MASS_POINT_M[get_machine_name(case)], sway_m)
    places += draw_position_errors(case, index, time, tool)
    places = spoil_places(case, places, time)
    headings = np.degrees(heading) + signals.follow(case, "heading_bias", index)
    times = list_row_times(drive.duration_s, case.rate_hz, tool, rng)
    columns = record_run(case, index, signals, places, spoil_headings(case, headings, time, rng), times, tool, rng)
    if "radar_threshold" in case.outside:
        low = case.outside["radar_threshold"]["speed_mps"]
        columns["speed_mps"] = np.where(columns["speed_mps"] < low, 0.0, columns["speed_mps"] - 0.15 * low)
    return build_log(drive.name, columns | read_switches(drive, times))


def spoil_places(case: TruthCase, places: Array, time: Array) -> Array:
    """Positions (k, 2) with what reflections at a place and a wandering base add."""
    out = places.copy()
    for axis, phase in enumerate((0.0, 1.7)):
        own, other = places[:, axis], places[:, 1 - axis]
        if "multipath" in case.outside:
            size = case.outside["multipath"]["size_m"] * (own + other > 0.0)
            out[:, axis] += size * np.sin(own / 2.1 + phase) * np.sin(other / 1.7 + 2.0 * phase)
        if "base_drift" in case.outside:
            drift = case.outside["base_drift"]
            out[:, axis] += drift["size_m"] * np.sin(2.0 * math.pi * time / drift["period_s"] + phase)
    return out


def spoil_headings(case: TruthCase, headings_deg: Array, time: Array, rng: np.random.Generator) -> Array:
    """Headings (k,) with what a gyroscope that walks and a compass that deviates add."""
    out = headings_deg
    if "gyro_walk" in case.outside:
        out = out + case.outside["gyro_walk"]["size_deg"] * draw_wander(rng, time, 12.0)
    if "compass_deviation" in case.outside:
        compass = case.outside["compass_deviation"]
        out = out + compass["size_deg"] * np.sin(np.radians(headings_deg - compass["bearing_deg"]))
    return out


def make_fourth_logs(case: TruthCase) -> list[pd.DataFrame]:
    """The logs of a case: one frame per run of its programme, in the columns of a log."""
    drives = build_programme(case.programme, case.seed)
    return [log_run(case, drive, index) for index, drive in enumerate(drives)]


def make_unseen_case(case: TruthCase, seed: int) -> TruthCase:
    """The same truth with other draws of ground, noise and drives; what befell single runs is left out."""
    laws = tuple(
        Law(law.effect, "constant", {"value": law.values["other"]}) if law.kind == "by_run" else law
        for law in case.laws
    )
    return replace(case, seed=seed, laws=laws, faults=())
