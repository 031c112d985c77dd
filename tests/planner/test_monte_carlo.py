"""Draws against what is known exactly: moments, independent tractors, exponential rain, no noise at all."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from planner.farm.random_inputs import RANDOM_INPUTS, UncertaintySettings, build_certain_settings, compute_log_deviation
from planner.farm.settings import NONE_GIVEN, get_default_source
from planner.request.plan_request import PlanRequest
from planner.risk.assessment import DecisionCriteria, list_sampled_figures
from planner.risk.costs import build_hire_terms
from planner.risk.leg_graph import TURN_OVER_MORE, TURN_OVER_ONE, WORK_PASS, LegGraph, WaitLink
from planner.risk.monte_carlo import (
    compute_slip_factor,
    compute_variance_shares,
    compute_wilson_interval,
    sample_outcomes,
)
from planner.risk.rain import RainForecast
from tests.examples import count_examples

DRAWS = 10_000
HOUR_S = 3600.0


def chain(kind: int, *seconds: float, tractors: int = 1, links: tuple[WaitLink, ...] = ()) -> LegGraph:
    """Tractors with these legs each, every leg a pass or turn of its own; passes work a metre a second."""
    count = len(seconds)
    nodes = tractors * count
    order = sorted(range(nodes), key=lambda node: (node % count, node))
    return LegGraph(
        tractors=tractors, first_nodes=tuple(range(0, nodes, count)), tractor=np.repeat(np.arange(tractors), count),
        driven_s=np.tile(np.array(seconds, float), tractors), group=np.tile(np.arange(count), tractors),
        kind=np.full(nodes, kind), worked_m=np.tile(np.array(seconds, float), tractors) * (kind == WORK_PASS),
        order=tuple(order), links=links, stand_s=np.zeros(nodes),
    )  # fmt: skip


def only(**values: Any) -> UncertaintySettings:
    """Nothing varies but what is named."""
    return build_certain_settings().model_copy(update=values)


def judge(uncertainty: UncertaintySettings, **values: Any) -> DecisionCriteria:
    """Criteria at the prices of hire; what is no rain is asked for."""
    rain = values.pop("rain", None)
    return DecisionCriteria(PlanRequest(start_s=0, **values), uncertainty, build_hire_terms(40.0, 0.0), rain=rain)


def share_done(graph: LegGraph, criteria: DecisionCriteria) -> float:
    """The mean share of the ground that is done at the limit."""
    limit_s = criteria.sample_field_limit_s()
    samples = sample_outcomes(
        graph, criteria.uncertainty, samples=criteria.samples, seed=criteria.request.seed, limit_s=limit_s
    )
    return float(samples.worked_share.mean())


def standard_error(values: Any) -> float:
    return float(np.std(values) / math.sqrt(len(values)))


class TestKnownAnswers:
    @pytest.mark.parametrize(("kind", "cv"), [(TURN_OVER_ONE, 0.21), (TURN_OVER_MORE, 0.13), (WORK_PASS, 0.15)])
    def test_mean_and_variance_of_equal_legs_add(self, kind: int, cv: float) -> None:
        chances = only(turn_cv=0.21, turn_more_cv=0.13, speed_cv=0.15)
        finish = sample_outcomes(chain(kind, *[30.0] * 40), chances, samples=DRAWS, seed=3).finish_s
        spread = compute_log_deviation(cv)
        mean = 40 * 30.0 * math.exp(0.5 * spread * spread)  # 30 s are the median of each
        variance = 40 * (30.0 * math.exp(0.5 * spread * spread) * cv) ** 2
        assert abs(finish.mean() - mean) < 3 * standard_error(finish)
        kurtosis_error = variance * math.sqrt(2.1 / DRAWS)
        assert abs(finish.var() - variance) < 3 * kurtosis_error

    def test_rain_at_a_rate_leaves_the_exponential_law(self) -> None:
        graph, rate = chain(WORK_PASS, 1800.0, 1800.0), 0.4 / HOUR_S
        criteria = judge(build_certain_settings(), rain=RainForecast(rate_per_s=rate), samples=DRAWS)
        probability = list_sampled_figures(graph, criteria, 1.0)["finish_probability"]
        wanted = math.exp(-rate * 3600.0)
        assert abs(probability - wanted) < 3 * math.sqrt(wanted * (1 - wanted) / DRAWS)
        # At a metre a second and onset t the share min(t / T, 1) is done: (1 - exp(-rT)) / rT in the mean.
        done = (1 - math.exp(-rate * 3600.0)) / (rate * 3600.0)
        assert abs(share_done(graph, criteria) - done) < 3 * 0.3 / math.sqrt(DRAWS)

    def test_two_tractors_alone_multiply(self) -> None:
        chances, limit = only(speed_cv=0.3), 1050.0
        both = chain(WORK_PASS, *[100.0] * 10, tractors=2)
        sample = sample_outcomes(both, chances, samples=DRAWS, seed=1)
        one, two = (float((seconds <= limit).mean()) for seconds in sample.tractor_finish_s)
        together = float((sample.finish_s <= limit).mean())
        assert 0.2 < one < 0.9
        assert abs(together - one * two) < 3 * math.sqrt(together * (1 - together) / DRAWS)

    def test_stops_come_at_their_rate_and_last_their_time(self) -> None:
        chances = only(stops_per_hour=4.0, stop_s=60.0, stop_cv=1.0)
        late = sample_outcomes(chain(WORK_PASS, *[360.0] * 20), chances, samples=DRAWS, seed=1).finish_s - 7200.0
        # Compound Poisson: mean n m, variance n (m2 + s2), with 8 stops of 60 s and a deviation of 60 s.
        assert abs(late.mean() - 480.0) < 3 * standard_error(late)
        assert late.var() == pytest.approx(8 * (60.0**2 + 60.0**2), rel=0.1)

    def test_breakdowns_leave_the_share_that_had_none(self) -> None:
        chances = only(breakdown_hours=10.0)
        spared = float(
            (sample_outcomes(chain(WORK_PASS, 7200.0), chances, samples=DRAWS, seed=1).finish_s == 7200.0).mean()
        )
        wanted = math.exp(-0.2)
        assert abs(spared - wanted) < 3 * math.sqrt(wanted * (1 - wanted) / DRAWS)

    def test_a_late_start_shifts_the_fleet_by_its_law(self) -> None:
        chances = only(start_delay_s=600.0, start_delay_cv=1.0)
        sample = sample_outcomes(chain(WORK_PASS, 1000.0, tractors=2), chances, samples=DRAWS, seed=1)
        assert (sample.tractor_finish_s[0] == sample.tractor_finish_s[1]).all()
        late = sample.finish_s - 1000.0
        assert abs(late.mean() - 600.0) < 3 * standard_error(late)

    def test_durations_are_drawn_from_those_that_were_seen(self) -> None:
        chances = only(stops_per_hour=0.5, stop_durations_s=(10.0, 300.0))
        late = sample_outcomes(chain(WORK_PASS, 600.0), chances, samples=DRAWS, seed=1).finish_s - 600.0
        single = set(np.round(late[(late > 0) & (late <= 300.0)], 6).tolist())
        assert {10.0, 300.0} <= single <= {10.0 * n for n in range(31)}

    @pytest.mark.parametrize(("limit", "wanted"), [(999, 0.0), (1001, 1.0)])
    def test_without_noise_a_plan_is_in_time_or_not(self, limit: int, wanted: float) -> None:
        graph = chain(WORK_PASS, 400.0, 600.0)
        criteria = judge(build_certain_settings(), deadline_s=limit, samples=50)
        found = list_sampled_figures(graph, criteria, 1.0)
        assert found["finish_probability"] == wanted
        assert (found["p50_s"], found["p95_s"]) == (1000.0, 1000.0)
        assert set(compute_variance_shares(graph, criteria.uncertainty, samples=50, seed=1).values()) == {0.0}
        assert 1.0 - share_done(graph, criteria) == pytest.approx(max(0.0, 1.0 - limit / 1000.0))

    @pytest.mark.parametrize("name", ["speed_cv", "turn_cv", "job_cv", "stops_per_hour"])
    def test_more_noise_never_helps_a_plan_that_is_early(self, name: str) -> None:
        graph = chain(TURN_OVER_ONE if name == "turn_cv" else WORK_PASS, *[60.0] * 30)
        criteria = judge(UncertaintySettings(), deadline_s=1890, samples=4000)
        shares = [
            list_sampled_figures(graph, replace(criteria, uncertainty=only(**{name: value})), 1.0)["finish_probability"]
            for value in (0.0, 0.1, 0.2, 0.4, 0.8)
        ]
        assert shares[0] == 1.0 and shares == sorted(shares, reverse=True) and shares[-1] < 1.0


class TestGates:
    def test_a_gate_holds_until_the_other_has_driven_so_far(self) -> None:
        # The second may begin its second leg when the first has driven 200 s of its own, and needs 2 s to move off.
        graph = chain(
            WORK_PASS, 50.0, 300.0, tractors=2, links=(WaitLink(source=1, after=3, offset_s=200.0, delay_s=2.0),)
        )
        graph = replace(graph, order=(0, 1, 2, 3))
        sample = sample_outcomes(graph, build_certain_settings(), samples=1, seed=1)
        assert sample.tractor_finish_s[:, 0].tolist() == [350.0, 50.0 + 200.0 + 2.0 + 300.0]

    def test_who_is_late_makes_the_other_late(self) -> None:
        graph = chain(
            WORK_PASS, 50.0, 300.0, tractors=2, links=(WaitLink(source=1, after=3, offset_s=299.0, delay_s=0.0),)
        )
        graph = replace(graph, order=(0, 1, 2, 3))
        sample = sample_outcomes(graph, only(stops_per_hour=2.0, stop_s=100.0), samples=2000, seed=1)
        held = sample.tractor_finish_s[0] > 350.0
        # Its last second apart, everything that held up the first comes before the second may go.
        after = sample.tractor_finish_s[1] >= sample.tractor_finish_s[0] - 1.0 + 300.0 - 1e-6
        assert held.any() and after[held].mean() > 0.98


class TestCommonNumbers:
    def test_the_same_seed_is_the_same_weather_and_luck_for_every_plan(self) -> None:
        rain = RainForecast(rate_per_s=1e-4)
        assert (rain.draw_onsets(100, 5) == rain.draw_onsets(100, 5)).all()
        assert (rain.draw_onsets(100, 5) != rain.draw_onsets(100, 6)).all()
        small, large = chain(WORK_PASS, 100.0), chain(WORK_PASS, *[50.0] * 7, tractors=3)
        job = only(job_cv=0.2)
        one, other = (sample_outcomes(graph, job, samples=100, seed=5).finish_s for graph in (small, large))
        assert one / 100.0 == pytest.approx(other / 350.0)

    def test_what_is_switched_off_does_not_move_the_rest(self) -> None:
        graph = chain(WORK_PASS, *[300.0] * 10)
        whole, calm = (
            UncertaintySettings(start_delay_s=0.0),
            UncertaintySettings(start_delay_s=0.0).disable_input("stops").disable_input("breakdowns"),
        )
        one, other = (sample_outcomes(graph, chances, samples=3000, seed=1).finish_s for chances in (whole, calm))
        assert (one >= other - 1e-9).all() and 0.05 < float((one == other).mean()) < 0.95

    def test_drivers_name_what_spreads_the_time(self) -> None:
        graph = chain(WORK_PASS, *[300.0] * 10)
        shares = compute_variance_shares(graph, only(job_cv=0.2, speed_cv=0.02), samples=2000, seed=1)
        assert next(iter(shares)) == "conditions of the day" and shares["stops"] == 0.0
        assert shares["conditions of the day"] > 0.9
        assert set(shares) == set(RANDOM_INPUTS)


def test_slip_at_its_median_changes_nothing_and_more_slip_is_slower() -> None:
    factor = compute_slip_factor(UncertaintySettings(slip_pct=10.0, slip_cv=0.3), np.array([-1.0, 0.0, 1.0]))
    assert factor[1] == 1.0 and factor[0] < 1.0 < factor[2]
    assert factor[2] == pytest.approx(0.9 / (1 - 0.1 * math.exp(compute_log_deviation(0.3))))
    # Quartiles of the log that the default is from: 6.2 and 9.0 %.
    quartile = 0.6745 * compute_log_deviation(UncertaintySettings().slip_cv)
    assert 7.6 * math.exp(-quartile) == pytest.approx(6.2, abs=0.2)
    assert 7.6 * math.exp(quartile) == pytest.approx(9.0, abs=0.2)


def test_the_stops_of_the_default_have_the_median_that_was_measured() -> None:
    chances = UncertaintySettings()
    assert chances.stop_s * math.exp(-0.5 * compute_log_deviation(chances.stop_cv) ** 2) == pytest.approx(12.0, abs=0.2)


class TestWilson:
    def test_half_of_a_hundred(self) -> None:
        # Worked by hand: centre 0.5, half width 1.96 / 1.0384 * sqrt(0.0025 + 0.0096)
        assert compute_wilson_interval(50, 100) == pytest.approx((0.4038, 0.5962), abs=1e-4)

    @given(st.integers(1, 5000), st.data())
    @settings(max_examples=count_examples(60))
    def test_holds_the_share_and_stays_inside(self, of: int, data: st.DataObject) -> None:
        hits = data.draw(st.integers(0, of))
        low, high = compute_wilson_interval(hits, of)
        assert 0.0 <= low <= hits / of <= high <= 1.0
        assert low < high


class TestSettings:
    def test_every_default_has_a_source(self) -> None:
        keys = UncertaintySettings.model_fields
        assert all(get_default_source(UncertaintySettings, key) != NONE_GIVEN for key in keys)

    @pytest.mark.parametrize(
        ("values", "word"),
        [
            ({"speed_cv": -0.1}, "speed_cv\n.*greater than or equal to 0 .*-0.1"),
            ({"stop_s": math.nan}, "stop_s\n.*finite number"),
            ({"slip_pct": 95.0}, "slip_pct\n.*less than or equal to 90"),
            ({"job_cv": True}, "job_cv\n.*valid number"),
            ({"stop_durations_s": (3.0, -1.0)}, "stop_durations_s.1\n.*-1"),
        ],
    )
    def test_what_cannot_be_is_refused(self, values: dict[str, Any], word: str) -> None:
        with pytest.raises(ValidationError, match=word):
            UncertaintySettings(**values)
