"""Circles driven by the base model, and the steering table that gives a tractor its measured turning radii.

Eq. 2.9, 2.10 and 5.1 map the physical angle to the angle of the thesis's own base model. On another base model the
invariant is the measured radius, so the table is the inverse of *our* base model's curve, measured here.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from vehicle.errors import VehicleError
from vehicle.ground import GROUNDS
from vehicle.tractor import Implement, Tractor

CIRCLE_SPEED_MPS = 5.0 / 3.6  # speed of the thesis's experiments
BASE_LOCK_DEG = 55.0
TABLE_STEPS = 281
_SAMPLES_DEG = (1.0, 2.0, 4.0, 7.0, 10.0, 15.0, 20.0, 25.0, 30.0, 35.0, 40.0, 45.0, 50.0, 54.0)
Array = npt.NDArray[np.float64]


def identity_table(lock_deg: float) -> Array:
    """A steering table that changes nothing."""
    return np.radians(np.linspace(-lock_deg, lock_deg, TABLE_STEPS))


@lru_cache(maxsize=16)
def _base_curve(tractor_key: str, ground: int) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Measured over kinematic radius of the base model at the sample angles (degrees)."""
    from vehicle.world import drive_circle  # the world needs this module's tables

    tractor = Tractor.model_validate_json(tractor_key)
    ratios = []
    for angle in _SAMPLES_DEG:
        radius = drive_circle(tractor, angle, GROUNDS[ground].name, corrected=False, seconds=20.0).radius_m
        ratios.append(radius / kinematic_radius(tractor, math.radians(angle)))
    return _SAMPLES_DEG, tuple(ratios)


def kinematic_radius(tractor: Tractor, angle: float) -> float:
    """Radius of the antenna's circle without any slip; `angle` in radians, not zero."""
    return math.hypot(tractor.antenna_forward_m, tractor.wheelbase_m / math.tan(abs(angle)))


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
    angles, ratios = _base_curve(_bare(tractor), ground)
    grid = np.linspace(-lock, lock, TABLE_STEPS)
    return np.array([_invert(tractor, law.radius_m(float(a)), float(a), angles, ratios, name) for a in grid])


def _bare(tractor: Tractor) -> str:
    """The tractor without names and measured radii, as a cache key."""
    return tractor.model_copy(update={"radius": {}, "source": {}, "name": ""}).model_dump_json()


def _invert(
    tractor: Tractor, radius: float, angle_deg: float, angles: Any, ratios: Any, ground: str
) -> float:
    """Base angle (radians, signed) whose circle has the wanted radius, by bisection."""
    if math.isinf(radius):
        return 0.0

    def reached(angle: float) -> float:
        return kinematic_radius(tractor, angle) * float(np.interp(math.degrees(angle), angles, ratios))

    low, high = 1e-9, math.radians(_SAMPLES_DEG[-1])
    if reached(high) > radius:
        raise VehicleError(
            f"{tractor.name} cannot turn on a radius of {radius:.2f} m as measured on {ground} at "
            f"{angle_deg:.1f} deg: its wheelbase allows {reached(high):.2f} m; check the radius values."
        )
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if reached(middle) > radius else (low, middle)
    return math.copysign(0.5 * (low + high), angle_deg)


def steering_tables(tractor: Tractor) -> Array:
    """Tables of all grounds, shape (grounds, TABLE_STEPS)."""
    return np.array([steering_table(tractor, ground) for ground in range(len(GROUNDS))])


DEFAULT_IMPLEMENT = Implement()
