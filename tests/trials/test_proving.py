"""Drives that show whether a tractor file holds together, and files that do not."""

import math
from typing import Any

import pytest

from vehicle.calibration import drive_circle
from vehicle.errors import VehicleError
from vehicle.tractor import PowerLaw, Tractor, load_tractor
from vehicle.trials.proving import ackermann_m, half_circle, lanes
from vehicle.trials.sheets.proved import proved
from vehicle.trials.sheets.sheet import Proof


@pytest.fixture(scope="module")
def eg105() -> Tractor:
    return load_tractor("eg105")


def changed(tractor: Tractor, section: str, **values: Any) -> Tractor:
    return tractor.model_copy(update={section: getattr(tractor, section).model_copy(update=values)})


def wrong(tractor: Tractor) -> list[str]:
    return [proof.drive for proof in proved(tractor)[0].proofs if not proof.good]


@pytest.mark.parametrize("name", ["eg105", "mr1000a"])
def test_the_tractors_that_ship_hold_together(name: str) -> None:
    tractor = load_tractor(name)
    verdict, sheet = proved(tractor)
    assert verdict.holds_together and verdict.words[0].startswith("The file holds together")
    circles = [proof for proof in verdict.proofs if proof.drive.startswith("circle")]
    assert len(circles) == 8
    for proof in circles:
        assert proof.driven == pytest.approx(proof.asked, rel=0.01)
    assert len(sheet.panels) == 4 and len(sheet.tables[0].rows) == len(verdict.proofs)


def test_ackermann_by_hand(eg105: Tractor) -> None:
    assert ackermann_m(eg105) == pytest.approx(math.hypot(1.1, 2.4 / math.tan(math.radians(35.0))))


def test_a_lane_is_reached_and_kept(eg105: Tractor) -> None:
    lane = lanes(eg105)
    assert lane.settled_m is not None and 3.0 < lane.settled_m < 20.0
    late = lane.track[(lane.track[:, 1] > 60.0) & (lane.track[:, 1] < 79.0)]
    assert abs(late[:, 0] - 1.0).max() < 0.05
    assert 0.0 < lane.weaving_m < 0.05  # the receiver errs


def test_the_half_circle_is_that_of_plans(eg105: Tractor) -> None:
    half = half_circle(eg105)
    assert half.radius_m == pytest.approx(1.08 * eg105.smallest_radius_m("soil"))
    assert half.off_m is not None and 0.05 < half.off_m < 0.5


def test_radii_that_do_not_go_with_the_wheelbase_are_found(eg105: Tractor) -> None:
    wide = PowerLaw(right=(0.25, 1.149), left=(0.25, 1.125))
    assert wrong(eg105.model_copy(update={"radius": {"asphalt": wide, "soil": wide}})) == [
        "radius at full lock, by wheelbase and wheel angle and in the file"
    ]


def test_slow_wheels_are_found_in_the_turn(eg105: Tractor) -> None:
    found = wrong(changed(eg105, "steering", rate_deg_per_s=3.0))
    assert any(drive.startswith("half circle") for drive in found)


def test_a_tractor_that_cannot_move_is_found(eg105: Tractor) -> None:
    verdict, _ = proved(changed(eg105, "speed", max_drive_n=100.0))
    assert not verdict.holds_together
    stuck = [proof for proof in verdict.proofs if proof.driven is None]
    assert {"half", "lane"} <= {proof.drive.split()[0] for proof in stuck}
    assert any("not to its end" in text for text in verdict.words)


def test_what_logs_taught_is_said_beside_the_radii(eg105: Tractor) -> None:
    taught = Tractor.model_validate(eg105.model_dump() | {"effects": {"steering_gain": {"value": {"ratio": 0.96}}}})
    verdict, _ = proved(taught)
    assert verdict.holds_together
    # Its path bends 0.96 times as much as commanded.
    radius = drive_circle(taught, 35.0, "soil").radius_m
    assert radius == pytest.approx(eg105.power_law("soil").radius_m(35.0) / 0.96, rel=0.01)
    assert any(f"steering_gain; with that full lock to the right drives {radius:.2f} m" in one for one in verdict.words)


def test_a_file_without_radii_on_soil_is_refused(eg105: Tractor) -> None:
    bare = eg105.model_copy(update={"radius": {"asphalt": eg105.power_law("asphalt")}})
    with pytest.raises(VehicleError, match=r"add \[radius.soil\]"):
        proved(bare)


@pytest.mark.parametrize(
    ("asked", "driven", "good"),
    [(5.0, 5.04, True), (5.0, 4.96, True), (5.0, 5.06, False), (5.0, None, False), (0.0, 0.04, True), (0, 0.06, False)],
)
def test_good_is_within_the_tolerance(asked: float, driven: float | None, good: bool) -> None:
    assert Proof("drive", "soil", "m", asked, driven, 0.05, "").good is good
