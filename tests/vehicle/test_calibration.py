"""Circles at fixed steering against the measured radii (Eq. 2.9, 2.10, 5.1) and the tables that make them so."""

import math
from typing import Any

import numpy as np
import pytest

from fields.arrays import Floats
from vehicle.errors import VehicleError
from vehicle.model.ground import GROUNDS, list_ground_names
from vehicle.model.tractor import PowerLaw, Tractor, list_tractor_names, load_tractor
from vehicle.sim.calibration import (
    TABLE_STEPS,
    build_identity_table,
    build_steering_table,
    build_steering_tables,
    compute_kinematic_radius,
    drive_circle,
)

ANGLES = (-35.0, -25.0, -15.0, -5.0, 5.0, 15.0, 25.0, 35.0)

# r_p = 118.4 / (c |delta|^p) written out for the tables of THESIS order: right, left at 35 degrees.
AT_FULL_LOCK = {
    ("eg105", "asphalt"): (118.4 / (0.5738437 * 35**1.149), 118.4 / (0.5883685 * 35**1.125)),
    ("eg105", "soil"): (118.4 / (0.4457377 * 35**1.199), 118.4 / (0.3081049 * 35**1.285)),
    ("mr1000a", "soil"): (118.4 / (0.6527535 * 35**1.040), 118.4 / (0.7555497 * 35**1.006)),
}


def fitted_radius(track: Floats) -> float:
    """Least-squares circle: |p|^2 = 2 c.p + (r^2 - |c|^2) is linear in the centre and the bracket."""
    system = np.concatenate([2.0 * track, np.ones((len(track), 1))], axis=1)
    (x, y, rest), *_ = np.linalg.lstsq(system, (track**2).sum(axis=1), rcond=None)
    return math.sqrt(rest + x * x + y * y)


@pytest.mark.parametrize("angle", ANGLES)
@pytest.mark.parametrize("ground", list_ground_names())
@pytest.mark.parametrize("name", list_tractor_names())
def test_circles_have_the_measured_radius(name: str, ground: str, angle: float) -> None:
    tractor = load_tractor(name)
    circle = drive_circle(tractor, angle, ground)
    measured = tractor.get_power_law(ground).compute_radius_m(angle)
    assert circle.radius_m == pytest.approx(measured, rel=0.01)
    assert fitted_radius(circle.antenna_path[-1800:]) == pytest.approx(measured, rel=0.01)


@pytest.mark.parametrize(("name", "ground"), AT_FULL_LOCK)
def test_full_lock_against_the_formulas(name: str, ground: str) -> None:
    tractor = load_tractor(name)
    right, left = AT_FULL_LOCK[name, ground]
    assert drive_circle(tractor, 35.0, ground).radius_m == pytest.approx(right, rel=0.01)
    assert drive_circle(tractor, -35.0, ground).radius_m == pytest.approx(left, rel=0.01)
    assert tractor.compute_smallest_radius_m(ground) == pytest.approx(max(right, left))


def test_radii_of_the_thesis() -> None:
    """Section 2.3.3: 3.75 m to the right and 3.99 m to the left at full lock on soil."""
    law = load_tractor("eg105").get_power_law("soil")
    assert law.compute_radius_m(35.0) == pytest.approx(3.75, abs=0.02)
    assert law.compute_radius_m(-35.0) == pytest.approx(3.99, abs=0.02)
    assert math.isinf(law.compute_radius_m(0.0))


@pytest.mark.parametrize("antenna", [-1.0, 0.0, 1.8, 2.4])
def test_the_radius_holds_wherever_the_antenna_stands(eg105: Tractor, antenna: float) -> None:
    tractor = eg105.model_copy(update={"antenna_forward_m": antenna})
    measured = tractor.get_power_law("soil").compute_radius_m(30.0)
    circle = drive_circle(tractor, 30.0, "soil")
    assert circle.radius_m == pytest.approx(measured, rel=0.01)
    assert fitted_radius(circle.antenna_path[-1800:]) == pytest.approx(measured, rel=0.01)


@pytest.mark.parametrize("angle", [-20.0, 20.0])
def test_positive_angles_turn_right(eg105: Tractor, angle: float) -> None:
    """A circle to the right, from a start heading north, lies east of the start."""
    track = drive_circle(eg105, angle, "soil").antenna_path
    assert np.sign(track[:, 0].mean()) == np.sign(angle)


def test_kinematic_radius_by_hand(eg105: Tractor) -> None:
    # Rear axle centre at 2.4 / tan 45 = 2.4 m, the antenna 1.1 m ahead of it.
    angles = np.radians([45.0, 30.0])
    assert compute_kinematic_radius(eg105, angles) == pytest.approx(
        [math.hypot(2.4, 1.1), math.hypot(2.4 * 3**0.5, 1.1)]
    )


@pytest.mark.parametrize("name", list_tractor_names())
def test_tables_rise_from_lock_to_lock_through_zero(name: str) -> None:
    tables = build_steering_tables(load_tractor(name))
    assert tables.shape == (len(GROUNDS), TABLE_STEPS)
    assert (np.diff(tables, axis=1) > 0.0).all()
    assert (tables[:, TABLE_STEPS // 2] == 0.0).all()


def test_a_ground_without_measurements_leaves_the_angle_alone(eg105: Tractor) -> None:
    bare = eg105.model_copy(update={"radius": {}})
    assert (build_steering_table(bare, 0) == build_identity_table(35.0)).all()
    with pytest.raises(VehicleError, match=r"Yanmar EG105 has no measured turning radii; add them as radius\.soil"):
        bare.get_power_law("soil")
    # Without slip: the wheelbase and the lock, and the antenna 1.1 m ahead of the rear axle.
    assert bare.compute_smallest_radius_m("soil") == pytest.approx(
        math.hypot(1.1, bare.wheelbase_m / math.tan(math.radians(35.0)))
    )
    asphalt_only = eg105.model_copy(update={"radius": {"asphalt": eg105.radius["asphalt"]}})
    with pytest.raises(VehicleError, match=r"are known on 'soil'; use one of: asphalt\."):
        asphalt_only.compute_smallest_radius_m("soil")


@pytest.mark.parametrize("law", [
    PowerLaw(right=(8.0, 1.2), left=(0.5, 1.1)),
    PowerLaw(right=(0.5, 1.1), left=(8.0, 1.2)),
])  # fmt: skip
def test_a_radius_tighter_than_the_wheelbase_allows_is_refused(eg105: Any, law: PowerLaw) -> None:
    tight = eg105.model_copy(update={"radius": {"soil": law}})
    with pytest.raises(
        VehicleError, match=r"cannot turn on a radius of \d\.\d+ m as measured on soil.*; check the radius"
    ):
        build_steering_tables(tight)
