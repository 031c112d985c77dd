"""The steering table that gives a tractor its measured turning radii, from circles driven with the base model.

Eq. 2.9, 2.10 and 5.1 map the physical angle to the angle of the thesis's own base model. For another base model the
invariant is the measured radius, so the table inverts the curve of this base model, which is measured here by driving
one body at fixed wheel angles.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from fields.arrays import ANGLE_STEP_RAD, Floats, Records, build_directions, round_to_steps
from fields.units import KMH_PER_MPS
from vehicle.errors import VehicleError
from vehicle.model.ground import GROUNDS, find_ground_index
from vehicle.model.tractor import Implement, Tractor, remove_log_corrections
from vehicle.records import BODY_ANGLE, BODY_PLACE, BODY_SPIN, BODY_VELOCITY, BODY_WIDTH, DT_S, STATE
from vehicle.sim.compile import build_ground_records, build_model_record
from vehicle.sim.loop import run_fixed
from vehicle.sim.pymunk_bridge import PymunkEngine, create_body, create_space

CIRCLE_SPEED_MPS = 5.0 / KMH_PER_MPS  # speed of the thesis's experiments
MEASURED_STEPS = round(1.0 / DT_S)  # the last second, when the circle has settled
BASE_LOCK_DEG = 55.0  # more than any tractor, so that the base model reaches every measured radius
TABLE_STEPS = 281  # a quarter of a degree apart at a lock of 35
SETTLING_TIME_S = 20.0  # of a circle: longer changes its radius by less than a millionth
SAMPLE_ANGLES_DEG = (1.0, 2.0, 4.0, 7.0, 10.0, 15.0, 20.0, 25.0, 30.0, 35.0, 40.0, 45.0, 50.0, 54.0)


@dataclass(frozen=True)
class SteeringCircle:
    """A drive with a fixed steering angle: the path of the antenna (t, 2) and the radius (m) of its circle."""

    antenna_path: Floats
    radius_m: float


def drive_circle_with_tables(
    tractor: Tractor, steering_deg: float, ground: int, tables: Records, *, seconds: float, speed_mps: float
) -> SteeringCircle:
    """Drive with the wheels at a fixed angle and measure the circle of the antenna over the last second.

    `ground` is its index in vehicle.model.ground.GROUNDS, `tables` (grounds, n) are steering tables.
    """
    space = create_space()
    engine = PymunkEngine(space, [create_body(space, tractor, (0.0, 0.0, math.pi / 2))])
    states = np.zeros(1, dtype=STATE)
    # The wheels start at the angle: Eq. 2.8 would stop up to its dead band short of it.
    states["command"] = states["steering"] = math.radians(steering_deg)
    states["target_speed"] = speed_mps
    states["stage"] = 1
    steps = round(seconds / DT_S)
    body_rows = np.empty((steps, BODY_WIDTH))
    models, grounds = np.array([build_model_record(tractor, Implement())]), build_ground_records()
    run_fixed(steps, DT_S, engine.bridge, states, models, grounds, ground, tables, body_rows)
    antenna_path = body_rows[:, BODY_PLACE] + tractor.guide_m * build_directions(body_rows[:, BODY_ANGLE])
    last_rows = body_rows[-MEASURED_STEPS:]
    spin, facing = last_rows[:, BODY_SPIN], last_rows[:, BODY_ANGLE]
    aside = build_directions(facing + 0.5 * math.pi)
    velocity = last_rows[:, BODY_VELOCITY] + tractor.guide_m * spin[:, None] * aside
    radius_m = np.hypot(*velocity.T) / np.maximum(np.abs(spin), 1e-12)
    return SteeringCircle(antenna_path, float(radius_m.mean()))


def build_identity_table(lock_deg: float) -> Floats:
    """A steering table that changes nothing."""
    return np.radians(np.linspace(-lock_deg, lock_deg, TABLE_STEPS))


@lru_cache(maxsize=16)
def _measure_base_radius_ratios(tractor_key: str, ground: int) -> tuple[float, ...]:
    """The measured radius of the base model at SAMPLE_ANGLES_DEG over the kinematic one."""
    tractor = Tractor.model_validate_json(tractor_key)
    ratios = []
    for angle in SAMPLE_ANGLES_DEG:
        radius = drive_base_circle(tractor, angle, ground, SETTLING_TIME_S).radius_m
        ratios.append(radius / float(compute_kinematic_radius(tractor, np.array(math.radians(angle)))))
    return tuple(ratios)


def compute_kinematic_radius(tractor: Tractor, angle: Floats) -> Floats:
    """Radius of the antenna's circle without any slip; `angle` in radians, above zero."""
    return np.hypot(tractor.antenna_forward_m, tractor.wheelbase_m / np.tan(angle))


def build_steering_table(tractor: Tractor, ground: int) -> Floats:
    """Base-model angle (radians) at TABLE_STEPS evenly spaced physical angles from -lock to lock.

    On a ground without measured radii the angles are equal. Raises VehicleError if the base model cannot turn as
    tightly as was measured.
    """
    name = GROUNDS[ground].name
    lock = tractor.max_steering_deg
    if name not in tractor.radius:
        return build_identity_table(lock)
    law = tractor.radius[name]
    grid = np.linspace(-lock, lock, TABLE_STEPS)
    target_radius_m = np.array([law.compute_radius_m(float(angle)) for angle in grid])
    return np.copysign(_invert_base_curve(tractor, target_radius_m, ground), grid)


def _invert_base_curve(tractor: Tractor, radius: Floats, ground: int) -> Floats:
    """Base-model angles (radians, positive) whose circles have these radii (m), by bisection of the measured curve."""
    # Without names, measured radii and corrections from logs, which change nothing here, as a key of the cache.
    bare = remove_log_corrections(tractor).model_copy(update={"radius": {}, "source": {}, "name": ""})
    ratios = _measure_base_radius_ratios(bare.model_dump_json(), ground)

    def compute_radius(angle: Floats) -> Floats:
        return compute_kinematic_radius(tractor, angle) * np.interp(np.degrees(angle), SAMPLE_ANGLES_DEG, ratios)

    low, high = np.full(len(radius), 1e-9), np.full(len(radius), math.radians(SAMPLE_ANGLES_DEG[-1]))
    smallest = float(compute_radius(high[:1])[0])
    if radius.min() < smallest:
        raise VehicleError(
            f"{tractor.name} cannot turn on a radius of {radius.min():.2f} m as measured on {GROUNDS[ground].name}: "
            f"its wheelbase allows {smallest:.2f} m; check the radius values."
        )
    for _ in range(60):
        middle = 0.5 * (low + high)
        is_too_wide = compute_radius(middle) > radius
        low, high = np.where(is_too_wide, middle, low), np.where(is_too_wide, high, middle)
    return round_to_steps(np.where(np.isinf(radius), 0.0, 0.5 * (low + high)), ANGLE_STEP_RAD)


def build_steering_tables(tractor: Tractor) -> Floats:
    """Tables of all grounds, shape (grounds, TABLE_STEPS).

    Corrections from logs do not change the tables: the simulation applies them in addition.
    """
    return np.array(_build_cached_steering_tables(remove_log_corrections(tractor).model_dump_json()))


@lru_cache(maxsize=16)
def _build_cached_steering_tables(tractor_key: str) -> tuple[tuple[float, ...], ...]:
    tractor = Tractor.model_validate_json(tractor_key)
    return tuple(tuple(build_steering_table(tractor, ground).tolist()) for ground in range(len(GROUNDS)))


def drive_base_circle(
    tractor: Tractor, steering_deg: float, ground: int, seconds: float = 60.0, speed_mps: float = CIRCLE_SPEED_MPS
) -> SteeringCircle:
    """The circle of the base model with its own larger lock and an uncorrected angle."""
    wide_tractor = tractor.model_copy(update={"max_steering_deg": BASE_LOCK_DEG})
    tables = np.array([build_identity_table(BASE_LOCK_DEG)] * len(GROUNDS))
    return drive_circle_with_tables(wide_tractor, steering_deg, ground, tables, seconds=seconds, speed_mps=speed_mps)


def drive_circle(tractor: Tractor, steering_deg: float, ground: str, seconds: float = 60.0) -> SteeringCircle:
    """The circle of a tractor with the corrections of its file. Raises VehicleError for an unknown ground."""
    index, tables = find_ground_index(ground), build_steering_tables(tractor)
    return drive_circle_with_tables(tractor, steering_deg, index, tables, seconds=seconds, speed_mps=CIRCLE_SPEED_MPS)
