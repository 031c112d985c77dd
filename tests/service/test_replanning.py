"""A plan driven live by simulated tractors, and the tracks of one that has failed given to the others."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import pytest
import shapely

from planner.candidates.evaluate import Candidate, simulated
from planner.saving import saved_plan
from planner.scenario import Scenario
from planner.service.centre.centre import Centre
from planner.service.centre.errors import CentreError
from planner.service.centre.fleet_plan import FleetPlan, prepared
from planner.service.centre.progress import progress_of, restore
from planner.service.centre.remaining import check_still, rest_of
from planner.service.centre.replanning import Proposal, replanned
from planner.service.centre.rules import Rules
from planner.service.centre.tractors import WAITS, Report
from planner.service.links.converting import report_of
from planner.service.links.frames import OF_ROLE
from planner.service.robot.driver import Driver
from planner.site import prepare
from vehicle.plan_file import plan_from_json, plan_to_json

FIELD = {
    "type": "FeatureCollection",
    "features": [{"type": "Feature", "properties": {}, "geometry": {
        "type": "Polygon", "coordinates": [[[0, 0], [70, 0], [70, 60], [0, 60], [0, 0]]]}}],
}  # fmt: skip


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> FleetPlan:
    file: Path = tmp_path_factory.mktemp("field") / "field.geojson"
    file.write_text(json.dumps(FIELD), encoding="utf-8")
    scenario = Scenario(field=str(file), local=True, width_m=3.0, tractors=(3,), strategies=("split-field",),
                        entrance=(0.0, 0.0))
    site = prepare(scenario)
    run = simulated(site, Candidate("split-field", 3)).run
    assert run is not None
    return prepared(saved_plan(site, run.plan), file)


def at(plan: FleetPlan, share: float) -> Centre:
    """A fleet each of whose tractors has driven so much of its plan."""
    centre = Centre(plan, Rules())
    centre.start("anna", 0.0)
    for number, course in enumerate(plan.courses):
        centre.joined(number, 0.0)
        at_m = share * course.before_m[-1]
        leg = next(k for k in range(len(course.legs)) if course.before_m[k + 1] > at_m)
        x, y, heading = course.along(leg, at_m - course.before_m[leg], [0.0], len(course.legs))[0]
        centre.states[number].released = leg + 1
        for each in range(leg + 1):
            metres = at_m - course.before_m[leg] if each == leg else course.lengths_m[each]
            centre.reported(number, Report(x, y, heading, 1.0, leg=each, leg_m=metres), 0.1)
    centre.tick(0.2)
    return centre


@pytest.fixture(scope="module")
def half(plan: FleetPlan) -> tuple[Centre, Proposal]:
    centre = at(plan, 0.4)
    centre.fail("anna", 1, 1.0)
    return centre, replanned(rest_of(centre, [], 100.0))


def worked(plan: FleetPlan, number: int, first: int) -> shapely.Geometry:
    legs = plan.courses[number].legs[first:]
    return shapely.union_all([shapely.LineString(leg.points).buffer(1.6, cap_style="flat") for leg in legs
                              if leg.implement])  # fmt: skip


def test_what_one_has_left_is_worked_by_the_others(half: tuple[Centre, Proposal]) -> None:
    centre, proposal = half
    left = worked(centre.plan, 1, centre.states[1].leg + 1)
    taken = shapely.union_all([worked(proposal.plan, number, proposal.kept[number]) for number in (0, 2)])
    report = centre.states[1].report
    assert report is not None
    standing = shapely.Point(report.x_m, report.y_m).buffer(9.0)
    # Driven the other way, the guided point is on a track a tool's distance earlier.
    assert shapely.difference(shapely.difference(left, taken), standing).area < 0.05 * left.area
    assert proposal.moved_m > 50.0 and proposal.left_m == 0.0
    assert proposal.sentence == f"{proposal.blocked_m:.0f} m of track lie too near to tractor 2 and stay open."


@pytest.mark.parametrize("number, share", [(0, 0.55), (1, 0.15), (2, 0.15)])
def test_hardly_anything_that_can_be_reached_stays_open(plan: FleetPlan, number: int, share: float) -> None:
    centre = at(plan, share)
    centre.fail("anna", number, 1.0)
    proposal = replanned(rest_of(centre, [], 100.0))
    state, course = centre.states[number], plan.courses[number]
    own_m = course.worked_m[-1] - course.done_m(state.leg, state.leg_m)
    assert proposal.left_m <= 0.03 * own_m
    assert proposal.moved_m + proposal.left_m + proposal.blocked_m > 0.9 * own_m


@pytest.mark.parametrize("number", [0, 2])
def test_before_the_start_those_that_are_left_come_in_one_after_another(plan: FleetPlan, number: int) -> None:
    proposal = replanned(rest_of(Centre(plan, Rules()), [number], 0.0))
    assert proposal.left_m == proposal.blocked_m == 0.0 and proposal.sentence is None
    firsts = [course.legs[0] for n, course in enumerate(proposal.plan.courses) if n != number]
    assert sorted(bool(leg.gates) for leg in firsts) == [False, True]
    assert all(gate.tractor != number for leg in firsts for gate in leg.gates)


def test_the_rest_takes_longer_without_one_and_less_than_alone(half: tuple[Centre, Proposal]) -> None:
    centre, proposal = half
    planned = max(course.before_s[-1] for course in centre.courses)
    assert 0.6 * planned < proposal.eta_s < 2.0 * planned


def test_an_accepted_plan_has_the_same_released_legs_and_goes_on(half: tuple[Centre, Proposal]) -> None:
    centre, proposal = half
    before = [(state.leg, state.released) for state in centre.states]
    legs = [len(course.legs) for course in centre.courses]
    centre.acknowledge("bert", centre.alarms.items()[0].id, 100.5)
    centre.adopt("anna", proposal.plan, 101.0, (1,))
    assert [(state.leg, state.released) for state in centre.states] == before
    assert len(centre.courses[0].legs) > legs[0] or len(centre.courses[2].legs) > legs[2]
    orders, events = centre.taken()
    assert {order.tractor for order in orders if order.kind == "plan"} == {0, 1, 2}
    assert "accept" in [event.what for event in events]
    (alarm,) = [each for each in centre.alarms.items() if each.code == "failed"]
    assert alarm.sentence == "Tractor 2 has failed; its tracks were given to others." and alarm.acknowledged == "bert"
    centre.tick(102.0)
    assert not any(gate.tractor == 1 for n in (0, 2) for leg in centre.courses[n].legs for gate in leg.gates)
    again = Centre(centre.plan, Rules())
    restore(again, json.loads(json.dumps(progress_of(centre, 102.0, 0.0))), 0.0, 0.0)
    assert [state.leg for state in again.states] == [state.leg for state in centre.states]


def test_a_proposal_is_a_plan_that_is_saved_and_read(half: tuple[Centre, Proposal]) -> None:
    made = half[1].plan
    text = plan_to_json(made.plan, scenario=made.saved.scenario)
    assert plan_from_json(text).tractors == 3


def test_what_cannot_be_planned_anew_is_refused_in_a_sentence(plan: FleetPlan) -> None:
    centre = at(plan, 0.1)
    with pytest.raises(CentreError, match="No tractor has failed"):
        rest_of(centre, [], 0.0)
    with pytest.raises(CentreError, match="No tractor is left"):
        rest_of(centre, [0, 1, 2], 0.0)


def test_simulated_tractors_drive_a_plan_live_in_the_time_it_was_planned_for(plan: FleetPlan) -> None:
    """All but the network: steering, speed control and noise of every tractor, releases and orders."""
    centre, now = Centre(plan, Rules()), 0.0
    drivers = [
        Driver(mission, plan.tractor, plan.implement, plan.saved.origin_m, name="robot", noise_m=0.02, seed=number)
        for number, mission in enumerate(plan.plan.missions)
    ]
    for number in range(plan.tractors):
        centre.joined(number, now)
    centre.start("anna", now)
    while centre.state != "done" and now < 1.2 * max(plan.finish_s):
        now += 0.1
        orders, events = centre.taken()
        for order in orders:
            drivers[order.tractor].heard({"kind": order.kind, "reason": ""} | order.data, now)
        assert not [event for event in events if event.what == "too near another"]
        for number, driver in enumerate(drivers):
            driver.heard({"kind": "beat"}, now)
            state = OF_ROLE["tractor"].validate_json(json.dumps(driver.step(now)))
            centre.reported(number, report_of(state, plan), now)
        centre.tick(now)
    assert now == pytest.approx(max(plan.finish_s), rel=0.03)
    assert centre.done_m() == pytest.approx(plan.worked_m)


def test_who_drives_is_not_told_to_wait_on_its_leg_and_who_stands_waits_there(plan: FleetPlan) -> None:
    centre = at(plan, 0.3)
    centre.fail("anna", 2, 1.0)
    with pytest.raises(CentreError, match="have to wait on what is driven already: pause tractor 2 and ask again"):
        replanned(rest_of(centre, [], 100.0))
    stand(centre)
    rest = rest_of(centre, [], 100.0)
    made = replanned(rest).plan
    state = centre.states[1]
    (gate,) = made.courses[1].legs[state.leg].gates
    assert gate.tractor == 0 and state.leg < state.released
    assert not any(gate.tractor == 2 for course in made.courses for leg in course.legs for gate in leg.gates)
    check_still(rest, centre, made)
    centre.adopt("anna", made, 101.0, rest.without)
    centre.resume("anna", None, 103.0)
    centre.taken()
    centre.tick(103.2)
    assert state.holds == {WAITS} and state.standing_ordered and not centre.states[0].holds
    assert centre.waits_for(1) == [(gate.tractor, gate.leg)]
    assert 0.0 < centre.finish_in_s[0] < centre.finish_in_s[1] < math.inf
    kept = Centre(centre.plan, Rules())
    restore(kept, json.loads(json.dumps(progress_of(centre, 103.2, 0.0))), 0.0, 0.0)
    kept.tick(0.2)
    assert kept.states[1].holds == {WAITS}, "a restart does not let it go"
    centre.states[0].leg, centre.states[0].leg_m = gate.leg, gate.after_m + 0.1
    centre.tick(103.4)
    assert not state.holds and not state.standing_ordered and centre.waits_for(1) == []


def test_a_plan_with_one_that_waits_where_it_stood_is_not_accepted_when_it_has_gone_on(plan: FleetPlan) -> None:
    centre = at(plan, 0.3)
    centre.fail("anna", 2, 1.0)
    stand(centre)
    rest = rest_of(centre, [], 100.0)
    made = replanned(rest).plan
    moving = replace(centre.states[1].report, speed_mps=1.0)  # type: ignore[type-var]
    centre.states[1].report = moving
    with pytest.raises(CentreError, match="Tractor 2 drives already where it would have to wait"):
        centre.adopt("anna", made, 101.0, rest.without)
    centre.states[1].report = replace(moving, speed_mps=0.0, x_m=moving.x_m + 3.0)
    with pytest.raises(CentreError, match=r"Tractor 2 was to wait where it stood and has moved 3\.0 m"):
        check_still(rest, centre, made)


def stand(centre: Centre) -> None:
    """Everybody is paused, and stands."""
    centre.pause("anna", None, 2.0)
    for state in centre.states:
        assert state.report is not None
        state.report = replace(state.report, speed_mps=0.0, mode="stopped")
