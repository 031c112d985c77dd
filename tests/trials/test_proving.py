"""Checks of tractor files: drives that show whether their values fit together."""

import math
from typing import Any

import pytest

from vehicle.errors import VehicleError
from vehicle.model.tractor import PowerLaw, Tractor, load_tractor
from vehicle.sim.calibration import drive_circle
from vehicle.trials.sheets.sheet import DriveCheck
from vehicle.trials.sheets.tractor_check import check_tractor, drive_half_circle, drive_lane_change


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
