"""The request of a plan: one set of names and defaults for the command line and the service."""

from __future__ import annotations

import inspect
from dataclasses import fields

import pytest

from planner.commands.plan import plan
from planner.errors import ScenarioError
from planner.request import PlanRequest
from planner.scenario import Scenario


def test_names_and_defaults_are_those_of_the_command() -> None:
    options = inspect.signature(plan).parameters
    for each in fields(PlanRequest):
        assert options[each.name].default == each.default, each.name


def test_a_request_of_nothing_is_the_scenario_of_nothing() -> None:
    asked, default = PlanRequest().scenario("iwamizawa", 3.0), Scenario(field="iwamizawa")
    differing = {each.name for each in fields(Scenario) if getattr(asked, each.name) != getattr(default, each.name)}
    assert differing <= {"speed_mps"}
    assert asked.speed_mps == pytest.approx(default.speed_mps)


def test_texts_are_read() -> None:
    asked = PlanRequest(tractors="1-3", speed_kmh=7.2, start="07:30", before="17:00", bearing=45.0, headland_last=True)
    scenario = asked.scenario("denmark", 6.0)
    assert (scenario.width_m, scenario.tractors, scenario.headland_order) == (6.0, (1, 2, 3), "last")
    assert scenario.speed_mps == pytest.approx(2.0)
    assert (scenario.start_s, scenario.before_s) == (27000, 61200)


def test_the_shift_starts_the_work_where_no_start_is_given() -> None:
    assert PlanRequest(before="17:00").scenario("denmark", 3.0, 21600).start_s == 21600
    assert PlanRequest(before="17:00", start="08:00").scenario("denmark", 3.0, 21600).start_s == 28800


def test_first_and_last_exclude_each_other() -> None:
    with pytest.raises(ScenarioError, match="exclude each other"):
        PlanRequest(headland_first=True, headland_last=True).scenario("denmark", 3.0)
