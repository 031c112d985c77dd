"""How the vehicle of logs turns, on kinematic truth: front wheels, rear wheels, or a joint (tests.truth.joints)."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pandas as pd
import pytest

from tests.truth.drives import Drive, drive, stairs, steps
from tests.truth.joints import FRONT, JOINT, REAR, Jointed, drive_jointed
from vehicle.identification.diagnosis.diagnose import diagnose_logs
from vehicle.identification.diagnosis.other_vehicles import (
    ARTICULATED,
    REAR_STEERED,
    OtherTurning,
    drop_course_headings,
    find_other_turning,
    measure_turning,
)
from vehicle.identification.diagnosis.results import Diagnosis
from vehicle.identification.logs.directions import COURSE_HEADING
from vehicle.identification.logs.reader import build_log
from vehicle.identification.logs.schema import Log
from vehicle.model.tractor import Tractor, load_tractor

FILE_ANTENNA_M = 1.1
TURNS = (3.0, -3.0, 12.0, -12.0, 20.0, -20.0, 6.0, -16.0, 0.0)
COMPASS_DEG = 4.0


def list_drives(hold_s: float = 5.0) -> tuple[Drive, ...]:
    """Steps at walking pace and faster, and bends at two speeds."""
    pace_s = 2.4 * hold_s
    paces = stairs((pace_s, 0.8), (pace_s, 2.0), (pace_s, 0.8), (pace_s, 2.0))
    return (
        steps(TURNS, hold_s, "slow_steps", 0.9),
        steps(TURNS[::-1], hold_s, "fast_steps", 2.0),
        drive("bends", 4.0 * pace_s, stairs((2.0 * pace_s, 14.0), (2.0 * pace_s, -14.0)), paces),
    )


SHORT = list_drives(10.0 / 3.0)
"""Long enough for a diagnosis of what is easily seen."""


@lru_cache(maxsize=4)
def make_logs(vehicle: Jointed, sensed: bool = True, drives: tuple[Drive, ...] = ()) -> list[Log]:
    runs = [drive_jointed(vehicle, run, number, sensed) for number, run in enumerate(drives or list_drives())]
    return [build_log(run, run.attrs["name"], wheelbase_m=vehicle.base_m) for run in runs]


def make_file(base_m: float, antenna_m: float = FILE_ANTENNA_M) -> Tractor:
    """The tractor file of a vehicle: its wheelbase, and where its antenna is meant to be."""
    tractor = load_tractor("eg105")
    axles = {"front_axle_m": 0.55 * base_m, "rear_axle_m": 0.45 * base_m, "radius": {}, "source": {}}
    return Tractor.model_validate({**tractor.model_dump(), **axles, "antenna_forward_m": antenna_m})


def find_kind(vehicle: Jointed, file_antenna_m: float, sensed: bool = True) -> str | None:
    found = find_other_turning(make_logs(vehicle, sensed=sensed), make_file(vehicle.base_m, file_antenna_m))
    return None if found is None else found.kind


@pytest.mark.parametrize(("base_m", "sensed"), [(1.6, True), (2.4, True), (2.4, False), (3.6, True)])
@pytest.mark.parametrize("off_m", [-0.8, 0.0, 0.5, 1.2])
def test_front_wheels_with_a_displaced_antenna_are_no_other_vehicle(base_m: float, off_m: float, sensed: bool) -> None:
    antenna_m = 0.5 * base_m
    assert find_kind(Jointed(FRONT, base_m, antenna_m + off_m), antenna_m, sensed) is None


def turn_compass(run: pd.DataFrame, bearing_deg: float) -> pd.DataFrame:
    """The run with headings that point COMPASS_DEG too far to the side where `bearing_deg` is on the left."""
    wrong_deg = COMPASS_DEG * np.sin(np.radians(run["heading_deg"] - bearing_deg))
    return run.assign(heading_deg=np.mod(run["heading_deg"] + wrong_deg, 360.0))


@pytest.mark.slow
def test_what_a_compass_does_has_a_hint_and_no_name() -> None:
    runs = [drive_jointed(Jointed(FRONT, 2.4, 1.1), run, number) for number, run in enumerate(SHORT)]
    logs = [build_log(turn_compass(run, 20.0), run.attrs["name"], wheelbase_m=2.4) for run in runs]
    found = diagnose_logs(logs, make_file(2.4), "soil")
    assert "cross_slope_drift" not in found.named and "cross_slope_drift" not in found.tractor.effects
    assert found.known_outside.startswith("The headings are wrong by up to ")
    assert found.hints[0].instrument == "heading" and found.headline.startswith(found.known_outside)


@pytest.mark.parametrize("base_m", [1.6, 2.4, 3.6])
@pytest.mark.parametrize("antenna_m", [0.4, 1.1, 2.0])
def test_rear_wheels_are_told(base_m: float, antenna_m: float) -> None:
    assert find_kind(Jointed(REAR, base_m, antenna_m), antenna_m) == REAR_STEERED


@pytest.mark.parametrize(("front_share", "sensed"), [(0.4, True), (0.5, True), (0.6, True), (0.5, False)])
@pytest.mark.parametrize(("base_m", "antenna_m"), [(1.6, 1.6), (2.6, 1.6), (3.6, 3.0)])
def test_a_joint_is_told_and_measured(base_m: float, antenna_m: float, front_share: float, sensed: bool) -> None:
    logs = make_logs(Jointed(JOINT, base_m, antenna_m, front_share), sensed)
    found, measured = find_other_turning(logs, make_file(base_m, antenna_m)), measure_turning(logs)
    assert found is not None and found.kind == ARTICULATED
    assert measured.joint_share == pytest.approx(1.0 - front_share, abs=max(0.06, 3.0 * measured.joint_error))


def test_the_rear_unit_of_a_joint_turns_against_it() -> None:
    vehicle = Jointed(JOINT, 2.6, 0.6, 0.45, on_rear_unit=True)
    assert find_kind(vehicle, 0.6) == ARTICULATED
    assert measure_turning(make_logs(vehicle)).joint_share == pytest.approx(-0.45, abs=0.06)


def test_without_a_heading_nothing_is_told() -> None:
    logs = [replace(log, heading_deg=None) for log in make_logs(Jointed(JOINT, 2.4, 2.0))]
    assert measure_turning(logs).joint_share is None
    assert find_other_turning(logs, make_file(2.4)) is None


def test_a_model_car_at_the_speed_of_a_tractor_shows_nothing() -> None:
    """In a second it drives ten times its wheelbase, so that nothing of how its wheels moved is left."""
    logs = make_logs(Jointed(FRONT, 2.4, 1.1))
    assert measure_turning(logs).pace_mps == pytest.approx(1.4, abs=0.6)
    assert find_other_turning(logs, make_file(0.175, -0.175 + 1.1)) is None


def test_straight_drives_show_nothing() -> None:
    straight = tuple(drive(f"straight_{number}", 60.0, stairs((60.0, 0.0)), 1.5) for number in range(2))
    assert find_other_turning(make_logs(Jointed(JOINT, 2.4, 2.0), drives=straight), make_file(2.4, 2.0)) is None


def test_effects_of_the_wheel_sensor_keep_their_names() -> None:
    with_sensor, without = (
        find_other_turning(make_logs(Jointed(JOINT, 2.4, 2.0), sensed=sensed), make_file(2.4, 2.0))
        for sensed in (True, False)
    )
    assert with_sensor is not None and without is not None
    assert {"antenna_forward", "steering_gain", "gnss_latency", "clock_offset_steering"} <= with_sensor.faked_ids
    assert "steering_dead_time" not in with_sensor.faked_ids and "wheel_slip" not in without.faked_ids
    assert "steering_dead_time" in without.faked_ids


def test_a_heading_that_is_the_course_is_dropped_and_told() -> None:
    logs = make_logs(Jointed(FRONT, 2.4, 1.1))
    assert drop_course_headings(logs, make_file(2.4)) == logs
    known = [replace(logs[0], corrections=(COURSE_HEADING,)), *logs[1:]]
    dropped = drop_course_headings(known, make_file(2.4))
    assert all(log.heading_deg is None and COURSE_HEADING in log.corrections for log in dropped)


def diagnose(vehicle: Jointed, file_antenna_m: float) -> tuple[Diagnosis, OtherTurning | None]:
    logs, tractor = make_logs(vehicle, drives=SHORT), make_file(vehicle.base_m, file_antenna_m)
    return diagnose_logs(logs, tractor, "soil"), find_other_turning(logs, tractor)


@pytest.mark.slow
def test_a_displaced_antenna_on_front_wheels_is_found() -> None:
    found, turning = diagnose(Jointed(FRONT, 2.4, 0.4), 1.1)
    assert turning is None and found.known_outside == ""
    finding = next(finding for finding in found.findings if finding.id == "antenna_forward")
    assert finding.status in ("named", "likely")
    value = finding.value
    assert value is not None and value["distance_m"] == pytest.approx(-0.7, abs=0.15)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("vehicle", "file_antenna_m"),
    [(Jointed(REAR, 2.4, 1.1), 1.1), pytest.param(Jointed(JOINT, 2.4, 2.0), 2.0, marks=pytest.mark.matrix)],
)
def test_another_vehicle_gets_a_sentence_and_no_antenna(vehicle: Jointed, file_antenna_m: float) -> None:
    found, turning = diagnose(vehicle, file_antenna_m)
    assert turning is not None and found.known_outside == turning.words
    assert found.headline.startswith("These logs look like a vehicle that")
    said = {finding.id for finding in found.findings if finding.value is not None}
    assert not said & turning.faked_ids
    if found.is_savable:
        for horizon, before in found.before.items():
            assert found.after[horizon].cross_cm <= 1.02 * before.cross_cm, horizon
