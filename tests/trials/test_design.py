"""Vehicle design: the statements of section 6.2, and how long 400 drives take."""

import time
from typing import Any

import numpy as np
import pytest

from vehicle.errors import VehicleError
from vehicle.model.ground import get_tyres
from vehicle.trials.drive import replace_steering
from vehicle.trials.fixed_steering import (
    STUDY_LIMITS_DEG,
    STUDY_SLOPES_PER_DEG,
    CentreOfMassSweep,
    TyreMap,
    compute_tyre_maps,
    drive_fixed_steering,
    move_centre_of_mass,
    sweep_centre_of_mass,
)


@pytest.fixture(scope="module")
def maps(eg105: Any) -> tuple[TyreMap, TyreMap]:
    return compute_tyre_maps(eg105)


@pytest.fixture(scope="module")
def sweep(eg105: Any) -> CentreOfMassSweep:
    return sweep_centre_of_mass(eg105)


def test_rear_grip_decides_stability(maps: tuple[TyreMap, TyreMap]) -> None:
    stable = maps[1].stable
    assert 0.2 < stable.mean() < 0.95
    assert (stable[1:] >= stable[:-1]).all() and (stable[:, 1:] >= stable[:, :-1]).all()


def test_the_front_may_not_hold_too_much(maps: tuple[TyreMap, TyreMap]) -> None:
    stable = maps[0].stable
    assert 0.2 < stable.mean() < 0.95
    assert (stable[1:] <= stable[:-1]).all() and (stable[:, 1:] <= stable[:, :-1]).all()


def test_front_grip_decides_the_radius_and_rear_grip_hardly_touches_it(maps: tuple[TyreMap, TyreMap]) -> None:
    front, rear = (found.radius_m[found.stable] for found in maps)
    assert front.max() > 10.0 * front.min()
    assert rear.max() < 1.1 * rear.min()


def test_a_weak_front_turns_where_its_friction_suffices(maps: tuple[TyreMap, TyreMap]) -> None:
    """Far out both axles pull alike, so the radius is v^2 over g times the front friction across the path; past its
    peak the engine's curve passes 0.75 of it.
    """
    radius = maps[0].radius_m[STUDY_SLOPES_PER_DEG.index(0.001), STUDY_LIMITS_DEG.index(1.0)]
    friction = 0.75 * 0.001 * np.cos(np.radians(35.0))
    assert radius == pytest.approx((5.0 / 3.6) ** 2 / (9.80665 * friction), rel=0.05)


def test_a_cell_is_the_drive_it_stands_for(eg105: Any, maps: tuple[TyreMap, TyreMap]) -> None:
    tyres = get_tyres("soil", "nonlinear").model_copy(update={"front_slope_per_deg": 0.012, "front_limit_deg": 3.0})
    alone = drive_fixed_steering(eg105, tyres, (35.0,), seconds=40.0, ahead_m=0.0)[0]
    cell = maps[0].radius_m[STUDY_SLOPES_PER_DEG.index(0.012), STUDY_LIMITS_DEG.index(3.0)]
    assert cell == pytest.approx(alone.radius_m, rel=1e-3)


def test_400_cells_take_under_two_seconds(eg105: Any, maps: tuple[TyreMap, TyreMap]) -> None:
    start = time.process_time()
    compute_tyre_maps(eg105)
    assert time.process_time() - start < 2.0


def test_a_centre_of_mass_to_the_rear_stabilises(sweep: CentreOfMassSweep) -> None:
    stable = np.isfinite(sweep.radius_m)
    assert (stable[:, 1:] >= stable[:, :-1]).all()
    assert not stable[:, 0].any() and stable[:, -1].all()


def test_the_radius_falls_as_the_centre_of_mass_moves_to_the_rear(sweep: CentreOfMassSweep) -> None:
    for radii in sweep.radius_m:
        assert (np.diff(radii[np.isfinite(radii)]) < 0.0).all()


def test_moving_the_mass_keeps_the_wheelbase(eg105: Any) -> None:
    moved = move_centre_of_mass(eg105, 0.9)
    assert moved.front_axle_m == 0.9 and moved.wheelbase_m == pytest.approx(eg105.wheelbase_m)
    assert replace_steering(moved, "none").front_axle_m == 0.9


@pytest.mark.parametrize("place", [0.0, -0.5, 2.4, 3.0])
def test_a_mass_outside_the_wheelbase_is_refused(eg105: Any, place: float) -> None:
    with pytest.raises(VehicleError, match=r"outside the wheelbase of 2\.4 m; use a value between 0 and 2\.4"):
        move_centre_of_mass(eg105, place)
