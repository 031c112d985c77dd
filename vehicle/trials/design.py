"""Vehicle design (section 6.2): tyres and the place of the centre of mass, 35 degrees at 5 km/h."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vehicle.circles import CIRCLE_SPEED_MPS
from vehicle.errors import VehicleError
from vehicle.ground import Tyres, tyres_on
from vehicle.tractor import Tractor
from vehicle.trials.drive import Trace, drive_steered, with_steering
from vehicle.trials.fixed import ANGLES_DEG, own_limit, step_commands
from vehicle.trials.oversteer import settled_radius

Array = npt.NDArray[np.float64]
LIMITS_DEG = tuple(float(limit) for limit in range(1, 11))
SLOPES_PER_DEG = tuple(round(0.001 * step, 3) for step in range(1, 21))
STEERING_DEG, SECONDS, KEEP = 35.0, 40.0, 6
AXLES = ("front", "rear")
MASS_STEPS = 11
NEAREST_M = 0.7  # the centre of mass stays this far from either axle


@dataclass(frozen=True, eq=False)
class TyreMap:
    """Radius (m) of the centre of mass per slope (rows) and limit (columns) of one axle's tyres; nan is oversteer."""

    axle: str
    slopes_per_deg: tuple[float, ...]
    limits_deg: tuple[float, ...]
    radius_m: Array

    @property
    def stable(self) -> npt.NDArray[np.bool_]:
        """Where the tractor settles."""
        return np.isfinite(self.radius_m)


@dataclass(frozen=True, eq=False)
class MassSweep:
    """Radius (m) of the centre of mass per steering angle (rows) and its distance behind the front axle (columns)."""

    front_axle_m: tuple[float, ...]
    angles_deg: tuple[float, ...]
    radius_m: Array
    tracks: tuple[Trace, ...]  # at the last angle, one per place


def tyre_maps(
    tractor: Tractor, *, tyres: Tyres | None = None, shared_limit: bool = False, speed_mps: float = CIRCLE_SPEED_MPS,
    steering_deg: float = STEERING_DEG,
) -> tuple[TyreMap, TyreMap]:  # fmt: skip
    """Vary the front tyres with the rear ones of section 4.3, and the rear with the front: 400 drives, one call.

    `tyres` are what is varied; with `shared_limit` drive and side force of the rear tyres share their side limit.
    """
    base = tyres or tyres_on("soil", "nonlinear")
    grid = [(slope, limit) for slope in SLOPES_PER_DEG for limit in LIMITS_DEG]
    cells = [
        base.model_copy(update={f"{axle}_slope_per_deg": slope, f"{axle}_limit_deg": limit})
        for axle in AXLES
        for slope, limit in grid
    ]
    if shared_limit:
        cells = [own_limit(cell) for cell in cells]
    tracks = _drive([tractor] * len(cells), cells, [steering_deg] * len(cells), speed_mps)
    radii = np.array([settled_radius(track, 0.0) for track in tracks])
    shape = (len(AXLES), len(SLOPES_PER_DEG), len(LIMITS_DEG))
    front, rear = radii.reshape(shape)
    return (
        TyreMap(AXLES[0], SLOPES_PER_DEG, LIMITS_DEG, front),
        TyreMap(AXLES[1], SLOPES_PER_DEG, LIMITS_DEG, rear),
    )


def mass_sweep(
    tractor: Tractor, *, tyres: Tyres | None = None, speed_mps: float = CIRCLE_SPEED_MPS,
    angles_deg: Sequence[float] = ANGLES_DEG,
) -> MassSweep:  # fmt: skip
    """Move the centre of mass from near the front axle to near the rear one."""
    base = tractor.wheelbase_m
    places = tuple(float(place) for place in np.linspace(NEAREST_M, base - NEAREST_M, MASS_STEPS))
    moved = [moved_mass(tractor, place) for place in places]
    tractors = moved * len(angles_deg)
    angles = [angle for angle in angles_deg for _ in places]
    chosen = tyres or tyres_on("soil", "nonlinear")
    tracks = _drive(tractors, [chosen] * len(tractors), angles, speed_mps)
    radii = np.array([settled_radius(track, 0.0) for track in tracks]).reshape(len(angles_deg), len(places))
    return MassSweep(places, tuple(angles_deg), radii, tuple(tracks[-len(places) :]))


def moved_mass(tractor: Tractor, front_axle_m: float) -> Tractor:
    """The tractor with its centre of mass so far behind the front axle; raises VehicleError outside the wheelbase."""
    base = tractor.wheelbase_m
    if not 1e-6 < front_axle_m < base - 1e-6:
        raise VehicleError(
            f"A centre of mass {front_axle_m:g} m behind the front axle is outside the wheelbase of {base:g} m; "
            f"use a value between 0 and {base:g}."
        )
    changes = {"front_axle_m": front_axle_m, "rear_axle_m": base - front_axle_m}
    return tractor.model_copy(update=changes)


def _drive(
    tractors: Sequence[Tractor], tyres: Sequence[Tyres], angles_deg: Sequence[float], speed_mps: float
) -> list[Trace]:
    direct = {id(tractor): with_steering(tractor, "none") for tractor in tractors}
    commands = step_commands(angles_deg, SECONDS)
    return drive_steered([direct[id(t)] for t in tractors], tyres, commands, speed_mps=speed_mps, keep=KEEP)
