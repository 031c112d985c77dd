"""A fleet goes on from where it is: what its new plan keeps and does, and all of it with a real service and robots."""

import math
import os
import re
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from playwright.sync_api import Browser

from fields.arrays import cut_line
from planner.cli.robots import DEMO_FIELD, DEMO_TRACTORS, DEMO_WIDTH_M
from planner.evaluation.preparation import prepare_context
from planner.evaluation.work_order import WorkOrder
from planner.fleet.manager.remaining_work import RemainingWork, check_proposal_still_fits, extract_remaining_work
from planner.fleet.model.fleet_plan import FleetPlan
from planner.fleet.model.rules import FleetManagerError
from planner.fleet.replanning.planning_anew import (
    MENTIONED_M,
    ReplanProposal,
    _build_taken_ground,
    continue_remaining_work,
)
from planner.fleet.safety.compliance import build_area_doubt
from planner.pipeline.executors import SerialExecutor
from planner.pipeline.outputs.saved_plans import write_saved_plan
from planner.pipeline.planning import plan as make_plan
from planner.request.plan_request import PlanRequest
from planner.service.errors import ServiceError
from planner.service.fleets.robot_client import request_json
from strategies.lines.work_line import build_tool_strip
from strategies.programmes.site_moves import SiteMoves
from tests.service.fleets import restart_manager
from tests.service.running import COMMAND, Running, run_service
from tests.service.test_replanning import WIDTH_M, at, start_live
from tests.service.watching import NARROW, WIDE, WatchedPage, find_overflow
from vehicle.missions.plan import LEAVE

pytestmark = pytest.mark.slow

TIMES = 6.0
LONGEST_S = 900.0


def stop_and_go_on(plan: FleetPlan, share: float, without: list[int]) -> tuple[RemainingWork, ReplanProposal, Any]:
    manager = at(plan, share)
    manager.operators.stop_all("anna", 1.0)
    remaining = extract_remaining_work(manager, without, 100.0)
    return remaining, continue_remaining_work(remaining), manager


def unite_strips(plan: FleetPlan, legs_of: Callable[[int], slice]) -> shapely.Geometry:
    tool_m = plan.tractor.antenna_forward_m + plan.implement.hitch_m
    legs = (leg for number, mission in enumerate(plan.timed_missions) for leg in mission.legs[legs_of(number)])
    return shapely.union_all([build_tool_strip(leg.points, tool_m, WIDTH_M) for leg in legs if leg.implement])


@pytest.mark.parametrize("without", [[], [1]])
def test_all_that_is_left_is_planned_anew_and_what_is_released_stays(plan: FleetPlan, without: list[int]) -> None:
    remaining, proposal, manager = stop_and_go_on(plan, 0.4, without)
    for number, (state, kept) in enumerate(zip(manager.states, proposal.unchanged_legs, strict=True)):
        old, new = plan.timed_missions[number].legs[:kept], proposal.plan.timed_missions[number].legs[:kept]
        least = state.leg if number in remaining.excluded else state.base_end  # who is left out drives no further
        assert kept >= least and all(np.array_equal(a.points, b.points) for a, b in zip(old, new, strict=True))
        assert number not in without or len(proposal.plan.timed_missions[number].legs) == kept
    done = unite_strips(proposal.plan, lambda number: slice(0, proposal.unchanged_legs[number]))
    again = unite_strips(proposal.plan, lambda number: slice(proposal.unchanged_legs[number], None))
    due = unite_strips(plan, lambda _: slice(None))
    standing = shapely.union_all(
        [shapely.Point(remaining.get_pose(number)[:2]).buffer(9.0) for number in without] or [shapely.Point()]
    )
    left_m2 = shapely.difference(due, shapely.union_all([done, again, standing])).area
    assert left_m2 < 0.02 * due.area
    left_s = [max(plan.finish_s) * 0.6] if not without else [sum(plan.finish_s) * 0.6 / 2]
    assert proposal.eta_s < 1.35 * left_s[0]  # who meets whom may cost a wait
    check_proposal_still_fits(remaining, manager, proposal.plan)
    # What follows the legs that a tractor keeps are other legs, so that its old gates say nothing of them.
    ends = proposal.unchanged_legs
    known = [{gate for leg in mission.legs for gate in leg.gates} for mission in plan.timed_missions]
    for number, state in enumerate(remaining.states):
        for leg in proposal.plan.timed_missions[number].legs[state.leg + 1 : ends[number]]:
            assert not [gate for gate in leg.gates if gate in known[number] and gate.leg >= ends[gate.tractor]]
    manager.operators.adopt_plan("anna", proposal.plan, 101.0, remaining.excluded)
    assert [state.leg for state in manager.states] == [state.leg for state in remaining.states]


def test_who_stands_where_and_how_much_is_left_is_told(plan: FleetPlan) -> None:
    remaining, proposal, _ = stop_and_go_on(plan, 0.4, [1])
    driven = [
        cut_line(leg.points, 0.0, min(leg.length_m, state.leg_m if number == state.leg else math.inf))
        for state in remaining.states
        for number, leg in enumerate(state.mission.legs[: state.leg + 1])
        if leg.implement and (number < state.leg or state.leg_m > 0.0)
    ]
    tool_m = plan.tractor.antenna_forward_m + plan.implement.hitch_m
    worked_ha = 1e-4 * shapely.union_all([build_tool_strip(points, tool_m, WIDTH_M) for points in driven]).area
    told = re.search(r"([\d.]+) of 0.42 ha are left", proposal.sentence)
    assert told is not None and float(told[1]) == pytest.approx(0.42 - worked_ha, abs=0.015), "also what they keep"
    assert proposal.sentence.startswith("Tractor 1 is ") and "Tractor 2 is left out." in proposal.sentence
    assert "of 0.42 ha are left to work." in proposal.sentence
    blocked = f"{proposal.blocked_m:.0f} m of track are too near tractor 2 and remain unworked."
    assert (blocked in proposal.sentence) == (proposal.blocked_m >= MENTIONED_M)


def test_where_no_way_leads_on_that_is_said(plan: FleetPlan, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, found in (("list_options", ()), ("list_cut_moves", ()), ("search", None)):
        monkeypatch.setattr(SiteMoves, name, lambda *_, found=found: found)
    with pytest.raises(FleetManagerError, match="Nothing more can be done: tracks and headland sides of"):
        stop_and_go_on(plan, 0.5, [])


def test_one_that_stands_in_the_entrance_keeps_others_from_leaving_and_from_coming_in_but_not_from_work(
    plan: FleetPlan,
) -> None:
    manager = at(plan, 0.4)
    manager.operators.stop_all("anna", 1.0)
    manager.states[1].report = manager.states[1].report._replace(x_m=4.0, y_m=1.5, heading_rad=0.0)
    proposal = continue_remaining_work(extract_remaining_work(manager, [1], 100.0))
    assert "The entrance is blocked by tractor 2: tractors on the field stay there" in proposal.sentence
    assert proposal.unreachable_m < 0.05 * proposal.reassigned_m
    assert not any(leg.task.kind == LEAVE for number in (0, 2) for leg in proposal.plan.timed_missions[number].legs)
    outside = manager.states[2]
    outside.leg, outside.leg_m, outside.base_end, outside.report = 0, 0.0, 0, None
    with pytest.raises(FleetManagerError, match="The entrance is blocked by tractor 2; clear it"):
        continue_remaining_work(extract_remaining_work(manager, [1], 100.0))


def test_what_is_released_past_one_that_stands_is_said_and_who_is_caught_can_be_left_out(plan: FleetPlan) -> None:
    manager = at(plan, 0.4)
    manager.operators.stop_all("anna", 1.0)
    caught = manager.states[1]
    last = caught.mission.legs[max(caught.base_end, caught.leg + 1) - 1]
    place, before = last.points[-1], last.points[-2]
    heading_rad = math.atan2(*(place - before)[::-1])
    manager.states[0].report = manager.states[0].report._replace(
        x_m=float(place[0]), y_m=float(place[1]), heading_rad=heading_rad
    )
    words = "What tractor 2 keeps leads too near tractor 1: clear the way, or leave tractor 2 out as well."
    for excluded in ([0], [0, 2]):  # tractor 3 stands elsewhere
        with pytest.raises(FleetManagerError, match=re.escape(words)):
            continue_remaining_work(extract_remaining_work(manager, excluded, 100.0))
    assert continue_remaining_work(extract_remaining_work(manager, [0, 1], 100.0)).reassigned_m > 100.0


def test_the_place_of_one_in_doubt_is_said_and_planned_round_if_it_is_left_out(plan: FleetPlan) -> None:
    manager = at(plan, 0.4)
    manager.operators.stop_all("anna", 1.0)
    manager._start_doubt(1, build_area_doubt(manager.states[1].report, 0.0), 1.0)
    manager.states[1].doubt.radius_m = 5.0
    remaining = extract_remaining_work(manager, [], 100.0)
    sentence = continue_remaining_work(remaining).sentence
    assert "Its place is in doubt: it may be up to 5 m from where it was." in sentence
    left_out = extract_remaining_work(manager, [1], 100.0)
    context = prepare_context(WorkOrder(plan.scenario, plan.field, plan.tractor, plan.implement), physics=plan.physics)
    taken = _build_taken_ground(left_out, context, 1.0).area
    place = shapely.Point(manager.states[1].doubt.pose[:2])
    assert taken.contains(place.buffer(5.0)) and taken.area < place.buffer(15.0).area


@pytest.mark.parametrize("speed_mps", [0.0, 1.0])
def test_one_that_was_heard_last_as_it_moved_is_planned_round_where_it_may_have_gone(
    plan: FleetPlan, speed_mps: float
) -> None:
    moments = (at(plan, share) for share in (0.4, 0.42, 0.44, 0.46, 0.48))
    manager = next(each for each in moments if each.states[1].present_leg.implement)  # on its line it goes straight on
    manager.operators.stop_all("anna", 1.0)
    state = manager.states[1]
    state.report = state.report._replace(speed_mps=speed_mps, mode="stopped")
    heard = extract_remaining_work(manager, [1], 100.0)
    manager.disconnect_tractor(1, 100.0, False)
    if speed_mps > 0.0:
        with pytest.raises(FleetManagerError, match="The link to tractor 2 broke as it moved"):
            check_proposal_still_fits(heard, manager)
    remaining = extract_remaining_work(manager, [1], 100.0)
    check_proposal_still_fits(remaining, manager)
    context = prepare_context(WorkOrder(plan.scenario, plan.field, plan.tractor, plan.implement), physics=plan.physics)
    taken = _build_taken_ground(remaining, context, 1.0).area
    last = manager.guard.predict_paths(manager.states, [1])[0, -1]
    nose = shapely.Point(last[:2] + 0.5 * plan.tractor.length_m * np.array([np.cos(last[2]), np.sin(last[2])]))
    assert taken.contains(nose.buffer(plan.scenario.clearance_m))
    end = state.mission.sample_poses(state.leg, state.leg_m, np.array([1e6]), state.base_end)[0, :2]
    assert taken.contains(shapely.Point(end)) == (speed_mps > 0.0), "the broken link says that it drives on"
    to_end_m = max(state.base_end_m - state.position_m, 0.0) * (speed_mps > 0.0)
    assert shapely.Point(remaining.get_pose(1)[:2]).buffer(to_end_m + 12.0).contains(taken)


def test_an_obstacle_is_worked_round(plan: FleetPlan) -> None:
    manager = at(plan, 0.4)
    last = [leg for leg in plan.saved.plan.missions[0].legs if leg.implement][-1]
    west, south = last.points.mean(axis=0) - 1.5
    corners = ((west, south), (west + 3.0, south), (west + 3.0, south + 3.0), (west, south + 3.0))
    manager.obstacles.add(corners, "stone", "anna")
    manager.operators.stop_all("anna", 1.0)
    remaining = extract_remaining_work(manager, [], 100.0)
    manager.update_blocked_legs()
    assert any(manager.blocked_legs)
    proposal = continue_remaining_work(remaining)
    assert proposal.blocked_m > 1.0 and "are too near an obstacle and remain unworked." in proposal.sentence
    manager.operators.adopt_plan("anna", proposal.plan, 101.0, remaining.excluded)
    assert not any(manager.blocked_legs)


def test_robots_take_up_the_new_mission_where_they_stand_and_drive_it_to_its_end(plan: FleetPlan) -> None:
    fleet = start_live(plan)
    begin_s = 0.4 * max(plan.finish_s)
    fleet.drive(lambda: fleet.now >= begin_s, begin_s + 1.0)
    fleet.manager.operators.stop_all("anna", fleet.now)
    stopped_s = fleet.now
    fleet.drive(lambda: fleet.now >= stopped_s + 10.0, 11.0)
    del fleet.drivers[1]
    remaining = extract_remaining_work(fleet.manager, [1], fleet.now)
    proposal = continue_remaining_work(remaining)
    check_proposal_still_fits(remaining, fleet.manager, proposal.plan)
    fleet.manager.operators.adopt_plan("anna", proposal.plan, fleet.now, remaining.excluded)
    fleet.drive(lambda: fleet.now >= stopped_s + 12.0, 3.0)
    fleet.manager.operators.resume_tractors("anna", None, fleet.now)
    resumed_s = fleet.now
    fleet.drive(lambda: fleet.now >= resumed_s + 0.3 * proposal.eta_s, proposal.eta_s)
    fleet.manager = restart_manager(fleet.manager, fleet.now, fleet.now)  # the service is killed and begins anew
    for number, driver in fleet.drivers.items():
        driver.handle_frame({"kind": "stop", "reason": "restart"}, fleet.now)
        fleet.manager.connect_tractor(number, fleet.now)
    fleet.drive(lambda: fleet.now >= resumed_s + 0.3 * proposal.eta_s + 5.0, 6.0)
    fleet.manager.operators.resume_tractors("anna", None, fleet.now)
    fleet.drive(lambda: fleet.manager.state == "done", 1.3 * proposal.eta_s)
    assert fleet.now - resumed_s < 1.1 * proposal.eta_s + 20.0
    assert all(legs == sorted(legs) for legs in fleet.legs.values()), "no leg is driven twice"


@contextmanager
def drive_robot(number: int, plan: Path, url: str, fleet: str, token: str) -> Iterator[subprocess.Popen[str]]:
    words = ("robot", "--plan", str(plan), "--tractor", str(number), "--url", url, "--fleet", fleet)
    process = subprocess.Popen([*COMMAND, *words], text=True, env=os.environ | {"HEADLAND_TOKEN": token})
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def await_answer(ask: Callable[[], Any], is_it: Callable[[Any], bool]) -> Any:
    """The first answer that is it; the service may be away in between."""
    until, answer = time.monotonic() + LONGEST_S, None
    while time.monotonic() < until:
        try:
            answer = ask()
            if is_it(answer):
                return answer
        except ServiceError as refusal:
            answer = refusal
        time.sleep(0.5)
    pytest.fail(f"in vain for {LONGEST_S:.0f} s, at last: {answer}")


@dataclass
class RequestOperator:
    """Somebody who orders a fleet over HTTP; also after the service began anew."""

    url: str
    fleet: str
    token: str

    def order(self, what: str, **values: Any) -> Any:
        return await_answer(lambda: request_json(self.url, f"fleets/{self.fleet}/{what}", self.token, values), bool)

    def start(self) -> None:
        self.order("start")

    def stop(self) -> None:
        self.order("stop")

    def go_on_without(self, tractor: int) -> None:
        self.order("accept", proposal=self.order("replan", without=[tractor])["proposal"])

    def resume(self) -> None:
        self.order("resume")

    def see_the_end(self) -> None:
        """Nothing: what is asked of the service says it."""


class PageOperator:
    """Somebody who orders a fleet by its page, which stays open while the service is away."""

    def __init__(self, browser: Browser, url: str, fleet: str, token: str) -> None:
        self.watched = WatchedPage(browser, f"{url}/", token)
        self.page = self.watched.open(f"/fleet/{fleet}")

    def start(self) -> None:
        self.page.click("button:text-is('Start')")

    def stop(self) -> None:
        self.page.click("text=STOP ALL")
        self.page.wait_for_selector(".badge:text-is('Stopped')")

    def go_on_without(self, tractor: int) -> None:
        self.page.select_option("select[aria-label='Who goes on']", str(tractor))
        self.page.click("text=Go on from here")
        note = self.page.locator(".note:has(button:text-is('Send to the tractors'))")
        note.wait_for()
        shown = note.inner_text()
        for words in ("Tractor 1 is ", f"Tractor {tractor} is left out.", "ha are left to work.", "done in"):
            assert words in shown, shown
        for size in (NARROW, WIDE):
            self.page.set_viewport_size(size)
            assert find_overflow(self.page) == []
        note.get_by_role("button", name="Send to the tractors").click()
        note.wait_for(state="detached")
        self.page.get_by_text("The tractors have the new plan and stand").wait_for()
        self.watched.well()

    def resume(self) -> None:
        self.page.click("button:text-is('Resume')")
        self.page.get_by_text("The tractors have the new plan and stand").wait_for(state="detached")

    def see_the_end(self) -> None:
        self.page.wait_for_selector(".badge:text-is('Done')")
        chosen = self.page.input_value("select[aria-label='Who goes on']")
        assert chosen == "2", "what is chosen stays chosen as the scene changes"


@pytest.mark.matrix
@pytest.mark.parametrize("by", ["requests", "page"])
def test_a_stopped_fleet_loses_a_robot_goes_on_and_outlives_a_killed_service(
    tmp_path: Path, by: str, request: pytest.FixtureRequest
) -> None:
    """The demonstration fleet: no leg is driven twice, and the new plan is driven to its end."""
    made = plan_demonstration()
    file = tmp_path / "plan.json"
    file.write_text(made, encoding="utf-8")
    with ExitStack() as stack:
        with run_service(tmp_path / "data") as service:
            token = take_token(service, "operator")
            url = f"http://127.0.0.1:{service.port}"
            uploaded = {"name": "f", "plan": made, "times": TIMES}
            fleet = request_json(url, "fleets", token, uploaded)["id"]
            robots = [
                stack.enter_context(
                    drive_robot(n, file, url, fleet, take_token(service, "robot", f"robot {n}", fleet=fleet, tractor=n))
                )
                for n in (1, 2, 3)
            ]
            legs = [[0], [0], [0]]
            seen = fleet, token
            operator: RequestOperator | PageOperator = (
                RequestOperator(url, *seen)
                if by == "requests"
                else PageOperator(request.getfixturevalue("browser"), url, *seen)
            )

            def look() -> Any:
                answer = request_json(url, f"fleets/{fleet}", token)
                for before, tractor in zip(legs, answer["tractors"], strict=True):
                    before.append(tractor.get("leg") or 0)
                return answer

            operator.start()
            await_answer(look, lambda _: all(max(each) > 4 for each in legs))
            operator.stop()
            robots[1].kill()
            await_answer(look, lambda answer: answer["tractors"][1]["connection"] != "online")
            operator.go_on_without(2)
            time.sleep(2.0)
            operator.resume()
            gone_on = [each[-1] for each in legs]
            await_answer(look, lambda _: any(each[-1] > 3 + first for each, first in zip(legs, gone_on, strict=True)))
            second = subprocess.run(
                [*COMMAND, "serve", "--port", "0", "--data", str(tmp_path / "data")], capture_output=True, text=True
            )
            assert second.returncode != 0 and "Another headland serve has the folder" in second.stderr
            assert look()["fleet"]["state"] == "running"
            service.process.send_signal(signal.SIGKILL)
            service.process.wait()
        with run_service(tmp_path / "data", "--port", str(service.port)):
            operator.resume()
            await_answer(look, lambda answer: answer["fleet"]["state"] == "done")
            operator.see_the_end()
    assert all(each == sorted(each) for each in legs)


def plan_demonstration() -> str:
    """The plan of `headland demo fleet`."""
    request = PlanRequest(
        field=DEMO_FIELD, width_m=DEMO_WIDTH_M, tractors=(DEMO_TRACTORS,), strategies=("split-field",)
    )
    answer = make_plan(request, executor=SerialExecutor())
    assert answer.run is not None
    return write_saved_plan(answer.context, answer.run.plan)


def take_token(service: Running, scope: str, name: str = "", **restrictions: Any) -> str:
    return service.make_token(scope, name=name, **restrictions)["authorization"].removeprefix("Bearer ")
