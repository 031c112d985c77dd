"""A fleet goes on from where it is: what its new plan keeps and does, and all of it with a real service and robots."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from planner.cli.robots import DEMO_FIELD, DEMO_TRACTORS, DEMO_WIDTH_M
from planner.fleet.manager.remaining_work import RemainingWork, check_proposal_still_fits, extract_remaining_work
from planner.fleet.model.errors import FleetManagerError
from planner.fleet.model.fleet_plan import FleetPlan
from planner.fleet.replanning.going_on import continue_remaining_work
from planner.fleet.replanning.replan import ReplanProposal
from planner.pipeline.executors import SerialExecutor
from planner.pipeline.outputs.saved_plans import write_saved_plan
from planner.pipeline.planning import plan as make_plan
from planner.request.plan_request import PlanRequest
from planner.service.errors import ServiceError
from planner.service.fleets.robot_client import request_json
from strategies.lines.work_line import build_tool_strip
from tests.service.running import COMMAND, Running, run_service
from tests.service.test_replanning import WIDTH_M, at, plan_three

TIMES = 6.0
LONGEST_S = 900.0


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> FleetPlan:
    return plan_three(tmp_path_factory, (0.0, 0.0))


def stop_and_go_on(plan: FleetPlan, share: float, without: list[int]) -> tuple[RemainingWork, ReplanProposal, Any]:
    manager = at(plan, share)
    manager.operators.stop_all("anna", 1.0)
    remaining = extract_remaining_work(manager, without, 100.0, goes_on=True)
    return remaining, continue_remaining_work(remaining), manager


def unite_strips(plan: FleetPlan, legs_of: Callable[[int], slice]) -> shapely.Geometry:
    tool_m = plan.tractor.antenna_forward_m + plan.implement.hitch_m
    return shapely.union_all(
        [
            build_tool_strip(leg.points, tool_m, WIDTH_M)
            for number, mission in enumerate(plan.timed_missions)
            for leg in mission.legs[legs_of(number)]
            if leg.implement
        ]
    )


@pytest.mark.slow
@pytest.mark.parametrize("without", [[], [1]])
def test_all_that_is_left_is_planned_anew_and_what_is_released_stays(plan: FleetPlan, without: list[int]) -> None:
    remaining, proposal, manager = stop_and_go_on(plan, 0.4, without)
    for number, (state, kept) in enumerate(zip(manager.states, proposal.unchanged_legs, strict=True)):
        old, new = plan.timed_missions[number].legs[:kept], proposal.plan.timed_missions[number].legs[:kept]
        assert kept >= state.base_end and all(np.array_equal(a.points, b.points) for a, b in zip(old, new, strict=True))
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
    assert proposal.eta_s < 1.15 * left_s[0]
    check_proposal_still_fits(remaining, manager, proposal.plan)
    manager.operators.adopt_plan("anna", proposal.plan, 101.0, remaining.excluded)
    assert [state.leg for state in manager.states] == [state.leg for state in remaining.states]


def test_who_stands_where_and_how_much_is_left_is_told(plan: FleetPlan) -> None:
    _, proposal, _ = stop_and_go_on(plan, 0.4, [1])
    assert proposal.sentence is not None
    assert proposal.sentence.startswith("Tractor 1 is ") and "Tractor 2 is left out." in proposal.sentence
    assert proposal.sentence.endswith("of 0.42 ha are left.")


def test_nobody_goes_on_where_all_are_left_out(plan: FleetPlan) -> None:
    with pytest.raises(FleetManagerError, match="keep at least one"):
        extract_remaining_work(at(plan, 0.4), [0, 1, 2], 100.0, goes_on=True)


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


@pytest.mark.matrix
def test_a_stopped_fleet_loses_a_robot_goes_on_and_outlives_a_killed_service(tmp_path: Path) -> None:
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
                    drive_robot(n, file, url, fleet, take_token(service, "robot", fleet=fleet, tractor=n))
                )
                for n in (1, 2, 3)
            ]
            legs = [[0], [0], [0]]

            def look() -> Any:
                answer = request_json(url, f"fleets/{fleet}", token)
                for before, tractor in zip(legs, answer["tractors"], strict=True):
                    before.append(tractor.get("leg") or 0)
                return answer

            order = lambda what, body=None: request_json(url, f"fleets/{fleet}/{what}", token, body or {})  # noqa: E731
            await_answer(lambda: order("start"), bool)
            await_answer(look, lambda _: all(max(each) > 4 for each in legs))
            order("stop")
            robots[1].kill()
            number = order("replan", {"goes_on": True, "without": [2]})["proposal"]
            await_answer(lambda: order("accept", {"proposal": number}), bool)
            time.sleep(2.0)
            order("resume")
            gone_on = [each[-1] for each in legs]
            await_answer(look, lambda _: any(each[-1] > 3 + first for each, first in zip(legs, gone_on, strict=True)))
            service.process.send_signal(signal.SIGKILL)
            service.process.wait()
        with run_service(tmp_path / "data", "--port", str(service.port)):
            await_answer(lambda: order("resume"), bool)
            await_answer(look, lambda answer: answer["fleet"]["state"] == "done")
    assert all(each == sorted(each) for each in legs)


def plan_demonstration() -> str:
    """The plan of `headland demo fleet`."""
    request = PlanRequest(
        field=DEMO_FIELD, width_m=DEMO_WIDTH_M, tractors=(DEMO_TRACTORS,), strategies=("split-field",)
    )
    answer = make_plan(request, executor=SerialExecutor())
    assert answer.run is not None
    return write_saved_plan(answer.context, answer.run.plan)


def take_token(service: Running, scope: str, **restrictions: Any) -> str:
    return service.make_token(scope, **restrictions)["authorization"].removeprefix("Bearer ")
