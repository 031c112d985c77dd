"""The plan of the drive to do next: what the programme says, joined by turns, in the metres of the logs."""

import json

import numpy as np
import pytest

from planner.fleet.model.fleet_plan import prepare_fleet_plan
from planner.pipeline.next_drive_plan import build_next_drive_plan
from tests.examples import seldom
from vehicle.identification.diagnosis.next_drive import DRIVE_PROGRAMMES, DriveProgramme
from vehicle.identification.diagnosis.results import NextDrive
from vehicle.identification.logs.reader import read_log
from vehicle.missions.plan import TURN, Leg
from vehicle.missions.plan_file import SavedPlan, parse_saved_plan
from vehicle.model.tractor import load_tractor

BY_ID = {programme.id: programme for programme in DRIVE_PROGRAMMES}


def build(programme: DriveProgramme) -> str:
    drive = NextDrive(programme.id, programme.description, programme.seconds, ("steering_offset", "understeer"), 9.0)
    return build_next_drive_plan(drive, [read_log("sample")], load_tractor("eg105"), "soil")


def list_driven(saved: SavedPlan) -> list[Leg]:
    return [leg for leg in saved.plan.missions[0].legs if leg.task.kind != TURN]


@pytest.mark.parametrize("programme", [*DRIVE_PROGRAMMES[:4], *seldom(*DRIVE_PROGRAMMES[4:])], ids=list(BY_ID))
def test_every_piece_of_the_programme_is_a_leg(programme: DriveProgramme) -> None:
    saved = parse_saved_plan(build(programme))
    pieces = [piece for _, pieces in programme.passes for piece in pieces]
    legs = list_driven(saved)
    assert len(legs) == len(pieces) and len(saved.plan.missions[0].legs) == len(pieces) + len(programme.passes) - 1
    usual = legs[0].speed_mps / pieces[0][2]
    for leg, (seconds, angle, share, working) in zip(legs, pieces, strict=True):
        assert leg.implement is (working > 0.0) and leg.speed_mps == pytest.approx(share * usual)
        # The tractor gathers speed at the start of a pass, and brakes or gathers speed where the speed changes.
        assert leg.length_m == pytest.approx(seconds * leg.speed_mps, abs=max(0.25 * seconds, 2.0))
        courses = np.unwrap(np.arctan2(*np.diff(leg.points, axis=0).T[::-1]))
        turned = float(courses[-1] - courses[len(courses) // 2])  # to the left, once the wheels have arrived
        assert abs(turned) < 0.05 if angle == 0.0 else turned * angle < 0.0


def test_there_and_back_is_the_same_line() -> None:
    there, back = list_driven(parse_saved_plan(build(BY_ID["there-and-back"])))
    np.testing.assert_allclose(back.points[0], there.points[-1], atol=0.05)
    np.testing.assert_allclose(back.points[-1], there.points[0], atol=0.3)


def test_it_begins_where_the_logs_begin_and_a_robot_can_drive_it() -> None:
    log, text = read_log("sample"), build(BY_ID["four-ways"])
    saved = parse_saved_plan(text)
    assert saved.origin_m == pytest.approx((float(log.easting_m[0]), float(log.northing_m[0])), abs=1.0)
    assert prepare_fleet_plan(text).finish_s[0] > BY_ID["four-ways"].seconds
    assert json.loads(text)["notes"]["drive"] == "four-ways"
