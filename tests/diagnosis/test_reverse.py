"""Runs driven in reverse by both references: replayed as well as those driven forward, and told the same causes."""

from dataclasses import replace

import pytest

from tests.diagnosis.hiding import told
from tests.truth.drives import Drive, constant, reversing, three_speeds_programme
from tests.truth.effects import CLEAR_SIZES
from tests.truth.model import make_logs
from tests.truth.second import second_logs
from vehicle.identification.logs.reader import build_log
from vehicle.identification.replay.drive_segments import build_dataset, build_rig
from vehicle.identification.replay.horizon_errors import compute_horizon_errors, measure_dataset
from vehicle.model.tractor import load_tractor

RUNS = ("there", "back", "right")


def in_reverse(drive: Drive) -> Drive:
    """The same commands in the other gear."""
    return replace(drive, name=f"{drive.name} in reverse", shuttle=constant(-1.0))


@pytest.mark.parametrize("reference", [make_logs, second_logs])
def test_the_way_back_is_replayed_as_well_as_the_way_there(reference) -> None:  # type: ignore[no-untyped-def]
    """The across and heading errors of the tractor that the file describes, over 5 s, by gear."""
    (frame,) = reference({}, 5, [reversing()], rate_hz=10.0)
    course = build_dataset([build_log(frame, "reversing")])
    assert [one.gear for one in course.segments] == [1.0, -1.0, 1.0] and course.rows > 480
    rig = build_rig(load_tractor("eg105"), "soil", course.origin)
    there, back = (
        compute_horizon_errors(
            measure_dataset(
                replace(course, segments=tuple(one for one in course.segments if one.gear == gear)), rig, {}
            )
        )[5.0]
        for gear in (1.0, -1.0)
    )
    assert back.cross_cm < 1.5 * there.cross_cm < 2.5 and back.heading_deg < 1.5 * there.heading_deg < 0.6


@pytest.mark.slow
@pytest.mark.parametrize("gears", ["forward and reverse", pytest.param("reverse", marks=pytest.mark.matrix)])
def test_an_offset_is_named_with_its_sign_in_either_gear(gears: str) -> None:
    drives = [one for one in three_speeds_programme() if one.name in RUNS]
    turned = [in_reverse(one) for one in drives]
    runs = turned if gears == "reverse" else [*drives[:2], turned[2]]
    effect = {"steering_offset": CLEAR_SIZES["steering_offset"]}
    found = told(second_logs(effect, 20261, runs, "eg105"))
    assert found.named == ("steering_offset",)
    assert found.calibration == {}, "what has a name is no correction without one"
    (value,) = (one.value for one in found.findings if one.id == "steering_offset")
    assert value is not None and value["angle_deg"] == pytest.approx(effect["steering_offset"]["angle_deg"], abs=0.25)
