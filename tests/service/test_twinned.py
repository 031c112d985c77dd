"""What twins add to the centre: places for the forecast, paths for the watch; and the chance to keep the deadline."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from planner.fleet.manager.finish_forecast import FinishDistribution, read_finish_distribution
from planner.fleet.manager.fleet_manager import FleetManager
from planner.fleet.model.rules import FleetRules
from planner.fleet.model.tractor_state import Hold
from planner.fleet.safety.motion_prediction import Array
from planner.fleet.session.frame_content import build_tick_fleet
from tests.service.fleets import SimulatedFleet, fleet_plan, start_fleet

WHOLE = FinishDistribution(planned_s=1000.0, p50_s=1100.0, p80_s=1200.0, p95_s=1400.0)


class FixedTwins:
    """Twins of which a test says where they are and will be."""

    def __init__(self) -> None:
        self.places: dict[int, tuple[float, float]] = {}
        self.paths: dict[int, Array] = {}

    def find_place(self, number: int) -> tuple[float, float] | None:
        return self.places.get(number)

    def predict_path(self, number: int, times_s: Array) -> Array | None:
        return self.paths.get(number)


def watched(apart_m: float = 20.0) -> tuple[SimulatedFleet, FixedTwins]:
    twins = FixedTwins()
    fleet = SimulatedFleet(FleetManager(fleet_plan(apart_m=apart_m), FleetRules(), twins))
    fleet.manager.operators.start_fleet_work("anna", 0.0)
    fleet.obey()
    return fleet, twins


def test_the_forecast_begins_where_the_twin_is_by_now() -> None:
    fleet, twins = watched()
    fleet.run(18.0)
    fleet.silent.add(0)  # no more is heard of it, and its twin drives on
    fleet.manager.twins = twins
    before = fleet.manager.states[0].leg_m
    twins.places[0] = (0.0, before + 4.0)
    fleet.run(1.0)
    left_m = 60.0 - before - 4.0
    assert fleet.manager.finish_in_s[0] == pytest.approx(left_m, abs=0.6)
    twins.places[0] = (0.0, before - 3.0)  # behind what it has reported itself
    fleet.run(1.0)
    assert fleet.manager.finish_in_s[0] == pytest.approx(60.0 - before, abs=0.6)


def test_a_place_on_the_next_leg_is_of_that_leg_as_far_as_legs_are_released() -> None:
    course = fleet_plan().timed_missions[0]
    assert course.locate_ahead(0, 18.0, 2, (0.1, 21.5)) == (1, pytest.approx(1.5, abs=0.13))
    assert course.locate_ahead(0, 18.0, 1, (0.1, 21.5)) == (1, pytest.approx(0.0))  # the end of what is released
    assert course.locate_ahead(2, 19.0, 3, (0.0, 70.0)) == (2, pytest.approx(20.0))


@pytest.mark.parametrize("towards, stopped", [(True, True), (False, False)])
def test_who_drives_by_hand_is_foreseen_by_the_twin(towards: bool, stopped: bool) -> None:
    fleet, twins = watched(apart_m=6.0)
    manager = fleet.manager
    fleet.run(5.0)
    one = manager.states[0]
    assert one.report is not None
    one.holds.add(Hold.REMOTE_CONTROL)
    one.report = one.report._replace(mode="remote", speed_mps=1.0)  # straight ahead, and the twin knows better
    x, y = one.report.x_m, one.report.y_m
    steps = np.linspace(0.0, 1.0, 11)
    aside = 6.0 * steps if towards else 0.0 * steps
    twins.paths[0] = np.column_stack([x + aside, y + 5.0 * steps, np.full(11, 0.5 * math.pi)])
    dangers = manager.guard.find_dangers(manager.states)
    assert bool([each for each in dangers if (each.first, each.second) == (0, 1)]) is stopped


def test_chances_of_the_whole_are_those_of_the_draws() -> None:
    for left_s, share in ((1100.0, 0.5), (1200.0, 0.8), (1400.0, 0.95)):
        assert WHOLE.compute_probability(1000.0, left_s) == pytest.approx(share, abs=1e-3)
    assert WHOLE.compute_probability(math.inf, 100.0) is None
    assert (WHOLE.compute_probability(0.0, 1.0), WHOLE.compute_probability(0.0, -1.0)) == (1.0, 0.0)
    sure = FinishDistribution(1000.0, 1000.0, 1000.0, 1000.0)
    assert (sure.compute_probability(500.0, 501.0), sure.compute_probability(500.0, 499.0)) == (1.0, 0.0)


@given(st.floats(0.0, 2000.0), st.floats(-100.0, 3000.0), st.floats(0.0, 500.0))
def test_more_time_never_makes_it_less_likely_nor_less_work(rest_s: float, left_s: float, more_s: float) -> None:
    base = WHOLE.compute_probability(rest_s, left_s)
    later = WHOLE.compute_probability(rest_s, left_s + more_s)
    assert base is not None and later is not None and 0.0 <= base <= later <= 1.0


def test_chances_are_those_of_the_plan_that_is_driven() -> None:
    one = {"strategy": "circuit", "tractors": 2, "time_s": 10.0, "p50_s": 11.0, "p80_s": 12.0, "p95_s": 13.0}
    other = one | {"strategy": "split-field", "p95_s": None}
    result = {"best": one, "plans": [one, other]}
    assert read_finish_distribution(result, "plan.json") == FinishDistribution(10.0, 11.0, 12.0, 13.0)
    assert read_finish_distribution(result, "plan-circuit-2.json") == FinishDistribution(10.0, 11.0, 12.0, 13.0)
    assert read_finish_distribution(result, "plan-split-field-2.json") is None  # made without draws
    assert read_finish_distribution({"best": None, "plans": []}, "plan.json") is None


def test_a_tick_tells_the_probability_where_there_are_draws_and_a_deadline() -> None:
    fleet = start_fleet()
    assert build_tick_fleet(fleet.manager, 65.0, WHOLE)["probability"] is None  # nobody knows how long it takes yet
    fleet.run(5.0)
    drawn = FinishDistribution(60.0, 60.0, 66.0, 72.0)
    told = build_tick_fleet(fleet.manager, 60.0, drawn)
    assert 0.5 < told["probability"] < build_tick_fleet(fleet.manager, 65.0, drawn)["probability"] < 1.0
    assert build_tick_fleet(fleet.manager, None, drawn)["probability"] is None
    assert build_tick_fleet(fleet.manager, 60.0, None)["probability"] is None
