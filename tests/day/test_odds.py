"""Draws chained along the day of a fleet: closed forms, and what shifts what."""

import math
from dataclasses import replace

import numpy as np
import pytest

from planner.day.formulation import FleetDaySamples, PlannedRouteField, convert_rain_onsets, sample_fleet_day
from planner.farm.random_inputs import UncertaintySettings, build_certain_settings
from planner.farm.workday import Workday
from planner.risk.costs import build_hire_terms
from planner.risk.leg_graph import TURN_OVER_MORE, WORK_PASS, LegGraph
from planner.risk.rain import RainForecast

DRAWS = 10_000
DRY = np.full(DRAWS, math.inf)


def one_leg(seconds: float) -> LegGraph:
    """A tractor that drives one pass."""
    return LegGraph(
        tractors=1, first_nodes=(0,), tractor=np.zeros(1, np.int64), driven_s=np.array([seconds]),
        group=np.zeros(1, np.int64), kind=np.array([WORK_PASS]), worked_m=np.array([100.0]), order=(0,), links=(),
        stand_s=np.zeros(1),
    )  # fmt: skip


def stop(
    seconds: float, seed: int, *, move_s: float = 0.0, window: tuple[float, float] = (0.0, 1e9)
) -> PlannedRouteField:
    return PlannedRouteField(one_leg(seconds), move_s, *window, build_hire_terms(36.0, 0.0), 100.0, seed)


def chain(
    stops: list[PlannedRouteField], uncertainty: UncertaintySettings | None = None, rain: np.ndarray = DRY
) -> FleetDaySamples:
    return sample_fleet_day(stops, uncertainty or build_certain_settings(), 0.0, rain, seed=1, fleet="one")


def within(share: float, truth: float) -> bool:
    """Whether a share of the draws is the truth, by three standard errors."""
    return abs(share - truth) <= 3.0 * math.sqrt(truth * (1.0 - truth) / DRAWS)


def test_without_chance_the_day_is_the_plan() -> None:
    found = chain([stop(1000.0, 1, move_s=300.0), stop(500.0, 2, move_s=200.0, window=(4000.0, 9000.0))])
    assert (found.end_s[0] == 1300.0).all() and (found.end_s[1] == 4500.0).all()
    assert found.in_time.all() and found.lost_cost.tolist() == [0.0, 0.0]
    assert found.work_cost.tolist() == pytest.approx([10.0, 5.0])


def test_the_share_that_rain_and_windows_take() -> None:
    """Rain at 1600 s: 300 of 500 s of the second field are not done; a window takes 100 of 1000 s of the first."""
    stops = [stop(1000.0, 1, window=(0.0, 900.0)), stop(500.0, 2, move_s=400.0)]
    found = chain(stops, rain=np.full(DRAWS, 1600.0))
    assert not found.in_time.any()
    assert found.lost_cost.tolist() == pytest.approx([10.0, 60.0])


def test_exponential_rain_is_exact_for_every_field() -> None:
    per_s = 1.0 / 4000.0
    rain = RainForecast(rate_per_s=per_s).draw_onsets(DRAWS, 1)
    found = chain([stop(1000.0, 1, move_s=200.0), stop(2000.0, 2, move_s=300.0)], rain=rain)
    for place, end in enumerate((1200.0, 3500.0)):
        assert within(found.estimate_in_time_probability(place)[0], math.exp(-per_s * end))
    assert (found.in_time[0] | ~found.in_time[1]).all(), "the same rain for both"


def test_moments_of_fields_add_up_along_the_day() -> None:
    """Each field has a lognormal factor of its own: means and variances of the ends add."""
    cv, median = 0.2, (1000.0, 1500.0)
    spread = math.log1p(cv * cv)
    uncertainty = UncertaintySettings(**{**vars(build_certain_settings()), "job_cv": cv})
    ends = chain([stop(median[0], 1), stop(median[1], 2)], uncertainty).end_s
    means = [value * math.exp(0.5 * spread) for value in median]
    deviation = [value * cv for value in means]
    both = math.hypot(*deviation)
    assert abs(float(ends[1].mean()) - sum(means)) <= 3.0 * both / math.sqrt(DRAWS)
    assert float(ends[1].std()) == pytest.approx(both, rel=0.05)
    assert abs(float(np.corrcoef(ends[0], ends[1] - ends[0])[0, 1])) < 0.04


def test_a_late_first_field_shifts_the_next() -> None:
    uncertainty = UncertaintySettings(**{**vars(build_certain_settings()), "job_cv": 0.3})
    first, second = chain([stop(1000.0, 1), stop(500.0, 2)], uncertainty).end_s
    assert (second > first).all() and float(np.corrcoef(first, second)[0, 1]) > 0.8
    late = UncertaintySettings(**{**vars(build_certain_settings()), "start_delay_s": 600.0, "start_delay_cv": 1.0})
    shifted = chain([stop(1000.0, 1), stop(500.0, 2)], late).end_s
    assert float(shifted[0].mean()) == pytest.approx(1600.0, rel=0.03)
    assert shifted[1] - shifted[0] == pytest.approx(np.full(DRAWS, 500.0)), "late once a day"


def test_rain_in_a_break_is_rain_at_its_beginning() -> None:
    found = convert_rain_onsets(
        np.array([100.0, 1500.0, 4000.0, math.inf]), 1000.0, Workday(1000, breaks_s=((2000, 3000),))
    )
    assert found.tolist() == [1100.0, 2000.0, 4000.0, math.inf]


def test_the_way_out_is_not_work_that_must_be_in_time() -> None:
    """A pass of 1000 s and 200 s to the entrance: rain or the end of the hours in between finds the work done."""
    leaves = replace(
        one_leg(1000.0), tractor=np.zeros(2, np.int64), driven_s=np.array([1000.0, 200.0]),
        kind=np.array([WORK_PASS, TURN_OVER_MORE]), group=np.array([0, 1]),
        worked_m=np.array([100.0, 0.0]), order=(0, 1), stand_s=np.zeros(2),
        leaving=np.array([False, True]),
    )  # fmt: skip
    first = replace(stop(1.0, 1, window=(0.0, 1100.0)), graph=leaves)
    found = chain([first, stop(500.0, 2)], rain=np.where(np.arange(DRAWS) % 2, 1050.0, 999.0))
    assert found.in_time[0].tolist() == [False, True] * (DRAWS // 2)
    assert (found.end_s[0] == 1200.0).all() and (found.end_s[1] == 1700.0).all(), "the next begins when it is gone"
