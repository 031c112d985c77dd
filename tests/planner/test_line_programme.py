"""Programmes of work lines: what they cover, what their sums say, and that a drive agrees."""

import math

import numpy as np
import pytest
import shapely

from fields.geometry.field import Field
from fields.geometry.obstacles import Obstacle
from planner.evaluation.candidates.evaluate import (
    Candidate,
    _check_programme,
    _simulate_passes,
    simulate_candidate,
)
from planner.evaluation.candidates.line_programme import describe_left, run_programme
from planner.evaluation.context import PlanningContext, prepare_context
from planner.evaluation.site import build_site
from planner.request.plan_request import PlanRequest
from reports.common.plan_results import OBSTACLE, PlanResult
from strategies.lines.lay_lines import lay_lines, measure_proof_rooms
from strategies.programmes.build_plan import build_plan
from strategies.programmes.move_table import MoveTable
from strategies.programmes.programme import Programme, make_programme
from strategies.programmes.site_moves import SiteMoves
from strategies.site.ground import get_distance
from tests.benchmarks.drawn_jobs import draw_job
from tests.benchmarks.planned_jobs import build_field, build_tractor
from vehicle.missions.plan import ENTER, HEADLAND_PASS, LEAVE, SWATH
from vehicle.missions.run import DONE

WIDTH_M = 6.0
RECTANGLE = shapely.box(0.0, 0.0, 180.0, 90.0)
CURVED_SEED = 45005
REFUSED = PlanResult("split-field", 1, "auto", False, "no path leads on")


def prepare(field: Field, **request: object) -> PlanningContext:
    values: dict[str, object] = {"width_m": WIDTH_M, "tractors": (1,), **request}
    return prepare_context(PlanRequest(**values), field=field)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def context() -> PlanningContext:
    return prepare(Field("rectangle", RECTANGLE))


@pytest.fixture(scope="module")
def programme(context: PlanningContext) -> Programme:
    site = build_site(context)
    lines = lay_lines(site)
    stages = [int(line.task.kind == HEADLAND_PASS) for line in lines]
    return make_programme(MoveTable(SiteMoves(site, lines)), 1, stages)


def test_lines_cover_a_rectangle(context: PlanningContext) -> None:
    site = build_site(context)
    lines = lay_lines(site)
    strips = shapely.union_all([line.build_strip(WIDTH_M) for line in lines])
    assert shapely.intersection(strips, RECTANGLE).area >= 0.995 * RECTANGLE.area
    assert {line.task.kind for line in lines} == {SWATH, HEADLAND_PASS}
    assert sum(line.own_m2 for line in lines) <= RECTANGLE.area


def test_every_line_is_worked_once_and_the_headland_last(programme: Programme) -> None:
    (tour,) = programme.tours
    numbers = [node // 2 for node in tour]
    assert sorted(numbers) == list(range(len(programme.table.lines)))
    assert programme.left == ()
    kinds = [programme.table.lines[number].task.kind for number in numbers]
    assert kinds == sorted(kinds, key=lambda kind: kind == HEADLAND_PASS)


def test_the_sum_of_lines_and_moves_is_the_time_of_the_drive(programme: Programme) -> None:
    run = programme.table.site.drive(build_plan(programme))
    assert run.outcome == DONE
    assert sum(programme.compute_tractor_s()) == pytest.approx(run.duration_s, rel=0.01)
    assert measure_proof_rooms(programme.table.site, run.get_poses(0)).min() >= -0.03


def test_a_driver_goes_up_to_an_obstacle_and_on_behind_it() -> None:
    pond = Obstacle("pond", shapely.Point(90.0, 45.0).buffer(8.0), 0.0, "pond")
    found = prepare(Field("with a pond", RECTANGLE, obstacles=(pond,)))
    driven = run_programme(found, REFUSED)
    assert driven is not None
    site = build_site(found)
    assert measure_proof_rooms(site, driven.run.get_poses(0)).min() >= -0.03
    worked = driven.run.plan.missions[0].legs
    assert any(leg.implement and np.hypot(*(leg.points - (90.0, 45.0)).T).min() < 20.0 for leg in worked)


@pytest.mark.parametrize("half_width_m", [0.05, 0.1, 0.25])
@pytest.mark.parametrize("place", [(60.1, 40.0), (60.25, 40.25), (60.4, 40.1)])
def test_no_pole_is_too_small_to_be_seen(half_width_m: float, place: tuple[float, float]) -> None:
    pole = Obstacle("pole", shapely.Point(place), half_width_m, "pole")
    ground = build_site(prepare(Field("with a pole", RECTANGLE, obstacles=(pole,)))).ground
    assert get_distance(*place, ground.grid, ground.frame) < 0.0


def test_what_no_machine_may_do_makes_a_programme_infeasible(context: PlanningContext) -> None:
    """The same drive on a field with a mast where it works."""
    driven = run_programme(context, REFUSED)
    assert driven is not None
    assert _check_programme(context, driven).reason is None
    mast = Obstacle("mast", shapely.Point(90.0, 45.0), 1.0, "mast")
    blocked = prepare(Field("with a mast", RECTANGLE, obstacles=(mast,)))
    checked = _check_programme(blocked, driven)
    assert checked.reason is not None
    assert OBSTACLE in {fault.kind for fault in checked.faults}


def test_tractors_come_in_and_leave_by_the_entrance() -> None:
    driven = run_programme(prepare(Field("gate", RECTANGLE, entrance=(90.0, 0.0))), REFUSED)
    assert driven is not None
    legs = driven.run.plan.missions[0].legs
    assert (legs[0].task.kind, legs[-1].task.kind) == (ENTER, LEAVE)
    assert math.dist(legs[0].points[0], (90.0, 0.0)) < 1.0
    assert math.dist(legs[-1].points[-1], (90.0, 0.0)) < 1.0


def test_the_same_request_gives_the_same_drive_bit_for_bit(context: PlanningContext) -> None:
    first, second = (run_programme(context, REFUSED) for _ in range(2))
    assert first is not None
    assert second is not None
    assert first.run.record.tobytes() == second.run.record.tobytes()


def test_lines_that_are_left_are_in_the_remark(context: PlanningContext, programme: Programme) -> None:
    assert describe_left(programme, context) is None
    left = Programme(programme.table, ((),), (0, 1))
    area_m2 = sum(line.own_m2 for line in programme.table.lines[:2])
    remark = describe_left(left, context)
    assert remark is not None
    assert f"2 lines of work are left, {area_m2:.0f} m2 in all" in remark


def test_not_tried_where_passes_work_the_field_well(context: PlanningContext) -> None:
    assert run_programme(context, PlanResult("split-field", 1, "u", True, worked_pct=99.0)) is None


def test_the_better_of_passes_and_lines_is_taken() -> None:
    """A small field with a curved edge and a boom of 24 m: passes leave a twelfth of it."""
    job = draw_job(CURVED_SEED, [], exact=True)
    request = PlanRequest(width_m=job["width_m"], speed_kmh=job["speed_kmh"], tractors=(1,))
    found = prepare_context(request, field=build_field(job), tractor=build_tractor(job["radius_m"]))
    candidate = Candidate("split-field", 1)
    passes, best = _simulate_passes(found, candidate, None).result, simulate_candidate(found, candidate).result
    assert passes.worked_pct is None or passes.worked_pct < 95.0
    assert best.feasible
    assert best.finished_s is not None
    assert not passes.feasible or (passes.finished_s is not None and best.finished_s < passes.finished_s)
