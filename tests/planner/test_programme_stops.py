"""Stops on programmes: where loads end, what is left, who is served when, and that a drive agrees."""

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
import shapely

from fields.geometry.field import Field
from planner.evaluation.candidates.energy_figures import find_flat_battery
from planner.evaluation.context import PlanningContext
from planner.evaluation.preparation import prepare_context
from planner.evaluation.site import build_site
from planner.evaluation.work_order import WorkOrder
from planner.request.plan_request import PlanRequest
from strategies.lines.lay_lines import lay_lines, measure_proof_rooms
from strategies.path_planning.errors import StrategyError
from strategies.programmes.driven_search import TourProblem
from strategies.programmes.move_table import MoveTable
from strategies.programmes.programme import Programme, make_programme
from strategies.programmes.site_moves import SiteMoves
from strategies.rules.battery_supply import BatterySupply
from strategies.rules.supply import HEADLAND, Supply
from strategies.service_stops.programme_stops import (
    StoppedProgramme,
    add_stops,
    build_stop_moves,
    estimate_served_s,
    stop_programme,
)
from strategies.service_stops.stop_moves import StopMoves
from strategies.service_stops.tour_parts import cut_to_loads
from vehicle.missions.plan import HEADLAND_PASS, REFILL, SWATH, Plan, check_plan
from vehicle.missions.run import DONE
from vehicle.model.tractor import BatteryParameters, load_tractor

pytestmark = pytest.mark.usefixtures("first_layout")

WIDTH_M, RATE, STAND_S, LOAD = 6.0, 0.1, 90.0, 300.0
RECTANGLE = shapely.box(0.0, 0.0, 180.0, 90.0)
PLACE = (0.0, 45.0)
BATTERY = BatteryParameters(capacity_kwh=25.0, charger_kw=60.0, connect_s=60.0, reserve=0.2)


@cache
def prepare(refill: str) -> PlanningContext:
    request = PlanRequest(width_m=WIDTH_M, tractors=(1,), refill=refill)
    return prepare_context(WorkOrder(request, field=Field("rectangle", RECTANGLE), supply=Supply(LOAD, RATE, STAND_S)))


@cache
def prepare_electric() -> PlanningContext:
    electric = load_tractor("eg105").model_copy(update={"drive": "electric", "battery": BATTERY})
    request = PlanRequest(width_m=3.0, tractors=(1,), refill="0,45")
    return prepare_context(WorkOrder(request, field=Field("rectangle", RECTANGLE), tractor=electric))


def make_table(context: PlanningContext) -> MoveTable:
    site = build_site(context)
    return MoveTable(SiteMoves(site, lay_lines(site)))


def pose(table: MoveTable, stages: list[int], tractors: int = 1, served_s: Any = None) -> TourProblem:
    allowed = np.ones((tractors, len(table.lines)), bool)
    return TourProblem(table, allowed, stages, np.zeros_like(table.cost_s), served_s)


def list_stages(table: MoveTable) -> list[int]:
    return [int(line.task.kind == HEADLAND_PASS) for line in table.lines]


@cache
def stop(kind: str, tractors: int = 1) -> StoppedProgramme:
    """A rectangle worked by a number of tractors with stops on the headland, at a place, or of a battery there."""
    context = prepare_electric() if kind == "battery" else prepare("0,45" if kind == "place" else kind)
    assert context.supply is not None
    table = make_table(context)
    moves, stages = build_stop_moves(table, context.supply), list_stages(table)
    served_s = estimate_served_s(table, context.supply, moves)
    programme = make_programme(pose(table, stages, tractors, served_s))
    return stop_programme(programme, context.supply, moves, stages)


def list_levels(plan: Plan, capacity: float) -> Iterator[float]:
    """What is left of the load of every tractor before every stop and at the end."""
    for mission in plan.missions:
        used = 0.0
        for leg in mission.legs:
            if leg.stand_s:
                yield capacity - used
                used = 0.0
            used += leg.length_m * leg.implement * WIDTH_M * RATE
        yield capacity - used


def test_a_load_lasts_for_three_tracks() -> None:
    """Tracks of 156 m take 93.6 each, a load is 300: served after every third one for the eleven tracks."""
    done = stop(HEADLAND)
    assert [stop.gap for stop in done.stops[0]][:3] == [3, 6, 9]
    assert [stop.amount for stop in done.stops[0]][:3] == pytest.approx([3 * 156.0 * WIDTH_M * RATE] * 3, rel=1e-6)
    (gaps,) = done.gaps
    assert done.compute_tractor_s()[0] == pytest.approx(gaps.driven_s + STAND_S * len(done.stops[0]))


@pytest.mark.parametrize(("kind", "tractors"), [(HEADLAND, 1), ("place", 1), ("place", 2)])
def test_no_load_is_used_up_and_every_line_is_worked_once(kind: str, tractors: int) -> None:
    done = stop(kind, tractors)
    plan = done.build_plan()
    check_plan(plan)
    lines = done.programme.table.lines
    assert sorted({part.node // 2 for gaps in done.gaps for part in gaps.tour}) == list(range(len(lines)))
    assert min(list_levels(plan, LOAD)) >= -1e-6
    worked = {
        (leg.task.kind, leg.task.number, leg.task.piece) for m in plan.missions for leg in m.legs if leg.implement
    }
    assert worked == {(line.task.kind, line.task.number, line.task.piece) for line in lines}
    assert plan.notes.collects is False
    assert len(plan.notes.stops) == sum(map(len, done.stops))


@pytest.mark.slow
@pytest.mark.parametrize("kind", [HEADLAND, "place", "battery"])
def test_lines_moves_and_stops_add_up_to_the_time_of_the_drive(kind: str) -> None:
    done = stop(kind)
    site = done.programme.table.site
    run = site.drive(done.build_plan())
    assert run.outcome == DONE
    assert done.compute_tractor_s()[0] == pytest.approx(run.duration_s, rel=0.01)
    assert measure_proof_rooms(site, run.get_poses(0)).min() >= -0.03


def test_tractors_stand_by_the_place_after_a_way_to_it() -> None:
    done = stop("place", 2)
    plan = done.build_plan()
    for entry in plan.notes.stops:
        legs, leg = plan.missions[entry.tractor].legs, entry.leg
        assert legs[leg].stand_s == STAND_S
        assert legs[leg - 1].task.kind == REFILL
        assert math.dist((entry.x_m, entry.y_m), PLACE) < 4.0 * done.programme.table.site.rules.radius_m
    assert any(leg.gates for mission in plan.missions for leg in mission.legs), "one at a time"


def test_an_order_found_with_the_loads_is_not_slower() -> None:
    done = stop("place")
    table, supply = done.programme.table, done.supply
    moves, stages = build_stop_moves(table, supply), list_stages(table)
    programme = make_programme(pose(table, stages, served_s=estimate_served_s(table, supply, moves)))
    plain = add_stops(programme, supply, moves, [cut_to_loads(table, supply, tour) for tour in programme.tours])
    cost_s = [sum(gaps.measure_cost_s([s.gap for s in one.stops[0]]) for gaps in one.gaps) for one in (done, plain)]
    assert cost_s[0] <= cost_s[1] + 1e-3
    kinds = [table.lines[part.node // 2].task.kind == HEADLAND_PASS for part in done.gaps[0].tour]
    assert kinds == sorted(kinds), "the headland is still the last"


def test_a_battery_lasts_with_the_ways_to_the_charger() -> None:
    context, done = prepare_electric(), stop("battery")
    assert isinstance(done.supply, BatterySupply)
    (gaps,), (stops,) = done.gaps, done.stops
    loads = gaps.build_needs().list_loads([stop.gap for stop in stops])
    assert max(loads) <= done.supply.usable_kwh + 1e-9
    assert stops and sum(stop.amount for stop in stops) == pytest.approx(sum(loads) - done.supply.usable_kwh)
    run = done.programme.table.site.drive(done.build_plan())
    assert find_flat_battery(context, run) is None
    assert run.plan.notes.service == "charge"


@pytest.mark.slow
@pytest.mark.parametrize("refill", [HEADLAND, "0,45"])
def test_a_track_longer_than_a_load_is_left_half_way(refill: str) -> None:
    """A load of 70 lasts for 117 m of the tracks of 156 m."""
    context = prepare(refill)
    assert context.supply is not None
    supply, table = replace(context.supply, capacity=70.0), make_table(context)
    stages, moves = list_stages(table), build_stop_moves(table, context.supply)
    done = stop_programme(make_programme(pose(table, stages)), supply, moves, stages)
    plan = done.build_plan()
    assert min(list_levels(plan, 70.0)) >= -1e-6
    worked_m = sum(leg.length_m for leg in plan.missions[0].legs if leg.task.kind == SWATH)
    assert worked_m == pytest.approx(11 * 156.0, rel=0.02)
    run = table.site.drive(plan)
    assert run.outcome == DONE
    assert done.compute_tractor_s()[0] == pytest.approx(run.duration_s, rel=0.02)
    legs = [plan.missions[0].legs[entry.leg] for entry in plan.notes.stops]
    assert any(leg.task.kind == SWATH or refill != HEADLAND for leg in legs), "some within a track"


def test_a_move_to_a_place_is_found_once_for_a_site() -> None:
    context = prepare("0,45")
    assert context.supply is not None
    table = make_table(context)
    first, second = (build_stop_moves(MoveTable(table.moves), context.supply) for _ in range(2))
    assert first is not None and second is not None
    (trip, _), *_ = first.list_trips((0, table.lines[0].measure_path_m(0)), (0, 0.0))
    guess_s, move = second.estimate_s(trip), first.get_move(trip)
    assert move is not None and first.estimate_s(trip) == move.cost_s != guess_s
    assert second.estimate_s(trip) == guess_s, "what one search asks changes nothing for another"
    assert second.get_move(trip) is move


def test_a_place_that_no_move_leads_to_is_refused() -> None:
    context = prepare("0,45")
    assert context.supply is not None
    table = make_table(context)
    moves = StopMoves(table, ((-500.0, -500.0, 0.0),))
    with pytest.raises(StrategyError, match="No path with a turning radius of"):
        stop_programme(Programme(table, ((0,),), ()), replace(context.supply, capacity=20.0), moves)
