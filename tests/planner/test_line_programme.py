"""Programmes of work lines: what they cover, what their sums say, and that a drive agrees."""

import math
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
import shapely

from fields.geometry.field import Field
from fields.geometry.obstacles import Obstacle
from fields.terrain.elevation_grid import ElevationGrid
from planner.evaluation.candidates.evaluate import Candidate, _check_run, simulate_candidate
from planner.evaluation.candidates.figures import CandidateRun
from planner.evaluation.candidates.fleet_drive import FleetDriver, build_clearance_check
from planner.evaluation.candidates.line_programme import drive_composed, list_left_remarks, sketch_plans
from planner.evaluation.context import PlanningContext
from planner.evaluation.field_physics import LEVEL_GROUND, build_terrain
from planner.evaluation.preparation import prepare_context
from planner.evaluation.site import build_site, get_site_moves
from planner.evaluation.work_order import WorkOrder
from planner.request.plan_request import PlanRequest
from reports.common.plan_records import OBSTACLE
from reports.common.plan_results import PlanResult
from strategies.lines.lay_lines import lay_lines, measure_proof_rooms
from strategies.lines.work_line import HOLE_PASS
from strategies.programmes.driven_search import TourProblem
from strategies.programmes.move_table import MoveTable
from strategies.programmes.programme import Programme, build_plan, charge_waiting, make_programme
from strategies.programmes.site_moves import SiteMoves
from strategies.programmes.tour_legs import build_mission
from strategies.programmes.ways_home import WayBook
from strategies.registry import STRATEGIES
from strategies.site.ground import get_distance
from tests.benchmarks.drawn_jobs import draw_job
from tests.benchmarks.planned_jobs import build_field, build_tractor
from vehicle.missions.plan import ENTER, HEADLAND_PASS, LEAVE, SWATH, Leg, LegGate, Plan
from vehicle.missions.run import DONE, SimulationRun
from vehicle.records import REC_Y, WAITING

pytestmark = pytest.mark.usefixtures("first_layout")

WIDTH_M = 6.0
RECTANGLE = shapely.box(0.0, 0.0, 180.0, 90.0)
CURVED_SEED = 45005


def prepare(field: Field, **request: object) -> PlanningContext:
    values: dict[str, object] = {"width_m": WIDTH_M, "tractors": (1,), **request}
    return prepare_context(WorkOrder(PlanRequest(**values), field=field))  # type: ignore[arg-type]


def drive(found: PlanningContext, tractors: int = 1) -> CandidateRun:
    """The cheapest programme of blocks, driven."""
    composed = sketch_plans(found, STRATEGIES["split-field"], tractors)[0].compose()
    return drive_composed(found, FleetDriver(found, beside=False), composed)


@pytest.fixture(scope="module")
def context() -> PlanningContext:
    return prepare(Field("rectangle", RECTANGLE))


@pytest.fixture(scope="module")
def programme(context: PlanningContext) -> Programme:
    site = build_site(context)
    lines = lay_lines(site)
    stages = [int(line.task.kind == HEADLAND_PASS) for line in lines]
    table = MoveTable(SiteMoves(site, lines))
    return make_programme(TourProblem(table, np.ones((1, len(lines)), bool), stages, np.zeros_like(table.cost_s)))


def test_lines_cover_a_rectangle(context: PlanningContext) -> None:
    site = build_site(context)
    lines = lay_lines(site)
    strips = shapely.union_all([line.build_strip(WIDTH_M) for line in lines])
    assert shapely.intersection(strips, RECTANGLE).area >= 0.995 * RECTANGLE.area
    assert {line.task.kind for line in lines} == {SWATH, HEADLAND_PASS}
    assert sum(line.own_m2 for line in lines) <= RECTANGLE.area


@pytest.mark.parametrize(("off_m", "is_alike", "drives"), [(0.0, True, False), (0.2, True, True), (0.0, False, True)])
def test_straight_lines_are_driven_where_a_tractor_may_leave_them(off_m: float, is_alike: bool, drives: bool) -> None:
    """In their place only, and the lines are the same."""
    corners = (500, 500), (700, 500), (640, 560), (690, 575), (660, 640), (500, 620), (530, 570)
    place = shapely.Polygon(corners, [shapely.Point(580.0, 560.0).buffer(4.0).exterior.coords])
    site, driven_alone = build_site(prepare(Field("far", place))), list[Leg]()

    def drive_in_place(plan: Plan) -> SimulationRun:
        legs = [leg for mission in plan.missions for leg in mission.legs]
        assert all(place.convex_hull.covers(shapely.LineString(leg.points)) for leg in legs)
        driven_alone.extend(leg for leg in legs if len(leg.points) == 2)
        return site.drive(plan)

    def drive_beside(plan: Plan) -> SimulationRun:
        run = site.drive_level(plan)
        run.record[:, :, REC_Y] += off_m
        return run

    laid = lay_lines(replace(site, drive=drive_in_place, drive_level=drive_beside, is_alike=is_alike))
    expected = lay_lines(site)
    assert bool(driven_alone) == drives and len(laid) == len(expected) > 10
    for one, other in zip(laid, expected, strict=True):
        assert np.concatenate(one.paths) == pytest.approx(np.concatenate(other.paths), abs=1e-6)


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
    driven = drive(found)
    site = build_site(found)
    assert measure_proof_rooms(site, driven.run.get_poses(0)).min() >= -0.03
    worked = driven.run.plan.missions[0].legs
    assert any(leg.implement and np.hypot(*(leg.points - (90.0, 45.0)).T).min() < 20.0 for leg in worked)


@pytest.mark.parametrize("half_width_m", [0.05, 0.1, 0.25])
@pytest.mark.parametrize("place", [(60.1, 40.0), (60.25, 40.25), (60.4, 40.1)])
def test_no_pole_is_too_small_to_be_seen(half_width_m: float, place: tuple[float, float]) -> None:
    pole = Obstacle("pole", shapely.Point(place), half_width_m, "pole")
    ground = build_site(prepare(Field("with a pole", shapely.box(40.0, 20.0, 100.0, 70.0), obstacles=(pole,)))).ground
    assert get_distance(*place, ground.grid, ground.frame) < 0.0


def test_what_no_machine_may_do_makes_a_programme_infeasible(context: PlanningContext) -> None:
    """The same drive on a field with a mast where it works."""
    driven = drive(context)
    assert _check_run(context, driven).reason is None
    mast = Obstacle("mast", shapely.Point(90.0, 45.0), 1.0, "mast")
    blocked = prepare(Field("with a mast", RECTANGLE, obstacles=(mast,)))
    checked = _check_run(blocked, driven)
    assert checked.reason is not None
    assert OBSTACLE in {fault.kind for fault in checked.faults}


def test_tractors_come_in_and_leave_by_the_entrance() -> None:
    driven = drive(prepare(Field("gate", RECTANGLE, entrance=(90.0, 0.0))))
    legs = driven.run.plan.missions[0].legs
    assert (legs[0].task.kind, legs[-1].task.kind) == (ENTER, LEAVE)
    assert math.dist(legs[0].points[0], (90.0, 0.0)) < 1.0
    assert math.dist(legs[-1].points[-1], (90.0, 0.0)) < 1.0


def test_the_same_request_gives_the_same_drive_bit_for_bit(context: PlanningContext) -> None:
    first, second = (drive(context) for _ in range(2))
    assert first.run.record.tobytes() == second.run.record.tobytes()


def test_lines_that_are_left_are_in_the_remark(context: PlanningContext, programme: Programme) -> None:
    assert list_left_remarks(programme, context) == ()
    left = Programme(programme.table, ((),), (0, 1))
    area_m2 = sum(line.own_m2 for line in programme.table.lines[:2])
    remark, _ = list_left_remarks(left, context)
    assert f"2 lines of work are left ({area_m2:.0f} m2 in all" in remark.text


def test_a_field_that_passes_leave_much_of_is_worked() -> None:
    """A small field with a curved edge and a boom of 24 m: passes and turns leave a twelfth of it."""
    job = draw_job(CURVED_SEED, [], exact=True)
    request = PlanRequest(width_m=job["width_m"], speed_kmh=job["speed_kmh"], tractors=(1,))
    found = prepare_context(WorkOrder(request, field=build_field(job), tractor=build_tractor(job["radius_m"])))
    result = simulate_candidate(found, Candidate("split-field", 1)).result
    assert result.feasible
    assert (result.worked_pct or 0.0) > 95.0


@pytest.mark.parametrize("name", ["split-field", "interleaved"])
def test_two_tractors_need_little_more_than_half_the_time_of_one(context: PlanningContext, name: str) -> None:
    alone, both = (simulate_candidate(context, Candidate(name, count)).result for count in (1, 2))
    assert both.feasible
    assert 0.5 * alone.time_s * 0.95 < both.time_s < 0.5 * alone.time_s * 1.1
    assert abs((both.worked_pct or 0.0) - (alone.worked_pct or 0.0)) < 0.5


def test_waiting_is_charged_to_the_move_before_which_a_tractor_waits(context: PlanningContext) -> None:
    composed = sketch_plans(context, STRATEGIES["split-field"], 2)[0].compose()
    programme, plan = composed.programme, composed.plan
    leg = next(number for number, leg in enumerate(plan.missions[0].legs) if leg.may_wait and leg.implement)
    waiting = plan.copy_with_gate(0, leg, LegGate(1, len(plan.missions[1].legs) - 1, 1.0))
    run = programme.table.site.drive(waiting)
    waited_s = run.step_s * np.count_nonzero(run.get_statuses(0) == WAITING)
    charged_s = charge_waiting(programme, programme.tours, plan, run)
    first, second = programme.tours[0][:2]
    assert waited_s > 100.0 and np.argwhere(charged_s).tolist() == [[first, second]]
    assert charged_s[first, second] == pytest.approx(waited_s)
    assert not charge_waiting(programme, programme.tours, waiting, run).any(), "the plan itself asks for it"


@pytest.mark.slow
def test_tractors_that_wait_long_are_given_other_moves() -> None:
    found = prepare_context(WorkOrder(PlanRequest("netherlands", width_m=4.5, tractors=(5,))))
    first_s = drive(found, 5).run.duration_s
    result = simulate_candidate(found, Candidate("split-field", 5)).result
    assert (result.time_s or math.inf) < 0.9 * first_s


@pytest.mark.slow
def test_where_most_moves_fail_others_are_tried_for_them() -> None:
    """An implement narrower than the tractor: hardly any move finds the rounds along the edge."""
    found = prepare(Field("small", shapely.box(0.0, 0.0, 60.0, 40.0)), width_m=1.4)
    worked_m2 = sum(line.own_m2 for line in get_site_moves(found).lines)
    left_m2 = sketch_plans(found, STRATEGIES["split-field"], 1)[0].compose().programme.left_m2
    assert left_m2 < 0.15 * worked_m2


def test_a_programme_that_is_longer_than_the_incumbent_is_not_driven(context: PlanningContext) -> None:
    (alone_s,) = sketch_plans(context, STRATEGIES["split-field"], 1)[0].compose().tractor_s
    for finish_s, is_driven in ((0.9 * alone_s, False), (1.1 * alone_s, True)):
        incumbent = PlanResult("another", 1, "u", True, time_s=finish_s, tractor_time_s=finish_s)
        found = simulate_candidate(context, Candidate("split-field", 1), incumbent)
        assert (found.run is not None) is is_driven
        assert (found.result.bound_s is None) is is_driven


def test_what_starting_and_stopping_take_does_not_depend_on_where_heights_are_known(context: PlanningContext) -> None:
    """Heights of a field far from its origin: the straight line that is timed lies on no ground of the field."""
    far = shapely.transform(RECTANGLE, lambda points: points + 500.0)
    grid = ElevationGrid(490.0, 490.0, 5.0, np.zeros((25, 45)))
    found = prepare_context(
        WorkOrder(PlanRequest(field="far", width_m=WIDTH_M, tractors=(1,)), field=Field("far", far)),
        physics=replace(LEVEL_GROUND, terrain=build_terrain(grid)),
    )
    level, high = (SiteMoves(build_site(one), []).drives.rest_s for one in (context, found))
    assert high == pytest.approx(level, abs=0.2)


def test_no_two_tractors_begin_or_end_where_they_never_get_on() -> None:
    """With only their first parts compared two of three began on neighbouring tracks, face to face."""
    found = prepare(Field("rectangle", shapely.box(0.0, 0.0, 120.0, 60.0)), width_m=4.0, headland_order="last")
    composed = sketch_plans(found, STRATEGIES["split-field"], 3)[0].compose()
    site, check = composed.programme.table.site, build_clearance_check(found, beside=False)
    book = WayBook(site.body.guide_m - site.axle_m)
    ways = [book.build_way(mission) for mission in composed.plan.missions]
    assert [book.find_stuck_side(a, b, check) for a, b in combinations(ways, 2)] == [None] * 3


def test_a_mission_is_built_once_for_the_same_moves(context: PlanningContext) -> None:
    """A move that is struck makes it another one."""
    composed = sketch_plans(context, STRATEGIES["split-field"], 1)[0].compose().programme
    table, (tour,) = composed.table, composed.tours
    mission = build_mission(table, tour)
    assert build_mission(table, list(tour)) is mission
    pair = next(pair for pair in composed.list_pairs() if len(table._options[pair]) > 1)
    table.strike(*pair)
    assert build_mission(table, tour) is not mission


@pytest.mark.slow
def test_a_formation_reaches_passes_round_a_hole_over_worked_ground_where_a_crop_stands() -> None:
    hole = [(50.0, 45.0), (75.0, 45.0), (75.0, 65.0), (50.0, 65.0)]
    field = Field("hole", shapely.Polygon([(0.0, 0.0), (125.0, 0.0), (125.0, 110.0), (0.0, 110.0)], [hole]))
    request = PlanRequest(width_m=4.0, operation="mow", tractors=(2,), clearance_m=0.1)
    composed = sketch_plans(prepare_context(WorkOrder(request, field=field)), STRATEGIES["row-by-row"], 2)[0].compose()
    groups = {line.task: line.group[0] for line in composed.programme.table.lines}
    driven = [[groups[leg.task] for leg in mission.legs if leg.implement] for mission in composed.plan.missions]
    assert composed.order == "first" and any(HOLE_PASS in kinds for kinds in driven)
    for kinds in driven:
        assert HOLE_PASS not in kinds or SWATH not in kinds[kinds.index(HOLE_PASS) :]


def test_what_stands_is_charged_on_the_way_into_a_crop() -> None:
    """Northwards through the middle of the field: of less after each pass that is worked."""
    found = prepare(Field("rectangle", RECTANGLE), operation="harvest", headland_passes=3)
    moves = get_site_moves(found)
    sides = {number: line for number, line in enumerate(moves.lines) if line.group == (HEADLAND_PASS, 0)}
    assert {moves.estimates.count_passes(2 * number, moves.gate) for number in sides} == {None}
    first = next(number for number, line in sides.items() if line.task.number == 1)
    assert moves.estimates.count_passes(moves.gate, 2 * first) == 0
    assert moves.estimates.count_passes(2 * first, 2 * first + 2) == 1
    charges_s = []
    for passes in (0, 1, 2, 3):
        (move, *_) = moves.finder.list_moves((90.0, 12.0, 0.5 * math.pi), (90.0, 60.0, 0.5 * math.pi), passes=passes)
        charges_s.append(move.charge_s)
    assert charges_s[0] == charges_s[1] == pytest.approx(charges_s[2], abs=2.0), "it begins inside the first"
    per_pass_s = moves.site.wheels_s_per_m * WIDTH_M
    assert charges_s[2] - charges_s[3] == pytest.approx(per_pass_s, abs=0.3 * per_pass_s)


@pytest.mark.slow
def test_sides_that_no_move_reaches_cost_no_track() -> None:
    """The wheels of the tractor do not fit beside the edge, so that hardly a move to the outermost pass is driven."""
    found = prepare(Field("strip", shapely.box(0.0, 0.0, 150.0, 35.0)), width_m=1.4)
    programme = sketch_plans(found, STRATEGIES["row-by-row"], 1)[0].compose().programme
    left = [programme.table.lines[number].task for number in programme.left]
    assert not [task for task in left if task.kind == SWATH] and len(left) <= 12
