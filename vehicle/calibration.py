"""The steering table that gives a tractor its measured turning radii, from circles driven by the base model.

Eq. 2.9, 2.10 and 5.1 map the physical angle to the angle of the thesis's own base model. On another base model the
invariant is the measured radius, so the table is the inverse of *our* base model's curve, measured here.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from vehicle.circles import CIRCLE_SPEED_MPS, Circle, fixed_circle
from vehicle.errors import VehicleError
from vehicle.ground import GROUNDS, ground_index
from vehicle.learnt import without_logs
from vehicle.tractor import Tractor

BASE_LOCK_DEG = 55.0  # the base model turns further than any tractor, so that every measured radius is found
TABLE_STEPS = 281  # a quarter of a degree apart at a lock of 35
SETTLED_S = 20.0  # of a circle: longer changes its radius by less than a millionth
_SAMPLES_DEG = (1.0, 2.0, 4.0, 7.0, 10.0, 15.0, 20.0, 25.0, 30.0, 35.0, 40.0, 45.0, 50.0, 54.0)
Array = npt.NDArray[np.float64]


def identity_table(lock_deg: float) -> Array:
    """A steering table that changes nothing."""
    return np.radians(np.linspace(-lock_deg, lock_deg, TABLE_STEPS))


@lru_cache(maxsize=16)
def _base_curve(tractor_key: str, ground: int) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Measured over kinematic radius of the base model at the sample angles (degrees)."""
    tractor = Tractor.model_validate_json(tractor_key)
    ratios = []
    for angle in _SAMPLES_DEG:
        radius = base_circle(tractor, angle, ground, SETTLED_S).radius_m
        ratios.append(radius / float(kinematic_radius(tractor, np.array(math.radians(angle)))))
    return _SAMPLES_DEG, tuple(ratios)


def kinematic_radius(tractor: Tractor, angle: Array) -> Array:
    """Radius of the antenna's circle without any slip; `angle` in radians, above zero."""
    return np.hypot(tractor.antenna_forward_m, tractor.wheelbase_m / np.tan(angle))


def steering_table(tractor: Tractor, ground: int) -> Array:
    """Base-model angle (radians) at TABLE_STEPS even steps of the physical angle from -lock to lock.

    A ground without measured radii leaves the angle as it is. Raises VehicleError when the base model cannot turn
    as tightly as was measured.
    """
    name = GROUNDS[ground].name
    lock = tractor.max_steering_deg
    if name not in tractor.radius:
        return identity_table(lock)
    law = tractor.radius[name]
    grid = np.linspace(-lock, lock, TABLE_STEPS)
    wanted = np.array([law.radius_m(float(angle)) for angle in grid])
    return np.copysign(_base_angle(tractor, wanted, ground), grid)


def _base_angle(tractor: Tractor, radius: Array, ground: int) -> Array:
    """Base-model angles (radians, positive) whose circles have the wanted radii, by bisection of the measured curve."""
    samples, ratios = _base_curve(_bare(tractor), ground)

    def reached(angle: Array) -> Array:
        return kinematic_radius(tractor, angle) * np.interp(np.degrees(angle), samples, ratios)

    low, high = np.full(len(radius), 1e-9), np.full(len(radius), math.radians(samples[-1]))
    smallest = float(reached(high[:1])[0])
    if radius.min() < smallest:
        raise VehicleError(
            f"{tractor.name} cannot turn on a radius of {radius.min():.2f} m as measured on {GROUNDS[ground].name}: "
            f"its wheelbase allows {smallest:.2f} m; check the radius values."
        )
    for _ in range(60):
        middle = 0.5 * (low + high)
        wide = reached(middle) > radius
        low, high = np.where(wide, middle, low), np.where(wide, high, middle)
    return np.where(np.isinf(radius), 0.0, 0.5 * (low + high))


def _bare(tractor: Tractor) -> str:
    """The tractor without names, measured radii and what logs taught, as a cache key."""
    bare = without_logs(tractor).model_copy(update={"radius": {}, "source": {}, "name": ""})
    return bare.model_dump_json()


def steering_tables(tractor: Tractor) -> Array:
    """Tables of all grounds, shape (grounds, TABLE_STEPS).

    Measured radii are those of the tractor before logs taught more of it: effects and rest come on top.
    """
    return np.array(_tables(without_logs(tractor).model_dump_json()))


@lru_cache(maxsize=16)
def _tables(tractor_key: str) -> tuple[tuple[float, ...], ...]:
    tractor = Tractor.model_validate_json(tractor_key)
    return tuple(tuple(steering_table(tractor, ground).tolist()) for ground in range(len(GROUNDS)))


def base_circle(
    tractor: Tractor, steering_deg: float, ground: int, seconds: float = 60.0, speed_mps: float = CIRCLE_SPEED_MPS
) -> Circle:
    """The circle of the base model with its own larger lock, the angle handed to it as it is."""
    wide = tractor.model_copy(update={"max_steering_deg": BASE_LOCK_DEG})
    tables = np.array([identity_table(BASE_LOCK_DEG)] * len(GROUNDS))
    return fixed_circle(wide, steering_deg, ground, tables, seconds=seconds, speed_mps=speed_mps)


def drive_circle(
    tractor: Tractor, steering_deg: float, ground: str, *, corrected: bool = True, seconds: float = 60.0,
    speed_mps: float = CIRCLE_SPEED_MPS,
) -> Circle:  # fmt: skip
    """The circle of a tractor at a wheel angle, with effects and rest of its file; uncorrected, of the base model.

    Raises VehicleError for an unknown ground.
    """
    index = ground_index(ground)
    if not corrected:
        return base_circle(tractor, steering_deg, index, seconds, speed_mps)
    return fixed_circle(tractor, steering_deg, index, steering_tables(tractor), seconds=seconds, speed_mps=speed_mps)
