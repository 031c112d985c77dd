"""Moves driven with the lines that they join: alike ones once, many at once as if each were alone."""

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely

from fields.geometry.field import Field
from planner.evaluation.preparation import prepare_context
from planner.evaluation.site import get_site_moves
from planner.evaluation.work_order import WorkOrder
from planner.request.plan_request import PlanRequest
from strategies.moves.drives import LEADS_M, MoveDrives, Passage, measure_settling
from strategies.moves.move import Move
from strategies.path_planning.paths import Pose
from strategies.site.site import Site
from vehicle.missions.plan import Plan
from vehicle.missions.run import SimulationRun

pytestmark = pytest.mark.usefixtures("first_layout")

STRETCH_M = 40.0


@pytest.fixture(scope="module")
def site() -> Site:
    field = Field("rectangle", shapely.box(0.0, 0.0, 200.0, 120.0))
    return get_site_moves(prepare_context(WorkOrder(PlanRequest(tractors=(1,)), field=field))).site


def make_passage(start: Pose, turn_rad: float, radius_m: float, lead_m: float = 3.0) -> Passage:
    """An arc to the left and straight on, between two straight lines."""
    rows = np.array([[radius_m * turn_rad, 1.0 / radius_m, 1.0], [lead_m, 0.0, 1.0]])
    move = Move(start, rows, "u", 0.0)
    ends = [(pose, np.array([math.cos(pose[2]), math.sin(pose[2])])) for pose in (start, move.path.end)]
    (p, ahead), (q, onward) = ends
    before, after = ([p[:2] - STRETCH_M * ahead, p[:2]], [q[:2], q[:2] + STRETCH_M * onward])
    return Passage(move, np.array(before), np.array(after))


def count_drives(site: Site, counted: list[int]) -> Site:
    def drive(plan: Plan) -> SimulationRun:
        counted.append(plan.tractors)
        return site.drive_level(plan)

    return replace(site, drive_level=drive)


def test_alike_moves_are_driven_once(site: Site) -> None:
    counted: list[int] = []
    poses = [(50.0, 60.0, 0.0), (90.0, 50.0, 1.0), (100.0, 60.0, -2.0)]
    drives = MoveDrives(count_drives(site, counted), is_level=True)
    proven = drives.prove([make_passage(pose, math.pi, 6.0) for pose in poses])
    assert 1 in counted
    assert max(counted) == 1
    assert all(move is not None for move in proven)
    assert len({move.cost_s for move in proven if move is not None}) == 1
    assert [move.start for move in proven if move is not None] == poses


def test_many_at_once_are_driven_as_if_alone(site: Site) -> None:
    passages = [
        make_passage((60.0, 60.0, 0.3), turn, radius, lead)
        for turn in (0.5, 1.5, 3.0)
        for radius in (6.0, 8.0)
        for lead in (0.5, 4.0, 9.0)
    ]
    together = MoveDrives(site, is_level=True).drive(passages)
    for passage, one in zip(passages, together, strict=True):
        (alone,) = MoveDrives(site, is_level=True).drive([passage])
        assert (one.drive_s, one.off_m, one.missed_m2) == (alone.drive_s, alone.off_m, alone.missed_m2)
        assert np.array_equal(one.poses, alone.poses)


def test_a_move_that_leaves_the_field_is_none(site: Site) -> None:
    inside, outside = (make_passage(pose, math.pi, 6.0) for pose in ((100.0, 60.0, 0.0), (193.0, 60.0, 0.0)))
    proven = MoveDrives(site, is_level=True).prove([inside, outside])
    assert proven[0] is not None
    assert proven[1] is None


def test_a_straight_passage_takes_its_length_at_working_speed(site: Site) -> None:
    rows = np.array([[10.0, 0.0, 1.0]])
    move = Move((60.0, 60.0, 0.0), rows, "route", 0.0)
    lines = np.array([[20.0, 60.0], [60.0, 60.0]]), np.array([[70.0, 60.0], [110.0, 60.0]])
    (driven,) = MoveDrives(site, is_level=True).drive([Passage(move, *lines)])
    assert driven.drive_s == pytest.approx(10.0 / site.rules.turn_speed_mps, abs=0.1)
    assert driven.off_m < 0.02
    assert driven.missed_m2 < 0.1


def test_a_longer_lead_leaves_less_to_settle(site: Site) -> None:
    leads_m, charges_s = measure_settling(site)
    assert leads_m.tolist() == list(LEADS_M)
    assert (np.diff(charges_s) < 0.0).all()
    assert charges_s[-1] < 0.25 * charges_s[0]
