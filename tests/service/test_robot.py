"""A simulated robot: what it does with what it hears, and when it hears nothing."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from planner.service.links.converting import mission_told
from planner.service.links.frames import OF_ROLE
from planner.service.robot.driver import Driver
from planner.service.robot.sending import Unacknowledged
from tests.service.fleets import BAR, EG105, LENGTH, fleet_plan

PLAN = fleet_plan(1, 3)


def robot() -> Driver:
    driver = Driver(PLAN.plan.missions[0], EG105, BAR, PLAN.saved.origin_m, name="robot 1")
    driver.heard({"kind": "welcome", "settings": {"times": 1.0}, "last_sequence": 6,
                  "plan": mission_told(PLAN, 0)}, 0.0)  # fmt: skip
    return driver


def let(driver: Driver, begin: float, seconds: float, *, beats: bool = True) -> dict[str, object]:
    """Time passes; the last state."""
    state: dict[str, object] = {}
    for now in np.arange(begin, begin + seconds, 0.1):
        if beats:
            driver.heard({"kind": "beat", "time": ""}, float(now))
        state = driver.step(float(now))
    return state


def release(driver: Driver, legs: int, now: float, limit: float | None = None) -> None:
    driver.heard({"kind": "release", "update": legs, "released": legs, "announced": 3, "limit_mps": limit}, now)
    driver.heard({"kind": "resume"}, now)


def test_it_stands_until_it_is_told_and_goes_on_from_the_known_sequence() -> None:
    driver = robot()
    state = let(driver, 0.0, 1.0)
    assert state["mode"] == "stopped" and state["speed_mps"] == 0.0
    assert state["sequence"] == 16
    OF_ROLE["tractor"].validate_json(json.dumps(state))


def test_it_ends_its_released_leg_and_stands_there_also_when_the_centre_is_silent() -> None:
    driver = robot()
    release(driver, 1, 0.0)
    state = let(driver, 0.0, 10.0)
    assert float(str(state["leg_m"])) > 5.0
    state = let(driver, 10.0, 40.0, beats=False)
    assert state["leg"] == 0 and state["leg_m"] == pytest.approx(LENGTH, abs=0.2)
    assert state["speed_mps"] == pytest.approx(0.0, abs=0.02) and state["done"] is False


def test_silence_for_a_second_stops_one_that_is_driven_by_remote_control_or_follows() -> None:
    for limit in (None, 0.8):
        driver = robot()
        release(driver, 3, 0.0, limit)
        if limit is None:
            driver.heard({"kind": "command", "steering_command_deg": 5.0, "speed_command_mps": 0.8}, 0.0)
        state = let(driver, 0.0, 5.0)
        assert float(str(state["speed_mps"])) == pytest.approx(0.8, abs=0.1)
        state = let(driver, 5.0, 0.8, beats=False)
        assert state["mode"] != "stopped"
        state = let(driver, 5.8, 3.0, beats=False)
        assert state["mode"] == "stopped" and state["speed_mps"] == pytest.approx(0.0, abs=0.02)


def test_a_stop_is_obeyed_at_once_and_a_resume_after_it() -> None:
    driver = robot()
    release(driver, 3, 0.0)
    let(driver, 0.0, 8.0)
    driver.heard({"kind": "stop", "reason": "test"}, 8.0)
    state = let(driver, 8.0, 3.0)
    assert state["mode"] == "stopped" and state["speed_mps"] == pytest.approx(0.0, abs=0.02)
    driver.heard({"kind": "resume"}, 11.0)
    assert float(str(let(driver, 11.0, 5.0)["speed_mps"])) > 0.5


def test_it_drives_as_it_is_commanded_to_the_right() -> None:
    driver = robot()
    driver.heard({"kind": "command", "steering_command_deg": 20.0, "speed_command_mps": 1.0}, 0.0)
    state = let(driver, 0.0, 6.0)
    assert state["mode"] == "remote"
    assert 5.0 < float(str(state["heading_deg"])) < 180.0  # from north to the right
    east, north = PLAN.saved.origin_m
    assert float(str(state["easting_m"])) > east and math.isfinite(float(str(state["northing_m"])) - north)


def test_states_wait_until_they_are_acknowledged_and_the_oldest_are_lost_first() -> None:
    waiting = Unacknowledged(most=3)
    for sequence in range(5):
        waiting.add({"sequence": sequence})
    assert waiting.lost == 2 and len(waiting) == 3
    waiting.acknowledged(3)
    assert waiting.texts() == ['{"sequence":4}']


def test_one_that_starts_again_goes_on_where_it_was_and_one_that_is_linked_again_stays() -> None:
    driver = Driver(PLAN.plan.missions[0], EG105, BAR, PLAN.saved.origin_m, name="robot 1")
    welcome = {"kind": "welcome", "settings": {"times": 1.0}, "last_sequence": 6, "plan": mission_told(PLAN, 0),
               "leg": 1, "leg_m": 5.0}  # fmt: skip
    driver.heard(welcome, 0.0)
    state = driver.step(0.0)
    assert (state["leg"], state["leg_m"], state["done"]) == (1, pytest.approx(5.0), False)
    assert state["northing_m"] == pytest.approx(PLAN.saved.origin_m[1] + LENGTH + 5.0)
    release(driver, 3, 0.0)
    assert float(str(let(driver, 0.0, 10.0)["leg_m"])) > 12.0
    before = float(str(driver.step(10.0)["leg_m"]))
    driver.heard(welcome, 10.0)
    assert float(str(driver.step(10.1)["leg_m"])) >= before
