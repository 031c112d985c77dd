"""Refills in whole plans: what is used and made good, who is served when, what is refused."""

import itertools
import json
import math
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest
import shapely

from fields import Field, read_field, write_field
from planner.errors import RequestError
from planner.evaluation.candidates.energy_figures import find_service_conflict, find_service_stops
from planner.evaluation.candidates.evaluate import Candidate, Outcome, simulate_candidate
from planner.evaluation.context import PlanningContext
from planner.evaluation.preparation import prepare_context
from planner.evaluation.work_order import WorkOrder
from planner.farm.machines import FarmImplement
from planner.farm.random_inputs import build_certain_settings
from planner.pipeline.outputs.driving_steps import list_steps
from planner.pipeline.outputs.pictures import build_run_picture
from planner.pipeline.ranking import rank_plans
from planner.request.plan_request import PlanRequest
from planner.request.service_points import add_coordinates
from planner.risk.leg_graph import build_leg_graph
from planner.risk.monte_carlo import sample_outcomes
from reports.plan.answer import write_answer
from reports.plan.figures import format_ranking_json
from reports.plan.leg_list import describe_leg
from reports.plan.ranking_table import build_ranking_table
from strategies.rules.supply import HEADLAND, PLACE, SERVICE_VEHICLE, Supply
from tests.printing import print_text
from vehicle.missions.plan import NotedStop, Plan, PlanNotes
from vehicle.missions.plan_file import format_plan, parse_plan

pytestmark = pytest.mark.usefixtures("first_layout")

RATE, STAND_S, WIDTH_M = 0.3, 90.0, 3.0
BOX = shapely.box(0, 0, 60, 110)
TANK = Supply(300.0, RATE, STAND_S)
Case = tuple[str, int, str, bool]
FIRST: Case = (HEADLAND, 1, "split-field", True)
CASES: list[Case] = [
    ("60,0", 2, "split-field", True),
    (HEADLAND, 3, "interleaved", False),
    (SERVICE_VEHICLE, 2, "split-field", False),
]
MORE_CASES: list[Case] = [
    (HEADLAND, 2, "interleaved", False),
    ("0,30", 1, "split-field", False),
    ("30,110", 2, "interleaved", False),
]


@cache
def site_for(refill: str | None, no_headland: bool = True, supply: Supply | None = TANK) -> PlanningContext:
    scenario = PlanRequest(field="drawn", no_headland=no_headland, refill=refill)
    return prepare_context(WorkOrder(scenario, Field("drawn", BOX), supply=supply))


@cache
def driven(refill: str, tractors: int, strategy: str, no_headland: bool) -> Outcome:
    return simulate_candidate(site_for(refill, no_headland), Candidate(strategy, tractors))


def levels(plan: Plan, supply: Supply) -> Iterator[tuple[int, list[float], float]]:
    """Per tractor what is left of the load before every stop and at the end, and all that is used."""
    for mission in plan.missions:
        used, all_used, left = 0.0, 0.0, []
        for leg in mission.legs:
            if leg.stand_s:
                left.append(supply.capacity - used)
                used = 0.0
            share = leg.length_m * leg.implement * WIDTH_M * supply.rate_per_m2
            used, all_used = used + share, all_used + share
        yield len(left), [*left, supply.capacity - used], all_used


@pytest.mark.parametrize(
    "case",
    [
        FIRST,
        *(pytest.param(case, marks=pytest.mark.slow) for case in CASES),
        *(pytest.param(case, marks=pytest.mark.matrix) for case in MORE_CASES),
    ],
    ids=lambda case: " ".join(map(str, case)),
)
class TestPlans:
    def test_loads_add_up_to_area_by_rate_and_no_level_is_below_nothing(self, case: Case) -> None:
        found = driven(*case)
        assert found.result.feasible, found.result.reason
        notes = found.run.plan.notes.stops
        assert found.result.refills == len(notes) > 0
        for tractor, (stops, left, used) in enumerate(levels(found.run.plan, TANK), start=1):
            own = [one.amount for one in notes if one.tractor + 1 == tractor]
            assert stops == len(own)
            assert min(left) >= -1e-6
            assert own == pytest.approx([TANK.capacity - level for level in left[:-1]], abs=0.01)
            assert math.fsum(own) + TANK.capacity - left[-1] == pytest.approx(used, abs=0.01)
        worked_m2 = sum(used for *_, used in levels(found.run.plan, TANK)) / RATE
        rounds_m = sum(lap.length_m for lap in site_for(case[0], case[3]).headland_passes)
        tracks_m = sum(track.length_m for track in site_for(case[0], case[3]).layout.swaths)
        assert worked_m2 == pytest.approx(WIDTH_M * (rounds_m + tracks_m), rel=0.06), "corners are worked twice"

    def test_it_stands_as_often_and_as_long_as_asked_for(self, case: Case) -> None:
        found = driven(*case)
        assert found.run is not None
        stops = find_service_stops(found.run)
        assert len(stops) == found.result.refills
        assert [one.to_s - one.from_s for one in stops] == pytest.approx([STAND_S] * len(stops), abs=0.11)
        assert found.result.refilling_s == pytest.approx(STAND_S * len(stops), abs=0.11 * len(stops))

    def test_one_is_served_at_a_time_where_only_one_can_be(self, case: Case) -> None:
        found = driven(*case)
        assert found.run is not None
        assert find_service_conflict(found.run, site_for(case[0], case[3]).supply) is None
        if case[0] != HEADLAND:
            stops = find_service_stops(found.run)
            assert all(b.from_s >= a.to_s - 1.0 for a, b in itertools.pairwise(stops))

    def test_a_tractor_stands_by_the_place(self, case: Case) -> None:
        found, site = driven(*case), site_for(case[0], case[3])
        if site.supply.place is None:
            return
        for one in found.run.plan.notes.stops:
            assert math.dist((one.x_m, one.y_m), site.supply.place) < 4.0 * site.driving_rules.radius_m

    def test_the_plan_is_saved_and_read_again(self, case: Case) -> None:
        found = driven(*case)
        text = format_plan(found.run.plan)
        assert format_plan(parse_plan(text)) == text
        assert sum(leg.stand_s for m in parse_plan(text).missions for leg in m.legs) == STAND_S * (
            found.result.refills or 0
        )

    def test_draws_without_luck_take_as_long_as_the_run(self, case: Case) -> None:
        found = driven(*case)
        graph = build_leg_graph(found.run)
        assert graph.stand_s.sum() == pytest.approx(found.result.refilling_s)
        (finish,) = sample_outcomes(graph, build_certain_settings(), samples=1, seed=1).finish_s
        assert finish == pytest.approx(found.run.duration_s, rel=0.01)

    def test_a_driver_is_told(self, case: Case) -> None:
        found = driven(*case)
        steps = [step for own in list_steps(found.run, WIDTH_M) for step in own]
        told = [step for step in steps if step.kind == "refill"]
        assert len(told) == found.result.refills
        amounts = sorted(one.amount for one in found.run.plan.notes.stops)
        assert sorted(step.amount or 0.0 for step in told) == amounts
        assert describe_leg(told[0]) == f"refill {told[0].amount:.0f} l or kg"
        ways = [step for step in steps if step.kind == "refill-way"]
        assert bool(ways) == (case[0] not in (HEADLAND, SERVICE_VEHICLE))


def test_a_refill_comes_before_a_track_that_could_not_be_finished() -> None:
    found = driven(*FIRST)
    per_track = site_for(HEADLAND).layout.swaths[0].length_m * WIDTH_M * RATE
    for left in next(levels(found.run.plan, TANK))[1][:-1]:
        assert left < per_track, "where a stop costs the same everywhere, none is made before it must be"


def test_a_tank_that_lasts_changes_nothing() -> None:
    large = replace(TANK, capacity=1e6)
    with_tank, without = (
        simulate_candidate(site_for(None, True, supply), Candidate("split-field", 2)) for supply in (large, None)
    )
    bare = [format_plan(replace(one.run.plan, notes=PlanNotes())) for one in (with_tank, without)]
    assert bare[0] == bare[1]
    assert (with_tank.result.refills, without.result.refills) == (0, None)
    assert (with_tank.run.plan.notes.stops, without.run.plan.notes.stops) == ((), None)


def test_what_fills_goes_as_often_as_what_empties() -> None:
    collecting = replace(TANK, collects=True)
    found = simulate_candidate(site_for(HEADLAND, True, collecting), Candidate("split-field", 1))
    same = driven(*FIRST)
    assert found.run.plan.notes.stops == same.run.plan.notes.stops
    context = site_for(HEADLAND, True, collecting)
    ranking = rank_plans(context, [found.result])
    answer = write_answer(ranking)
    assert "stops to unload" in answer.work and "refill" not in " ".join((*answer.list_sentences(), *answer.details))
    table = print_text(build_ranking_table(ranking), 160)
    assert "Unloads" in table and "Refills" not in table
    assert build_run_picture(context, found.run, found.result).service == "unload"
    (own,) = list_steps(found.run, WIDTH_M)
    assert {describe_leg(step).split()[0] for step in own if step.kind == "refill"} == {"unload"}


@pytest.mark.slow
def test_the_place_costs_more_than_the_headland_and_a_far_one_more_than_a_near_one() -> None:
    times = [driven(refill, 1, "split-field", True).result.time_s or 0.0 for refill in (HEADLAND, "30,0")]
    wide = simulate_candidate(
        prepare_context(
            WorkOrder(PlanRequest(field="drawn", no_headland=True, refill="-45,0"), Field("drawn", BOX), supply=TANK)
        ),
        Candidate("split-field", 1),
    )
    assert times[0] < times[1] < (wide.result.time_s or 0.0)


@pytest.mark.parametrize("refill", [HEADLAND, SERVICE_VEHICLE, "30,0"])
def test_formations_that_would_have_to_part_say_what_helps(refill: str) -> None:
    found = simulate_candidate(site_for(refill), Candidate("row-by-row", 2))
    assert found.run is None and found.result.reason is not None
    assert "use split-field or interleaved, or a larger tank" in found.result.reason
    enough = simulate_candidate(site_for(refill, True, replace(TANK, capacity=5000.0)), Candidate("row-by-row", 2))
    assert enough.result.feasible and enough.result.refills == 0


@pytest.mark.parametrize(
    ("refill", "supply", "words"),
    [
        ("headland", None, "no implement carries anything"),
        ("nowhere", TANK, "'nowhere' is not a place; write headland, tender or x,y in metres"),
        ("1,2,3", TANK, "is not a place"),
        ("nan,2", TANK, "is not a place"),
        ("30,-51", TANK, "lies 51 m from the field; it must be within 50 m"),
        ("60,0", replace(TANK, capacity=44.9), "takes at least 45 l or kg, and a load is 44.9; use a larger tank"),
    ],
)
def test_what_cannot_be_is_refused_in_a_sentence(refill: str | None, supply: Supply | None, words: str) -> None:
    with pytest.raises(RequestError) as refusal:
        prepare_context(WorkOrder(PlanRequest(field="drawn", refill=refill), Field("drawn", BOX), supply=supply))
    assert words in str(refusal.value)


@pytest.mark.slow
@pytest.mark.parametrize(("refill", "capacity"), [(None, 70.0), ("60,0", 46.0)])
def test_a_tank_smaller_than_a_track_takes_is_filled_within_the_track(refill: str | None, capacity: float) -> None:
    tank = replace(TANK, capacity=capacity)
    context = site_for(refill, True, tank)
    assert max(tank.compute_need(track.length_m, WIDTH_M) for track in context.layout.swaths) > tank.capacity
    found = simulate_candidate(context, Candidate("split-field", 1))
    assert found.result.feasible
    ((_, left, used),) = levels(found.run.plan, tank)
    assert min(left) >= -1e-6 and used / RATE == pytest.approx(
        WIDTH_M * sum(track.length_m for track in context.layout.swaths), rel=0.03
    )


def test_the_only_track_is_worked_however_long_its_stops_take() -> None:
    strip, tank = Field("strip", shapely.box(0, 0, 1.1 * WIDTH_M, 110)), replace(TANK, capacity=60.0)
    request = PlanRequest(field="strip", no_headland=True, bearing_deg=0.0, refill="3,0")
    found = simulate_candidate(prepare_context(WorkOrder(request, strip, supply=tank)), Candidate("split-field", 1))
    assert found.result.feasible and found.result.refills == 1


def test_the_field_file_says_where(tmp_path: Path) -> None:
    path = tmp_path / "field.geojson"
    write_field(Field("drawn", BOX, service_point=(60.0, 40.0)), path)
    field = read_field(path)
    assert field.service_point == (60.0, 40.0)
    site = prepare_context(WorkOrder(PlanRequest(field="drawn", no_headland=True), field, supply=TANK))
    assert (site.supply.served_at, site.supply.place) == (PLACE, (60.0, 40.0))
    asked = prepare_context(
        WorkOrder(PlanRequest(field="drawn", no_headland=True, refill="tender"), field, supply=TANK)
    )
    assert (asked.supply.served_at, asked.supply.place) == (SERVICE_VEHICLE, None)


def test_stops_have_their_place_on_the_earth() -> None:
    field = Field("earth", BOX, crs="EPSG:32632", origin_m=(500_000.0, 5_400_000.0))
    lon, lat = field.to_wgs84([(0.0, 0.0)])[0].tolist()
    site = prepare_context(
        WorkOrder(PlanRequest(field="earth", no_headland=True, refill=f"{lon},{lat}"), field, supply=TANK)
    )
    assert site.supply.place == pytest.approx((0.0, 0.0), abs=1e-3)
    plan = Plan((), PlanNotes(stops=(NotedStop(0, 3, 5.0, 0.0, 0.0),)))
    (told,) = add_coordinates(plan, field).notes.stops
    assert (told.lon, told.lat) == pytest.approx((lon, lat), abs=1e-9)
    assert add_coordinates(plan, Field("drawn", BOX)) is plan


@pytest.mark.slow
def test_the_ranking_tells() -> None:
    site, found = site_for("60,0"), driven(*CASES[0])
    ranking = rank_plans(site, [found.result])
    count = found.result.refills
    assert f"{count} refills" in write_answer(ranking).work
    entry = json.loads(format_ranking_json(ranking))["plans"][0]
    assert (entry["refills"], entry["refilling_s"]) == (count, pytest.approx(found.result.refilling_s))
    assert json.loads(format_ranking_json(ranking))["scenario"]["capacity"] == TANK.capacity
    assert any("carries 300" in words for words in ranking.assumptions)


def test_an_implement_of_the_farm_carries() -> None:
    drill = FarmImplement(name="drill", capacity=800.0, rate_per_m2=0.02)
    assert drill.build_supply(240.0) == Supply(800.0, 0.02, 240.0)
    assert FarmImplement(name="plough").build_supply(240.0) is None
