"""Drives that nobody has made: commands by hand, and a circle that is logged as it is driven."""

import math

import numpy as np
import pytest

from tests.identification.analytic_drives import circle, course, rig
from vehicle.identification.diagnosis.next_drive import (
    DRIVE_PROGRAMMES,
    PROGRAMME_PACE_MPS,
    DriveProgramme,
    build_command_segment,
    find_usual_heading_and_speed,
    simulate_programme,
)
from vehicle.model.tractor import load_tractor

PIECES = ((2.0, 10.0, 1.0, 0.0), (3.0, -5.0, 0.5, 1.0))


def test_a_drive_has_the_commands_of_its_pieces() -> None:
    one = build_command_segment(4, 0.3, PIECES, 2.0, step=0.5)
    assert one.run == 4 and one.time == pytest.approx(np.arange(10) * 0.5) and (one.heading == 0.3).all()
    assert one.command is not None and one.target is not None and one.wheel is None
    assert np.degrees(one.command) == pytest.approx([10.0] * 4 + [-5.0] * 6)
    assert one.target == pytest.approx([2.0] * 4 + [1.0] * 6) and one.working == pytest.approx([0.0] * 4 + [1.0] * 6)
    assert len(one.grids["command"]) == math.ceil(4.5 * 60.0) + 1
    assert np.degrees(one.grids["command"][[119, 121]]) == pytest.approx([10.0, -5.0])


def test_every_drill_lasts_what_its_words_say() -> None:
    assert DriveProgramme("one", "words", ((0.0, PIECES), (180.0, PIECES))).seconds == 10.0
    assert len({drill.id for drill in DRIVE_PROGRAMMES}) == len(DRIVE_PROGRAMMES)
    by_name = {drill.id: drill.seconds for drill in DRIVE_PROGRAMMES}
    assert (by_name["implement-lifted"], by_name["circles"], by_name["four-ways"]) == (30.0, 40.0, 60.0)


def test_a_drill_is_logged_as_it_is_driven() -> None:
    """Two straight passes, the second the other way: each antenna goes its way at the usual pace."""
    drill = DriveProgramme("there", "and back", ((0.0, ((10.0, 0.0, 1.0, 0.0),)), (180.0, ((10.0, 0.0, 1.0, 0.0),))))
    made = simulate_programme(rig(), drill, 0.5, 1.2, {})
    assert made.names == ("pass 1", "pass 2") and [one.run for one in made.segments] == [0, 1]
    for one, heading in zip(made.segments, (0.5, 0.5 - math.pi), strict=True):
        way = np.array([one.east[-1] - one.east[0], one.north[-1] - one.north[0]])
        assert math.atan2(way[1], way[0]) == pytest.approx(math.remainder(heading, 2.0 * math.pi))
        assert np.hypot(*way) == pytest.approx(1.2 * one.time[-1], rel=1e-6)
        assert one.wheel is not None and one.wheel == pytest.approx(np.zeros(one.rows))


def test_a_circle_of_a_drill_has_the_measured_radius() -> None:
    drill = DriveProgramme("circle", "to the right", ((0.0, ((30.0, 15.0, 1.0, 0.0),)),))
    (one,) = simulate_programme(rig(), drill, 0.0, PROGRAMME_PACE_MPS, {}).segments
    late = one.time > 10.0
    way = np.hypot(np.diff(one.east[late]), np.diff(one.north[late])).sum()
    turned = one.heading[late][0] - one.heading[late][-1]
    assert way / turned == pytest.approx(load_tractor("eg105").get_power_law("soil").compute_radius_m(15.0), rel=0.02)


def test_the_usual_drive_is_the_mean_heading_and_the_median_speed() -> None:
    runs = course(circle(0.0, bearing_deg=80.0), circle(0.0, bearing_deg=100.0))
    heading, pace = find_usual_heading_and_speed(runs.segments)
    assert heading == pytest.approx(0.0, abs=1e-9) and pace == pytest.approx(1.5)
