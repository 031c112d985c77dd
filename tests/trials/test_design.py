"""Vehicle design: the statements of section 6.2, and how long 400 drives take."""

import math
import time
from typing import Any

import numpy as np
import pytest

from vehicle.errors import VehicleError
from vehicle.model.ground import get_tyres
from vehicle.model.tractor import PowerLaw, Tractor, load_tractor
from vehicle.sim.calibration import drive_circle
from vehicle.trials.drive import replace_steering
from vehicle.trials.fixed_steering import (
    STUDY_LIMITS_DEG,
    STUDY_SLOPES_PER_DEG,
    RadiusMap,
    compute_tyre_maps,
    drive_fixed_steering,
    move_centre_of_mass,
    sweep_centre_of_mass,
)
from vehicle.trials.sheets.sheet import DriveCheck
from vehicle.trials.sheets.tractor_check import check_tractor, drive_half_circle, drive_lane_change


@pytest.fixture(scope="module")
def maps(eg105: Any) -> tuple[RadiusMap, RadiusMap]:
    return compute_tyre_maps(eg105)


@pytest.fixture(scope="module")
def sweep(eg105: Any) -> RadiusMap:
    return sweep_centre_of_mass(eg105)


def test_rear_grip_decides_stability(maps: tuple[RadiusMap, RadiusMap]) -> None:
    stable = maps[1].stable
    assert 0.2 < stable.mean() < 0.95
    assert (stable[1:] >= stable[:-1]).all() and (stable[:, 1:] >= stable[:, :-1]).all()


def test_the_front_may_not_hold_too_much(maps: tuple[RadiusMap, RadiusMap]) -> None:
    stable = maps[0].stable
    assert 0.2 < stable.mean() < 0.95
    assert (stable[1:] <= stable[:-1]).all() and (stable[:, 1:] <= stable[:, :-1]).all()


def test_front_grip_decides_the_radius_and_rear_grip_hardly_touches_it(maps: tuple[RadiusMap, RadiusMap]) -> None:
    front, rear = (found.radius_m[found.stable] for found in maps)
    assert front.max() > 10.0 * front.min()
    assert rear.max() < 1.1 * rear.min()


def test_a_weak_front_turns_where_its_friction_suffices(maps: tuple[RadiusMap, RadiusMap]) -> None:
    """Far out both axles pull alike, so the radius is v^2 over g times the front friction across the path; past its
    peak the engine's curve passes 0.75 of it.
    """
    radius = maps[0].radius_m[STUDY_SLOPES_PER_DEG.index(0.001), STUDY_LIMITS_DEG.index(1.0)]
    friction = 0.75 * 0.001 * np.cos(np.radians(35.0))
    assert radius == pytest.approx((5.0 / 3.6) ** 2 / (9.80665 * friction), rel=0.05)


def test_a_cell_is_the_drive_it_stands_for(eg105: Any, maps: tuple[RadiusMap, RadiusMap]) -> None:
    tyres = get_tyres("soil", "nonlinear").model_copy(update={"front_slope_per_deg": 0.012, "front_limit_deg": 3.0})
    alone = drive_fixed_steering(eg105, tyres, (35.0,), seconds=40.0, ahead_m=0.0)[0]
    cell = maps[0].radius_m[STUDY_SLOPES_PER_DEG.index(0.012), STUDY_LIMITS_DEG.index(3.0)]
    assert cell == pytest.approx(alone.radius_m, rel=1e-3)


def test_400_cells_take_under_two_seconds(eg105: Any, maps: tuple[RadiusMap, RadiusMap]) -> None:
    start = time.process_time()
    compute_tyre_maps(eg105)
    assert time.process_time() - start < 2.0


def test_a_centre_of_mass_to_the_rear_stabilises(sweep: RadiusMap) -> None:
    stable = np.isfinite(sweep.radius_m)
    assert (stable[:, 1:] >= stable[:, :-1]).all()
    assert not stable[:, 0].any() and stable[:, -1].all()


def test_the_radius_falls_as_the_centre_of_mass_moves_to_the_rear(sweep: RadiusMap) -> None:
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


# --- Checks of tractor files: drives that show whether their values fit together ---


def changed(tractor: Tractor, section: str, **values: Any) -> Tractor:
    return tractor.model_copy(update={section: getattr(tractor, section).model_copy(update=values)})


def wrong(tractor: Tractor) -> list[str]:
    return [proof.drive for proof in check_tractor(tractor)[0].checks if not proof.is_good]


@pytest.mark.parametrize("name", ["eg105", "mr1000a"])
def test_the_values_of_shipped_tractors_fit_together(name: str) -> None:
    tractor = load_tractor(name)
    verdict, sheet = check_tractor(tractor)
    assert verdict.holds_together and verdict.words[0].startswith("The values fit together")
    circles = [proof for proof in verdict.checks if proof.drive.startswith("circle")]
    assert len(circles) == 8
    for proof in circles:
        assert proof.driven == pytest.approx(proof.expected, rel=0.01)
    assert len(sheet.panels) == 4 and len(sheet.tables[0].rows) == len(verdict.checks)


def test_ackermann_by_hand(eg105: Tractor) -> None:
    assert eg105.ackermann_radius_m == pytest.approx(math.hypot(1.1, 2.4 / math.tan(math.radians(35.0))))


def test_a_lane_is_reached_and_held(eg105: Tractor) -> None:
    lane = drive_lane_change(eg105)
    assert lane.settled_m is not None and 3.0 < lane.settled_m < 20.0
    late = lane.path[(lane.path[:, 1] > 60.0) & (lane.path[:, 1] < 79.0)]
    assert abs(late[:, 0] - 1.0).max() < 0.05
    assert 0.0 < lane.weaving_m < 0.05  # the receiver errs


def test_the_half_circle_is_that_of_plans(eg105: Tractor) -> None:
    half = drive_half_circle(eg105)
    assert half.radius_m == pytest.approx(1.08 * eg105.compute_smallest_radius_m("soil"))
    assert half.deviation_m is not None and 0.05 < half.deviation_m < 0.5


def test_radii_that_do_not_fit_the_wheelbase_are_found(eg105: Tractor) -> None:
    wide = PowerLaw(right=(0.25, 1.149), left=(0.25, 1.125))
    assert wrong(eg105.model_copy(update={"radius": {"asphalt": wide, "soil": wide}})) == [
        "radius at full lock, from wheelbase and wheel angle and in the file"
    ]


def test_slow_wheels_are_found_in_the_turn(eg105: Tractor) -> None:
    found = wrong(changed(eg105, "steering", rate_deg_per_s=3.0))
    assert any(drive.startswith("half circle") for drive in found)


def test_a_tractor_that_cannot_move_is_found(eg105: Tractor) -> None:
    verdict, _ = check_tractor(changed(eg105, "speed", max_drive_n=100.0))
    assert not verdict.holds_together
    stuck = [proof for proof in verdict.checks if proof.driven is None]
    assert {"half", "lane"} <= {proof.drive.split()[0] for proof in stuck}
    assert any("not finished" in text for text in verdict.words)


def test_effects_from_logs_are_mentioned_with_the_radii(eg105: Tractor) -> None:
    corrected = Tractor.model_validate(eg105.model_dump() | {"effects": {"steering_gain": {"value": {"ratio": 0.96}}}})
    verdict, _ = check_tractor(corrected)
    assert verdict.holds_together
    # Its path bends 0.96 times as much as commanded.
    radius = drive_circle(corrected, 35.0, "soil").radius_m
    assert radius == pytest.approx(eg105.get_power_law("soil").compute_radius_m(35.0) / 0.96, rel=0.01)
    assert any(f"steering_gain; with them full lock to the right drives {radius:.2f} m" in one for one in verdict.words)


def test_a_file_without_radii_on_soil_is_refused(eg105: Tractor) -> None:
    bare = eg105.model_copy(update={"radius": {"asphalt": eg105.get_power_law("asphalt")}})
    with pytest.raises(VehicleError, match=r"add \[radius.soil\]"):
        check_tractor(bare)


@pytest.mark.parametrize(
    ("expected", "driven", "good"),
    [(5.0, 5.04, True), (5.0, 4.96, True), (5.0, 5.06, False), (5.0, None, False), (0.0, 0.04, True), (0, 0.06, False)],
)
def test_good_is_within_the_tolerance(expected: float, driven: float | None, good: bool) -> None:
    assert DriveCheck("drive", "soil", "m", expected, driven, 0.05, "").is_good is good
